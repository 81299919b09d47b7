"""The path of a program under one control: what is the same for every feed and spindle speed."""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES, Kind, Moves
from pipeline.machine.auxiliary import where
from pipeline.machine.control import ControlParameters, Floats
from pipeline.machine.corners import Limit, rounding
from pipeline.machine.motion import Motion
from pipeline.machine.spindle import halts

Codes = npt.NDArray[np.uint8]

_STOPS = ("always", "change", "never")


@dataclass(frozen=True, kw_only=True)
class Path:
    """M rows; every array has one entry a row, zero where the row does not move.

    Parameters
    ----------
    moves : Moves
        What it was made from.
    control : ControlParameters
        Whose limits hold.
    motion : (M,) array of uint8
        :class:`pipeline.machine.motion.Motion`.
    form : (M,) array of uint8
        Of rows that move: :mod:`pipeline.machine.geometry`'s STRAIGHT, ROTARY or CURVED.
    length : (M,) array
        Of X, Y, Z [m]; where only rotary axes move, of these [rad].
    factor : (M,) array
        Speed [m/s] (or [rad/s]) for one unit of F, of rapids for an override of 1, of
        ``Motion.PER_TURN`` for one unit of F and 1 rev/min.
    cap : (M,) array
        Speed not to be passed, by the axes' speed, arcs, and the corners of curves [m/s].
    acceleration, jerk : (M,) array
        Along the path [m/s^2], [m/s^3]; ``jerk`` is empty for a trapezoid.
    corner : (M,) array
        Speed not to be passed at the row's end [m/s]; infinite where it runs on straight.
    pause : (M,) array
        Standstill after the row: the filters run empty, and the check of position [s].
    reason, end_reason : (M,) array of uint8
        :class:`pipeline.machine.motion.Binding` of ``cap`` and of ``corner``.
    """

    moves: Moves = field(repr=False)
    control: ControlParameters
    motion: Codes = field(repr=False)
    form: Codes = field(repr=False)
    length: Floats = field(repr=False)
    factor: Floats = field(repr=False)
    cap: Floats = field(repr=False)
    acceleration: Floats = field(repr=False)
    jerk: Floats = field(repr=False)
    corner: Floats = field(repr=False)
    pause: Floats = field(repr=False)
    reason: Codes = field(repr=False)
    end_reason: Codes = field(repr=False)

    def __len__(self) -> int:
        return len(self.motion)

    @property
    def moving(self) -> npt.NDArray[np.bool_]:
        """Which rows move; shape (M,)."""
        return self.motion != Motion.STILL


def limited_path(moves: Moves, control: ControlParameters) -> Path:
    """The path of ``moves`` with what bounds its speed; once for a program and a control.

    Raises
    ------
    ValueError
        When a position is not finite, or an axis moves that the control does not have.
    """
    from pipeline.machine.limits import FRAMES, limit
    from pipeline.machine.tolerance import keep_tolerance

    _check_positions(moves, control)
    s_curve = control.profile == "s_curve"
    path = _empty(moves, control)
    tolerance = _tolerance(moves, control)
    filters = control.filters
    rounds = bool(np.isfinite(tolerance).any() and filters.any())
    turn, bend = np.zeros((2, len(moves) if rounds else 0))
    limit(
        moves.kind, moves.origin, moves.end, moves.centre, moves.angle, moves.plane,
        moves.feed_mode, moves.path_mode, tolerance, halts(moves, control.auxiliary),
        control.limits, filters.sum(axis=1), bool((filters[0] == filters[1]).all()),
        control.settle_time, _STOPS.index(control.rapid_stop),
        control.rapid_mode == "independent", s_curve, np.zeros(FRAMES),
        path.motion, path.form, path.length, path.factor, path.cap, path.acceleration, path.jerk,
        path.corner, path.pause, path.reason, path.end_reason, turn, bend,
    )  # fmt: skip
    if rounds:
        keep_tolerance(
            tolerance, _rounding(control), filters.sum(axis=1), path.form, path.length, turn, bend,
            *_neighbours(path.moving), path.motion, path.cap, path.acceleration, path.corner,
            path.pause, path.reason, path.end_reason,
        )  # fmt: skip
    return path


def _neighbours(moving: npt.NDArray[np.bool_]) -> tuple[npt.NDArray[np.int32], ...]:
    """The moving rows after and before each moving row, -1 for none; shape (M,) each."""
    rows = np.flatnonzero(moving)
    following, preceding = np.full((2, len(moving)), -1, np.int32)
    following[rows[:-1]] = rows[1:]
    preceding[rows[1:]] = rows[:-1]
    return following, preceding


def _empty(moves: Moves, control: ControlParameters) -> Path:
    rows = len(moves)
    length, factor, cap, acceleration, corner, pause = (np.zeros(rows) for _ in range(6))
    motion, form, reason, end_reason = (np.zeros(rows, np.uint8) for _ in range(4))
    return Path(
        moves=moves, control=control, motion=motion, form=form, length=length, factor=factor,
        cap=cap, acceleration=acceleration,
        jerk=np.zeros(rows if control.profile == "s_curve" else 0),
        corner=corner, pause=pause, reason=reason, end_reason=end_reason,
    )  # fmt: skip


def _tolerance(moves: Moves, control: ControlParameters) -> Floats:
    own = control.tolerance if control.corner == "tolerance" else np.inf
    return np.where(moves.tolerance > 0, moves.tolerance, own)


def _rounding(control: ControlParameters) -> Floats:
    rows = [Limit.RAPID_ACCELERATION, Limit.CUTTING_ACCELERATION]
    linear = control.limits[rows, :3]
    along = np.sqrt((np.where(np.isfinite(linear), linear, 0.0) ** 2).sum(axis=1))
    if control.rapid_stop == "never":
        along[:] = along.max()
    return rounding(control.filters, along)


def _check_positions(moves: Moves, control: ControlParameters) -> None:
    origin = np.asarray(moves.origin)[np.newaxis]
    if not np.isfinite(origin).all():
        raise ValueError(f"origin = {moves.origin} must be finite")
    bad = ~np.isfinite(moves.end).all(axis=1)
    arc = moves.kind == Kind.ARC
    in_plane = np.isfinite(moves.centre).sum(axis=1) >= 2
    bad |= arc & ~(in_plane & np.isfinite(moves.angle))
    if bad.any():
        row = int(np.argmax(bad))
        raise ValueError(
            f"{where(moves, row)}: position {moves.end[row].tolist()} is not finite: "
            "give every move an end, and every arc a centre and an angle"
        )
    for axis in np.flatnonzero(~control.has_axis):
        moved = moves.end[:, axis] != origin[0, axis]
        if moved.any():
            letter = AXES[axis]
            raise ValueError(
                f"{where(moves, int(np.argmax(moved)))}: axis {letter} moves, the control has "
                f"{''.join(control.axes)}: add axes.{letter} to its parameters"
            )
