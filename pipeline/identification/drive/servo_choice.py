"""Which terms the records want of a servo, and how well they determine them."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.intervals import BLOCK, correlation_rows
from pipeline.identification.drive.servo_equation import ServoEquation
from pipeline.identification.drive.servo_search import ServoOptimum, least_squares_servo
from pipeline.identification.drive.servo_terms import (
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
)
from pipeline.submodels.least_squares import certainty

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WANTED = 0.05
"""Share of the squared error that a further term must take away to be kept [1]."""
MATTERS = 0.005
"""Share of the command that it must explain [1]."""
CLOCK = 1e-4
"""How wrong the clock of a recorder may go, and with it every gain [1]."""
NONE_SEEN = 0.1
"""A feed-forward that is not wanted is 0 when its interval reaches no further [1]."""
_FEWEST = 3
"""Blocks for each parameter."""


@dataclass(frozen=True, kw_only=True)
class ServoCertainty:
    """How well the terms of a servo are known.

    Parameters
    ----------
    half_width : ndarray, shape (D,)
        Half of the 95 % interval; infinite of what was not sought.
    condition : float
        Of the Jacobian with columns scaled to length one.
    rank : int
        Of the same.
    correlation : ndarray, shape (S, S)
        Of the terms that were sought.
    correlated : tuple of str
        Their names.
    """

    half_width: Floats
    condition: float
    rank: int
    correlation: Floats
    correlated: tuple[str, ...]


def always_sought(nominal: Nominal) -> Flags:
    """Terms of every servo of this list; shape (D,)."""
    sought = np.zeros(len(TERMS), bool)
    sought[[SPP, SVP, TX, TV, TS]] = True
    sought[[SVI, TH]] = nominal.integral is True
    return sought


def further(nominal: Nominal) -> list[tuple[int, ...]]:
    """Terms that are sought where the records want them: the list says nothing of them."""
    found: list[tuple[int, ...]] = [(SVI, TH)] if nominal.integral is None else []
    for k in (FV, FA):
        if TERMS[k] in nominal.unnamed:
            found.append((k,))
    return found


def wanted_servo(equation: ServoEquation) -> ServoOptimum:
    """Least squares with the terms that the records want, found one after the other."""
    values, sought = equation.nominal.fixed, always_sought(equation.nominal)
    best = least_squares_servo(equation, values, sought)
    candidates = further(equation.nominal)
    while candidates:
        tried = [_with(equation, values, best, terms) for terms in candidates]
        k = int(np.argmin([one.error for one in tried]))
        gain = best.error**2 - tried[k].error ** 2
        if not gain > max(WANTED * best.error**2, (MATTERS * equation.spread) ** 2):
            break
        best = tried[k]
        del candidates[k]
    return best


def _with(
    equation: ServoEquation, values: Floats, best: ServoOptimum, terms: tuple[int, ...]
) -> ServoOptimum:
    sought, begin = best.sought.copy(), values.copy()
    sought[list(terms)] = True
    if SVI in terms:
        begin[SVI] = 1.0
    found = least_squares_servo(equation, begin, sought)
    return replace(found, evaluations=found.evaluations + best.evaluations)


def servo_certainty(
    equation: ServoEquation, slower: ServoEquation, found: ServoOptimum
) -> ServoCertainty:
    """Certainty of an optimum: 95 %, clustered, and what half the bandwidth makes of it.

    Parameters
    ----------
    equation : ServoEquation
        That it is the optimum of.
    slower : ServoEquation
        The same recordings below half the bandwidth; what the equation does not know of a servo
        (how it samples and filters) moves the optimum from the one to the other.
    found : ServoOptimum
        The optimum.
    """
    # what stands at a bound counts too: a lag of 0 is known no better than its interval
    inside = found.sought
    slopes = (equation.columns @ equation.slopes(found.values))[:, inside]
    residuals = equation.columns @ equation.factors(found.values)
    length = BLOCK * correlation_rows(residuals, equation.stretch)
    length = max(min(length, len(residuals) / (_FEWEST * max(int(inside.sum()), 1))), 1.0)
    blocks = (np.arange(len(residuals)) / length).astype(np.int64)
    sure = certainty(slopes, residuals, blocks)
    again = least_squares_servo(slower, found.values, found.sought, found.values)
    half = np.full(len(TERMS), np.inf)
    half[inside] = sure.half_width + np.abs(again.values - found.values)[inside]
    half[inside] += CLOCK * np.abs(found.values[inside])
    scaled = slopes / np.where((norm := np.linalg.norm(slopes, axis=0)) > 0, norm, 1.0)
    return ServoCertainty(
        half_width=half, condition=sure.condition, rank=int(np.linalg.matrix_rank(scaled)),
        correlation=sure.correlation,
        correlated=tuple(t for t, i in zip(TERMS, inside, strict=True) if i),
    )  # fmt: skip


def none_seen(
    equation: ServoEquation, slower: ServoEquation, best: ServoOptimum, term: int
) -> float | None:
    """How large a feed-forward that is not wanted may be at most; None where that says little."""
    sought = best.sought.copy()
    sought[term] = True
    tried = least_squares_servo(equation, best.values, sought, best.values)
    half = servo_certainty(equation, slower, tried).half_width[term]
    most = float(tried.values[term] + half) if np.isfinite(half) else np.inf
    return most if most <= NONE_SEEN * (1.0 if term == FV else equation.steepest) else None
