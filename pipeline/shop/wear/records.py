"""Records of tool lives: seven channels of some cuts as Parquet, the list of them, the truth.

Forces on the workpiece pass the dynamometer's modes; accelerations are the modes of table, spindle
and tool under the same forces, with unbalance, bearings and the magnet's resonance; the envelope of
the emission is the root of the rate of work with the detector's lag, speckle and bursts of breaking
chips.  All have gains of the mounting, offset, drift, noise, the converter's steps and ends.
``wear/<tool>_<number>.parquet`` has the channels with their units and no time; ``wear/lives.csv``
one row a record in the order of cutting, with the land where it was measured.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema import store
from pipeline.schema.arrays import Floats
from pipeline.schema.si import DAY
from pipeline.shop.cutting.dynamometer import Window, converted
from pipeline.shop.cutting.force import AXIAL, CHIP, RUBBING, Motion, X, Y
from pipeline.shop.cutting.parameters import Conditions, Workpiece
from pipeline.shop.files import write_text
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import Random, ShopParameters, Wear, stamp
from pipeline.shop.wear.parameters import CHANNELS, Mode, PlannedLife, Sensors
from pipeline.shop.wear.teeth import (
    WornTool,
    conditions,
    cut_forces,
    flank_wear,
    new_tool,
    workpiece,
)

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


def mounted(sensors: Sensors, random: Random) -> Mounting:
    """Sensors mounted anew, drawn."""
    gain = 1 + random.normal(0, sensors.gain, CHANNELS)
    gain[EMISSION] = np.exp(random.normal(0, sensors.coupling))
    return Mounting(gain=gain, creep=float(random.normal(0, sensors.coupling / 2)))


def _filtered(
    values: Floats, above: Sequence[float], below: Sequence[float], rate: float
) -> Floats:
    """Response of a transfer function, ``above`` over ``below`` in powers of s, at ``rate``."""
    from scipy.signal import lfilter

    return lfilter(*_sampled(tuple(above), tuple(below), rate), values)


@cache
def _sampled(
    above: tuple[float, ...], below: tuple[float, ...], rate: float
) -> tuple[Floats, Floats]:
    """The transfer function in powers of the delay: designed once, not for each record."""
    from scipy.signal import bilinear

    return bilinear(above, below, fs=rate)


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


def _turning(sensors: Sensors, angle: Floats, random: Random) -> Floats:
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


def _emission(sensors: Sensors, force: Floats, cutting_speed: float, random: Random) -> Floats:
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
    sensors: Sensors, force: Floats, angle: Floats, cutting_speed: float, random: Random
) -> Floats:
    """Signals at the sensors at each row, shape (T, 7) [N, m/s2, V].

    ``force`` (FINE T, 6): of :func:`pipeline.shop.wear.teeth.cut_forces`; ``angle`` (FINE T,): of
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

    return sosfilt(butter(4, 0.8 / FINE, output="sos"), values, axis=0)[::FINE]


