"""Contiguous segments of the state table in which every input is known."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd


@dataclass(frozen=True, kw_only=True)
class StateSegment:
    """Contiguous segment of a day in which every input is known."""

    day: str
    """Day of the plant, ``YYYY-MM-DD``."""
    frame: pd.DataFrame
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


def read_state(clean: Path, day: str) -> pd.DataFrame:
    """The state table of one day, indexed by time in the zone of the plant."""
    path = clean / "state" / f"{day}.parquet"
    if not path.exists():
        raise ValueError(
            f"no state table of {day} in {clean}: run the stage clean for this machine"
        )
    return pd.read_parquet(path).set_index("time")


def state_segments(
    frame: pd.DataFrame,
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
