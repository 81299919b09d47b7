"""Recordings against the force model as its page shows them: errors, limits, curves."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import (
    CHANNEL_FORCE,
    CHANNELS,
    HIGHEST,
    LOWEST,
    MAGNITUDE,
    MEAN,
    OTHERS,
    PEAK,
    PLAIN,
    PLANE,
    CutRecording,
    CuttingModel,
)
from pipeline.schema.predictions import BASELINE
from pipeline.schema.verdict import Figures, Score, Verdict
from pipeline.submodels.contract import Shown

ERRORS = ("rms", "peak", "mean")
"""Errors of the force in the plane: of its waveform, of its largest value, of its mean."""
ALIKE = 1e-3
"""Relative difference of two errors below which two predictions are equally good [1]."""
SLIGHT = 0.1
"""Share of its RMS below which a mean is no measure of its own error [1]."""
Of = Literal["model", "mechanics", "plain"]
Status = Literal["passed", "failed", "unknown"]


@dataclass(frozen=True, kw_only=True)
class HeldLevel:
    """Half of a level's 90 % interval over the predicted level [%], and whether it holds it."""

    half_percent: float
    held: bool


@dataclass(frozen=True, kw_only=True)
class CutRun:
    """One recording compared with the force model.

    Parameters
    ----------
    row : CutRecording
        Its role and conditions.
    waveform, magnitude : Score
        Of the force in the plane: its waveform, and its magnitude.
    fitted_on : tuple of str
        Recordings of the fit that predicts it, where that is not the model's own.
    levels : mapping of str to HeldLevel
        Of ``peak`` and ``mean``, where there are intervals.
    outside : str
        Conditions that are outside of those learnt, in words.
    reason : str
        Why it failed, or was not compared.
    """

    row: CutRecording
    waveform: Score
    magnitude: Score
    fitted_on: tuple[str, ...] = ()
    levels: Mapping[str, HeldLevel] = field(default_factory=dict)
    outside: str = ""

    @property
    def recording(self) -> str:
        """Name of the raw file."""
        return self.row.recording

    @property
    def is_training(self) -> bool:
        """Whether the fit that predicts it was made on it."""
        return self.waveform.role == "training" and not self.fitted_on

    @property
    def status(self) -> Status:
        """Whether limits are kept; ``unknown`` where it does not count."""
        if self.fitted_on:
            return "failed" if any(self.beyond(kind) for kind in ERRORS) else "passed"
        words = {self.waveform.status, self.magnitude.status}
        return "failed" if "failed" in words else "passed" if words == {"passed"} else "unknown"

    @property
    def reason(self) -> str:
        """Each limit that is not kept, or why it was not judged."""
        return "; ".join((*self.waveform.reasons, *self.magnitude.reasons))

    def error(self, kind: str, of: Of = "model") -> float | None:
        """Error [%] of the force in the plane, with its sign; None where there is none."""
        score = self.waveform if kind == "rms" else self.magnitude
        name = {"rms": "relative_percent", "peak": "peak_percent", "mean": "mean_percent"}[kind]
        figures: Figures | None = score if of == "model" else score.baselines.get(of)
        value: float | None = None if figures is None else getattr(figures, name)
        return value

    def size(self, kind: str, of: Of = "model") -> float | None:
        """Size of an error [%]."""
        error = self.error(kind, of)
        return None if error is None else abs(error)

    def limit(self, kind: str) -> float | None:
        """Largest error that passes [%]."""
        if kind == "rms":
            return self.waveform.limits.get("relative_percent")
        return self.magnitude.limits.get(f"{kind}_percent")

    def beyond(self, kind: str) -> bool:
        """Whether an error of what was not learnt from is above its limit."""
        error, limit = self.size(kind), self.limit(kind)
        return not self.is_training and error is not None and limit is not None and error > limit

    def plain_better(self, kind: str = "rms") -> bool:
        """Whether the plain guess comes closer than the model."""
        model, plain = self.size(kind), self.size(kind, "plain")
        return model is not None and plain is not None and plain < model * (1 - ALIKE)


