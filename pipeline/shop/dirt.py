"""Dirt of the log: lost connections, wrong values, lines that come late, lines that are torn.

What goes wrong follows the recordings of a real agent: temperatures that read 0 for one poll (in
spells), feed rates of 1e5 mm/s, counters that fall to 0, ``UNAVAILABLE`` for every item when the
connection is lost, stamped up to half a minute before lines that stand above it.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.shop.parameters import LogParameters

MARGIN = 900  # s from switching on or off in which nothing is lost
SPELL = 600  # polls, mean length of a spell of zero temperatures
APART = 8  # polls between two pieces of dirt of one kind
SETTLED = 20.0  # s, longest time in which a late line still arrives


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Seconds of the day: nothing is heard after ``kept`` until ``restart``."""

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
    found: list[Loss] = []
    wanted = ["disconnect"] * random.poisson(p.disconnects)
    wanted += ["silence"] * random.poisson(p.silences)
    for cause in wanted:
        start = float(np.round(random.uniform(on + MARGIN, off - MARGIN - 3600), 3))
        late = cause == "disconnect" and random.random() < p.late_disconnects
        kept = start + random.uniform(24, 34) if late else start
        length = random.uniform(42, 75) if cause == "disconnect" else random.uniform(300, 3000)
        loss = Loss(cause=cause, start=start, kept=kept, restart=kept + length)
        if all(loss.start > x.restart + MARGIN or x.start > loss.restart + MARGIN for x in found):
            found.append(loss)
    return sorted(found, key=lambda x: x.start)


def spread(
    count: int, low: int, high: int, random: np.random.Generator, apart: int = APART
) -> np.ndarray:
    """Up to ``count`` places between ``low`` and ``high``, at least ``apart`` from each other."""
    places: list[int] = []
    for place in np.sort(random.integers(low, max(high, low + 1), count)):
        if not places or place - places[-1] >= apart:
            places.append(int(place))
    return np.array(places, dtype=int)


def zero_places(mean: float, polls: int, random: np.random.Generator) -> np.ndarray:
    """Polls at which a temperature reads 0: single polls, crowded in spells."""
    ends = np.cumsum(random.exponential(SPELL, 2 * polls // SPELL + 20)).astype(int)
    sick = np.searchsorted(ends, np.arange(polls)) % 2 == 1
    candidates = np.flatnonzero(sick)
    candidates = candidates[(candidates > 2) & (candidates < polls - 2)]
    if candidates.size == 0:
        return candidates
    chosen = np.unique(random.choice(candidates, random.poisson(mean)))
    return chosen[np.diff(chosen, prepend=-9) > 1]


def late_places(
    times: np.ndarray, busy: np.ndarray, mean: float, random: np.random.Generator
) -> list[tuple[int, int]]:
    """``(poll, polls late)`` of lines to be delayed; a younger line stands before each of them.

    ``times`` (P,) [s] of the polls; ``busy`` (P,) number of records of each poll.
    """
    late = []
    for place in spread(random.poisson(mean), 2, times.size - 8, random, apart=2 * APART):
        delay = int(random.integers(2, 7))
        after = slice(place + 1, place + delay + 1)
        if busy[after].any() and times[place + delay] - times[place] < SETTLED:
            late.append((int(place), delay))
    return late


def broken_line(stamp: str, random: np.random.Generator) -> tuple[str, str]:
    """A line that nobody can read and what is wrong with it."""
    kind = str(random.choice(["torn", "impossible_time", "nulls"]))
    if kind == "torn":
        return kind, stamp[: int(random.integers(6, 20))]
    if kind == "nulls":
        return kind, "\0" * int(random.integers(8, 64))
    return kind, f"{stamp[:10]}T24:6{random.integers(10)}:07.512Z|Xload|33"
