"""Friction at constant speed: stretches of a record, and Stribeck's curve through them (Sim2023).

A stretch is of constant speed where the acceleration (of the reference, where that is recorded)
stays below ``STEADY`` of its greatest; the force there is friction alone, u = F_f(v) + F_g.  The
standard error of its mean force counts correlated samples once; points of a curve join stretches of
nearly one speed, whose scatter widens their error.  Each direction has a curve of its own: Coulomb
level, F_s - F_c, v_s and mu_v, found by least squares and by a genetic algorithm in the same box,
each point weighted by its duration.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.drive.mechanics.motion import Motion, reach
from pipeline.submodels.statistics import correlation_rows

STEADY = 0.02
"""Greatest acceleration of a stretch over that of the record [1]."""
CONSTANT = 0.1
"""Greatest standard deviation of the speed in a stretch over its mean [1]."""
ALIKE = 0.03
"""Greatest relative difference of speeds in one point [1]."""
NORMAL = 1.96
"""Quantile of the normal distribution for a 95 % interval [1]."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """Stretch of constant speed."""

    recording: str
    """Its name."""
    velocity: float
    force: float
    """Means [m/s], [N]."""
    error: float
    """Standard error of ``force`` [N]."""
    seconds: float
    """Duration [s]."""


@dataclass(frozen=True, kw_only=True)
class FrictionPoint:
    """Friction at one speed; ``half_width`` is half of its 95 % interval [N]."""

    velocity: float
    force: float
    half_width: float
    seconds: float


def constant_speed_segments(motions: Sequence[Motion], shortest: float) -> list[Segment]:
    """Stretches of at least ``shortest`` [s], in the order of time.

    Recordings under a load do not show friction alone: they are left out where there are others.
    """
    free = [each for each in motions if each.load is None] or motions
    return [one for each in free for one in _segments(each, shortest)]


def _segments(motion: Motion, shortest: float) -> list[Segment]:
    commanded = motion.acceleration if motion.instruments is None else motion.instruments[1]
    greatest = float(np.percentile(np.abs(commanded), 99.9))
    if greatest == 0:
        return []
    steady = (np.abs(commanded) <= STEADY * greatest) & motion.known & motion.moving
    settle = 0 if motion.bandwidth is None else reach(motion.period, motion.bandwidth)
    edges = np.flatnonzero(np.diff(np.r_[False, steady, False]))
    found = []
    for start, end in zip(edges[::2] + settle, edges[1::2] - settle, strict=True):
        if (end - start) * motion.period < shortest or end - start < 3:
            continue
        speed, force = motion.velocity[start:end], motion.force[start:end]
        mean = float(speed.mean())
        if np.std(speed) > CONSTANT * abs(mean):
            continue
        stretch = np.zeros(end - start, np.int64)
        alone = max((end - start) / correlation_rows(force, stretch), 1.0)
        found.append(
            Segment(
                recording=motion.recording, velocity=mean, force=float(force.mean()),
                error=float(np.std(force)) / np.sqrt(alone), seconds=(end - start) * motion.period,
            )
        )  # fmt: skip
    return found


def friction_points(segments: Sequence[Segment]) -> list[FrictionPoint]:
    """The curve: stretches of nearly one speed joined, in the order of speed."""
    points: list[FrictionPoint] = []
    group: list[Segment] = []
    for one in sorted(segments, key=lambda s: s.velocity):
        if group and abs(one.velocity - group[0].velocity) > ALIKE * abs(group[0].velocity):
            points.append(_point(group))
            group = []
        group.append(one)
    return [*points, _point(group)] if group else points


def _point(group: Sequence[Segment]) -> FrictionPoint:
    from scipy.special import stdtrit

    seconds = np.array([one.seconds for one in group])
    share = seconds / seconds.sum()
    force = np.array([one.force for one in group])
    mean = float(share @ force)
    within = float(np.sqrt(share**2 @ np.array([one.error for one in group]) ** 2))
    half = NORMAL * within
    if len(group) > 1:
        between = float(np.sqrt((share**2) @ (force - mean) ** 2 * len(group) / (len(group) - 1)))
        half = max(half, float(stdtrit(len(group) - 1, 0.975)) * between)
    velocity = float(share @ np.array([one.velocity for one in group]))
    return FrictionPoint(
        velocity=velocity, force=mean, half_width=half, seconds=float(seconds.sum())
    )


STARTS = 6
"""Number of velocities v_s to begin with [1]."""
PARAMETERS = 4
"""Number of parameters of one direction [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CurveFit:
    """Curves of both directions."""

    values: Floats
    """Coulomb level [N], F_s - F_c [N], ln v_s, mu_v [N s/m], of the positive and the negative
    direction; shape (2, 4)."""
    error: float
    """Root mean square of the force, weighted [N]."""
    evaluations: int
    """Curves that were tried."""


def curve_force(speed: Floats, values: Floats) -> Floats:
    """Force against motion [N], (N,) or (P, N), at speeds > 0 [m/s] by values of a CurveFit."""
    level, amplitude, log_velocity, viscous = (values[..., k, None] for k in range(PARAMETERS))
    force: Floats = (
        level + amplitude * np.exp(-((speed / np.exp(log_velocity)) ** 2)) + viscous * speed
    )
    return force


def least_squares_curves(points: Sequence[FrictionPoint]) -> CurveFit:
    """Bounded least squares from several starts, direction by direction."""
    from scipy.optimize import least_squares

    values, squares, evaluations = np.full((2, PARAMETERS), np.nan), 0.0, 0
    directions = _directions(points)
    for direction, (speed, force, share) in enumerate(directions):
        if not len(speed):
            continue
        low, high = _box(speed, force)
        root = np.sqrt(share)
        best = np.inf
        for start in np.linspace(low[2], high[2], STARTS + 2)[1:-1]:
            begin = np.array([np.median(force), 0.1 * np.ptp(force), start, 0.0])

            def misses(x: Floats, s: Floats = speed, f: Floats = force, r: Floats = root) -> Floats:
                weighted: Floats = r * (curve_force(s, x) - f)
                return weighted

            answer = least_squares(
                misses,
                np.clip(begin, low + 1e-9 * (high - low), high - 1e-9 * (high - low)),
                bounds=(low, high), x_scale=high - low, max_nfev=100,
            )  # fmt: skip
            evaluations += int(answer.nfev) * (1 + PARAMETERS)
            if 2 * answer.cost < best:
                best, values[direction] = 2 * float(answer.cost), answer.x
        squares += best
    return CurveFit(values=values, error=_error(squares, directions), evaluations=evaluations)


def genetic_curves(points: Sequence[FrictionPoint], settings: GeneticSettings) -> CurveFit:
    """The genetic algorithm in the same box, both directions with half of the population each."""
    values, squares, evaluations = np.full((2, PARAMETERS), np.nan), 0.0, 0
    directions = _directions(points)
    for direction, (speed, force, share) in enumerate(directions):
        if not len(speed):
            continue

        def cost(x: Floats, s: Floats = speed, f: Floats = force, w: Floats = share) -> Floats:
            misses: Floats = (curve_force(s, x) - f) ** 2 @ w
            return misses

        found = minimise(cost, *_box(speed, force), settings)
        values[direction], evaluations = found.x, evaluations + found.evaluations
        squares += found.cost
    return CurveFit(values=values, error=_error(squares, directions), evaluations=evaluations)


def _directions(points: Sequence[FrictionPoint]) -> list[tuple[Floats, Floats, Floats]]:
    """Speed, force against motion and weight of the points of each direction."""
    directions = []
    for sign in (1.0, -1.0):
        chosen = [one for one in points if one.velocity * sign > 0]
        directions.append(
            (
                np.array([abs(one.velocity) for one in chosen]),
                np.array([sign * one.force for one in chosen]),
                np.array([one.seconds for one in chosen]),
            )
        )
    return directions


def _box(speed: Floats, force: Floats) -> tuple[Floats, Floats]:
    """Least and greatest values of a curve through the points."""
    top = 2 * float(np.abs(force).max())
    slow, fast = float(speed.min()) / 3, float(speed.max())
    return (
        np.array([-top, 0.0, np.log(slow), 0.0]),
        np.array([top, top, np.log(max(fast / 3, 3 * slow)), top / fast]),
    )


def _error(squares: float, directions: Sequence[tuple[Floats, Floats, Floats]]) -> float:
    weight = sum(float(share.sum()) for _, _, share in directions)
    return float(np.sqrt(squares / weight)) if weight else np.nan
