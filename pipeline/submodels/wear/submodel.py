"""Wear of tools as a sub-model: cases are lives of tools, from new to worn."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.golden import GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Condition
from pipeline.schema.predictions import AGAIN
from pipeline.schema.ranges import Positive, Ranged, Share
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import WearRecords, WearWindows
from pipeline.submodels.cases import Case, Cases, Records, Roles
from pipeline.submodels.conformal import ALL_REGIMES, MANY_GROUPS
from pipeline.submodels.contract import Ends, Input, Prediction, Predictor, Shown, SubModel, Target
from pipeline.submodels.wear.cases import life_cases, windows_of, windows_of_table
from pipeline.submodels.wear.due import Estimate, due_facts, fit_lasting, parameters
from pipeline.submodels.wear.fit import fit_wear
from pipeline.submodels.wear.life import WearLifeSettings
from pipeline.submodels.wear.model import (
    GUESS,
    MEAN,
    WEAR,
    Wear,
    WearFitSettings,
    WearModel,
    load_wear,
)


@dataclass(frozen=True, kw_only=True)
class WearLimits(Ranged, section="wear_limits"):
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
    coverage: tuple[Share, ...] = (0.8, 0.98)
    """Least and greatest share of readings inside the 90 % interval [1].  The upper one decides
    from ``MANY_GROUPS`` training tools on: fewer may differ more than those to come."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.coverage) != 2 or self.coverage[0] > self.coverage[1]:
            raise ValueError(
                f"wear_limits.coverage = {list(self.coverage)} must be the least and the greatest "
                "share"
            )


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """Sections of params.yaml that the fit reads."""

    identity: MachineIdentity
    roles: Roles
    wear_records: WearRecords
    wear_life: WearLifeSettings = field(default_factory=WearLifeSettings)
    wear_fit: WearFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging:
    """Sections of params.yaml that the judgement reads."""

    identity: MachineIdentity
    roles: Roles
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
        if model.is_class:
            return (
                Target(
                    quantity=model.quantity, unit=model.wear_unit, baselines=others,
                    limits={"rmse": limits.rmse_class}, must_beat=beaten,
                    least_auc=limits.least_auc,
                ),
            )  # fmt: skip
        least, most = limits.coverage
        if model.bands[model.champion][ALL_REGIMES].groups < MANY_GROUPS:
            most = 1.0
        return (
            Target(
                quantity=model.quantity, unit=model.wear_unit, baselines=others,
                limits={"rmse": limits.rmse_um}, must_beat=beaten, coverage=(least, most),
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
        found = fit_wear(windows, records.progress, settings.wear_fit)
        write_json(found.methods, folder / "methods.json")
        return WearModel(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters=parameters(lasting),
            lasting=lasting,
            trained_on=tuple(case.training for case in training),
            left_out=cases.left_out,
            conditions=_conditions(windows),
            wear_unit=windows.wear_unit,
            learnt=(float(windows.wear.min()), float(windows.wear.max())),
            channels=windows.channels,
            units=windows.units,
            rate_Hz=windows.rate_Hz,
            length=windows.values.shape[2],
            scaling=found.scaling,
            known=found.known,
            condition_units=dict(windows.condition_units),
            progress=records.progress,
            progress_unit=windows.progress_unit,
            per_recording=found.per_recording,
            champion=found.champion,
            alone=found.alone,
            scores=found.scores,
            weights=found.weights,
            bands=found.bands,
        )

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

    def curves(self, folder: Path) -> Mapping[str, Sequence[float]]:
        """Validation RMSE after each epoch of the networks of the folds."""
        wear = load_wear(folder)
        return {
            f"resnet.fold_{fold}": [float(row[2]) for row in one.trained.history]
            for fold, one in enumerate(wear.fitted.networks, start=1)
        }

    def page(self, shown: Shown[WearModel]) -> Any:
        """Wear over the life of each tool held out, methods compared, where the model errs."""
        from pipeline.submodels.wear.page import content

        return content(shown)


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
    return Prediction(frame=frame, facts=facts, note=note)


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
