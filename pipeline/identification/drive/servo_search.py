"""Which servo explains the command best: least squares from several starts, or a genetic search.

Both minimise the same error, the RMSE of the command in :class:`ServoEquation`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.servo_equation import ServoEquation
from pipeline.identification.drive.servo_terms import FA, FV, SPP, SVI, SVP, TH, TS, TV, TX
from pipeline.search.genetic import GeneticSettings, minimise

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

SHARES = (0.0, 0.5, 0.9)
"""Of velocity that is fed forward, where a search for it begins."""
DELAYS = (0.1, 0.5)
"""Of the longest that the equation serves for, where a search begins."""
_EVALUATIONS = 300
_BEYOND = 3.0
"""The genetic algorithm looks within this factor about the closed forms."""


@dataclass(frozen=True, kw_only=True)
class ServoOptimum:
    """Where a search ended.

    Parameters
    ----------
    values : ndarray, shape (D,)
        In the order of ``TERMS``.
    sought : ndarray of bool, shape (D,)
        The others are as they were given.
    error : float
        RMSE of the command [A].
    evaluations : int
        Servos that were tried.
    """

    values: Floats
    sought: Flags
    error: float
    evaluations: int


def closed_forms(equation: ServoEquation, share: float, values: Floats) -> Floats:
    """Where a search begins: gains that follow at once when lags are 0 and f_v is ``share``.

    A = (S_vp V_p S_pp P_p) e + (S_vp V_p)(f_v r' - v) + ... is linear in the products of the gains.

    Parameters
    ----------
    equation : ServoEquation
        Of the recordings.
    share : float
        f_v [1].
    values : ndarray, shape (D,)
        Of all other parameters; where S_vi is 0 there is no integral part.
    """
    e, v_ref, swept, r, _, v, x, A = equation.undelayed(equation.triangle).T
    columns = [e, share * v_ref - v]
    if values[SVI] > 0:
        columns += [swept, share * r - x]
    gains = np.linalg.lstsq(np.stack(columns, axis=1), A, rcond=None)[0]
    n, found = equation.nominal, values.copy()
    found[FV] = share
    if gains[0] > 0 and gains[1] > 0:
        found[SPP], found[SVP] = gains[0] / gains[1] / n.position_gain, gains[1] / n.velocity_gain
    elif len(gains) > 2 and gains[2] > 0 and gains[3] > 0:
        found[SPP] = gains[2] / gains[3] / n.position_gain
    if len(gains) > 2 and gains[3] > 0:
        found[SVI] = gains[3] / n.integral_gain
    return found


def starts(equation: ServoEquation, values: Floats, sought: Flags) -> Iterator[Floats]:
    """Where searches begin; each of shape (D,)."""
    low, high = equation.nominal.bounds(equation.longest)
    shares = SHARES if sought[FV] else (float(values[FV]),)
    places = [(share, DELAYS[0]) for share in shares] + [(shares[0], late) for late in DELAYS[1:]]
    for share, late in places:
        found = closed_forms(equation, share, values)
        found[[TX, TV]] = late * equation.longest
        found[TH], found[TS] = 0.1 * late * equation.longest, 0.5
        found[~sought] = values[~sought]
        yield np.clip(found, low, high)


def least_squares_servo(
    equation: ServoEquation, values: Floats, sought: Flags, begin: Floats | None = None
) -> ServoOptimum:
    """Bounded least squares of the ``sought`` parameters; the others stay as in ``values``.

    Parameters
    ----------
    equation : ServoEquation
        Of the recordings.
    values : ndarray, shape (D,)
        Of what is not sought, and about where to begin.
    sought : ndarray of bool, shape (D,)
        Which are sought.
    begin : ndarray, shape (D,), optional
        The only start, in place of the closed forms.
    """
    from scipy.optimize import least_squares

    low, high = (bound[sought] for bound in equation.nominal.bounds(equation.longest))

    def full(x: Floats) -> Floats:
        found = values.copy()
        found[sought] = x
        return found

    def residuals(x: Floats) -> Floats:
        return equation.residuals(full(x))

    def slopes(x: Floats) -> Floats:
        found: Floats = (equation.triangle @ equation.slopes(full(x)))[:, sought]
        return found

    best = ServoOptimum(values=values, sought=sought, error=np.inf, evaluations=0)
    for start in [begin] if begin is not None else starts(equation, values, sought):
        margin = 1e-6 * np.minimum(high - low, 1.0)
        found = least_squares(
            residuals, np.clip(start[sought], low + margin, high - margin), jac=slopes,
            bounds=(low, high), x_scale="jac", max_nfev=_EVALUATIONS,
        )  # fmt: skip
        tried = best.evaluations + found.nfev
        error = float(equation.rmse(full(found.x)))
        if error < best.error:
            best = replace(best, values=full(found.x), error=error)
        best = replace(best, evaluations=tried)
    return best


def genetic_servo(
    equation: ServoEquation, values: Floats, sought: Flags, settings: GeneticSettings
) -> ServoOptimum:
    """The same by a genetic algorithm (Sim2023), within a factor about the closed forms."""
    low, high = equation.nominal.bounds(equation.longest)
    about = np.stack(list(starts(equation, values, sought)))
    scales = np.array([k in (SPP, SVP, SVI) for k in range(len(values))])
    low = np.where(scales, np.maximum(about.min(axis=0) / _BEYOND, low), low)
    high = np.where(scales, np.minimum(about.max(axis=0) * _BEYOND, high), high)
    high[FA] = _BEYOND * equation.steepest

    def cost(x: Floats) -> Floats:
        tried = np.tile(values, (len(x), 1))
        tried[:, sought] = x
        return equation.rmse(tried)

    found = minimise(cost, low[sought], high[sought], settings, start=about[:, sought])
    best = values.copy()
    best[sought] = found.x
    return ServoOptimum(values=best, sought=sought, error=found.cost, evaluations=found.evaluations)
