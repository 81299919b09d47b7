"""Inverse dynamics of a feed drive: the regression table, and bounded robust least squares on it.

k A = M a + mu_v v + [F_c + (F_s - F_c) exp(-(|v| / v_s)^2)] sgn v + F_g + c F_d (Sim2023), with
friction parameters of their own for each direction.  All is linear in the parameters except v_s:
the columns of exp(-(v / v_s)^2) stand in a table over v_s, between whose entries they are
interpolated, so that every method searches the same, cheap objective.

The vector of parameters is that of the table's linear columns, then F_s - F_c and ln v_s of the
positive and of the negative direction.  For each pair of v_s of the table the rest is linear; the
best pairs are the starts of a bounded search over all.  Outliers count less (Huber's weights):
reversals, cogging and cuts that nobody marked are no part of the model.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.submodels.drive.motion import Motion, eroded, first_difference, gaussian, reach

LINEAR = (
    "mass", "viscous_positive", "viscous_negative", "coulomb_level_positive",
    "coulomb_level_negative",
)  # fmt: skip
"""Columns of every table; a Coulomb level is Coulomb friction plus (positive direction) or less
(negative direction) the constant force."""
DIRECTIONS = ("positive", "negative")
"""Directions of motion; friction has parameters of its own for each."""
STEPS_A_DECADE = 24
"""Entries of the table over v_s a decade [1]: its error is below 0.2 % of the curve's height."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Regressors:
    """Regression table: N rows of filtered motion and force."""

    names: tuple[str, ...]
    """Names of ``linear``: :data:`LINEAR`, then ``delay`` [N s] and ``compliance`` [N s^2], which a
    second-order lag of the motion adds, then ``load`` and ``load_zero``, the reading of the load's
    sensor without load [N], where a recording has it."""
    force: Floats
    """Force of the motor; shape (N,)."""
    linear: Floats
    """Columns by ``names``; shape (N, K)."""
    stribeck: Floats
    """Velocities v_s of the table [m/s]; shape (V,)."""
    stribeck_table: Floats
    """Columns of F_s - F_c in the positive and the negative direction; shape (2, N, V)."""
    instruments: Floats | None
    """``linear`` of the reference; shape (N, K)."""
    position: Floats
    velocity: Floats
    """[m], [m/s]; shape (N,)."""
    stroke: Ints
    """Number of the stretch without a reversal of each row, over all recordings; shape (N,)."""
    stretch: Ints
    """Number of the stretch without a gap between rows; shape (N,)."""
    period: float
    """Row period within a stretch [s]."""

    def stribeck_columns(self, log_velocity: Floats) -> Floats:
        """Columns of F_s - F_c at ln v_s of both directions; shape (N, 2)."""
        columns = []
        for table, log in zip(self.stribeck_table, log_velocity, strict=True):
            low, share = self._bracket(log)
            columns.append((1 - share) * table[:, low] + share * table[:, low + 1])
        return np.column_stack(columns)

    def stribeck_slopes(self, log_velocity: Floats) -> Floats:
        """Derivatives of :meth:`stribeck_columns` by ln v_s; shape (N, 2)."""
        step = np.log(self.stribeck[1] / self.stribeck[0])
        columns = []
        for table, log in zip(self.stribeck_table, log_velocity, strict=True):
            low, _ = self._bracket(log)
            columns.append((table[:, low + 1] - table[:, low]) / step)
        return np.column_stack(columns)

    def _bracket(self, log_velocity: float) -> tuple[int, float]:
        at = np.interp(log_velocity, np.log(self.stribeck), np.arange(len(self.stribeck)))
        low = min(int(at), len(self.stribeck) - 2)
        return low, float(at - low)


def regressors(motions: Sequence[Motion]) -> Regressors:
    """The table of several recordings.

    Filtered ones have columns of the jerk and its derivative too; the first one's factor is mass
    times delay of the motion behind the force.
    """
    velocities = stribeck_velocities(motions)
    with_load = any(one.load is not None for one in motions)
    delay = all(one.bandwidth is not None for one in motions)
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
        stribeck_table=np.concatenate([part.stribeck_table for part in parts], axis=1),
        instruments=np.concatenate([p.instruments for p in parts if p.instruments is not None])
        if known else None,
        position=np.concatenate([part.position for part in parts]),
        velocity=np.concatenate([part.velocity for part in parts]),
        stroke=np.concatenate([p.stroke + n for p, n in zip(parts, strokes, strict=False)]),
        stretch=np.concatenate([p.stretch + n for p, n in zip(parts, stretches, strict=False)]),
        period=float(np.median([part.period for part in parts])),
    )  # fmt: skip


