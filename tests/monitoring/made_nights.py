"""Nights of machines whose truth is known, quiet or with one thing that has changed.

Spindle, feed axis and cut are simulated by programs that share nothing with the twin but the
thermal network; each sub-model is really fitted and judged before its nights.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import date, timedelta
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.nightly import ServingModel, scored
from pipeline.schema.drive import DriveModel
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.ledger import Night
from pipeline.schema.model import Model, SourceFile
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Fact, Role
from pipeline.signals.conditions import Condition
from pipeline.signals.recordings import Recording as RecordedFile
from pipeline.submodels.cases import Case, Cases, Roles, conditions_of
from pipeline.submodels.contract import submodel
from pipeline.submodels.cutting.identify import cutting_model, identify_cutting_force
from pipeline.submodels.cutting.settings import CuttingLimits, CuttingRecords
from pipeline.submodels.cutting.submodel import Judging as CuttingJudging
from pipeline.submodels.cutting.submodel import _facts
from pipeline.submodels.drive.model import identified_axis, stored_axis
from pipeline.submodels.drive.records import (
    AxisChannels,
    AxisConstants,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
)
from pipeline.submodels.drive.submodel import DriveLimits, drive_case
from pipeline.submodels.drive.submodel import Judging as DriveJudging
from pipeline.submodels.judge import judge
from pipeline.submodels.spindle.calibration import ForestSettings
from pipeline.submodels.spindle.days import IntervalSettings, SpindleLimits
from pipeline.submodels.spindle.fit import SpindleFitSettings
from pipeline.submodels.spindle.submodel import Fitting
from pipeline.submodels.spindle.submodel import Judging as SpindleJudging
from pipeline.thermal.network import heat_sources, temperatures
from pipeline.twin.spindle import SpindleRecords
from tests.submodels.cutting.recorded import SETTINGS as CUT
from tests.submodels.cutting.recorded import SLOT, known_of
from tests.submodels.cutting.recorded import recording as recorded_cut
from tests.submodels.drive.servo_rig import Rig, recording, strokes
from tests.submodels.spindle.spindle_days import ONE, schedule

SETTINGS = MonitoringSettings()
MONDAY = date(2026, 1, 5)
TRAINED, JUDGED = 5, 5
"""Days of the fit and of the judgement, before the nights."""
RECORDS = SpindleRecords(ambient=True)
IDENTITY = MachineIdentity(name="mill", description="a mill", origin="simulated")
FITTING = Fitting(
    identity=IDENTITY, roles=Roles(), spindle=RECORDS,
    spindle_fit=SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,), nodes=(1,)),
    residual_forest=ForestSettings(trees=3, depth=3, every_s=1800.0, sample_s=300.0),
    spindle_interval=IntervalSettings(folds=3),
)  # fmt: skip
SPINDLE = SpindleJudging(
    identity=IDENTITY, roles=Roles(), spindle=RECORDS, spindle_limits=SpindleLimits()
)


@dataclass(frozen=True, kw_only=True)
class SpindleFault:
    """Change of a spindle or its records."""

    offset_K: float = 0.0
    noise_K: float = 0.2
    stuck: bool = False
    cooling: float = 1.0
    """Factor on the cooling rate."""
    speed: float = 1.0
    """Factor on all speeds."""


def spindle_day(seed: int, number: int, fault: SpindleFault) -> pd.DataFrame:
    """State table of a working day of 7 hours at 10 s, in air that differs from day to day.

    Bearings heat more than the network knows above 900 rad/s; heat and cooling vary by 2 %.
    """
    rng = np.random.default_rng([seed, number])
    steps, step = 2520, 10.0
    speed, load, _ = schedule(rng, steps, step)
    hours = np.arange(steps) * step / 3600
    air = 21 + rng.normal(0, 1) + np.sin(hours / 7 * np.pi)
    speed = speed * fault.speed
    heat = heat_sources(speed, load, np.zeros(steps))
    heat[:, 0] *= np.where(speed > 900, 1.8, 1.0)
    truth = replace(
        ONE,
        heating={name: rng.normal(1, 0.02) * value for name, value in ONE.heating.items()},
        cooling_rate=ONE.cooling_rate * fault.cooling * rng.normal(1, 0.02),
    )
    true = temperatures(heat, air[0] + rng.normal(1, 0.3), truth, step, ambient=air)[0]
    seen = np.round(2 * (true + fault.offset_K + rng.normal(0, fault.noise_K, steps))) / 2
    if fault.stuck:
        seen[600:] = seen[600]
    day = MONDAY + timedelta(days=number)
    index = pd.date_range(f"{day}T06:00", periods=steps, freq=f"{step:g}s", tz="UTC", name="time")
    table = pd.DataFrame(
        {"spindle_speed": speed * 30 / np.pi, "spindle_load": 100 * load,
         "spindle_temperature": seen, "ambient_temperature": air},
        index=index,
    )  # fmt: skip
    return table.resample("1s").ffill()


def spindle_case(seed: int, number: int, role: Role, fault: SpindleFault) -> Case:
    """A day as the sub-model's own cases are."""
    day, table = str(MONDAY + timedelta(days=number)), spindle_day(seed, number, fault)
    file = SourceFile(file=f"agent/{day}.txt", sha256=sha256(f"{seed} {day}".encode()).hexdigest())
    top = {f"highest {name}": Fact(value=float(table[name].max()), unit=unit)
           for name, unit in (("spindle_speed", "rev/min"), ("spindle_load", "%"))}  # fmt: skip
    return Case(name=day, group=day, role=role, files=(file,), load=lambda: table, conditions=top)


