"""What recordings show of a servo, and up to which frequency its equation is compared."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.known import AxisConstants
from pipeline.identification.drive.records import Recording

Floats = NDArray[np.float64]

ABOVE = 12.0
"""Bandwidth of what is compared, over that of the position loop [1]."""
FASTEST = 0.08
"""Of the recorder's rate that the bandwidth may be: delays of half a sample still show [1]."""
PERIODS = 40.0
"""Of the lowest bandwidth that the longest recording holds [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoRecord:
    """What one stretch of a recording shows of a servo, T samples.

    Parameters
    ----------
    reference, position : ndarray, shape (T,)
        [m].
    command : ndarray, shape (T,)
        [A].
    period : float
        [s].
    """

    reference: Floats = field(repr=False)
    position: Floats = field(repr=False)
    command: Floats = field(repr=False)
    period: float

    def rows(self, first: int, after: int) -> "ServoRecord":
        """Samples ``first`` to before ``after``."""
        part = slice(first, after)
        return replace(
            self, reference=self.reference[part], position=self.position[part],
            command=self.command[part],
        )  # fmt: skip


def servo_records(
    recordings: Sequence[Recording], axis: str
) -> tuple[list[ServoRecord], AxisConstants, str, list[str]]:
    """Records of one axis with one list of gains, that list, the command's unit, what is left out.

    Recordings that were taken with other gains than the first are another servo's.
    """
    found: list[ServoRecord] = []
    constants, unit, others = AxisConstants(), "A", []
    for recording in recordings:
        one = recording.axes.get(axis)
        if one is None or one.reference is None or one.position is None:
            continue
        if not found:
            constants, unit = one.constants, one.command_unit
        if one.constants != constants:
            others.append(recording.name)
            continue
        found.append(
            ServoRecord(
                reference=one.reference, position=one.position, command=one.command,
                period=recording.period,
            )
        )  # fmt: skip
    return found, constants, unit, others


def servo_bandwidth(records: Sequence[ServoRecord]) -> float:
    """Bandwidth of what is compared [Hz]: three times that of the position loop.

    At constant feed e = v / (S_pp P_p), which gives the position loop's gain.
    """
    top, bottom, slow, rate = 0.0, 0.0, np.inf, np.inf
    for one in records:
        v = np.gradient(one.position, one.period)
        e = one.reference - one.position
        top, bottom = top + float(v @ v), bottom + abs(float(e @ v))
        slow = min(slow, PERIODS / (one.period * len(v)))
        rate = min(rate, 1 / one.period)
    gain = top / bottom if bottom > 0 else np.inf
    return float(min(max(ABOVE * gain / (2 * np.pi), slow), FASTEST * rate))


def low_passed(signals: Floats, period: float, bandwidth: float) -> Floats:
    """Signals, shape (..., T), below ``bandwidth`` [Hz], without a shift in time."""
    from scipy.signal import butter, sosfiltfilt

    lowest = bandwidth * 2 * period
    if lowest >= 1:
        return signals
    found: Floats = sosfiltfilt(butter(3, lowest, output="sos"), signals, axis=-1)
    return found
