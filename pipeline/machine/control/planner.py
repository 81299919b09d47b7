"""Motion planner of the virtual control: time and speed of each row of a program.

A program and a control make a :class:`pipeline.machine.control.path.Path` once; :func:`plan` then
gives the times for any feeds, spindle speeds and overrides.

    path = limited_path(moves, control)
    plan(path).total

Interpolated rows follow the look-ahead, by trapezoids or with bounded jerk; rapids whose axes each
go as fast as they can (the dog-leg) have closed forms.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.gcode.moves import AXES, METRE, RADIAN, Kind, Moves
from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.parameters import ControlParameters, Limit
from pipeline.machine.control.path import Motion, Path, Segments, where
from pipeline.machine.spindle import halts
from pipeline.schema.arrays import Bools, Floats, Rows

_STOPS = ("always", "change", "never")


def limited_path(moves: Moves, control: ControlParameters) -> Path:
    """Path of ``moves`` with the limits of its speed; once for a program and a control.

    ValueError when a position is not finite, or an axis moves that the control does not have.
    """
    from pipeline.machine.control.limits import FRAMES, Filled, keep_tolerance, limit

    _check_positions(moves, control)
    s_curve = control.profile == "s_curve"
    path = _empty(moves, control)
    tolerance = _tolerance(moves, control)
    filters = control.filters
    rounds = bool(np.isfinite(tolerance).any() and filters.any())
    turn, bend = np.zeros((2, len(moves) if rounds else 0))
    none = np.zeros(0, np.int32)
    rows = Filled(
        path.motion, path.form, path.length, path.factor, path.cap, path.acceleration, path.jerk,
        path.corner, path.pause, path.reason, path.end_reason, turn, bend, none, none,
    )  # fmt: skip
    limit(
        moves.kind, moves.origin, moves.end, moves.centre, moves.angle, moves.plane,
        moves.feed_mode, moves.path_mode, tolerance, halts(moves, control.auxiliary),
        control.limits, control.path_limits, filters.sum(axis=1),
        bool((filters[0] == filters[1]).all()), control.settle_time,
        _STOPS.index(control.rapid_stop), control.rapid_mode == "independent", s_curve,
        control.corner == "blend", np.zeros(FRAMES), rows,
    )  # fmt: skip
    if control.corner == "blend":
        return _blended(path)
    if rounds:
        after, before = _neighbours(path.moving)
        rows = rows._replace(after=after, before=before)
        keep_tolerance(tolerance, _rounding(control), filters.sum(axis=1), rows)
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
    from pipeline.machine.control.limits import rounding

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


UNITS = np.array([METRE] * 3 + [RADIAN] * 3)
"""Factors of the axes' positions to SI."""


@dataclass(frozen=True, kw_only=True)
class RowMotion:
    """Speeds and times of M rows."""

    v_out: Floats = field(repr=False)
    v_peak: Floats = field(repr=False)
    """Speed along the path at the end of a row, and greatest in it [m/s]."""
    time: Floats = field(repr=False)
    """Duration of the row's motion [s]."""
    profile: npt.NDArray[np.int32] = field(
        default_factory=lambda: np.zeros(0, np.int32), repr=False
    )
    """Profile of an S-curve: the row in ``profiles`` that a row belongs to, -1 where it does not
    move; empty of a trapezoid, whose rows are each a profile."""
    profiles: Floats = field(default_factory=lambda: np.zeros((0, 6)), repr=False)
    """Speeds at both ends and on top [m/s], length [m], acceleration [m/s^2], jerk [m/s^3]."""


def row_motion(path: Path, feed: Floats, spindle: Floats) -> RowMotion:
    """Motion under one individual's commands, both of shape (1, M)."""
    if path.segments is not None:
        return _blended_rows(path, path.segments, feed, spindle)
    if path.control.profile == "s_curve":
        motion = _jerk_limited(path, feed, spindle)
    else:
        motion = _trapezoids(path, feed, spindle)
    _add_independent(path, feed, motion.time[np.newaxis])
    return motion


def motion_times(path: Path, feed: Floats, spindle: Floats) -> Floats:
    """Duration of the rows' motion [s]; shape (P, M), from commands (P, M) and (1 or P, M)."""
    if path.control.profile == "s_curve" or path.segments is not None:
        own = np.broadcast_to(spindle, feed.shape)
        rows = [row_motion(path, feed[[p]], own[[p]]).time for p in range(len(feed))]
        return np.array(rows).reshape(feed.shape)
    from pipeline.machine.control.look_ahead import plan_population

    time = np.zeros(feed.shape)
    speeds = np.zeros((2, len(path)))
    plan_population(
        path.motion, path.length, path.factor, path.cap, path.acceleration, path.corner,
        feed, spindle, speeds[0], speeds[1], time,
    )  # fmt: skip
    _add_independent(path, feed, time)
    return time


def _trapezoids(path: Path, feed: Floats, spindle: Floats) -> RowMotion:
    from pipeline.machine.control.look_ahead import plan_rows

    v_out, v_peak, time = (np.zeros(len(path)) for _ in range(3))
    plan_rows(
        path.motion, path.length, path.factor, path.cap, path.acceleration, path.corner,
        feed, spindle, 0, v_out, v_peak, time,
    )  # fmt: skip
    return RowMotion(v_out=v_out, v_peak=v_peak, time=time)


