"""Identification of cutting forces from dynamometer recordings, and the document of the result."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import (
    CHANNEL,
    COEFFICIENTS,
    MEAN_FORCE,
    SPINDLE,
    CutRecording,
    CuttingFitFacts,
    CuttingModel,
    FoldModel,
    MethodTried,
    ResidualConditions,
    TermsTried,
)
from pipeline.schema.model import Correlation, Model, Parameter
from pipeline.schema.si import MM
from pipeline.submodels.cutting.coefficients import (
    kienzle,
    mean_regression,
    modes,
    parameters,
)
from pipeline.submodels.cutting.faults import Reference, named_faults
from pipeline.submodels.cutting.fit import Fit, genetic_fit
from pipeline.submodels.cutting.model import BEYOND, CutModel, plain_model, stored
from pipeline.submodels.cutting.recordings import CuttingRecording, cut_harmonics
from pipeline.submodels.cutting.regression import Estimate, digits
from pipeline.submodels.cutting.runout import RoundedFit, rounded_fit
from pipeline.submodels.cutting.selection import (
    FitUncertainty,
    Selection,
    fit_uncertainty,
    left_out_error,
    model_of,
    residual_helps,
    select_model,
)
from pipeline.submodels.cutting.settings import DIRECTIONS, CuttingFitSettings, CuttingSetup
from pipeline.submodels.cutting.spindle_load.identify import SpindleLoadResult
from pipeline.submodels.cutting.spread import calibrated, left_out_errors, spread_of
from pipeline.submodels.cutting.waveform import CutHarmonics, mean_squares


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingIdentification:
    """Result of the identification."""

    recordings: Sequence[CuttingRecording]
    """All of the machine."""
    cuts: Sequence[CutHarmonics] = ()
    """The training recordings, in their order."""
    selection: Selection | None = None
    """Selected terms; None without a training recording."""
    fit: Fit | None = None
    """Optimum by the chosen method."""
    uncertainty: FitUncertainty | None = None
    """Uncertainty of its unknowns."""
    not_sharp: RoundedFit | None = None
    """Fit whose edges are not sharp, each tooth with its own, of the other terms of ``fit``."""
    mean_force: Sequence[Estimate] = ()
    """Coefficients by regression of the mean forces."""
    mean_values: Floats | None = None
    """The same in SI; shape (6,)."""
    methods: Sequence[MethodTried] = ()
    """Error and evaluations of each method tried."""
    serving: Fit | None = None
    """The one that predicts: ``fit``, or that whose edges are not sharp."""
    model: CutModel | None = None
    """Its model, with what the intervals of its forces are made of."""
    folds: Sequence[CutModel] = ()
    """Its models of the selection's folds, with their own spreads."""
    reason: str = ""
    """Why there is no fit."""

    @property
    def references(self) -> dict[str, Reference]:
        """Model of each recording that was fitted without it: of its fold, else of the fit."""
        if self.selection is None or self.model is None:
            return {}
        names = tuple(one.name for one in self.training)
        whole = Reference(model=self.model, fitted_on=names)
        found = {one.name: whole for one in self.recordings if not one.is_training}
        for fold, model in zip(self.selection.folds, self.folds, strict=True):
            out = tuple(names[k] for k in fold.left_out)
            rest = tuple(name for name in names if name not in out)
            found |= {name: Reference(model=model, fitted_on=rest) for name in out}
        return found

    @property
    def training(self) -> list[CuttingRecording]:
        """The training recordings, in the order of ``cuts``."""
        return [one for one in self.recordings if one.is_training]


