"""Seven channels beside a cut: forces on the workpiece, vibration of the nose, acoustic emission.

Forces pass the dynamometer's modes; accelerations are the modes of table, spindle and tool under
the same forces, with unbalance, bearings and the magnet's resonance; the envelope of the emission
is the root of the rate of work with the detector's lag, speckle and bursts of breaking chips.  All
of them have gains of the mounting, offset, drift, noise, the converter's steps and ends.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.wear.parameters import CHANNELS, Mode, Sensors
from pipeline.shop.wear.teeth import AXIAL, CHIP, RUBBING, X, Y

FINE = 2
"""Steps of the simulation for each row."""
FORCES, ACCELERATIONS, EMISSION = slice(0, 3), slice(3, 6), 6
LOST = 0.003
"""Share that a channel without its plug still shows [1]."""
TURNS = 100.0
"""Speed at which amplitudes of unbalance and bearings are stated [rev/s]: 6000 rev/min."""


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """Sensors as they were mounted for one tool: gain of each channel (7,) [1]."""

    gain: Floats
    creep: float
    """Logarithm by which the emission's coupling changes over the life."""


def mounted(sensors: Sensors, random: np.random.Generator) -> Mounting:
    """Sensors mounted anew, drawn."""
    gain = 1 + random.normal(0, sensors.gain, CHANNELS)
    gain[EMISSION] = np.exp(random.normal(0, sensors.coupling))
    return Mounting(gain=gain, creep=float(random.normal(0, sensors.coupling / 2)))


def _filtered(
    values: Floats, above: Sequence[float], below: Sequence[float], rate: float
) -> Floats:
    """Response of a transfer function, ``above`` over ``below`` in powers of s, at ``rate``."""
    from scipy.signal import lfilter

    out: Floats = lfilter(*_sampled(tuple(above), tuple(below), rate), values)
    return out


@cache
def _sampled(
    above: tuple[float, ...], below: tuple[float, ...], rate: float
) -> tuple[Floats, Floats]:
    """The transfer function in powers of the delay: designed once, not for each record."""
    from scipy.signal import bilinear

    found: tuple[Floats, Floats] = bilinear(above, below, fs=rate)
    return found


def _plate(force: Floats, frequency: float, damping: float, rate: float) -> Floats:
    w = 2 * np.pi * frequency
    return _filtered(force, [w * w], [1.0, 2 * damping * w, w * w], rate)


def _acceleration(force: Floats, modes: Sequence[Mode], rate: float) -> Floats:
    """Acceleration of the sum of some modes [m/s2], shape of ``force``."""
    total = np.zeros_like(force)
    for mode in modes:
        w = 2 * np.pi * mode.frequency
        below = [mode.mass, 2 * mode.damping * w * mode.mass, w * w * mode.mass]
        total += _filtered(force, [1.0, 0.0, 0.0], below, rate)
    return total


def _turning(sensors: Sensors, angle: Floats, random: np.random.Generator) -> Floats:
    """Acceleration by unbalance and bearings along x, y, z, shape (T, 3) [m/s2]."""
    speed = (angle[-1] - angle[0]) / (angle.size - 1) * sensors.rate * FINE / (2 * np.pi) / TURNS
    out = np.zeros((angle.size, 3))
    phase = random.uniform(0, 2 * np.pi)
    out[:, 0] += sensors.unbalance * speed**2 * np.cos(angle + phase)
    out[:, 1] += sensors.unbalance * speed**2 * np.sin(angle + phase)
    for multiple, amplitude in sensors.bearing:
        phases = random.uniform(0, 2 * np.pi, 3)
        out += amplitude * speed * np.cos(multiple * angle[:, None] + phases)
    return out


