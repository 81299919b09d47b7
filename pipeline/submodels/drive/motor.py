"""Synchronous motor from recorded currents, voltages and speed.

u_d = R i_d + L_d di_d/dt - w_e L_q i_q and u_q = R i_q + L_q di_q/dt + w_e (L_d i_d + phi)
(Feed2025) are linear in their parameters once integrated over windows.  A parameter that the record
does not excite is not determined, with the reason.

* Modulating functions: multiplied by a function g that vanishes with its slope at both ends of a
  window and integrated, dx/dt becomes -integral(g' x) (Shinbrot 1957), so that no record is
  differentiated.  The functions are sin^3(pi s) cos(k pi s) over s = 0..1; their first two
  derivatives vanish at the ends too, or nearly, so that sums over samples are integrals to the
  fourth order of the period.
* Two-stage least squares: ordinary least squares takes noise in the regressors for excitation, and
  answers with small parameters and narrow intervals where nothing is excited.  Here the regressors
  are made from the even samples and from the odd ones; noise of the samples is in one only, signal
  in both.  Each serves as the other's instrument, and a regressor or a combination of several on
  which the halves do not agree is not determined.
* Dead time: where the voltages are the ones commanded, the inverter takes a voltage of constant
  height along the current from them, u_0 i / |i|, which otherwise counts as resistance (Jeong and
  Park 1991).  It is fitted too, and kept where the record shows it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.submodels.drive.estimates import AxisFit
from pipeline.submodels.statistics import Uncertainty, uncertainty_of

WINDOW = 64
"""Samples of a window, about as long as the slowest of what is fitted [1]."""
ORDERS = 4
"""Modulating functions of each window; the fastest has (ORDERS + 2) / 2 waves in it [1]."""


class Windows:
    """Windows of a record of ``signals``, (T,) each, sampled with ``period`` [s].

    Those with a sample that is not finite are left out; ValueError when none is whole.  Where it is
    ``held``, the driving signal (the voltage) stays from its sample to the next, as an inverter's
    command does; else it is sampled like the others.
    """

    def __init__(self, signals: Mapping[str, ArrayLike], period: float, *, held: bool) -> None:
        arrays = {name: np.asarray(one, dtype=np.float64) for name, one in signals.items()}
        many = len(next(iter(arrays.values())))
        starts = np.arange(0, max(many - WINDOW, 0), WINDOW)
        samples = starts[:, None] + np.arange(WINDOW + 1)
        whole = np.ones(len(starts), bool)
        for one in arrays.values():
            whole &= np.isfinite(one[samples]).all(axis=1)
        if not whole.any():
            raise ValueError(
                f"record of {many} samples has no window of {WINDOW + 1} finite ones: record longer"
            )
        self.signals = {name: one[samples[whole]] for name, one in arrays.items()}
        self.left_out = int((~whole).sum())
        self.period, self.held = period, held

    def __len__(self) -> int:
        """Number of windows B [1]."""
        return len(next(iter(self.signals.values())))

    def driven(self, name: str) -> Floats:
        """Integrals of g times the driving signal, shape (B, orders)."""
        if not self.held:
            return self._summed(self.signals[name], self._function(np.arange(WINDOW + 1)))
        # Gauss and Legendre's three points within each period that the signal is held over
        points, weights = np.polynomial.legendre.leggauss(3)
        within = np.arange(WINDOW)[:, None] + 0.5 * (1.0 + points)
        mean = np.einsum("p,npk->nk", 0.5 * weights, self._function(within))
        return self._summed(self.signals[name][:, :WINDOW], mean)

    def halves(self, signal: Floats) -> Floats:
        """Integrals of g times a signal (B, W + 1), even and odd samples apart; (2, B, orders)."""
        return self._split(signal, self._function(np.arange(WINDOW + 1)))

    def rates(self, signal: Floats) -> Floats:
        """Integrals of g times the signal's derivative, as :meth:`halves`."""
        return -self._split(signal, self._slope(np.arange(WINDOW + 1)))

    def _split(self, signal: Floats, weights: Floats) -> Floats:
        both = [self._summed(signal[:, i::2], 2.0 * weights[i::2]) for i in (0, 1)]
        return np.stack(both)

    def _summed(self, signal: Floats, weights: Floats) -> Floats:
        return signal @ weights * self.period

    def _function(self, sample: ArrayLike) -> Floats:
        """The functions g at samples of a window, shape (..., orders)."""
        s = pi * np.asarray(sample, dtype=np.float64)[..., None] / WINDOW
        return np.sin(s) ** 3 * np.cos(np.arange(ORDERS) * s)

    def _slope(self, sample: ArrayLike) -> Floats:
        """Their slopes g' [1/s], shape (..., orders)."""
        s = pi * np.asarray(sample, dtype=np.float64)[..., None] / WINDOW
        k = np.arange(ORDERS)
        by_s = 3 * np.sin(s) ** 2 * np.cos(s) * np.cos(k * s) - np.sin(s) ** 3 * k * np.sin(k * s)
        return np.asarray(by_s * (pi / (WINDOW * self.period)), dtype=np.float64)


