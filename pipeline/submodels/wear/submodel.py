"""Wear of tools as a sub-model: lives of tools are cases, from new to worn; windows of a table."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Ints
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Condition, LeftOut, Model, SourceFile
from pipeline.schema.predictions import AGAIN
from pipeline.schema.ranges import Positive, Share
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact, Role
from pipeline.signals.units import conversion
from pipeline.signals.wear_lives import read_lives
from pipeline.signals.wear_windows import ToolLife, WearRecords, WearWindows
from pipeline.submodels.cases import Case, Cases, Records, Roles, held, role_of
from pipeline.submodels.contract import (
    CUTTING_TIME,
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
from pipeline.submodels.wear.due import Estimate, due_facts, fit_lasting, parameters
from pipeline.submodels.wear.fit import fit_wear
from pipeline.submodels.wear.life import WearLifeSettings
from pipeline.submodels.wear.methods import feature_names, features
from pipeline.submodels.wear.model import (
    GUESS,
    MEAN,
    NAMES,
    WEAR,
    Readings,
    Wear,
    WearFitSettings,
    WearModel,
    load_wear,
)


def life_cases(
    signals: Path, records: WearRecords, roles: Roles, sets: GoldenSets | None,
    in_use: Collection[str] = (),
) -> Cases:  # fmt: skip
    """Lives of a machine's tools.

    A tool is in training as soon as one of its recordings is, so that none is learnt from and
    judged on.  A window of another life with the samples of one in training makes the case name the
    training recording among its files: the judge then refuses it as seen.  Of tools ``in_use`` the
    recordings after the last measurement of their wear are kept, with NaN.
    """
    found = read_lives(signals, records, roles.is_training, in_use=in_use)
    by_role: list[tuple[ToolLife, Role]] = [
        (life, role_of(_names(life), roles, sets)) for life in found.lives
    ]
    training = [life for life, role in by_role if role == "training"]
    learnt = {
        digest: life.files[_file_of(life, k)].sha256
        for life in training
        for k, digest in enumerate(life.windows.sha256s())
    }
    cases = []
    for life, role in by_role:
        files = [SourceFile(file=one.name, sha256=one.sha256) for one in life.files]
        if role != "training":
            files += _copied(life, learnt)
        conditions = {} if role == "sealed" else _furthest(life, training)
        cases.append(
            Case(
                name=life.tool, group=life.tool, role=role, files=tuple(files),
                load=held(life.windows), conditions=conditions,
            )
        )  # fmt: skip
    left_out = [LeftOut(case=name, reason=reason) for name, reason in found.left_out.items()]
    return Cases(cases=tuple(cases), left_out=tuple(left_out))


def _names(life: ToolLife) -> list[str]:
    """Names by which a life may be given a role: those of its recordings and raw files."""
    return [*dict.fromkeys(n for one in life.files for n in (one.name, one.file)), life.tool]


def _file_of(life: ToolLife, window: int) -> int:
    names = [one.name for one in life.files]
    return names.index(str(life.windows.recording[window]))


def _copied(life: ToolLife, learnt: dict[str, str]) -> list[SourceFile]:
    """Training recordings of which a window stands in this life, and that copy."""
    seen: dict[str, SourceFile] = {}
    for k, digest in enumerate(life.windows.sha256s()):
        if (source := learnt.get(digest)) is not None:
            name = f"{life.windows.recording[k]}, window at {life.windows.time[k]:.4g} s,"
            seen.setdefault(source, SourceFile(file=name, sha256=source))
    return list(seen.values())


def _furthest(life: ToolLife, training: list[ToolLife]) -> dict[str, Fact]:
    """Value of each condition, of the life that lies furthest from what training lives have."""
    found = {}
    for name, values in life.windows.conditions.items():
        others = [one.windows.conditions[name] for one in training]
        if name in life.windows.condition_units:
            numbers = [np.asarray(one, float) for one in others]
            low = min((float(one.min()) for one in numbers), default=-np.inf)
            high = max((float(one.max()) for one in numbers), default=np.inf)
            beyond = np.maximum(low - values, values - high)
            furthest = float(values[int(np.argmax(beyond))])
            value = float(f"{furthest:.6g}")
            if np.isfinite(value):
                found[name] = Fact(value=value, unit=life.windows.condition_units[name])
        else:
            known = {word for one in others for word in one.tolist()}
            words = dict.fromkeys(values.tolist())
            found[name] = Fact(value=next((w for w in words if w not in known), next(iter(words))))
    return found


def windows_of(cases: Iterable[Case]) -> WearWindows:
    """Windows of all cases, one after the other."""
    return WearWindows.joined([case.load() for case in cases])


PROGRESS = "progress"
"""Column of the use of the tool, in the unit that was learnt."""


def windows_of_table(table: "pd.DataFrame", file: WearModel) -> tuple[WearWindows, Ints]:
    """Windows of a table, and the window of each row, (T,); the last takes the remainder."""
    wanted = [*file.channels, *file.known.numbers, *file.known.words]
    if missing := [name for name in wanted if name not in table.columns]:
        raise ValueError(f"the input has no column {missing[0]!r}: give {', '.join(wanted)}")
    many = len(table) // file.length
    if not many:
        raise ValueError(
            f"the input has {len(table)} rows, a window has {file.length} at {file.rate_Hz:g} Hz: "
            "give at least as many"
        )
    used = table.iloc[: many * file.length]
    samples = used[list(file.channels)].to_numpy(float)
    if not np.isfinite(samples).all():
        row, column = np.argwhere(~np.isfinite(samples))[0]
        raise ValueError(
            f"{file.channels[column]} holds no finite value in row {row + 1}: leave such rows out"
        )
    starts = np.arange(many) * file.length
    conditions: dict[str, Any] = {
        name: used[name].to_numpy(float)[starts] for name in file.known.numbers
    }
    conditions |= {name: used[name].to_numpy(str)[starts] for name in file.known.words}
    for name in file.known.numbers:
        if not np.isfinite(conditions[name]).all():
            raise ValueError(
                f"condition {name} is not known: give it in {file.condition_units[name]}"
            )
    nothing = np.full(many, np.nan)
    progress = used[PROGRESS].to_numpy(float)[starts] if PROGRESS in used.columns else nothing
    windows = WearWindows(
        values=samples.reshape(many, file.length, -1).transpose(0, 2, 1).astype(np.float32),
        channels=file.channels, units=file.units, rate_Hz=file.rate_Hz, wear=nothing,
        wear_unit=file.wear_unit, measured=np.zeros(many, bool), conditions=conditions,
        condition_units={n: file.condition_units[n] for n in file.known.numbers},
        tool=np.full(many, ""), recording=np.full(many, ""), time=starts / file.rate_Hz,
        progress=progress, progress_unit=file.progress_unit,
    )  # fmt: skip
    return windows, np.minimum(np.arange(len(table)) // file.length, many - 1)


@dataclass(frozen=True, kw_only=True)
class WearLimits(IntervalLimits, section="wear_limits"):
    """Limits on the error of each tool that no method was fitted on."""

    rmse_um: Positive = 30.0
    """RMSE of flank wear over a tool's life [um]: a tenth of the usual criterion of 300 um (ISO
    8688-2)."""
    rmse_class: Positive = 0.5
    """RMSE of the probability of a worn tool [1]; 0.5 is what a coin has."""
    least_auc: Share = 0.7
    """Least area under the ROC curve of worn tools over all that were held out [1]; 0.7 is
    "acceptable" discrimination (Hosmer, Lemeshow and Sturdivant 2013, Applied Logistic Regression,
    5.2.4), a coin has 0.5."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    wear_records: WearRecords
    wear_life: WearLifeSettings = field(default_factory=WearLifeSettings)
    wear_fit: WearFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    wear_records: WearRecords
    wear_life: WearLifeSettings = field(default_factory=WearLifeSettings)
    wear_limits: WearLimits


