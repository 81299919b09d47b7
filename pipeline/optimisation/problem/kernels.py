"""Compiled loops: times, loads and limits of a population, loads inverted, draws of a part.

Rows of a cut and a spindle drive are passed as arrays whose columns are named here.

Row: path length [m] and teeth / 60; scale and exponent of the load table; wear a second of motion,
at which speed [rev/min] and feed for each tooth [m], and the exponents of both; price of a tool
life; share of the row in the material; power that is always on, and that of the drives while axes
move [W]; least and greatest feed for each tooth [m], F [mm/min], S [rev/min]; [mm/min] in one unit
of F, 0 where F is not limited; 1 where the row cuts.

Drive: rated power that may be taken, below and above the base speed [W]; base and top speed [1/s];
efficiency, and that with the motor's; coefficients of the no-load power [W, W s, ...].

``loads`` of shape (2, M, K + 1) are the mean torque over block and turn, and that of the hardest
station over a turn, at the nodes of the load table.  Between its nodes, at u = 0, 1, 4, 9, ... with
u = scale f_z^exponent, the table is straight, so that it is inverted exactly; see
:mod:`pipeline.cutting.force.profile_kernel`.
"""

from math import inf, pi, sqrt

from pipeline.kernels import compiled
from pipeline.machine.control.path import Motion

COLUMNS = 21
(
    LENGTH, TEETH, SCALE, EXPONENT, WEAR, SPEED, FEED, SPEED_POWER, FEED_POWER, LIFE, INSIDE,
    STEADY, MOVING, LOW, HIGH, FEED_LOW, FEED_HIGH, SPEED_LOW, SPEED_HIGH, FEED_UNIT, CUTS,
) = range(COLUMNS)  # fmt: skip
POWER_BELOW, POWER_ABOVE, BASE, TOP, EFFICIENCY, SUPPLY, IDLE = range(7)


NEAR = 1e-9
"""Share that a limit may be passed by and count as kept: rounding."""
_PER_TURN = int(Motion.PER_TURN)


