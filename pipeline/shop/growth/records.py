"""Records of spindle growth: nine Pt100, the air and a displacement probe, once a minute.

Faults of the logger: offsets within class A, a sensor that drifts, one that dies, cells without a
value, a record that breaks off.  The probe is set to zero at the start of each record.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.files import torn, write_text
from pipeline.shop.growth.heat import KEPT, at_rest, heated
from pipeline.shop.growth.network import (
    HEAD_CELLS,
    Network,
    cell_at,
    network,
    speed_growth,
    thermal_growth,
)
from pipeline.shop.growth.parameters import SENSORS, Growth, Instruments
from pipeline.shop.growth.profiles import Profile, profiles
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import ShopParameters

INTERVAL = 60
"""Time between two rows [s]."""
OPEN = 850.0
"""Reading of a Pt100 channel without its sensor: the end of its range [degC]."""
NAMES = ("Time", "Speed", *(f"T{k}" for k in range(1, SENSORS + 1)), "Ambient", "Growth")
"""Names of the columns."""
TITLE = "Temperature and displacement logger TD-12 (simulated)"
DEFINITION = {
    "growth": "shift of the spindle's nose towards the table [um], 0 at the first row of a record",
    "true_growth_um": "of each row, without the probe's noise",
    "drift": "K to be added to the sensor's sound reading: rate times the hours that records ran",
    "parts_um": "growth at the last row by part; their sum is the growth",
}


@dataclass(frozen=True, kw_only=True)
class Place:
    """Place of a Pt100: a node of the network, and in words."""

    node: str
    words: str


def places(growth: Growth) -> tuple[Place, ...]:
    """Places of T1 to T9, from the spindle's front to its rear."""
    body = growth.body
    centre = (body.motor_begin + body.motor_end) / 2

    def housing(place: float, words: str) -> Place:
        return Place(node=f"housing_{cell_at(place, growth):02d}", words=words)

    return (
        housing(body.front - body.shaft_length / 20, "front cover of the housing"),
        Place(node="front_outer", words="outer ring of the front bearing"),
        Place(node="middle_outer", words="outer ring of the middle bearing"),
        housing(body.flange, "housing at its flange"),
        housing(body.motor_begin + 0.02, "housing at the front of the motor"),
        housing(centre, "housing at the middle of the motor"),
        housing(body.motor_end, "housing at the rear of the motor"),
        Place(node="rear_outer", words="outer ring of the rear bearing"),
        Place(node=f"head_{HEAD_CELLS - 2:02d}", words="head, above the spindle"),
    )


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One record: rows (R,) of time [s]; true temperatures (R, 10), the air last; growth [um]."""

    time: Floats
    speed: Floats
    temperatures: Floats
    growth: Floats
    parts: dict[str, float]


def measured(net: Network, profile: Profile, parameters: ShopParameters) -> Measured:
    """True inputs of the sensors of one record, and the true growth, at each row."""
    growth, course = parameters.growth, profile.course
    first = float(np.mean(course.air[: profile.lead // 2]))
    hot = heated(net, at_rest(net, first), course, parameters)
    begin = profile.lead // KEPT
    rows = np.arange(begin, len(hot.temperatures), INTERVAL // KEPT)
    seconds = np.minimum(rows * KEPT, course.speed.size - 1)
    speed, air = course.speed[seconds], course.air
    share = min(KEPT / max(growth.instruments.lag, KEPT), 1.0)
    at = np.minimum(np.arange(len(hot.temperatures)) * KEPT, air.size - 1)
    read = [
        lagged((1 - growth.instruments.stem) * hot.temperatures[:, net.names.index(p.node)]
               + growth.instruments.stem * air[at], share, first)
        for p in places(growth)
    ]  # fmt: skip
    read.append(lagged(air[at], share, first))
    parts = _part_growth(net, hot.temperatures[rows], growth)
    parts["speed"] = speed_growth(speed, growth) * 1e6
    total = np.sum(list(parts.values()), axis=0)
    return Measured(
        time=np.asarray((rows - begin) * KEPT, dtype=np.float64), speed=speed,
        growth=total - total[0], temperatures=np.column_stack(read)[rows],
        parts={name: round(float(v[-1] - v[0]), 3) for name, v in parts.items()},
    )  # fmt: skip


def _part_growth(net: Network, temperatures: Floats, growth: Growth) -> dict[str, Floats]:
    """Growth of the nose [um] that each part makes at ``temperatures`` (R, N), by its name."""
    parts: dict[str, Floats] = {}
    for name, per_kelvin in thermal_growth(growth).items():
        stem = name.split("_")[0]
        part = "rings" if stem in ("front", "middle") else stem
        more = temperatures[:, net.names.index(name)] * per_kelvin * 1e6
        parts[part] = parts[part] + more if part in parts else more
    return parts


@dataclass(kw_only=True)
class _Logger:
    """Logger over all records: offsets of its channels [K], the drift so far, the last value."""

    parameters: ShopParameters
    offsets: Floats
    drift: float = 0.0
    held: float | None = None


def _read(logger: _Logger, profile: Profile, true: Measured) -> tuple[Floats, dict[str, Any]]:
    """Table (R, 13) of one record as it is written, NaN for no value; its faults."""
    stand = logger.parameters.growth.instruments
    random = logger.parameters.generator(f"growth logger {profile.number}")
    values = true.temperatures + logger.offsets
    values += random.normal(0, stand.noise, values.shape)
    faults: dict[str, Any] = {}
    _drifted(logger, profile, true.time, values, faults)
    values = np.round(values / stand.resolution) * stand.resolution
    _died(logger, profile, true.time, values, faults)
    probe = true.growth + random.normal(0, stand.probe_noise, true.growth.size)
    probe -= random.normal(0, stand.probe_noise / 3)  # the mean of some readings is taken as zero
    probe = np.round(probe / stand.probe_resolution) * stand.probe_resolution
    shown = np.round(true.speed + np.where(true.speed > 0, random.normal(0, 1.0, probe.size), 0))
    table = np.column_stack([true.time, shown, values, probe])
    faults["missing"] = _blanked(table, stand, random)
    return table, faults


def _drifted(
    logger: _Logger, profile: Profile, time: Floats, values: Floats, faults: dict[str, Any]
) -> None:
    """Add the drift to its sensor; it goes on while records run."""
    stand = logger.parameters.growth.instruments
    if profile.number < stand.drift_from:
        return
    begin = stand.drift_after * 3600 if profile.number == stand.drift_from else 0.0
    drift = logger.drift + stand.drift_rate * np.maximum(time - begin, 0.0) / 3600
    values[:, stand.drifting - 1] += drift
    logger.drift = float(drift[-1])
    faults["drift_K"] = [round(float(drift[0]), 4), round(float(drift[-1]), 4)]


def _died(
    logger: _Logger, profile: Profile, time: Floats, values: Floats, faults: dict[str, Any]
) -> None:
    stand = logger.parameters.growth.instruments
    if profile.number < stand.dead_from:
        return
    begin = stand.dead_after * 3600 if profile.number == stand.dead_from else 0.0
    gone = time >= begin
    column = values[:, stand.dead - 1]
    if logger.held is None:
        logger.held = float(column[max(int(np.argmax(gone)) - 1, 0)])
    column[gone] = {"open": OPEN, "held": logger.held, "missing": np.nan}[stand.dead_as]
    faults["dead_from_s"] = float(time[gone][0])


def _blanked(
    table: Floats, stand: Instruments, random: np.random.Generator
) -> list[dict[str, object]]:
    """Take single values out of ``table``, of any column but the time; which ones."""
    cells = []
    for _ in range(int(random.poisson(stand.missing))):
        row, column = int(random.integers(1, len(table))), int(random.integers(2, table.shape[1]))
        table[row, column] = np.nan
        cells.append({"row": row, "column": NAMES[column]})
    return cells


def write_growth(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``growth/*.csv`` into ``folder``, when growth is recorded; the truth about it."""
    growth = parameters.growth
    if not growth.recorded:
        return {}
    net = network(parameters)
    random, tolerance = parameters.generator("growth sensors"), growth.instruments.tolerance
    limit = tolerance * (0.15 + 0.002 * 30.0)
    logger = _Logger(parameters=parameters, offsets=random.uniform(-limit, limit, SENSORS + 1))
    files = [_recorded(folder, net, profile, logger) for profile in profiles(parameters)]
    stand = growth.instruments
    return {
        "definition": DEFINITION,
        "nodes": len(net.names),
        "strain_um_per_K": {
            name: round(value * 1e6, 6) for name, value in thermal_growth(growth).items()
        },
        "sensors": [
            {"column": f"T{k}", "place": p.words, "node": p.node, "offset_K": round(float(o), 4)}
            for k, (p, o) in enumerate(zip(places(growth), logger.offsets, strict=False), 1)
        ],
        "ambient_offset_K": round(float(logger.offsets[-1]), 4),
        "drifting": {"column": f"T{stand.drifting}", "profile": stand.drift_from,
                     "after_s": stand.drift_after * 3600, "rate_K_per_h": stand.drift_rate},
        "dead": {"column": f"T{stand.dead}", "profile": stand.dead_from,
                 "after_s": stand.dead_after * 3600, "as": stand.dead_as},
        "files": files,
    }  # fmt: skip


