"""Log of a working day as an MTConnect agent or an adapter (SHDR) writes it: on change, polled.

Its faults follow the recordings of a real agent: temperatures that read 0 for one poll (in spells),
feed rates of 1e5 mm/s, counters that fall to 0, ``UNAVAILABLE`` for every item when the connection
is lost, stamped up to half a minute before lines that stand above it.
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import DAY
from pipeline.shop.files import write_text
from pipeline.shop.parameters import LogParameters, Random, ShopParameters, stamp
from pipeline.shop.sensors import DataItem, SensedDay, data_items
from pipeline.shop.timeline import Alarm

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


def losses(on: float, off: float, p: LogParameters, random: Random) -> list[Loss]:
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


def spread(count: int, low: int, high: int, random: Random, apart: int = APART) -> Ints:
    """Up to ``count`` polls between ``low`` and ``high``, at least ``apart`` from each other."""
    places: list[int] = []
    for place in np.sort(random.integers(low, max(high, low + 1), count)):
        if not places or place - places[-1] >= apart:
            places.append(int(place))
    return np.array(places, dtype=int)


def zero_polls(mean: float, polls: int, random: Random) -> Ints:
    """Polls at which a temperature reads 0: single polls, crowded in spells."""
    ends = np.cumsum(random.exponential(SPELL, 2 * polls // SPELL + 20)).astype(int)
    sick = np.searchsorted(ends, np.arange(polls)) % 2 == 1
    candidates = np.flatnonzero(sick)
    candidates = candidates[(candidates > 2) & (candidates < polls - 2)]
    if candidates.size == 0:
        return candidates
    chosen = np.unique(random.choice(candidates, random.poisson(mean)))
    return chosen[np.diff(chosen, prepend=-9) > 1]


def late_polls(times: Floats, busy: Ints, mean: float, random: Random) -> list[tuple[int, int]]:
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


def broken_line(stamp: str, random: Random) -> tuple[str, str]:
    """Kind and text of a line that no reader can parse."""
    kind = str(random.choice(["torn", "impossible_time", "nulls"]))
    if kind == "torn":
        return kind, stamp[: int(random.integers(6, 20))]
    if kind == "nulls":
        return kind, "\0" * int(random.integers(8, 64))
    return kind, f"{stamp[:10]}T24:6{random.integers(10)}:07.512Z|Xload|33"


def inject_glitches(
    numbers: dict[str, Floats], stamps: list[str], p: ShopParameters, truth: LogTruth,
    random: Random,
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


AGENT_UP = -3.7 * DAY
"""Start of the agent, before the first midnight [s]."""


@dataclass(kw_only=True)
class LogLines:
    """Records with their order in the file.

    ``keys`` orders the file: the number of the poll plus the rank of the item; a whole number and a
    bit for what stands between polls.  An adapter writes all pairs of one time on one line, an
    agent each on its own.
    """

    native: bool
    times: list[str] = field(default_factory=list)  # stamps of the polls
    keys: list[float] = field(default_factory=list)
    when: list[str] = field(default_factory=list)
    what: list[str] = field(default_factory=list)
    alone: list[bool] = field(default_factory=list)
    broken: int = 0

    @property
    def records(self) -> int:
        """Number of records that can be read."""
        return len(self.keys) - self.broken

    def add(self, polls: Ints, rank: int, item: DataItem, texts: list[str]) -> None:
        """Add values of one item at ``polls``; ``rank`` orders the items of one poll."""
        own = item.category == "CONDITION"
        offset = rank / 1000 + (0.2 if own and self.native else 0.0)
        self.keys += (polls + offset).tolist()
        self.when += [self.times[k] for k in polls.tolist()]
        self.what += [f"{item.name}|{text}" for text in texts]
        self.alone += [own] * len(texts)

    def add_unavailable(self, key: float, when: str, item: DataItem) -> None:
        """Add that ``item`` is not available."""
        own = item.category == "CONDITION"
        text = condition("UNAVAILABLE", self.native) if own else "UNAVAILABLE"
        offset = 0.01 if own and self.native else 0.0
        self._add_line(key + offset, when, f"{item.name}|{text}", own)

    def add_broken(self, key: float, text: str) -> None:
        """Add a line that no reader can parse."""
        self.broken += 1
        self._add_line(key, "", text, True)

    def _add_line(self, key: float, when: str, what: str, alone: bool) -> None:
        self.keys.append(key)
        self.when.append(when)
        self.what.append(what)
        self.alone.append(alone)

    def text(self) -> tuple[str, int]:
        """The file's text and its number of lines."""
        order = np.argsort(np.array(self.keys), kind="stable").tolist()
        pairs = zip(self.when, self.what, strict=True)
        lines = [f"{when}|{what}" if when else what for when, what in pairs]
        if not self.native:
            return "\n".join([lines[k] for k in order]) + "\n", len(order)
        rows: list[str] = []
        open_at = ""
        for k in order:
            if not self.alone[k] and self.when[k] == open_at:
                rows[-1] += f"|{self.what[k]}"
                continue
            rows.append(lines[k])
            open_at = "" if self.alone[k] else self.when[k]
        return "\n".join(rows) + "\n", len(rows)


