"""Stability lobes, margins and the map of one tooth period, compiled.

A segment of the stability boundary lies between two neighbouring chatter frequencies: ``omega``
[rad/s] and ``share`` (phase of the regeneration over a turn, less whole waves, 0 to 1) at its two
ends, ``inverse`` = 1 / depth [1/m] there, all of shape (G, 2) and straight between.  Lobe k has
k whole waves within a tooth period.

The state of one tooth period is that of the modes (displacement q and q' / w_n of each), then the
tip's displacement at the ends of the steps while the tooth before cut.
"""

from math import ceil, floor, inf, nan, pi, sqrt

from pipeline.kernels import compiled

_TURN = 2.0 * pi


@compiled
def lowest_lobes(omega, share, inverse, period, out, chatter):  # type: ignore[no-untyped-def]
    """Fill the greatest 1 / depth of all lobes at each tooth period, and its frequency [rad/s].

    Parameters
    ----------
    omega, share, inverse : ndarray, shape (G, 2)
        Segments of the boundary.
    period : ndarray, shape (S,)
        Tooth period [s].
    out, chatter : ndarray, shape (S,)
        Filled; 0 and nan where there is no lobe.
    """
    for s in range(period.shape[0]):
        out[s] = 0.0
        chatter[s] = nan
        for g in range(omega.shape[0]):
            if inverse[g, 0] <= out[s] and inverse[g, 1] <= out[s]:
                continue
            first = omega[g, 0] * period[s] / _TURN - share[g, 0]
            last = omega[g, 1] * period[s] / _TURN - share[g, 1]
            k = max(ceil(min(first, last)), 0)
            while k <= max(first, last):
                along = (k - first) / (last - first) if last != first else 0.0
                value = inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0])
                if value > out[s]:
                    out[s] = value
                    chatter[s] = omega[g, 0] + along * (omega[g, 1] - omega[g, 0])
                k += 1


@compiled
def lobes_in_cells(omega, share, inverse, flutes, lowest, width, out):  # type: ignore[no-untyped-def]
    """Raise ``out``, shape (C,), to the greatest 1 / depth of all lobes within each cell of speed.

    Cell c reaches from ``lowest`` + c ``width`` to the next one [1/s].
    """
    cells = out.shape[0]
    highest = lowest + cells * width
    for g in range(omega.shape[0]):
        if inverse[g, 0] <= 0.0 and inverse[g, 1] <= 0.0:
            continue
        k = 0
        while True:
            # periods at the ends, and between them as good as straight
            first = _TURN * (k + share[g, 0]) / omega[g, 0]
            last = _TURN * (k + share[g, 1]) / omega[g, 1]
            k += 1
            long, short = max(first, last) * flutes, min(first, last) * flutes
            if short * lowest > 1.0:
                break
            if long * highest < 1.0:
                continue
            begin = 0 if long * lowest >= 1.0 else int((1.0 / long - lowest) / width)
            end = cells - 1 if short * highest <= 1.0 else int((1.0 / short - lowest) / width)
            for c in range(max(begin, 0), min(end, cells - 1) + 1):
                slow = min(1.0 / (lowest + c * width), long)
                fast = max(1.0 / (lowest + (c + 1) * width), short)
                for edge in range(2):
                    period = (slow if edge == 0 else fast) / flutes
                    along = (period - first) / (last - first) if last != first else 0.0
                    along = min(max(along, 0.0), 1.0)
                    value = inverse[g, 0] + along * (inverse[g, 1] - inverse[g, 0])
                    out[c] = max(out[c], value)


@compiled
def fill_margins(speed, lowest, width, table, kind, depth, block, out):  # type: ignore[no-untyped-def]
    """Lower ``out`` (P, B) to the least margin of each block's stations; where a speed is bad.

    ``speed`` (P, B) [1/s]; ``table`` (K, C) depth limits [m] in cells of speed; ``kind``, ``depth``
    [m], ``block`` (N,) of the stations.  A speed outside of the cells ends it: p B + b; else -1.
    """
    cells = table.shape[1]
    for p in range(speed.shape[0]):
        for i in range(block.shape[0]):
            b = block[i]
            place = (speed[p, b] - lowest) / width
            if not -1e-9 <= place <= cells + 1e-9:
                return p * speed.shape[1] + b
            c = min(max(floor(place), 0), cells - 1)
            margin = table[kind[i], c] / depth[i] - 1.0
            if margin < out[p, b]:
                out[p, b] = margin
    return -1


_TERMS = 12
"""Terms of the Taylor series: at a norm of 1/2 the remainder is below 1e-14."""


