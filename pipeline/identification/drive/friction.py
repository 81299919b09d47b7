"""Stribeck's curve through points of constant speed (Sim2023): least squares and genetic algorithm.

u = F_f(v) + F_g at constant speed.  Each direction has a curve of its own: level, F_s - F_c, v_s
and mu_v.  Both methods search the same box for the least root mean square of force, each point
weighted by how long it was held.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.segments import FrictionPoint
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]

STARTS = 6
"""Velocities v_s to begin with."""
PARAMETERS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit:
    """Curves of both directions.

    Parameters
    ----------
    values : ndarray, shape (2, 4)
        Level [N], F_s - F_c [N], ln v_s, mu_v [N s/m] of the positive and negative direction.
    error : float
        Root mean square of the force, weighted [N].
    evaluations : int
        Curves that were tried.
    """

    values: Floats
    error: float
    evaluations: int


def curve_force(speed: Floats, values: Floats) -> Floats:
    """Force against motion at ``speed`` > 0 [N].

    Parameters
    ----------
    speed : ndarray, shape (N,)
        [m/s].
    values : ndarray, shape (4,) or (P, 4)
        As in :class:`CurveFit`, of one direction.

    Returns
    -------
    ndarray, shape (N,) or (P, N)
    """
    level, dip, log_velocity, viscous = (values[..., k, None] for k in range(PARAMETERS))
    force: Floats = level + dip * np.exp(-((speed / np.exp(log_velocity)) ** 2)) + viscous * speed
    return force


def least_squares_curves(points: Sequence[FrictionPoint]) -> CurveFit:
    """Bounded least squares from several starts, direction by direction."""
    from scipy.optimize import least_squares

    values, squares, evaluations = np.full((2, PARAMETERS), np.nan), 0.0, 0
    ways = _ways(points)
    for way, (speed, force, share) in enumerate(ways):
        if not len(speed):
            continue
        low, high = _box(speed, force)
        root = np.sqrt(share)
        best = np.inf
        for start in np.linspace(low[2], high[2], STARTS + 2)[1:-1]:
            begin = np.array([np.median(force), 0.1 * np.ptp(force), start, 0.0])

            def misses(x: Floats, s: Floats = speed, f: Floats = force, r: Floats = root) -> Floats:
                weighted: Floats = r * (curve_force(s, x) - f)
                return weighted

            answer = least_squares(
                misses,
                np.clip(begin, low + 1e-9 * (high - low), high - 1e-9 * (high - low)),
                bounds=(low, high), x_scale=high - low, max_nfev=100,
            )  # fmt: skip
            evaluations += int(answer.nfev) * (1 + PARAMETERS)
            if 2 * answer.cost < best:
                best, values[way] = 2 * float(answer.cost), answer.x
        squares += best
    return CurveFit(values=values, error=_error(squares, ways), evaluations=evaluations)


def genetic_curves(points: Sequence[FrictionPoint], settings: GeneticSettings) -> CurveFit:
    """The genetic algorithm in the same box, both directions with half of the population each."""
    values, squares, evaluations = np.full((2, PARAMETERS), np.nan), 0.0, 0
    ways = _ways(points)
    for way, (speed, force, share) in enumerate(ways):
        if not len(speed):
            continue

        def cost(x: Floats, s: Floats = speed, f: Floats = force, w: Floats = share) -> Floats:
            misses: Floats = (curve_force(s, x) - f) ** 2 @ w
            return misses

        found = minimise(cost, *_box(speed, force), settings)
        values[way], evaluations = found.x, evaluations + found.evaluations
        squares += found.cost
    return CurveFit(values=values, error=_error(squares, ways), evaluations=evaluations)


def _ways(points: Sequence[FrictionPoint]) -> list[tuple[Floats, Floats, Floats]]:
    """Speed, force against motion and weight of the points of each direction."""
    ways = []
    for sign in (1.0, -1.0):
        chosen = [one for one in points if one.velocity * sign > 0]
        ways.append(
            (
                np.array([abs(one.velocity) for one in chosen]),
                np.array([sign * one.force for one in chosen]),
                np.array([one.seconds for one in chosen]),
            )
        )
    return ways


def _box(speed: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Least and greatest values that a curve through the points may have."""
    top = 2 * float(np.abs(force).max())
    slow, fast = float(speed.min()) / 3, float(speed.max())
    return (
        np.array([-top, 0.0, np.log(slow), 0.0]),
        np.array([top, top, np.log(max(fast / 3, 3 * slow)), top / fast]),
    )


def _error(squares: float, ways: Sequence[tuple[Floats, Floats, Floats]]) -> float:
    weight = sum(float(share.sum()) for _, _, share in ways)
    return float(np.sqrt(squares / weight)) if weight else np.nan
