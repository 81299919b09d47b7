"""Errors of methods side by side: RMSE, largest error, correlation, relative error with a floor."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.predictions import BASELINE
from pipeline.submodels.deformation.methods import METHODS
from pipeline.submodels.deformation.methods import PERSISTENCE as PERSISTENCE
from pipeline.submodels.deformation.model import MAPE_FLOOR_UM, MethodScore

if TYPE_CHECKING:
    pass

GROWTH = "growth"
"""Name of the quantity."""


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of one prediction."""

    rmse: float
    largest: float
    """[um]."""
    r: float | None
    """Correlation [1]."""
    mape: float
    """Mape [%], growth below the floor counting as the floor."""


def errors_of(predicted: Floats, measured: Floats) -> Errors:
    """Errors where both have a value.

    ValueError without samples.

    Examples
    --------
    >>> found = errors_of(np.array([11.0, 20.0]), np.array([10.0, 20.0]))
    >>> found.largest, found.mape
    (1.0, 5.0)
    """
    known = np.isfinite(predicted) & np.isfinite(measured)
    if not known.any():
        raise ValueError("no sample of growth is measured and predicted: record growth")
    predicted, measured = predicted[known], measured[known]
    error = predicted - measured
    varies = min(np.ptp(predicted), np.ptp(measured)) > 0
    share = np.abs(error) / np.maximum(np.abs(measured), MAPE_FLOOR_UM)
    return Errors(
        rmse=_rounded(np.sqrt(np.mean(error**2))),
        largest=_rounded(np.abs(error).max()),
        r=_rounded(np.corrcoef(predicted, measured)[0, 1]) if varies else None,
        mape=_rounded(100 * share.mean()),
    )


def _rounded(value: Any) -> float:
    return float(f"{float(value):.4g}")


def method_score(name: str, by_seed: Floats, measured: Floats) -> MethodScore:
    """Score of a method from the predictions of its seeds, shape (seeds, N)."""
    whole = errors_of(by_seed.mean(axis=0), measured)
    single = [errors_of(one, measured).rmse for one in by_seed]
    return MethodScore(
        label=METHODS[name].label, seeds=len(by_seed), rmse_um=whole.rmse, max_um=whole.largest,
        r=whole.r, mape_percent=whole.mape, seed_rmse_um=(min(single), max(single)),
    )  # fmt: skip


def columns_of(name: str, by_seed: Floats) -> dict[str, Floats]:
    """Columns of the predictions of a method: its mean, and each seed where there are several."""
    found = {f"{BASELINE}{name}": by_seed.mean(axis=0)}
    if len(by_seed) > 1:
        found |= {f"{BASELINE}{name} {k + 1}": one for k, one in enumerate(by_seed)}
    return found
