"""Stability limit of milling by semi-discretisation with impulses; compiled.

The window in which teeth cut is divided into R cells.  Within a cell the force acts as one impulse
at its middle, the exact integral of the directional matrix over the cell times the regeneration
u - u_old there; between two middles the modes vibrate freely, which has a closed form.  This is
Strang's splitting: the error of the spectral radius falls with the square of the cell, and a pass
of a tooth period costs a few dozen operations a cell, whatever the number of modes.

The state is that of the modes (q and q' / w_n of each), then the tip's displacement at the R
middles one tooth period ago, D directions each.  The leading eigenvalue of the period's map comes
from a Krylov space, whose Hessenberg matrix is squared until its norm says how fast it grows.
"""

from math import cos, exp, inf, log, pi, sin, sqrt
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled

_STRAIGHT = 1e-6
"""Lag [rad] below which an edge counts as straight."""
_SQUARINGS = 18
"""Number of squarings of the Hessenberg matrix: its norm's growth is exact to 1 / 2^17."""
_FAR = 30.0
"""Logarithm of a norm beyond which the growth's sign is certain."""
_SETTLED = 1e-6
"""Change of the growth for each period between two squarings below which it is taken."""


_CLEAR = 0.2
"""Decay over that without a cut which is far enough from chatter that few cells will do."""


class Cut(NamedTuple):
    """A cut as the kernel takes it: coefficients [N/m^2], angles [rad], lag [rad/m]."""

    K_tc: float
    K_rc: float
    entry: float
    exit: float
    pitch: float
    lag: float
    turned: np.ndarray  # (2, D): machine's directions with modes, in the cut's frame


class Tip(NamedTuple):
    """The modes as the kernel takes them, (M,) each."""

    omega: np.ndarray
    zeta: np.ndarray
    mass: np.ndarray
    axis: np.ndarray  # among the D directions that give way


class Work(NamedTuple):
    """Arrays to work in, for K dimensions of the Krylov space."""

    weight: np.ndarray  # (R, D, D)
    edge: np.ndarray  # (2, 3)
    drift: np.ndarray  # (2, M, 4)
    tip: np.ndarray  # (2, D)
    start: np.ndarray  # (n,)
    basis: np.ndarray  # (K + 1, n)
    hessenberg: np.ndarray  # (K, K)
    square: np.ndarray  # (2, K, K)


@compiled
def _once(entry, exit, phi, factor, out):  # type: ignore[no-untyped-def]
    """Add ``factor`` times the integrals of sin cos, sin^2, cos^2 of a tooth in cut up to phi."""
    phi = min(max(phi, entry), exit)
    wave = (sin(2.0 * phi) - sin(2.0 * entry)) / 4.0
    half = (phi - entry) / 2.0
    out[0] += factor * (sin(phi) ** 2 - sin(entry) ** 2) / 2.0
    out[1] += factor * (half - wave)
    out[2] += factor * (half + wave)


@compiled
def _twice(entry, exit, phi, factor, out):  # type: ignore[no-untyped-def]
    """Add ``factor`` times the integral of :func:`_once` up to phi."""
    if phi <= entry:
        return
    at = min(phi, exit)
    span = at - entry
    s0, c0 = sin(2.0 * entry), cos(2.0 * entry)
    s1, c1 = sin(2.0 * at), cos(2.0 * at)
    square = (at * at - entry * entry) / 4.0
    wave = (c1 - c0) / 8.0
    out[0] += factor * (span / 4.0 - (s1 - s0) / 8.0 - span * sin(entry) ** 2 / 2.0)
    out[1] += factor * (square + wave - span * (entry / 2.0 - s0 / 4.0))
    out[2] += factor * (square - wave - span * (entry / 2.0 + s0 / 4.0))
    if phi > exit:
        _once(entry, exit, exit, factor * (phi - exit), out)


