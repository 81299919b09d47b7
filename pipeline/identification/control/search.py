"""Least squares of some of a control's parameters, on the scale that each is sought on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.control.free import Free

Floats = NDArray[np.float64]
Residuals = Callable[[Floats], Floats]


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """How an optimum is sought.

    Parameters
    ----------
    loose_s : float
        Waiting times are sought about their start as loosely as this [s]; rates within a factor e.
    step : float
        Of the differences that the Jacobian is made of [1 on the logarithmic scale, s].
    evaluations : int
        Jacobians at most.
    """

    loose_s: float = 5.0
    step: float = 0.02
    evaluations: int = 60

    def __post_init__(self) -> None:
        for name in ("loose_s", "step", "evaluations"):
            check_positive(f"control_fit.{name}", getattr(self, name))


def check_positive(name: str, value: float) -> None:
    """Refuse a setting that is not positive.

    Raises
    ------
    ValueError
        With its name and value.
    """
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} = {value} must be finite and positive")


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """Where a search ended.

    Parameters
    ----------
    values : ndarray, shape (D,)
        Of all parameters, in their units.
    jacobian : ndarray, shape (N, S)
        Of the residuals by the S parameters that were sought, on the scale of the search [1].
    residuals : ndarray, shape (N,)
        In units of the scale beyond which they count linearly [1].
    """

    values: Floats
    jacobian: Floats
    residuals: Floats


def optimum(
    residuals: Residuals, free: Sequence[Free], values: Floats, active: NDArray[np.bool_],
    scale_s: float, settings: SearchSettings,
) -> Optimum:  # fmt: skip
    """Least squares (soft L1) of the ``active`` parameters; the others stay as in ``values``.

    A weak pull towards where the search began decides what the residuals leave open; it has no part
    in the Jacobian and the residuals that are returned.

    Parameters
    ----------
    residuals : callable
        Residuals, shape (N,) [s], of all parameters, shape (D,), in their units.
    free : sequence of Free
        The D parameters.
    values : ndarray, shape (D,)
        Where the search begins.
    active : ndarray of bool, shape (D,)
        Which are sought.
    scale_s : float
        Residuals above count linearly [s].
    settings : SearchSettings
        How it is sought.
    """
    from scipy.optimize import least_squares

    sought = [one for one, used in zip(free, active, strict=True) if used]
    low, high = np.array([one.bounds for one in sought]).T
    begin = np.clip([one.coordinate(one.start) for one in sought], low, high)
    pull = np.array([1.0 if one.log_scale else 1 / settings.loose_s for one in sought])

    def full(x: Floats) -> Floats:
        out = values.copy()
        out[active] = [one.value(v) for one, v in zip(sought, x.tolist(), strict=True)]
        return out

    def scaled(x: Floats) -> Floats:
        return residuals(full(x)) / scale_s

    def jacobian(x: Floats) -> Floats:
        return _differences(scaled, x, low, high, settings.step)

    def pulled(x: Floats) -> Floats:
        return np.concatenate([scaled(x), pull * (x - begin)])

    def pulled_jacobian(x: Floats) -> Floats:
        return np.vstack([jacobian(x), np.diag(pull)])

    x = [one.coordinate(v) for one, v in zip(sought, values[active].tolist(), strict=True)]
    found = least_squares(
        pulled, np.clip(x, low, high), jac=pulled_jacobian, bounds=(low, high), loss="soft_l1",
        max_nfev=settings.evaluations,
    ).x  # fmt: skip
    return Optimum(values=full(found), jacobian=jacobian(found), residuals=scaled(found))


def _differences(function: Residuals, x: Floats, low: Floats, high: Floats, step: float) -> Floats:
    """Jacobian of ``function`` at ``x`` from differences within the bounds; shape (N, D)."""
    columns = []
    for k in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[k] = min(x[k] + step, high[k])
        behind[k] = max(x[k] - step, low[k])
        columns.append((function(ahead) - function(behind)) / (ahead[k] - behind[k]))
    return np.column_stack(columns)