@compiled
def row_values(time, wait, speed, rows, loads, drive, prices, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (4, P, M): time [s], cost, electricity [J], share of tool life.

    ``time`` and ``wait`` [s] have shape (P, M), ``speed`` [rev/min] (1 or P, M); ``prices`` are
    those of a second and of a joule.
    """
    for p in range(time.shape[0]):
        for k in range(time.shape[1]):
            n = speed[min(p, speed.shape[0] - 1), k]
            wear, energy = _wear_and_energy(time[p, k], wait[p, k], n, rows[k], loads[0, k], drive)
            spent = time[p, k] + wait[p, k]
            out[0, p, k] = spent
            out[1, p, k] = spent * prices[0] + wear * rows[k, LIFE] + energy * prices[1]
            out[2, p, k] = energy
            out[3, p, k] = wear


@compiled
def sums(time, wait, speed, rows, loads, drive, prices, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P, 4) with the sums over all rows of :func:`row_values`."""
    for p in range(time.shape[0]):
        spent, cost, joules, worn = 0.0, 0.0, 0.0, 0.0
        for k in range(time.shape[1]):
            n = speed[min(p, speed.shape[0] - 1), k]
            wear, energy = _wear_and_energy(time[p, k], wait[p, k], n, rows[k], loads[0, k], drive)
            spent += time[p, k] + wait[p, k]
            cost += wear * rows[k, LIFE]
            joules += energy
            worn += wear
        out[p, 0], out[p, 2], out[p, 3] = spent, joules, worn
        out[p, 1] = spent * prices[0] + cost + joules * prices[1]


@compiled
def _wear_and_energy(time, wait, speed, row, loads, drive):  # type: ignore[no-untyped-def]
    wear, energy = 0.0, (time + wait) * row[STEADY] + time * row[MOVING]
    n = speed / 60.0
    if drive.shape[0] > 0 and speed > 0.0:
        energy += (time + wait) * _idle(n, drive) / drive[SUPPLY]
    if row[CUTS] == 0.0 or not time > 0.0 or not speed > 0.0:
        return wear, energy
    f_z = row[LENGTH] / time / (speed * row[TEETH])
    if row[WEAR] != 0.0:
        wear = time * row[WEAR] * (speed / row[SPEED]) ** row[SPEED_POWER]
        if row[FEED_POWER] != 0.0:
            wear *= (f_z / row[FEED]) ** row[FEED_POWER]
    if drive.shape[0] > 0:
        torque = looked_up(f_z, loads, row[SCALE], row[EXPONENT])
        energy += time * row[INSIDE] * 2.0 * pi * n * torque / drive[SUPPLY]
    return wear, energy


@compiled
def violations(motion, factor, cap, feed, speed, rows, loads, drive, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P,): excess over each limit, as a share of it, summed over rows."""
    for p in range(feed.shape[0]):
        total = 0.0
        for k in range(feed.shape[1]):
            row = rows[k]
            n = speed[min(p, speed.shape[0] - 1), k]
            f = feed[p, k] * (n if motion[k] == _PER_TURN else 1.0)
            if row[FEED_UNIT] > 0.0:
                total += _outside(f * row[FEED_UNIT], row[FEED_LOW], row[FEED_HIGH])
            total += _outside(n, row[SPEED_LOW], row[SPEED_HIGH])
            if row[CUTS] == 0.0 or not n > 0.0:
                continue
            f_z = min(f * factor[k], cap[k]) / (n * row[TEETH])
            total += _outside(f_z, row[LOW], row[HIGH])
            if drive.shape[0] > 0:
                torque = looked_up(f_z, loads[1, k], row[SCALE], row[EXPONENT])
                total += _beyond(power_share(torque, n / 60.0, drive))
        out[p] = total


@compiled
def power_share(torque, n, drive):  # type: ignore[no-untyped-def]
    """Motor power for a cutting torque [N m] at ``n`` [1/s] over what is allowed [1]."""
    demanded = (2.0 * pi * n * torque + _idle(n, drive)) / drive[EFFICIENCY]
    if n < drive[BASE]:
        return demanded / (drive[POWER_BELOW] * n / drive[BASE])
    return demanded / drive[POWER_ABOVE]


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
def looked_up(f_z, values, scale, exponent):  # type: ignore[no-untyped-def]
    """Interpolated loads, by :func:`pipeline.cutting.force.profile_kernel.look_up`."""
    if not f_z > 0.0:
        return 0.0
    u = scale * (f_z if exponent == 1.0 else f_z**exponent)
    k = int(min(sqrt(u), values.shape[0] - 2.0))
    return values[k] + (u - k * k) / (2 * k + 1) * (values[k + 1] - values[k])


@compiled
def first_crossings(limit, values, scale, exponent, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` of shape (P, M), the greatest f_z [m] up to which loads stay within ``limit``.

    ``limit`` has shape (P, M), ``values`` (M, K + 1), ``scale`` and ``exponent`` (M,).  It is 0
    where any feed passes the limit and infinite where none does.
    """
    for p in range(limit.shape[0]):
        for m in range(limit.shape[1]):
            u = _first_crossing(limit[p, m], values[m])
            out[p, m] = (u / scale[m]) ** (1.0 / exponent[m]) if u < inf else inf


@compiled
def _first_crossing(limit, values):  # type: ignore[no-untyped-def]
    if not values[0] <= limit:
        return 0.0
    last = values.shape[0] - 2
    for k in range(last + 1):
        if values[k + 1] > limit:
            share = (limit - values[k]) / (values[k + 1] - values[k])
            return k * k + share * (2 * k + 1)
    rise = values[last + 1] - values[last]
    if not rise > 0.0:
        return inf
    return last * last + (limit - values[last]) / rise * (2 * last + 1)


HALVINGS = 40
LEAST = 1e-9
"""Least feed as a share of the greatest one, below which it counts as none [1]."""


@compiled
def feeds_within(  # type: ignore[no-untyped-def]
    limit, most, curve, scale, exponent, weight, group, nodes, changes, out
):
    """Fill ``out`` (Q,): feed up to which each load and its change stay within ``limit``.

    ``most`` (Q,) bounds it, ``changes`` (C, K) are those of the classes at ``nodes``.
    """
    for q in range(group.shape[0]):
        c, low, high = group[q], 0.0, most[q]
        for k in range(nodes.shape[1]):
            feed = min(nodes[c, k], most[q])
            high = feed
            load = looked_up(feed, curve[q], scale[q], exponent[q])
            if load + weight[q] * _between(feed, nodes[c], changes[c]) > limit:
                break
            low = feed
        for _ in range(HALVINGS if high > low else 0):
            middle = 0.5 * (low + high)
            load = looked_up(middle, curve[q], scale[q], exponent[q])
            if load + weight[q] * _between(middle, nodes[c], changes[c]) > limit:
                high = middle
            else:
                low = middle
        out[q] = low if low > LEAST * most[q] else 0.0


@compiled
def peak_loads(  # type: ignore[no-untyped-def]
    f_z, curve, scale, exponent, weight, group, nodes, expected, values, first, out
):
    """Fill ``out`` of shape (D,), the part's greatest load in each draw [N].

    ``expected`` of shape (C, K) and ``values`` of (C, K, first + D or more) are the loads of the
    classes at ``nodes``; ``first`` is the first draw that counts.
    """
    for q in range(group.shape[0]):
        feed, c = f_z[q], group[q]
        if feed <= 0.0:
            continue
        k = _node(feed, nodes[c])
        share = _share(feed, nodes[c], k)
        here, after = values[c, k], values[c, k + 1]
        rest = looked_up(feed, curve[q], scale[q], exponent[q])
        rest -= weight[q] * _between(feed, nodes[c], expected[c])
        for d in range(out.shape[0]):
            drawn = here[first + d] + share * (after[first + d] - here[first + d])
            out[d] = max(out[d], rest + weight[q] * drawn)


@compiled
def _between(feed, nodes, values):  # type: ignore[no-untyped-def]
    k = _node(feed, nodes)
    return values[k] + _share(feed, nodes, k) * (values[k + 1] - values[k])


@compiled
def _node(feed, nodes):  # type: ignore[no-untyped-def]
    k = 0
    while k < nodes.shape[0] - 2 and nodes[k + 1] < feed:
        k += 1
    return k


@compiled
def _share(feed, nodes, k):  # type: ignore[no-untyped-def]
    """Interpolation share between two nodes; what is outside of them takes the nearest."""
    gap = nodes[k + 1] - nodes[k]
    return min(max((feed - nodes[k]) / gap, 0.0), 1.0) if gap > 0.0 else 0.0