@compiled
def fill_weights(cut, depth, cells, work):  # type: ignore[no-untyped-def]
    """Fill the integrals of A over the cells [N/m^2 rad]; the window's width [rad]."""
    lag = cut.lag * depth
    width = cut.exit - cut.entry + lag
    window = min(width, cut.pitch)
    many = work.tip.shape[1]
    teeth = int(width / cut.pitch) + 2
    for i in range(cells + 1):
        after = work.edge[i % 2]
        for k in range(3):
            after[k] = 0.0
        for tooth in range(teeth):
            phi = cut.entry + window * i / cells + tooth * cut.pitch
            if lag < _STRAIGHT:
                _once(cut.entry, cut.exit, phi, 1.0, after)
            else:
                _twice(cut.entry, cut.exit, phi, 1.0 / lag, after)
                _twice(cut.entry, cut.exit, phi - lag, -1.0 / lag, after)
        if i == 0:
            continue
        before = work.edge[(i + 1) % 2]
        sc, ss, cc = after[0] - before[0], after[1] - before[1], after[2] - before[2]
        xx, xy = -cut.K_tc * sc - cut.K_rc * ss, -cut.K_tc * cc - cut.K_rc * sc
        yx, yy = cut.K_tc * ss - cut.K_rc * sc, cut.K_tc * sc - cut.K_rc * cc
        for r in range(many):
            a, b = cut.turned[0, r], cut.turned[1, r]
            for c in range(many):
                x, y = cut.turned[0, c], cut.turned[1, c]
                work.weight[i - 1, r, c] = a * (xx * x + xy * y) + b * (yx * x + yy * y)
    return window


@compiled
def _fill_drift(tip, time, out):  # type: ignore[no-untyped-def]
    """Fill the free vibration of each mode over ``time`` [s], (M, 4)."""
    for j in range(tip.omega.shape[0]):
        zeta = tip.zeta[j]
        share = sqrt(1.0 - zeta * zeta)
        decay = exp(-zeta * tip.omega[j] * time)
        c, s = cos(share * tip.omega[j] * time) * decay, sin(share * tip.omega[j] * time) * decay
        s /= share
        out[j, 0], out[j, 1] = c + zeta * s, s
        out[j, 2], out[j, 3] = -s, c - zeta * s


@compiled
def pass_period(tip, gain, cells, work, state, out):  # type: ignore[no-untyped-def]
    """Fill ``out`` with the state one tooth period after ``state``."""
    modes, many = tip.omega.shape[0], work.tip.shape[1]
    u, gap = work.tip[0], work.tip[1]
    size = 2 * modes
    for r in range(size):
        out[r] = state[r]
    for i in range(cells):
        at = size + i * many
        for d in range(many):
            u[d] = 0.0
        for j in range(modes):
            u[tip.axis[j]] += out[2 * j]
        for d in range(many):
            gap[d] = u[d] - state[at + d]
            out[at + d] = u[d]
        drift = work.drift[1 if i == cells - 1 else 0]
        for j in range(modes):
            force = 0.0
            for d in range(many):
                force += work.weight[i, tip.axis[j], d] * gap[d]
            q = out[2 * j]
            p = out[2 * j + 1] + gain / (tip.mass[j] * tip.omega[j]) * force
            out[2 * j] = drift[j, 0] * q + drift[j, 1] * p
            out[2 * j + 1] = drift[j, 2] * q + drift[j, 3] * p


@compiled
def fill_period(tip, cut, n, depth, cells, work):  # type: ignore[no-untyped-def]
    """Fill the impulses and the free vibrations of one tooth period."""
    window = fill_weights(cut, depth, cells, work)
    cell = window / cells / (2.0 * pi * n)
    _fill_drift(tip, cell, work.drift[0])
    _fill_drift(tip, cut.pitch / (2.0 * pi * n) - (cells - 1) * cell, work.drift[1])


@compiled
def _orthonormal(basis, hessenberg, k, many):  # type: ignore[no-untyped-def]
    """Step k of Arnoldi: length left of row k + 1 at right angles to those before; 0 if none."""
    row = basis[k + 1]
    before, rest = 0.0, 0.0
    for c in range(many):
        before += row[c] ** 2
    if not before < inf:
        return inf
    for _ in range(2):  # twice is enough for right angles to rounding
        for j in range(k + 1):
            along = 0.0
            for c in range(many):
                along += basis[j, c] * row[c]
            hessenberg[j, k] += along
            for c in range(many):
                row[c] -= along * basis[j, c]
    for c in range(many):
        rest += row[c] ** 2
    if rest <= 1e-28 * before:
        return 0.0
    rest = sqrt(rest)
    for c in range(many):
        row[c] /= rest
    return rest


