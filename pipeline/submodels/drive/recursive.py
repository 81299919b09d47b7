"""Recursive least squares with forgetting (FFRLS): inertia, damping and load of an axis as it runs.

J dw/dt = T_e - T_l - B w, sampled: w(k) = S_1 w(k-1) + S_2 T_e(k-1) - S_3 with J = T / S_2,
B = (1 - S_1) J / T, T_l = S_3 / S_2 (Feed2025).  Euler's step makes J too great by B T / (2 J) of
it.  Estimated is the change w(k) - w(k-1), on scales on which every regressor and every parameter
is about one, so that T = 1e-6 s loses no digits.

At constant speed inertia and load cannot be separated, and forgetting would lose the estimate.  All
three are therefore updated only while the torque, less its part proportional to the speed, has
spread by more than ``excitation`` of its scale within the memory; else the load alone is updated.
Forgetting pauses while it would carry the trace of P above its bound.

The compiled recursion works with y = -b w + j m - l, where (b, j, l) = (B w_s / m_s, 1, T_l / m_s)
J_0 / J, all of size one.  Its state is held in scalars, not in an array: memory between the steps
would take as long as they do.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan, sqrt
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels import compiled
from pipeline.machine.axis.drive_parameters import friction_force
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import RecursiveMass
from pipeline.schema.model import significant
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.submodels.drive.feed_drive import FeedDriveFit
from pipeline.submodels.drive.motion import motion
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import NORMAL_95


@dataclass(frozen=True, kw_only=True)
class RecursiveSettings(Ranged, section="recursive"):
    """Settings of the recursive estimator."""

    forgetting: Annotated[float, Range(least=0.9, most=1.0)] = 0.99
    """lambda for each update [1], 0.9 to 1: the memory is about 1 / (1 - lambda) updates."""
    inertia: Positive = 1e-3
    """Initial J_0 [kg m^2] (a mass [kg] for a linear axis); a factor of a hundred off is enough."""
    prior: Positive = 1e4
    """Variance of the scaled parameters at the start, in units of the residuals' [1]."""
    excitation: Annotated[float, Range(least=0.0, below=1.0)] = 0.1
    """Spread of torque below which the inertia is not updated, as a share of its scale [1]. It must
    be above the noise of torque and speed; 0 updates always."""
    trace_bound: Positive = 1e6
    """Greatest trace of the scaled P [1], at least three times ``prior``."""
    speed_scale: Positive | None = None
    torque_scale: Positive | None = None
    """Rated values [rad/s, N m] or [m/s, N]; the record's greatest unless given."""


@dataclass(frozen=True, kw_only=True)
class RecursiveTrace:
    """Estimates at each sample; nan where they were not determined."""

    inertia: Floats
    """J [kg m^2], or the mass [kg] of a linear axis; shape (T,)."""
    damping: Floats
    """B [N m s/rad] or [N s/m]; shape (T,)."""
    load: Floats
    """T_l [N m] or [N], Coulomb friction of the present direction in it; shape (T,)."""
    deviation: Floats
    """Standard deviation of ``inertia`` from P and the residuals' variance; infinite where it is
    not determined; shape (T,)."""
    covariance_trace: Floats
    """Covariance trace of the scaled P [1]; shape (T,)."""
    excited: Bools
    """Whether the inertia was updated at that sample; shape (T,)."""
    freedom: float
    """Degrees of freedom of the last deviation."""
    skipped: int
    """Samples without a finite speed or torque, left out."""


def recursive_inertia(
    speed: ArrayLike, torque: ArrayLike, period: float, settings: RecursiveSettings
) -> RecursiveTrace:
    """Inertia, damping and load torque at every sample of a record, sampled with ``period`` [s].

    By w [rad/s] and T_e [N m], held from its sample to the next, (T,) each; for a linear axis mass
    [kg], damping [N s/m] and load [N] by velocity [m/s] and force [N].
    """
    w = np.ascontiguousarray(speed, dtype=np.float64)
    m = np.ascontiguousarray(torque, dtype=np.float64)
    speed_scale = _scale(w, settings.speed_scale)
    torque_scale = _scale(m, settings.torque_scale)
    many = len(w)
    inertia, damping, load, deviation, trace = (np.empty(many) for _ in range(5))
    excited, ends = np.empty(many, np.bool_), np.empty(3)
    recurse(
        w, m, (settings.inertia, torque_scale / speed_scale, torque_scale, 1 / speed_scale),
        settings.inertia / (period * torque_scale), settings.forgetting, settings.prior,
        settings.excitation, settings.trace_bound,
        inertia, damping, load, deviation, trace, excited, ends,
    )  # fmt: skip
    weight, squared, skipped = ends.tolist()
    return RecursiveTrace(
        inertia=inertia, damping=damping, load=load, deviation=deviation, covariance_trace=trace,
        excited=excited, freedom=weight**2 / squared - PARAMETERS if squared else 0.0,
        skipped=int(skipped),
    )  # fmt: skip


def _scale(series: Floats, given: float | None) -> float:
    if given is not None:
        return given
    greatest = max(float(series.max()), -float(series.min()))
    if not isfinite(greatest):
        greatest = float(np.abs(series[np.isfinite(series)]).max(initial=0.0))
    return greatest if greatest > 0 else 1.0


