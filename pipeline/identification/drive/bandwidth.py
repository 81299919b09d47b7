"""Bandwidth of the parallel filter, from the records themselves.

Unless it is given, it is what holds ``HELD`` of the power of the acceleration, or, where that is
more, what lets the filter's memory pass in half of the shortest stretch of constant speed; but not
more than where the noise of the position adds ``NOISE`` to the power of the acceleration, which
would make the mass too small by as much, nor than ``TOP`` of half the sampling rate.  Records whose
velocity and acceleration were recorded need no derivative; when their band is full they are taken
as they are.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.filters import REACH, white_noise
from pipeline.identification.drive.motion import derivatives
from pipeline.identification.drive.records import Recording

Floats = NDArray[np.float64]

HELD = 0.95
NOISE = 1e-3
TOP = 0.25


def parallel_bandwidth(recordings: Sequence[Recording], axis: str, shortest: float) -> float | None:
    """Bandwidth of the parallel filter [Hz] by the rule above; None to take records as they are.

    Parameters
    ----------
    recordings : sequence of Recording
        That of them with the greatest acceleration counts.
    axis : str
        Its letter.
    shortest : float
        Stretch of constant speed [s].
    """
    shown = [one for one in recordings if axis in one.axes]
    found = [_bandwidth(one, axis, 4 * REACH / shortest) for one in shown]
    return max(found, key=lambda one: one[0])[1] if found else None


def _bandwidth(recording: Recording, axis: str, settled: float) -> tuple[float, float | None]:
    """Power of the acceleration, and the bandwidth by the rule."""
    record, period = recording.axes[axis], recording.period
    half = 0.5 / period
    _, acceleration = derivatives(
        record.position, record.velocity, record.acceleration, period, 0.5 * half
    )
    frequency, power = _power(acceleration * recording.air, period)
    noise = np.zeros_like(power)
    if record.velocity is None and record.position is not None:
        noise = 2 * period * white_noise(record.position) * (2 * np.pi * frequency) ** 4
    signal = np.cumsum(np.maximum(power - noise, 0))
    if signal[-1] <= 0:
        return 0.0, TOP * half
    power_held = float(signal[-1])
    clear = np.flatnonzero(np.cumsum(noise) <= NOISE * signal)
    quiet = float(frequency[max(int(clear[-1]), 1)]) if len(clear) else float(frequency[1])
    below = signal[frequency <= quiet]
    held = float(frequency[np.searchsorted(below, HELD * below[-1])])
    if held > TOP * half and record.velocity is not None and record.acceleration is not None:
        return power_held, None
    return power_held, max(min(max(held, settled), quiet, TOP * half), 4 / recording.seconds)


def _power(values: Floats, period: float) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and one-sided power density."""
    from scipy.signal import welch

    length = min(len(values), int(4 / period))
    frequency, power = welch(values, 1 / period, nperseg=length, detrend=False)
    return frequency, power