def condition(level: str, native: bool, fields: tuple[str, ...] = ("", "", "", "")) -> str:
    """Level, code, severity, qualifier, text of a condition; agents write ``Normal``."""
    return "|".join([level if native else level.capitalize(), *fields])


@dataclass(kw_only=True)
class Log:
    """A log that is being written, day after day."""

    parameters: ShopParameters
    folder: Path
    random: Random
    truth: LogTruth = field(default_factory=LogTruth)
    last_burst: float = AGENT_UP  # s since the first midnight

    @property
    def items(self) -> list[DataItem]:
        """Data items of the machine."""
        return data_items(self.parameters.c_axis)

    @property
    def native(self) -> bool:
        """Whether values are written in native units."""
        return self.parameters.log.native

    @property
    def supplied(self) -> list[DataItem]:
        """Data items that the machine sends."""
        return [item for item in self.items if item.supplied]


def write_day(log: Log, day: SensedDay) -> None:
    """Write the file of ``day`` and enter its faults into the truth."""
    timeline, start = day.timeline, log.parameters.start
    midnight = timeline.day * DAY
    lines = LogLines(native=log.native)
    _head(log, lines, midnight)
    late, first_broken = 0, len(log.truth.rejected)
    if timeline.on < DAY:
        lost = losses(timeline.on, timeline.off, log.parameters.log, log.random)
        times = _polls(timeline.on, timeline.off, lost, log.parameters, log.random)
        _observations(log, lines, day, times, lost)
        _bursts(log, lines, day, times, lost)
        late = _delay_lines(log, lines, times, midnight)
        _break_lines(log, lines, times, midnight)
    name = f"agent/{stamp(start, midnight)[:10]}.txt"
    text, count = lines.text()
    write_text(log.folder / name, text, "utf-8")
    for entry in log.truth.rejected[first_broken:]:
        entry["file"] = name
    first = stamp(start, midnight)
    old = sum(b.lines for b in log.truth.bursts if b.late and b.time >= first)
    log.truth.files.append(
        LogFile(file=name, lines=count, records=lines.records, rejected=lines.broken,
                out_of_order=old + late)
    )  # fmt: skip


def _polls(on: int, off: int, lost: list[Loss], p: ShopParameters, random: Random) -> Floats:
    """Times of the polls that reach the log [s of the day]; the first is when the control is up."""
    ready = on + random.uniform(110, 155)
    count = int((off - on) / p.log.poll) + 50
    steps = np.maximum(p.log.poll + random.normal(0, p.log.jitter, count), 0.05)
    steps[random.random(count) < p.log.skipped_polls] *= 2
    times = np.round(np.concatenate([[on + random.uniform(0, 1)], ready + np.cumsum(steps)]), 3)
    arrives = times < off
    for loss in lost:
        arrives &= (times <= loss.kept) | (times >= loss.restart)
    return times[arrives]


def _poll_stamps(start: np.datetime64, midnight: float, times: Floats) -> list[str]:
    first = start.astype("datetime64[ms]") + np.timedelta64(int(midnight), "s")
    moments = first + np.round(times * 1000).astype("timedelta64[ms]")
    return [f"{m}Z" for m in np.datetime_as_string(moments, unit="ms").tolist()]


def _observations(
    log: Log, lines: LogLines, day: SensedDay, times: Floats, lost: list[Loss]
) -> None:
    """Add all changes of all items, and every item anew after a disconnection."""
    p, seconds = log.parameters, times.astype(int)
    numbers = {
        item.name: item.written(day.numbers[item.name][seconds], log.native)
        for item in log.items
        if item.name in day.numbers
    }
    lines.times = _poll_stamps(p.start, day.timeline.day * DAY, times)
    inject_glitches(numbers, lines.times, p, log.truth, log.random)
    restarts = [int(np.searchsorted(times, x.restart)) for x in lost if x.cause == "disconnect"]
    for rank, item in enumerate(log.supplied):
        codes: Floats | Ints
        if item.category == "CONDITION":
            codes, table = _alarm_codes(item, day.timeline.alarms, times, log.native)
        elif item.name in day.words:
            codes, table = day.words[item.name][0][seconds], day.words[item.name][1]
        else:
            codes, table = numbers[item.name], None
        first = 0 if item.at_start else 1
        changed = np.flatnonzero(codes[first + 1 :] != codes[first:-1]) + first + 1
        at = np.unique(np.concatenate([[first], restarts, changed]).astype(int))
        texts = (
            item.texts(codes[at], log.native) if table is None else [table[k] for k in codes[at]]
        )
        lines.add(at, rank, item, texts)


