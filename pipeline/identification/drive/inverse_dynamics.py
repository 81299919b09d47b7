"""Mass, friction and offset from filtered motion and force: bounded robust least squares.

The vector of parameters is that of the table of regressors, then F_s - F_c and ln v_s of the
positive and of the negative direction.  For each pair of v_s of the table the rest is linear; the
best pairs are the starts of a bounded search over all.  Rows that lie far from the rest count less
(Huber's weights): reversals, cogs and cuts that nobody marked are no part of the model.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.regressors import Regressors

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

DIPS = ("dip_positive", "dip_negative")
LOGS = ("log_velocity_positive", "log_velocity_negative")
HUBER = 2.0
"""Residuals beyond as many standard deviations count less."""
ROUNDS = 4
STARTS = 3
COARSE = 4
"""Every such velocity of the table is tried for a start."""
RIDGE = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Dynamics:
    """Where a search ended.

    Parameters
    ----------
    names : tuple of str
        Of the D parameters.
    values : ndarray, shape (D,)
        In SI; 0 of those that were not sought.
    sought : ndarray of bool, shape (D,)
        Which were.
    weights : ndarray, shape (N,)
        Of the rows, at most 1.
    residuals : ndarray, shape (N,)
        Measured less modelled force [N].
    evaluations : int
        How often the model was evaluated on all rows.
    """

    names: tuple[str, ...]
    values: Floats
    sought: Flags
    weights: Floats
    residuals: Floats
    evaluations: int

    @property
    def cost(self) -> float:
        """Weighted sum of squares [N^2]."""
        return float(self.weights @ self.residuals**2)

    def value(self, name: str) -> float:
        """Of the parameter called ``name``; 0 when the table has none such."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0


def parameter_names(rows: Regressors) -> tuple[str, ...]:
    """Names of the D parameters."""
    return rows.names + DIPS + LOGS


def modelled_force(rows: Regressors, values: Floats) -> Floats:
    """Force of the motor by the model [N]; shape (N,)."""
    k = len(rows.names)
    force: Floats = rows.linear @ values[:k] + rows.dip_columns(values[k + 2 :]) @ values[k : k + 2]
    return force


def jacobian(rows: Regressors, values: Floats) -> Floats:
    """Derivatives of the modelled force by the parameters; shape (N, D)."""
    k = len(rows.names)
    logs = values[k + 2 :]
    slopes = rows.dip_slopes(logs) * values[k : k + 2]
    return np.hstack([rows.linear, rows.dip_columns(logs), slopes])


def bounds(rows: Regressors) -> tuple[Floats, Floats]:
    """Least and greatest value of each parameter, wide of anything the rows can mean."""
    top = float(np.abs(rows.force).max())
    rates = np.abs(rows.linear)
    low, high = [], []
    for name, column in zip(rows.names, rates.T, strict=True):
        most = 10 * top / max(float(np.percentile(column, 99)), 1e-12)
        least = {"mass": 1e-4 * most, "viscous_positive": 0.0, "viscous_negative": 0.0}
        low.append(least.get(name, -most))
        high.append(most)
    ends = np.log(rows.stribeck[[0, -1]])
    return (
        np.array([*low, 0.0, 0.0, ends[0], ends[0]]),
        np.array([*high, 2 * top, 2 * top, ends[1], ends[1]]),
    )


def all_sought(rows: Regressors) -> Flags:
    """Every parameter that some row depends on; shape (D,)."""
    felt = np.abs(rows.linear).max(axis=0) > 0
    ways = np.array([np.any(rows.velocity > 0), np.any(rows.velocity < 0)])
    for way, sign in enumerate(("positive", "negative")):
        for name in (f"viscous_{sign}", f"level_{sign}"):
            felt[rows.names.index(name)] &= ways[way]
    return np.r_[felt, ways, ways]


def least_squares_dynamics(
    rows: Regressors, sought: Flags, shares: Floats | None = None
) -> Dynamics:
    """Bounded least squares with Huber's weights, from several starts.

    Parameters
    ----------
    rows : Regressors
        The table.
    sought : ndarray of bool, shape (D,)
        Parameters that are sought; others are 0.
    shares : ndarray, shape (N,), optional
        Weights of the rows, before Huber's.
    """
    weights = np.ones(len(rows.force)) if shares is None else shares
    tried = [_search(rows, sought, weights, one) for one in profile_starts(rows, sought, weights)]
    evaluations = sum(one.evaluations for one in tried)
    found = min(tried, key=lambda one: one.cost)
    for _ in range(ROUNDS):
        found = _search(rows, sought, weights * huber_weights(found.residuals), found.values)
        evaluations += found.evaluations
    return replace(found, evaluations=evaluations)


