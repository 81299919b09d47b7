"""Modes of the structure at the tool's tip, as a modal test or a catalogue gives them.

A mode moves the tip in one direction of the machine's frame, and adds to the receptance there
1 / (k - m w^2 + i c w) = 1 / (k (1 - r^2 + 2 i zeta r)), r = w / w_n (Altintas 2012, eq. 3.20);
time goes as e^(i w t), so that the imaginary part is negative.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, pi
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

DIRECTIONS = ("x", "y")


@dataclass(frozen=True, kw_only=True)
class Mode:
    """One mode, seen at the tool's tip.

    Parameters
    ----------
    direction : {"x", "y"}
        Axis of the machine along which the tip moves.
    natural_frequency_Hz : float
        Undamped [Hz].
    damping : float
        Ratio zeta [1].
    stiffness_N_m, mass_kg : float, optional
        Modal stiffness [N/m] or modal mass [kg]; one of them says the other.

    Raises
    ------
    ValueError
        When a value is out of its range, or not exactly one of stiffness and mass is given.

    Examples
    --------
    >>> mode = Mode(direction="x", natural_frequency_Hz=922.0, damping=0.011, mass_kg=0.03993)
    >>> round(mode.stiffness / 1e6, 3)  # [N/um]
    1.34
    """

    direction: Literal["x", "y"]
    natural_frequency_Hz: float
    damping: float
    stiffness_N_m: float | None = None
    mass_kg: float | None = None

    def __post_init__(self) -> None:
        if self.direction not in DIRECTIONS:
            raise ValueError(f"mode.direction = {self.direction!r} is none: write x or y")
        if (self.stiffness_N_m is None) == (self.mass_kg is None):
            raise ValueError(
                f"mode.stiffness_N_m = {self.stiffness_N_m}, mode.mass_kg = {self.mass_kg}: give "
                "exactly one of them, the natural frequency says the other"
            )
        for name, highest in _HIGHEST.items():
            value = getattr(self, name)
            if value is not None and not (isfinite(value) and 0.0 < value < highest):
                below = "" if highest == inf else f" and below {highest:g}"
                raise ValueError(f"mode.{name} = {value} must be above 0{below}")

    @property
    def omega(self) -> float:
        """Natural angular frequency w_n [rad/s]."""
        return 2 * pi * self.natural_frequency_Hz

    @property
    def stiffness(self) -> float:
        """Modal stiffness k = m w_n^2 [N/m]."""
        if self.stiffness_N_m is None:
            return (self.mass_kg or 0.0) * self.omega**2
        return self.stiffness_N_m

    @property
    def mass(self) -> float:
        """Modal mass m [kg]."""
        return self.stiffness / self.omega**2

    @property
    def axis(self) -> int:
        """0 for x, 1 for y."""
        return DIRECTIONS.index(self.direction)


_HIGHEST = {"natural_frequency_Hz": inf, "damping": 1.0, "stiffness_N_m": inf, "mass_kg": inf}


def frf(modes: Sequence[Mode], frequency_Hz: ArrayLike) -> NDArray[np.complex128]:
    """Receptance of the tip, displacement over force [m/N]; a diagonal matrix at each frequency.

    Parameters
    ----------
    modes : sequence of Mode
        Their receptances add.
    frequency_Hz : array_like, shape (F,)
        [Hz].

    Returns
    -------
    ndarray of complex, shape (F, 2, 2)
        Rows: direction of the displacement; columns: of the force; x, y of the machine.
    """
    frequency = np.asarray(frequency_Hz, dtype=np.float64)
    receptance = np.zeros((*frequency.shape, 2, 2), dtype=np.complex128)
    for mode in modes:
        r = frequency / mode.natural_frequency_Hz
        flexible = 1.0 / (mode.stiffness * (1.0 - r * r + 2j * mode.damping * r))
        receptance[..., mode.axis, mode.axis] += flexible
    return receptance
