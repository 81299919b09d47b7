"""Inertia, damping and load of an axis while it runs: least squares that forget (FFRLS).

J dw/dt = T_e - T_l - B w, sampled: w(k) = S_1 w(k-1) + S_2 T_e(k-1) - S_3 with J = T / S_2,
B = (1 - S_1) J / T, T_l = S_3 / S_2 (Feed2025).  Euler's step makes J too great by B T / (2 J) of
it.  Estimated is the change w(k) - w(k-1), on scales on which every regressor and every parameter
is about one, so that T = 1e-6 s loses no digits.

At constant speed inertia and load cannot be told apart, and forgetting would give away what is
known.  All three are therefore updated only while the torque, less what follows the speed, has
spread by more than ``excitation`` of its scale within the memory; else the load alone follows.
Forgetting rests while it would carry the trace of P above its bound.
"""

from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class RecursiveSettings:
    """How the recursive estimator forgets.

    Parameters
    ----------
    forgetting : float
        lambda for each update [1], 0.9 to 1: the memory is about 1 / (1 - lambda) updates.
    inertia : float
        J_0 [kg m^2] (a mass [kg] for a linear axis), where it begins; within a factor of a hundred
        is enough.
    prior : float
        Variance of the scaled parameters at the start, in units of the residuals' [1].
    excitation : float
        Spread of torque below which nothing is learnt of the inertia, as a share of its scale [1].
        It must be above the noise of torque and speed; 0 learns always.
    trace_bound : float
        That the trace of the scaled P never passes [1], at least three times ``prior``.
    window : int
        Samples whose mean makes one update.  Noise of the speed is in its change too, and biases
        the damping, and the inertia where the torque answers to it; by 1 / window^2 of that.
    speed_scale, torque_scale : float, optional
        Rated values [rad/s, N m] or [m/s, N]; the record's greatest unless given.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    forgetting: float = 0.99
    inertia: float = 1e-3
    prior: float = 1e4
    excitation: float = 0.1
    trace_bound: float = 1e6
    window: int = 1
    speed_scale: float | None = None
    torque_scale: float | None = None

    def __post_init__(self) -> None:
        if not 0.9 <= self.forgetting <= 1:
            raise ValueError(f"recursive.forgetting = {self.forgetting} must lie in 0.9 to 1")
        for name in ("inertia", "prior", "trace_bound", "speed_scale", "torque_scale"):
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and value > 0):
                raise ValueError(f"recursive.{name} = {value} must be finite and positive")
        if not 0 <= self.excitation < 1:
            raise ValueError(f"recursive.excitation = {self.excitation} must lie in 0 to 1")
        if self.trace_bound < 3 * self.prior:
            raise ValueError(
                f"recursive.trace_bound = {self.trace_bound} must be at least three times "
                f"recursive.prior = {self.prior}"
            )
        if not (self.window >= 1 and self.window == int(self.window)):
            raise ValueError(f"recursive.window = {self.window} must be a whole number above 0")


@dataclass(frozen=True, kw_only=True)
class RecursiveTrace:
    """What the estimator knew at each sample; nan where it was not determined.

    Parameters
    ----------
    inertia : ndarray, shape (T,)
        J [kg m^2], or the mass [kg] of a linear axis.
    damping : ndarray, shape (T,)
        B [N m s/rad] or [N s/m].
    load : ndarray, shape (T,)
        T_l [N m] or [N], Coulomb friction of the present direction in it.
    deviation : ndarray, shape (T,)
        Standard deviation of ``inertia`` from P and the residuals' variance; infinite where it is
        not determined.
    covariance_trace : ndarray, shape (T,)
        Of the scaled P [1].
    excited : ndarray of bool, shape (T,)
        Whether the record told of the inertia.
    freedom : float
        Degrees of freedom of the last deviation.
    skipped : int
        Samples without a finite speed or torque, left out.
    """

    inertia: Floats
    damping: Floats
    load: Floats
    deviation: Floats
    covariance_trace: Floats
    excited: NDArray[np.bool_]
    freedom: float
    skipped: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the last inertia; 0 to infinity when it is not determined."""
        from scipy.stats import t as student

        if not (isfinite(self.deviation[-1]) and self.freedom > 0):
            return 0.0, inf
        value = float(self.inertia[-1])
        share = float(student.ppf(0.975, self.freedom) * self.deviation[-1]) / value
        # symmetric in 1 / J, which is what is estimated
        return value / (1 + share), value / (1 - share) if share < 1 else inf