def identify_cutting_force(
    recordings: Sequence[CuttingRecording], setup: CuttingSetup, settings: CuttingFitSettings
) -> CuttingIdentification:
    """Coefficients, runout and modes from the training recordings."""
    cuts = [cut_harmonics(one, settings) for one in recordings if one.is_training]
    if not cuts:
        return CuttingIdentification(recordings=recordings, reason=_why_none(recordings))
    selection = select_model(
        setup.tool, cuts, "helix" in setup.identified, settings.gain, settings.folds
    )
    fit, methods = selection.fit, [_method("least_squares", selection.fit)]
    if settings.compare or settings.method == "genetic":
        other = genetic_fit(selection.fit, settings.genetic)
        methods.append(_method("genetic", other))
        fit = other if settings.method == "genetic" else fit
    uncertainty = fit_uncertainty(fit, selection.folds, selection.rivals)
    not_sharp = rounded_fit(fit, settings.folds)
    mean_values, means = mean_regression(cuts, settings.widest, fit, not_sharp.shape)
    candidates = (
        (fit, selection.folds, selection.with_residual),
        (not_sharp.fit, not_sharp.folds, residual_helps(cuts, not_sharp.folds, settings.gain)),
    )
    serving, fits, with_residual = min(  # the one that errs least on recordings left out
        candidates,
        key=lambda one: left_out_error(cuts, one[1], with_residual=one[2]) if one[1] else 0.0,
    )
    folds = [
        model_of(fold.fit, with_residual=with_residual, spread=spread_of(fold.fit, line, shape))
        for fold, line, shape in zip(fits, not_sharp.lines_elsewhere, not_sharp.shapes, strict=True)
    ]
    errors = [
        left_out_errors(model, cuts[k])
        for model, fold in zip(folds, fits, strict=True) for k in fold.left_out
    ]  # fmt: skip
    spread = calibrated(spread_of(serving, not_sharp.line_elsewhere, not_sharp.shape), errors)
    return CuttingIdentification(
        recordings=recordings, cuts=cuts, selection=selection, fit=fit, uncertainty=uncertainty,
        not_sharp=not_sharp, mean_force=means, mean_values=mean_values, methods=methods,
        serving=serving, folds=folds,
        model=model_of(serving, with_residual=with_residual, spread=spread),
        reason=_upside_down(fit),
    )  # fmt: skip


def _why_none(recordings: Sequence[CuttingRecording]) -> str:
    if not recordings:
        return "no dynamometer: coefficients of the cut are found from its forces, record them"
    left = [one for one in recordings if one.role == "training"]
    if not left:
        return "no recording is named in roles.training: name those to learn from"
    reasons = "; ".join(f"{one.name}: {one.reason}" for one in left)
    return f"none of the training recordings can be used ({reasons})"


def _upside_down(fit: Fit) -> str:
    if fit.values[0] > 0:
        return ""
    return (
        f"K_tc is {fit.values[0] / 1e6:.4g} N/mm^2, and no tool cuts with that: correct the "
        "directions and signs in cutting.dynamometer, or the immersion"
    )


def _method(name: str, fit: Fit) -> MethodTried:
    return MethodTried(
        method=name, rms_error_percent=rms_error_percent(fit), evaluations=fit.evaluations
    )


def rms_error_percent(fit: Fit) -> float:
    """RMS residual of a fit over the RMS force, all recordings and directions [%]."""
    pairs = list(zip(fit.problem.cuts, fit.modelled, strict=True))
    error = sum(float(mean_squares(cut.lines - model).sum()) for cut, model in pairs)
    power = sum(float(mean_squares(cut.lines).sum()) for cut, _ in pairs)
    return 100 * float(np.sqrt(error / power))


