"""One data item on its way through a day."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.signals.cleaning import gaps as found_gaps
from pipeline.signals.cleaning.gaps import NOTHING_LOST, Gap, Lost
from pipeline.signals.cleaning.glitches import without_glitches
from pipeline.signals.cleaning.habits import Habit
from pipeline.signals.cleaning.resample import held, removed_holes
from pipeline.signals.cleaning.series import Ints, Series, empty, joined
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.columns import Column

Carry = dict[str, Any]
"""What one day leaves to the next, as JSON: ``spoken``, ``agent``, ``items``, ``held`` (position
control); times in ns."""


@dataclass(frozen=True, kw_only=True)
class Audit:
    """One change that cleaning made; ``after`` is null: removed."""

    time: int
    data_item: str
    before: str
    rule: str


class Item:
    """One data item on its way through a day."""

    def __init__(self, item: str, signal: Column, before: Carry) -> None:
        self.item, self.signal, self.before = item, signal, before
        self.series = self.raw = empty(text=signal.text)
        self.holes = np.array([], dtype=np.int64)
        self.words: list[Audit] = []
        self.apart = False

    def read(self, rows: pd.DataFrame) -> None:
        """Take the item's rows, after what was known before."""
        chosen = rows["wanted"].to_numpy() & (rows["data_item"] == self.item).to_numpy()
        part = rows[chosen]
        time = part["time"].to_numpy().astype(np.int64)
        value = _words(part) if self.signal.text else self._numbers(part, time)
        said = Series(time=time, value=value, fresh=~part["restated"].to_numpy(dtype=bool))
        self.apart = bool(part["apart"].any() or self.before.get("apart", False))
        known = [tuple(v) for k in ("good", "said") if (v := self.before.get(k))]
        past = list(dict.fromkeys(known))  # the last value is often also the last good one
        self.raw = joined(_brought_over(past, self.signal.text), said)

    def _numbers(self, part: pd.DataFrame, time: Ints) -> np.ndarray:
        number = part["number"].to_numpy(dtype=float).copy()
        word = part["text"].notna().to_numpy() & np.isnan(number)
        if word.any():
            text = part["text"].astype(object)[word]
            number[word] = pd.to_numeric(text, errors="coerce")
            lost = np.isnan(number[word])
            self.words = [
                Audit(time=int(t), data_item=self.item, before=str(w), rule="not_a_number")
                for t, w in zip(time[word][lost], text[lost], strict=True)
            ]
        return number

    def glitches(self, settings: CleanSettings, lost: Lost) -> list[Audit]:
        """Remove what cannot be true; what was removed, as audit rows."""
        cuts = NOTHING_LOST.cuts if self.apart else lost.cuts
        done = without_glitches(self.raw, self.signal, settings, cuts)
        self.series = done.series
        self.holes = removed_holes(self.raw, done.removed, settings.bridge_s)
        at = np.flatnonzero(done.removed)
        return self.words + [
            Audit(time=int(self.raw.time[i]), data_item=self.item,
                  before=f"{self.raw.value[i]:.10g}", rule=str(done.rule[i]))
            for i in at
        ]  # fmt: skip

    def gaps(self, lost: Lost, habit: Habit, settings: CleanSettings) -> list[Gap]:
        """The item's own gaps."""
        own = found_gaps.unavailable(self.item, self.raw)
        if self.apart:
            quiet = found_gaps.silences(self.raw.time, habit, settings, self.item)
        else:
            quiet = found_gaps.item_silences(self.item, self.raw, lost.gaps, habit, settings)
        self.holes = np.unique(np.r_[self.holes, [g.start + 1 for g in quiet]]).astype(np.int64)
        return own + quiet

    def known(self, lost: Lost) -> Series:
        """The clean series with "not known" wherever it is not."""
        lost = NOTHING_LOST if self.apart else lost
        hole = self.before.get("hole")
        past = np.array([] if hole is None else [hole], dtype=np.int64)
        self.holes = np.unique(np.r_[self.holes, lost.cuts, past]).astype(np.int64)
        whole = self.series.unknown_at(self.holes)
        since, until = lost.pauses[:, 0], lost.pauses[:, 1]
        again = Series(time=until, value=held(whole, until), fresh=np.zeros(len(until), dtype=bool))
        return joined(whole.unknown_at(since), again.keep(again.known))

    def left(self, end: int) -> Carry:
        """What is known of the item at ``end`` [ns], for the next day."""
        said = self.series.before(end)
        good = said.keep(said.known)
        holes = self.holes[self.holes < end]
        last = int(said.time[-1]) if len(said.time) else -1
        open_hole = len(holes) and holes[-1] >= last
        return {
            "said": _pair(said),
            "good": _pair(good),
            "hole": int(holes[-1]) if open_hole else None,
            "apart": self.apart,
        }


def _pair(series: Series) -> list[Any] | None:
    if not len(series.time):
        return None
    value = series.value[-1]
    lost = value is None or (not series.text and np.isnan(value))
    plain = None if lost else (str(value) if series.text else float(value))
    return [int(series.time[-1]), plain]


def _brought_over(past: list[tuple[Any, ...]], text: bool) -> Series:
    if not past:
        return empty(text=text)
    missing = None if text else np.nan
    words = [missing if v is None else v for _, v in past]
    value = np.array(words, dtype=object if text else float)
    time = np.array([t for t, _ in past], dtype=np.int64)
    return Series(time=time, value=value, fresh=np.zeros(len(past), dtype=bool))


def _words(part: pd.DataFrame) -> np.ndarray:
    text = np.array([None if pd.isna(word) else word for word in part["text"]], dtype=object)
    number = part["number"].to_numpy(dtype=float)
    for i in np.flatnonzero(~np.isnan(number)):
        if text[i] is None:
            text[i] = f"{number[i]:.10g}"
    return text
