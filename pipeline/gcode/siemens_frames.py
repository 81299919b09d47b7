"""Turned work planes of the Sinumerik 840D on a machine whose table turns about B and C.

TRAORI keeps the tool's tip on the workpiece while the table turns, AROT turns the program's axes on
the workpiece.  A post processor that mills in a turned plane turns both so that they cancel,

    R_y(-B) R_z(-C) R_AROT = 1,

and then the linear axes move as the program says, from the point where the axes of B and C meet,
which is where the work offset must lie.  Only this is followed here; everything else would need the
machine's dimensions.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Frames" (AROT: additive, about the axes
already turned; R_z R_y R_x within a block), Job Planning, "Transformations".
"""

import math

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]
SQUARE = 1e-6
"""How far table and work plane may be from cancelling [rad]."""
UNTURNED: Matrix = np.eye(3)


def rotation(axis: int, degrees: float) -> Matrix:
    """Matrix (3, 3) of a rotation about X (0), Y (1) or Z (2)."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    turned[first, first] = turned[second, second] = cosine
    turned[first, second], turned[second, first] = -sine, sine
    return turned


def turned(frame: Matrix, x: float, y: float, z: float) -> Matrix:
    """A frame turned further by AROT X Y Z [deg]."""
    return frame @ rotation(2, z) @ rotation(1, y) @ rotation(0, x)


def tilt(frame: Matrix, b: float, c: float) -> float:
    """Angle between the program's axes and the machine's with the table at B and C [rad]."""
    residual = rotation(1, -b) @ rotation(2, -c) @ frame
    # |R - 1| is √2 times a small angle; the arccos of the trace would lose half its digits
    return float(np.linalg.norm(residual - UNTURNED) / math.sqrt(2))
