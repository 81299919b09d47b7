"""Feed drives as a sub-model: cases are recordings of the servo, judged by force and position."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import drive_row
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import (
    BASELINE_TITLES,
    COMMAND,
    FOLLOWING,
    FORCE,
    LAG,
    LEVEL,
    MOTOR,
    RIGID,
    SPEED,
    TWIST,
    DriveAxis,
    DriveModel,
    TrainingRecording,
)
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Band, LeftOut, SourceFile, significant
from pipeline.schema.ranges import Positive
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact, Role, widest
from pipeline.signals.windows import row_period
from pipeline.submodels.cases import Case, Cases, Records, conditions_of, held, role_of
from pipeline.submodels.contract import (
    VELOCITY,
    Ends,
    Input,
    IntervalLimits,
    Prediction,
    Predictor,
    Sections,
    SubModel,
    Target,
)
from pipeline.submodels.drive import comparison
from pipeline.submodels.drive.comparison import with_intervals
from pipeline.submodels.drive.disturbance import PLACES, Disturbance
from pipeline.submodels.drive.experiments import axis_designs
from pipeline.submodels.drive.model import (
    DriveIdentification,
    axis_again,
    axis_parameters,
    identify_drives,
    left_out,
    motor_parameters,
    stored_axis,
    stored_motor,
)
from pipeline.submodels.drive.reading import read_recordings
from pipeline.submodels.drive.records import (
    BLOCK,
    AxisRecord,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
    Recording,
    blocks_of,
    of_axis,
)
from pipeline.submodels.drive.shaft_signals import is_known, twist_frames
from pipeline.submodels.drive.speed_loops import compared_loops, shaft_figures
from pipeline.submodels.next_recording import Design
from pipeline.twin.drive import IdentifiedDrive, identified_drive, identified_drives, speed_of
from pipeline.twin.program_axes import between

SHOWN = 4000
"""Greatest number of rows of a quantity that is only shown [1]."""


@dataclass(frozen=True, kw_only=True)
class DriveLimits(IntervalLimits, section="drive_limits"):
    """Limits on every recording that the drives were not identified from."""

    force_percent: Positive = 15.0
    """Greatest error of the force over the measured force [%]."""
    following_percent: Positive = 10.0
    """Greatest error of the following error, RMS over its RMS and maximum over its maximum [%]."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the identification reads."""

    drive: DrivePrior
    drive_records: DriveRecords
    drive_fit: DriveFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    drive: DrivePrior
    drive_records: DriveRecords
    drive_limits: DriveLimits


