"""Control as a sub-model: cases are runs of programs, judged by their time without stops."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.charts.sections import SubModelPage
from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Correlation, LeftOut, Parameter
from pipeline.schema.ranges import NotNegative, Ranged
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.submodels.cases import Case, Cases, Records, Roles, conditions_of, role_of, sources
from pipeline.submodels.contract import Input, Prediction, Predictor, Shown, SubModel, Target
from pipeline.submodels.control.fit import ControlFit, ControlFitSettings, identify_control
from pipeline.submodels.control.programs import Match, read_matches, read_programs
from pipeline.submodels.control.runs import stopped_within
from pipeline.submodels.control.segments import Observed, observe, shares
from pipeline.twin.control import (
    ControlFitFacts,
    ControlModelFile,
    ControlRecords,
    control_of_unit,
    planned_program,
    program_moves,
    read_controls,
)
from pipeline.twin.simulation import TYPES, block_table

TIME = "run time"
"""Quantity: time of a whole run, or of its rows of one type, without the operator's stops [s]."""
WHOLE = "whole run"
FITTED = "bounded least squares (soft L1) on the durations of blocks in logs of line numbers"
FROM_SPEEDS = "steady speeds in rapids"
NOT_DETERMINED = "not determined by these runs; kept near its value in conf/machine/"
WAIT = 1.0
"""At M0 and M1 an operator is taken to wait when they last longer than planned by this [s]."""
NAIVE, OVERRIDE_ONLY = "path over programmed feed", "recorded override only"
"""Baselines: no acceleration or waiting; overrides as recorded, feeds not read from speeds."""


@dataclass(frozen=True, kw_only=True)
class ControlLimits(Ranged, section="control_limits"):
    """Limits on the errors of a control's times.

    Parameters
    ----------
    total_percent : float
        Greatest error of the time of a run that was not fitted on [%].
    """

    total_percent: NotNegative = 5.0


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """Sections of params.yaml that the fit reads."""

    identity: MachineIdentity
    roles: Roles
    mapping: CleanMachine
    control: ControlParameters
    setup: Setup
    control_records: ControlRecords
    control_fit: ControlFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging:
    """Sections of params.yaml that the judgement reads."""

    identity: MachineIdentity
    roles: Roles
    mapping: CleanMachine
    setup: Setup
    control_records: ControlRecords
    control_fit: ControlFitSettings
    control_limits: ControlLimits


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedRun:
    """A run with its program, and the segments of the parts that are of this program."""

    match: Match
    observed: tuple[Observed, ...]


