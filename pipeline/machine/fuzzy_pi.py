"""Fuzzy rules that move the gains of the speed loop's PI (Feed2025).

Speed error E and its change EC, scaled to [-10, 10], each belong to two neighbours of seven
triangular sets NB ... PB.  A rule holds as much as the lesser of its two ("min"), and the increment
of a gain is the mean of the rules' outputs weighted with that.  The tables are the classical ones
of fuzzy tuning.  They are nearly odd in (E, EC), where rules that treat both directions of motion
alike would be even: a gain that rises on the way up falls on the way down.
"""

from dataclasses import dataclass
from math import isfinite

import numpy as np

SETS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")
"""Negative big ... positive big: centres -10 ... 10 of an input, -1 ... 1 of an increment."""


def _rules(text: str) -> np.ndarray:
    """Increments [1]; a row for each set of E, a column for each of EC."""
    return np.array([[SETS.index(word) for word in row.split()] for row in text.split("/")]) / 3 - 1


PROPORTIONAL = _rules(
    "PB PB PM PM PS ZO ZO / PB PB PM PS PS ZO NS / PM PM PM PS ZO NS NS / PM PM PS ZO NS NM NM /"
    "PS PS ZO NS NS NM NM / PS ZO NS NM NM NM NB / ZO ZO NM NM NM NB NB"
)
INTEGRAL = _rules(
    "NB NB NM NM NS ZO ZO / NB NB NM NS NS ZO ZO / NB NM NS NS ZO PS PS / NM NM NS ZO PS PM PM /"
    "NM NS ZO PS PS PM PB / ZO ZO PS PS PM PB PB / ZO ZO PS PM PM PB PB"
)


@dataclass(frozen=True, kw_only=True)
class FuzzyParameters:
    """Scales of the rules.  K = K_middle (1 + span times increment), increments in [-1, 1].

    Parameters
    ----------
    error_scale : float
        E for one unit of speed error [s/rad].
    change_scale : float
        EC for one unit of its rate of change [s^2/rad].
    proportional_span, integral_span : float
        Greatest change of a gain as a share of its middle [1], below 1; the defaults give
        [0.2, 0.8] about 0.5 and [20, 60] about 40.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    error_scale: float
    change_scale: float
    proportional_span: float = 0.6
    integral_span: float = 0.5

    def __post_init__(self) -> None:
        for name in ("error_scale", "change_scale"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0):
                raise ValueError(f"fuzzy.{name} = {value} must be finite and at least 0")
        for name in ("proportional_span", "integral_span"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ValueError(
                    f"fuzzy.{name} = {value} must be in [0, 1), else a gain can vanish"
                )


def increments(error: float, change: float) -> tuple[float, float]:
    """Return the increments of K_p and K_i as shares of their spans [1].

    Parameters
    ----------
    error, change : float
        E and EC [1]; beyond [-10, 10] they count as its ends.

    Examples
    --------
    The start of a step up: the greatest error, which falls fast, leaves both gains as they are.

    >>> [round(float(x), 12) for x in increments(10.0, -10.0)]
    [0.0, 0.0]
    """
    x, y = 0.3 * (error + 10.0), 0.3 * (change + 10.0)
    # what is no number counts as the lower end, so that the tables are never left
    x = min(x, 6.0) if x > 0.0 else 0.0
    y = min(y, 6.0) if y > 0.0 else 0.0
    row, column = min(int(x), 5), min(int(y), 5)
    a, b = x - row, y - column
    weight = (min(1 - a, 1 - b), min(1 - a, b), min(a, 1 - b), min(a, b))
    total = weight[0] + weight[1] + weight[2] + weight[3]
    proportional = (
        weight[0] * PROPORTIONAL[row, column]
        + weight[1] * PROPORTIONAL[row, column + 1]
        + weight[2] * PROPORTIONAL[row + 1, column]
        + weight[3] * PROPORTIONAL[row + 1, column + 1]
    )
    integral = (
        weight[0] * INTEGRAL[row, column]
        + weight[1] * INTEGRAL[row, column + 1]
        + weight[2] * INTEGRAL[row + 1, column]
        + weight[3] * INTEGRAL[row + 1, column + 1]
    )
    return proportional / total, integral / total
