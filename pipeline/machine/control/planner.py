"""Motion planner of the virtual control: time and speed of each row of a program.

A program and a control make a :class:`pipeline.machine.control.path.Path` once; :func:`plan` then
gives the times for any feeds, spindle speeds and overrides.

    path = limited_path(moves, control)
    plan(path).total
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.gcode.moves import AXES, Kind, Moves
from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.parameters import ControlParameters, Limit
from pipeline.machine.control.path import Path, where
from pipeline.machine.control.row_motion import RowMotion, row_motion
from pipeline.machine.spindle import halts
from pipeline.schema.arrays import Bools, Floats

_STOPS = ("always", "change", "never")


def limited_path(moves: Moves, control: ControlParameters) -> Path:
    """Path of ``moves`` with the limits of its speed; once for a program and a control.

    ValueError when a position is not finite, or an axis moves that the control does not have.
    """
    from pipeline.machine.control.corners import keep_tolerance
    from pipeline.machine.control.limits import FRAMES, limit

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
        control.limits, control.path_limits, filters.sum(axis=1),
        bool((filters[0] == filters[1]).all()),
        control.settle_time, _STOPS.index(control.rapid_stop),
        control.rapid_mode == "independent", s_curve, control.corner == "blend", np.zeros(FRAMES),
        path.motion, path.form, path.length, path.factor, path.cap, path.acceleration, path.jerk,
        path.corner, path.pause, path.reason, path.end_reason, turn, bend,
    )  # fmt: skip
    if control.corner == "blend":
        return _blended(path)
    if rounds:
        keep_tolerance(
            tolerance, _rounding(control), filters.sum(axis=1), path.form, path.length, turn, bend,
            *_neighbours(path.moving), path.motion, path.cap, path.acceleration, path.corner,
            path.pause, path.reason, path.end_reason,
        )  # fmt: skip
    return path


def _blended(path: Path) -> Path:
    """Path with the segments of a control that blends its corners, and the caps of their arcs."""
    from pipeline.machine.control.blends import CAP, segments_of
    from pipeline.machine.control.geometry import ROTARY

    segments = segments_of(path)
    rotary = path.form[segments.last] == ROTARY
    most = np.where(rotary, np.inf, path.control.path_limits[0])
    path.cap[segments.last] = np.minimum(segments.table[CAP], most)
    return replace(path, segments=segments)


def _neighbours(moving: Bools) -> tuple[npt.NDArray[np.int32], ...]:
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
    if control.corner == "blend":
        return np.full(len(moves), np.inf)
    own = control.tolerance if control.corner == "tolerance" else np.inf
    return np.where(moves.tolerance > 0, moves.tolerance, own)


def _rounding(control: ControlParameters) -> Floats:
    from pipeline.machine.control.corners import rounding

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


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Times and speeds of the M rows of a program."""

    path: Path
    """Path that is planned."""
    feed: Floats = field(repr=False)
    """F with the override, in the units of ``Moves``; in rapids the override [1]."""
    spindle_speed: Floats = field(repr=False)
    """Speed of the spindle [rev/min]."""
    motion: RowMotion = field(repr=False)
    """Speeds and times of what moves."""
    wait: Floats = field(repr=False)
    """Standstill after it: filters, check of position, dwell, tool, spindle, M code [s]."""

    @cached_property
    def time(self) -> Floats:
        """Time of each row [s]; shape (M,)."""
        return self.motion.time + self.wait

    @property
    def total(self) -> float:
        """Time of the program [s]."""
        return float(self.time.sum())

    @property
    def v_out(self) -> Floats:
        """Speed along the path at the end of each row [m/s]; shape (M,)."""
        return self.motion.v_out

    @property
    def v_peak(self) -> Floats:
        """Greatest speed along the path in each row [m/s]; shape (M,)."""
        return self.motion.v_peak

    @cached_property
    def limit(self) -> npt.NDArray[np.uint8]:
        """Limit that keeps each row from being faster, :class:`.path.Binding`."""
        from pipeline.machine.control.look_ahead import binding

        path = self.path
        out = np.zeros(len(path), np.uint8)
        binding(
            path.motion, path.factor, path.cap, path.reason, path.corner, path.end_reason,
            self.feed[np.newaxis], self.spindle_speed[np.newaxis], self.v_out, self.v_peak, out,
        )  # fmt: skip
        return out


def plan(
    path: Path,
    *,
    feeds: ArrayLike | None = None,
    speeds: ArrayLike | None = None,
    feed_override: ArrayLike = 100.0,
    rapid_override: ArrayLike = 100.0,
) -> Plan:
    """Times and speeds of a program.

    ``path`` is from :func:`limited_path`; ``feeds`` and ``speeds`` (M,) are F and S in force in
    each row, in the units of ``Moves``, the program's own by default; overrides are in percent, and
    threads take none. ValueError when a row that cuts has no positive F (or the spindle is at rest
    under G95), a speed is negative, or an override is not positive.
    """
    feed = commanded_feeds(path, feeds, feed_override, rapid_override)
    spindle = spindle_speeds(path, speeds)
    if (many := max(len(feed), len(spindle))) != 1:
        raise ValueError(f"plan takes the feeds and speeds of one individual, got {many}")
    motion = row_motion(path, feed, spindle)
    wait = waits(path, spindle, motion.time[np.newaxis])[0]
    return Plan(path=path, feed=feed[0], spindle_speed=spindle[0], motion=motion, wait=wait)
