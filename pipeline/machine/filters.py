"""The moving averages after interpolation, sample by sample, compiled.

A moving average of length T is exact for the straight line between samples, for any T >= 0:
with I the integral of the input since the motion began, (I(t) - I(t - T)) / T, where t - T may lie
between two samples.  A filter begins anew when a motion begins at a standstill.
"""

from pipeline.kernels import compiled

VALUE, INTEGRAL = 0, 1
"""What is remembered of each sample."""


def memory(length: float, period: float) -> int:
    """Samples that a filter of a length must remember."""
    return int(length / period) + 3


@compiled
def filtered(raw, rows, run, group, lengths, period, room, base, state, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the samples ``raw`` after two moving averages.

    Parameters
    ----------
    raw, out : (T, 6) array
        [m, rad].
    rows : (T,) array
        Row of each sample.
    run, group : (M,) arrays
        Which motion from standstill to standstill a row belongs to, and which filters it has.
    lengths : (2, 2) array
        T1 and T2 [s] by group.
    period : float
        [s].
    room : (2, R, 6, 2) array
        What the filters remember, R of :func:`memory`; kept from call to call.
    base : (2, 6) array
        Where the motion began, and the last sample [m, rad]; kept from call to call.
    state : (2,) array of int64
        The motion at hand (-1 before the first sample) and the number of samples; kept.
    """
    room.shape[1]
    for n in range(raw.shape[0]):
        row = rows[n]
        if run[row] != state[0]:
            _begin(raw, n, room, base, state)
            state[0] = run[row]
        state[1] += 1
        for i in range(6):
            base[1, i] = raw[n, i]
            value = raw[n, i] - base[0, i]
            for stage in range(2):
                value = _average(
                    room, stage, i, state[1], value, lengths[group[row], stage], period
                )
            out[n, i] = base[0, i] + value


@compiled
def _begin(raw, n, room, base, state):  # type: ignore[no-untyped-def]
    """Forget what was before: at a standstill the filters have run empty."""
    for i in range(6):
        base[0, i] = raw[n, i] if state[0] < 0 else base[1, i]
        for stage in range(2):
            for m in range(room.shape[1]):
                room[stage, m, i, VALUE] = 0.0
                room[stage, m, i, INTEGRAL] = 0.0


@compiled
def _average(room, stage, i, count, value, length, period):  # type: ignore[no-untyped-def]
    size = room.shape[1]
    here, before = count % size, (count - 1) % size
    integral = room[stage, before, i, INTEGRAL]
    integral += 0.5 * period * (room[stage, before, i, VALUE] + value)
    room[stage, here, i, VALUE] = value
    room[stage, here, i, INTEGRAL] = integral
    if length <= 0.0:
        return value
    whole = int(length / period)
    part = length / period - whole
    late, early = (count - whole) % size, (count - whole - 1) % size
    v_late, v_early = room[stage, late, i, VALUE], room[stage, early, i, VALUE]
    # of the cell that t - T lies in, what lies after it
    rest = period * (v_late * part + 0.5 * (v_early - v_late) * part * part)
    return (integral - room[stage, late, i, INTEGRAL] + rest) / length
