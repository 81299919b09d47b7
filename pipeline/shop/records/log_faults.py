"""Faults of the log: lost connections, wrong values, late lines, torn lines, and their truth.

They follow the recordings of a real agent: temperatures that read 0 for one poll (in spells), feed
rates of 1e5 mm/s, counters that fall to 0, ``UNAVAILABLE`` for every item when the connection is
lost, stamped up to half a minute before lines that stand above it.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.shop.parameters import LogParameters, ShopParameters
from pipeline.shop.records.data_items import data_items

MARGIN = 900
"""Time after switching on and before switching off in which no connection is lost [s]."""
SPELL = 600
"""Mean length of a spell of zero temperatures, in polls."""
APART = 8
"""Least distance between two faults of one kind, in polls."""
SETTLED = 20.0
"""Longest delay of a late line [s]."""
SIXTEEN_BITS = 65535.0
"""Speed that a spike shows: -1 read as an unsigned 16-bit word [rev/min]."""
FULL_DISPLAY = 99999.999
"""Position that a spike shows: all digits of the display [mm]."""


@dataclass(kw_only=True)
class Glitch:
    """One wrong value in the log; ``value`` as it is written."""

    kind: str
    item: str
    time: str
    value: str


@dataclass(kw_only=True)
class Burst:
    """All items became unavailable; ``late`` bursts stand after lines that are younger."""

    kind: str  # agent_start, power_off, disconnect
    time: str
    lines: int
    late: bool


@dataclass(kw_only=True)
class Unobserved:
    """A stretch in which the machine was on and the log does not say what it did."""

    cause: str  # disconnect, silence
    start: str
    end: str


@dataclass(kw_only=True)
class LogFile:
    """One file of the log: all lines, unreadable ones, those older than one before them."""

    file: str
    lines: int
    records: int
    rejected: int
    out_of_order: int


@dataclass(kw_only=True)
class LogTruth:
    """All faults of the log, which a reader of it should detect."""

    glitches: list[Glitch] = field(default_factory=list)
    bursts: list[Burst] = field(default_factory=list)
    unobserved: list[Unobserved] = field(default_factory=list)
    late_lines: list[dict[str, str]] = field(default_factory=list)
    rejected: list[dict[str, str]] = field(default_factory=list)
    files: list[LogFile] = field(default_factory=list)

    def document(self) -> dict[str, Any]:
        """Section ``log`` of the truth: every fault with its exact time, and counts."""
        kinds = sorted({g.kind for g in self.glitches})
        counts = {
            "glitches": {k: sum(g.kind == k for g in self.glitches) for k in kinds},
            "bursts": len(self.bursts),
            "late_lines": len(self.late_lines),
            "out_of_order": sum(f.out_of_order for f in self.files),
            "rejected": len(self.rejected),
            "lines": sum(f.lines for f in self.files),
        }
        return {"counts": counts, **asdict(self)}


@dataclass(frozen=True, kw_only=True)
class Loss:
    """A lost connection, in seconds of the day: no poll arrives from ``kept`` to ``restart``."""

    cause: str  # disconnect, silence
    start: float  # as the agent stamps it
    kept: float
    restart: float

    @property
    def late(self) -> bool:
        """Whether lines from after ``start`` stand before the burst."""
        return self.cause == "disconnect" and self.kept > self.start


def losses(on: float, off: float, p: LogParameters, random: np.random.Generator) -> list[Loss]:
    """Connections lost and silences of one day between ``on`` and ``off`` [s], in order."""
    drawn: list[Loss] = []
    causes = ["disconnect"] * random.poisson(p.disconnects)
    causes += ["silence"] * random.poisson(p.silences)
    for cause in causes:
        start = float(np.round(random.uniform(on + MARGIN, off - MARGIN - 3600), 3))
        late = cause == "disconnect" and random.random() < p.late_disconnects
        kept = start + random.uniform(24, 34) if late else start
        length = random.uniform(42, 75) if cause == "disconnect" else random.uniform(300, 3000)
        loss = Loss(cause=cause, start=start, kept=kept, restart=kept + length)
        if all(loss.start > x.restart + MARGIN or x.start > loss.restart + MARGIN for x in drawn):
            drawn.append(loss)
    return sorted(drawn, key=lambda x: x.start)


def spread(
    count: int, low: int, high: int, random: np.random.Generator, apart: int = APART
) -> Ints:
    """Up to ``count`` polls between ``low`` and ``high``, at least ``apart`` from each other."""
    places: list[int] = []
    for place in np.sort(random.integers(low, max(high, low + 1), count)):
        if not places or place - places[-1] >= apart:
            places.append(int(place))
    return np.array(places, dtype=int)


def zero_polls(mean: float, polls: int, random: np.random.Generator) -> Ints:
    """Polls at which a temperature reads 0: single polls, crowded in spells."""
    ends = np.cumsum(random.exponential(SPELL, 2 * polls // SPELL + 20)).astype(int)
    sick = np.searchsorted(ends, np.arange(polls)) % 2 == 1
    candidates = np.flatnonzero(sick)
    candidates = candidates[(candidates > 2) & (candidates < polls - 2)]
    if candidates.size == 0:
        return candidates
    chosen = np.unique(random.choice(candidates, random.poisson(mean)))
    return chosen[np.diff(chosen, prepend=-9) > 1]


def late_polls(
    times: Floats, busy: Ints, mean: float, random: np.random.Generator
) -> list[tuple[int, int]]:
    """``(poll, polls late)`` of lines to be delayed; a younger line stands before each of them.

    ``times`` (P,) of the polls [s]; ``busy`` (P,) number of records of each poll.
    """
    late = []
    for place in spread(random.poisson(mean), 2, times.size - 8, random, apart=2 * APART):
        delay = int(random.integers(2, 7))
        after = slice(place + 1, place + delay + 1)
        if busy[after].any() and times[place + delay] - times[place] < SETTLED:
            late.append((int(place), delay))
    return late


def broken_line(stamp: str, random: np.random.Generator) -> tuple[str, str]:
    """Kind and text of a line that no reader can parse."""
    kind = str(random.choice(["torn", "impossible_time", "nulls"]))
    if kind == "torn":
        return kind, stamp[: int(random.integers(6, 20))]
    if kind == "nulls":
        return kind, "\0" * int(random.integers(8, 64))
    return kind, f"{stamp[:10]}T24:6{random.integers(10)}:07.512Z|Xload|33"


def inject_glitches(
    numbers: dict[str, Floats], stamps: list[str], p: ShopParameters, truth: LogTruth,
    random: np.random.Generator,
) -> None:  # fmt: skip
    """Put wrong values into ``numbers`` (each (P,), as written) and enter them in the truth."""
    polls, log = len(stamps), p.log

    def drawn(mean: float) -> Ints:
        return spread(random.poisson(mean), 3, polls - 3, random)

    zeros = zero_polls(log.zero_temperatures, polls, random)
    wrong = [("zero_temperature", "S1temp", k, 0.0) for k in zeros]
    for k in drawn(log.feedrate_spikes):
        value = random.choice([-1.0, 1.0]) * random.uniform(3e4, 3e5)
        wrong.append(("feedrate_spike", "vpath", k, float(np.round(value, 1))))
    for k in drawn(log.speed_spikes):
        wrong.append(("speed_spike", "S1n", k, SIXTEEN_BITS))
    for k in drawn(log.position_spikes):
        wrong.append(("position_spike", f"{random.choice(list('XYZ'))}pos", k, FULL_DISPLAY))
    for k in drawn(log.counter_resets):
        wrong.append(("counter_reset", str(random.choice(["t_total", "t_auto", "t_cut"])), k, 0.0))
    items = {item.name: item for item in data_items(p.c_axis)}
    for kind, name, k, value in wrong:
        numbers[name][k] = value
        text = items[name].texts(np.array([value]), p.log.native)[0]
        truth.glitches.append(Glitch(kind=kind, item=name, time=stamps[k], value=text))
