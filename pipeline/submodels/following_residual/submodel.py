"""Residual following error of the feed axes as a sub-model, judged on recordings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.nets.settings import TuningSettings
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import LeftOut, SourceFile
from pipeline.schema.ranges import Positive
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Fact, Role
from pipeline.signals.windows import row_period
from pipeline.submodels.cases import Case, Cases, Records, conditions_of, held, role_of
from pipeline.submodels.conformal import interval
from pipeline.submodels.contract import (
    VELOCITY,
    Ends,
    Input,
    IntervalLimits,
    Prediction,
    Predictor,
    Sections,
    SeenInputs,
    SubModel,
    Target,
)
from pipeline.submodels.following_residual.features import RESIDUAL, Features, features_of
from pipeline.submodels.following_residual.fit import UM, chosen, fit_axes, leak_shown, searched
from pipeline.submodels.following_residual.model import (
    ARX,
    FUZZY,
    PERSISTENCE,
    PREDICTION,
    QUANTITIES,
    TWIN,
    LoadedResidual,
    NetworksFile,
    ResidualFitSettings,
    ResidualModel,
    UseModel,
    attention_shown,
    load_residual,
    titles,
)
from pipeline.submodels.following_residual.records import ResidualRecords, Run, read_runs
from pipeline.submodels.statistics import drawn_again
from pipeline.twin.drive import IdentifiedDrive, read_drives

SERVED = ("reference", "modelled_error", "modelled_command")
"""Columns of a table that the model serves, after the axis' letter."""
LEARNT = 300
"""Samples of a training recording that are compared [1]."""
COMPARED = 400
"""Samples of a recording, evenly, on which networks that do not serve are compared, at most [1]."""


