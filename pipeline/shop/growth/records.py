"""Records of spindle growth: nine Pt100, the air and a displacement probe, once a minute.

Speed profiles over a year, each after a night in the shop's air and half an hour of standing on; a
warm start has some hours of work before it.  Faults of the logger: offsets within class A, a sensor
that drifts, one that dies, cells without a value, a record that breaks off.  The probe is set to
zero at the start of each record.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.files import torn, write_text
from pipeline.shop.growth.heat import (
    HEAD_CELLS,
    KEPT,
    Course,
    Network,
    cell_at,
    heated,
    network,
    speed_growth,
    thermal_growth,
)
from pipeline.shop.growth.parameters import PROFILES, SENSORS, Growth, Instruments, Season
from pipeline.shop.motion import lagged, slewed
from pipeline.shop.parameters import Random, ShopParameters, stamp
from pipeline.shop.spindle import state_at_rest

Kind = Literal["warm-up", "steps", "random", "pauses", "equilibrium", "warm-start"]

KINDS: tuple[Kind, ...] = (
    "warm-up", "steps", "random", "pauses", "equilibrium", "warm-start", "steps", "random",
    "pauses", "warm-up", "random", "equilibrium", "steps", "warm-start", "random", "steps",
    "pauses", "warm-up", "warm-start", "equilibrium", "random", "steps", "pauses", "random",
    "warm-start", "steps",
)  # fmt: skip
"""Kind of each record, in their order."""
STEADY = (1.0, 0.9, 0.55, 0.65, 0.8, 0.75)
"""Speed of warm-up and equilibrium, one after another, as part of the top speed [1]."""
HOUR, MINUTE = 3600, 60
APART = 14
"""Days from one record to the next."""
OVERNIGHT = 12 * HOUR
"""Time that the machine stands in the shop's air before it is switched on [s]."""
LEAD = 30 * MINUTE
"""Time from switching on to the record, or to the work before it [s]."""
SLOWEST = 0.08
"""Least speed that is set, as part of the top speed [1]."""
ROUNDED = 50.0
"""Step in which speeds are set [rev/min]."""
NOON = 15.0
"""Hour at which the air is warmest."""


@dataclass(frozen=True, kw_only=True)
class Profile:
    """One record: its number from 1, kind, first instant, and the course of speed and air."""

    number: int
    kind: Kind
    start: np.datetime64
    lead: int
    """Time of ``course`` before the record [s]."""
    level: float
    """Mean of the air on that day [degC]."""
    course: Course

    @property
    def name(self) -> str:
        """Name of the profile's file."""
        return f"profile-{self.number:02d}-{self.kind}"

    @property
    def starts(self) -> str:
        """Its first instant, as the logger writes it."""
        return stamp(self.start, 0.0)[:19].replace("T", " ")


def profiles(parameters: ShopParameters) -> Iterator[Profile]:
    """Records of a machine that are made, in their order over a year before its first week."""
    season = parameters.growth.season
    shift = float(parameters.generator("growth season").uniform(0, 2 * np.pi))
    first = parameters.start - np.timedelta64(APART * PROFILES, "D")
    for number, kind in enumerate(KINDS, 1):
        if number not in parameters.growth.numbers:
            continue
        random = parameters.generator(f"growth profile {number}")
        before = _work(random, parameters) if kind == "warm-start" else np.zeros(0)
        command = _command(kind, number, random, parameters)
        lead = OVERNIGHT + LEAD + before.size
        opens = round(float(random.uniform(6.0, 10.5)) * HOUR / MINUTE) * MINUTE
        day = first + np.timedelta64(APART * (number - 1), "D")
        turn = np.cos(shift + 2 * np.pi * (number - 1) / PROFILES)
        level = season.mean + season.swing * float(turn) + float(random.normal(0, season.scatter))
        idle = np.zeros(OVERNIGHT + LEAD)
        speed = slewed(
            np.concatenate([idle, before, command]), parameters.spindle.motor.acceleration
        )
        air = _air(speed.size, opens - lead, level, season, random)
        power = np.arange(speed.size) >= OVERNIGHT
        yield Profile(
            number=number, kind=kind, start=day + np.timedelta64(opens, "s"), lead=lead,
            level=level, course=Course(speed, air, power),
        )  # fmt: skip


def _air(seconds: int, first: int, level: float, season: Season, random: Random) -> Floats:
    """Air at each second [degC], from ``first`` [s] of the day on."""
    hour = (first + np.arange(seconds)) / HOUR
    course = season.daily * np.cos(2 * np.pi * (hour - NOON) / 24)
    share = 1 / (20 * MINUTE)
    wander = lagged(random.standard_normal(seconds), share, 0.0) * np.sqrt(2 / share)
    works = (hour % 24 >= 6) & (hour % 24 < 18)
    opened = random.random(seconds) < np.where(works, season.doors / HOUR, 0.0)
    recovers = 1 / (season.recovery * MINUTE)
    fall = opened * random.uniform(0.4, 1.6, seconds) * season.drop / recovers
    # the cold spreads through the shop within two minutes
    doors = lagged(lagged(fall, recovers, 0.0), 1 / (2 * MINUTE), 0.0)
    return level + course + season.wander * wander - doors