def _alarm_codes(
    item: DataItem, alarms: list[Alarm], times: Floats, native: bool
) -> tuple[Ints, list[str]]:
    """State of a condition at each poll: 0 normal, else the index of its alarm in the table."""
    codes, table = np.zeros(times.size, dtype=int), [condition("NORMAL", native)]
    for alarm in (a for a in alarms if a.name == item.name):
        a, b = np.searchsorted(times, [alarm.start, alarm.end])
        codes[a:b] = len(table)
        fields = (alarm.code, "", alarm.qualifier, alarm.text)
        table.append(condition(alarm.level, native, fields))
    return codes, table


def _head(log: Log, lines: LogLines, midnight: float) -> None:
    """Begin as an agent does, with the last values; an adapter begins with the present."""
    start = log.parameters.start
    now = stamp(start, midnight + 0.118)
    never, last = stamp(start, AGENT_UP, 6), stamp(start, log.last_burst, 6)
    for item in sorted(log.items, key=lambda i: i.supplied):
        when = now if log.native else last if item.supplied else never
        lines.add_unavailable(-1.0, when, item)
    if midnight == 0 and not log.native:
        log.truth.bursts.append(
            Burst(kind="agent_start", time=never, lines=len(log.items), late=False)
        )


def _bursts(log: Log, lines: LogLines, day: SensedDay, times: Floats, lost: list[Loss]) -> None:
    """Let every item become unavailable at each disconnection and when the machine goes off."""
    start, digits = log.parameters.start, 3 if log.native else 6
    midnight, supplied = day.timeline.day * DAY, log.supplied
    count = len(supplied)
    if log.native:
        count = 1 + sum(item.category == "CONDITION" for item in supplied)

    def burst(kind: str, key: float, when: str, late: bool) -> None:
        for item in supplied:
            lines.add_unavailable(key, when, item)
        log.truth.bursts.append(Burst(kind=kind, time=when, lines=count, late=late))

    for loss in lost:
        resumed = int(np.searchsorted(times, loss.restart))
        end = stamp(start, midnight + times[resumed])
        if loss.cause == "disconnect":
            when = stamp(start, midnight + loss.start, digits)
            burst("disconnect", resumed - 0.4, when, loss.late)
        began = stamp(start, midnight + loss.start)
        log.truth.unobserved.append(Unobserved(cause=loss.cause, start=began, end=end))
    log.last_burst = midnight + day.timeline.off + float(log.random.uniform(3, 11))
    burst("power_off", times.size + 20.0, stamp(start, log.last_burst, digits), False)


def _delay_lines(log: Log, lines: LogLines, times: Floats, midnight: float) -> int:
    """Let some values reach the file polls later than others of their poll; their number."""
    keys = np.array(lines.keys)
    polls = np.floor(keys).astype(int)
    regular = (keys >= 0) & (polls < times.size) & (keys - polls < 0.2)
    busy = np.bincount(polls[regular], minlength=times.size)
    count = 0
    for poll, delay in late_polls(times, busy, log.parameters.log.late_lines, log.random):
        mates = np.flatnonzero(regular & (polls == poll) & ~np.array(lines.alone))
        if mates.size == 0:
            continue
        k = int(log.random.choice(mates))
        lines.keys[k], lines.alone[k] = poll + delay + 0.3, True
        count += 1
        time = stamp(log.parameters.start, midnight + times[poll])
        entry = {"time": time, "record": lines.what[k], "polls": str(delay)}
        log.truth.late_lines.append(entry)
    return count


def _break_lines(log: Log, lines: LogLines, times: Floats, midnight: float) -> None:
    p = log.parameters
    count = int(log.random.poisson(p.log.broken_lines))
    for poll in log.random.integers(1, times.size, count):
        kind, text = broken_line(stamp(p.start, midnight + times[poll]), log.random)
        lines.add_broken(poll + 0.5, text)
        log.truth.rejected.append({"reason": kind, "line": text, "file": ""})
