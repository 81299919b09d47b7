"""From the force on the workpiece to what stands in the file: modes, amplifier, converter."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.shop.cutting_force import AXIAL, X, Y
from pipeline.shop.dynamometer_parameters import RATE, ChannelMode, Dynamometer
from pipeline.shop.s_curve import Floats

FINE = 4
"""Steps of the simulation for each row: modes and edges' entries are fast."""
SHARE_OF_LOST = 0.004
"""What a channel without its cable still shows: stray capacitance."""


@dataclass(frozen=True, kw_only=True)
class Zero:
    """What one recording adds: offset [N], drift [N/s] and phase of the hum [rad], (3,) each."""

    offset: Floats
    drift: Floats
    hum_phase: Floats


def zero(dynamometer: Dynamometer, random: np.random.Generator) -> Zero:
    """Drawn for one recording."""
    return Zero(
        offset=random.normal(0, dynamometer.offset, 3),
        drift=random.normal(0, dynamometer.drift, 3), hum_phase=random.uniform(0, 2 * np.pi, 3),
    )  # fmt: skip


def crosstalk(dynamometer: Dynamometer, random: np.random.Generator) -> Floats:
    """What each channel (row) shows of each force (column), shape (3, 3) [1]."""
    mixed: Floats = random.uniform(0.4, 1.0, (3, 3)) * random.choice((-1.0, 1.0), (3, 3))
    mixed *= dynamometer.crosstalk
    np.fill_diagonal(mixed, 1.0)
    return mixed


def on_the_plate(on_tool: Floats, dynamometer: Dynamometer) -> Floats:
    """Forces (T, 4) on the tool as the plate feels them along its axes x, y, z, (T, 3) [N]."""
    ahead, left = -on_tool[:, X], -on_tool[:, Y]
    up = on_tool[:, AXIAL] if dynamometer.axial == "lift" else -on_tool[:, AXIAL]
    along_x = dynamometer.along == "x"
    return np.stack([ahead, left, up] if along_x else [-left, ahead, up], axis=1)


def disconnected(mixed: Floats, channel: int) -> Floats:
    """The same as :func:`crosstalk` with the cable of a channel off: next to nothing is left."""
    left = mixed.copy()
    left[channel] *= SHARE_OF_LOST
    return left


def shown(
    on_tool: Floats, mixed: Floats, own: Zero, dynamometer: Dynamometer, lead: int,
    random: np.random.Generator,
) -> Floats:  # fmt: skip
    """What the amplifier gives at each row, before the converter, shape (T, 3) [N].

    Parameters
    ----------
    on_tool : (FINE T + lead, 4) array
        Forces of :func:`.cutting_force.forces`, FINE steps a row.
    mixed : (3, 3) array
        Of :func:`crosstalk`.
    own, dynamometer
        Of the recording and of the whole.
    lead : int
        First steps, in which the modes settle, and which are not shown.
    random
        For the noise.
    """
    force = on_the_plate(on_tool, dynamometer)
    modes = (dynamometer.x, dynamometer.y, dynamometer.z)
    rung = [_rung(values, mode) for values, mode in zip((force @ mixed.T).T, modes, strict=True)]
    rows = np.stack(rung, axis=1)[lead::FINE]
    time = np.arange(len(rows))[:, None] / RATE
    hum = dynamometer.hum * np.sin(2 * np.pi * dynamometer.mains * time + own.hum_phase)
    noise = random.normal(0, dynamometer.noise, rows.shape)
    out: Floats = rows + own.offset + own.drift * time + hum + noise
    return out


def _rung(force: Floats, mode: ChannelMode) -> Floats:
    """Answer of a mode to a force that goes straight from step to step."""
    from scipy.signal import cont2discrete, lfilter

    w = 2 * np.pi * mode.frequency
    ratio = np.array([w * w]), np.array([1.0, 2 * mode.damping * w, w * w])
    above, below, _ = cont2discrete(ratio, 1 / (RATE * FINE), method="foh")
    out: Floats = lfilter(above.ravel(), below, force)
    return out


def converted(values: Floats, ends: float, bits: int) -> tuple[Floats, dict[str, Any]]:
    """What the converter makes of them, and how many values of each channel stand at its ends."""
    step = ends / 2 ** (bits - 1)
    counts = np.clip(np.round(values / step), -(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    at_end = (np.abs(counts) >= 2 ** (bits - 1) - 1).sum(axis=0)
    out: Floats = counts * step
    return out, {"range_N": ends, "step_N": step, "clipped": at_end.tolist()}
