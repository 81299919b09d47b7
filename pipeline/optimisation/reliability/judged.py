"""Verdicts of the sub-models that figures rest on, and the spread that they leave.

Control, drives and cut are judged apart, on recordings that their fits did not see.  Times rest on
the control, following errors on the drives, loads on the cut.  The standard deviation of what rests
on one that

- passed is the root mean square of its errors on those recordings;
- failed is the greatest of them, at least ``certainty.failed``;
- was not judged is at least ``certainty.not_judged``.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.schema.cutting import MAGNITUDE
from pipeline.schema.drive import FOLLOWING
from pipeline.schema.verdict import UsedModel, UsedStatus, Verdict

FIGURES = {"control": "times", "drive": "following errors", "cutting": "peak loads"}
"""Sub-models that programs are simulated and optimised with, and the figures that rest on each."""
UNIDENTIFIED = {
    "control": "its values are those of conf/machine",
    "drive": "no following error is known",
    "cutting": "coefficients are others', with the spread of their source",
}
"""Substitutes for a sub-model that was not identified."""
GRAVITY: tuple[UsedStatus, ...] = (
    "failed", "not decided", "not judged", "not identified", "passed",
)  # fmt: skip
"""Statuses in the order in which a person has to read them."""
QUANTITY = {"control": "", "drive": FOLLOWING, "cutting": MAGNITUDE}
"""Beginning of the quantity whose errors count; of a control all that has limits."""


def used_models(
    verdicts: Mapping[str, Verdict | None], settings: ReliabilitySettings
) -> tuple[UsedModel, ...]:
    """Sub-models with their verdicts and spreads, the gravest first."""
    found = [
        _used(name, verdicts.get(name), settings) if name in verdicts
        else _without(name, settings)
        for name in FIGURES
    ]  # fmt: skip
    return tuple(sorted(found, key=lambda one: GRAVITY.index(one.status)))


def _used(name: str, verdict: Verdict | None, settings: ReliabilitySettings) -> UsedModel:
    errors = judged_errors(name, verdict)
    status = "not judged" if verdict is None else verdict.status
    missed = () if verdict is None else verdict.set_aside
    if verdict is not None and status != "passed":
        missed = verdict.missed
    least = settings.model if name == "cutting" else 0.0
    if verdict is None:
        missed = ("no verdict.json stands beside its model: run dvc repro to its end",)
    return UsedModel(
        submodel=name, figures=FIGURES[name], status=status,
        reason=missed[0] if missed else "", missed=len(missed),
        recordings=len({group for group, _ in _judged(name, verdict)}),
        error_percent=float(f"{100 * rms(errors):.4g}") if errors else None,
        spread_percent=float(f"{100 * judged_spread(status, errors, least, settings)[0]:.4g}"),
    )  # fmt: skip


def _without(name: str, settings: ReliabilitySettings) -> UsedModel:
    """A sub-model that was not identified; times of an assumed control count as not judged."""
    return UsedModel(
        submodel=name, figures=FIGURES[name], status="not identified", reason=UNIDENTIFIED[name],
        spread_percent=float(f"{100 * settings.not_judged:.4g}") if name == "control" else None,
    )  # fmt: skip


def judged_errors(name: str, verdict: Verdict | None) -> list[float]:
    """Relative errors of a sub-model on held-out recordings [1]: peak loads, else RMSE over RMS."""
    return [error for _, error in _judged(name, verdict)]


def _judged(name: str, verdict: Verdict | None) -> list[tuple[str, float]]:
    """Held-out recordings, one for each axis or channel that was judged, with the error [1]."""
    figure = "peak_percent" if name == "cutting" else "relative_percent"
    errors = [
        (score.group, getattr(score, figure))
        for score in (() if verdict is None else verdict.scores)
        if score.quantity.startswith(QUANTITY[name]) and score.group != "all"
        and score.role != "training" and not score.alone
        and (not score.regime if name == "cutting" else score.limits)
    ]  # fmt: skip
    return [(group, round(one, 2) / 100) for group, one in errors if one is not None]


def judged_spread(
    status: UsedStatus, errors: Sequence[float], least: float, settings: ReliabilitySettings
) -> tuple[float, str]:
    """Standard deviation that a verdict leaves [1], and its source.

    It is never less than ``least``, nor than the root mean square of ``errors``.
    """
    many = f"{len(errors)} recordings"
    known = [
        (least, "certainty.model"),
        (rms(errors), f"{many} that the coefficients were not found from"),
    ]
    if status == "failed":
        known += [
            (settings.failed, "certainty.failed: its verdict failed"),
            (max(map(abs, errors), default=0.0), f"its verdict failed: greatest error of {many}"),
        ]
    elif status != "passed":
        known.append((settings.not_judged, "certainty.not_judged: it was not judged"))
    return max(known, key=lambda one: one[0])


def rms(errors: Sequence[float]) -> float:
    """Root mean square; 0 without values."""
    return float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else 0.0
