"""Differential equations as integrals over windows, so that no record is differentiated.

Multiplied by a function g that vanishes with its slope at both ends of a window and integrated,
dx/dt becomes -integral(g' x) (Shinbrot 1957).  The functions are sin^3(pi s) cos(k pi s) over
s = 0..1; their first two derivatives vanish at the ends too, or nearly, so that sums over samples
are integrals to the fourth order of the period.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ModulatingSettings:
    """Windows and functions.

    Parameters
    ----------
    window : int
        Samples of a window, even and at least 16; it should last about as long as the slowest of
        what is sought.
    orders : int
        Functions for each window; the fastest has (orders + 2) / 2 waves in it.
    held : bool
        Whether the driving signal (the voltage, the torque) is held from its sample to the next, as
        an inverter's command is; else it is sampled like the others.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    window: int = 64
    orders: int = 4
    held: bool = False

    def __post_init__(self) -> None:
        if not (self.window >= 16 and self.window % 2 == 0):
            raise ValueError(f"modulating.window = {self.window} must be even and at least 16")
        if not (self.orders == int(self.orders) and 1 <= self.orders <= self.window // 8):
            raise ValueError(
                f"modulating.orders = {self.orders} must be whole and lie in 1 to window / 8 = "
                f"{self.window // 8}"
            )


class Windows:
    """A record cut into windows; windows that hold a sample without a number are left out.

    Parameters
    ----------
    signals : dict of str to array_like, shape (T,)
        The record, sampled at the same times.
    period : float
        Between samples [s].
    settings : ModulatingSettings
        How it is cut.

    Raises
    ------
    ValueError
        When the signals differ in length, the period is not positive, or no window is whole.
    """

    def __init__(
        self, signals: dict[str, ArrayLike], period: float, settings: ModulatingSettings
    ) -> None:
        arrays = {name: np.asarray(one, dtype=np.float64) for name, one in signals.items()}
        shapes = {name: one.shape for name, one in arrays.items()}
        if len(set(shapes.values())) != 1 or len(next(iter(shapes.values()))) != 1:
            told = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ValueError(f"signals of shapes {told} are no record: give series of one length")
        if not (np.isfinite(period) and period > 0):
            raise ValueError(f"period = {period} s must be finite and positive")
        many, size = len(next(iter(arrays.values()))), settings.window
        starts = np.arange(0, max(many - size, 0), size)
        samples = starts[:, None] + np.arange(size + 1)
        whole = np.ones(len(starts), bool)
        for one in arrays.values():
            whole &= np.isfinite(one[samples]).all(axis=1)
        if not whole.any():
            raise ValueError(
                f"record of {many} samples has no window of {size + 1} finite ones: "
                "record longer, or make modulating.window smaller"
            )
        self.signals = {name: one[samples[whole]] for name, one in arrays.items()}
        self.left_out = int((~whole).sum())
        self.period, self.settings = period, settings

    def __len__(self) -> int:
        """Windows B."""
        return len(next(iter(self.signals.values())))

    def driven(self, name: str) -> Floats:
        """Integrals of g times the driving signal, shape (B, orders)."""
        size = self.settings.window
        if not self.settings.held:
            return self._summed(self.signals[name], self._function(np.arange(size + 1)))
        # Gauss and Legendre's three points within each period that the signal is held over
        points, weights = np.polynomial.legendre.leggauss(3)
        within = np.arange(size)[:, None] + 0.5 * (1.0 + points)
        mean = np.einsum("p,npk->nk", 0.5 * weights, self._function(within))
        return self._summed(self.signals[name][:, :size], mean)

    def halves(self, signal: Floats) -> Floats:
        """Integrals of g times a signal, shape (B, W + 1), from every other sample.

        Shape (2, B, orders): from the even samples, and from the odd.
        """
        return self._split(signal, self._function(np.arange(self.settings.window + 1)))

    def rates(self, signal: Floats) -> Floats:
        """Integrals of g times the signal's derivative, as :meth:`halves`."""
        return -self._split(signal, self._slope(np.arange(self.settings.window + 1)))

    def _split(self, signal: Floats, weights: Floats) -> Floats:
        both = [self._summed(signal[:, i::2], 2.0 * weights[i::2]) for i in (0, 1)]
        return np.stack(both)

    def _summed(self, signal: Floats, weights: Floats) -> Floats:
        summed: Floats = signal @ weights * self.period
        return summed

    def _function(self, sample: ArrayLike) -> Floats:
        """The functions g at samples of a window, shape (..., orders)."""
        s = pi * np.asarray(sample, dtype=np.float64)[..., None] / self.settings.window
        return np.sin(s) ** 3 * np.cos(np.arange(self.settings.orders) * s)

    def _slope(self, sample: ArrayLike) -> Floats:
        """Their slopes g' [1/s], shape (..., orders)."""
        s = pi * np.asarray(sample, dtype=np.float64)[..., None] / self.settings.window
        k = np.arange(self.settings.orders)
        by_s = 3 * np.sin(s) ** 2 * np.cos(s) * np.cos(k * s) - np.sin(s) ** 3 * k * np.sin(k * s)
        return np.asarray(by_s * (pi / (self.settings.window * self.period)), dtype=np.float64)
