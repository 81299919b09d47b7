"""Windows of the twin's state: means over a few seconds, of a day or a week at once, by arrays.

A row counts where a program runs, unless its load says nothing of a cut: the spindle runs up or is
tapping, a tool is changed, the machine is warmed up.  A machine that is off has no row.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import MINUTE, NS
from pipeline.schema.twin_state import AXES, read_day
from pipeline.signals.columns import unit_of

MASKED = ("tool_change", "warm_up")
"""Modes whose load says nothing of a cut."""
BREAK_S = 900.0
"""Time without records from which on what came before does not go on [s]."""
MOST_Z = 20.0
"""Most that one row counts, over half of its interval [1]."""
RESIDUALS = {"spindle_temperature": "temperature", "no_load_power": "no_load",
             **{f"{axis}_following_error": f"{axis}_following" for axis in AXES}}  # fmt: skip
"""Quantities with a residual, and the names of their distances from the estimate."""
RAW = ("speed", "load", "load_spread", "feed", "temperature")
ACCELERATION = {"METER/SECOND^2", "MILLIMETER/SECOND"}
"""Units of vibration's RMS in further channels of the clean table."""
WORDS = ("program", "tool_number", "mode")
NAMES = (
    *RAW, "fed", "running", "warming", "silent", "cutting_power", "temperature_estimated",
    "temperature_low", "temperature_high", *(f"{name}_distance" for name in RESIDUALS.values()),
)  # fmt: skip
"""Values that every window has."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """W windows in the order of time."""

    start: Ints
    """Begin [ns since 1970]; shape (W,)."""
    length_s: float
    day: Any
    """Day of the plant of each window; shape (W,)."""
    values: Mapping[str, Floats]
    """Means over the rows that count, NaN where none does; shape (W,) each."""
    words: Mapping[str, Any]
    """Program, tool and mode at the begin, empty where not known; shape (W,) each."""
    counts: Bools
    """Whether at least half of the rows count; shape (W,)."""

    def __len__(self) -> int:
        return len(self.start)

    def where(self, keep: Any) -> Self:
        """Those windows alone."""
        return type(self)(
            start=self.start[keep], length_s=self.length_s, day=self.day[keep],
            values={name: one[keep] for name, one in self.values.items()},
            words={name: one[keep] for name, one in self.words.items()}, counts=self.counts[keep],
        )  # fmt: skip

    @classmethod
    def joined(cls, parts: Sequence[Self], length_s: float) -> Self:
        """Windows of days one after the other."""
        names = sorted({*NAMES, *(name for one in parts for name in one.values)})
        none = np.zeros(0)

        def all_of(name: str) -> Floats:
            rows = [one.values.get(name, np.full(len(one), np.nan)) for one in parts]
            return np.concatenate([none, *rows])

        return cls(
            start=np.concatenate([none.astype(np.int64), *(one.start for one in parts)]),
            length_s=length_s, day=np.concatenate([none.astype(str), *(one.day for one in parts)]),
            values={name: all_of(name) for name in names},
            words={name: np.concatenate([none.astype(str), *(one.words[name] for one in parts)])
                   for name in WORDS},
            counts=np.concatenate([none.astype(bool), *(one.counts for one in parts)]),
        )  # fmt: skip


def windows_of(
    folder: Path, clean: Path, days: Iterable[str], settings: IncidentSettings
) -> Windows:
    """Windows of ``days`` of a state, with channels of vibration that the clean table has."""
    parts = []
    for day in days:
        path, more = clean / "state" / f"{day}.parquet", None
        if settings.vibration and path.exists():
            names = [one.name for one in pq.read_schema(path) if unit_of(one) in ACCELERATION
                     and "vibration" in one.name]  # fmt: skip
            more = pq.read_table(path, columns=names) if names else None
        parts.append(day_windows(read_day(folder, day), day, settings, more))
    return Windows.joined(parts, settings.window_s)


def day_windows(
    table: pa.Table, day: str, settings: IncidentSettings, vibration: pa.Table | None = None
) -> Windows:
    """Windows of the rows of one day, and of channels of vibration with the same rows."""
    time = table["time"].cast(pa.int64()).to_numpy()
    step = round(settings.window_s * NS)
    place = time // step
    first = np.flatnonzero(np.diff(place, prepend=place[:1] - 1))
    rows = np.diff(first, append=len(time))

    def number(name: str, source: pa.Table = table) -> Floats:
        return np.asarray(source[name].to_numpy(zero_copy_only=False), dtype=np.float64)

    def total(values: Any) -> Floats:
        kind = np.int64 if values.dtype == bool else np.float64
        return np.add.reduceat(values, first, dtype=kind) if len(first) else np.zeros(0)

    def mean(values: Floats, where: Bools | None = None) -> Floats:
        known = np.isfinite(values) if where is None else np.isfinite(values) & where
        with np.errstate(invalid="ignore"):
            return total(np.where(known, values, 0.0)) / total(known)

    words = {name: _words(table[name]) for name in (*WORDS, "execution")}
    active = _is(words["execution"], ("ACTIVE",))
    speed, load, feed = (number(name) for name in ("spindle_speed", "spindle_load",
                                                   "path_feedrate"))  # fmt: skip
    speed, load = np.abs(speed), np.abs(load)
    steady = np.asarray(table["spindle_steady"].fill_null(False).to_numpy(zero_copy_only=False))
    warm = _is(words["mode"], MASKED)
    counts = active & ~warm & ((speed == 0) | steady.astype(bool))
    measured = number("spindle_temperature_measured")
    fed = np.abs(feed) * MINUTE >= settings.idle_feed_mm_min
    values = {
        "speed": mean(speed, counts), "load": mean(load, counts), "feed": mean(feed, counts),
        "fed": mean(np.where(np.isnan(feed), np.nan, fed), counts),
        "temperature": mean(measured), "running": total(active) / rows,
        "warming": total(_is(words["mode"], ("warm_up",))) / rows,
        "silent": mean(np.isnan(measured).astype(float), active & (words["execution"][1] >= 0)),
        "cutting_power": mean(number("cutting_power_estimated"), counts),
    }  # fmt: skip
    square = mean(load**2, counts) - values["load"] ** 2
    values["load_spread"] = np.sqrt(np.maximum(square, 0.0))
    for quantity, name in RESIDUALS.items():
        values[f"{name}_distance"] = mean(_distance(quantity, number))
    starts = np.flatnonzero(np.diff(time, prepend=-np.inf) > BREAK_S * NS)
    for begin in time[starts[active[starts]]]:  # how warm the spindle is inside is not known
        since = place[first] * step - begin
        values["temperature_distance"][(since > -step) & (since < settings.start_s * NS)] = np.nan
    for name in ("estimated", "low", "high"):
        values[f"temperature_{name}"] = mean(number(f"spindle_temperature_{name}"))
    for name in () if vibration is None else vibration.column_names:
        values[name] = mean(number(name, vibration), counts)
    return Windows(
        start=place[first] * step, length_s=settings.window_s, day=np.full(len(first), day),
        values=values, counts=total(counts) >= np.maximum(rows / 2, 1.0),
        words={name: np.array([*words[name][0], ""])[words[name][1][first]] for name in WORDS},
    )  # fmt: skip


def _words(column: pa.ChunkedArray) -> tuple[list[str], Ints]:
    """Different words of a column, and the place of each row's among them, -1 for none."""
    coded = column.combine_chunks()
    places = np.asarray(coded.indices.fill_null(-1).to_numpy(zero_copy_only=False))
    return [str(one) for one in coded.dictionary.to_pylist()], places


def _is(words: tuple[list[str], Ints], wanted: Sequence[str]) -> Bools:
    return np.array([one in wanted for one in words[0]] + [False])[words[1]]


def _distance(quantity: str, number: Any) -> Floats:
    """Residual over that half of the 90 % interval on its side, at most :data:`MOST_Z`; (T,)."""
    residual, estimated = number(f"{quantity}_residual"), number(f"{quantity}_estimated")
    low, high = number(f"{quantity}_low"), number(f"{quantity}_high")
    half = np.where(residual > 0, high - estimated, estimated - low)
    with np.errstate(invalid="ignore", divide="ignore"):
        found = np.where(half > 0, residual / half, np.nan)
    return np.clip(found, -MOST_Z, MOST_Z)


def held(values: Floats, windows: int) -> float:
    """Most that assessed ``values`` hold over ``windows`` in a row; -inf where there are fewer."""
    known = values[np.isfinite(values)]
    if len(known) < windows:
        return -np.inf
    return float(np.lib.stride_tricks.sliding_window_view(known, windows).min(axis=1).max())


def dwell(windows: Windows, seconds: float) -> int:
    """Windows in a time."""
    return max(1, ceil(seconds / windows.length_s))
