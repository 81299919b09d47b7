"""Recursive least squares with forgetting of one axis's inertia, step by step, compiled.

With the scales of :mod:`pipeline.identification.drive.recursive` all is of size one:
y = -b w + j m - l, where (b, j, l) = (B w_s / m_s, 1, T_l / m_s) J_0 / J.  What is carried from
step to step are names, not an array: memory between the steps would take as long as they do.
"""

from math import inf, nan, sqrt

from pipeline.kernels import compiled

PARAMETERS = 3
_NO_SPREAD = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_NO_RESIDUALS = (0.0, 0.0, 0.0, 0.0)


@compiled
def recurse(  # type: ignore[no-untyped-def]
    speed, torque, scales, gain, window, forgetting, prior, excitation, bound,
    inertia, damping, load, deviation, trace, excited, ends,
):  # fmt: skip
    """Go through a record of T samples; what stands after ``bound`` is filled.

    ``scales`` are J_0, torque scale / speed scale, torque scale, and 1 / speed scale; ``gain`` is
    J_0 / (T torque scale).  ``inertia``, ``damping``, ``load``, ``deviation``, ``trace`` and
    ``excited`` have shape (T,); ``ends`` the sum of the weights, of their squares, and the samples
    that were skipped.
    """
    inverse_speed, inverse_torque = scales[3], 1.0 / scales[2]
    share = 1.0 / window
    b, j, l = 0.0, 1.0, 0.0  # noqa: E741
    p = (prior, 0.0, 0.0, prior, 0.0, prior)
    spread, residuals = _NO_SPREAD, _NO_RESIDUALS
    seen, skipped, count, sum_w, sum_m = 0.0, 0.0, 0, 0.0, 0.0
    anchor, learns = speed[0], False
    known = (nan, nan, nan, inf)
    for k in range(speed.shape[0]):
        if k > 0:
            w, m = speed[k - 1], torque[k - 1]
            # what is not finite, or no number, gives no zero
            if (speed[k] - anchor + m + w) * 0.0 == 0.0:
                count += 1
                sum_w += w
                sum_m += m
            else:
                skipped += 1.0
                count, sum_w, sum_m, anchor = 0, 0.0, 0.0, speed[k]
        if count == window:
            y = (speed[k] - anchor) * gain * share
            w, m = sum_w * share * inverse_speed, sum_m * share * inverse_torque
            count, sum_w, sum_m, anchor = 0, 0.0, 0.0, speed[k]
            seen += 1.0
            spread = _spread(spread, w, m, max(1.0 - forgetting, 1.0 / seen))
            learns = _tells(spread, excitation)
            error = y + b * w - j * m + l
            if learns:
                full = p[0] + p[3] + p[5] > bound * forgetting
                p, step, residuals = _update(p, residuals, w, m, error, 1.0 if full else forgetting)
                b, j, l = b + step[0], j + step[1], l + step[2]  # noqa: E741
            else:
                # at constant speed only the load is seen
                l -= (1.0 - forgetting) * error  # noqa: E741
            known = _physical(b, j, l, p[3], residuals, scales)
        inertia[k], damping[k], load[k], deviation[k] = known
        trace[k] = p[0] + p[3] + p[5]
        excited[k] = learns
    ends[0], ends[1], ends[2] = residuals[1], residuals[2], skipped


@compiled
def _update(p, residuals, w, m, error, forgetting):  # type: ignore[no-untyped-def]
    """The upper half of P, the step of the parameters, and the residuals' sums after a sample.

    The regressors are (-w, m, -1).  Six numbers hold P, so that it stays symmetric.
    """
    p00, p01, p02, p11, p12, p22 = p
    squares, weight, squared, updates = residuals
    g0 = p01 * m - p00 * w - p02
    g1 = p11 * m - p01 * w - p12
    g2 = p12 * m - p02 * w - p22
    inverse = 1.0 / (forgetting - g0 * w + g1 * m - g2)
    slower = 1.0 / forgetting
    gain, h = error * inverse, inverse * slower
    h0, h1, h2 = g0 * h, g1 * h, g2 * h
    after = (
        p00 * slower - g0 * h0, p01 * slower - g0 * h1, p02 * slower - g0 * h2,
        p11 * slower - g1 * h1, p12 * slower - g1 * h2, p22 * slower - g2 * h2,
    )  # fmt: skip
    sums = (
        forgetting * (squares + error * gain), forgetting * weight + 1.0,
        forgetting * forgetting * squared + 1.0, updates + 1.0,
    )  # fmt: skip
    return after, (g0 * gain, g1 * gain, g2 * gain), sums


@compiled
def _spread(spread, w, m, share):  # type: ignore[no-untyped-def]
    """Mean and variance of speed and torque over the memory, and their covariance."""
    mean_w, mean_m, var_w, var_m, both, _ = spread
    kept = 1.0 - share
    off_w, off_m = w - mean_w, m - mean_m
    return (
        mean_w + share * off_w, mean_m + share * off_m,
        kept * (var_w + share * off_w * off_w), kept * (var_m + share * off_m * off_m),
        kept * (both + share * off_w * off_m), 0.0,
    )  # fmt: skip


@compiled
def _tells(spread, excitation):  # type: ignore[no-untyped-def]
    """Whether the torque, less what follows the speed, spreads by more than ``excitation``."""
    if excitation == 0.0:
        return True
    _, _, var_w, var_m, both, _ = spread
    least = excitation * excitation
    return var_m >= least and var_m * var_w - both * both >= least * var_w


@compiled
def _physical(b, j, l, p11, residuals, scales):  # type: ignore[no-untyped-def]  # noqa: E741
    """J, B, T_l and the standard deviation of J; no numbers where they are not determined."""
    squares, weight, squared, updates = residuals
    thinned = squared / max(weight, 1.0)
    freedom = weight - PARAMETERS * thinned
    if not (updates > PARAMETERS and freedom > 0.0 and j > 0.0):
        return nan, nan, nan, inf
    inverse = 1.0 / j
    variance = max(squares / freedom * thinned * p11, 0.0)
    return (
        scales[0] * inverse, b * inverse * scales[1], l * inverse * scales[2],
        scales[0] * inverse * inverse * sqrt(variance),
    )  # fmt: skip
