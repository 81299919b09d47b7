"""Contiguous segments of state tables (every input known) and of recordings (uniform grid)."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class StateSegment:
    """Contiguous segment of a day in which every input is known."""

    day: str
    """Day of the plant, ``YYYY-MM-DD``."""
    frame: "pd.DataFrame"
    """Inputs and target, one row a step, by the UTC time of the step's beginning."""
    step: float
    """Step of time [s]."""
    bridged: int
    """Steps whose inputs were unknown and held from before."""


def state_days(clean: Path, start: str | None = None, end: str | None = None) -> list[str]:
    """Days with a state table in ``clean`` from ``start`` to ``end``, both included."""
    days = sorted(p.stem for p in (clean / "state").glob("*.parquet"))
    return [d for d in days if (start is None or d >= start) and (end is None or d <= end)]


def absent_items(clean: Path) -> dict[str, list[str]]:
    """Data items of the machine's file without records, each with similar names."""
    try:
        summary = json.loads((clean / "summary.json").read_text(encoding="utf-8"))
        return {item: summary["near"].get(item, []) for item in summary["absent"]}
    except (OSError, ValueError, KeyError):
        return {}


def read_state(clean: Path, day: str) -> "pd.DataFrame":
    """The state table of one day, indexed by time in the zone of the plant."""
    path = clean / "state" / f"{day}.parquet"
    if not path.exists():
        raise ValueError(
            f"no state table of {day} in {clean}: run the stage clean for this machine"
        )
    import pandas as pd

    return pd.read_parquet(path).set_index("time")


def state_segments(
    frame: "pd.DataFrame",
    day: str,
    *,
    inputs: Sequence[str],
    target: str,
    step: float,
    bridge_s: float,
    shortest_s: float,
) -> Iterator[StateSegment]:
    """Segments of a day, averaged over steps, in which every input is known.

    Unknown inputs are held for up to ``bridge_s`` seconds; a longer gap ends a segment.  A segment
    begins with a measured target and lasts at least ``shortest_s`` seconds.  An input or a target
    that is no column of numbers is a ValueError.
    """
    numbers = frame.select_dtypes("number")
    missing = [name for name in (*inputs, target) if name not in numbers.columns]
    if missing:
        raise ValueError(
            f"{missing[0]} is no column of numbers in the state table of {day}; "
            "map it to a data item in conf/machine/ or leave it out of the model's inputs"
        )
    import pandas as pd

    steps = numbers.resample(pd.Timedelta(seconds=step)).mean()
    known = steps[list(inputs)].notna().all(axis=1).to_numpy()
    limit = len(steps) if np.isinf(bridge_s) else int(bridge_s / step)
    held = steps[list(inputs)].ffill(limit=limit) if limit else steps[list(inputs)]
    steps = steps.assign(**{name: held[name] for name in inputs})
    usable = held.notna().all(axis=1).to_numpy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        measured = np.flatnonzero(steps[target].iloc[first:last].notna().to_numpy())
        if len(measured) == 0:
            continue
        begin, end = first + measured[0], first + measured[-1] + 1
        if (end - begin) * step >= shortest_s:
            yield StateSegment(
                day=day,
                frame=steps.iloc[begin:end],
                step=step,
                bridged=int((~known[begin:end]).sum()),
            )


LONGEST_BRIDGE = 3
"""Greatest number of consecutive missing rows [1] that straight lines bridge."""
ROUNDING_JITTER = 0.1
"""Standard deviation of time stamps about the grid [periods] up to which it counts as rounding."""
EVEN = 0.02
"""Deviation of the period of a table from the one that was learnt, over it, at most [1]."""
COARSE_CLOCK = 0.1
"""Share of repeated time stamps [1] above which the clock ticks slower than rows are recorded."""
SHORTEST_SEGMENT = 32
"""Smallest number of rows [1] of a segment; shorter ones are left out."""


@dataclass(frozen=True, kw_only=True)
class UniformSegment:
    """Contiguous segment of a recording on a uniform grid of T samples."""

    start: float
    """Time of the first sample [s]."""
    period: float
    """Sampling period [s]."""
    rows: Ints
    """Rows of the recording that lie in it; shape (R,)."""
    places: Floats
    """Position of each row on the grid [periods]; whole numbers where stamps are only rounded;
    shape (R,)."""

    @property
    def samples(self) -> int:
        """T, the number of samples on the grid [1]."""
        return int(np.floor(self.places[-1] + 1e-9)) + 1

    @property
    def filled(self) -> Bools:
        """Samples without a row within half a period; shape (T,)."""
        recorded = np.zeros(self.samples, bool)
        near = np.rint(self.places).astype(np.int64)
        recorded[np.clip(near, 0, self.samples - 1)] = True
        return ~recorded

    def on_grid(self, values: Floats) -> Floats:
        """Values of all rows of the recording, interpolated on the grid; shape (T,)."""
        return np.interp(np.arange(self.samples), self.places, values[self.rows])


