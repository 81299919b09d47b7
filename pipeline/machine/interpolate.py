"""Positions at the interpolation period: what the control commands the drives.

Before the filters (``programmed``) the position lies on the programmed path; after them
(``position``) it is what the position loops are given.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from pipeline.machine.control import Floats
from pipeline.machine.motion import Binding, Motion
from pipeline.machine.nck import Plan


@dataclass(frozen=True, kw_only=True)
class Trace:
    """T samples of a plan.

    Parameters
    ----------
    time : (T,) array
        [s].
    programmed, position : (T, 6) array
        X Y Z A B C before and after the filters [m, rad].
    row : (T,) array of int32
        Row of ``Moves`` that the interpolator is in (the filters lag behind).
    distance : (T,) array
        How far it is within the row [m], [rad] where only rotary axes move.
    """

    time: Floats = field(repr=False)
    programmed: Floats = field(repr=False)
    position: Floats = field(repr=False)
    row: npt.NDArray[np.int32] = field(repr=False)
    distance: Floats = field(repr=False)

    def __len__(self) -> int:
        return len(self.time)


def trace(plan: Plan, *, period: float | None = None) -> Trace:
    """All samples of a plan, from 0 to its end or up to a period beyond.

    Parameters
    ----------
    plan : Plan
        What is sampled.
    period : float, optional
        The control's ``interpolation_period`` by default [s].

    Raises
    ------
    ValueError
        When the period is not positive, or the program has no rows.
    """
    step = _period(plan, period)
    return next(traces(plan, period=step, samples=_count(plan, step)))


def traces(plan: Plan, *, period: float | None = None, samples: int = 65536) -> Iterator[Trace]:
    """The same in chunks of at most ``samples``, for programs of any length.

    Parameters
    ----------
    plan : Plan
        What is sampled.
    period : float, optional
        The control's ``interpolation_period`` by default [s].
    samples : int
        Greatest length of a chunk.

    Raises
    ------
    ValueError
        As :func:`trace`.
    """
    from pipeline.machine.filters import filtered, memory
    from pipeline.machine.sampling import sample

    step = _period(plan, period)
    lengths = plan.path.control.filters
    room = np.zeros((2, memory(float(lengths.max()), step), 6, 2))
    base, state = np.zeros((2, 6)), np.array([-1, 0])
    run, group = _runs(plan), _groups(plan)
    arguments = _sampled(plan)
    row = 0
    for first in range(0, _count(plan, step), samples):
        many = min(samples, _count(plan, step) - first)
        programmed, position = np.empty((many, 6)), np.empty((many, 6))
        distance, rows = np.empty(many), np.empty(many, np.int32)
        row = sample(*arguments, step, first, row, programmed, distance, rows)
        filtered(programmed, rows, run, group, lengths, step, room, base, state, position)
        yield Trace(
            time=step * np.arange(first, first + many, dtype=np.float64),
            programmed=programmed,
            position=position,
            row=rows,
            distance=distance,
        )


def _period(plan: Plan, period: float | None) -> float:
    step = plan.path.control.interpolation_period if period is None else period
    if not (np.isfinite(step) and step > 0):
        raise ValueError(f"period = {step} s must be finite and positive")
    if len(plan.path) == 0:
        raise ValueError("the program has no rows: there is nothing to interpolate")
    return step


def _count(plan: Plan, period: float) -> int:
    return int(np.ceil(plan.total / period - 1e-9)) + 1


def _runs(plan: Plan) -> npt.NDArray[np.int32]:
    """Which motion from standstill to standstill each row belongs to; shape (M,)."""
    ends = plan.path.end_reason == Binding.EXACT_STOP
    return np.concatenate([[0], np.cumsum(ends)[:-1]]).astype(np.int32)


def _groups(plan: Plan) -> npt.NDArray[np.uint8]:
    """0 in rapids, 1 in cutting, by the last row that moved; shape (M,)."""
    motion = plan.path.motion
    rapid = (motion == Motion.RAPID) | (motion == Motion.INDEPENDENT)
    last = np.maximum.accumulate(np.where(motion != Motion.STILL, np.arange(len(motion)), 0))
    return (~rapid[last]).astype(np.uint8)


def _sampled(plan: Plan) -> tuple[object, ...]:
    """What :func:`pipeline.machine.sampling.sample` takes of a plan, in its order."""
    path, motion = plan.path, plan.motion
    moves = path.moves
    begin = np.concatenate([[0.0], np.cumsum(plan.time)[:-1]])
    return (
        moves.origin, moves.end, moves.centre, moves.angle, moves.plane,
        path.motion, path.form, path.length, path.acceleration, path.control.limits, plan.feed,
        begin, motion.time, motion.v_out, motion.v_peak,
        motion.profile, motion.profiles, *_profile_places(plan, begin),
    )  # fmt: skip


def _profile_places(plan: Plan, begin: Floats) -> tuple[Floats, Floats]:
    """When each profile begins [s], and where each row begins within its profile [m]."""
    profile = plan.motion.profile
    if len(profile) == 0:
        return np.zeros(0), np.zeros(0)
    rows = np.flatnonzero(profile >= 0)
    of, first = np.unique(profile[rows], return_index=True)
    starts = np.zeros(len(plan.motion.profiles))
    starts[of] = begin[rows[first]]
    gone = np.concatenate([[0.0], np.cumsum(plan.path.length)])[:-1]
    offset = np.zeros(len(profile))
    offset[rows] = gone[rows] - gone[rows[first]][profile[rows]]
    return starts, offset
