"""The log of one run, as an adapter that polls the control's lines writes it: on change."""

from dataclasses import dataclass

import numpy as np

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.control_run import EXECUTION, Display
from pipeline.shop.ledger import stamp
from pipeline.shop.s_curve import Floats

LEAD = 1.3
"""Seconds from the adapter's connection to the start of the program."""
TORN = 4
"""Characters that are left of a torn line: the year."""


@dataclass(frozen=True, kw_only=True)
class Polled:
    """One item as it was polled: P values, and whether each is known."""

    name: str
    values: np.ndarray
    known: np.ndarray
    words: tuple[str, ...] = ()

    def text(self, place: int) -> str:
        """The value at poll ``place`` as it is written."""
        value = self.values[place]
        if self.words:
            return self.words[int(value)]
        return f"{value + 0.0:.2f}".rstrip("0").rstrip(".")


def written(
    run: Display, start: np.datetime64, control: ControlParameters, random: np.random.Generator,
    torn: bool = False, load: Floats | None = None,
) -> list[str]:  # fmt: skip
    """Lines of a log, ``timestamp|item|value``.

    Parameters
    ----------
    run : Display
        What the control showed.
    start : datetime64
        When the program was started (UTC).
    control, random
        How the control is polled, and by what chance when.
    torn : bool
        Whether one line in the middle is cut short.
    load : (T,) array, optional
        Of the spindle [percent], where the adapter polls that too.
    """
    polls = _polls(run.line.size * control.cycle, control, random)
    cycle = np.floor(polls / control.cycle).astype(int)
    lines: list[tuple[int, int, str]] = []
    for rank, item in enumerate(_items(run, cycle, load)):
        new = np.append(True, item.values[1:] != item.values[:-1])
        new |= item.known & ~np.append(False, item.known[:-1])
        lines += [
            (k, rank, f"|{item.name}|{item.text(k)}")
            for k in np.flatnonzero(new & item.known).tolist()
        ]
    stamps = [stamp(start, t) for t in polls]
    text = [stamps[k] + said for k, _, said in sorted(lines)]
    if torn:
        feeds = [k for k, line in enumerate(text) if "|vpath|" in line]
        place = feeds[int(random.uniform(0.3, 0.7) * len(feeds))]
        text[place] = text[place][:TORN]
    return text


def _polls(end: float, control: ControlParameters, random: np.random.Generator) -> np.ndarray:
    """Times of the polls [s] since the start of the program, to the millisecond."""
    count = int((end + LEAD) / control.poll * 1.2) + 20
    steps = control.poll + random.normal(0, control.poll_jitter, count)
    times: np.ndarray = np.round(np.cumsum(np.maximum(steps, control.poll / 3)) - LEAD, 3)
    return times[times < end]


def _items(run: Display, cycle: np.ndarray, load: Floats | None) -> list[Polled]:
    """What is polled; before the start everything stands still."""
    begun = cycle >= 0
    at = np.maximum(cycle, 0)

    def item(name: str, values: np.ndarray, before: float | None = 0.0) -> Polled:
        shown = np.where(begun, values[at], np.nan if before is None else before)
        return Polled(name=name, values=shown, known=~np.isnan(shown))

    execution = np.where(begun, run.execution[at], -1)
    return [
        Polled(name="exec", values=execution, known=begun, words=EXECUTION),
        item("ln", run.line),
        item("tool", run.tool, before=float(run.tool_before)),
        item("fovr", run.feed_override, before=None),
        item("rovr", run.rapid_override, before=float(run.rapid_override[0])),
        item("S1n", np.round(run.speed)),
        item("vpath", np.round(run.feedrate, 2)),
        *([] if load is None else [item("S1load", load)]),
    ]