class ToolWear(SubModel[Fitting, Judging, WearModel]):
    """Wear of tools from signals of the cut."""

    name: ClassVar[str] = "wear"
    title: ClassVar[str] = "tool wear"
    needs: ClassVar[str] = (
        "forces, vibration or currents in cut over the lives of three tools or more, with the "
        "flank wear measured from time to time, or said to be worn or not"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals",)
    model: ClassVar[type] = WearModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="signals of the cut", unit="of the recording", older_than_s=0.0),
        Input(name="conditions of the cut", unit="of the recording"),
        Input(name="use of the tool", unit="of the recording"),
    )
    ends: ClassVar[Ends] = {(WEAR, ""): ("low", "high")}

    def targets(self, settings: Judging, model: WearModel) -> tuple[Target, ...]:
        """Wear of held-out tools, beside a baseline without sensors."""
        limits = settings.wear_limits
        beaten = tuple(name for name in (GUESS, MEAN) if name in model.scores)
        others = tuple(name for name in model.scores if name != model.champion)
        return (
            Target(
                quantity=model.quantity, unit=model.wear_unit, baselines=others,
                limits={"rmse": limits.rmse_class if model.is_class else limits.rmse_um},
                must_beat=beaten, titles=NAMES,
                coverage=None if model.is_class else limits.share,
                least_auc=limits.least_auc if model.is_class else 0.0,
            ),
        )  # fmt: skip

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Lives of tools."""
        if records.signals is None:
            raise ValueError("recordings of tools stand in the signals: name them in reads")
        in_use = settings.wear_life.in_use
        return life_cases(records.signals, settings.wear_records, settings.roles, sets, in_use)

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> WearModel:
        """Every method fitted on the training tools; the one that serves is named."""
        training, records = cases.of("training"), settings.wear_records
        if not training:
            first = next((f"; {one.case}: {one.reason}" for one in cases.left_out), "")
            raise ValueError(
                f"no training tool has a window of known wear{first}: name some in roles.training"
            )
        windows = windows_of(training)
        windows = windows.of(np.isfinite(windows.wear))
        lasting = fit_lasting(windows, settings.wear_life)
        head = Model(
            submodel=self.name, machine=settings.identity.name, origin=settings.identity.origin,
            parameters=parameters(lasting), left_out=cases.left_out,
            trained_on=tuple(case.training for case in training), conditions=_conditions(windows),
        )  # fmt: skip
        model, methods = fit_wear(windows, records.progress, settings.wear_fit, head, lasting)
        write_json(methods, folder / "methods.json")
        return model

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of lives."""
        wear = load_wear(folder)
        return lambda case: _predicted(case, wear, settings.wear_life)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Wear with its 90 % interval from a table of samples at the learnt rate.

        The table has a column for each channel, in the unit that was learnt, the conditions as
        further columns, and the use of the tool as ``progress`` where that is known; windows follow
        one another, and each row gets the wear of its own.
        """
        wear = load_wear(folder)

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            windows, of_row = windows_of_table(table, wear.file)
            _, told, low, high = wear.served(wear.together(wear.fitted.predict(windows)))
            columns = {"wear": told, "low": low, "high": high}
            return pd.DataFrame(
                {name: values[of_row] for name, values in columns.items()}, index=table.index
            )

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """Example window of a wave about the middle of each channel."""
        file = read_json(folder / "model.json", WearModel)
        wave = np.sin(np.arange(file.length))
        columns: dict[str, Any] = {
            name: shift + scale * wave
            for name, shift, scale in zip(
                file.channels, file.scaling.shift, file.scaling.scale, strict=True
            )
        }
        for name in file.known.numbers:
            one = file.conditions[name]
            columns[name] = np.full(file.length, 0.5 * ((one.low or 0.0) + (one.high or 0.0)))
        for name, words in file.known.words.items():
            columns[name] = words[0]
        if not file.is_class:
            columns["progress"] = 0.0
        return pd.DataFrame(columns)

    def influences(self, case: Case, rows: pd.DataFrame) -> dict[str, Any]:
        """Use of the tool since it was changed."""
        return {CUTTING_TIME: rows["t"].to_numpy(float)}

    def curves(self, folder: Path) -> Mapping[str, Sequence[float]]:
        """Validation RMSE after each epoch of the networks of the folds."""
        wear = load_wear(folder)
        return {
            f"resnet.fold_{fold}": [float(row[2]) for row in one.trained.history]
            for fold, one in enumerate(wear.fitted.networks, start=1)
        }


def _conditions(windows: WearWindows) -> dict[str, Condition]:
    found = {}
    for name, values in windows.conditions.items():
        unit = windows.condition_units.get(name)
        if unit is None:
            found[name] = Condition(words=tuple(np.unique(values).tolist()))
        elif np.isfinite(values).any():
            low, high = float(np.nanmin(values)), float(np.nanmax(values))
            found[name] = Condition(unit=unit, low=float(f"{low:.6g}"), high=float(f"{high:.6g}"))
    return found


def _predicted(case: Case, wear: Wear, life: WearLifeSettings) -> Prediction:
    windows: WearWindows = case.load()
    file = wear.file
    mine = windows.channels, windows.units, windows.values.shape[2], windows.wear_unit
    if mine != (file.channels, file.units, file.length, file.wear_unit):
        return Prediction(
            frame=pd.DataFrame(),
            note=f"its windows of {', '.join(windows.channels)} are none of those learnt",
        )
    readings, found, again = wear.predict_again(windows)
    name, told, low, high = wear.served(found)
    first = readings.first
    others = {f"baseline_{one}": values for one, values in found.items() if one != name}
    others |= {f"{AGAIN}{k}": wear.served(one)[1] for k, one in enumerate(again)}
    frame = pd.DataFrame({
        "quantity": file.quantity, "unit": file.wear_unit, "regime": "",
        "t": _seconds(windows.progress[first], file.progress_unit),
        "measured": readings.mean(windows.wear), "predicted": told, "low": low, "high": high,
        "scored": windows.measured[first], **others,
    })  # fmt: skip
    frame = frame[np.isfinite(frame["measured"])]
    facts = _facts(windows, frame, file)
    if file.lasting.life is not None:
        estimate = Estimate(wear=float(told[-1]), low=float(low[-1]), high=float(high[-1]))
        facts |= due_facts(windows, estimate, file.lasting.life, life)
    note = "" if len(frame) else "its wear was not measured, so that nothing can be held against it"
    return Prediction(frame=frame, facts=facts, note=note, seen=(_seen(windows, readings, wear),))


def _seen(windows: WearWindows, readings: Readings, wear: Wear) -> SeenInputs:
    """Measured wear of each reading, and features of the signals, over the use of the tool."""
    known = wear.fitted.known
    x = features(windows, wear.fitted.scaling, known)
    names = feature_names(windows.channels, known, windows, x.shape[1])
    rows = np.flatnonzero(windows.measured[readings.first])
    inputs = {name: readings.mean(x[:, k])[rows] for k, name in enumerate(names)}
    return SeenInputs(
        quantity=wear.file.quantity, t=np.asarray(windows.progress[readings.first][rows], float),
        measured=readings.mean(windows.wear)[rows], inputs=inputs,
    )  # fmt: skip


def _seconds(use: Any, unit: str) -> Any:
    """Use of the tool in seconds where it is a time, else as it is."""
    try:
        factor, _ = conversion(unit, "s")
    except ValueError:
        factor = 1.0
    return np.asarray(use, float) * factor


def _facts(windows: WearWindows, frame: pd.DataFrame, file: WearModel) -> dict[str, Fact]:
    """Number of windows, share with measured wear, and share beyond the training range."""
    facts = {"windows": Fact(value=float(len(windows)), unit="1")}
    if file.is_class:
        share = float(frame["predicted"].mean())
        return facts | {"mean probability of a worn tool": Fact(value=float(f"{share:.3g}"))}
    scored = frame["scored"].to_numpy(bool)
    if not scored.all():
        facts["readings with interpolated wear, not judged"] = Fact(
            value=float((~scored).sum()), unit="1"
        )
    low, high = file.learnt
    wear = windows.wear[np.isfinite(windows.wear)]
    if wear.size and (float(wear.max()) > high or float(wear.min()) < low):
        facts["wear learnt up to"] = Fact(value=float(f"{high:.4g}"), unit="um")
    return facts


SUBMODEL = ToolWear()
"""Wear of tools."""