def recursive_inertia(
    speed: ArrayLike, torque: ArrayLike, period: float, settings: RecursiveSettings
) -> RecursiveTrace:
    """Inertia, damping and load torque at every sample of a record.

    Parameters
    ----------
    speed : array_like, shape (T,)
        w [rad/s].
    torque : array_like, shape (T,)
        T_e [N m], held from its sample to the next.
    period : float
        T [s].
    settings : RecursiveSettings
        How it forgets.

    Raises
    ------
    ValueError
        When the record is no two series of the same length, or the period is not positive.
    """
    w, m = _record(speed, torque, period)
    speed_scale = _scale(w, settings.speed_scale)
    torque_scale = _scale(m, settings.torque_scale)
    return _recursed(w, m, period, settings, speed_scale, torque_scale)


def recursive_mass(
    velocity: ArrayLike, force: ArrayLike, period: float, settings: RecursiveSettings
) -> RecursiveTrace:
    """Mass [kg], damping [N s/m] and load [N] of a linear axis at every sample of a record.

    Parameters
    ----------
    velocity : array_like, shape (T,)
        v [m/s].
    force : array_like, shape (T,)
        Of the drive [N], held from its sample to the next.
    period : float
        T [s].
    settings : RecursiveSettings
        How it forgets; ``inertia`` is the mass it begins with [kg].

    Raises
    ------
    ValueError
        As :func:`recursive_inertia`.
    """
    return recursive_inertia(velocity, force, period, settings)


def _recursed(
    w: Floats, m: Floats, period: float, settings: RecursiveSettings,
    speed_scale: float, torque_scale: float,
) -> RecursiveTrace:  # fmt: skip
    from pipeline.identification.drive import recursive_kernel as kernel

    many = len(w)
    inertia, damping, load, deviation, trace = (np.empty(many) for _ in range(5))
    excited, ends = np.empty(many, np.bool_), np.empty(3)
    kernel.recurse(
        w, m, (settings.inertia, torque_scale / speed_scale, torque_scale, 1 / speed_scale),
        settings.inertia / (period * torque_scale), int(settings.window), settings.forgetting,
        settings.prior, settings.excitation, settings.trace_bound,
        inertia, damping, load, deviation, trace, excited, ends,
    )  # fmt: skip
    weight, squared, skipped = ends.tolist()
    return RecursiveTrace(
        inertia=inertia,
        damping=damping,
        load=load,
        deviation=deviation,
        covariance_trace=trace,
        excited=excited,
        freedom=weight**2 / squared - kernel.PARAMETERS if squared else 0.0,
        skipped=int(skipped),
    )


def _record(speed: ArrayLike, torque: ArrayLike, period: float) -> tuple[Floats, Floats]:
    w = np.ascontiguousarray(speed, dtype=np.float64)
    m = np.ascontiguousarray(torque, dtype=np.float64)
    if w.ndim != 1 or w.shape != m.shape or len(w) < 2:
        raise ValueError(
            f"speed of shape {w.shape} and torque of shape {m.shape} are no record: "
            "give two series of the same length, two samples at least"
        )
    if not (isfinite(period) and period > 0):
        raise ValueError(f"period = {period} s must be finite and positive")
    return w, m


def _scale(series: Floats, given: float | None) -> float:
    if given is not None:
        return given
    greatest = max(float(series.max()), -float(series.min()))
    if not isfinite(greatest):
        greatest = float(np.abs(series[np.isfinite(series)]).max(initial=0.0))
    return greatest if greatest > 0 else 1.0