def _emission(
    sensors: Sensors, force: Floats, cutting_speed: float, random: np.random.Generator
) -> Floats:
    """Envelope of the acoustic emission before its gain, shape (T,) [V]."""
    work = sensors.shear * force[:, CHIP] + sensors.flank * force[:, RUBBING]
    level = np.sqrt(np.maximum(work * cutting_speed, 0.0))
    busy = level > 0
    level *= np.maximum(1 + random.normal(0, sensors.speckle, level.size) * np.sqrt(FINE), 0.0)
    rate = sensors.rate * FINE
    broken = random.random(level.size) < sensors.bursts / rate
    heights = random.exponential(sensors.burst * sensors.lag * rate, level.size)
    level += np.where(broken & busy, heights, 0.0)
    return _filtered(level, [1.0], [sensors.lag, 1.0], rate)


def channels(
    sensors: Sensors, force: Floats, angle: Floats, cutting_speed: float,
    random: np.random.Generator,
) -> Floats:  # fmt: skip
    """Signals at the sensors at each row, shape (T, 7) [N, m/s2, V].

    ``force`` (FINE T, 5): of :func:`pipeline.shop.wear.teeth.cut_forces`; ``angle`` (FINE T,): of
    the spindle [rad]; ``cutting_speed`` [m/s].
    """
    rate = sensors.rate * FINE
    on_plate = np.stack([-force[:, X], -force[:, Y], force[:, AXIAL]], axis=1)
    out = np.zeros((len(force), CHANNELS))
    for axis in range(3):
        out[:, axis] = _plate(on_plate[:, axis], sensors.plate[axis], sensors.plate_damping, rate)
    mixed = on_plate.copy()
    mixed[:, :2] += sensors.across * on_plate[:, 1::-1]
    turning = _turning(sensors, angle, random)
    for axis, modes in enumerate((sensors.x, sensors.y, sensors.z)):
        felt = _acceleration(mixed[:, axis], modes, rate) + turning[:, axis]
        out[:, 3 + axis] = _plate(felt, sensors.mounting, sensors.mounting_damping, rate)
    out[:, EMISSION] = _emission(sensors, force, cutting_speed, random)
    return _before_converter(out)


def _before_converter(values: Floats) -> Floats:
    """Rows after the anti-aliasing filter: Butterworth of the fourth order at 0.4 of the rate."""
    from scipy.signal import butter, sosfilt

    rows: Floats = sosfilt(butter(4, 0.8 / FINE, output="sos"), values, axis=0)[::FINE]
    return rows


def recorded(
    sensors: Sensors, true: Floats, mounting: Mounting, life: float, random: np.random.Generator
) -> Floats:
    """Output of the converter for ``true`` (T, 7), in its units, at a share of the ``life``."""
    gain = mounting.gain.copy()
    gain[EMISSION] *= np.exp(mounting.creep * life)
    time = np.arange(len(true))[:, None] / sensors.rate
    noise, offset, drift = (np.array(v) for v in (sensors.noise, sensors.offset, sensors.drift))
    values = true * gain + random.normal(0, 1, true.shape) * noise
    values += random.normal(0, 1, CHANNELS) * offset + random.normal(0, 1, CHANNELS) * drift * time
    phase = random.uniform(0, 2 * np.pi, 3)
    values[:, FORCES] += sensors.hum * np.sin(2 * np.pi * sensors.mains * time + phase)
    return converted(sensors, values)


def converted(sensors: Sensors, values: Floats) -> Floats:
    """Values (T, 7) in the converter's steps, cut off at its ends."""
    ends = 2.0 ** (sensors.bits - 1)
    step = np.array(sensors.ranges) / ends
    out: Floats = np.clip(np.round(values / step), -ends, ends - 1) * step
    return out


def truth(sensors: Sensors, mounting: Mounting) -> dict[str, Any]:
    """Gains of one mounting by the names of the columns."""
    names = zip(sensors.columns, mounting.gain.tolist(), strict=True)
    return {"gain": {n: round(g, 5) for n, g in names}, "emission_creep": round(mounting.creep, 5)}
