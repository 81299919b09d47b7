"""Replay of faults of the simulated shop names the sub-model that explains the residual.

The weeks are those of the test of incidents and others, of other kinds and smaller sizes;
``KERF_WEEKS`` and ``KERF_MORE_WEEKS`` name projects of them that an earlier run has made.  Quiet
weeks name nothing.
"""

import os
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.app.replay import replayed
from pipeline.monitoring.replay import Replay
from pipeline.monitoring.replay_parts import SENSOR
from pipeline.shop.sensors import MachineState, SensedDay
from pipeline.shop.timeline import Timeline
from tests.monitoring import faulty_weeks
from tests.monitoring.faulty_weeks import (
    MACHINE,
    QUIET_WEEKS,
    Fault,
    Week,
    day_span,
    one_operation,
    project_with_weeks,
    read_weeks,
    set_spindle,
)
from tests.monitoring.test_incidents_proof import BUILT
from tests.small_project import inside

RIGHT: Mapping[str, tuple[str, ...]] = {
    "cooling failure": ("spindle",), "weaker cooling": ("spindle",),
    "bearing friction": ("spindle",), "stiffer lubricant": ("spindle",),
    "dead sensor": (SENSOR,), "drifting sensor": (SENSOR,), "sensor offset": (SENSOR,),
    "slow drift": (SENSOR,), "load meter": (SENSOR,),
    "tool breakage": ("cutting",), "worn tool": ("cutting",), "blunter tool": ("cutting",),
    "overload": ("cutting",),
    "axis friction": ("drive",), "stiff grease": ("drive",), "override left": ("control",),
    "load without feed": (), "": (),
}  # fmt: skip
"""What a replay is to name; nothing where no sub-model has what happened, or nothing did."""
SHORT = {"overload", "load without feed"}
"""Faults of two minutes: replayed from a quarter of an hour before to one after."""
SEEDS = 2


def cooling_weaker(machine: MachineState, day: Timeline, since: int) -> tuple[int, int]:
    """The filter of the chiller clogs: the jackets keep a third of their conductance."""
    if since == 0:
        paths = machine.parameters.spindle.paths
        set_spindle(machine, paths=replace(paths, stator_jacket=0.35 * paths.stator_jacket,
                                        housing_jacket=0.35 * paths.housing_jacket))  # fmt: skip
    return day_span(day)


def lubricant_stiffer(machine: MachineState, day: Timeline, since: int) -> tuple[int, int]:
    """The lubricant's share of the bearings' friction is three times as high from one day on."""
    if since == 0:
        spindle = machine.parameters.spindle
        set_spindle(machine, front=replace(spindle.front, f0=3.0 * spindle.front.f0),
                 rear=replace(spindle.rear, f0=3.0 * spindle.rear.f0))  # fmt: skip
    return day_span(day)