def _speed(random: Random, top: float, least: float = SLOWEST) -> float:
    return float(np.round(random.uniform(least, 1.0) * top / ROUNDED) * ROUNDED)


def _held(blocks: list[tuple[float, float]], seconds: int) -> Floats:
    """Speeds [rev/min] held for times [s] one after another, the last one to the end."""
    lengths = [max(round(length), 1) for _, length in blocks]
    held = np.repeat([speed for speed, _ in blocks], lengths)[:seconds]
    return np.append(held, np.full(seconds - held.size, blocks[-1][0]))


def _command(kind: Kind, number: int, random: Random, parameters: ShopParameters) -> Floats:
    """Commanded speed at each second of a record [rev/min]."""
    top = parameters.spindle.top_speed
    hours = {"warm-up": (4.0, 5.5), "equilibrium": (6.5, 8.0)}.get(kind, (4.0, 7.5))
    minutes = round(float(random.uniform(*hours)) * 60)
    seconds = minutes * MINUTE + 1
    if kind in ("warm-up", "equilibrium"):
        before = sum(k in ("warm-up", "equilibrium") for k in KINDS[: number - 1])
        speed = round(STEADY[before] * top / ROUNDED) * ROUNDED
        still = float(random.uniform(3, 8)) * MINUTE
        if kind == "warm-up":
            return _held([(0.0, still), (speed, seconds)], seconds)
        running = float(random.uniform(0.58, 0.66)) * seconds
        return _held([(0.0, still), (speed, running), (0.0, seconds)], seconds)
    if kind == "steps":
        return _steps(random, top, seconds)
    if kind == "random":
        return _random(random, top, seconds)
    if kind == "pauses":
        return _pauses(random, top, seconds)
    again = _random(random, top, seconds // 2)
    speed = _speed(random, top, 0.3)
    return np.append(again, _held([(0.0, 1800), (speed, 3600), (0.0, seconds)], seconds // 2 + 1))[
        :seconds
    ]


def _steps(random: Random, top: float, seconds: int) -> Floats:
    """A staircase of speeds up and down again, each held for half an hour or more."""
    count = int(random.integers(4, 7))
    up = np.linspace(float(random.uniform(0.15, 0.3)), float(random.uniform(0.85, 1.0)), count)
    shares = [*up, *up[::-1][1:]] if random.random() < 0.5 else [*up[::-1], *up[1:]]
    length = 0.92 * seconds / len(shares)
    blocks = [(0.0, 240.0)]
    blocks += [
        (round(s * top / ROUNDED) * ROUNDED, length * float(random.uniform(0.8, 1.2)))
        for s in shares
    ]
    return _held([*blocks, (0.0, seconds)], seconds)


def _random(random: Random, top: float, seconds: int) -> Floats:
    """Speeds at random, each held for 3 to 30 minutes; one in eight is a stop."""
    blocks = [(0.0, 120.0)]
    while sum(length for _, length in blocks) < seconds:
        speed = 0.0 if random.random() < 1 / 8 else _speed(random, top)
        blocks.append((speed, float(random.uniform(3, 30)) * MINUTE))
    return _held(blocks, seconds)


def _pauses(random: Random, top: float, seconds: int) -> Floats:
    """Work at one or two speeds, with short stops and breaks between."""
    blocks = [(0.0, 180.0)]
    speeds = [_speed(random, top, 0.35), _speed(random, top, 0.5)]
    while sum(length for _, length in blocks) < seconds:
        blocks.append((speeds[int(random.integers(2))], float(random.uniform(15, 70)) * MINUTE))
        stop = random.uniform(2, 8) if random.random() < 0.6 else random.uniform(20, 60)
        blocks.append((0.0, float(stop) * MINUTE))
    return _held(blocks, seconds)


def _work(random: Random, parameters: ShopParameters) -> Floats:
    """Speed over the hours of work before a warm start [rev/min], a short stop at its end."""
    seconds = round(float(random.uniform(1.5, 4.0)) * HOUR)
    work = _random(random, parameters.spindle.top_speed, seconds)
    return np.append(work, np.zeros(round(float(random.uniform(3, 12)) * MINUTE)))


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
    hot = heated(net, state_at_rest(first, len(net.names)), course, parameters)
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


def _blanked(table: Floats, stand: Instruments, random: Random) -> list[dict[str, object]]:
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
