"""Frequency response at the tool's tip, measured or of modes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.modes import DIRECTIONS, Mode, frf

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyResponse:
    """Receptance of the tip at F frequencies; straight between them, both its parts.

    Parameters
    ----------
    frequency_Hz : ndarray, shape (F,)
        Growing, above 0 [Hz].
    receptance : ndarray of complex, shape (F, 2, 2)
        Displacement over force [m/N], time as e^(i w t); rows: direction of the displacement,
        columns: of the force; x, y of the machine.  What was not measured is 0.

    Raises
    ------
    ValueError
        When frequencies do not grow, a value is not finite, or a direct receptance's imaginary
        part is positive at its peak: energy would come out of the structure.
    """

    frequency_Hz: Floats
    receptance: Complex

    def __post_init__(self) -> None:
        if len(self.frequency_Hz) < 2 or self.receptance.shape != (len(self.frequency_Hz), 2, 2):
            raise ValueError(
                f"frequency response: {len(self.frequency_Hz)} frequencies with a receptance of "
                f"shape {self.receptance.shape}; it needs two or more, each with a 2 x 2 matrix"
            )
        bad = ~np.isfinite(self.frequency_Hz) | ~np.isfinite(self.receptance).all(axis=(1, 2))
        if bad.any():
            raise ValueError(f"frequency response: value {int(bad.argmax()) + 1} is not finite")
        falls = np.flatnonzero(np.diff(self.frequency_Hz, prepend=0.0) <= 0.0)
        if len(falls):
            raise ValueError(
                f"frequency response: frequency {int(falls[0]) + 1}, "
                f"{self.frequency_Hz[falls[0]]:g} Hz, is not above the one before (or 0)"
            )
        for axis, name in enumerate(DIRECTIONS):
            direct = self.receptance[:, axis, axis]
            peak = int(np.abs(direct.imag).argmax())
            if direct[peak].imag > 0.0:
                raise ValueError(
                    f"frequency response: the imaginary part along {name} is positive at its peak, "
                    f"{self.frequency_Hz[peak]:g} Hz; change the sign of the imaginary part (or of "
                    "the displacement, where the hammer hits against the sensor)"
                )

    def at(self, frequency_Hz: Floats) -> Complex:
        """Receptance at frequencies within the measured ones [m/N]; shape (..., 2, 2)."""
        place = np.interp(frequency_Hz, self.frequency_Hz, np.arange(len(self.frequency_Hz)))
        low = np.minimum(place.astype(np.int64), len(self.frequency_Hz) - 2)
        share = (place - low)[..., None, None]
        between: Complex = self.receptance[low] * (1 - share) + self.receptance[low + 1] * share
        return between


Dynamics = Sequence[Mode] | FrequencyResponse
"""What gives way at the tip: modes, or a measured response."""


def receptance(dynamics: Dynamics, frequency_Hz: Floats) -> Complex:
    """Of either kind [m/N]; shape (F, 2, 2)."""
    if isinstance(dynamics, FrequencyResponse):
        return dynamics.at(frequency_Hz)
    return frf(dynamics, frequency_Hz)


def joined(parts: Sequence[FrequencyResponse]) -> FrequencyResponse:
    """Responses of several measurements as one, at the frequencies that all of them cover.

    Raises
    ------
    ValueError
        When there is none, two of them hold the same direction, or they share no frequencies.
    """
    if not parts:
        raise ValueError("frequency response: there is none to join")
    measured = np.array([np.any(part.receptance != 0, axis=0) for part in parts])
    twice = np.argwhere(measured.sum(axis=0) > 1)
    if len(twice):
        row, column = twice[0]
        raise ValueError(
            f"frequency response: {DIRECTIONS[row]} over {DIRECTIONS[column]} is measured more "
            "than once; leave one out, or say another direction for one of them"
        )
    low = max(part.frequency_Hz[0] for part in parts)
    high = min(part.frequency_Hz[-1] for part in parts)
    frequency = np.unique(np.concatenate([part.frequency_Hz for part in parts]))
    frequency = frequency[(frequency >= low) & (frequency <= high)]
    if len(frequency) < 2:
        raise ValueError(
            f"frequency response: the measurements share no frequencies, one begins at {low:g} Hz "
            f"and one ends at {high:g} Hz"
        )
    total = np.sum([part.at(frequency) for part in parts], axis=0)
    return FrequencyResponse(frequency_Hz=frequency, receptance=total)