class Drive(SubModel[Fitting, Judging, DriveModel]):
    """Force and following error of each feed axis."""

    name: ClassVar[str] = "drive"
    title: ClassVar[str] = "feed drives"
    needs: ClassVar[str] = (
        "commanded position, measured position and current of each axis at 1 kHz while it goes "
        "back and forth in air at several speeds"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals",)
    model: ClassVar[type] = DriveModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="reference", unit="m"),
        Input(name="position", unit="m", older_than_s=0.0),
        Input(name="load", unit="N", older_than_s=0.0),
    )
    shared: ClassVar[str] = r"\w (coulomb|static|stribeck_velocity|viscous)_(positive|negative)"
    ends: ClassVar[Ends] = {
        (FOLLOWING, ""): ("following_error_low", "following_error_high"),
        (FORCE, ""): ("force_low", "force_high"),
    }

    def targets(self, settings: Judging, model: DriveModel) -> tuple[Target, ...]:
        """Force and following error of each axis."""
        limits = settings.drive_limits
        share = limits.following_percent
        return tuple(
            target
            for letter, axis in model.axes.items()
            for target in (
                Target(
                    quantity=f"{FORCE} {letter}", unit=axis.force_unit, baselines=(LEVEL,),
                    limits={"relative_percent": limits.force_percent},
                    coverage=limits.share if FORCE in axis.intervals else None,
                ),
                Target(
                    quantity=f"{FOLLOWING} {letter}", unit="um", baselines=(LAG,),
                    limits={"relative_percent": share, "max_percent": share},
                    coverage=limits.share if FOLLOWING in axis.intervals else None,
                ),
            )
        ) + tuple(
            Target(
                quantity=f"{TWIST} {letter}", unit="um", baselines=(RIGID,), must_beat=(RIGID,),
                titles=BASELINE_TITLES,
            )
            for letter in model.shafts if is_known(model, letter)
        )  # fmt: skip

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Recordings of the servo and of a motor; one for each stretch without a gap in time."""
        if records.signals is None:
            raise ValueError("recordings of the servo stand in the signals: name them in reads")

        def role(file: str) -> Role:
            return role_of([file], settings.roles, sets)

        cases, others = [], []
        for one in read_recordings(
            records.signals, settings.drive_records, settings.drive, lambda f: role(f) == "training"
        ):
            if not (one.axes or one.motor or one.shafts or one.trained):
                reasons = "; ".join(sorted(set(one.lacking.values())))
                others.append(LeftOut(case=one.name, reason=reasons))
                continue
            of_file = role(one.file)
            # nothing is predicted of a motor: unless it is frozen, its recording serves the fit
            if one.motor and of_file == "held_out":
                of_file = "training"
            cases.append(drive_case(one, of_file))
        return Cases(cases=(*cases, *_own_time(cases)), left_out=tuple(others))

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> DriveModel:
        """Mechanics, servo and mass over time of each axis, and the motor."""
        training = cases.of("training")
        recordings: list[Recording] = [case.load() for case in training]
        found = identify_drives(
            recordings, settings.drive_records, settings.drive, settings.drive_fit
        )
        stored = mapped(lambda axis: stored_axis(axis, found.axes[axis], recordings), found.axes)
        axes = with_intervals(
            dict(zip(found.axes, stored, strict=True)),
            recordings,
            partial(axis_again, axes=found.axes, prior=settings.drive, settings=settings.drive_fit),
            settings.drive_fit,
        )
        parameters = {
            letter: axis_parameters(letter, found) for letter in sorted({*axes, *found.loop_gains})
        }
        if found.motor is not None:
            pairs = settings.drive_records.motor.pole_pairs if settings.drive_records.motor else 1
            parameters[MOTOR] = motor_parameters(found.motor, pairs)
        shafts = {letter: fit.shaft for letter, fit in found.shafts.items()}
        used = [
            c for c, one in zip(training, recordings, strict=True)
            if one.axes or one.motor or one.shafts or one.tracked
        ]  # fmt: skip
        blocks = [case.load() for case in cases.of("held_out") if BLOCK in case.name]
        return DriveModel(
            blocks=_by_rest(blocks, found, settings),
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters=parameters,
            trained_on=tuple(case.training for case in used),
            left_out=(*left_out(found, recordings), *cases.left_out),
            # on its way to its highest speed an axis passes all below
            conditions={name: replace(c, low=0.0) for name, c in conditions_of(used).items()},
            axes=axes,
            motor=None if found.motor is None else stored_motor(found.motor, found.motor_axis),
            recordings=tuple(
                TrainingRecording(
                    recording=one.name, seconds=round(one.seconds, 3), notes=one.notes
                )
                for one in recordings
                if one.axes or one.tracked
            ),
            substeps=settings.drive_fit.substeps,
            shafts=shafts,
            speed_loops=compared_loops(axes, parameters, shafts, settings.drive_records.motor),
        )

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of recordings."""
        model = read_json(folder / "model.json", DriveModel)
        drives = identified_drives(model)
        of_rest = {
            name: {letter: identified_drive(axis) for letter, axis in axes.items()}
            for name, axes in model.blocks.items()
        }
        return lambda case: _predicted(
            case.load(), model, of_rest.get(case.name, {}) if BLOCK in case.name else drives
        )

    def designs(self, model: DriveModel, cases: Cases, settings: Judging) -> list[Design]:
        """Strokes of each axis, by its mass and friction."""
        judged = cases.of("golden") or cases.of("held_out")
        training, others = (
            [one for case in some if (one := case.load()).axes]
            for some in (cases.of("training"), judged)
        )
        return list(axis_designs(model, training, others))

    def figures(self, model: DriveModel) -> dict[str, Any]:
        """Parameters of shafts, and speed loops by kind and gains, for the metrics."""
        return shaft_figures(model)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Following error [um], command and force of each axis from its commanded position.

        Beside error and force stand the ends of their 90 % intervals, ``_low`` and ``_high``, where
        recordings left out gave them, wider beyond the speeds of the recordings.  The table has
        ``t`` [s], evenly spaced, and ``<axis>_reference`` [m] for each axis of interest, which is
        at rest in the first row.
        """
        model = read_json(folder / "model.json", DriveModel)
        drives = identified_drives(model)

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            names = [f"{letter}_reference" for letter in drives]
            period = row_period(table, *(name for name in names if name in table.columns))
            found = {"t": table["t"].to_numpy(float)}
            for letter, drive in drives.items():
                name = f"{letter}_reference"
                if name not in table.columns or drive.servo is None:
                    continue
                reference = table[name].to_numpy(float)
                trace = simulate(
                    between(reference, model.substeps), period / model.substeps,
                    drive_row(drive.servo, drive.feed_drive)[np.newaxis],
                )  # fmt: skip
                position = trace.position[0, :: model.substeps]
                command = trace.command[0, :: model.substeps]
                bands = model.axes[letter].intervals
                fastest = float(np.abs(np.gradient(reference, period)).max())
                factor = widest(speed_of(letter, fastest), model.conditions)
                for name, values, quantity in (
                    ("following_error", 1e6 * (reference - position), FOLLOWING),
                    ("command", command, ""),
                    ("force", drive.feed_drive.force_constant * command, FORCE),
                ):
                    found[f"{letter}_{name}"] = values
                    ends = _within(values, bands.get(quantity), factor)
                    found |= {f"{letter}_{name}_{end}": at for end, at in ends.items()}
            return pd.DataFrame(found)

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """A tenth of a second of slow feed of each axis."""
        model = read_json(folder / "model.json", DriveModel)
        t = 1e-3 * np.arange(100)
        return pd.DataFrame({"t": t, **{f"{letter}_reference": 0.01 * t for letter in model.axes}})

    def influences(self, case: Case, rows: pd.DataFrame) -> dict[str, Floats]:
        """Velocity of the axis of the rows [m/s]."""
        recording: Recording = case.load()
        axis = recording.axes.get(str(rows["quantity"].iloc[0]).rpartition(" ")[2])
        speed = None if axis is None else _speed(axis, recording.period)
        if speed is None:
            return {}
        time = np.arange(recording.samples) * recording.period
        return {VELOCITY: np.interp(rows["t"], time, np.asarray(speed, float))}


def _own_time(cases: list[Case]) -> list[Case]:
    """Blocks to judge by where all cases that show an axis are parts of one training recording."""
    shown = [case for case in cases if case.conditions or case.role == "sealed"]
    files = {one.file for case in shown for one in case.files}
    if len(files) != 1 or any(case.role != "training" for case in shown):
        return []
    parts: list[Recording] = [case.load() for case in shown]
    return [
        drive_case(block, "held_out") for block in blocks_of([one for one in parts if one.axes])
    ]


def _by_rest(
    blocks: list[Recording], found: DriveIdentification, settings: Fitting
) -> dict[str, dict[str, DriveAxis]]:
    """Axes that the other blocks determine as well as all do, by the name of each block."""
    tasks = [(block.name, letter) for block in blocks for letter in block.axes]
    tasks = [one for one in tasks if one[1] in found.axes]

    def of_rest(task: tuple[str, str]) -> DriveAxis | None:
        rest = of_axis([one for one in blocks if one.name != task[0]], task[1])
        return axis_again(task[1], rest, found.axes, settings.drive, settings.drive_fit)

    axes: dict[str, dict[str, DriveAxis]] = {}
    for (name, letter), axis in zip(tasks, mapped(of_rest, tasks), strict=True):
        if axis is not None:
            axes.setdefault(name, {})[letter] = axis
    return axes


def drive_case(recording: Recording, role: Role) -> Case:
    """A recording as a case; of a sealed one nothing is said but its name and hash."""
    return Case(
        name=recording.name, group=recording.name, role=role, load=held(recording),
        files=(SourceFile(file=recording.file, sha256=recording.sha256),),
        conditions={} if role == "sealed" else _conditions(recording),
    )  # fmt: skip


def _conditions(recording: Recording) -> dict[str, Fact]:
    """Highest speed of each axis, to three significant digits."""
    found: dict[str, Fact] = {}
    for letter, axis in recording.axes.items():
        speed = _speed(axis, recording.period)
        if speed is not None:
            found |= speed_of(letter, float(np.abs(speed).max()))
    return found


def _speed(axis: AxisRecord, period: float) -> Any:
    """Recorded speed [m/s], else the derivative of the position; shape (T,)."""
    if axis.velocity is None and axis.position is not None:
        return np.gradient(axis.position, period)
    return axis.velocity


def _predicted(
    recording: Recording, model: DriveModel, drives: dict[str, IdentifiedDrive]
) -> Prediction:
    frames: list[pd.DataFrame] = []
    facts: dict[str, Fact] = {"length": Fact(value=round(recording.seconds, 3), unit="s")}
    frames += twist_frames(recording, model, drives)
    notes: dict[str, list[str]] = {}
    for letter, drive in drives.items():
        if letter not in recording.axes:
            continue
        found = comparison.axis_comparison(recording, letter, drive, model.substeps)
        frames += _frames(recording, letter, found, model)
        facts |= _facts(letter, found, model)
        for why in _reasons(found):
            notes.setdefault(why, []).append(letter)
    if not frames:
        why = "it shows a motor, no axis" if recording.motor else "it shows no identified axis"
        if BLOCK in recording.name:
            why = "the rest of the recording determines less than the whole: record another"
        return Prediction(frame=pd.DataFrame(), facts=facts, note=why)
    said = [f"{' and '.join(letters)}: {why}" for why, letters in notes.items()]
    said += ["a block of the only recording, by a drive of the others"] * (BLOCK in recording.name)
    note = "; ".join(said)
    return Prediction(frame=pd.concat(frames, ignore_index=True), facts=facts, note=note)


def _reasons(found: comparison.AxisComparison) -> Iterator[str]:
    if found.force.seconds < comparison.LEAST:
        yield f"the axis moves in air for less than {comparison.LEAST:g} s"
    if isinstance(found.following, str):
        yield found.following
    if found.disturbance is not None and found.disturbance.words:
        yield found.disturbance.words


def _frames(
    recording: Recording, letter: str, found: comparison.AxisComparison, model: DriveModel
) -> Iterator[pd.DataFrame]:
    """Rows of one axis: force and following error are scored, command and speed shown."""
    axis, force, following = model.axes[letter], found.force, found.following
    record = recording.axes[letter]
    enough = force.seconds >= comparison.LEAST
    force_band, following_band = (axis.intervals.get(name) for name in (FORCE, FOLLOWING))
    yield pd.DataFrame({
        "quantity": f"{FORCE} {letter}", "unit": axis.force_unit, "t": force.time,
        "measured": force.measured, "predicted": force.modelled, "scored": enough,
        f"baseline_{LEVEL}": axis.constant_level * force.direction,
        **_within(force.modelled, force_band),
    })  # fmt: skip
    if isinstance(following, str):
        return
    t = np.arange(recording.samples) * recording.period
    yield pd.DataFrame({
        "quantity": f"{FOLLOWING} {letter}", "unit": "um", "t": t,
        "measured": 1e6 * following.measured, "predicted": 1e6 * following.modelled,
        "scored": enough, f"baseline_{LAG}": 1e6 * following.guessed,
        **_within(1e6 * following.modelled, following_band),
    })  # fmt: skip
    rows = np.unique(np.linspace(0, recording.samples - 1, SHOWN).astype(int))
    yield pd.DataFrame({
        "quantity": f"{COMMAND} {letter}", "unit": axis.command_unit, "t": t[rows],
        "measured": record.command[rows], "predicted": following.command[rows], "scored": False,
    })  # fmt: skip
    speed = _speed(record, recording.period)
    if speed is not None:
        yield pd.DataFrame({
            "quantity": f"{SPEED} {letter}", "unit": "mm/s", "t": t[rows],
            "measured": 1e3 * speed[rows], "predicted": np.nan, "scored": False,
        })  # fmt: skip


def _within(predicted: Floats, band: Band | None, factor: float = 1.0) -> dict[str, Floats]:
    """Columns of the 90 % interval, ``factor`` times as wide; none where there is no band."""
    if band is None:
        return {}
    return {"low": predicted - factor * band.lower, "high": predicted + factor * band.upper}


def _facts(letter: str, found: comparison.AxisComparison, model: DriveModel) -> dict[str, Fact]:
    """Mean forces against motion, by which friction is judged, and the disturbance."""
    force, unit = found.force, model.axes[letter].force_unit
    facts = {}
    if force.seconds >= comparison.LEAST:
        for name, values in (("measured", force.measured), ("modelled", force.modelled)):
            mean = significant(float(np.mean(values * force.direction)), 4)
            facts[f"mean force {letter} {name}"] = Fact(value=mean, unit=unit)
    return facts | _disturbance_facts(letter, found.disturbance)


def _disturbance_facts(letter: str, found: Disturbance | None) -> dict[str, Fact]:
    """Entry, factor, delay and what is to be said of a disturbance; no factor where none is."""
    if found is None:
        return {}
    name = f"disturbance {letter}"
    facts = {f"{name} enters at": Fact(value=PLACES[found.entry])}
    if found.factor is not None:
        unit = f"{found.unit} per unit of the channel"
        numbers = {
            f"{name}, factor": (found.factor.value, unit),
            f"{name}, factor, half width": (found.factor.half_width, unit),
            f"{name}, delay": (1e3 * found.delay, "ms"),
            f"{name}, delay, half width": (1e3 * found.delay_half_width, "ms"),
        }
        facts |= {
            key: Fact(value=significant(value, 4), unit=unit)
            for key, (value, unit) in numbers.items()
            if np.isfinite(value)
        }
    facts[f"{name}, error explained"] = Fact(value=round(100 * found.share, 2), unit="%")
    if found.words:
        facts[f"{name}, cause"] = Fact(value=found.words)
    return facts


SUBMODEL = Drive()
