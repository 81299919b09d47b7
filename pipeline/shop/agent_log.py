"""The log of one day, as an MTConnect agent or an adapter (SHDR) writes it: on change, polled."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.shop.dirt import Loss, losses
from pipeline.shop.glitches import inject
from pipeline.shop.items import Item, items
from pipeline.shop.ledger import Burst, Ledger, LogFile, Unobserved, stamp
from pipeline.shop.lines import Lines, add_broken, add_late, condition, number_texts
from pipeline.shop.measured import Day
from pipeline.shop.parameters import DAY, ShopParameters
from pipeline.shop.timeline import Alarm

AGENT_UP = -3.7 * DAY  # s, the agent was started before the first day


@dataclass(kw_only=True)
class Log:
    """A log that is being written, day after day."""

    parameters: ShopParameters
    folder: Path
    ledger: Ledger
    random: np.random.Generator
    last_burst: float = AGENT_UP  # s since the first midnight

    @property
    def items(self) -> list[Item]:
        """Data items of the machine."""
        return items(self.parameters.c_axis)

    @property
    def native(self) -> bool:
        """Whether values are written in native units."""
        return self.parameters.log.kind == "adapter"


def write_day(log: Log, day: Day) -> None:
    """Write the file of ``day`` and enter its dirt into the ledger."""
    timeline, p = day.timeline, log.parameters
    midnight = timeline.day * DAY
    lines = Lines(native=log.native)
    _header(log, lines, midnight)
    if timeline.on < DAY:
        lost = losses(timeline.on, timeline.off, p.log, log.random)
        times = _polls(timeline.on, timeline.off, lost, p, log.random)
        _observations(log, lines, day, times, lost)
        _bursts(log, lines, times, lost, midnight, timeline.off)
        late = add_late(lines, times, p, log.random, log.ledger, midnight)
        broken = add_broken(lines, times, p, log.random, log.ledger, midnight)
    else:
        late = broken = 0
    name = f"agent/{stamp(p.start, midnight)[:10]}.txt"
    text, count = lines.text()
    path = log.folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")
    for entry in log.ledger.rejected[len(log.ledger.rejected) - broken :]:
        entry["file"] = name
    first = stamp(p.start, midnight)
    old = sum(b.lines for b in log.ledger.bursts if b.late and b.time >= first)
    log.ledger.log_files.append(
        LogFile(file=name, lines=count, records=lines.records, rejected=broken,
                out_of_order=old + late)
    )  # fmt: skip


def _polls(
    on: int, off: int, lost: list[Loss], p: ShopParameters, random: np.random.Generator
) -> np.ndarray:
    """Times of the polls that reach the log [s of the day]; the first is when the control is up."""
    ready = on + random.uniform(110, 155)
    count = int((off - on) / p.log.poll) + 50
    steps = np.maximum(p.log.poll + random.normal(0, p.log.jitter, count), 0.05)
    steps[random.random(count) < p.log.skipped_polls] *= 2
    times = np.round(np.concatenate([[on + random.uniform(0, 1)], ready + np.cumsum(steps)]), 3)
    heard = times < off
    for loss in lost:
        heard &= (times <= loss.kept) | (times >= loss.restart)
    return times[heard]


def _observations(log: Log, lines: Lines, day: Day, times: np.ndarray, lost: list[Loss]) -> None:
    """All changes of all items; everything anew after a disconnection."""
    p, midnight = log.parameters, day.timeline.day * DAY
    seconds = times.astype(int)
    numbers = {
        i.name: i.written(day.numbers[i.name][seconds], log.native)
        for i in log.items
        if i.name in day.numbers
    }
    stamps = lines.stamps(p.start, midnight, times)
    inject(numbers, times, stamps, p, log.random, log.ledger, log.native)
    restarts = [int(np.searchsorted(times, x.restart)) for x in lost if x.cause == "disconnect"]
    for place, item in enumerate(i for i in log.items if i.supplied):
        if item.category == "CONDITION":
            codes, table = _alarm_codes(item, day.timeline.alarms, times, log.native)
        elif item.name in day.words:
            codes, table = day.words[item.name][0][seconds], day.words[item.name][1]
        else:
            codes, table = numbers[item.name], None
        first = 0 if item.at_start else 1
        changed = np.flatnonzero(codes[first + 1 :] != codes[first:-1]) + first + 1
        at = np.unique(np.concatenate([[first], restarts, changed]).astype(int))
        if table is None:
            texts = number_texts(codes[at], item, log.native)
        else:
            texts = [table[k] for k in codes[at]]
        lines.add(at, place, item, texts)


def _alarm_codes(
    item: Item, alarms: list[Alarm], times: np.ndarray, native: bool
) -> tuple[np.ndarray, list[str]]:
    """State of a condition at each poll: 0 normal, else the place of its alarm in the table."""
    codes, table = np.zeros(times.size, dtype=int), [condition("NORMAL", native)]
    for alarm in (a for a in alarms if a.name == item.name):
        a, b = np.searchsorted(times, [alarm.start, alarm.end])
        codes[a:b] = len(table)
        fields = (alarm.code, "", alarm.qualifier, alarm.text)
        table.append(condition(alarm.level, native, fields))
    return codes, table


def _header(log: Log, lines: Lines, midnight: float) -> None:
    """Begin as an agent does, with the last values known; an adapter says what is now."""
    start = log.parameters.start
    now = stamp(start, midnight + 0.118)
    never, last = stamp(start, AGENT_UP, 6), stamp(start, log.last_burst, 6)
    for item in sorted(log.items, key=lambda i: i.supplied):
        when = now if log.native else last if item.supplied else never
        lines.add_unavailable(-1.0, when, item)
    if midnight == 0 and not log.native:
        log.ledger.bursts.append(
            Burst(kind="agent_start", time=never, lines=len(log.items), late=False)
        )


def _bursts(
    log: Log, lines: Lines, times: np.ndarray, lost: list[Loss], midnight: float, off: int
) -> None:
    """Say of every item that it is not available: at each disconnection and at the end."""
    start, digits = log.parameters.start, 3 if log.native else 6
    supplied = [i for i in log.items if i.supplied]
    count = len(supplied)
    if log.native:
        count = 1 + sum(i.category == "CONDITION" for i in supplied)
    for loss in lost:
        resumed = int(np.searchsorted(times, loss.restart))
        end = stamp(start, midnight + times[resumed])
        if loss.cause == "disconnect":
            when = stamp(start, midnight + loss.start, digits)
            for item in supplied:
                lines.add_unavailable(resumed - 0.4, when, item)
            burst = Burst(kind="disconnect", time=when, lines=count, late=loss.late)
            log.ledger.bursts.append(burst)
        began = stamp(start, midnight + loss.start)
        log.ledger.unobserved.append(Unobserved(cause=loss.cause, start=began, end=end))
    log.last_burst = midnight + off + float(log.random.uniform(3, 11))
    when = stamp(start, log.last_burst, digits)
    for item in supplied:
        lines.add_unavailable(times.size + 20.0, when, item)
    log.ledger.bursts.append(Burst(kind="power_off", time=when, lines=count, late=False))
