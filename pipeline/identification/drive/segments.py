"""Stretches of constant speed, where the motor's force is friction alone, and the curve they give.

A stretch is constant where the acceleration (of the reference, where that is recorded) stays below
``STEADY`` of its greatest.  The error of its mean force counts samples that hang together once
only; points of a curve join the stretches of nearly one speed, whose scatter widens their error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.filters import reach
from pipeline.identification.drive.intervals import correlation_rows
from pipeline.identification.drive.motion import Motion

Floats = NDArray[np.float64]

STEADY = 0.02
CONSTANT = 0.1
"""Share of its mean that the speed of a stretch may spread by (standard deviation)."""
ALIKE = 0.03
"""Share by which speeds of one point may differ."""
NORMAL = 1.96


@dataclass(frozen=True, kw_only=True)
class Segment:
    """One stretch of constant speed.

    Parameters
    ----------
    recording : str
        Where it stands.
    velocity, force : float
        Means [m/s], [N].
    error : float
        Standard error of ``force`` [N].
    seconds : float
        How long it is [s].
    """

    recording: str
    velocity: float
    force: float
    error: float
    seconds: float


@dataclass(frozen=True, kw_only=True)
class FrictionPoint:
    """Friction at one speed; ``half_width`` is half of its 95 % interval [N]."""

    velocity: float
    force: float
    half_width: float
    seconds: float


def constant_speed_segments(motions: Sequence[Motion], shortest: float) -> list[Segment]:
    """Stretches of at least ``shortest`` [s], in the order of time.

    What carries a load says nothing of friction alone: it is left out where there is something
    else.
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
    from scipy.stats import t as student

    seconds = np.array([one.seconds for one in group])
    share = seconds / seconds.sum()
    force = np.array([one.force for one in group])
    mean = float(share @ force)
    within = float(np.sqrt(share**2 @ np.array([one.error for one in group]) ** 2))
    half = NORMAL * within
    if len(group) > 1:
        between = float(np.sqrt((share**2) @ (force - mean) ** 2 * len(group) / (len(group) - 1)))
        half = max(half, float(student.ppf(0.975, len(group) - 1)) * between)
    velocity = float(share @ np.array([one.velocity for one in group]))
    return FrictionPoint(
        velocity=velocity, force=mean, half_width=half, seconds=float(seconds.sum())
    )