def tool_blunter(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """A tool needs 1.35 times its power from ten o'clock on to the end of the day."""
    found = one_operation(day, since, 0.15 * machine.parameters.spindle.motor.rated_power)
    if found is None:
        return None
    day.cut_power[found[0] :][day.tool[found[0] :] == day.tool[found[0]]] *= 1.35
    return found[0], day.off


def sensor_offset(day: SensedDay, since: int) -> tuple[int, int]:
    """The sensor of the spindle reads 6 K more from one morning on."""
    day.numbers["S1temp"] = np.asarray(day.numbers["S1temp"] + 6.0)
    return day_span(day.timeline)


def sensor_slow_drift(day: SensedDay, since: int) -> tuple[int, int]:
    """The sensor of the spindle reads 0.4 K less each hour of the clock."""
    hours = np.arange(86400) / 3600 + 24 * since - day.timeline.on / 3600 * (since == 0)
    day.numbers["S1temp"] = np.floor(day.numbers["S1temp"] - 0.4 * np.maximum(hours, 0.0))
    return day_span(day.timeline)


def load_meter(day: SensedDay, since: int) -> tuple[int, int]:
    """The load of the spindle reads 1.4 times what it is."""
    day.numbers["S1load"] = np.round(1.4 * day.numbers["S1load"])
    return day_span(day.timeline)


def axis_friction(day: SensedDay, since: int) -> tuple[int, int]:
    """A cover rubs: the X axis needs 12 % more load while it moves."""
    moves = day.numbers["Xfeed"] > 0
    day.numbers["Xload"] = day.numbers["Xload"] + np.where(moves, 12.0, 0.0)
    return day_span(day.timeline)


def axis_viscous(day: SensedDay, since: int) -> tuple[int, int]:
    """Stiff grease: the Z axis needs three times the load that goes with its speed."""
    day.numbers["Zload"] = np.round(
        day.numbers["Zload"] + 2.0 * 0.12 * np.minimum(np.abs(day.numbers["Zfeed"]), 300)
    )
    return day_span(day.timeline)


FAULTS: dict[str, Fault] = {
    "weaker cooling": Fault(before=cooling_weaker),
    "stiffer lubricant": Fault(before=lubricant_stiffer),
    "blunter tool": Fault(before=tool_blunter),
    "sensor offset": Fault(after=sensor_offset),
    "slow drift": Fault(after=sensor_slow_drift),
    "load meter": Fault(after=load_meter),
    "axis friction": Fault(after=axis_friction),
    "stiff grease": Fault(after=axis_viscous),
    "override left": Fault(override=60.0),
}


pytestmark = [
    pytest.mark.proof,
    pytest.mark.skipif(
        not (BUILT / "data/champion" / MACHINE).exists() and "KERF_WEEKS" not in os.environ,
        reason="needs a built simulated fleet (`make repro`; KERF_BUILT names another)",
    ),
]


def weeks_of(
    variable: str, folder: Path, seeds: int, faults: Mapping[str, Fault], quiet: int
) -> tuple[Path, list[Week]]:
    """A project of weeks, made anew where the variable names none."""
    if made := os.environ.get(variable):
        return Path(made), read_weeks(Path(made))
    return folder, project_with_weeks(BUILT, folder, seeds, faults, quiet)


def replay_of(week: Week, out: Path) -> Replay:
    """Replay of the days on which a fault acted, of a quiet week all of it."""
    times = [np.datetime64(ns, "ns") for span in week.spans for ns in span]
    if not times:
        return replayed(MACHINE, week.days()[0], week.days()[-1], "", out)
    about = np.timedelta64(900 if week.fault in SHORT else 0, "s")
    first, last = (str(one)[: 19 if week.fault in SHORT else 10]
                   for one in (times[0] - about, times[-1] + about))  # fmt: skip
    return replayed(MACHINE, first, last, "", out)


def test_the_sub_model_of_a_fault_is_named_in_nine_of_ten(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    folders, out = (
        [tmp_path_factory.mktemp(name) for name in ("weeks", "more")],
        tmp_path_factory.mktemp("out"),
    )
    made = [weeks_of("KERF_WEEKS", folders[0], 3, faulty_weeks.FAULTS, QUIET_WEEKS),
            weeks_of("KERF_MORE_WEEKS", folders[1], SEEDS, FAULTS, 0)]  # fmt: skip
    right: dict[str, list[bool]] = {}
    for folder, weeks in made:
        with inside(folder):
            for week in weeks:
                found = replay_of(week, out)
                right.setdefault(week.fault, []).append(found.named == RIGHT[week.fault])
                sys.stdout.write(f"{week.fault or 'quiet'} {week.first}: {found.sentence}\n")
    rows = [f"{name or 'quiet'} {sum(hits)}/{len(hits)}" for name, hits in right.items()]
    sys.stdout.write("; ".join(rows) + "\n")
    assert all(right.pop("")), "a quiet week names a sub-model"
    hits = [hit for some in right.values() for hit in some]
    assert sum(hits) >= 0.9 * len(hits)
