"""Servo drives of many individuals in SIMD lanes, and traces one by one, compiled.

Time is the outer loop, the axes within it, the lanes innermost; error statistics are accumulated in
passing.  All quantities lie in one array at constant distances: so the compiler sees that writing
one leaves the others alone, and takes the lanes together.
"""

from math import sqrt

from numpy import uint64

from pipeline.kernels import compiled
from pipeline.machine.axis.drive_step import (
    COMMAND,
    GREATEST_COMMAND,
    GREATEST_ERROR,
    LANES,
    LAST_REFERENCE,
    LAST_VELOCITY_REF,
    ROWS,
    SQUARE_COMMAND,
    SQUARE_ERROR,
    UNIT,
    V,
    X,
    in_widest_vectors,
    mechanics_step,
    prepare,
    servo_sample,
)

CHUNK = 16
"""Samples that are laid out at once: a value stored lane by lane is best not read at once."""
MAX_ERROR, RMS_ERROR, MAX_COMMAND, RMS_COMMAND = range(4)
"""Columns of the error statistics."""
_AXIS = uint64(ROWS * LANES)
_LOAD = uint64(LANES)


@compiled
def drive_errors(  # type: ignore[no-untyped-def]
    reference, load, table, start, first, last, period, inner, held, lanes, data, inputs, out
):
    """Fill ``out`` of shape (P, A, 4) for the individuals from ``first`` to before ``last``.

    ``reference`` has shape (1 or P, T, A), ``load`` (1 or P, 1 or T, A), ``table`` (P, A, columns)
    and ``start`` (P, A, 4); the servo samples ``inner`` times a ``period``, and the mechanics make
    ``held`` steps for each.  ``lanes`` is LANES: were it known to the compiler, that would unroll
    the loops over lanes and leave them in scalars.  Work arrays: ``data``, A * ROWS * LANES
    long, and ``inputs``, CHUNK * A * 2 * LANES; both best lie on whole lines of the cache.
    """
    samples, axes = reference.shape[1], reference.shape[2]
    each = period / inner
    own = reference.shape[0] > 1 or load.shape[0] > 1
    for block in range(first, last, LANES):
        for lane in range(LANES):
            # lanes that are left over repeat the last individual
            p = min(block + lane, last - 1)
            of = min(p, reference.shape[0] - 1)
            for a in range(axes):
                at = uint64(a) * _AXIS + uint64(lane)
                prepare(table[p, a], start[p, a], reference[of, 0, a], each, held, data, at)
        if own:
            _follow_own(reference, load, block, last, each, inner, held, lanes, data, inputs)
        else:
            _follow_one(reference[0], load[0], each, inner, held, lanes, data)
        for lane in range(min(LANES, last - block)):
            for a in range(axes):
                at = uint64(a) * _AXIS + uint64(lane)
                _report(data, at, samples * inner, out[block + lane, a])


@compiled
def _report(data, at, samples, out):  # type: ignore[no-untyped-def]
    unit = data[at + UNIT]
    out[MAX_ERROR] = data[at + GREATEST_ERROR]
    out[RMS_ERROR] = sqrt(data[at + SQUARE_ERROR] / samples)
    out[MAX_COMMAND] = data[at + GREATEST_COMMAND] / unit
    out[RMS_COMMAND] = sqrt(data[at + SQUARE_COMMAND] / samples) / unit


@compiled
def _follow_one(reference, load, period, inner, held, lanes, data):  # type: ignore[no-untyped-def]
    """All individuals follow one reference of shape (T, A), against one load."""
    in_widest_vectors()
    rate, part, half = 1.0 / period, 1.0 / inner, 0.5 * period / held
    loaded = 1 if load.shape[0] > 1 else 0
    for k in range(reference.shape[0]):
        after = min(k + 1, reference.shape[0] - 1)
        for j in range(inner):
            for a in range(reference.shape[1]):
                base = uint64(a) * _AXIS
                # the last reference is the same in all lanes: the first one keeps it
                r = reference[k, a] + (reference[after, a] - reference[k, a]) * (j * part)
                forward = (r - data[base + LAST_REFERENCE]) * rate
                ahead = (forward - data[base + LAST_VELOCITY_REF]) * rate
                data[base + LAST_REFERENCE], data[base + LAST_VELOCITY_REF] = r, forward
                push = load[loaded * k, a]
                for lane in range(lanes):
                    servo_sample(data, base + uint64(lane), r, forward, ahead)
                for _ in range(held):
                    for lane in range(lanes):
                        mechanics_step(data, base + uint64(lane), push, half)


