"""Control as a sub-model: cases are runs of programs, judged by their time without stops.

The 90 % interval of a time has a half width that is a share of the predicted time, by type of row:
conformal over programs, each predicted by a control that was identified from the others.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.spindle import CUTTING
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Band, Bands, Correlation, LeftOut, Parameter
from pipeline.schema.ranges import NotNegative, Range
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.submodels.cases import (
    Case,
    Cases,
    Records,
    conditions_of,
    held,
    role_of,
    sources,
)
from pipeline.submodels.conformal import Residuals, bands, half_widths, splits
from pipeline.submodels.contract import (
    Ends,
    Input,
    IntervalLimits,
    Prediction,
    Predictor,
    Sections,
    SubModel,
    Target,
)
from pipeline.submodels.control.fit import ControlFit, ControlFitSettings, identify_control
from pipeline.submodels.control.programs import Match, read_matches, read_programs
from pipeline.submodels.control.runs import stopped_within
from pipeline.submodels.control.segments import (
    NAIVE,
    OVERRIDE_ONLY,
    TIME,
    Observed,
    observe,
    shares,
)
from pipeline.twin.control import (
    WHOLE,
    ControlFitFacts,
    ControlModelFile,
    ControlRecords,
    control_of_unit,
    dwells,
    planned_program,
    program_conditions,
    program_moves,
    time_interval,
)
from pipeline.twin.simulation import TYPES, block_table, type_of

DWELL = "dwell"
"""Regime of the rows that the control times by its own clock."""
WAIT = 1.0
"""Excess over the planned M0 or M1 from which the operator is taken to wait [s]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MatchedRun:
    """A run with its program, and the segments of the parts that are of this program."""

    match: Match
    observed: tuple[Observed, ...]


def time_bands(
    runs: Sequence[MatchedRun], start: ControlParameters, settings: ControlFitSettings,
    fit: ControlFit,
) -> dict[str, Band]:  # fmt: skip
    """Half widths of the 90 % interval of a time as shares of it [1], by type of row.

    Runs of a program are left out together, where another program ran on the same machine; else
    they are left out one by one, and the only run of a machine is not.  Empty where fewer than two
    groups can be left out.
    """
    units = Counter(run.observed[0].unit for run in runs if run.observed)
    whole = [
        run for run in runs
        if run.match.whole and run.match.run.completed
        and run.observed and units[run.observed[0].unit] > 1
    ]  # fmt: skip
    groups: dict[str, list[MatchedRun]] = {}
    for run in whole:
        groups.setdefault(_left_together(run, whole), []).append(run)

    tasks = []
    for _, others in splits(list(groups), settings.folds):
        out = {id(run) for name in others for run in groups[name]}
        tasks.append(
            _Task(
                observed=[part for run in runs if id(run) not in out for part in run.observed],
                left={name: groups[name] for name in others}, start=start, settings=settings,
                near=fit,
            )
        )  # fmt: skip
    residuals = Residuals.joined(mapped(_left_over, tasks))
    found = bands(residuals) if np.isfinite(residuals.error).any() else {}
    return {
        name: replace(band, lower=float(f"{band.lower:.4g}"), upper=float(f"{band.upper:.4g}"))
        for name, band in found.items()
    }


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """A fold: what a control is identified from, and the runs that it is to predict, by group."""

    observed: Sequence[Observed]
    left: Mapping[str, Sequence[MatchedRun]]
    start: ControlParameters
    settings: ControlFitSettings
    near: ControlFit


def _left_over(task: _Task) -> Residuals:
    """Shares by which a control misses the times of runs that it was not identified from."""
    controls = identify_control(task.observed, task.start, task.settings, task.near).control
    return Residuals.joined(
        _residuals(run, name, controls) for name, runs in task.left.items() for run in runs
    )


def _left_together(run: MatchedRun, runs: Sequence[MatchedRun]) -> str:
    """The group that a run is left out with: its program, or itself."""
    own = run.observed[0]
    others = {one.observed[0].program for one in runs if one.observed[0].unit == own.unit}
    return f"{own.program}@{own.unit}" if len(others) > 1 else run.match.run.name


def _residuals(run: MatchedRun, group: str, controls: Mapping[str, ControlParameters]) -> Residuals:
    frame = predicted(run, controls).frame
    frame = frame[frame["predicted"] > frame["exact"]]
    error = (frame["measured"] - frame["predicted"]).to_numpy(float)
    share = error / (frame["predicted"] - frame["exact"]).to_numpy(float)
    return Residuals(
        error=share, regime=frame["regime"].to_numpy(dtype=str), t=np.zeros(len(frame)),
        group=np.full(len(frame), group),
    )  # fmt: skip