_ROUNDING = 1e-9  # of the greatest singular value
AGREEMENT = 0.5
"""Correlation of the halves below which noise exceeds signal [1]."""
_TAKES_PART = 0.01  # in a combination, of its greatest member


@dataclass(frozen=True, kw_only=True)
class SplitFit:
    """Fit of linear parameters by two halves of the samples."""

    values: Floats
    """0 where the regressor is not excited; shape (D,)."""
    half_width: Floats
    """Half width of the 95 % interval; infinite if not excited, or interchangeable; (D,)."""
    excited: Bools
    """Whether the halves agree on the regressor; shape (D,)."""
    interchangeable: Bools
    """Whether it is part of an excited combination that they do not agree on; shape (D,)."""
    condition: float
    """Condition of the excited regressors, each scaled to length one."""
    correlation: Floats
    """Correlation of the parameters; 0 beside the diagonal if not excited; shape (D, D)."""


def split_fit(regressors: Floats, y: Floats, blocks: Ints) -> SplitFit:
    """Fit y = regressors @ values by two-stage least squares, each half the other's instrument.

    ``regressors`` (2, N, D) from either half of the samples; residuals of ``y`` (N,) are correlated
    within ``blocks`` (N,).
    """
    # by chance the halves of pure noise agree by about 1 / sqrt(blocks)
    least = min(max(AGREEMENT, 4.0 / np.sqrt(len(np.unique(blocks)))), 0.99)
    lengths = np.sqrt((regressors**2).sum(axis=1))
    products = (regressors[0] * regressors[1]).sum(axis=0)
    excited = (products > least * lengths[0] * lengths[1]) & (products > 0)
    many = len(excited)
    values, half_width, condition = np.zeros(many), np.full(many, np.inf), np.inf
    interchangeable, correlation = np.zeros(many, bool), np.eye(many)
    if excited.any():
        scale = np.sqrt(products[excited])
        halves = regressors[:, :, excited] / scale
        found, uncertainty = _two_stage(halves, y, blocks)
        free = _free(halves, least)
        values[excited] = found / scale
        half_width[excited] = np.where(free, np.inf, uncertainty.half_width / scale)
        interchangeable[excited], condition = free, uncertainty.condition
        correlation[np.ix_(excited, excited)] = uncertainty.correlation
    return SplitFit(
        values=values, half_width=half_width, excited=excited, interchangeable=interchangeable,
        condition=condition, correlation=correlation,
    )  # fmt: skip


def _two_stage(halves: Floats, y: Floats, blocks: Ints) -> tuple[Floats, Uncertainty]:
    both = np.concatenate([halves[0], halves[1]])
    swapped = np.concatenate([halves[1], halves[0]])
    twice = np.concatenate([y, y])
    # each regressor as the other half predicts it
    stage = swapped @ np.linalg.lstsq(swapped, both, rcond=_ROUNDING)[0]
    found = np.linalg.lstsq(stage, twice, rcond=_ROUNDING)[0]
    residuals = twice - both @ found
    return found, uncertainty_of(stage, residuals, np.concatenate([blocks, blocks]))


def _free(halves: Floats, least: float) -> Bools:
    """Regressors in a combination that the halves do not agree on; shape (D,).

    Combinations are those of canonical correlation: with both halves' regressors made orthonormal
    together, the eigenvectors of what the one half shares with the other.
    """
    both = np.concatenate([halves[0], halves[1]])
    _, singular, right = np.linalg.svd(np.linalg.qr(both, mode="r"), full_matrices=True)
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    seen = singular > _ROUNDING * singular[0]
    orthonormal = right[seen].T / singular[seen]
    first, second = halves[0] @ orthonormal, halves[1] @ orthonormal
    shared = first.T @ second
    agreement, vectors = np.linalg.eigh(shared + shared.T)
    open_combinations = [right[~seen].T, orthonormal @ vectors[:, agreement < least]]
    combinations = np.abs(np.concatenate(open_combinations, axis=1))
    return (combinations > _TAKES_PART * combinations.max(axis=0)).any(1)


