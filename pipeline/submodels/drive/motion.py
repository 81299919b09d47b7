"""Filtered motion and force of an axis, and the bandwidth of the filter.

Positions are differentiated after a Butterworth filter run forward and backward (no delay), by
central differences of fourth order.  What the regression sees, motion and force alike, passes one
more filter (parallel filtering: Gautier, Vandanjon and Presse 1994): a Gaussian, because its
impulse response ends, so that the samples around a stop can be cut out cleanly.  A linear model
passes through such a filter unchanged, whatever its bandwidth.

Unless it is given, the bandwidth holds ``HELD`` of the power of the acceleration, or, where that is
more, lets the filter settle in half of the shortest stretch of constant speed, and is doubled while
the cut around stops, which is as long as the filter's memory, leaves less than ``SURVIVES`` of the
acceleration: short moves from stop to stop would show no inertia (there noise may add ``LOUD``).
But it is at most where the noise of the position adds ``NOISE`` to the power of the acceleration,
which would make the mass too small by as much, and ``TOP`` of half the sampling rate.  Records
whose velocity and acceleration were recorded need no derivative; when their band is full they are
not filtered.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from pipeline.submodels.drive.records import AxisRecord, Recording

REACH = 0.4
"""Half length of the Gaussian in periods of its bandwidth [1]: 3 standard deviations."""


def first_difference(q: Floats, period: float) -> Floats:
    """Derivative by central differences of fourth order; the two samples at each end are held."""
    d: Floats = np.empty_like(q)
    d[2:-2] = (8 * (q[3:-1] - q[1:-3]) - (q[4:] - q[:-4])) / (12 * period)
    d[:2], d[-2:] = d[2], d[-3]
    return d


def second_difference(q: Floats, period: float) -> Floats:
    """Second derivative by central differences of fourth order; the ends are held."""
    d: Floats = np.empty_like(q)
    near, far = q[3:-1] + q[1:-3], q[4:] + q[:-4]
    d[2:-2] = (16 * near - far - 30 * q[2:-2]) / (12 * period**2)
    d[:2], d[-2:] = d[2], d[-3]
    return d


def low_passed(values: Floats, period: float, cut: float | None) -> Floats:
    """Butterworth of order 4 at ``cut`` [Hz], forward and backward."""
    if cut is None:
        return values
    from scipy.signal import butter, sosfiltfilt

    sos = butter(4, cut, fs=1 / period, output="sos")
    return sosfiltfilt(sos, values, padlen=min(len(values) - 1, int(3 / (cut * period))))


def gaussian(places: Ints, samples: int, period: float, bandwidth: float) -> Any:
    """Gaussian filter of -3 dB at ``bandwidth`` [Hz], at some samples only; sparse, (N, T).

    Its standard deviation is sqrt(ln 2) / (2 pi bandwidth); it ends ``REACH`` / bandwidth away.
    ``places`` (N,) are at least this reach from both ends of the signals' T ``samples``, which have
    the ``period`` [s] and the shape (T,) or (T, C).
    """
    from scipy.sparse import csr_array

    half = reach(period, bandwidth)
    offsets = np.arange(-half, half + 1)
    weights = np.exp(-0.5 * (offsets * period * 2 * np.pi * bandwidth) ** 2 / np.log(2))
    weights /= weights.sum()
    columns = (places[:, None] + offsets).ravel()
    starts = np.arange(len(places) + 1) * len(offsets)
    return csr_array((np.tile(weights, len(places)), columns, starts), shape=(len(places), samples))


def eroded(flags: Bools, reach: int) -> Bools:
    """True where all within ``reach`` samples are."""
    bad = np.flatnonzero(np.r_[True, ~flags, True]) - 1
    after = np.searchsorted(bad, np.arange(len(flags)))
    place = np.arange(len(flags))
    clear: Bools = (bad[after] - place > reach) & (place - bad[after - 1] > reach)
    return clear & flags


def reach(period: float, bandwidth: float) -> int:
    """Half length of the Gaussian filter in samples."""
    return int(np.ceil(REACH / (bandwidth * period)))


def white_noise(values: Floats) -> float:
    """Variance of the white noise in a smooth signal: fourth differences, or its resolution."""
    d = np.diff(values, 4)
    steps = np.abs(np.diff(values))
    step = float(np.min(steps[steps > 0], initial=np.inf))
    noise = (1.4826 * float(np.median(np.abs(d)))) ** 2 / 70  # 1 + 16 + 36 + 16 + 1
    return max(noise, step**2 / 12 if np.isfinite(step) else 0.0)


WIDER = 3.0
"""Bandwidth of the speed that friction is a function of, over that of the parallel filter."""
LATEST = 0.2
"""Greatest lag of an axis behind its reference [s]."""
QUIET = 4.0
"""Standard deviations of its noise below which a speed has no sign [1]."""
PRESLIDING = 3e-5
"""Travel after a stop or reversal over which friction is a spring, not a level [m]: rolling
guides and screws have 10 to 50 micrometres (Armstrong-Helouvry, Dupont and Canudas de Wit 1994)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Axis in a recording, ready for regression; N samples."""

    recording: str
    """Its name."""
    period: float
    """Sampling period [s]."""
    bandwidth: float | None
    """Bandwidth of the parallel filter still to be applied [Hz]; None for none."""
    time: Floats
    """Time [s]; shape (N,)."""
    position: Floats
    """Position [m]; integrated speed where only the speed was recorded; shape (N,)."""
    velocity: Floats
    acceleration: Floats
    """[m/s], [m/s^2]; shape (N,)."""
    force: Floats
    """Force of the motor: command times force constant; shape (N,)."""
    load: Floats | None
    """Load against positive motion [N]; shape (N,)."""
    instruments: tuple[Floats, Floats] | None
    """Velocity and acceleration of the reference, free of the noise of measurement; shape (N,)."""
    known: Bools
    """Recorded, free of cutting and away from the ends of the record; shape (N,)."""
    moving: Bools
    """Whether the axis slides: the speed has a significant sign, and has kept it for longer than
    presliding; shape (N,)."""


def motion(
    recording: "Recording", axis: str, bandwidth: float | None, delay: float = 0.0
) -> Motion:
    """Speed, acceleration and force of ``axis``.

    ``bandwidth`` is that of the parallel filter [Hz], None for records that are taken as they are;
    ``delay`` is that of the motion behind the command [s].
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


