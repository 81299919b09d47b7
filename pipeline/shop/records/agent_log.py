"""Log of a working day as an MTConnect agent or an adapter (SHDR) writes it: on change, polled."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.si import DAY
from pipeline.shop.files import write_text
from pipeline.shop.parameters import ShopParameters, stamp
from pipeline.shop.records import log_faults as faults
from pipeline.shop.records.data_items import DataItem, data_items
from pipeline.shop.records.log_faults import Burst, LogFile, LogTruth, Loss, Unobserved
from pipeline.shop.records.sensors import SensedDay
from pipeline.shop.timeline import Alarm

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
    random: np.random.Generator
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
        lost = faults.losses(timeline.on, timeline.off, log.parameters.log, log.random)
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


def _polls(
    on: int, off: int, lost: list[Loss], p: ShopParameters, random: np.random.Generator
) -> Floats:
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
    faults.inject_glitches(numbers, lines.times, p, log.truth, log.random)
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
    for poll, delay in faults.late_polls(times, busy, log.parameters.log.late_lines, log.random):
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
        kind, text = faults.broken_line(stamp(p.start, midnight + times[poll]), log.random)
        lines.add_broken(poll + 0.5, text)
        log.truth.rejected.append({"reason": kind, "line": text, "file": ""})