def serving_of(
    name: str, folder: Path, model: Model, judging: object, cases: Cases
) -> ServingModel:
    """The stored model with its verdict on held-out cases."""
    one = submodel(name)
    write_json(model, folder / "model.json")
    targets = one.targets(judging, model)
    found = judge(model, one.load(folder, judging), cases, targets, sets=None, files={})
    write_json(found.verdict, folder / "verdict.json")
    return ServingModel(
        one=one, folder=folder, judging=judging, settings=SETTINGS, bundle="b", sha256=name
    )


def spindle_serving(folder: Path, seed: int) -> ServingModel:
    """A spindle that was fitted on five days and judged on the next five."""
    quiet = SpindleFault()
    training = [spindle_case(seed, n, "training", quiet) for n in range(TRAINED)]
    others = [spindle_case(seed, TRAINED + n, "held_out", quiet) for n in range(JUDGED)]
    cases = Cases(cases=(*training, *others))
    model = submodel("spindle").fit(cases, FITTING, folder)
    return serving_of("spindle", folder, model, SPINDLE, cases)


def spindle_nights(
    seed: int, nights: int, fault_from: int, fault: SpindleFault | None
) -> Iterator[tuple[str, tuple[Case, ...]]]:
    """Nights after the judgement; ``fault`` None: from then on nothing is recorded."""
    for n in range(nights):
        number = TRAINED + JUDGED + n
        if fault is None and n >= fault_from:
            yield str(MONDAY + timedelta(days=number)), ()
            continue
        now = fault if fault is not None and n >= fault_from else SpindleFault()
        case = spindle_case(seed, number, "held_out", now)
        yield case.name, (case,)


CONSTANTS = AxisConstants(force_constant=100.0)


def drive_serving(folder: Path, seed: int) -> ServingModel:
    """A feed axis that was identified on three recordings and judged on four."""
    rig, settings = Rig(), DriveFitSettings(compare=False)
    training = [
        recording(rig, strokes(speeds), 100 * seed + k, CONSTANTS, name=f"train-{k}.csv")
        for k, speeds in enumerate(((0.002, 0.01, 0.05), (0.02, 0.1), (0.005, 0.03, 0.2)))
    ]
    axis = stored_axis("X", identified_axis("X", training, DrivePrior(), settings), training)
    cases = [drive_case(one, "training") for one in training]
    cases += [drive_night(seed, n, rig) for n in range(-4, 0)]
    model = DriveModel(
        submodel="drive", machine="mill", origin="simulated", parameters={},
        trained_on=tuple(case.training for case in cases[:3]), axes={"X": axis},
        substeps=settings.substeps,
        conditions={n: replace(c, low=0.0) for n, c in conditions_of(cases[:3]).items()},
    )  # fmt: skip
    judging = DriveJudging(
        identity=IDENTITY, roles=Roles(), drive=DrivePrior(),
        drive_records=DriveRecords(
            recordings="*", axes={"X": AxisChannels(command="c", position="p")}
        ),
        drive_limits=DriveLimits(),
    )  # fmt: skip
    return serving_of("drive", folder, model, judging, Cases(cases=tuple(cases)))


def drive_night(seed: int, number: int, rig: Rig) -> Case:
    """A recording of strokes at speeds that differ from night to night."""
    rng = np.random.default_rng([seed, number + 100])
    speeds = tuple(sorted(rng.uniform(0.004, 0.18, 3)))
    name = f"night-{number + 100:03d}.csv"
    one = recording(
        rig, strokes(speeds), 1000 * seed + number + 100, CONSTANTS, name=name, trained=False
    )
    return drive_case(replace(one, sha256=sha256(name.encode()).hexdigest()), "held_out")