ELECTRICAL = {"resistance": "ohm", "inductance_d": "H", "inductance_q": "H", "flux": "Wb"}
DEAD_VOLTAGE = {"dead_voltage": "V"}
SHOWN = 2.0
"""Least dead voltage over the half width of its interval [1]: chance exceeds it once in 10^4."""


METHOD = "least squares on voltage equations integrated over windows"
REMEDY = (
    "record voltages, currents and speed of the motor under steps of speed and load, i_d among them"
)


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorFit(AxisFit):
    """Parameters of a motor; values are nan where the record does not determine them."""

    reasons: dict[str, str]
    """Why those that are not determined are not."""
    windows: int
    left_out: int
    """Windows fitted, and left out because a sample in them is not finite."""


def identify_motor(
    signals: Mapping[str, ArrayLike], *, period: float, widest: float, held: bool = False
) -> MotorFit:
    """Resistance, both inductances, the magnets' flux linkage, and the inverter's dead voltage.

    The last is left out where the record does not clearly show it: measured voltages have none.
    ``signals``, shape (T,), are voltages ``u_d``, ``u_q`` [V] and currents ``i_d``, ``i_q`` [A],
    amplitude-invariant, and the electrical speed ``w_e`` [rad/s]; ``held`` as of :class:`Windows`.
    ``widest`` is the greatest relative half width of a determined parameter's 95 % interval [1].
    ValueError when the series are too short for a window.
    """
    cut = Windows(signals, period, held=held)
    d, q, w = (cut.signals[name] for name in ("i_d", "i_q", "w_e"))
    none = np.zeros((2, len(cut), ORDERS))
    along_d = [cut.halves(d), cut.rates(d), -cut.halves(w * q), none]
    along_q = [cut.halves(q), cut.halves(w * d), cut.rates(q), cut.halves(w)]
    driven = [cut.driven("u_d"), cut.driven("u_q")]
    size = np.maximum(np.hypot(d, q), np.finfo(float).tiny)
    fit = _fit([[*along_d, cut.halves(d / size)], [*along_q, cut.halves(q / size)]], driven)
    units = ELECTRICAL | DEAD_VOLTAGE
    if not fit.values[-1] > SHOWN * fit.half_width[-1]:
        fit, units = _fit([along_d, along_q], driven), ELECTRICAL
    return _verified(units, fit, cut, widest * np.abs(fit.values))


def _fit(equations: Sequence[Sequence[Floats]], driven: Sequence[Floats]) -> SplitFit:
    """Fit equations, each of D regressors of shape (2, B, orders), to what drives them."""
    regressors = np.concatenate(
        [np.stack(one, axis=-1).reshape(2, -1, len(one)) for one in equations], axis=1
    )
    blocks = np.concatenate([np.repeat(np.arange(len(y)), y.shape[1]) for y in driven])
    return split_fit(regressors, np.concatenate([y.ravel() for y in driven]), blocks)


def _verified(units: dict[str, str], fit: SplitFit, cut: Windows, widest: Floats) -> MotorFit:
    """Parameters with their reasons; those of the motor must be above 0."""
    reasons = {}
    for k, (name, unit) in enumerate(units.items()):
        value, half = float(fit.values[k]), float(fit.half_width[k])
        interval = f"its 95 % interval {value:.3g} ± {half:.2g} {unit}"
        if not fit.excited[k]:
            reasons[name] = "the record does not excite it beyond its noise"
        elif fit.interchangeable[k]:
            reasons[name] = "others can take its place: the record does not tell them apart"
        elif not np.isfinite(half):
            reasons[name] = f"{len(cut)} windows are too few for an interval"
        elif half > widest[k]:
            reasons[name] = f"{interval} is wider than {widest[k]:.2g} {unit} either way"
        elif name in ELECTRICAL and value <= 0:
            reasons[name] = f"{interval} is not above 0: check the signs of the recorded axes"
    determined = np.array([name not in reasons for name in units])
    return MotorFit(
        names=tuple(units), units=tuple(units.values()),
        values=np.where(determined, fit.values, np.nan), low=fit.values - fit.half_width,
        high=fit.values + fit.half_width, determined=determined,
        how=tuple(reasons.get(name, METHOD) for name in units), remedy=(REMEDY,) * len(units),
        reasons=reasons, condition=fit.condition, correlation=fit.correlation, windows=len(cut),
        left_out=cut.left_out,
    )  # fmt: skip
