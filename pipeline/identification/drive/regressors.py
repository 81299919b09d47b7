"""The inverse dynamics of a feed drive as a table: what multiplies which parameter.

k A = M a + mu_v v + [F_c + (F_s - F_c) exp(-(|v| / v_s)^2)] sgn v + F_g + c F_d (Sim2023), with
sets of their own for each direction.  All is linear in the parameters except v_s: the columns of
exp(-(v / v_s)^2) stand in a table over v_s, between whose entries they are interpolated, so that
every method searches the same, cheap objective.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.filters import first_difference, gaussian, reach
from pipeline.identification.drive.motion import Motion

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LINEAR = (
    "mass", "viscous_positive", "viscous_negative", "level_positive", "level_negative",
)  # fmt: skip
"""Columns that are always there; a level is Coulomb friction plus (positive direction) or less
(negative direction) the force that is always there."""
STEPS_A_DECADE = 24
"""Of the table over v_s: a straight line between them is within 0.2 % of the curve's height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Regressors:
    """N rows of filtered motion and force.

    Parameters
    ----------
    names : tuple of str
        Of ``linear``: :data:`LINEAR`, then ``delay`` [N s] and ``compliance`` [N s^2], which a
        second-order lag of the motion adds, then ``load`` and ``load_zero``, what the load's
        sensor shows without any [N], where a recording has it.
    force : ndarray, shape (N,)
        Of the motor.
    linear : ndarray, shape (N, K)
        Columns by ``names``.
    stribeck : ndarray, shape (V,)
        Velocities v_s of the table [m/s].
    dips : ndarray, shape (2, N, V)
        Columns of F_s - F_c in the positive and the negative direction.
    instruments : ndarray, shape (N, K), optional
        ``linear`` of the reference.
    position, velocity : ndarray, shape (N,)
        [m], [m/s].
    stroke : ndarray of int, shape (N,)
        Number of the stretch without a reversal that a row belongs to, over all recordings.
    stretch : ndarray of int, shape (N,)
        Number of the stretch without a gap between rows.
    period : float
        From row to row within a stretch [s].
    """

    names: tuple[str, ...]
    force: Floats
    linear: Floats
    stribeck: Floats
    dips: Floats
    instruments: Floats | None
    position: Floats
    velocity: Floats
    stroke: NDArray[np.int64]
    stretch: NDArray[np.int64]
    period: float

    def dip_columns(self, log_velocity: Floats) -> Floats:
        """Columns of F_s - F_c at ln v_s of both directions; shape (N, 2)."""
        columns = np.empty((len(self.force), 2))
        for way in range(2):
            low, share = self._place(log_velocity[way])
            table = self.dips[way]
            columns[:, way] = (1 - share) * table[:, low] + share * table[:, low + 1]
        return columns

    def dip_slopes(self, log_velocity: Floats) -> Floats:
        """Derivatives of :meth:`dip_columns` by ln v_s; shape (N, 2)."""
        columns = np.empty((len(self.force), 2))
        step = np.log(self.stribeck[1] / self.stribeck[0])
        for way in range(2):
            low, _ = self._place(log_velocity[way])
            table = self.dips[way]
            columns[:, way] = (table[:, low + 1] - table[:, low]) / step
        return columns

    def _place(self, log_velocity: float) -> tuple[int, float]:
        at = np.interp(log_velocity, np.log(self.stribeck), np.arange(len(self.stribeck)))
        low = min(int(at), len(self.stribeck) - 2)
        return low, float(at - low)

    def of(self, rows: Flags) -> "Regressors":
        """Only some rows; shape (N,) of ``rows``."""
        chosen = self.instruments[rows] if self.instruments is not None else None
        return Regressors(
            names=self.names, force=self.force[rows], linear=self.linear[rows],
            stribeck=self.stribeck, dips=self.dips[:, rows], instruments=chosen,
            position=self.position[rows], velocity=self.velocity[rows], stroke=self.stroke[rows],
            stretch=self.stretch[rows], period=self.period,
        )  # fmt: skip