@compiled
def _follow_own(reference, load, block, last, period, inner, held, lanes, data, inputs):  # type: ignore[no-untyped-def]
    """Each individual follows its own reference, or has its own load."""
    in_widest_vectors()
    rate, half = 1.0 / period, 0.5 * period / held
    samples, axes, loaded = reference.shape[1] * inner, reference.shape[2], load.shape[1] > 1
    for chunk in range(0, samples, CHUNK):
        many = min(CHUNK, samples - chunk)
        _lay_out(reference, block, last, chunk, many, inner, inputs, uint64(0))
        if loaded or chunk == 0:
            _lay_out(load, block, last, chunk, many, inner, inputs, _LOAD)
        for s in range(many):
            for a in range(axes):
                base, at = uint64(a) * _AXIS, uint64(s * axes + a) * uint64(2 * LANES)
                for lane in range(lanes):
                    i, r = base + uint64(lane), inputs[at + uint64(lane)]
                    forward = (r - data[i + LAST_REFERENCE]) * rate
                    ahead = (forward - data[i + LAST_VELOCITY_REF]) * rate
                    data[i + LAST_REFERENCE], data[i + LAST_VELOCITY_REF] = r, forward
                    servo_sample(data, i, r, forward, ahead)
                for _ in range(held):
                    for lane in range(lanes):
                        push = inputs[at + _LOAD + uint64(lane)]
                        mechanics_step(data, base + uint64(lane), push, half)


@compiled
def _lay_out(values, block, last, first, many, inner, inputs, row):  # type: ignore[no-untyped-def]
    """Lay out samples of the servo, on straight lines between those of ``values``; loads hold."""
    axes, part = values.shape[2], 0.0 if row == _LOAD else 1.0 / inner
    for lane in range(LANES):
        own = values[min(min(block + lane, last - 1), values.shape[0] - 1)]
        at = uint64(lane) + row
        if inner == 1 and values.shape[1] > 1:
            for k in range(first, first + many):
                for a in range(axes):
                    inputs[at] = own[k, a]
                    at += uint64(2 * LANES)
            continue
        k, j = min(first // inner, values.shape[1] - 1), first % inner
        for _ in range(many):
            after = min(k + 1, values.shape[1] - 1)
            for a in range(axes):
                inputs[at] = own[k, a] + (own[after, a] - own[k, a]) * (j * part)
                at += uint64(2 * LANES)
            j += 1
            if j == inner:
                k, j = after, 0


@compiled
def drive_traces(  # type: ignore[no-untyped-def]
    reference, load, table, start, period, inner, held, data, begun, position, velocity, command
):
    """Fill position, velocity and command, shape (P, T), at the samples of the reference.

    ``reference`` has shape (T,), ``load`` (1 or T,), ``table`` (P, columns) and ``start`` (P, 4);
    the work array ``data`` is ROWS * LANES long.  Where it has ``begun``, the samples follow those
    that left ``data`` as it is.
    """
    each = period / inner
    loaded = 1 if load.shape[0] > 1 else 0
    for p in range(table.shape[0]):
        if not begun:
            prepare(table[p], start[p], reference[0], each, held, data, 0)
        for k in range(reference.shape[0]):
            here, after = reference[k], reference[min(k + 1, reference.shape[0] - 1)]
            position[p, k], velocity[p, k] = data[X], data[V]
            for j in range(inner):
                r = here + (after - here) * (j / inner)
                forward = (r - data[LAST_REFERENCE]) / each
                ahead = (forward - data[LAST_VELOCITY_REF]) / each
                data[LAST_REFERENCE], data[LAST_VELOCITY_REF] = r, forward
                servo_sample(data, 0, r, forward, ahead)
                if j == 0:
                    command[p, k] = data[COMMAND] / data[UNIT]
                for _ in range(held):
                    mechanics_step(data, 0, load[loaded * k], 0.5 * each / held)
