"""Mean force of the cut along a program, in the machine's axes, at the times of a plan.

At each moment the tool is at a station of the engagement, whose mean force over a turn belongs to
the feed for each tooth of that moment (:mod:`pipeline.cutting.force.load_table`); without runout
the mean over a tooth period is the same.  About the mean it goes up and down with the teeth: as one
harmonic at the frequency of their passing, of the same standard deviation.  Its phase is not known
and does not matter: it moves an axis by fractions of a micrometre, and that is what makes the
friction of one that stands give way.

Frames.  The force of a station lies along the feed, to its left and along the tool; the feed is
turned into the coordinates of the blank by its piece of the path, and from there into the machine's
by the rotation of the work offset.  A positive coordinate of an axis moves the tool along it
relative to the workpiece, whichever of the two the axis carries (ISO 841): a tool that moves is
pushed by the force on it; a table moves against its coordinate and is pushed by the opposite force.
So the force on the tool helps positive motion in both cases, and the load against it is minus that
force.
"""

from dataclasses import dataclass, field

import numpy as np

from pipeline.gcode.moves import RADIAN
from pipeline.machine.control.interpolate import Trace
from pipeline.machine.control.path import Motion
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut import Cut


@dataclass(frozen=True, kw_only=True, eq=False)
class CutForce:
    """Force of the cut at T times."""

    force: Floats = field(repr=False)
    """On the tool along X, Y, Z of the machine [N]; 0 in air."""
    ripple: Floats = field(repr=False)
    """Amplitude of its harmonic at tooth passing [N]."""
    tooth_frequency: Floats = field(repr=False)
    """Tooth frequency [Hz]; 0 in air."""
    cutting: Bools = field(repr=False)
    """Whether the tool is in the material at feed, and its command not in a rapid yet."""
    f_z: Floats = field(repr=False)
    """Feed for each tooth, 0 in air [m]."""


def cut_force(cut: Cut, trace: Trace, delay: float = 0.0) -> CutForce:
    """Force of the cut at the times of a trace of its plan.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    trace : Trace
        Of the plan of the cut, T samples.
    delay : float
        By which the tool is behind the interpolator: filters and servo [s].
    """
    begins = _begins(cut)
    place = begins[trace.row] + np.minimum(trace.distance, np.diff(begins)[trace.row])
    speed = np.gradient(place, trace.time) if len(place) > 1 else np.zeros(len(place))
    since = trace.time - delay
    station = _stations(cut, begins, np.interp(since, trace.time, place))
    at = np.flatnonzero(station >= 0)
    here = station[at]
    engagement = cut.engagement
    flutes = np.array([tool.flutes for tool in cut.tools], dtype=np.float64)
    teeth = flutes[engagement.tool[here]] * cut.plan.spindle_speed[engagement.block[here]] / 60
    slow = np.interp(since[at], trace.time, speed)
    f_z, frequency = np.zeros(len(place)), np.zeros(len(place))
    force, ripple = np.zeros((len(place), 3)), np.zeros((len(place), 3))
    frequency[at] = teeth
    f_z[at] = np.divide(slow, teeth, out=np.zeros(len(at)), where=teeth > 0)
    forces = cut.table.mean_forces(here, f_z[at])
    turn = _turn(cut, here)
    force[at] = np.einsum("qij,qj->qi", turn, forces[:, :3])
    # components that vary independently: variances go with the squares of the turn
    ripple[at] = np.sqrt(2 * np.einsum("qij,qj->qi", turn**2, forces[:, 3:] ** 2))
    path = cut.plan.path
    rapid = np.isin(path.motion, (Motion.RAPID, Motion.INDEPENDENT))[trace.row]
    return CutForce(
        force=force, ripple=ripple, tooth_frequency=frequency,
        cutting=(station >= 0) & ~rapid, f_z=f_z,
    )  # fmt: skip


def _begins(cut: Cut) -> Floats:
    """Path length of the program before each row, and of all of it [m]; shape (M + 1,).

    Rows that stand or turn rotary axes alone have none.
    """
    path, moves = cut.plan.path, cut.plan.path.moves
    linear = np.any(moves.start[:, :3] != moves.end[:, :3], axis=1) | (moves.angle != 0)
    lengths = np.where(path.moving & linear, path.length, 0.0)
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _stations(cut: Cut, begins: Floats, place: Floats) -> Rows:
    """Station at each place along the program [m], -1 in air; shape (T,)."""
    engagement, pieces = cut.engagement, cut.path.pieces
    fed = np.flatnonzero(engagement.feed & (engagement.upper > engagement.lower).any(axis=1))
    if not len(fed):
        return np.full(len(place), -1)
    # a row's pieces are chords, a little shorter than its arc
    lengths = pieces.length
    gone = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
    whole = np.bincount(pieces.block, lengths, minlength=engagement.blocks)
    piece, block = engagement.piece[fed], engagement.block[fed]
    first = np.searchsorted(pieces.block, block, side="left")
    scale = np.diff(begins)[block] / whole[block]
    begin = begins[block] + scale * (gone[piece] - gone[first] + engagement.along[fed])
    end = begin + scale * engagement.length[fed]
    order = np.argsort(begin, kind="stable")
    nearest = np.searchsorted(begin[order], place, side="right") - 1
    at = order[np.maximum(nearest, 0)]
    inside = (nearest >= 0) & (place <= end[at])
    return np.where(inside, fed[at], -1)


def _turn(cut: Cut, station: Rows) -> Floats:
    """From the frame of stations to forces on the tool in the machine's axes; shape (Q, 3, 3)."""
    pieces, piece = cut.path.pieces, cut.engagement.piece[station]
    way = (pieces.end - pieces.start)[piece, :2]
    angle = np.arctan2(way[:, 1], way[:, 0]) + cut.path.frame.rotation * RADIAN
    c, s = np.cos(angle), np.sin(angle)
    left = np.where(pieces.direction[piece] < 0, -1.0, 1.0)  # M4 cuts its mirror image
    turn = np.zeros((len(station), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1] = c, -s * left
    turn[:, 1, 0], turn[:, 1, 1] = s, c * left
    turn[:, 2, 2] = -1.0
    return turn
