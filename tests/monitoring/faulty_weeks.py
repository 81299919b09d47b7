"""Weeks of the simulated shop with one fault, written as its agent's log, read by the pipeline.

Faults act on the simulated machine: on its parameters, on what its tools meet, on what its sensors
read. Nothing of the twin takes part.
"""

import json
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.parameters import read_params, structure
from pipeline.schema.bundle import BUNDLE, bundle_of, stored_bundle
from pipeline.schema.si import DAY
from pipeline.schema.store import write_json
from pipeline.shop import schedule, sensors
from pipeline.shop.agent_log import Log, write_day
from pipeline.shop.parameters import Random, ShopParameters
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.sensors import MachineState, SensedDay
from pipeline.shop.timeline import Execution, Timeline
from pipeline.stages.__main__ import run
from tests.small_project import inside

WEDNESDAY = 2
"""Day of the week on which a fault begins; what came before is quiet."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault: what it does to a day before it is sensed, and to what the sensors read then.

    ``before`` gives the first and last second of the day in which it acts; None where it does not.
    """

    before: Callable[[MachineState, Timeline, int], tuple[int, int] | None] | None = None
    after: Callable[[SensedDay, int], tuple[int, int] | None] | None = None
    override: float = 0.0
    """Feed override that somebody leaves set, from the fault on [%]; 0 for none."""


def set_spindle(machine: MachineState, **parts: Any) -> None:
    """Change parameters of the simulated spindle from now on."""
    spindle = machine.parameters.spindle
    machine.parameters = replace(machine.parameters, spindle=replace(spindle, **parts))


def day_span(day: Timeline) -> tuple[int, int]:
    """From switching on to switching off."""
    return day.on, day.off