def stribeck_velocities(motions: Sequence[Motion]) -> Floats:
    """Velocities v_s of the table [m/s], from a third of the slowest to a third of the greatest."""
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
    """Rows of one recording, filtered and decimated, away from samples that do not count."""
    keep, every = motion.known & motion.moving, 1
    if motion.bandwidth is not None:
        keep = eroded(keep, reach(motion.period, motion.bandwidth))
        every = max(int(0.25 / (motion.bandwidth * motion.period)), 1)
    place = np.flatnonzero(keep[::every]) * every
    instruments = motion.instruments
    table = [
        motion.force[:, None],
        _columns(motion.velocity, motion.acceleration, motion, names),
        *(_stribeck_exponentials(sign * motion.velocity, sign, velocities) for sign in (1.0, -1.0)),
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
        stribeck_table=np.stack(table[2:4]), position=motion.position[place],
        velocity=motion.velocity[place],
        instruments=None if instruments is None else table[4],
        stroke=np.unique(turns[place], return_inverse=True)[1], stretch=gaps,
        period=motion.period * every,
    )  # fmt: skip


def _stribeck_exponentials(speed: Floats, sign: float, velocities: Floats) -> Floats:
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


AMPLITUDES = ("stribeck_amplitude_positive", "stribeck_amplitude_negative")
LOGS = ("log_velocity_positive", "log_velocity_negative")
HUBER = 2.0
"""Standard deviations beyond which a residual counts less [1]."""
ROUNDS = 4
"""Searches with Huber's weights, one after the other [1]."""
STARTS = 3
"""Greatest number of starts of the search [1]."""
COARSE = 4
"""Step through the velocities of the table on the grid of starts [1]."""
AT_BOUND = 1e-5
"""Share of the range of a parameter within which it is at the end [1]."""
RIDGE = 1e-12
"""Ridge on scaled normal equations of the grid [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Dynamics:
    """Optimum of the inverse dynamics."""

    names: tuple[str, ...]
    """Names of the D parameters."""
    values: Floats
    """Values in SI; 0 of those that were not fitted; shape (D,)."""
    fitted: Bools
    """Whether each was fitted; shape (D,)."""
    weights: Floats
    """Weights of the rows, at most 1; shape (N,)."""
    residuals: Floats
    """Measured less modelled force [N]; shape (N,)."""
    evaluations: int
    """Number of evaluations of the model on all rows."""
    limits: tuple[Floats, Floats] | None = None
    """Least and greatest value of each parameter that was searched, shape (D,) each."""

    @property
    def cost(self) -> float:
        """Weighted sum of squares [N^2]."""
        return float(self.weights @ self.residuals**2)

    def is_fitted(self, name: str) -> bool:
        """Whether the parameter ``name`` was fitted."""
        return bool(self.fitted[self.names.index(name)])

    def at_bound(self, name: str) -> bool:
        """Whether the search stopped the parameter ``name`` at its least or greatest value."""
        if self.limits is None:
            return False
        k = self.names.index(name)
        low, high = (float(one[k]) for one in self.limits)
        margin = AT_BOUND * (high - low)
        return self.is_fitted(name) and not low + margin < self.values[k] < high - margin

    def value(self, name: str) -> float:
        """Value of the parameter ``name``; 0 when the table has none of that name."""
        return float(self.values[self.names.index(name)]) if name in self.names else 0.0


def parameter_names(rows: Regressors) -> tuple[str, ...]:
    """Names of the D parameters."""
    return rows.names + AMPLITUDES + LOGS


def modelled_force(rows: Regressors, values: Floats) -> Floats:
    """Force of the motor by the model [N]; shape (N,)."""
    k = len(rows.names)
    return rows.linear @ values[:k] + rows.stribeck_columns(values[k + 2 :]) @ values[k : k + 2]


def jacobian(rows: Regressors, values: Floats) -> Floats:
    """Derivatives of the modelled force by the parameters; shape (N, D)."""
    k = len(rows.names)
    logs = values[k + 2 :]
    slopes = rows.stribeck_slopes(logs) * values[k : k + 2]
    return np.hstack([rows.linear, rows.stribeck_columns(logs), slopes])


def bounds(rows: Regressors) -> tuple[Floats, Floats]:
    """Least and greatest value of each parameter, far beyond any that the rows allow."""
    top = float(np.abs(rows.force).max())
    rates = np.abs(rows.linear)
    low, high = [], []
    for name, column in zip(rows.names, rates.T, strict=True):
        most = 10 * top / max(float(np.percentile(column, 99)), 1e-12)
        least = {"mass": 1e-4 * most, "viscous_positive": 0.0, "viscous_negative": 0.0}
        low.append(least.get(name, -most))
        high.append(most)
    ends = np.log(rows.stribeck[[0, -1]])
    return (
        np.array([*low, 0.0, 0.0, ends[0], ends[0]]),
        np.array([*high, 2 * top, 2 * top, ends[1], ends[1]]),
    )


def all_observable(rows: Regressors) -> Bools:
    """Every parameter that some row depends on; shape (D,)."""
    excited = np.abs(rows.linear).max(axis=0) > 0
    directions = np.array([np.any(rows.velocity > 0), np.any(rows.velocity < 0)])
    for direction, shown in zip(DIRECTIONS, directions, strict=True):
        for name in (f"viscous_{direction}", f"coulomb_level_{direction}"):
            excited[rows.names.index(name)] &= shown
    return np.r_[excited, directions, directions]


def least_squares_dynamics(
    rows: Regressors, fitted: Bools, shares: Floats | None = None
) -> Dynamics:
    """Bounded least squares with Huber's weights, from several starts.

    ``fitted`` (D,): parameters that are fitted, others are 0; ``shares`` (N,): weights of the rows,
    before Huber's.
    """
    weights = np.ones(len(rows.force)) if shares is None else shares
    tried = [_search(rows, fitted, weights, one) for one in profile_starts(rows, fitted, weights)]
    evaluations = sum(one.evaluations for one in tried)
    found = min(tried, key=lambda one: one.cost)
    for _ in range(ROUNDS):
        found = _search(rows, fitted, weights * huber_weights(found.residuals), found.values)
        evaluations += found.evaluations
    return replace(found, evaluations=evaluations)


def huber_weights(residuals: Floats) -> Floats:
    """Weight of each row by Huber: 1 up to ``HUBER`` standard deviations, then falling; (N,)."""
    scale = 1.4826 * float(np.median(np.abs(residuals)))
    if scale == 0:
        return np.ones(len(residuals))
    return np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residuals), 1e-300))


def _search(rows: Regressors, fitted: Bools, weights: Floats, start: Floats) -> Dynamics:
    from scipy.optimize import least_squares

    low, high = bounds(rows)
    root = np.sqrt(weights)
    values = np.where(fitted, np.clip(start, low, high), 0.0)
    # an amplitude of exactly 0 does not depend on v_s: begin inside
    margin = 1e-6 * (high - low)
    begin = np.clip(values[fitted], (low + margin)[fitted], (high - margin)[fitted])

    def full(x: Floats) -> Floats:
        whole = values.copy()
        whole[fitted] = x
        return whole

    def misses(x: Floats) -> Floats:
        return root * (modelled_force(rows, full(x)) - rows.force)

    def slopes(x: Floats) -> Floats:
        return root[:, None] * jacobian(rows, full(x))[:, fitted]

    answer = least_squares(
        misses, begin, slopes, bounds=(low[fitted], high[fitted]), x_scale="jac",
        ftol=1e-10, xtol=1e-10, gtol=1e-12, max_nfev=60,
    )  # fmt: skip
    best = full(answer.x)
    return Dynamics(
        names=parameter_names(rows), values=best, fitted=fitted, weights=weights,
        residuals=rows.force - modelled_force(rows, best), evaluations=int(answer.nfev),
        limits=(low, high),
    )  # fmt: skip


def profile_starts(rows: Regressors, fitted: Bools, weights: Floats) -> list[Floats]:
    """The best pairs of v_s on a coarse grid, each with the linear optimum at it.

    Directions whose Stribeck amplitude is not fitted are left out of the grid.
    """
    k, size = len(rows.names), len(rows.names) + 4
    linear = np.flatnonzero(fitted[:k])
    directions = [direction for direction in range(2) if fitted[k + direction]]
    picks = np.arange(0, len(rows.stribeck), COARSE)
    columns = [
        rows.linear[:, linear],
        *(rows.stribeck_table[direction][:, picks] for direction in directions),
    ]
    wide = np.hstack(columns)
    moments, right = wide.T @ (weights[:, None] * wide), wide.T @ (weights * rows.force)
    grids = np.meshgrid(*[np.arange(len(picks))] * len(directions), indexing="ij")
    choice = (
        np.stack([g.ravel() for g in grids], axis=1) if directions else np.zeros((1, 0), np.int64)
    )
    offsets = len(linear) + len(picks) * np.arange(len(directions))
    index = np.hstack([np.tile(np.arange(len(linear)), (len(choice), 1)), choice + offsets])
    system = moments[index[:, :, None], index[:, None, :]]
    scale = np.sqrt(np.maximum(np.einsum("pii->pi", system), 1e-300))
    system = system / (scale[:, :, None] * scale[:, None, :]) + RIDGE * np.eye(index.shape[1])
    answer = np.linalg.solve(system, (right[index] / scale)[:, :, None])[:, :, 0] / scale
    gain = np.einsum("pi,pi->p", right[index], answer)
    if directions:
        gain = np.where((answer[:, len(linear) :] > 0).all(axis=1), gain, gain * 0.5)
    starts = []
    for p in _apart(gain, choice):
        start = np.zeros(size)
        start[linear] = answer[p, : len(linear)]
        for place, direction in enumerate(directions):
            start[k + direction] = answer[p, len(linear) + place]
            start[k + 2 + direction] = np.log(rows.stribeck[picks[choice[p, place]]])
        starts.append(start)
    return starts


def _apart(gain: Floats, choice: Ints) -> list[int]:
    """The best points of a grid that are no neighbours; at most ``STARTS``."""
    chosen: list[int] = []
    for p in np.argsort(-gain, kind="stable").tolist():
        if all(np.abs(choice[p] - choice[q]).max(initial=0) > 1 for q in chosen):
            chosen.append(p)
        if len(chosen) == STARTS or not choice.shape[1]:
            break
    return chosen