def _sliding(velocity: Floats, period: float, slow: float) -> Bools:
    """Whether the axis has moved in one direction for longer than presliding."""
    sign = np.where(np.abs(velocity) > slow, np.sign(velocity), 0.0)
    reversals = (
        np.flatnonzero(np.diff(sign, prepend=sign[0])) if len(sign) else np.zeros(0, np.int64)
    )
    travel = np.cumsum(velocity) * period
    since = np.zeros(len(sign), np.int64)
    since[reversals] = reversals
    since = np.maximum.accumulate(since)
    return np.asarray((sign != 0) & (np.abs(travel - travel[since]) > PRESLIDING))


def _instruments(
    record: "AxisRecord", measured: Floats, period: float, cut: float | None, every: int
) -> tuple[Floats, Floats] | None:
    """Velocity and acceleration of the reference, delayed by the lag of the axis."""
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


def _all_of(flags: Bools, every: int) -> Bools:
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
    """Velocity and acceleration filtered at ``cut``: recorded ones, else derivatives."""
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
    return np.interp(place - samples, place, smooth)


def _standstill(record: "AxisRecord", period: float, cut: float | None) -> float:
    """Speed below which its sign is noise [m/s]: noise of the position, differentiated."""
    top = 0.4 / period if cut is None else cut
    if record.velocity is not None:
        return QUIET * float(np.sqrt(white_noise(record.velocity) * 2 * period * top))
    density = 0.0 if record.position is None else 2 * period * white_noise(record.position)
    return QUIET * float(2 * np.pi * np.sqrt(density * top**3 / 3))


HELD = 0.95
"""Share of the power of the acceleration below the bandwidth [1]."""
SURVIVES = 0.2
"""Least RMS of the acceleration that the regression sees, over that of the record [1]."""
NOISE = 1e-3
"""Greatest share of noise in the power of the acceleration [1]."""
LOUD = 0.03
"""The same where the acceleration would not survive otherwise [1]: a mass too small by as much is
better than none, and the fits at other bandwidths widen its interval."""
TOP = 0.25
"""Greatest bandwidth over half the sampling rate [1]."""


def parallel_bandwidth(
    recordings: "Sequence[Recording]", axis: str, shortest: float
) -> float | None:
    """Bandwidth of the parallel filter [Hz] by the rule above; None for no filter.

    The recording with the greatest acceleration decides; ``shortest`` is the shortest stretch of
    constant speed [s].
    """
    shown = [one for one in recordings if axis in one.axes]
    found = [_bandwidth(one, axis, 4 * REACH / shortest) for one in shown]
    if not found:
        return None
    power, bandwidth, most = max(found, key=lambda one: one[0])
    at = [one[0] for one in found].index(power)
    while bandwidth is not None and bandwidth < most:
        if _surviving(shown[at], axis, bandwidth) >= SURVIVES * np.sqrt(power):
            break
        bandwidth = min(2 * bandwidth, most)
    return bandwidth


def _surviving(recording: "Recording", axis: str, bandwidth: float) -> float:
    """RMS of the acceleration where it is neither cut away nor filtered out [m/s^2]."""
    one = motion(recording, axis, bandwidth)
    places = np.flatnonzero(eroded(one.known & one.moving, reach(one.period, bandwidth)))
    if not len(places):
        return 0.0
    through = gaussian(places, len(one.time), one.period, bandwidth) @ one.acceleration
    return float(np.sqrt(np.mean(through**2)))


def _bandwidth(
    recording: "Recording", axis: str, settled: float
) -> tuple[float, float | None, float]:
    """Mean square of the acceleration, the bandwidth by the rule above, and the greatest [Hz]."""
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
        return 0.0, TOP * half, TOP * half
    power_held = float(signal[-1])

    def clear(share: float) -> float:
        """Frequency up to which noise adds at most a share of the power [Hz]."""
        below = np.flatnonzero(np.cumsum(noise) <= share * signal)
        return float(frequency[max(int(below[-1]), 1)]) if len(below) else float(frequency[1])

    quiet = clear(NOISE)
    below = signal[frequency <= quiet]
    held = float(frequency[np.searchsorted(below, HELD * below[-1])])
    if held > TOP * half and record.velocity is not None and record.acceleration is not None:
        return power_held * (frequency[1] - frequency[0]), None, TOP * half
    chosen = max(min(max(held, settled), quiet, TOP * half), 4 / recording.seconds)
    most = min(clear(LOUD), TOP * half)
    # quantisation is no white noise while the axis moves: what lies above is no acceleration
    inside = float(signal[frequency <= most][-1])
    return inside * (frequency[1] - frequency[0]), chosen, most


def _power(values: Floats, period: float) -> tuple[Floats, Floats]:
    """Frequencies [Hz] and one-sided power density."""
    from scipy.signal import welch

    length = min(len(values), int(4 / period))
    frequency, power = welch(values, 1 / period, nperseg=length, detrend=False)
    return frequency, power