MEMORY = 0.99
"""Forgetting factor of the mass trace [1]: the last hundred samples count."""
SHOWN = 200
"""Greatest number of samples of a stored mass trace [1]."""


def mass_trace(
    recordings: Sequence[Recording], axis: str, fit: FeedDriveFit
) -> RecursiveMass | None:
    """Recursive mass in the recording of the strongest acceleration, with friction subtracted.

    None where the fit determines no mass, the sampling is too slow, or no recording shows one.
    """
    if not (fit.determined[0] and np.isfinite(fit.bandwidth_Hz)):
        return None
    shown = [one for one in recordings if axis in one.axes]
    moved = [motion(one, axis, fit.bandwidth_Hz, fit.delay) for one in shown]
    best = max(moved, key=lambda one: float(np.mean(one.acceleration[one.known] ** 2)))
    drive = fit.feed_drive
    force = best.force - friction_force(best.velocity, drive.friction) - drive.offset
    middle = 0.5 * (force + np.append(force[1:], force[-1]))  # the mean until the next sample
    clear = best.known & best.moving
    settings = RecursiveSettings(
        forgetting=MEMORY, inertia=float(drive.mass) / 2,
        speed_scale=float(np.abs(best.velocity).max()),
        torque_scale=float(np.abs(middle[clear]).max()),
    )  # fmt: skip
    trace = recursive_inertia(
        np.where(clear, best.velocity, np.nan), np.where(clear, middle, np.nan), best.period,
        settings,
    )  # fmt: skip
    defined = np.flatnonzero(np.isfinite(trace.inertia) & np.isfinite(trace.deviation))
    if not len(defined):
        return None
    chosen = np.unique(
        defined[np.linspace(0, len(defined) - 1, min(SHOWN, len(defined))).astype(int)]
    )
    return RecursiveMass(
        recording=best.recording, unit=fit.units[0],
        time_s=tuple(round(t, 4) for t in best.time[chosen].tolist()),
        value=tuple(map(significant, trace.inertia[chosen].tolist())),
        half_width=tuple(map(significant, (NORMAL_95 * trace.deviation[chosen]).tolist())),
    )  # fmt: skip


PARAMETERS = 3
"""Number of estimated parameters [1]."""
_NO_SPREAD = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_NO_RESIDUALS = (0.0, 0.0, 0.0, 0.0)


@compiled
def recurse(  # type: ignore[no-untyped-def]
    speed, torque, scales, gain, forgetting, prior, excitation, bound,
    inertia, damping, load, deviation, trace, excited, ends,
):  # fmt: skip
    """Recursion over a record of T samples; the arguments after ``bound`` are filled.

    ``scales`` are J_0, torque scale / speed scale, torque scale, and 1 / speed scale; ``gain`` is
    J_0 / (T torque scale).  ``inertia``, ``damping``, ``load``, ``deviation``, ``trace`` and
    ``excited`` have shape (T,); ``ends`` the sum of the weights, of their squares, and the samples
    that were skipped.
    """
    inverse_speed, inverse_torque = scales[3], 1.0 / scales[2]
    b, j, l = 0.0, 1.0, 0.0  # noqa: E741
    p = (prior, 0.0, 0.0, prior, 0.0, prior)
    spread, residuals = _NO_SPREAD, _NO_RESIDUALS
    seen, skipped, updates_all = 0.0, 0.0, False
    known = (nan, nan, nan, inf)
    for k in range(speed.shape[0]):
        # times 0 only finite numbers give 0
        if k > 0 and (speed[k] - speed[k - 1] + torque[k - 1] + speed[k - 1]) * 0.0 != 0.0:
            skipped += 1.0
        elif k > 0:
            y = (speed[k] - speed[k - 1]) * gain
            w, m = speed[k - 1] * inverse_speed, torque[k - 1] * inverse_torque
            seen += 1.0
            spread = _spread(spread, w, m, max(1.0 - forgetting, 1.0 / seen))
            updates_all = _excites(spread, excitation)
            error = y + b * w - j * m + l
            if updates_all:
                full = p[0] + p[3] + p[5] > bound * forgetting
                p, step, residuals = _update(p, residuals, w, m, error, 1.0 if full else forgetting)
                b, j, l = b + step[0], j + step[1], l + step[2]  # noqa: E741
            else:
                # at constant speed only the load is seen
                l -= (1.0 - forgetting) * error  # noqa: E741
            known = _physical(b, j, l, p[3], residuals, scales)
        inertia[k], damping[k], load[k], deviation[k] = known
        trace[k] = p[0] + p[3] + p[5]
        excited[k] = updates_all
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
def _excites(spread, excitation):  # type: ignore[no-untyped-def]
    """Whether the torque, less what follows the speed, spreads by more than ``excitation``."""
    if excitation == 0.0:
        return True
    _, _, var_w, var_m, both, _ = spread
    least = excitation * excitation
    return var_m >= least and var_m * var_w - both * both >= least * var_w


@compiled
def _physical(b, j, l, p11, residuals, scales):  # type: ignore[no-untyped-def]  # noqa: E741
    """J, B, T_l and the standard deviation of J; nan where they are not determined."""
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