@compiled
def growth(tip, cut, n, depth, cells, work):  # type: ignore[no-untyped-def]
    """Logarithm of the spectral radius of one tooth period; its sign where it is far from 0.

    Spindle speed ``n`` [1/s], a_p = ``depth`` [m], ``cells`` R; ``work`` holds work arrays.
    """
    fill_period(tip, cut, n, depth, cells, work)
    gain = depth / (2.0 * pi * n)
    many = 2 * tip.omega.shape[0] + cells * work.tip.shape[1]
    basis, hessenberg = work.basis, work.hessenberg
    size = hessenberg.shape[0]
    norm = 0.0
    for c in range(many):
        norm += work.start[c] ** 2
    norm = sqrt(norm)
    for c in range(many):
        basis[0, c] = work.start[c] / norm
    for r in range(size):
        for c in range(size):
            hessenberg[r, c] = 0.0
    for k in range(size):
        pass_period(tip, gain, cells, work, basis[k], basis[k + 1])
        left = _orthonormal(basis, hessenberg, k, many)
        if not left < inf:
            return inf
        if left == 0.0:
            size = k + 1
            break
        if k + 1 < size:
            hessenberg[k + 1, k] = left
    return _spectral(hessenberg, size, work.square)


@compiled
def _norm(matrix, size):  # type: ignore[no-untyped-def]
    total = 0.0
    for r in range(size):
        for c in range(size):
            total += matrix[r, c] ** 2
    return sqrt(total)


@compiled
def _fill_square(matrix, size, norm, out):  # type: ignore[no-untyped-def]
    """Divide ``matrix`` by its norm, and fill ``out`` with its square."""
    for r in range(size):
        for c in range(size):
            matrix[r, c] /= norm
            out[r, c] = 0.0
    for r in range(size):
        for m in range(size):
            left = matrix[r, m]
            for c in range(size):
                out[r, c] += left * matrix[m, c]


@compiled
def _spectral(matrix, size, square):  # type: ignore[no-untyped-def]
    """Logarithm of the spectral radius by squaring: that of its power's norm over the power."""
    scale, last, before = 0.0, 0.0, 0.0  # log of what was taken out; of the norm before
    for r in range(size):
        for c in range(size):
            square[0, r, c] = matrix[r, c]
    power = 1.0
    for k in range(_SQUARINGS):
        here, there = square[k % 2], square[(k + 1) % 2]
        norm = _norm(here, size)
        if norm == 0.0:
            return -inf
        total = scale + log(norm)
        value = (total - last) / (power / 2.0) if k else total
        # far away the sign is all that counts; close by the growth settles
        if k > 2 and abs(total) > _FAR and abs(value - before) < 0.02 * abs(value):
            return value
        if k > 6 and abs(value - before) < _SETTLED:
            return value
        last, before = total, value
        _fill_square(here, size, norm, there)
        scale = 2.0 * total
        power *= 2.0
    return before


@compiled
def _crossing(tip, cut, n, stable, not_stable, cells, tolerance, work):  # type: ignore[no-untyped-def]
    """Depth where the growth is 0, by two depths with their growths: Illinois' rule."""
    (low, at_low), (high, at_high) = stable, not_stable
    side = 0
    for _ in range(40):
        if high - low <= tolerance * high:
            break
        share = at_low / (at_low - at_high) if at_low > -inf and at_high < inf else 0.5
        share = min(max(share, 0.02), 0.98)
        middle = low + share * (high - low)
        value = growth(tip, cut, n, middle, cells, work)
        if value > 0.0:
            high, at_high = middle, value
            at_low *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            low, at_low = middle, value
            at_high *= 0.5 if side == -1 else 1.0
            side = -1
        if abs(value) < 1e-7:
            return middle
    return (low + high) / 2.0