@compiled
def fill_steps(omega, zeta, mass, axis, matrix, time, depth, here, ago, now, work):  # type: ignore[no-untyped-def]
    """Fill the matrices that take the state through each step.

    z(t + h) = here z(t) + ago u_i + now u_(i+1), u being the delayed displacement, linear within a
    step: with X = M h and phi_2 = sum X^k / (k + 2)!, phi_1 = 1 + X phi_2 they are 1 + X phi_1,
    h (phi_1 - phi_2) G and h phi_2 G.

    Parameters: ``omega, zeta, mass, axis`` (M,) of the modes; ``matrix`` (R, D, D) and ``time``
    (R,) of the steps; ``here`` (R, 2 M, 2 M), ``ago`` and ``now`` (R, 2 M, D) are filled; ``work``
    (4, 2 M, 2 M) is to work in.
    """
    X, one, two, product = work[0], work[1], work[2], work[3]
    size = X.shape[0]
    for i in range(time.shape[0]):
        h = time[i]
        norm = 0.0
        for j in range(omega.shape[0]):
            w, gain = omega[j], depth / (mass[j] * omega[j])
            for c in range(size):
                X[2 * j, c] = 0.0
                X[2 * j + 1, c] = 0.0
            X[2 * j, 2 * j + 1] = w * h
            for m in range(omega.shape[0]):
                X[2 * j + 1, 2 * m] = gain * matrix[i, axis[j], axis[m]] * h
            X[2 * j + 1, 2 * j] -= w * h
            X[2 * j + 1, 2 * j + 1] -= 2.0 * zeta[j] * w * h
            for r in range(2):
                total = 0.0
                for c in range(size):
                    total += abs(X[2 * j + r, c])
                norm = max(norm, total)
        _phi(X, norm, one, two, product)
        _multiply(X, one, product)
        for r in range(size):
            for c in range(size):
                here[i, r, c] = product[r, c] + (1.0 if r == c else 0.0)
            for d in range(ago.shape[2]):
                old, new = 0.0, 0.0
                for j in range(omega.shape[0]):
                    force = -depth / (mass[j] * omega[j]) * matrix[i, axis[j], d]
                    new += two[r, 2 * j + 1] * force
                    old += (one[r, 2 * j + 1] - two[r, 2 * j + 1]) * force
                ago[i, r, d] = old * h
                now[i, r, d] = new * h


@compiled
def _phi(X, norm, one, two, product):  # type: ignore[no-untyped-def]
    """Fill phi_1 and phi_2 of X, which is halved until its norm is small and doubled again."""
    size = X.shape[0]
    halvings = 0
    while 0.5 < norm < inf:  # the caller refuses values that are not finite
        norm *= 0.5
        halvings += 1
    scale = 0.5**halvings
    for r in range(size):
        for c in range(size):
            X[r, c] *= scale
            two[r, c] = 0.0
    for k in range(_TERMS, 1, -1):  # Horner: phi_2 = (1 + X/3 (1 + X/4 (...))) / 2
        _multiply(X, two, product)
        for r in range(size):
            for c in range(size):
                two[r, c] = (product[r, c] + (1.0 if r == c else 0.0)) / k
    while True:
        _multiply(X, two, one)
        for r in range(size):
            one[r, r] += 1.0
        if halvings == 0:
            return
        _multiply(one, one, product)  # phi_2(2 X) = (phi_1(X)^2 + 2 phi_2(X)) / 4
        for r in range(size):
            for c in range(size):
                two[r, c] = (product[r, c] + 2.0 * two[r, c]) * 0.25
                X[r, c] *= 2.0
        halvings -= 1


@compiled
def _multiply(a, b, out):  # type: ignore[no-untyped-def]
    size = out.shape[0]
    for r in range(size):
        for c in range(size):
            total = 0.0
            for k in range(size):
                total += a[r, k] * b[k, c]
            out[r, c] = total


@compiled
def pass_period(here, ago, now, free, axis, work, state, out):  # type: ignore[no-untyped-def]
    """Fill ``out``, the state one tooth period after ``state``; shape (2 M + (R + 1) D,).

    ``free`` (2 M, 2 M) takes the modes from the last step's end to the period's, where no tooth
    cuts; ``work`` (2 M,) is to work in.
    """
    size, many = here.shape[1], ago.shape[2]
    for r in range(size):
        out[r] = state[r]
    _tip(out, axis, size, many)
    for i in range(here.shape[0]):
        old = size + i * many
        new = old + many
        for r in range(size):
            total = 0.0
            for c in range(size):
                total += here[i, r, c] * out[c]
            for d in range(many):
                total += ago[i, r, d] * state[old + d] + now[i, r, d] * state[new + d]
            work[r] = total
        for r in range(size):
            out[r] = work[r]
        _tip(out, axis, new, many)
    for r in range(size):
        total = 0.0
        for c in range(size):
            total += free[r, c] * work[c]
        out[r] = total


@compiled
def _tip(state, axis, place, many):  # type: ignore[no-untyped-def]
    """Write the tip's displacement, the sum over the modes of each direction, to ``place``."""
    for d in range(many):
        state[place + d] = 0.0
    for j in range(axis.shape[0]):
        state[place + axis[j]] += state[2 * j]


@compiled
def extend_krylov(here, ago, now, free, axis, work, first, last, basis, hessenberg):  # type: ignore[no-untyped-def]
    """Arnoldi's iteration from row ``first`` of ``basis`` to ``last``; rows that it reached.

    ``basis`` (K + 1, n) has an orthonormal row ``first`` and those before; ``hessenberg`` is
    (K + 1, K).  It ends early where the space is closed.
    """
    many = basis.shape[1]
    for k in range(first, last):
        pass_period(here, ago, now, free, axis, work, basis[k], basis[k + 1])
        before = 0.0
        for c in range(many):
            before += basis[k + 1, c] ** 2
        for _ in range(2):  # twice is enough for rows at right angles to rounding
            for j in range(k + 1):
                along = 0.0
                for c in range(many):
                    along += basis[j, c] * basis[k + 1, c]
                hessenberg[j, k] += along
                for c in range(many):
                    basis[k + 1, c] -= along * basis[j, c]
        rest = 0.0
        for c in range(many):
            rest += basis[k + 1, c] ** 2
        if rest <= 1e-28 * before:
            return k + 1
        rest = sqrt(rest)
        hessenberg[k + 1, k] = rest
        for c in range(many):
            basis[k + 1, c] /= rest
    return last
