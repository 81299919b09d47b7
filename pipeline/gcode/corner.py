"""Corners of two straight lines that a program rounds (``,R``) or breaks (``,C``).

``,R`` is the radius; ``,C`` the distance from the corner to both ends of the chamfer. Source: Fanuc
0i-F operator's manual B-64694EN, "Optional chamfering and corner R".
"""

import math

import numpy as np

from pipeline.gcode.moves import Kind
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.run import Block, Corner, Run

LETTERS = (",R", ",C")
LEAST_TURN = 1e-9
"""Angle between directions that are one line [rad]."""
SAME = 1e-9
"""Lengths that are equal [mm] or [deg]."""


def begin_corner(run: Run, block: Block) -> None:
    """Remember the corner in which a block's last row ends, where it has ``,R`` or ``,C``."""
    letter = next((one for one in LETTERS if one in block.words), None)
    if letter is None:
        return
    item, value = block.items[letter], block.words.pop(letter)
    if not value > 0:
        raise block.error(item, f"{letter} is {value:g}: give more than 0")
    matrix = run.transform.matrix
    if matrix is not None and abs(abs(np.linalg.det(np.array(matrix))) - 1) > SAME:
        raise block.error(item, "a corner under G51 is not followed: write its arc or its line")
    run.corner = Corner(
        rounded=letter == ",R", size=value * run.state.unit, row=run.rows.count - 1, block=block,
        item=item,
    )  # fmt: skip


def finish_corner(run: Run, corner: Corner) -> None:
    """Put in the arc or the line of a corner, before the straight line that is the last row.

    Raises GcodeError where the lines are not straight, not in the plane, one, or too short.
    """
    run.corner, last = None, run.rows.count - 1
    if last != corner.row + 1 or run.rows.arrays["kind"][last] not in (Kind.RAPID, Kind.FEED):
        raise _error(corner, "the next block has to be a straight line")
    after = tuple(array[last].copy() for array in run.rows.arrays.values())
    end, run.rows.count = run.state.position, last
    _insert(run, corner, end)
    run.rows.append(after)
    run.state.position = end


def _insert(run: Run, corner: Corner, end: list[float]) -> None:
    """The row of the corner, behind the line that is shortened for it."""
    ends = run.rows.arrays["end"]
    begin = ends[corner.row - 1] if corner.row else np.array(run.setup.initial_position)
    at, to = ends[corner.row].copy(), np.array(end)
    first, second, normal = IN_PLANE[run.state.plane]
    others = [normal, 3, 4, 5]
    if np.abs([(at - begin)[others], (to - at)[others]]).max() > SAME:
        raise _error(corner, "both lines have to lie in the plane of G17, G18 or G19")
    plane = [first, second]
    back, on = (begin - at)[plane], (to - at)[plane]
    lengths = math.hypot(*back), math.hypot(*on)
    cross = back[0] * on[1] - back[1] * on[0]
    angle = math.atan2(abs(cross), float(back @ on))  # between the lines, pi where they are one
    if min(lengths) < SAME or math.sin(angle) < LEAST_TURN:
        raise _error(corner, "it needs two lines that meet at an angle")
    taken = corner.size / math.tan(angle / 2) if corner.rounded else corner.size
    if taken > min(lengths) + SAME:
        raise _error(
            corner,
            f"it takes {taken:.4g} mm of lines of {lengths[0]:.4g} and {lengths[1]:.4g} mm: make "
            "it smaller",
        )
    u, v = back / lengths[0], on / lengths[1]
    leave, join = at.copy(), at.copy()
    leave[plane] += taken * u
    join[plane] += taken * v
    run.rows.arrays["end"][corner.row] = leave
    if corner.rounded:
        centre = at[:3].copy()
        towards = (u + v) / math.hypot(*(u + v))
        centre[plane] += corner.size / math.sin(angle / 2) * towards
        turned = math.copysign(math.pi - angle, -cross)
        x, y, z = centre.tolist()
        run.arc_to(corner.block.line, join.tolist(), (x, y, z), turned)
    else:
        run.line_to(Kind.FEED, corner.block.line, join.tolist())
    feed = run.rows.arrays["feed"]  # that of the corner's block, whatever F the next one has
    feed[run.rows.count - 1] = feed[corner.row]


def _error(corner: Corner, reason: str) -> Exception:
    return corner.block.error(corner.item, f"the corner cannot be made: {reason}")