def _jerk_limited(path: Path, feed: Floats, spindle: Floats) -> RowMotion:
    from pipeline.machine.control.look_ahead import COLUMNS, plan_profiles

    rows = np.flatnonzero(path.moving & (path.motion != Motion.INDEPENDENT))
    speed = _commanded(path, rows, feed, spindle)
    v_out, v_peak, time = (np.zeros(len(rows)) for _ in range(3))
    profile = np.zeros(len(rows), np.int32)
    profiles = np.zeros((len(rows), COLUMNS))
    plan_profiles(
        path.length[rows], np.minimum(speed, path.cap[rows]), path.acceleration[rows],
        path.jerk[rows], path.corner[rows], np.zeros(len(rows), np.uint8),
        v_out, v_peak, time, profile, profiles,
    )  # fmt: skip
    first, of = np.unique(profile, return_inverse=True)
    return RowMotion(
        v_out=_carried(len(path), rows, v_out),
        v_peak=_placed(len(path), rows, v_peak, 0.0),
        time=_placed(len(path), rows, time, 0.0),
        profile=_placed(len(path), rows, of.astype(np.int32), -1),
        profiles=np.ascontiguousarray(profiles[first, :6]),
    )


def _commanded(path: Path, rows: Rows, feed: Floats, spindle: Floats) -> Floats:
    """Speed along the path that is commanded in rows [m/s]."""
    turning = np.where(path.motion[rows] == Motion.PER_TURN, spindle[0, rows], 1.0)
    return feed[0, rows] * path.factor[rows] * turning


def _blended_rows(path: Path, segments: Segments, feed: Floats, spindle: Floats) -> RowMotion:
    """Row motion by segments with blends; a row takes its share of the segment's length."""
    from pipeline.machine.control.blends import OVERLAP, plan_segments

    control, last = path.control, segments.last
    v_out, v_peak, time = np.zeros((3, len(last)))
    plan_segments(
        segments.table, _commanded(path, last, feed, spindle), path.cap[last],
        path.motion[last] != Motion.RAPID,
        control.interpolation_period, control.blend.arcs, control.blend.arc_share,
        control.blend.kink_ratio, control.blend.feed_scale,
        np.zeros((OVERLAP + 1, 2 * len(last))), v_out, v_peak, time,
    )  # fmt: skip
    rows = np.flatnonzero(path.moving)
    of = np.searchsorted(segments.last, rows)
    sizes = np.bincount(of, path.length[rows])[of]
    return RowMotion(
        v_out=_carried(len(path), rows, np.where(rows == last[of], v_out[of], v_peak[of])),
        v_peak=_placed(len(path), rows, v_peak[of], 0.0),
        time=_placed(len(path), rows, time[of] * path.length[rows] / sizes, 0.0),
    )


def _placed(many: int, rows: Rows, values: np.ndarray, other: float) -> np.ndarray:
    placed = np.full(many, other, values.dtype)
    placed[rows] = values
    return placed


def _carried(many: int, rows: Rows, speed: Floats) -> Floats:
    """Speed at the end of each row; what does not move keeps that of the row before."""
    last = np.searchsorted(rows, np.arange(many), side="right") - 1
    return np.concatenate([[0.0], speed])[last + 1]


def _add_independent(path: Path, feed: Floats, time: Floats) -> None:
    rows = np.flatnonzero(path.motion == Motion.INDEPENDENT)
    if len(rows):
        time[:, rows] = independent_time(path, rows, feed[:, rows])


def distances(path: Path, rows: Rows) -> Floats:
    """Signed distance of each axis in rows [m, rad]; shape (N, 6)."""
    start = np.where((rows > 0)[:, np.newaxis], path.moves.end[rows - 1], path.moves.origin)
    return (path.moves.end[rows] - start) * UNITS


def independent_time(path: Path, rows: Rows, share: Floats) -> Floats:
    """Time of the slowest axis from standstill to standstill [s]; shape (P, N).

    Parameters
    ----------
    path : Path
        Moves and the control's limits.
    rows : (N,) array
        Rows of the path.
    share : (P, N) array
        Override of the speeds [1].
    """
    here = path.control.has_axis
    size = np.abs(distances(path, rows))[:, here]
    limits = path.control.limits[:, here]
    speed = limits[Limit.RAPID_SPEED] * share[..., np.newaxis]
    jerk = limits[Limit.JERK] if path.control.profile == "s_curve" else np.inf
    return rest_to_rest(size, speed, limits[Limit.RAPID_ACCELERATION], jerk).max(axis=-1)


def ramp_time(change: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike) -> Floats:
    """Time to change the speed by ``change``, without acceleration before and after [s].

    >>> ramp_time([0.1, 1.0], 2.0, 20.0).round(4).tolist()
    [0.1414, 0.6]
    """
    v, a, j = np.abs(np.asarray(change, float)), np.asarray(acceleration), np.asarray(jerk)
    return np.where(v <= a * a / j, 2 * np.sqrt(v / j), v / a + a / j)


def rest_to_rest(
    distance: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike = np.inf
) -> Floats:
    """Shortest time from standstill to standstill [s]; an infinite jerk makes a trapezoid.

    Parameters
    ----------
    distance, speed, acceleration, jerk : array_like, broadcast
        At least 0, and positive [m], [m/s], [m/s^2], [m/s^3].

    Examples
    --------
    >>> rest_to_rest([0.01, 1.0], 0.5, 2.0).round(4).tolist()
    [0.1414, 2.25]
    """
    d, v, a, j = (np.asarray(value, float) for value in (distance, speed, acceleration, jerk))
    # the greatest speed that both ramps fit in: v ramp_time(v) = d
    by_jerk = np.cbrt((d / 2) ** 2 * np.where(np.isfinite(j), j, 0.0))
    blunt = a * a / j
    by_acceleration = (np.sqrt(blunt * blunt + 4 * d * a) - blunt) / 2
    top = np.minimum(v, np.where(by_jerk < blunt, by_jerk, by_acceleration))
    ramp = ramp_time(top, a, j)
    return 2 * ramp + (d - top * ramp) / np.where(top > 0, top, 1.0)


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