def huber_weights(residuals: Floats) -> Floats:
    """Weight of each row by Huber: 1 up to ``HUBER`` standard deviations, then falling; (N,)."""
    scale = 1.4826 * float(np.median(np.abs(residuals)))
    if scale == 0:
        return np.ones(len(residuals))
    weights: Floats = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residuals), 1e-300))
    return weights


def _search(rows: Regressors, sought: Flags, weights: Floats, start: Floats) -> Dynamics:
    """Bounded search over the parameters that are sought."""
    from scipy.optimize import least_squares

    low, high = bounds(rows)
    root = np.sqrt(weights)
    values = np.where(sought, np.clip(start, low, high), 0.0)
    # a dip of exactly 0 feels no v_s: begin inside
    margin = 1e-6 * (high - low)
    begin = np.clip(values[sought], (low + margin)[sought], (high - margin)[sought])

    def full(x: Floats) -> Floats:
        whole = values.copy()
        whole[sought] = x
        return whole

    def misses(x: Floats) -> Floats:
        weighted: Floats = root * (modelled_force(rows, full(x)) - rows.force)
        return weighted

    def slopes(x: Floats) -> Floats:
        weighted: Floats = root[:, None] * jacobian(rows, full(x))[:, sought]
        return weighted

    answer = least_squares(
        misses, begin, slopes, bounds=(low[sought], high[sought]), x_scale="jac",
        ftol=1e-10, xtol=1e-10, gtol=1e-12, max_nfev=60,
    )  # fmt: skip
    best = full(answer.x)
    return Dynamics(
        names=parameter_names(rows), values=best, sought=sought, weights=weights,
        residuals=rows.force - modelled_force(rows, best), evaluations=int(answer.nfev),
    )  # fmt: skip


def profile_starts(rows: Regressors, sought: Flags, weights: Floats) -> list[Floats]:
    """The best pairs of v_s on a coarse grid, each with the linear optimum at it.

    Directions whose dip is not sought have no place in the grid.
    """
    k, size = len(rows.names), len(rows.names) + 4
    linear = np.flatnonzero(sought[:k])
    ways = [way for way in range(2) if sought[k + way]]
    picks = np.arange(0, len(rows.stribeck), COARSE)
    columns = [rows.linear[:, linear], *(rows.dips[way][:, picks] for way in ways)]
    wide = np.hstack(columns)
    moments, right = wide.T @ (weights[:, None] * wide), wide.T @ (weights * rows.force)
    grids = np.meshgrid(*[np.arange(len(picks))] * len(ways), indexing="ij")
    choice = np.stack([g.ravel() for g in grids], axis=1) if ways else np.zeros((1, 0), np.int64)
    offsets = len(linear) + len(picks) * np.arange(len(ways))
    index = np.hstack([np.tile(np.arange(len(linear)), (len(choice), 1)), choice + offsets])
    system = moments[index[:, :, None], index[:, None, :]]
    scale = np.sqrt(np.maximum(np.einsum("pii->pi", system), 1e-300))
    system = system / (scale[:, :, None] * scale[:, None, :]) + RIDGE * np.eye(index.shape[1])
    answer = np.linalg.solve(system, (right[index] / scale)[:, :, None])[:, :, 0] / scale
    gain = np.einsum("pi,pi->p", right[index], answer)
    if ways:
        gain = np.where((answer[:, len(linear) :] > 0).all(axis=1), gain, gain * 0.5)
    starts = []
    for p in _apart(gain, choice):
        start = np.zeros(size)
        start[linear] = answer[p, : len(linear)]
        for place, way in enumerate(ways):
            start[k + way] = answer[p, len(linear) + place]
            start[k + 2 + way] = np.log(rows.stribeck[picks[choice[p, place]]])
        starts.append(start)
    return starts


def _apart(gain: Floats, choice: NDArray[np.int64]) -> list[int]:
    """The best points of a grid that are no neighbours; at most ``STARTS``."""
    chosen: list[int] = []
    for p in np.argsort(-gain, kind="stable").tolist():
        if all(np.abs(choice[p] - choice[q]).max(initial=0) > 1 for q in chosen):
            chosen.append(p)
        if len(chosen) == STARTS or not choice.shape[1]:
            break
    return chosen