SLOT_RPM, SLOT_DEPTH, FEEDS = 6000.0, 2.0, (0.05, 0.1, 0.15)


def cut(
    seed: int, number: int, f_z: float, role: Role, *, minutes: float = 5.0, wear: float = 0.0
) -> Case:
    """A slot by a tool that has cut so many minutes, its edge dulled by ``wear`` [1/min]."""
    dull = 1 + wear * minutes
    truth = replace(
        SLOT, edge=(dull * SLOT.edge[0], dull * SLOT.edge[1], dull * SLOT.edge[2]),
        cutting=(SLOT.cutting[0] * (1 + 0.1 * (dull - 1)), *SLOT.cutting[1:]),
    )  # fmt: skip
    rng = np.random.default_rng([seed, number + 100, round(1e4 * f_z)])
    test = (SLOT_RPM, f_z, SLOT_DEPTH, 0.0, np.pi)
    one = recorded_cut(truth, test, number % 7, rng, 1.0)
    name = f"slot-{number + 100:03d}-{f_z:.4f}.csv"
    used = Condition(value=minutes, unit="min", source="its name")
    file = RecordedFile(name=name, conditions={"cutting_time_min": used})
    one = replace(one, name=name, role=role, sha256=sha256(name.encode()).hexdigest(), file=file)
    return Case(
        name=name, group=name, role=role, load=lambda: one,
        files=(SourceFile(file=name, sha256=one.sha256),), conditions=_facts(one.conditions),
    )  # fmt: skip


def cutting_serving(folder: Path, seed: int) -> ServingModel:
    """Forces that were identified on three slots and judged on four."""
    cases = [cut(seed, -10, f_z, "training") for f_z in FEEDS]
    cases += [cut(seed, -n, f_z, "held_out") for n, f_z in enumerate((0.06, 0.08, 0.11, 0.14), 1)]
    found = identify_cutting_force([c.load() for c in cases[:3]], known_of(SLOT), CUT)
    head = Model(
        submodel="cutting", machine="mill", origin="simulated", parameters={},
        trained_on=tuple(case.training for case in cases[:3]), conditions=conditions_of(cases[:3]),
    )  # fmt: skip
    model = cutting_model(head, found, known_of(SLOT), CUT, None)
    judging = CuttingJudging(
        identity=IDENTITY, roles=Roles(), cutting=known_of(SLOT), cutting_fit=CUT,
        cutting_records=CuttingRecords(recordings="*"), cutting_limits=CuttingLimits(),
    )  # fmt: skip
    return serving_of("cutting", folder, model, judging, Cases(cases=tuple(cases)))


def cutting_nights(
    seed: int, nights: int, fault_from: int, wear: float
) -> Iterator[tuple[str, tuple[Case, ...]]]:
    """Three slots a night, ten minutes of cutting apart, by a tool that goes on night after night
    from the fault on."""
    for n in range(nights):
        worn = n >= fault_from
        start = 20.0 * (n - fault_from) if worn else 0.0
        feeds = np.random.default_rng([seed, n]).uniform(0.055, 0.145, 3).round(3)
        yield f"night-{n:03d}", tuple(
            cut(seed, 10 * n + k, float(f_z), "held_out", minutes=start + 10.0 * k + 5.0,
                wear=wear if worn else 0.0)
            for k, f_z in enumerate(feeds)
        )  # fmt: skip


def drive_nights(
    seed: int, nights: int, fault_from: int, friction: float
) -> Iterator[tuple[str, tuple[Case, ...]]]:
    """A recording a night; from the fault on the Coulomb level is ``friction`` times as high."""
    for n in range(nights):
        factor = friction if n >= fault_from else 1.0
        rig = replace(Rig(), coulomb=150.0 * factor, static=190.0 * factor)
        case = drive_night(seed, n, rig)
        yield case.name, (case,)


def run(serving: ServingModel, each: Iterator[tuple[str, tuple[Case, ...]]]) -> list[Night]:
    """Nights in a row, as those of many runs of the command."""
    return scored(serving, each, ())


def first_ask(nights: list[Night], fault_from: int) -> tuple[int, Night] | None:
    """How many nights after the fault came in something is asked for, and that night."""
    order = list(dict.fromkeys(one.night for one in nights))
    for one in nights:
        at = order.index(one.night)
        if one.ask and at >= fault_from:
            return at - fault_from + 1, one
    return None


def false_asks(nights: list[Night], before: int | None = None) -> list[Night]:
    """Calls before the fault, one of each ask: it stays open until the errors are back."""
    order = list(dict.fromkeys(one.night for one in nights))[:before]
    return list({one.since: one for one in nights if one.ask and one.night in order}.values())