def predicted(
    run: MatchedRun, controls: Mapping[str, ControlParameters], intervals: Bands | None = None,
    ends: Mapping[str, Sequence[ControlParameters]] | None = None,
) -> Prediction:  # fmt: skip
    """Time of one run beside that measured; nothing of a run of another revision.

    Its interval reaches as far as the controls that the runs leave open, ``ends`` by unit, and as
    the stamps of the log may be late.
    """
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
    modelled, plain, recorded = (float(t[:until].sum()) for t in (times, naive, said))
    rows: list[dict[str, Any]] = [
        {
            "regime": WHOLE, "measured": measured, "predicted": modelled,
            f"baseline_{NAIVE}": plain, f"baseline_{OVERRIDE_ONLY}": recorded,
        }
    ]  # fmt: skip
    by_type = shares(one, times)
    rows += [
        {"regime": word, "measured": share.measured, "predicted": share.predicted}
        for word, share in by_type.items()
    ]
    frame = pd.DataFrame(rows).assign(quantity=TIME, unit="s", t=0.0)
    dwell, ticks = dwells(one.moves.part(0, until), control)
    timed = frame["regime"].isin((WHOLE, DWELL)).to_numpy(bool)
    frame["exact"] = np.where(timed, np.minimum(dwell, frame["predicted"]), 0.0)
    if intervals:
        exact, regime = frame["exact"].to_numpy(float), frame["regime"].to_numpy(dtype=str)
        rest, tick = frame["predicted"].to_numpy(float) - exact, np.where(timed, ticks, 0.0)
        stamps = [one.run.latency, *(share.late for share in by_type.values())]
        opened = _opened(one, times, until, (ends or {}).get(one.unit, ()), by_type)
        lower, upper = (
            np.sqrt((half * rest) ** 2 + np.square(stamps) + open_**2)
            for half, open_ in zip(half_widths(regime, intervals), opened, strict=True)
        )
        frame["low"] = frame["predicted"] - tick - lower
        frame["high"] = frame["predicted"] + tick + upper
    # a run that was aborted is compared up to the last line that was seen, and decides nothing
    frame["scored"] = one.run.completed and measured > 0
    return Prediction(
        frame=frame,
        facts={
            "program": Fact(value=one.program),
            "measured": Fact(value=round(measured, 2), unit="s"),
            "predicted": Fact(value=round(modelled, 2), unit="s"),
            "error": Fact(value=_percent(modelled, measured), unit="%"),
            NAIVE: Fact(value=round(plain, 2), unit="s"),
            f"error of {NAIVE}": Fact(value=_percent(plain, measured), unit="%"),
            f"error of {OVERRIDE_ONLY}": Fact(value=_percent(recorded, measured), unit="%"),
            "stops": Fact(value=round(stops, 2), unit="s"),
            "completed": Fact(value="yes" if one.run.completed else "no"),
            "feed read from speeds": Fact(value=round(one.operator.feed_read, 3), unit="1"),
        },
        note="" if one.run.completed else "the run was aborted; compared up to its last line",
    )


def _opened(
    one: Observed, times: Floats, until: int, ends: Sequence[ControlParameters],
    types: Iterable[str],
) -> tuple[Floats, Floats]:  # fmt: skip
    """Differences of the times of the whole run and its ``types`` at the ``ends`` [s]."""
    kind = type_of(one.moves.kind[:until])
    change = np.zeros((1 + len(ends), until))
    for k, end in enumerate(ends, start=1):
        change[k] = (planned_program(one.moves, end, one.overrides).time - times)[:until]
    each = np.array([change.sum(axis=1), *(change[:, kind == w].sum(axis=1) for w in types)])
    return each.min(axis=1), each.max(axis=1)


def naive_times(moves: Moves, feed_factor: Floats, rapid_speed: float) -> Floats:
    """Path over programmed feed, without acceleration or waiting, as by simple estimators [s].

    ``feed_factor`` is the feed override, (rows,) [1]; ``rapid_speed`` [mm/min] that of rapids, and
    of cuts whose feed is not in mm/min.
    """
    cutting = np.isin(moves.kind, CUTTING)
    timed = cutting & (moves.feed > 0) & (moves.feed_mode == FeedMode.PER_MINUTE)
    speed = np.where(timed, moves.feed * feed_factor, rapid_speed)
    return np.where(cutting | (moves.kind == Kind.RAPID), moves.length / speed * 60, 0.0)


def _seen_until(one: Observed) -> tuple[float, int]:
    """Time at which the last line was seen [s], and the number of rows executed until then."""
    if one.run.completed or not len(one.after):
        return one.run.end, len(one.moves) if one.run.completed else 0
    return float(one.end[-1]), int(one.after[-1])