@dataclass(frozen=True, kw_only=True)
class ResidualLimits(IntervalLimits, section="following_residual_limits"):
    """Limits on recordings that no network was trained on."""

    most_percent: Positive = 70.0
    """Greatest RMSE over the RMS of the following error itself [%]: at 70 half of its mean square
    is predicted, whatever the interval holds and whichever method serves."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    following_residual_records: ResidualRecords
    following_residual_fit: ResidualFitSettings
    tuning: TuningSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    following_residual_records: ResidualRecords
    following_residual_limits: ResidualLimits


@dataclass(frozen=True, kw_only=True, eq=False)
class Driven:
    """A recording, and the identified drives of its axes; none where the machine has no model.

    ``most`` samples of it are compared, evenly; all where it is None.
    """

    run: Run
    drives: Mapping[str, IdentifiedDrive]
    records: ResidualRecords
    most: int | None = None

    def features(self, letter: str, step_s: float, *, with_fuzzy: bool = False) -> Features:
        """Network inputs of an axis."""
        return features_of(
            self.run,
            letter,
            self.drives.get(letter),
            step_s=step_s,
            lead_mm=self.records.axes[letter].lead_mm,
            with_fuzzy=with_fuzzy,
        )


class FollowingResidual(SubModel[Fitting, Judging, ResidualModel]):
    """Residual following error beyond the drives' model."""

    name: ClassVar[str] = "following_residual"
    title: ClassVar[str] = "residual following error"
    needs: ClassVar[str] = (
        "commanded and measured position of each axis at 500 Hz or more, in five recordings or "
        "more of motions like those that shall be predicted"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals", "drive")
    model: ClassVar[type] = ResidualModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="commanded position", unit="m"),
        Input(name="state of the drive model", unit="m"),
        Input(name="following error", unit="m", older_than_s=0.001),
        Input(name="torque command", unit="1", older_than_s=0.001),
    )
    ends: ClassVar[Ends] = {(QUANTITIES[PREDICTION], ""): ("low", "high")}

    def targets(self, settings: Judging, model: ResidualModel) -> tuple[Target, ...]:
        """Following error of each axis, predicted and estimated.

        An interval as wide as the error holds all of it, and the drive model alone has nothing to
        beat where it serves: every axis has to be predicted in its own right.
        """
        limits = settings.following_residual_limits
        found = []
        for letter, uses in model.axes.items():
            for use, one in uses.items():
                base = TWIN if use == PREDICTION else PERSISTENCE
                others = others_of(one)
                if use == PREDICTION and model.with_drive:
                    others = (*others, FUZZY)
                found.append(
                    Target(
                        quantity=f"{QUANTITIES[use]} {letter}", unit="um", baselines=others,
                        must_beat=(base,) if base in others else (), coverage=limits.share,
                        most_percent=limits.most_percent,
                        titles=titles(with_drive=model.with_drive),
                    )
                )  # fmt: skip
        return tuple(found)

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Recordings of axes and parts of them; ValueError for a pattern without a file."""
        if records.signals is None or records.drive is None:
            raise ValueError("recordings stand in signals, drives beside them: name both in reads")
        wanted = settings.following_residual_records
        path = records.drive / "model.json"
        drives = read_drives(path) if path.exists() else {}

        def role(name: str, file: str) -> Role:
            return role_of([name, file], settings.roles, sets)

        cases, left_out = [], []
        runs = read_runs(
            records.signals, wanted,
            lambda name, file: role(name, file) == "training",
        )  # fmt: skip
        for run in runs:
            if not run.axes:
                reasons = "; ".join(sorted(set(run.lacking.values())))
                left_out.append(LeftOut(case=run.name, reason=reasons))
                continue
            of_run: Role = "held_out" if run.last else role(run.name, run.file)
            most = LEARNT if of_run == "training" else None  # it decides nothing
            driven = Driven(run=run, drives=drives, records=wanted, most=most)
            cases.append(
                Case(
                    name=run.name, group=run.group, role=of_run, load=held(driven),
                    files=(SourceFile(file=run.name, sha256=run.sha256),),
                    conditions={} if of_run == "sealed" else _conditions(run),
                )
            )  # fmt: skip
        return Cases(cases=tuple(cases), left_out=tuple(left_out))

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> ResidualModel:
        """Networks of every axis; what serves is chosen on training recordings left out."""
        training, fitting = cases.of("training"), settings.following_residual_fit
        driven: list[Driven] = [case.load() for case in training]
        if not driven:
            first = next((f"; {one.case}: {one.reason}" for one in cases.left_out), "")
            raise ValueError(
                f"no training recording shows a following error{first}: name one in roles.training"
            )
        axes = {
            letter: features
            for letter in settings.following_residual_records.axes
            if (features := [
                one.features(letter, fitting.step_s) for one in driven if letter in one.run.axes
            ])
        }  # fmt: skip
        fitting, search = searched(axes, fitting, settings.tuning)
        found = fit_axes(axes, fitting)
        letter = next(iter(axes))
        leak = None
        if (letter, PREDICTION) in found and fitting.searched in fitting.kinds:
            honest = found[letter, PREDICTION].model.scores[fitting.searched]
            leak = leak_shown(letter, axes[letter], fitting, honest)
        documents = {key: value for one in found.values() for key, value in one.documents.items()}
        write_json(NetworksFile(documents=documents), folder / "networks.json")
        steps = [one.recording.step_s for features in axes.values() for one in features]
        model = ResidualModel(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters={},
            trained_on=tuple(case.training for case in training),
            left_out=cases.left_out,
            conditions={n: replace(c, low=0.0) for n, c in conditions_of(training).items()},
            axes={
                name: {use: one.model for (of, use), one in found.items() if of == name}
                for name in axes
            },
            step_s=float(np.median(steps)),
            horizon_s=fitting.horizon_s,
            settle_s=fitting.settle_s,
            length=fitting.length,
            lead_mm={
                name: one.lead_mm for name, one in settings.following_residual_records.axes.items()
                if one.lead_mm is not None
            },
            with_drive=bool(driven[0].drives),
            search=search,
            leak=leak,
        )  # fmt: skip
        served = LoadedResidual(file=model, documents=documents)
        return replace(model, attention=attention_shown(served, driven[0].drives))

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of recordings."""
        model = load_residual(folder)
        return lambda case: _predicted(case.load(), model)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Residual of each axis before the motion with its 90 % interval [um].

        The table has ``t`` [s], evenly spaced, and for each axis of interest
        ``<axis>_reference`` [m], ``<axis>_modelled_error`` [m] and ``<axis>_modelled_command`` of
        the drives' model; the axis is at rest in the first row.
        """
        model = load_residual(folder)

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            row_period(table)
            found: dict[str, Any] = {"t": table["t"].to_numpy(float)}
            for letter, uses in model.file.axes.items():
                names = [f"{letter}_{one}" for one in SERVED]
                if PREDICTION not in uses or any(name not in table.columns for name in names):
                    continue
                period = row_period(table, *names)
                reference, error, command = (table[name].to_numpy(float) for name in names)
                residual, half = model.residual(letter, reference, error, command, period)
                found |= {
                    f"{letter}_residual": UM * residual, f"{letter}_low": UM * (residual - half),
                    f"{letter}_high": UM * (residual + half),
                }  # fmt: skip
            return pd.DataFrame(found, index=table.index)

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """A fifth of a second of slow feed of each axis."""
        model = load_residual(folder).file
        t = model.step_s * np.arange(100)
        columns: dict[str, Any] = {"t": t}
        for letter, uses in model.axes.items():
            if PREDICTION in uses:
                columns |= {
                    f"{letter}_reference": 0.01 * t, f"{letter}_modelled_error": 0.0 * t,
                    f"{letter}_modelled_command": 0.0 * t,
                }  # fmt: skip
        return pd.DataFrame(columns)

    def curves(self, folder: Path) -> Mapping[str, Sequence[float]]:
        """Validation RMSE [um] after each epoch of every network, by axis, use, kind and fold."""
        documents = load_residual(folder).documents
        return {
            f"{name}.fold_{fold}": [UM * float(row[2]) for row in one["history"]]
            for name, some in documents.items()
            for fold, one in enumerate(some, start=1)
        }

    def influences(self, case: Case, rows: pd.DataFrame) -> dict[str, Any]:
        """Commanded velocity of the axis of the rows [m/s]."""
        run = case.load().run
        axis = run.axes.get(str(rows["quantity"].iloc[0]).rpartition(" ")[2])
        if axis is None or axis.reference is None or len(axis.reference) < 2:
            return {}
        time = np.arange(len(axis.reference)) * run.period
        speed = np.gradient(axis.reference, run.period)
        return {VELOCITY: np.interp(rows["t"], time, speed)}


def _conditions(run: Run) -> dict[str, Fact]:
    """Highest commanded speed of each axis, to three significant digits."""
    return {
        f"highest speed {letter}": Fact(
            value=float(f"{1e3 * np.abs(np.diff(axis.reference)).max() / run.period:.3g}"),
            unit="mm/s",
        )
        for letter, axis in run.axes.items()
        if axis.reference is not None and len(axis.reference) > 1
    }


def _predicted(driven: Driven, model: LoadedResidual) -> Prediction:
    frames: list[pd.DataFrame] = []
    facts: dict[str, Fact] = {}
    seen: list[SeenInputs] = []
    for letter, uses in model.file.axes.items():
        if letter not in driven.run.axes:
            continue
        features = driven.features(letter, model.file.step_s, with_fuzzy=True)
        for use, one in uses.items():
            known = set(features.recording.signals)
            if any(wanted.name not in known for wanted in one.inputs):
                continue
            if len(features.time) < model.rows_needed(one):
                continue
            frame = _frame(features, letter, use, model, driven.most)
            if not len(frame):
                continue
            frames.append(frame)
            facts |= _facts(frame, letter, use)
            seen.append(_seen(features, f"{QUANTITIES[use]} {letter}", one, model.file.settle_s))
    if not frames:
        return Prediction(frame=pd.DataFrame(), note="it is shorter than a window or shows no axis")
    return Prediction(frame=pd.concat(frames, ignore_index=True), facts=facts, seen=tuple(seen))


def _seen(features: Features, quantity: str, use: UseModel, settle_s: float) -> SeenInputs:
    """Residual that is learnt [m], once the model has settled, and its inputs, as old as is due."""
    recording, t = features.recording, features.time
    learnt = features.known & (recording.step_s * np.arange(len(t)) >= settle_s)
    inputs = {}
    for one in use.inputs:
        if one.name == RESIDUAL:  # its own past is the target by design: the windows hold its age
            continue
        late = one.rows(recording.step_s)
        values = np.asarray(recording.signals[one.name], float)
        inputs[one.name] = np.concatenate([np.full(late, np.nan), values[: len(t) - late]])
    measured = np.where(learnt, recording.signals[RESIDUAL], np.nan)
    return SeenInputs(quantity=quantity, t=t, measured=measured, inputs=inputs)


def _frame(
    features: Features, letter: str, use: str, model: LoadedResidual, most: int | None
) -> pd.DataFrame:
    """Following error measured and predicted [um], the other networks beside it."""
    one = model.file.axes[letter][use]
    windows = model.windows(letter, use, features.recording)
    late = windows.at * features.recording.step_s >= model.file.settle_s
    rows = np.flatnonzero(late & features.known[windows.at])
    if most is not None:
        rows = rows[:: max(-(-len(rows) // most), 1)]
    windows = chosen(windows, rows)
    at = windows.at
    modelled, regime = UM * features.modelled[at], features.regime[at]

    each = UM * np.stack(model.by_each(letter, use, one.champion, windows))
    found = modelled + each.mean(axis=0)
    low, high = interval(found, regime, one.bands)
    others = {}
    for kind in others_of(one):
        if kind in (TWIN, PERSISTENCE):
            rows = np.arange(len(at))
        elif most is None:
            rows = np.arange(len(at))[:: max(-(-len(at) // COMPARED), 1)]
        else:
            continue  # networks that do not serve are not compared on what they learnt from
        column = np.full(len(at), np.nan)
        column[rows] = modelled[rows] + UM * model.predicted(
            letter, use, kind, chosen(windows, rows)
        )
        others[f"baseline_{kind}"] = column
    if one.champion not in (TWIN, PERSISTENCE, ARX):  # these are the same from any seed
        others |= {name: modelled + mean for name, mean in drawn_again(each).items()}
    if use == PREDICTION and features.fuzzy is not None:
        others[f"baseline_{FUZZY}"] = UM * features.fuzzy[at]
    return pd.DataFrame({
        "quantity": f"{QUANTITIES[use]} {letter}", "unit": "um", "t": features.time[at],
        "measured": UM * features.measured[at], "predicted": found, "low": low, "high": high,
        "step": UM * features.step, **others,
    })  # fmt: skip


def others_of(one: UseModel) -> tuple[str, ...]:
    """Kinds that do not serve, the baseline among them."""
    return tuple(name for name in one.scores if name != one.champion)


def _facts(frame: pd.DataFrame, letter: str, use: str) -> dict[str, Fact]:
    base = TWIN if use == PREDICTION else PERSISTENCE
    name = f"baseline_{base}"
    if name not in frame.columns:
        return {}
    measured = frame["measured"].to_numpy(float)
    before = float(np.abs(frame[name].to_numpy(float) - measured).max())
    after = float(np.abs(frame["predicted"].to_numpy(float) - measured).max())
    if before <= 0:
        return {}
    share = Fact(value=float(f"{100 * (1 - after / before):.3g}"), unit="%")
    return {f"greatest error of {letter} less by, {use}": share}


SUBMODEL = FollowingResidual()
"""Following errors of feed axes."""
