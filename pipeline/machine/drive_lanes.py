"""Axes of many individuals under their servos at once, in lanes, compiled.

Time stands outside, the axes within it, the lanes innermost; what is reported is counted on the
way.  All numbers lie in one array at constant distances: so the compiler sees that writing one
leaves the others alone, and takes the lanes together.
"""

from math import sqrt

from numpy import uint64

from pipeline.kernels import compiled
from pipeline.machine.drive_arithmetic import (
    ASKED,
    FORWARD,
    GREATEST_COMMAND,
    GREATEST_ERROR,
    LANES,
    ROWS,
    SQUARE_COMMAND,
    SQUARE_ERROR,
    UNIT,
    make_ready,
    mechanics_step,
    servo_sample,
)
from pipeline.machine.lane_arithmetic import in_widest_vectors

CHUNK = 16
"""Samples that are laid out at once: what is stored lane by lane is best not read at once."""
MAX_ERROR, RMS_ERROR, MAX_COMMAND, RMS_COMMAND = range(4)
"""Columns of what is reported."""
_AXIS = uint64(ROWS * LANES)
_LOAD = uint64(LANES)


@compiled
def drive_errors(  # type: ignore[no-untyped-def]
    reference, load, table, start, first, last, period, inner, held, lanes, room, coming, out
):
    """Fill ``out`` of shape (P, A, 4) for the individuals from ``first`` to before ``last``.

    ``reference`` has shape (1 or P, T, A), ``load`` (1 or P, 1 or T, A), ``table`` (P, A, columns)
    and ``start`` (P, A, 4); the servo samples ``inner`` times a ``period``, and the mechanics make
    ``held`` steps for each.  ``lanes`` is LANES: were it known to the compiler, that would unroll
    the loops over lanes and leave them in scalars.  Room to work in: ``room``, A * ROWS * LANES
    long, and ``coming``, CHUNK * A * 2 * LANES; both best lie on whole lines of the cache.
    """
    samples, axes = reference.shape[1], reference.shape[2]
    each = period / inner
    own = reference.shape[0] > 1 or load.shape[0] > 1
    for block in range(first, last, LANES):
        for lane in range(LANES):
            # what is left of the lanes repeats the last individual
            p = min(block + lane, last - 1)
            of = min(p, reference.shape[0] - 1)
            for a in range(axes):
                at = uint64(a) * _AXIS + uint64(lane)
                make_ready(table[p, a], start[p, a], reference[of, 0, a], each, held, room, at)
        if own:
            _follow_own(reference, load, block, last, each, inner, held, lanes, room, coming)
        else:
            _follow_one(reference[0], load[0], each, inner, held, lanes, room)
        for lane in range(min(LANES, last - block)):
            for a in range(axes):
                at = uint64(a) * _AXIS + uint64(lane)
                _report(room, at, samples * inner, out[block + lane, a])


@compiled
def _report(room, at, samples, out):  # type: ignore[no-untyped-def]
    unit = room[at + UNIT]
    out[MAX_ERROR] = room[at + GREATEST_ERROR]
    out[RMS_ERROR] = sqrt(room[at + SQUARE_ERROR] / samples)
    out[MAX_COMMAND] = room[at + GREATEST_COMMAND] / unit
    out[RMS_COMMAND] = sqrt(room[at + SQUARE_COMMAND] / samples) / unit


@compiled
def _follow_one(reference, load, period, inner, held, lanes, room):  # type: ignore[no-untyped-def]
    """All individuals follow one reference of shape (T, A), against one load."""
    in_widest_vectors()
    rate, part, half = 1.0 / period, 1.0 / inner, 0.5 * period / held
    loaded = 1 if load.shape[0] > 1 else 0
    for k in range(reference.shape[0]):
        after = min(k + 1, reference.shape[0] - 1)
        for j in range(inner):
            for a in range(reference.shape[1]):
                base = uint64(a) * _AXIS
                # what was asked last is the same in all lanes: the first one keeps it
                r = reference[k, a] + (reference[after, a] - reference[k, a]) * (j * part)
                forward = (r - room[base + ASKED]) * rate
                ahead = (forward - room[base + FORWARD]) * rate
                room[base + ASKED], room[base + FORWARD] = r, forward
                push = load[loaded * k, a]
                for lane in range(lanes):
                    servo_sample(room, base + uint64(lane), r, forward, ahead)
                for _ in range(held):
                    for lane in range(lanes):
                        mechanics_step(room, base + uint64(lane), push, half)


@compiled
def _follow_own(reference, load, block, last, period, inner, held, lanes, room, coming):  # type: ignore[no-untyped-def]
    """Each individual follows its own reference, or has its own load."""
    in_widest_vectors()
    rate, half = 1.0 / period, 0.5 * period / held
    samples, axes, loaded = reference.shape[1] * inner, reference.shape[2], load.shape[1] > 1
    for chunk in range(0, samples, CHUNK):
        many = min(CHUNK, samples - chunk)
        _lay_out(reference, block, last, chunk, many, inner, coming, uint64(0))
        if loaded or chunk == 0:
            _lay_out(load, block, last, chunk, many, inner, coming, _LOAD)
        for s in range(many):
            for a in range(axes):
                base, at = uint64(a) * _AXIS, uint64(s * axes + a) * uint64(2 * LANES)
                for lane in range(lanes):
                    i, r = base + uint64(lane), coming[at + uint64(lane)]
                    forward = (r - room[i + ASKED]) * rate
                    ahead = (forward - room[i + FORWARD]) * rate
                    room[i + ASKED], room[i + FORWARD] = r, forward
                    servo_sample(room, i, r, forward, ahead)
                for _ in range(held):
                    for lane in range(lanes):
                        push = coming[at + _LOAD + uint64(lane)]
                        mechanics_step(room, base + uint64(lane), push, half)


@compiled
def _lay_out(values, block, last, first, many, inner, coming, row):  # type: ignore[no-untyped-def]
    """Lay out samples of the servo, on straight lines between those of ``values``; loads hold."""
    axes, part = values.shape[2], 0.0 if row == _LOAD else 1.0 / inner
    for lane in range(LANES):
        own = values[min(min(block + lane, last - 1), values.shape[0] - 1)]
        at = uint64(lane) + row
        if inner == 1 and values.shape[1] > 1:
            for k in range(first, first + many):
                for a in range(axes):
                    coming[at] = own[k, a]
                    at += uint64(2 * LANES)
            continue
        k, j = min(first // inner, values.shape[1] - 1), first % inner
        for _ in range(many):
            after = min(k + 1, values.shape[1] - 1)
            for a in range(axes):
                coming[at] = own[k, a] + (own[after, a] - own[k, a]) * (j * part)
                at += uint64(2 * LANES)
            j += 1
            if j == inner:
                k, j = after, 0
