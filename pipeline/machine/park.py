"""Park's transforms between three phases, the stator's frame and the rotor's, amplitude-invariant.

Phase a lies on the alpha axis, the d axis leads it by the electrical angle theta, the q axis leads
d by 90 degrees.  A balanced set of amplitude U has length U in each frame, so that power is
3/2 (u_d i_d + u_q i_q).  The line-voltage form needs no neutral point; as printed in Feed2025 (its
Eq. 9 and 10) it and the inverse do not invert each other, what stands here is the standard form.
"""

from typing import Any

import numpy as np

_SQRT3 = np.sqrt(3.0)


def park(a: Any, b: Any, c: Any, theta: Any) -> tuple[Any, Any]:
    """Return d and q of three phase quantities; the zero component does not enter.

    Parameters
    ----------
    a, b, c : array_like
        Phase quantities, any one unit, shapes that broadcast.
    theta : array_like
        Electrical angle of the rotor [rad].
    """
    alpha, beta = (2 * a - b - c) / 3, (b - c) / _SQRT3
    return rotated(alpha, beta, np.cos(theta), -np.sin(theta))


def line_park(ab: Any, bc: Any, theta: Any) -> tuple[Any, Any]:
    """Return d and q of two line voltages u_ab and u_bc [V] at the electrical angle theta [rad]."""
    cos, sin = np.cos(theta), np.sin(theta)
    d = (2 * cos * ab + (cos + _SQRT3 * sin) * bc) / 3
    q = (-2 * sin * ab + (-sin + _SQRT3 * cos) * bc) / 3
    return d, q


def inverse_park(d: Any, q: Any, theta: Any) -> tuple[Any, Any, Any]:
    """Return the three phases of d and q; their sum is zero.

    Parameters
    ----------
    d, q : array_like
        In the rotor's frame, any one unit.
    theta : array_like
        Electrical angle of the rotor [rad].
    """
    alpha, beta = rotated(d, q, np.cos(theta), np.sin(theta))
    return alpha, (_SQRT3 * beta - alpha) / 2, (-_SQRT3 * beta - alpha) / 2


def rotated(x: Any, y: Any, cos: Any, sin: Any) -> tuple[Any, Any]:
    """Return the vector (x, y) turned by the angle of this cosine and sine.

    With the rotor's angle it leads from dq to the stator's frame, with its negative back.
    """
    return x * cos - y * sin, x * sin + y * cos
