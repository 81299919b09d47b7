"""What an identified cut says of its certainty: intervals, correlations, errors of judged peaks.

Documents come from files, so that nothing of their form is taken for granted: what is missing or of
another form is not known.
"""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.twin.cut_coefficients import COEFFICIENTS

Floats = NDArray[np.float64]


def interval(
    document: Mapping[str, Any], name: str, *, upper: bool = False
) -> tuple[float, float] | tuple[None, None]:
    """Value and half of the 95 % interval of a parameter of cutting.json, in its unit.

    None where it was not determined; ``upper`` takes the part of the interval above the value.
    """
    parameter = _under(document, "parameters", name)
    if not isinstance(parameter, dict) or not parameter.get("determined", True):
        return None, None
    value, ends = _number(parameter.get("value")), parameter.get("interval_95")
    if value is None or not isinstance(ends, list) or len(ends) != 2:
        return None, None
    low, high = _number(ends[0]), _number(ends[1])
    if low is None or high is None:
        return None, None
    return value, high - value if upper else (high - low) / 2


def fitted_coefficients(document: Mapping[str, Any]) -> Floats:
    """The six coefficients as the fit took them, determined or not, SI; 0 where nothing says."""
    values = _under(document, "prediction", "values")
    if not isinstance(values, list) or len(values) < len(COEFFICIENTS):
        return np.zeros(len(COEFFICIENTS))
    found = [_number(value) for value in values[: len(COEFFICIENTS)]]
    return np.array([0.0 if value is None else value for value in found])


def correlation(document: Mapping[str, Any], known: Sequence[str]) -> Floats:
    """Of the six coefficients; only those of ``known`` are correlated.  Shape (6, 6)."""
    found = np.eye(len(COEFFICIENTS))
    names, matrix = (_under(document, "correlation", key) for key in ("names", "matrix"))
    if not isinstance(names, list) or not isinstance(matrix, list):
        return found
    try:
        table = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        return found
    if table.shape != (len(names), len(names)) or not np.isfinite(table).all():
        return found
    rows = [k for k, name in enumerate(COEFFICIENTS) if name in names and name in known]
    place = [names.index(COEFFICIENTS[k]) for k in rows]
    found[np.ix_(rows, rows)] = table[np.ix_(place, place)]
    np.fill_diagonal(found, 1.0)
    return found


def root(matrix: Floats) -> Floats:
    """R with R R^T a correlation, which rounding may have made slightly indefinite."""
    values, vectors = np.linalg.eigh(0.5 * (matrix + matrix.T))
    found: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
    length = np.sqrt((found**2).sum(axis=1, keepdims=True))
    return found / np.where(length > 0, length, 1.0)


def model_spread(document: Mapping[str, Any], least: float) -> tuple[float, str]:
    """Standard deviation of the model's peak loads [1], at least ``least``, and where it is from.

    It is the root mean square of the errors of the peaks of recordings that the coefficients were
    not found from, in cutting_validation.json.
    """
    rows = document.get("recordings")
    judged = [
        error for row in (rows if isinstance(rows, list) else [])
        if _under(row, "role") == "judged"
        and (error := _number(_under(row, "components", "resultant", "peak_error_percent")))
        is not None
    ]  # fmt: skip
    found = float(np.sqrt(np.mean(np.square(judged)))) / 100 if judged else 0.0
    if found > least:
        return found, f"{len(judged)} recordings that the coefficients were not found from"
    return least, "certainty.model"


def _under(document: Any, *keys: str) -> Any:
    """What stands under keys; None where a part of the way is missing."""
    for key in keys:
        document = document.get(key) if isinstance(document, dict) else None
    return document


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        return None
    return float(value)