def cutting_model(
    head: Model, identified: CuttingIdentification, setup: CuttingSetup,
    settings: CuttingFitSettings, spindle: SpindleLoadResult | None,
) -> CuttingModel:  # fmt: skip
    """Model as it is stored, the parameters of ``head`` filled in."""
    fit, selection, model = identified.fit, identified.selection, identified.model
    uncertainty, not_sharp = identified.uncertainty, identified.not_sharp
    widest = settings.widest
    groups: dict[str, Mapping[str, Parameter]] = {}
    remarks: dict[str, str] = {}
    facts, correlation = None, Correlation()
    terms: tuple[TermsTried, ...] = ()
    folds: tuple[FoldModel, ...] = ()
    if (
        fit is not None and uncertainty is not None and not_sharp is not None
        and selection is not None and model is not None
    ):  # fmt: skip
        estimates = parameters(fit, uncertainty, not_sharp, widest, identified.mean_force)
        remarks = {one.name: one.remark for one in estimates if one.determined and one.remark}
        groups[COEFFICIENTS] = _parameters(estimates) | kienzle(identified.cuts, widest)
        groups[MEAN_FORCE] = _parameters(identified.mean_force)
        for direction, rows in modes(fit, uncertainty, widest).items():
            channel: str = getattr(setup.dynamometer, DIRECTIONS[direction])
            groups[CHANNEL + channel.removeprefix("-")] = _parameters(rows)
        facts = _facts(identified, identified.serving or fit, uncertainty)
        correlation = _correlation(uncertainty.names, uncertainty.covariance)
        terms = tuple(selection.tried)
        names = [one.name for one in identified.training]
        folds = tuple(
            FoldModel(left_out=tuple(names[k] for k in one.left_out), prediction=stored(fold_model),
                      fitted_on=tuple(n for k, n in enumerate(names) if k not in one.left_out))
            for one, fold_model in zip(selection.folds, identified.folds, strict=True)
        )  # fmt: skip
    faults = named_faults(identified.recordings, identified.references, setup, settings)
    if spindle is not None:
        groups[SPINDLE] = spindle.parameters
    plain = identified.mean_values
    return CuttingModel(
        **vars(replace(head, parameters=groups)), method=settings.method, reason=identified.reason,
        material=setup.material, tool=asdict(setup.tool), remarks=remarks, correlation=correlation,
        fit=facts, terms=terms, methods=tuple(identified.methods), folds=folds,
        residual_conditions=() if model is None else _residual_conditions(model),
        recordings=tuple(
            replace(recording_row(one), fault=faults.get(one.name, ""))
            for one in identified.recordings
        ),
        prediction=None if model is None else stored(model),
        plain=None if plain is None else stored(plain_model(setup.tool, np.array(plain))),
        spindle=None if spindle is None else spindle.facts,
    )  # fmt: skip


def _facts(
    identified: CuttingIdentification, fit: Fit, uncertainty: FitUncertainty
) -> CuttingFitFacts:
    return CuttingFitFacts(
        rms_error_percent=digits(rms_error_percent(fit)),
        samples=len(fit.solved.residuals) - fit.problem.linear,
        revolutions=sum(one.cut[1].count for one in identified.training),
        condition=digits(uncertainty.condition),
        left_out_N=tuple(digits(v) for v in np.sqrt(fit.problem.left_out)),
        zero_N=digits(float(np.sqrt(fit.problem.zero))),
    )


def _residual_conditions(model: CutModel) -> tuple[ResidualConditions, ...]:
    """Conditions of the waveform residual; empty where it is not part of the model."""
    rows = []
    for one in model.residuals:
        stated = {name: digits(value) for name, value in one.conditions.stated.items()}
        del stated["feed_per_tooth_mm"]
        rows.append(ResidualConditions(
            **stated, feeds_per_tooth_mm=tuple(digits(f / MM) for f in one.feeds),
            holds_for_mm=(digits(min(one.feeds) / BEYOND / MM),
                          digits(max(one.feeds) * BEYOND / MM)),
        ))  # fmt: skip
    return tuple(rows)


def recording_row(one: CuttingRecording) -> CutRecording:
    """Role and conditions of a recording in the units of their names, or why it is left out."""
    c, revolution = one.conditions, one.revolution
    used = "training" if one.role == "training" else "judged"
    row = CutRecording(
        recording=one.name, role="left out" if revolution is None else used, reason=one.reason,
        notes=one.notes, revolutions=0 if revolution is None else revolution.count,
    )  # fmt: skip
    if c is None:
        return row
    speed = c.speed if revolution is None else revolution.speed
    stated: dict[str, Any] = {name: digits(value) for name, value in c.stated.items()}
    stated["speed_rpm"] = round(60 * speed, 2)
    return replace(row, feed_mm_min=digits(c.feed / MM * 60), **stated)


def _parameters(rows: Sequence[Estimate]) -> dict[str, Parameter]:
    return {one.name: one.parameter for one in rows}


def _correlation(names: Sequence[str], covariance: Floats) -> Correlation:
    """Correlation of the unknowns but the phases."""
    shown = [k for k, name in enumerate(names) if not name.startswith("phase")]
    deviation = np.sqrt(np.diag(covariance))
    share = covariance / np.outer(deviation, deviation)
    values = np.round(share[np.ix_(shown, shown)], 3)
    return Correlation(
        names=tuple(names[k] for k in shown),
        values=tuple(tuple(v if np.isfinite(v) else None for v in row) for row in values.tolist()),
    )