def regressors(motions: Sequence[Motion], *, delay: bool = True, load: bool = True) -> Regressors:
    """The table of several recordings.

    Parameters
    ----------
    motions : sequence of Motion
        Of one axis, of one bandwidth.
    delay : bool
        Whether columns of the jerk and its derivative are added; the first one's factor is mass
        times delay of the motion behind the force.
    load : bool
        Whether the column of the load is added where a recording has one.

    Raises
    ------
    ValueError
        When no row is left that moves, or the axis was recorded standing.
    """
    velocities = stribeck_velocities(motions)
    with_load = load and any(one.load is not None for one in motions)
    delay = delay and all(one.bandwidth is not None for one in motions)
    names = LINEAR + ("delay", "compliance") * delay + ("load", "load_zero") * with_load
    parts = [_rows(one, velocities, names) for one in motions]
    strokes = np.cumsum([0] + [int(part.stroke.max(initial=-1)) + 1 for part in parts])
    stretches = np.cumsum([0] + [int(part.stretch.max(initial=-1)) + 1 for part in parts])
    known = all(part.instruments is not None for part in parts)
    return Regressors(
        names=names,
        force=np.concatenate([part.force for part in parts]),
        linear=np.concatenate([part.linear for part in parts]),
        stribeck=velocities,
        dips=np.concatenate([part.dips for part in parts], axis=1),
        instruments=np.concatenate([p.instruments for p in parts if p.instruments is not None])
        if known else None,
        position=np.concatenate([part.position for part in parts]),
        velocity=np.concatenate([part.velocity for part in parts]),
        stroke=np.concatenate([p.stroke + n for p, n in zip(parts, strokes, strict=False)]),
        stretch=np.concatenate([p.stretch + n for p, n in zip(parts, stretches, strict=False)]),
        period=float(np.median([part.period for part in parts])),
    )  # fmt: skip


def stribeck_velocities(motions: Sequence[Motion]) -> Floats:
    """Where v_s is sought [m/s]: from a third of the slowest speed to a third of the greatest.

    Raises
    ------
    ValueError
        When nothing moves.
    """
    speeds = np.concatenate([np.abs(m.velocity[m.moving & m.known]) for m in motions])
    if len(speeds) < 10:
        raise ValueError(
            f"{len(speeds)} samples move without a cutting load: record the axis going back and "
            "forth in air"
        )
    slowest, fastest = np.percentile(speeds, [0.5, 99.5])
    low = max(slowest, 1e-4 * fastest) / 3
    high = max(fastest / 3, 3 * low)
    number = max(int(np.ceil(STEPS_A_DECADE * np.log10(high / low))) + 1, 8)
    return np.geomspace(low, high, number)


def _rows(motion: Motion, velocities: Floats, names: tuple[str, ...]) -> Regressors:
    """Rows of one recording, filtered, decimated, without what the filter drags in."""
    keep, every = motion.known & motion.moving, 1
    if motion.bandwidth is not None:
        keep = _eroded(keep, reach(motion.period, motion.bandwidth))
        every = max(int(0.25 / (motion.bandwidth * motion.period)), 1)
    place = np.flatnonzero(keep[::every]) * every
    instruments = motion.instruments
    table = [
        motion.force[:, None],
        _columns(motion.velocity, motion.acceleration, motion, names),
        *(_dips(sign * motion.velocity, sign, velocities) for sign in (1.0, -1.0)),
        *([] if instruments is None else [_columns(*instruments, motion, names)]),
    ]
    if motion.bandwidth is None:
        table = [one[place] for one in table]
    else:
        through = gaussian(place, len(motion.time), motion.period, motion.bandwidth)
        table = [through @ one for one in table]
    turns = np.cumsum(np.abs(np.diff(np.sign(motion.velocity), prepend=0)) > 0)
    gaps = np.cumsum(np.diff(place, prepend=place[:1]) > every, dtype=np.int64)
    return Regressors(
        names=names, force=table[0][:, 0], linear=table[1], stribeck=velocities,
        dips=np.stack(table[2:4]), position=motion.position[place],
        velocity=motion.velocity[place],
        instruments=None if instruments is None else table[4],
        stroke=np.unique(turns[place], return_inverse=True)[1], stretch=gaps,
        period=motion.period * every,
    )  # fmt: skip


def _dips(speed: Floats, sign: float, velocities: Floats) -> Floats:
    """Columns of F_s - F_c in the direction where ``speed`` is positive; shape (T, V)."""
    moving = speed > 0
    columns = np.zeros((len(speed), len(velocities)))
    columns[moving] = sign * np.exp(-((speed[moving, None] / velocities) ** 2))
    return columns


def _columns(v: Floats, a: Floats, motion: Motion, names: tuple[str, ...]) -> Floats:
    positive, negative = v > 0, v < 0
    columns = [a, v * positive, v * negative, positive, -1.0 * negative]
    if "delay" in names:
        jerk = first_difference(a, motion.period)
        columns += [jerk, -first_difference(jerk, motion.period)]
    if "load" in names:
        columns += [
            np.zeros_like(v) if motion.load is None else motion.load,
            np.full_like(v, motion.load is not None),
        ]
    return np.column_stack(columns).astype(np.float64)


def _eroded(flags: Flags, reach: int) -> Flags:
    """True where all within ``reach`` samples are."""
    bad = np.flatnonzero(np.r_[True, ~flags, True]) - 1
    after = np.searchsorted(bad, np.arange(len(flags)))
    place = np.arange(len(flags))
    clear: Flags = (bad[after] - place > reach) & (place - bad[after - 1] > reach)
    return clear & flags