def _stops(one: Observed, times: Floats, end: float) -> float:
    """Time that the machine was held, and time at M0 and M1 beyond the machine's own [s]."""
    start = np.array([one.run.start])
    stopped = float(stopped_within(one.operator.stops, start, np.array([end]))[0])
    for first, after, measured in zip(one.first, one.after, one.measured, strict=True):
        rows = slice(first, after)
        if (one.moves.kind[rows] == Kind.STOP).any():
            stopped += max(0.0, float(measured - times[rows].sum()) - WAIT)
    return stopped


def _percent(predicted: float, measured: float) -> float | None:
    return round(100 * (predicted / measured - 1), 2) if measured > 0 else None


FITTED = "bounded least squares (soft L1) on the durations of blocks in logs of line numbers"
FROM_SPEEDS = "steady speeds in rapids"
NOT_DETERMINED = (
    "not determined by these runs; kept between its value in conf/machine/ and those of its kind"
)
LENT = "of {others}, not determined here"
"""Method of what a machine of several takes from the others."""


@dataclass(frozen=True, kw_only=True)
class ControlLimits(IntervalLimits, section="control_limits"):
    """Limits on the errors of a control's times."""

    total_percent: NotNegative = 5.0
    """Greatest error of the time of a run that was not fitted on [%]."""
    alone: Annotated[int, Range(least=0)] = 4
    """Runs within it beside which a single one beyond it is named and does not decide; 0 where each
    decides."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    mapping: CleanMachine
    control: ControlParameters
    setup: Setup
    control_records: ControlRecords
    control_fit: ControlFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    mapping: CleanMachine
    setup: Setup
    control_records: ControlRecords
    control_fit: ControlFitSettings
    control_limits: ControlLimits


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
    shared: ClassVar[str] = ".*"
    ends: ClassVar[Ends] = {(TIME, WHOLE): ("program_time_low", "program_time_high")}

    def targets(self, settings: Judging, model: ControlModelFile) -> tuple[Target, ...]:
        """Time of whole runs, which is judged, and of their types of rows, which is shown."""
        limits = settings.control_limits
        whole = Target(
            quantity=TIME, unit="s", regime=WHOLE, baselines=(NAIVE, OVERRIDE_ONLY),
            limits={"relative_percent": limits.total_percent}, must_beat=(NAIVE,),
            alone=limits.alone, coverage=limits.share if model.intervals else None,
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
                    files=sources(files, [one.run.recording]), load=held(matched),
                    conditions=program_conditions(moves),
                )
            )  # fmt: skip
        left_out = [LeftOut(case=m.run.name, reason=m.left_out) for m in matches if m.reason]
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
            intervals=time_bands(runs, settings.control, settings.control_fit, fit),
            ends=fit.ends,
        )  # fmt: skip

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of runs."""
        stored = read_json(folder / "model.json", ControlModelFile)
        return lambda case: predicted(case.load(), stored.control, stored.intervals, stored.ends)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Times by block from a table with the text of a program a row: column ``program``.

        ``program_time``, ``_low`` and ``_high`` are the time of the whole program and its 90 %
        interval [s], where runs left out gave one.  The control is that of the first unit in the
        order of the alphabet.
        """
        stored = read_json(folder / "model.json", ControlModelFile)
        unit = min(stored.control)
        control, open_ = stored.control[unit], stored.ends.get(unit, ())

        def by_block(number: int, text: str) -> pd.DataFrame:
            plan = planned_program(_moves(text), control)
            ends = time_interval(plan, stored.intervals, stored.conditions, open_)
            low, high = ends or (np.nan, np.nan)
            return block_table(plan).assign(
                program=number, program_time=plan.total, program_time_low=low,
                program_time_high=high,
            )  # fmt: skip

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            if "program" not in table.columns:
                raise ValueError("the input has no column program: give a program's text in it")
            parts = [
                by_block(number, text) for number, text in enumerate(table["program"].tolist())
            ]
            return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """A square."""
        lines = ("G21 G90 G94", "G0 X0 Y0", "G1 X40 F600", "Y40", "X0", "Y0", "M30")
        return pd.DataFrame({"program": ["\n".join(lines) + "\n"]})


def _moves(text: str) -> Moves:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "program.nc"
        path.write_text(text)
        return program_moves(path, Setup())


def _parameters(fit: ControlFit) -> dict[str, Parameter]:
    found = {}
    for i, one in enumerate(fit.free):
        others = fit.lenders(i)
        kept = LENT.format(others=" and ".join(others)) if others else NOT_DETERMINED
        known, method = bool(fit.determined[i]), FROM_SPEEDS if fit.from_speeds[i] else FITTED
        found[one.name] = Parameter.estimated(
            float(fit.values[i]), float(fit.low[i]), float(fit.high[i]), one.unit,
            method=method if known else kept, remedy=one.remedy, determined=known,
        )  # fmt: skip
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


SUBMODEL = Control()
