"""Speed profiles of the growth records, the shop air, and the machine's work before them.

A machine stands overnight, is switched on half an hour before the record, and before a warm start
works for some hours.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.growth.heat import Course
from pipeline.shop.growth.parameters import PROFILES, Season
from pipeline.shop.motion import lagged, slewed
from pipeline.shop.parameters import ShopParameters, stamp

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


def _air(
    seconds: int, first: int, level: float, season: Season, random: np.random.Generator
) -> Floats:
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
    air: Floats = level + course + season.wander * wander - doors
    return air


def _speed(random: np.random.Generator, top: float, least: float = SLOWEST) -> float:
    return float(np.round(random.uniform(least, 1.0) * top / ROUNDED) * ROUNDED)


def _held(blocks: list[tuple[float, float]], seconds: int) -> Floats:
    """Speeds [rev/min] held for times [s] one after another, the last one to the end."""
    lengths = [max(round(length), 1) for _, length in blocks]
    held = np.repeat([speed for speed, _ in blocks], lengths)[:seconds]
    return np.append(held, np.full(seconds - held.size, blocks[-1][0]))


def _command(
    kind: Kind, number: int, random: np.random.Generator, parameters: ShopParameters
) -> Floats:
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


def _steps(random: np.random.Generator, top: float, seconds: int) -> Floats:
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


def _random(random: np.random.Generator, top: float, seconds: int) -> Floats:
    """Speeds at random, each held for 3 to 30 minutes; one in eight is a stop."""
    blocks = [(0.0, 120.0)]
    while sum(length for _, length in blocks) < seconds:
        speed = 0.0 if random.random() < 1 / 8 else _speed(random, top)
        blocks.append((speed, float(random.uniform(3, 30)) * MINUTE))
    return _held(blocks, seconds)


def _pauses(random: np.random.Generator, top: float, seconds: int) -> Floats:
    """Work at one or two speeds, with short stops and breaks between."""
    blocks = [(0.0, 180.0)]
    speeds = [_speed(random, top, 0.35), _speed(random, top, 0.5)]
    while sum(length for _, length in blocks) < seconds:
        blocks.append((speeds[int(random.integers(2))], float(random.uniform(15, 70)) * MINUTE))
        stop = random.uniform(2, 8) if random.random() < 0.6 else random.uniform(20, 60)
        blocks.append((0.0, float(stop) * MINUTE))
    return _held(blocks, seconds)


def _work(random: np.random.Generator, parameters: ShopParameters) -> Floats:
    """Speed over the hours of work before a warm start [rev/min], a short stop at its end."""
    seconds = round(float(random.uniform(1.5, 4.0)) * HOUR)
    work = _random(random, parameters.spindle.top_speed, seconds)
    return np.append(work, np.zeros(round(float(random.uniform(3, 12)) * MINUTE)))
