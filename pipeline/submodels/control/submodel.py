"""Control as a sub-model: cases are runs of programs, judged by their time without stops."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import numpy as np
import pandas as pd

from pipeline.gcode.moves import Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.golden import GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Correlation, LeftOut, Parameter
from pipeline.schema.ranges import NotNegative, Range, Ranged
from pipeline.schema.store import read_json
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.submodels.cases import Case, Cases, Records, Roles, conditions_of, role_of, sources
from pipeline.submodels.contract import Ends, Input, Predictor, Shown, SubModel, Target
from pipeline.submodels.control.fit import ControlFit, ControlFitSettings, identify_control
from pipeline.submodels.control.programs import read_matches, read_programs
from pipeline.submodels.control.segments import observe
from pipeline.submodels.control.times import (
    NAIVE,
    OVERRIDE_ONLY,
    TIME,
    MatchedRun,
    predicted,
    time_bands,
)
from pipeline.twin.control import (
    WHOLE,
    ControlFitFacts,
    ControlModelFile,
    ControlRecords,
    planned_program,
    program_conditions,
    program_moves,
    time_interval,
)
from pipeline.twin.simulation import TYPES, block_table

if TYPE_CHECKING:
    from pipeline.charts.submodel_page import PageContent

FITTED = "bounded least squares (soft L1) on the durations of blocks in logs of line numbers"
FROM_SPEEDS = "steady speeds in rapids"
NOT_DETERMINED = (
    "not determined by these runs; kept between its value in conf/machine/ and those of its kind"
)
LENT = "of {others}, not determined here"
"""Method of what a machine of several takes from the others."""


@dataclass(frozen=True, kw_only=True)
class ControlLimits(Ranged, section="control_limits"):
    """Limits on the errors of a control's times."""

    total_percent: NotNegative = 5.0
    """Greatest error of the time of a run that was not fitted on [%]."""
    alone: Annotated[int, Range(least=0)] = 4
    """Runs within it beside which a single one beyond it is named and does not decide; 0 where each
    decides."""


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
    ends: ClassVar[Ends] = {(TIME, WHOLE): ("program_time_low", "program_time_high")}

    def targets(self, settings: Judging, model: ControlModelFile) -> tuple[Target, ...]:
        """Time of whole runs, which is judged, and of their types of rows, which is shown."""
        limits = settings.control_limits
        whole = Target(
            quantity=TIME, unit="s", regime=WHOLE, baselines=(NAIVE, OVERRIDE_ONLY),
            limits={"relative_percent": limits.total_percent}, must_beat=(NAIVE,),
            alone=limits.alone,
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

    def page(self, shown: Shown[ControlModelFile]) -> "PageContent":
        """Parameters, run times, and the verdict in words."""
        from pipeline.submodels.control.page import content

        return content(shown)


def _moves(text: str) -> Moves:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "program.nc"
        path.write_text(text)
        return program_moves(path, Setup())


def _loader(matched: MatchedRun) -> Callable[[], MatchedRun]:
    return lambda: matched


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
