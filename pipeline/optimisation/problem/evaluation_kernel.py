"""What a population's times, feeds and speeds make of the rows of a cut, compiled.

Rows and drive have the columns of :mod:`pipeline.optimisation.problem.columns`; ``loads`` of shape
(2, M, K + 1) are the mean torque over block and turn, and that of the hardest station over a turn,
at the nodes of the load table.
"""

from math import pi, sqrt

from pipeline.kernels import compiled
from pipeline.machine.control.path import Motion
from pipeline.optimisation.problem.columns import (
    BASE,
    CUTS,
    EFFICIENCY,
    EXPONENT,
    FEED,
    FEED_HIGH,
    FEED_LOW,
    FEED_POWER,
    FEED_UNIT,
    HIGH,
    IDLE,
    INSIDE,
    LENGTH,
    LIFE,
    LOW,
    MOVING,
    POWER_ABOVE,
    POWER_BELOW,
    SCALE,
    SPEED,
    SPEED_HIGH,
    SPEED_LOW,
    SPEED_POWER,
    STEADY,
    SUPPLY,
    TEETH,
    WEAR,
)  # fmt: skip

NEAR = 1e-9
"""Share that a limit may be passed by and count as kept: rounding."""
_PER_TURN = int(Motion.PER_TURN)


@compiled
def row_values(time, wait, turns, rows, loads, drive, prices, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (4, P, M): time [s], cost, electricity [J], share of tool life.

    ``time`` and ``wait`` [s] have shape (P, M), ``turns`` [rev/min] (1 or P, M); ``prices`` are
    those of a second and of a joule.
    """
    for p in range(time.shape[0]):
        for k in range(time.shape[1]):
            n = turns[min(p, turns.shape[0] - 1), k]
            wear, energy = _wear_and_energy(time[p, k], wait[p, k], n, rows[k], loads[0, k], drive)
            spent = time[p, k] + wait[p, k]
            out[0, p, k] = spent
            out[1, p, k] = spent * prices[0] + wear * rows[k, LIFE] + energy * prices[1]
            out[2, p, k] = energy
            out[3, p, k] = wear


@compiled
def sums(time, wait, turns, rows, loads, drive, prices, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P, 4) with the sums over all rows of :func:`row_values`."""
    for p in range(time.shape[0]):
        spent, cost, joules, worn = 0.0, 0.0, 0.0, 0.0
        for k in range(time.shape[1]):
            n = turns[min(p, turns.shape[0] - 1), k]
            wear, energy = _wear_and_energy(time[p, k], wait[p, k], n, rows[k], loads[0, k], drive)
            spent += time[p, k] + wait[p, k]
            cost += wear * rows[k, LIFE]
            joules += energy
            worn += wear
        out[p, 0], out[p, 2], out[p, 3] = spent, joules, worn
        out[p, 1] = spent * prices[0] + cost + joules * prices[1]


@compiled
def _wear_and_energy(time, wait, turns, row, loads, drive):  # type: ignore[no-untyped-def]
    wear, energy = 0.0, (time + wait) * row[STEADY] + time * row[MOVING]
    n = turns / 60.0
    if drive.shape[0] > 0 and turns > 0.0:
        energy += (time + wait) * _idle(n, drive) / drive[SUPPLY]
    if row[CUTS] == 0.0 or not time > 0.0 or not turns > 0.0:
        return wear, energy
    f_z = row[LENGTH] / time / (turns * row[TEETH])
    if row[WEAR] != 0.0:
        wear = time * row[WEAR] * (turns / row[SPEED]) ** row[SPEED_POWER]
        if row[FEED_POWER] != 0.0:
            wear *= (f_z / row[FEED]) ** row[FEED_POWER]
    if drive.shape[0] > 0:
        torque = _looked_up(f_z, loads, row[SCALE], row[EXPONENT])
        energy += time * row[INSIDE] * 2.0 * pi * n * torque / drive[SUPPLY]
    return wear, energy


@compiled
def violations(motion, factor, cap, feed, turns, rows, loads, drive, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P,): what passes each limit, as a share of it, summed over rows.

    Feed for each tooth against its bounds, motor power, F and S against their ranges.
    """
    for p in range(feed.shape[0]):
        total = 0.0
        for k in range(feed.shape[1]):
            row = rows[k]
            n = turns[min(p, turns.shape[0] - 1), k]
            f = feed[p, k] * (n if motion[k] == _PER_TURN else 1.0)
            if row[FEED_UNIT] > 0.0:
                total += _outside(f * row[FEED_UNIT], row[FEED_LOW], row[FEED_HIGH])
            total += _outside(n, row[SPEED_LOW], row[SPEED_HIGH])
            if row[CUTS] == 0.0 or not n > 0.0:
                continue
            f_z = min(f * factor[k], cap[k]) / (n * row[TEETH])
            total += _outside(f_z, row[LOW], row[HIGH])
            if drive.shape[0] > 0:
                torque = _looked_up(f_z, loads[1, k], row[SCALE], row[EXPONENT])
                total += _beyond(power_share(torque, n / 60.0, drive))
        out[p] = total


@compiled
def power_share(torque, n, drive):  # type: ignore[no-untyped-def]
    """Motor's power for a cut's torque [N m] at ``n`` [1/s] over what is allowed [1]."""
    asked = (2.0 * pi * n * torque + _idle(n, drive)) / drive[EFFICIENCY]
    if n < drive[BASE]:
        return asked / (drive[POWER_BELOW] * n / drive[BASE])
    return asked / drive[POWER_ABOVE]


@compiled
def _outside(value, low, high):  # type: ignore[no-untyped-def]
    if value < low:
        return _beyond(low / max(value, NEAR * low))
    return _beyond(value / high) if value > high else 0.0


@compiled
def _beyond(ratio):  # type: ignore[no-untyped-def]
    return ratio - 1.0 if ratio > 1.0 + NEAR else 0.0


@compiled
def _idle(n, drive):  # type: ignore[no-untyped-def]
    power = 0.0
    for i in range(drive.shape[0] - 1, IDLE - 1, -1):
        power = power * n + drive[i]
    return max(power, 0.0)


@compiled
def _looked_up(f_z, values, scale, exponent):  # type: ignore[no-untyped-def]
    """As :func:`pipeline.cutting.force.profile_kernel.look_up`."""
    if not f_z > 0.0:
        return 0.0
    u = scale * (f_z if exponent == 1.0 else f_z**exponent)
    k = int(min(sqrt(u), values.shape[0] - 2.0))
    return values[k] + (u - k * k) / (2 * k + 1) * (values[k + 1] - values[k])
