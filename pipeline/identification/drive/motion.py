"""Speed and acceleration from recorded positions, and force beside them, through one filter.

Positions are differentiated after a Butterworth filter run forward and backward (no delay), by
central differences of fourth order.  What the regression sees, motion and force alike, goes
through one more filter (parallel filtering: Gautier, Vandanjon and Presse 1994): a Gaussian,
because its memory ends, so that what a stop does not tell can be cut out cleanly.  A linear model
passes through such a filter unchanged, whatever its bandwidth.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.filters import (
    first_difference,
    low_passed,
    reach,
    second_difference,
    white_noise,
)
from pipeline.identification.drive.records import AxisRecord, Recording

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WIDER = 3.0
"""Bandwidth of the speed that friction is a function of, over that of the parallel filter."""
LATEST = 0.2
"""No axis follows its reference later [s]."""
QUIET = 4.0
"""Speeds below as many standard deviations of their noise have no sign."""
PRESLIDING = 3e-5
"""Way after a stop or reversal over which friction is a spring rather than a level [m]; rolling
guides and screws have 10 to 50 micrometres (Armstrong-Helouvry, Dupont and Canudas de Wit 1994)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """One axis in one recording, ready for regression; N samples.

    Parameters
    ----------
    recording : str
        Its name.
    period : float
        From sample to sample [s].
    bandwidth : float or None
        Of the parallel filter still to be applied [Hz]; None for none.
    time : ndarray, shape (N,)
        [s].
    position : ndarray, shape (N,)
        [m]; way gone, where only the speed was recorded.
    velocity, acceleration : ndarray, shape (N,)
        [m/s], [m/s^2].
    force : ndarray, shape (N,)
        Of the motor: command times force constant.
    load : ndarray, shape (N,), optional
        Against positive motion [N].
    instruments : tuple of ndarray, shape (N,), optional
        Velocity and acceleration of the reference, free of the noise of measurement.
    known : ndarray of bool, shape (N,)
        Recorded, free of cutting and away from the ends.
    moving : ndarray of bool, shape (N,)
        Whether the speed has a sign that is known, and has had it for longer than presliding.
    """

    recording: str
    period: float
    bandwidth: float | None
    time: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats
    force: Floats
    load: Floats | None
    instruments: tuple[Floats, Floats] | None
    known: Flags
    moving: Flags


def motion(recording: Recording, axis: str, bandwidth: float | None, delay: float = 0.0) -> Motion:
    """Speed, acceleration and force of ``axis``.

    Parameters
    ----------
    recording : Recording
        That shows the axis.
    axis : str
        Its letter.
    bandwidth : float or None
        Of the parallel filter [Hz]; None for records that are taken as they are.
    delay : float
        How long the motion is behind the command [s].
    """
    record, period = recording.axes[axis], recording.period
    cut = None if bandwidth is None else min(WIDER * bandwidth, 0.8 * 0.5 / period)
    every = 1 if cut is None else max(int(0.25 / (cut * period)), 1)
    velocity, acceleration = derivatives(
        record.position, record.velocity, record.acceleration, period, cut
    )
    place = np.cumsum(velocity) * period if record.position is None else record.position
    slow = _standstill(record, period, cut)
    ends = 0 if bandwidth is None else 2 * reach(period, bandwidth)
    inside = np.zeros(recording.samples, bool)
    inside[ends : recording.samples - ends] = True
    return Motion(
        recording=recording.name,
        period=period * every,
        bandwidth=bandwidth,
        time=period * np.arange(recording.samples, dtype=np.float64)[::every],
        position=place[::every],
        velocity=velocity[::every],
        acceleration=acceleration[::every],
        force=record.force_constant * _later(record.command, delay / period, period, cut)[::every],
        load=None if record.load is None else low_passed(record.load, period, cut)[::every],
        instruments=_instruments(record, velocity, period, cut, every),
        known=_all_of(recording.air, every) & inside[::every],
        moving=_sliding(velocity, period, slow)[::every],
    )


def _sliding(velocity: Floats, period: float, slow: float) -> Flags:
    """Whether the axis has gone one way for longer than presliding."""
    way = np.where(np.abs(velocity) > slow, np.sign(velocity), 0.0)
    turns = np.flatnonzero(np.diff(way, prepend=way[0])) if len(way) else np.zeros(0, np.int64)
    gone = np.cumsum(velocity) * period
    since = np.zeros(len(way), np.int64)
    since[turns] = turns
    since = np.maximum.accumulate(since)
    return np.asarray((way != 0) & (np.abs(gone - gone[since]) > PRESLIDING))


def _instruments(
    record: AxisRecord, measured: Floats, period: float, cut: float | None, every: int
) -> tuple[Floats, Floats] | None:
    """Velocity and acceleration of the reference, as late as the axis follows it."""
    if record.reference is None and record.velocity_reference is None:
        return None
    velocity, acceleration = derivatives(
        record.reference, record.velocity_reference, record.acceleration_reference, period, cut
    )
    velocity, acceleration = velocity[::every], acceleration[::every]
    if cut is None:
        return velocity, acceleration
    lags = range(min(int(LATEST / (period * every)), len(velocity) // 2))
    followed = measured[::every]
    alike = [float(velocity[: len(velocity) - k] @ followed[k:]) for k in lags]
    late = int(np.argmax(alike)) if alike else 0
    return _held_back(velocity, late), _held_back(acceleration, late)


def _held_back(values: Floats, samples: int) -> Floats:
    return np.r_[np.full(samples, values[0]), values[: len(values) - samples]]


def _all_of(flags: Flags, every: int) -> Flags:
    """Whether all of each ``every`` samples are true, at the first of each."""
    padded = np.r_[flags, np.ones(-len(flags) % every, bool)]
    return np.asarray(padded.reshape(-1, every).all(axis=1))


def derivatives(
    position: Floats | None,
    velocity: Floats | None,
    acceleration: Floats | None,
    period: float,
    cut: float | None,
) -> tuple[Floats, Floats]:
    """Velocity and acceleration: as recorded, else derived from what is; filtered at ``cut``."""
    if velocity is not None:
        v = low_passed(velocity, period, cut)
        a = first_difference(v, period)
    elif position is not None:
        q = low_passed(position, period, cut)
        v, a = first_difference(q, period), second_difference(q, period)
    else:
        raise ValueError("neither position nor velocity is recorded")
    return v, a if acceleration is None else low_passed(acceleration, period, cut)


def _later(values: Floats, samples: float, period: float, cut: float | None) -> Floats:
    """Filtered values, each ``samples`` later; the ends are held."""
    smooth = low_passed(values, period, cut)
    if samples == 0:
        return smooth
    place = np.arange(len(values))
    shifted: Floats = np.interp(place - samples, place, smooth)
    return shifted


def _standstill(record: AxisRecord, period: float, cut: float | None) -> float:
    """Speed below which its sign is not known [m/s]: noise of the position, differentiated."""
    top = 0.4 / period if cut is None else cut
    if record.velocity is not None:
        return QUIET * float(np.sqrt(white_noise(record.velocity) * 2 * period * top))
    density = 0.0 if record.position is None else 2 * period * white_noise(record.position)
    return QUIET * float(2 * np.pi * np.sqrt(density * top**3 / 3))