def _recorded(folder: Path, net: Network, profile: Profile, logger: _Logger) -> dict[str, Any]:
    stand = logger.parameters.growth.instruments
    true = measured(net, profile, logger.parameters)
    table, faults = _read(logger, profile, true)
    file, breaks = f"growth/{profile.name}.csv", profile.number == stand.torn
    text = _text(table, profile, logger.parameters)
    write_text(folder / file, torn(text) if breaks else text, stand.encoding)
    return {
        "file": file, "number": profile.number, "kind": profile.kind, "start": profile.starts,
        "rows": len(table) - breaks, "torn": breaks, "air_mean_degC": round(profile.level, 3),
        "speeds_rpm": sorted({round(float(n)) for n in true.speed.tolist()}),
        "hours_before": round(profile.lead / 3600, 3), **faults, "parts_um": true.parts,
        "true_growth_um": np.round(true.growth, 3).tolist(),
    }  # fmt: skip


def _text(table: Floats, profile: Profile, parameters: ShopParameters) -> str:
    """One file: a block about the logger, names, units, rows."""
    stand = parameters.growth.instruments
    comma, western = stand.decimal == ",", stand.encoding == "cp1252"
    separator = ";" if comma else ","
    degrees, length = ("\N{DEGREE SIGN}C", "\N{MICRO SIGN}m") if western else ("degC", "um")
    units = ("s", "1/min", *[degrees] * (SENSORS + 1), length)
    head = [
        TITLE, f"Machine{separator}{parameters.machine}", f"Record{separator}{profile.name}",
        f"Start{separator}{profile.starts}", f"Interval{separator}{INTERVAL} s", "",
        separator.join(NAMES), separator.join(units),
    ]  # fmt: skip
    fine = (stand.resolution, stand.probe_resolution)
    temperature, probe = (max(len(f"{step:g}".partition(".")[2]), 1) for step in fine)
    decimals = (0, 0, *[temperature] * (SENSORS + 1), probe)
    rows = [separator.join(_cells(row, decimals, stand)) for row in (table + 0.0).tolist()]
    return "\n".join([*head, *rows]) + "\n"


def _cells(row: Sequence[float], decimals: Sequence[int], stand: Instruments) -> list[str]:
    words = [
        stand.blank if np.isnan(value) else f"{value:.{places}f}"
        for value, places in zip(row, decimals, strict=True)
    ]
    return [word.replace(".", stand.decimal) for word in words]