def cooling_failure(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """The pump of the chiller stands: its jackets keep a twentieth of their conductance."""
    if since == 0:
        paths = machine.parameters.spindle.paths
        set_spindle(
            machine,
            paths=replace(
                paths,
                stator_jacket=0.05 * paths.stator_jacket,
                housing_jacket=0.05 * paths.housing_jacket,
            ),
        )
    return day.on, day.off


def bearing_friction(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """Lubricant's share of the friction of both bearings: twice as high each day."""
    spindle = machine.parameters.spindle
    set_spindle(
        machine,
        front=replace(spindle.front, f0=min(2.0 * spindle.front.f0, 10.0)),
        rear=replace(spindle.rear, f0=min(2.0 * spindle.rear.f0, 10.0)),
    )
    return day.on, day.off


def _operations(day: Timeline, least: float) -> list[tuple[int, int]]:
    """Spans of a day in which one tool cuts, each longer than four minutes, at ``least`` [W]."""
    heavy = day.cut_power >= least
    key = np.where(
        heavy | (day.execution == Execution.ACTIVE), day.tool * 10000 + day.line // 100, -1
    )
    edges = np.flatnonzero(np.diff(key)) + 1
    spans = zip([0, *edges], [*edges, DAY], strict=True)
    return [(int(a), int(b)) for a, b in spans if b - a > 240 and heavy[a:b].mean() > 0.5]


def one_operation(day: Timeline, since: int, least: float) -> tuple[int, int] | None:
    """The operation after ten o'clock of the first day."""
    found = [one for one in _operations(day, least) if one[0] > 10 * 3600]
    return found[0] if since == 0 and found else None


def tool_breakage(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """Half a minute into an operation the tool breaks: it meets nothing for the next half hour."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := one_operation(day, since, 0.15 * rated)) is None:
        return None
    a = found[0] + 30
    b, tool = min(a + 1800, day.off), day.tool[a]
    day.cut_power[a:b][day.tool[a:b] == tool] = 0.0
    return a, b


def worn_tool(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """A tool needs 1.6 times its power from ten o'clock on to the end of the day."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := one_operation(day, since, 0.15 * rated)) is None:
        return None
    a = found[0]
    day.cut_power[a:][day.tool[a:] == day.tool[a]] *= 1.6
    return a, day.off


def overload(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """For two minutes a cut needs 1.3 times the rated power."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := one_operation(day, since, 0.15 * rated)) is None:
        return None
    a, b = found[0] + 60, found[0] + 180
    day.cut_power[a:b] = 1.3 * rated
    return a, b


def load_without_feed(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """For two minutes the tool is jammed: the feed stands at 80 % load, the program runs."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := one_operation(day, since, 0.15 * rated)) is None:
        return None
    a, b = found[0] + 60, found[0] + 180
    day.cut_power[a:b], day.feed[a:b] = 0.8 * rated, 0.0
    for axis in (day.x, day.y, day.z):
        axis[a:b] = np.nan
    return a, b


def dead_sensor(day: SensedDay, since: int) -> tuple[int, int] | None:
    """From ten o'clock on the first day the sensor says the same, over days."""
    a = 10 * 3600 if since == 0 else 0
    one = day.numbers["S1temp"]
    one[a:] = 37.0
    return max(a, day.timeline.on), day.timeline.off


def drifting_sensor(day: SensedDay, since: int) -> tuple[int, int] | None:
    """From ten o'clock of the first day the sensor reads 1 K more each hour of the clock."""
    hours = (np.arange(DAY) + since * DAY) / 3600 - 10
    day.numbers["S1temp"] = np.floor(day.numbers["S1temp"] + np.maximum(hours, 0.0))
    return max(10 * 3600 if since == 0 else 0, day.timeline.on), day.timeline.off


FAULTS: dict[str, Fault] = {
    "cooling failure": Fault(before=cooling_failure),
    "bearing friction": Fault(before=bearing_friction),
    "dead sensor": Fault(after=dead_sensor),
    "drifting sensor": Fault(after=drifting_sensor),
    "tool breakage": Fault(before=tool_breakage),
    "worn tool": Fault(before=worn_tool),
    "overload": Fault(before=overload),
    "load without feed": Fault(before=load_without_feed),
}
QUIET = Fault()


@contextmanager
def overridden(percent: float) -> Iterator[None]:
    """Every run of the shop has this feed override; 0 leaves it to the operators."""
    usual = schedule._overrides

    def fixed(day: Timeline, t: int, run: schedule.Run, random: Random) -> None:
        usual(day, t, run, random)
        day.feed_override[t:] = percent

    schedule._overrides = fixed if percent else usual
    try:
        yield
    finally:
        schedule._overrides = usual


def write_weeks(
    out: Path, parameters: ShopParameters, fault: Fault = QUIET
) -> list[tuple[int, int]]:
    """Write the agent's log of all weeks; spans [ns] in which the fault acted.

    It begins on the first Wednesday, or as soon as the machine does what it needs.
    """
    ambient = sensors.ambient_temperature(parameters)
    shop = Shop(parameters=parameters, random=parameters.generator("schedule"))
    machine = sensors.new_machine(parameters, float(ambient[0]))
    log = Log(parameters=parameters, folder=out, random=parameters.generator("log"))
    spans, tips, began = list[tuple[int, int]](), [], parameters.days
    for number in range(parameters.days):
        slow = fault.override if number >= WEDNESDAY else 0.0
        with overridden(slow):
            timeline, since = working_day(shop, number), max(number - began, 0)
        acted = number >= WEDNESDAY and timeline.on < DAY
        found = fault.before(machine, timeline, since) if acted and fault.before else None
        day = sensors.sensed_day(machine, timeline, sensors.air_of_day(ambient, number))
        if acted and fault.after:
            found = fault.after(day, since)
        write_day(log, day)
        tips.append(sensors.tip_temperatures(day))
        if fault.override and acted:
            found = day_span(timeline)
        if found is not None:
            began = min(began, number)
            start = (
                parameters.start.astype("datetime64[ns]").astype(np.int64) + number * DAY * 10**9
            )
            spans.append((int(start + found[0] * 10**9), int(start + found[1] * 10**9)))
    sensors.write_thermocouples(out / "thermocouples", np.concatenate(tips), parameters)
    return spans


MACHINE = "mill01"
QUIET_WEEKS, QUIET_FROM, FAULTS_FROM = 10, date(2026, 3, 2), date(2026, 6, 1)
"""Quiet weeks and their first Monday; Monday from which on each week has a fault."""
SERVING = ("spindle", "cutting")
"""Sub-models whose estimates monitoring reads; the others need records that are left out here."""
WEEKS = "weeks.json"


@dataclass(frozen=True, kw_only=True)
class Week:
    """A week of the project: its fault, its first day, spans [ns] in which the fault acted."""

    fault: str
    first: str
    spans: list[tuple[int, int]]

    def days(self) -> list[str]:
        return [str(date.fromisoformat(self.first) + timedelta(days=k)) for k in range(7)]


def project_with_weeks(
    built: Path, folder: Path, seeds: int, faults: Mapping[str, Fault] = FAULTS,
    quiet: int = QUIET_WEEKS,
) -> list[Week]:  # fmt: skip
    """A built project of the simulated fleet, and after its records weeks of each fault.

    The training days stay as they are: what serves was fitted on them, and they are known-good.
    """
    for name in ("golden", "settings"):
        shutil.copytree(built / "data" / name, folder / "data" / name)
    shutil.copytree(built / "conf", folder / "conf")
    shutil.copy(built / "params.yaml", folder / "params.yaml")
    champion = folder / "data/champion" / MACHINE
    serving = stored_bundle(built / "data/champion" / MACHINE, MACHINE)
    assert serving is not None, f"nothing serves {MACHINE} in {built}"
    for name in SERVING:
        shutil.copytree(built / "data/champion" / MACHINE / name, champion / name)
    own = bundle_of(champion, MACHINE, {name: serving.submodels[name] for name in SERVING})
    write_json(own, champion / BUNDLE)
    raw = folder / "data/raw" / MACHINE
    for name in ("agent", "thermocouples", "cutting", "programs"):
        shutil.copytree(built / "data/raw" / MACHINE / name, raw / name)
    shutil.copy(built / "data/raw" / MACHINE / "Devices.xml", raw / "Devices.xml")
    with inside(folder):
        parameters = structure(read_params(), f"machine.{MACHINE}.shop", ShopParameters)
        weeks = list(_written_weeks(Path("data/raw") / MACHINE, parameters, seeds, faults, quiet))
        paths = {name: f"data/{name}/{MACHINE}" for name in
                 ("champion", "raw", "signals", "clean", "twin_state", "usual")}  # fmt: skip
        run(f"ingest@{MACHINE}", paths["raw"], paths["signals"])
        run(f"clean@{MACHINE}", paths["signals"], paths["clean"])
        run(f"state@{MACHINE}", paths["champion"], "champions.json",
            *(paths[n] for n in ("raw", "signals", "clean")), "data/golden",
            paths["twin_state"])  # fmt: skip
    document = [vars(one) for one in weeks]
    (folder / WEEKS).write_text(json.dumps(document))
    return weeks


def _written_weeks(
    raw: Path, parameters: ShopParameters, seeds: int, faults: Mapping[str, Fault], quiet: int
) -> Iterator[Week]:
    if quiet:
        write_weeks(raw, replace(parameters, seed=100, weeks=quiet, first_day=str(QUIET_FROM)))
    for k in range(quiet):
        yield Week(fault="", first=str(QUIET_FROM + timedelta(weeks=k)), spans=[])
    first = FAULTS_FROM
    for seed in range(1, seeds + 1):
        for name, fault in faults.items():
            week = replace(parameters, seed=seed, weeks=1, first_day=str(first))
            yield Week(fault=name, first=str(first), spans=write_weeks(raw, week, fault))
            first += timedelta(weeks=1)


def read_weeks(folder: Path) -> list[Week]:
    """Weeks of a project that :func:`project_with_weeks` made."""
    return [Week(**one) for one in json.loads((folder / WEEKS).read_text())]
