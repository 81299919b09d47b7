"""Search for the servo parameters with the least error of the command, and their uncertainty.

Least squares from several starts and a genetic algorithm minimise the same error, the RMSE of the
command in :class:`ServoEquation`.  Optional terms are added one after the other while they improve
it.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.drive.servo.equation import (
    FA,
    FV,
    SPP,
    SVI,
    SVP,
    TERMS,
    TH,
    TS,
    TV,
    TX,
    Nominal,
    ServoEquation,
)
from pipeline.submodels.statistics import Uncertainty, block_numbers, uncertainty_of

SHARES = (0.0, 0.5, 0.9)
"""Shares of velocity feed-forward where a search begins [1]."""
DELAYS = (0.1, 0.5)
"""Delays over the longest of the equation where a search begins [1]."""
_EVALUATIONS = 300
_BEYOND = 3.0
"""Factor about the closed forms that bounds the genetic algorithm [1]."""


@dataclass(frozen=True, kw_only=True)
class ServoOptimum:
    """Optimum of a search."""

    values: Floats
    """Values in the order of ``TERMS``; shape (D,)."""
    fitted: Bools
    """The others are as they were given; shape (D,)."""
    error: float
    """RMSE of the command [A]."""
    evaluations: int
    """Number of servos evaluated."""


def closed_forms(equation: ServoEquation, share: float, values: Floats) -> Floats:
    """Start of a search: gains by linear least squares for lags of 0 and f_v = ``share``.

    A = (S_vp V_p S_pp P_p) e + (S_vp V_p)(f_v r' - v) + ... is linear in the products of the gains.
    ``values`` (D,) are those of all other parameters; where S_vi is 0 there is no integral part.
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


def starts(equation: ServoEquation, values: Floats, fitted: Bools) -> Iterator[Floats]:
    """Starts of searches; each of shape (D,)."""
    low, high = equation.nominal.bounds(equation.longest)
    shares = SHARES if fitted[FV] else (float(values[FV]),)
    places = [(share, DELAYS[0]) for share in shares] + [(shares[0], late) for late in DELAYS[1:]]
    for share, late in places:
        found = closed_forms(equation, share, values)
        found[[TX, TV]] = late * equation.longest
        found[TH], found[TS] = 0.1 * late * equation.longest, 0.5
        found[~fitted] = values[~fitted]
        yield np.clip(found, low, high)


def least_squares_servo(
    equation: ServoEquation, values: Floats, fitted: Bools, begin: Floats | None = None
) -> ServoOptimum:
    """Bounded least squares of the ``fitted`` parameters, (D,); the others stay as in ``values``.

    ``values`` (D,) are also near the start; ``begin`` (D,) is the only start, in place of the
    closed forms.
    """
    from scipy.optimize import least_squares

    low, high = (bound[fitted] for bound in equation.nominal.bounds(equation.longest))

    def full(x: Floats) -> Floats:
        found = values.copy()
        found[fitted] = x
        return found

    def residuals(x: Floats) -> Floats:
        return equation.residuals(full(x))

    def slopes(x: Floats) -> Floats:
        found: Floats = (equation.triangle @ equation.slopes(full(x)))[:, fitted]
        return found

    best = ServoOptimum(values=values, fitted=fitted, error=np.inf, evaluations=0)
    for start in [begin] if begin is not None else starts(equation, values, fitted):
        margin = 1e-6 * np.minimum(high - low, 1.0)
        found = least_squares(
            residuals, np.clip(start[fitted], low + margin, high - margin), jac=slopes,
            bounds=(low, high), x_scale="jac", max_nfev=_EVALUATIONS,
        )  # fmt: skip
        tried = best.evaluations + found.nfev
        error = float(equation.rmse(full(found.x)))
        if error < best.error:
            best = replace(best, values=full(found.x), error=error)
        best = replace(best, evaluations=tried)
    return best


def genetic_servo(
    equation: ServoEquation, values: Floats, fitted: Bools, settings: GeneticSettings
) -> ServoOptimum:
    """The same by a genetic algorithm (Sim2023), within a factor about the closed forms."""
    low, high = equation.nominal.bounds(equation.longest)
    about = np.stack(list(starts(equation, values, fitted)))
    scales = np.array([k in (SPP, SVP, SVI) for k in range(len(values))])
    low = np.where(scales, np.maximum(about.min(axis=0) / _BEYOND, low), low)
    high = np.where(scales, np.minimum(about.max(axis=0) * _BEYOND, high), high)
    high[FA] = _BEYOND * equation.steepest

    def cost(x: Floats) -> Floats:
        tried = np.tile(values, (len(x), 1))
        tried[:, fitted] = x
        return equation.rmse(tried)

    found = minimise(cost, low[fitted], high[fitted], settings, start=about[:, fitted])
    best = values.copy()
    best[fitted] = found.x
    return ServoOptimum(values=best, fitted=fitted, error=found.cost, evaluations=found.evaluations)


IMPROVEMENT = 0.05
"""Least relative decrease of the squared error by which another term is kept [1]."""
MATTERS = 0.005
"""Least share of the command that another term explains [1]."""
CLOCK = 1e-4
"""Relative error of a recorder's clock, and with it of every gain [1]."""
NONE_SEEN = 0.1
"""Greatest end of its interval up to which a feed-forward that is not fitted counts as 0 [1]."""


def always_fitted(nominal: Nominal) -> Bools:
    """Terms of every servo of this list; shape (D,)."""
    fitted = np.zeros(len(TERMS), bool)
    fitted[[SPP, SVP, TX, TV, TS]] = True
    fitted[[SVI, TH]] = nominal.integral is True
    return fitted


def optional_terms(nominal: Nominal) -> list[tuple[int, ...]]:
    """Terms that are fitted where they improve the fit: the list does not name them."""
    found: list[tuple[int, ...]] = [(SVI, TH)] if nominal.integral is None else []
    for k in (FV, FA):
        if TERMS[k] in nominal.unnamed:
            found.append((k,))
    return found


def selected_servo(equation: ServoEquation) -> ServoOptimum:
    """Least squares with the terms that improve the fit, added one after the other."""
    values, fitted = equation.nominal.fixed, always_fitted(equation.nominal)
    best = least_squares_servo(equation, values, fitted)
    candidates = optional_terms(equation.nominal)
    while candidates:
        tried = [_with(equation, values, best, terms) for terms in candidates]
        k = int(np.argmin([one.error for one in tried]))
        gain = best.error**2 - tried[k].error ** 2
        if not gain > max(IMPROVEMENT * best.error**2, (MATTERS * equation.spread) ** 2):
            break
        best = tried[k]
        del candidates[k]
    return best


def _with(
    equation: ServoEquation, values: Floats, best: ServoOptimum, terms: tuple[int, ...]
) -> ServoOptimum:
    fitted, begin = best.fitted.copy(), values.copy()
    fitted[list(terms)] = True
    if SVI in terms:
        begin[SVI] = 1.0
    found = least_squares_servo(equation, begin, fitted)
    return replace(found, evaluations=found.evaluations + best.evaluations)


def servo_uncertainty(
    equation: ServoEquation, slower: ServoEquation, optimum: ServoOptimum
) -> Uncertainty:
    """Uncertainty of an optimum: clustered 95 % intervals and the change at half the bandwidth.

    Half widths are of all D terms, infinite where not fitted; the rest is of the S fitted ones.

    ``slower`` has the same recordings below half the bandwidth; sampling and filters of a servo
    that the equation leaves out move the optimum from the one to the other.
    """
    # parameters at a bound count too: a lag of 0 has an interval like any other
    inside = optimum.fitted
    slopes = equation.jacobian(optimum.values, inside)
    residuals = equation.columns @ equation.factors(optimum.values)
    blocks = block_numbers(residuals, equation.stretch, int(inside.sum()))
    uncertainty = uncertainty_of(slopes, residuals, blocks)
    again = least_squares_servo(slower, optimum.values, optimum.fitted)
    half = np.full(len(TERMS), np.inf)
    half[inside] = uncertainty.half_width + np.abs(again.values - optimum.values)[inside]
    half[inside] += CLOCK * np.abs(optimum.values[inside])
    return replace(uncertainty, half_width=half)


def greatest_unseen(
    equation: ServoEquation, slower: ServoEquation, best: ServoOptimum, term: int
) -> float | None:
    """Upper bound of a feed-forward that is not fitted; None where that is no bound."""
    fitted = best.fitted.copy()
    fitted[term] = True
    tried = least_squares_servo(equation, best.values, fitted, best.values)
    half = servo_uncertainty(equation, slower, tried).half_width[term]
    most = float(tried.values[term] + half) if np.isfinite(half) else np.inf
    return most if most <= NONE_SEEN * (1.0 if term == FV else equation.steepest) else None