class Control(SubModel[Fitting, Judging, ControlModelFile]):
    """Time that a program takes."""

    name: ClassVar[str] = "control"
    title: ClassVar[str] = "program times"
    needs: ClassVar[str] = (
        "the line of the program, feed, overrides and tool while programs run, and the programs"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals", "raw")
    model: ClassVar[type] = ControlModelFile
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="program", unit=""),
        Input(name="feed_override", unit="%"),
        Input(name="rapid_override", unit="%"),
    )

    def targets(self, settings: Judging, model: ControlModelFile) -> tuple[Target, ...]:
        """Time of whole runs, which is judged, and of their types of rows, which is shown."""
        limit = settings.control_limits.total_percent
        whole = Target(
            quantity=TIME, unit="s", regime=WHOLE, limits={"relative_percent": limit},
            baselines=(NAIVE, OVERRIDE_ONLY), must_beat=(NAIVE,),
        )  # fmt: skip
        return (whole, *(Target(quantity=TIME, unit="s", regime=word) for word in TYPES))

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Runs of programs in the logs; those of another revision are left out with the reason."""
        signals, raw, files = records.signals, records.raw, records.files
        if signals is None or raw is None:
            raise ValueError("runs need the signals and the raw programs: name both in reads")
        known = settings.control_records
        programs = read_programs(raw, known, settings.setup)
        matches = read_matches(signals, files, known, settings.mapping.signals, programs.moves)
        shortest = settings.control_fit.shortest_s
        cases = []
        for one in matches:
            if one.program is None:
                continue
            name, moves = one.program, programs.moves[one.program]
            unit = known.unit(one.run.recording)
            parts = tuple(observe(part, name, moves, unit, shortest) for part in one.parts())
            matched = MatchedRun(match=one, observed=parts)
            cases.append(
                Case(
                    name=one.run.name, group=one.run.name,
                    role=role_of([one.run.recording], settings.roles, sets),
                    files=sources(files, [one.run.recording]), load=_loader(matched),
                    conditions=_conditions(moves),
                )
            )  # fmt: skip
        left_out = [LeftOut(case=m.run.name, reason=m.reason) for m in matches if m.reason]
        refused = [LeftOut(case=name, reason=why) for name, why in programs.refused.items()]
        return Cases(cases=tuple(cases), left_out=tuple(left_out + refused))

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> ControlModelFile:
        """The control that explains the training runs best."""
        training = cases.of("training")
        runs: list[MatchedRun] = [case.load() for case in training]
        observed = [part for run in runs for part in run.observed]
        fit = identify_control(observed, settings.control, settings.control_fit)
        names = {case.name for case in training}
        return ControlModelFile(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters={"": _parameters(fit)},
            trained_on=tuple(case.training for case in training),
            left_out=tuple(
                one for one in cases.left_out
                if one.case in names or settings.roles.is_training(one.case)
            ),
            conditions=conditions_of(training),
            control=fit.control,
            fit=_facts(fit),
            programs={run.match.run.name: str(run.match.program) for run in runs},
        )  # fmt: skip

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of runs."""
        controls = read_controls(folder / "model.json")
        return lambda case: _predicted(case.load(), controls)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Times by block from a table with the text of a program a row: column ``program``.

        The control is that of the first unit in the order of the alphabet.
        """
        stored = read_json(folder / "model.json", ControlModelFile)
        control = stored.control[min(stored.control)]

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            if "program" not in table.columns:
                raise ValueError("the input has no column program: give a program's text in it")
            parts = [
                block_table(planned_program(_moves(text), control)).assign(program=number)
                for number, text in enumerate(table["program"].tolist())
            ]
            return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """A square."""
        lines = ("G21 G90 G94", "G0 X0 Y0", "G1 X40 F600", "Y40", "X0", "Y0", "M30")
        return pd.DataFrame({"program": ["\n".join(lines) + "\n"]})

    def page(self, shown: Shown[ControlModelFile]) -> SubModelPage:
        """Parameters, run times, and the verdict in words."""
        from pipeline.submodels.control.page import page

        return page(shown)


def _moves(text: str) -> Moves:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "program.nc"
        path.write_text(text)
        return program_moves(path, Setup())


def _loader(matched: MatchedRun) -> Callable[[], MatchedRun]:
    return lambda: matched


def _conditions(moves: Moves) -> dict[str, Fact]:
    """Highest programmed feed and spindle speed."""
    timed = moves.feed[(moves.feed_mode == FeedMode.PER_MINUTE) & np.isin(moves.kind, CUTTING)]
    found = {}
    if len(timed):
        found["highest feed"] = Fact(value=round(float(timed.max()), 3), unit="mm/min")
    if len(moves.speed):
        speed = round(float(moves.speed.max()), 3)
        found["highest spindle speed"] = Fact(value=speed, unit="rev/min")
    return found


def _parameters(fit: ControlFit) -> dict[str, Parameter]:
    found = {}
    for i, one in enumerate(fit.free):
        known = bool(fit.determined[i])
        method = FROM_SPEEDS if fit.from_speeds[i] else FITTED
        low, high = (float(f"{end[i]:.5g}") for end in (fit.low, fit.high))
        found[one.name] = Parameter(
            value=float(f"{fit.values[i]:.5g}") if known else None,
            unit=one.unit,
            interval_95=(low, high) if known and np.isfinite(low + high) else None,
            determined=known,
            method=method if known else NOT_DETERMINED,
            remedy="" if known else one.remedy,
        )
    return found


def _facts(fit: ControlFit) -> ControlFitFacts:
    fitted = fit.determined & ~fit.from_speeds
    correlation: list[list[float]] = np.round(fit.uncertainty.correlation, 3).tolist()
    return ControlFitFacts(
        rmse_s=_rounded(fit.rmse_s, 4),
        segments=fit.segments,
        condition=_rounded(fit.uncertainty.condition, 3),
        correlation=Correlation(
            names=tuple(one.name for one, f in zip(fit.free, fitted, strict=True) if f),
            values=tuple(map(tuple, correlation)),
        ),
    )


def _rounded(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None


def _predicted(run: MatchedRun, controls: dict[str, ControlParameters]) -> Prediction:
    """Time of one run beside that measured; nothing of a run of another revision."""
    if not run.match.whole or not run.observed:
        return Prediction(frame=pd.DataFrame(), note=run.match.reason)
    one = run.observed[0]
    control = control_of_unit(controls, one.unit)
    times = planned_program(one.moves, control, one.overrides).time
    as_said = replace(one.overrides, feed=one.operator.said[one.moves.line])
    said = planned_program(one.moves, control, as_said).time
    rapid = min(axis.rapid_speed for axis in control.axes.values())
    naive = naive_times(one.moves, one.operator.feed[one.moves.line], rapid)
    end, until = _seen_until(one)
    stops = _stops(one, times, end)
    measured = end - one.run.start - stops
    predicted, plain, recorded = (float(t[:until].sum()) for t in (times, naive, said))
    rows: list[dict[str, Any]] = [
        {
            "regime": WHOLE, "measured": measured, "predicted": predicted,
            f"baseline_{NAIVE}": plain, f"baseline_{OVERRIDE_ONLY}": recorded,
        }
    ]  # fmt: skip
    rows += [
        {"regime": word, "measured": m, "predicted": p}
        for word, (m, p) in shares(one, times).items()
    ]
    frame = pd.DataFrame(rows).assign(quantity=TIME, unit="s", t=0.0)
    # a run that was aborted is compared up to the last line that was seen, and decides nothing
    frame["scored"] = one.run.completed and measured > 0
    return Prediction(
        frame=frame,
        facts={
            "program": Fact(value=one.program),
            "measured": Fact(value=round(measured, 2), unit="s"),
            "predicted": Fact(value=round(predicted, 2), unit="s"),
            "error": Fact(value=_percent(predicted, measured), unit="%"),
            NAIVE: Fact(value=round(plain, 2), unit="s"),
            f"error of {NAIVE}": Fact(value=_percent(plain, measured), unit="%"),
            f"error of {OVERRIDE_ONLY}": Fact(value=_percent(recorded, measured), unit="%"),
            "stops": Fact(value=round(stops, 2), unit="s"),
            "completed": Fact(value="yes" if one.run.completed else "no"),
            "feed read from speeds": Fact(value=round(one.operator.feed_read, 3), unit="1"),
        },
        note="" if one.run.completed else "the run was aborted; compared up to its last line",
    )


def naive_times(moves: Moves, feed_factor: Floats, rapid_speed: float) -> Floats:
    """Path over programmed feed, without acceleration or waiting: what simple estimators do [s].

    Parameters
    ----------
    moves : Moves
        Of the program.
    feed_factor : ndarray, shape (rows,)
        Feed override [1].
    rapid_speed : float
        Of rapids, and of cuts whose feed is not in mm/min [mm/min].
    """
    cutting = np.isin(moves.kind, CUTTING)
    timed = cutting & (moves.feed > 0) & (moves.feed_mode == FeedMode.PER_MINUTE)
    speed = np.where(timed, moves.feed * feed_factor, rapid_speed)
    times: Floats = np.where(cutting | (moves.kind == Kind.RAPID), moves.length / speed * 60, 0.0)
    return times


def _seen_until(one: Observed) -> tuple[float, int]:
    """Time at which the last line was seen [s], and the number of rows executed until then."""
    if one.run.completed or not len(one.after):
        return one.run.end, len(one.moves) if one.run.completed else 0
    return float(one.end[-1]), int(one.after[-1])


def _stops(one: Observed, times: Floats, end: float) -> float:
    """Time that the machine was held, and time at M0 and M1 beyond the machine's own [s].

    Parameters
    ----------
    one : Observed
        The run.
    times : ndarray, shape (rows,)
        Predicted time of each row [s].
    end : float
        Until when [s].
    """
    start = np.array([one.run.start])
    stopped = float(stopped_within(one.operator.stops, start, np.array([end]))[0])
    for first, after, measured in zip(one.first, one.after, one.measured, strict=True):
        rows = slice(first, after)
        if (one.moves.kind[rows] == Kind.STOP).any():
            stopped += max(0.0, float(measured - times[rows].sum()) - WAIT)
    return stopped


def _percent(predicted: float, measured: float) -> float | None:
    return round(100 * (predicted / measured - 1), 2) if measured > 0 else None


SUBMODEL = Control()