def sampling_period(t: Floats) -> float:
    """Sampling period [s] from two time stamps or more."""
    steps = np.diff(t)
    forward = steps[steps > 0]
    if not len(forward):
        raise ValueError("its time never goes forward")
    if np.mean(steps == 0) > COARSE_CLOCK:  # several rows share each tick of the clock
        return float(forward.sum() / np.count_nonzero(steps >= 0))
    return float(np.median(forward))


def uniform_segments(t: Floats) -> list[UniformSegment]:
    """Segments of a recording on uniform grids, from the time stamps [s] of its N rows.

    A repeated stamp belongs in the gap behind it, if there is one, and is a copy otherwise.  Up to
    ``LONGEST_BRIDGE`` missing rows are interpolated and marked as filled; a longer gap, or a clock
    that jumps back, ends the segment.  Stamps within ``ROUNDING_JITTER`` of the grid are rounded;
    samples farther off are interpolated.  Fewer than ``SHORTEST_SEGMENT`` rows, or stamps without a
    period, are a ValueError.
    """
    if len(t) < SHORTEST_SEGMENT:
        raise ValueError(f"it has {len(t)} rows, {SHORTEST_SEGMENT} are the least that can be used")
    period = sampling_period(t)
    if np.mean(np.diff(t) == 0) > COARSE_CLOCK:
        t = t[0] + period * np.arange(len(t))  # evenly spaced below the clock's tick
    steps = np.rint(np.diff(t) / period).astype(np.int64)
    cuts = np.flatnonzero((steps < 0) | (steps > LONGEST_BRIDGE + 1)) + 1
    segments = [
        _segment(t, rows, period) for rows in np.split(np.arange(len(t)), cuts) if len(rows) > 1
    ]
    return [segment for segment in segments if len(segment.rows) >= SHORTEST_SEGMENT]


def _segment(t: Floats, rows: Ints, period: float) -> UniformSegment:
    """Rows between two gaps on their grid, of the period that fits their stamps."""
    steps = np.rint(np.diff(t[rows]) / period).astype(np.int64)
    late = np.flatnonzero((steps[:-1] == 0) & (steps[1:] > 1))
    steps[late] += 1  # its stamp repeats, the gap behind it is its own
    steps[late + 1] -= 1
    kept = np.r_[True, steps > 0]
    places = np.r_[0, np.cumsum(steps)][kept].astype(np.float64)
    stamps = t[rows[kept]]
    if len(places) < 2:
        return UniformSegment(
            start=float(t[rows[0]]), period=period, rows=rows[kept], places=places
        )
    slope, start = np.polyfit(places, stamps, 1)
    deviation = (stamps - start - slope * places) / slope
    if np.std(deviation) > ROUNDING_JITTER:
        even = (stamps - stamps[0]) / slope
        forward = np.r_[True, np.diff(even) > 0]
        return UniformSegment(
            start=float(stamps[0]), period=float(slope), rows=rows[kept][forward],
            places=even[forward],
        )  # fmt: skip
    return UniformSegment(start=float(start), period=float(slope), rows=rows[kept], places=places)


def row_period(table: "pd.DataFrame", *needed: str, learnt: float | None = None) -> float:
    """Period of the rows of a table [s], from its column ``t`` [s].

    Stamps may be rounded, or stand still below a clock's tick.  ValueError where rows lie off an
    even grid by half a period or lack between others, where the period is not the one that was
    ``learnt``, and where a value of the columns ``needed`` is missing.
    """
    if "t" not in table.columns or len(table) < (1 if learnt else 2):
        raise ValueError("the input has no column t of two rows or more: give it in seconds")
    for name in ("t", *needed):
        finite = np.isfinite(table[name].to_numpy(float))
        if not finite.all():
            row = int(finite.argmin())
            raise ValueError(
                f"{name} is {table[name].iloc[row]} in row {row + 1}: give a value in each row"
            )
    if learnt and len(table) == 1:
        return learnt
    t = table["t"].to_numpy(float)
    steps = np.diff(t)
    if not t[-1] > t[0] or steps.min() < 0:
        row = int(steps.argmin())
        raise ValueError(
            f"t does not go forward: it is {t[row]:g} s in row {row + 1} and {t[row + 1]:g} s in "
            f"row {row + 2}: give rows in the order of time"
        )
    period = float(steps.mean())
    off = np.abs(t - np.linspace(t[0], t[-1], len(t)))
    gaps = steps > 1.5 * period
    uneven = gaps if gaps.any() else off[1:] > 0.5 * period
    if uneven.any() and np.mean(steps == 0) <= COARSE_CLOCK:
        row = int(uneven.argmax())
        raise ValueError(
            f"rows {row + 1} and {row + 2} of the input are {steps[row]:g} s apart, all rows "
            f"{period:g} s in the mean: give evenly spaced rows"
        )
    if learnt and abs(period - learnt) > EVEN * learnt:
        raise ValueError(
            f"rows of the input are {period:g} s apart, {learnt:g} s were learnt: give rows of "
            "that period"
        )
    return learnt or period