@dataclass(frozen=True, kw_only=True, eq=False)
class CutTrace:
    """One mean revolution: ``angle`` [deg] (T,) ascending, forces [N] (T,) by curve and channel.

    The ends of what 95 % of the revolutions show have angles of their own.
    """

    recording: str
    angle: Floats
    measured: Mapping[str, Floats]
    modelled: Mapping[str, Floats]
    plain: Mapping[str, Floats]
    scatter_angle: Floats
    low: Mapping[str, Floats]
    high: Mapping[str, Floats]

    @property
    def channels(self) -> list[str]:
        """Channels with a measured and a modelled curve."""
        return [c for c in CHANNELS if c in self.measured and c in self.modelled]


@dataclass(frozen=True, kw_only=True)
class Component:
    """Force of one component: peak, mean and RMS [N] measured and modelled, errors [%]."""

    measured: Mapping[str, float]
    modelled: Mapping[str, float]
    errors: Mapping[str, float | None]
    plain: Mapping[str, float | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingFacts:
    """Everything that cutting's page is made of."""

    shown: Shown[CuttingModel]
    runs: list[CutRun]
    cross: list[CutRun]

    @property
    def model(self) -> CuttingModel | None:
        """The identified model."""
        return self.shown.model

    @property
    def verdict(self) -> Verdict | None:
        """Its judgement."""
        return self.shown.verdict

    @property
    def has_coefficients(self) -> bool:
        """Whether coefficients were identified."""
        return self.model is not None and bool(self.model.coefficients)

    @property
    def undetermined(self) -> list[str]:
        """Names of the parameters that the recordings do not determine."""
        rows = {} if self.model is None else self.model.coefficients
        return [name for name, p in rows.items() if not p.determined]

    @property
    def judged(self) -> list[CutRun]:
        """Those that count: nothing was learnt from them, and they were judged."""
        return [run for run in self.runs if run.status != "unknown"]

    @property
    def telling(self) -> list[CutRun]:
        """Predictions of what was not learnt from: the judged, or the cross ones without any."""
        return self.judged or [run for run in self.cross if run.size("rms") is not None]

    def limit(self, kind: str) -> float | None:
        """Largest error that passes [%]; ``kind`` of :data:`ERRORS`."""
        return next((x for run in (*self.runs, *self.cross) if (x := run.limit(kind))), None)


def cutting_facts(shown: Shown[CuttingModel]) -> CuttingFacts:
    """Recordings of the verdict, the judged first, then by name."""
    model, verdict = shown.model, shown.verdict
    runs: list[CutRun] = []
    cross: list[CutRun] = []
    if verdict is not None:
        rows = {} if model is None else {one.recording: one for one in model.recordings}
        folds = () if model is None else model.folds
        others = {name: fold.fitted_on for fold in folds for name in fold.left_out}
        second = {(s.group, s.regime): s for s in verdict.of(MAGNITUDE)}
        for score in verdict.of(PLANE):
            magnitude = second.get((score.group, score.regime))
            if score.group == "all" or magnitude is None:
                continue
            role = "training" if score.role == "training" else "judged"
            row = rows.get(score.group, CutRecording(recording=score.group, role=role))
            levels = _levels_held(shown.predictions, score.group, score.regime)
            if score.regime == OTHERS:
                fitted_on = others.get(score.group, ())
                cross.append(
                    CutRun(
                        row=row,
                        waveform=score,
                        magnitude=magnitude,
                        fitted_on=fitted_on,
                        levels=levels,
                    )
                )
            else:
                runs.append(
                    CutRun(
                        row=row,
                        waveform=score,
                        magnitude=magnitude,
                        levels=levels,
                        outside=_outside(verdict, score.group),
                    )
                )
    runs.sort(key=lambda run: (run.status == "unknown", run.recording))
    cross.sort(key=lambda run: run.recording)
    return CuttingFacts(shown=shown, runs=runs, cross=cross)


def _levels_held(
    predictions: pd.DataFrame | None, recording: str, regime: str
) -> dict[str, HeldLevel]:
    """Intervals of peak and mean of one recording; empty without any."""
    if predictions is None or "low" not in predictions:
        return {}
    mine = predictions[(predictions["case"] == recording) & (predictions["regime"] == regime)]
    found = {}
    for kind, quantity in (("peak", PEAK), ("mean", MEAN)):
        rows = mine[mine["quantity"] == quantity]
        if len(rows) != 1 or not rows["predicted"].iloc[0] > 0:
            continue
        measured, predicted, low, high = (
            rows[["measured", "predicted", "low", "high"]].to_numpy(float)[0].tolist()
        )
        found[kind] = HeldLevel(
            half_percent=50 * (high - low) / predicted, held=low <= measured <= high
        )
    return found


def _outside(verdict: Verdict, recording: str) -> str:
    """Conditions of a recording that nothing was learnt at, with what was learnt."""
    return "; ".join(
        f"{one.condition} {one.value if isinstance(one.value, str) else f'{one.value:g}'} "
        f"{one.unit} (learnt: {one.learnt})"
        for one in verdict.outside if one.case == recording
    )  # fmt: skip


def worst_run(runs: list[CutRun], kind: str = "rms") -> CutRun | None:
    """The run that is predicted worst; None without any."""
    known = [run for run in runs if run.size(kind) is not None]
    return max(known, key=lambda run: run.size(kind) or 0.0, default=None)


def best_run(runs: list[CutRun]) -> CutRun | None:
    """The run that is predicted best; None without any."""
    known = [run for run in runs if run.size("rms") is not None]
    return min(known, key=lambda run: run.size("rms") or 0.0, default=None)


def cut_trace(predictions: pd.DataFrame | None, recording: str) -> CutTrace | None:
    """Curves of a recording; None where it has none."""
    if predictions is None or not len(predictions):
        return None
    rows = predictions[predictions["case"] == recording]
    curves: dict[str, dict[str, Floats]] = {}
    angle = scatter = np.zeros(0)
    columns = (("measured", "", "measured"), ("modelled", "", "predicted"),
               ("plain", "", BASELINE + PLAIN), ("low", LOWEST, "measured"),
               ("high", HIGHEST, "measured"))  # fmt: skip
    for channel in CHANNELS:
        of = rows[rows["quantity"] == CHANNEL_FORCE + channel].sort_values("t")
        for kind, regime, column in columns:
            part = of[of["regime"] == regime]
            if column not in part.columns or not np.isfinite(part[column]).any():
                continue
            curves.setdefault(kind, {})[channel] = part[column].to_numpy(float)
            if regime:
                scatter = part["t"].to_numpy(float)
            else:
                angle = part["t"].to_numpy(float)
    empty: dict[str, Floats] = {}
    trace = CutTrace(
        recording=recording, angle=angle, scatter_angle=scatter,
        **{kind: curves.get(kind, empty) for kind, *_ in columns},
    )  # fmt: skip
    return trace if trace.channels else None


def components(
    predictions: pd.DataFrame | None, recording: str, regime: str
) -> dict[str, Component]:
    """Each channel and the resultant in the plane of one recording, as one fit predicts it."""
    if predictions is None or not len(predictions):
        return {}
    rows = predictions[(predictions["case"] == recording) & (predictions["regime"] == regime)]
    result = {}
    for name in (*CHANNELS, "resultant"):
        of = rows[rows["quantity"] == (MAGNITUDE if name == "resultant" else CHANNEL_FORCE + name)]
        # the waveform's error in the plane is that of the vector
        wave = rows[rows["quantity"] == PLANE] if name == "resultant" else of
        if len(of):
            result[name] = _component(of, wave)
    return result


def _component(of: pd.DataFrame, wave: pd.DataFrame) -> Component:
    measured = of["measured"].to_numpy(float)
    levels = _levels(measured)
    modelled = _levels(of["predicted"].to_numpy(float))
    plain = _levels(of[BASELINE + PLAIN].to_numpy(float))
    strength = _rms(wave["measured"].to_numpy(float))

    def errors(column: str, other: Mapping[str, float]) -> dict[str, float | None]:
        if not strength > 0:
            return dict.fromkeys(ERRORS)
        error = _rms((wave[column] - wave["measured"]).to_numpy(float))
        slight = abs(levels["mean"]) <= SLIGHT * levels["rms"]
        return {
            "rms": 100 * error / strength,
            "peak": 100 * (other["peak"] - levels["peak"]) / levels["peak"],
            "mean": None if slight else 100 * (other["mean"] - levels["mean"])
            / abs(levels["mean"]),
        }  # fmt: skip

    return Component(
        measured=levels, modelled=modelled, errors=errors("predicted", modelled),
        plain=errors(BASELINE + PLAIN, plain),
    )  # fmt: skip


def _levels(force: Floats) -> dict[str, float]:
    return {"peak": float(np.abs(force).max()), "mean": float(force.mean()), "rms": _rms(force)}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
