"""Lines of a log: collected in any order, written in the order in which they reached the file."""

from dataclasses import dataclass, field

import numpy as np

from pipeline.shop.dirt import broken_line, late_places
from pipeline.shop.items import Item
from pipeline.shop.ledger import Ledger, stamp
from pipeline.shop.parameters import ShopParameters


@dataclass(kw_only=True)
class Lines:
    """Records with their place in the file.

    ``keys`` orders the file: the poll's number plus the place of the item; a whole number and a bit
    for what stands between polls.  An adapter writes all pairs of one time on one line, an agent
    each on its own.
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

    def stamps(self, start: np.datetime64, midnight: float, times: np.ndarray) -> list[str]:
        """Stamps of polls at ``times`` (P,) [s after midnight]."""
        first = start.astype("datetime64[ms]") + np.timedelta64(int(midnight), "s")
        moments = first + np.round(times * 1000).astype("timedelta64[ms]")
        self.times = [f"{m}Z" for m in np.datetime_as_string(moments, unit="ms").tolist()]
        return self.times

    def add(self, polls: np.ndarray, place: int, item: Item, texts: list[str]) -> None:
        """Values of one item at ``polls``; ``place`` is the item's among its fellows."""
        own = item.category == "CONDITION"
        offset = place / 1000 + (0.2 if own and self.native else 0.0)
        self.keys += (polls + offset).tolist()
        self.when += [self.times[k] for k in polls]
        self.what += [f"{item.name}|{text}" for text in texts]
        self.alone += [own] * len(texts)

    def add_unavailable(self, key: float, when: str, item: Item) -> None:
        """``item`` is not available."""
        own = item.category == "CONDITION"
        self.keys.append(key + (0.01 if own and self.native else 0.0))
        self.when.append(when)
        text = condition("UNAVAILABLE", self.native) if own else "UNAVAILABLE"
        self.what.append(f"{item.name}|{text}")
        self.alone.append(own)

    def text(self) -> tuple[str, int]:
        """The file's text and its number of lines."""
        order = np.argsort(np.array(self.keys), kind="stable").tolist()
        if not self.native:
            rows = [self._row(k) for k in order]
            return "\n".join(rows) + "\n", len(rows)
        rows, open_at = [], ""
        for k in order:
            if not self.alone[k] and self.when[k] == open_at:
                rows[-1] += f"|{self.what[k]}"
                continue
            rows.append(self._row(k))
            open_at = "" if self.alone[k] else self.when[k]
        return "\n".join(rows) + "\n", len(rows)

    def _row(self, k: int) -> str:
        return f"{self.when[k]}|{self.what[k]}" if self.when[k] else self.what[k]


def condition(level: str, native: bool, fields: tuple[str, ...] = ("", "", "", "")) -> str:
    """Level, code, severity, qualifier, text of a condition; agents write ``Normal``."""
    return "|".join([level if native else level.capitalize(), *fields])


def number_texts(values: np.ndarray, item: Item, native: bool) -> list[str]:
    """Numbers as the log has them: whole ones without a point."""
    if item.decimals == 0 or (native and item.type == "EQUIPMENT_TIMER"):
        return [str(int(v)) for v in values.tolist()]
    return [f"{v:.10g}" for v in values.tolist()]


def add_late(
    lines: Lines, times: np.ndarray, p: ShopParameters, random: np.random.Generator,
    ledger: Ledger, midnight: float,
) -> int:  # fmt: skip
    """Let some values reach the file polls later than their fellows; the number of such lines."""
    keys = np.array(lines.keys)
    polls = np.floor(keys).astype(int)
    regular = (keys >= 0) & (polls < times.size) & (keys - polls < 0.2)
    busy = np.bincount(polls[regular], minlength=times.size)
    chosen = late_places(times, busy, p.log.late_lines, random)
    count = 0
    for poll, delay in chosen:
        mates = np.flatnonzero(regular & (polls == poll) & ~np.array(lines.alone))
        if mates.size == 0:
            continue
        k = int(random.choice(mates))
        lines.keys[k], lines.alone[k] = poll + delay + 0.3, True
        count += 1
        entry = {"time": stamp(p.start, midnight + times[poll]), "record": lines.what[k]}
        ledger.late_lines.append(entry | {"polls": str(delay)})
    return count


def add_broken(
    lines: Lines, times: np.ndarray, p: ShopParameters, random: np.random.Generator,
    ledger: Ledger, midnight: float,
) -> int:  # fmt: skip
    """Add lines that nobody can read; their number."""
    count = int(random.poisson(p.log.broken_lines))
    for poll in random.integers(1, times.size, count):
        kind, text = broken_line(stamp(p.start, midnight + times[poll]), random)
        lines.keys.append(poll + 0.5)
        lines.when.append("")
        lines.what.append(text)
        lines.alone.append(True)
        ledger.rejected.append({"reason": kind, "line": text, "file": ""})
    lines.broken = count
    return count
