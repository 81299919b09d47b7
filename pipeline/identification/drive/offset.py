"""From levels of both directions to Coulomb friction and the force that is always there.

Motion shows two levels, F_c+ + F_g and F_c- - F_g: three unknowns.  What is known of the axis
decides (``coulomb`` in conf/machine/): with Coulomb friction alike both ways the difference of the
levels is twice the force; with no such force each level is Coulomb friction.  "auto" takes the
first where the levels differ by more than ``GRAVITY`` of their mean, or one is negative, which
friction alone does not explain, and the second otherwise.  "Alike" is meant within ``ALIKE``: what
horizontal axes of one machine differ by; where "auto" decides, within the share by which viscous
friction differs, if that is more.  Coulomb friction and force are uncertain by as much.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.inverse_dynamics import Dynamics
from pipeline.identification.drive.known import Coulomb

Floats = NDArray[np.float64]

GRAVITY = 0.5
ALIKE = 0.05
EQUAL = "Coulomb friction taken as alike both ways"
GIVEN = f"{EQUAL}, as conf/machine/ says"
SHOWN = f"{EQUAL}: the levels differ by more than friction does"
UNEQUAL = "taken as 0: motion cannot tell it from Coulomb friction that differs both ways"


@dataclass(frozen=True, kw_only=True)
class Split:
    """How levels are split.

    Parameters
    ----------
    equal : bool
        Whether Coulomb friction is taken as alike both ways.
    reason : str
        Why.
    unequal_share : float
        Share of Coulomb friction by which it may differ nevertheless [1].
    """

    equal: bool
    reason: str
    unequal_share: float = 0.0


def split_of(found: Dynamics, coulomb: Coulomb) -> Split:
    """How the levels of ``found`` are split."""
    positive, negative = found.value("level_positive"), found.value("level_negative")
    both = all(found.sought[found.names.index(f"level_{s}")] for s in ("positive", "negative"))
    if not both:
        return Split(equal=False, reason="only one direction was recorded")
    if coulomb == "equal":
        return Split(equal=True, reason=GIVEN, unequal_share=ALIKE)
    mean = 0.5 * (positive + negative)
    impossible = min(positive, negative) < 0
    if impossible or (coulomb == "auto" and abs(positive - negative) > GRAVITY * mean):
        ways = found.value("viscous_positive"), found.value("viscous_negative")
        share = abs(ways[0] - ways[1]) / sum(ways) if sum(ways) > 0 else 0.0
        return Split(equal=True, reason=SHOWN, unequal_share=max(share, ALIKE))
    return Split(equal=False, reason=UNEQUAL)


def coulomb_and_offset(found: Dynamics, split: Split) -> tuple[float, float, float]:
    """F_c+, F_c- and F_g [N]."""
    positive, negative = found.value("level_positive"), found.value("level_negative")
    if split.equal:
        mean = 0.5 * (positive + negative)
        return mean, mean, 0.5 * (positive - negative)
    return positive, negative, 0.0
