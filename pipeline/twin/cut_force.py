"""Mean force of the cut along a program, in the machine's axes, at the times of a plan.

At each moment the tool is at a station of the engagement, whose mean force over a turn belongs to
the feed for each tooth of that moment (:mod:`pipeline.cutting.force.load_table`); without runout
the mean over a tooth period is the same.  What teeth add at their own frequency is left out: its
mean is zero, and feed drives follow frequencies of tooth passing by fractions of a micrometre.

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
from numpy.typing import NDArray

from pipeline.gcode.moves import RADIAN
from pipeline.machine.control.geometry import ROTARY
from pipeline.machine.control.interpolate import Trace
from pipeline.schema.arrays import Bools, Floats
from pipeline.twin.cut import Cut

Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class CutForce:
    """Force of the cut at T times.

    Parameters
    ----------
    force : (T, 3) array
        On the tool along X, Y, Z of the machine [N]; 0 in air.
    cutting : (T,) array of bool
        Whether the tool is in the material at feed.
    f_z : (T,) array
        Feed for each tooth, 0 in air [m].
    """

    force: Floats = field(repr=False)
    cutting: Bools = field(repr=False)
    f_z: Floats = field(repr=False)


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
    f_z, force = np.zeros(len(place)), np.zeros((len(place), 3))
    f_z[at] = np.divide(slow, teeth, out=np.zeros(len(at)), where=teeth > 0)
    force[at] = _in_machine(cut, here, cut.table.mean_forces(here, f_z[at]))
    return CutForce(force=force, cutting=station >= 0, f_z=f_z)


def _begins(cut: Cut) -> Floats:
    """Path length of the program before each row, and of all of it [m]; shape (M + 1,).

    Rows that stand or turn rotary axes alone have none.
    """
    path = cut.plan.path
    lengths = np.where(path.moving & (path.form != ROTARY), path.length, 0.0)
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


def _in_machine(cut: Cut, station: Rows, forces: Floats) -> Floats:
    """Forces of stations on the tool in the machine's axes [N]; shape (Q, 3)."""
    pieces, piece = cut.path.pieces, cut.engagement.piece[station]
    way = (pieces.end - pieces.start)[piece, :2]
    size = np.hypot(way[:, 0], way[:, 1])
    plunge = size == 0.0
    ahead = np.where(plunge, 1.0, way[:, 0]) / np.where(plunge, 1.0, size)
    across = np.where(plunge, 0.0, way[:, 1]) / np.where(plunge, 1.0, size)
    along, left = forces[:, 0], forces[:, 1] * np.where(pieces.direction[piece] < 0, -1.0, 1.0)
    x, y = along * ahead - left * across, along * across + left * ahead
    angle = cut.path.frame.rotation * RADIAN
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x - s * y, s * x + c * y, -forces[:, 2]], axis=1)
