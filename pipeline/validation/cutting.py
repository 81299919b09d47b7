"""Validation of an identified cut on recordings that its coefficients were not found from.

Judged is the force in the plane: its peak, its mean and the RMS error of the waveform over the mean
revolution, of the whole prediction: mechanics and, where the conditions are trained ones, what
mechanics leave over.  Each channel, mechanics alone, and a plain model (the coefficients of the
mean forces, neither helix nor runout nor modes) stand beside it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from typing import Any

import pyarrow as pa

from pipeline.identification.cutting.document import conditions_row
from pipeline.identification.cutting.identify import cut_beside
from pipeline.identification.cutting.model import CutModel, restored
from pipeline.identification.cutting.records import (
    CuttingFitSettings,
    CuttingKnown,
    CuttingRecording,
)
from pipeline.signals.ingest import MachineIdentity
from pipeline.validation.cutting_errors import Components, components, over_limits
from pipeline.validation.cutting_traces import traces_of, traces_table

PLAIN = "coefficients of the mean forces; no helix, runout or mode of a channel"


@dataclass(frozen=True, kw_only=True)
class CuttingLimits:
    """What a prediction of cutting forces may be off.

    Parameters
    ----------
    peak_percent, mean_percent : float
        Of the force in the plane, of its own peak and mean over a mean revolution [%].
    rms_percent : float
        RMS error of the waveform in the plane, of the RMS force [%].
    """

    peak_percent: float = 10.0
    mean_percent: float = 10.0
    rms_percent: float = 20.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (isfinite(value) and value > 0):
                raise ValueError(
                    f"cutting_limits.{item.name} = {value} must be finite and positive"
                )


def cutting_verdict(
    document: Mapping[str, Any],
    recordings: Sequence[CuttingRecording],
    identity: MachineIdentity,
    known: CuttingKnown,
    settings: CuttingFitSettings,
    limits: CuttingLimits,
) -> tuple[dict[str, Any], pa.Table]:
    """The content of ``cutting_validation.json`` and of ``cutting_traces.parquet``.

    Parameters
    ----------
    document : mapping
        The content of ``cutting.json``.
    recordings : sequence of CuttingRecording
        All of the machine; those that it learnt from are compared and not judged.
    identity : MachineIdentity
        Of the machine.
    known : CuttingKnown
        How the dynamometer stands.
    settings : CuttingFitSettings
        What a zero is worth.
    limits : CuttingLimits
        What the others are judged by.
    """
    shown = [one for one in recordings if one.revolution is not None]
    rows, cross, traces = [], [], []
    if document["prediction"] is not None:
        model, plain = restored(document["prediction"]), restored(document["plain"])
        judge = _Judge(known=known, settings=settings, limits=limits, plain=plain)
        learnt = set(document["found_from"])
        rows = [judge.row(one, model, one.name in learnt) for one in shown]
        without = {
            name: restored(fold["prediction"])
            for fold in document["folds"]
            for name in fold["left_out"]
        }
        traces = [
            traces_of(
                one, judge.beside(one, model), judge.beside(one, plain),
                judge.beside(one, without[one.name]) if one.name in without else None, known,
            )
            for one in shown
        ]  # fmt: skip
        cross = [
            {**judge.row(one, restored(fold["prediction"]), False), "from": fold["from"]}
            for fold in document["folds"]
            for one in shown
            if one.name in fold["left_out"]
        ]
    told = [row["status"] for row in rows if row["status"] != "not judged"]
    return {
        "model": "cutting",
        "machine": identity.name,
        "origin": identity.origin,
        "passed": all(status == "passed" for status in told) if told else None,
        "reason": "" if told else _why_not(document, recordings),
        "limits": {item.name: getattr(limits, item.name) for item in fields(limits)},
        "recordings": rows,
        "cross": cross,
    }, traces_table(traces)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judge:
    """Compares recordings with predictions of them."""

    known: CuttingKnown
    settings: CuttingFitSettings
    limits: CuttingLimits
    plain: CutModel

    def beside(
        self, recording: CuttingRecording, model: CutModel, *, mechanics_only: bool = False
    ) -> Any:
        """Predicted harmonics of a recording, in its phase."""
        cut = cut_beside(recording, self.settings)
        return model.beside(cut, mechanics_only=mechanics_only)

    def row(self, recording: CuttingRecording, model: CutModel, learnt: bool) -> dict[str, Any]:
        """What is said of one recording."""
        cut = cut_beside(recording, self.settings)
        over = model.remainder(cut.conditions)
        found = self._components(recording, model)
        status, reason = self._status(found, learnt)
        return {
            "recording": recording.name,
            "role": recording.role,
            "conditions": conditions_row(recording),
            "how": "mechanics" if over is None else "mechanics and what they leave over",
            "components": found,
            "mechanics": {"components": self._components(recording, model, mechanics_only=True)},
            "plain": {"what": PLAIN, "components": self._components(recording, self.plain)},
            "status": status,
            "reason": reason,
        }

    def _components(
        self, recording: CuttingRecording, model: CutModel, *, mechanics_only: bool = False
    ) -> Components:
        _, revolution = recording.cut
        predicted = self.beside(recording, model, mechanics_only=mechanics_only)
        return components(revolution.lines, predicted, self.known.dynamometer)

    def _status(self, found: Components, learnt: bool) -> tuple[str, str]:
        if learnt:
            return "not judged", "the coefficients were found from it"
        over = over_limits(
            found["resultant"], peak=self.limits.peak_percent, mean=self.limits.mean_percent,
            rms=self.limits.rms_percent,
        )  # fmt: skip
        return ("failed" if over else "passed"), "; ".join(over)


def _why_not(document: Mapping[str, Any], recordings: Sequence[CuttingRecording]) -> str:
    if document["prediction"] is None:
        return str(document["reason"])
    left = [f"{one.name}: {one.reason}" for one in recordings if one.revolution is None]
    said = f" ({'; '.join(left)})" if left else ""
    return (
        f"the coefficients were found from all recordings of use{said}: leave some out of "
        "cutting_records.training, or record others"
    )


def cutting_metrics(document: Mapping[str, Any]) -> dict[str, float | int | str]:
    """Key figures, flat, for ``dvc metrics``."""
    verdict = {True: "passed", False: "failed"}.get(document["passed"], "not judged")
    judged = [row for row in document["recordings"] if row["status"] != "not judged"]
    found: dict[str, float | int | str] = {"verdict": verdict, "recordings_judged": len(judged)}
    for rows, part in ((judged, "judged"), (document["cross"], "cross")):
        for figure in ("peak_error_percent", "mean_error_percent", "rms_error_percent"):
            errors = [abs(row["components"]["resultant"][figure]) for row in rows]
            if errors:
                found[f"{part}.worst_{figure}"] = max(errors)
    return found