def recorded(
    sensors: Sensors, true: Floats, mounting: Mounting, life: float, random: Random
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
    return converted(values, np.array(sensors.ranges), sensors.bits)[0]


def truth(sensors: Sensors, mounting: Mounting) -> dict[str, Any]:
    """Gains of one mounting by the names of the columns."""
    names = zip(sensors.columns, mounting.gain.tolist(), strict=True)
    return {"gain": {n: round(g, 5) for n, g in names}, "emission_creep": round(mounting.creep, 5)}


BLOCK = 120.0
"""Length of a pass [mm]."""
LEAD = 0.04
"""Time before the first row in which modes and filters settle [s]."""
AIR = 0.08
"""Time in the air of a record that holds entry or exit [s]."""
SLOW = 0.15
"""Time constant of the spindle's wander and of the material's structure [s]."""
COLUMNS = (
    ("Recorded", "UTC"), ("File", ""), ("Tool", ""), ("Tool type", ""), ("Material", ""),
    ("Cut", ""), ("Speed", "1/min"), ("Feed", "mm/min"), ("Depth", "mm"), ("Width", "mm"),
    ("Time in cut", "min"), ("Feed travel", "m"), ("VB", "um"),
)  # fmt: skip
"""Columns of the list and their units."""
DEFINITION = {
    "wear_um": "width of the flank's land of each tooth at the record",
    "worn_after_min": "time in the cut until the mean land is what ends a life by its reading",
    "slope": "edge force by the land of a tooth: N for each mm of depth and each mm of land",
    "hardness": "of the batch against the usual one; force and wear follow it",
}


@dataclass(frozen=True, kw_only=True)
class Course:
    """One life at its K records: time in cut (K,) [min], hardness (K,) [1], land (K, F) [um]."""

    cuts: list[Conditions]
    names: list[str]
    tool: WornTool
    times: Floats
    hardness: Floats
    land: Floats
    measured: Floats
    """Reading after each record [um], NaN without one; shape (K,)."""
    worn_after: float
    """Time in the cut until the tool is worn, also of one that is still in use [min]."""


def course(wear: Wear, life: PlannedLife, random: Random) -> Course:
    """Life of one tool, until a reading shows that it is worn."""
    cutter, planned = wear.cutter(life), wear.planned(life)
    tool = new_tool(cutter, wear.rate, random)
    cuts = [conditions(one, cutter, life.speed) for one in planned]
    every = np.arange(wear.longest) + random.uniform(0.2, 0.6, wear.longest)
    times = every * life.interval
    changes = random.random(wear.longest) < 1 - np.exp(-life.interval / wear.rate.batch)
    drawn = 1 + random.normal(0, wear.rate.hardness_scatter, wear.longest + 1)
    hardness = drawn[np.cumsum(changes)]
    land = flank_wear(wear.rate, tool, cuts, times, hardness)
    mean, limit = land.mean(axis=1), wear.microscope.changed_at
    measured = _measured(wear, mean, random)
    over = np.flatnonzero(measured >= limit)
    count = min(int(over[0]) + 1 if over.size else wear.most, life.records or wear.most)
    return Course(
        cuts=cuts, names=[one.name for one in planned], tool=tool, times=times[:count],
        hardness=hardness[:count], land=land[:count], measured=measured[:count],
        worn_after=float(np.interp(limit, mean, times, right=np.inf)),
    )  # fmt: skip


def _measured(wear: Wear, mean: Floats, random: Random) -> Floats:
    """Readings of the microscope of mean lands (K,) [um], NaN where there is none."""
    scope = wear.microscope
    read = mean + random.normal(0, scope.error, mean.size)
    read = np.maximum(np.round(read / scope.step) * scope.step, 0.0)
    skipped = np.arange(mean.size) % scope.every != 0
    forgotten = random.random(mean.size) < scope.forgotten
    return np.where(skipped | forgotten, np.nan, read)


@dataclass(frozen=True, kw_only=True)
class _Cut:
    conditions: Conditions
    workpiece: Workpiece
    window: Window
    motion: Motion


def _cut(wear: Wear, life: Course, k: int, random: Random) -> _Cut:
    told = life.cuts[k % len(life.cuts)]
    depth = told.depth * (1 + random.normal(0, wear.depth_error))
    side = told.width if told.immersion == "slot" else told.width * (
        1 + random.normal(0, wear.width_error)
    )  # fmt: skip
    lot = random.random()
    window: Window = "inside"
    if lot < 2 * wear.entries:
        window = "entry" if lot < wear.entries else "exit"
    width = float(min(max(side, 0.01), life.tool.mill.diameter))
    true = replace(told, depth=float(max(depth, 0.05)), width=width)
    motion = _motion(wear, true, window, life.tool.mill.radius, random)
    batch = workpiece(wear.workpiece, float(life.hardness[k]))
    return _Cut(conditions=true, workpiece=batch, window=window, motion=motion)


def _motion(wear: Wear, c: Conditions, window: Window, radius: float, random: Random) -> Motion:
    rate, velocity, length = wear.sensors.rate * FINE, c.feed / 60e3, BLOCK * 1e-3
    ramp = AIR + radius / velocity if window != "inside" else 0.0
    steps = round((wear.sensors.seconds + ramp + LEAD) * rate)
    travel = steps / rate * velocity
    inside = random.uniform(radius, max(length - radius - travel, radius + 1e-4))
    first = {
        "inside": inside, "entry": -radius - (AIR + LEAD) * velocity,
        "exit": length + radius + AIR * velocity - travel,
    }[window]  # fmt: skip
    share = 1 / (SLOW * rate)
    wander = lagged(random.standard_normal(steps), share, 0.0) * np.sqrt(2 / share)
    error = random.uniform(-1, 1) * wear.speed_error
    speed = c.speed * pi / 30 * (1 + error + wear.speed_wander * wander)
    angle = random.uniform(0, 2 * pi) + np.cumsum(speed) / rate
    return Motion(angle=angle, x=first + np.arange(steps) * velocity / rate)


def write_wear(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``wear/*.parquet`` and ``wear/lives.csv`` into ``folder``, when wear is recorded.

    The truth: runout, rates and gains of each tool; land, hardness, depth and fault of each record;
    the slope of the edge forces over the land.
    """
    wear = parameters.wear
    if not wear.recorded:
        return {}
    rows: list[list[str | float]] = []
    tools = [_life(folder, number, parameters, rows) for number in range(len(wear.lives))]
    write_text(folder / "wear" / "lives.csv", _listed(rows, wear))
    w = wear.workpiece
    return {
        "definition": DEFINITION,
        "slope_N_mm2": {
            "tangential": w.flank_pressure * w.flank_friction, "radial": w.flank_pressure,
        },
        "tools": tools,
    }  # fmt: skip


def _life(
    folder: Path, number: int, parameters: ShopParameters, rows: list[list[str | float]]
) -> dict[str, Any]:
    """Write the records of one tool, add their ``rows`` to the list; the truth about it."""
    wear = parameters.wear
    plan = wear.lives[number]
    random = parameters.generator(f"wear {plan.tool}")
    life, mounting = course(wear, plan, random), mounted(wear.sensors, random)
    files = []
    start = parameters.start + np.timedelta64(DAY * (parameters.days + number) + 8 * 3600, "s")
    for k, minutes in enumerate(life.times.tolist()):
        lost = number == 0 and 0 <= k + 1 - wear.sensors.lost_from < wear.sensors.lost_count
        name = f"wear/{plan.tool}_{k + 1:03d}.parquet"
        cut, values = _values(wear, life, mounting, k, random)
        if lost:
            values[:, wear.sensors.lost - 1] *= LOST
        _write(folder / name, values, wear)
        c, told = life.cuts[k % len(life.cuts)], life.measured[k]
        travel = np.mean([one.feed for one in life.cuts]) * minutes * 1e-3
        rows.append([
            stamp(start, minutes * 90.0), name, plan.tool, plan.cutter, wear.workpiece.name,
            life.names[k % len(life.cuts)], c.speed, c.feed, c.depth, c.width, minutes,
            float(travel), float(told),
        ])  # fmt: skip
        files.append({
            "file": name, "wear_um": np.round(life.land[k], 2).tolist(),
            "hardness": round(float(life.hardness[k]), 5), "window": cut.window,
            "depth_mm": round(cut.conditions.depth, 4), "width_mm": round(cut.conditions.width, 4),
            "lost": wear.sensors.columns[wear.sensors.lost - 1] if lost else "",
            "measured_um": None if np.isnan(told) else float(told),
        })  # fmt: skip
    mill = asdict(life.tool.mill)
    kept = ("runout", "runout_angle", "tilt", "tilt_angle", "sharpness")
    return {
        "tool": plan.tool, "cutter": plan.cutter, **{name: mill[name] for name in kept},
        "rates": np.round(life.tool.teeth, 4).tolist(),
        "worn_after_min": round(life.worn_after, 3) if np.isfinite(life.worn_after) else None,
        **truth(wear.sensors, mounting),
        "files": files,
    }  # fmt: skip


def _values(
    wear: Wear, life: Course, mounting: Mounting, k: int, random: Random
) -> tuple[_Cut, Floats]:
    """The record ``k`` of a life, and its seven channels as the converter has them, (T, 7)."""
    cut = _cut(wear, life, k, random)
    mill, motion = life.tool.mill, cut.motion
    force = cut_forces(cut.conditions, mill, cut.workpiece, life.land[k], motion, BLOCK)
    share = 1 / (SLOW * wear.sensors.rate * FINE)
    structure = lagged(random.standard_normal(len(force)), share, 0.0) * np.sqrt(2 / share)
    force *= 1 + wear.unsteady * structure[:, None]
    speed = cut.conditions.speed * pi / 30 * mill.radius
    true = channels(wear.sensors, force, motion.angle, speed, random)
    rows = true[round(LEAD * wear.sensors.rate) :]
    return cut, recorded(wear.sensors, rows, mounting, k / wear.most, random)


def _write(path: Path, values: Floats, wear: Wear) -> None:
    import pyarrow as pa

    sensors = wear.sensors
    columns = (values * np.array(sensors.factors)).astype(np.float32).T
    fields = [
        pa.field(name, pa.float32(), metadata={"unit": unit})
        for name, unit in zip(sensors.columns, sensors.units, strict=True)
    ]
    store.write_table(pa.table([pa.array(c) for c in columns], schema=pa.schema(fields)), path)


def _listed(rows: list[list[str | float]], wear: Wear) -> str:
    head = [wear.delimiter.join(part) for part in zip(*COLUMNS, strict=True)]
    lines = [wear.delimiter.join(_cell(v, wear.decimal) for v in row) for row in rows]
    return "\n".join([*head, *lines]) + "\n"


def _cell(value: str | float, decimal: str) -> str:
    if isinstance(value, str):
        return value
    return "" if np.isnan(value) else f"{value:.3f}".rstrip("0").rstrip(".").replace(".", decimal)