@compiled
def _first(tip, cut, n, least, highest, ratio, cells, tolerance, work):  # type: ignore[no-untyped-def]
    """Least depth of chatter from ``least`` to ``highest`` [m], inf without one; greatest growth.

    The depths grow by ``ratio``; a hump of the growth between them is climbed.
    """
    before, at_before = 0.0, -inf
    here = min(least, highest)
    at_here = growth(tip, cut, n, here, cells, work)
    while at_here > 0.0 and here > least * 1e-3:  # it was no bound: go down
        before, at_before = here, at_here
        here /= 2.0
        at_here = growth(tip, cut, n, here, cells, work)
        if at_here <= 0.0:
            low, high = (here, at_here), (before, at_before)
            return _crossing(tip, cut, n, low, high, cells, tolerance, work), 0.0
    most = at_here
    while here < highest:
        there = min(here * ratio, highest)
        at_there = growth(tip, cut, n, there, cells, work)
        if at_there > 0.0:
            low, high = (here, at_here), (there, at_there)
            return _crossing(tip, cut, n, low, high, cells, tolerance, work), 0.0
        if at_here >= at_before and at_here >= at_there and before > 0.0:
            begin, end = before, there
            for _ in range(8):  # golden section
                one, two = begin + 0.382 * (end - begin), begin + 0.618 * (end - begin)
                at_one = growth(tip, cut, n, one, cells, work)
                at_two = growth(tip, cut, n, two, cells, work) if at_one <= 0.0 else 0.0
                if at_one > 0.0 or at_two > 0.0:
                    high = (one, at_one) if at_one > 0.0 else (two, at_two)
                    low = (before, at_before)
                    return _crossing(tip, cut, n, low, high, cells, tolerance, work), 0.0
                most = max(most, at_one, at_two)
                if at_one > at_two:
                    end = two
                else:
                    begin = one
                if end - begin < 0.01 * end:
                    break
        before, at_before = here, at_here
        here, at_here = there, at_there
        most = max(most, at_here)
    return inf, most


@compiled
def _near(tip, cut, n, before, cells, tolerance, work):  # type: ignore[no-untyped-def]
    """Depth limit close to that of fewer cells; inf when it is not there."""
    for reach in (0.01, 0.04, 0.12):
        low, high = before * (1.0 - reach), before * (1.0 + reach)
        at_low = growth(tip, cut, n, low, cells, work)
        if at_low > 0.0:
            continue
        at_high = growth(tip, cut, n, high, cells, work)
        if at_high > 0.0:
            return _crossing(tip, cut, n, (low, at_low), (high, at_high), cells, tolerance, work)
    return inf


@compiled
def first_limits(tip, cut, work, speeds, cells, depths, tolerance, out, error, last):  # type: ignore[no-untyped-def]
    """Fill ``out``, shape (S,), with the least depth of chatter at each speed [m]; inf without one.

    ``cells`` are those to begin with; they are doubled as long as ``work`` holds them, until the
    limit stays within the share ``tolerance``.  ``depths`` are least and greatest depth of the
    search [m], and the ratio of neighbouring ones.  ``error`` and ``last`` (S,) are filled with the
    estimated error before extrapolation over the limit, and the cells.
    """
    least, highest, ratio = depths
    exact = 0.05 * tolerance
    for s in range(speeds.shape[0]):
        many = cells
        coarse, most = _first(tip, cut, speeds[s], least, highest, ratio, many, exact, work)
        out[s], error[s] = coarse, inf
        free = inf  # decay of a mode in a tooth period without a cut
        for j in range(tip.omega.shape[0]):
            free = min(free, tip.zeta[j] * tip.omega[j] * cut.pitch / (2.0 * pi * speeds[s]))
        if coarse == inf and most < -_CLEAR * free:
            error[s], last[s] = 0.0, many
            continue
        while 2 * many <= work.weight.shape[0]:
            many *= 2
            fine = inf
            if coarse < inf:
                fine = _near(tip, cut, speeds[s], coarse, many, exact, work)
            if fine == inf:
                fine, _ = _first(tip, cut, speeds[s], least, highest, ratio, many, exact, work)
            if fine == coarse:  # both without limit
                out[s], error[s] = fine, 0.0
                break
            if fine < inf and coarse < inf:
                off = (fine - coarse) / 3.0
                out[s], error[s] = fine + off, abs(off) / fine
            else:
                out[s], error[s] = fine, inf
            if error[s] <= tolerance:
                break
            coarse = fine
        last[s] = many
