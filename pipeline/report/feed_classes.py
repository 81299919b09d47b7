"""Classes of feed that the figures of all programs of a machine colour alike."""

from dataclasses import dataclass

import numpy as np

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.report.program_moves import ProgramMoves

COLOURS = 6  # of the scale in style.css, f0 slow to f5 fast
SERIES = ((1, 1.5, 2, 3, 5, 7), (1, 2, 5), (1, 3), (1,))
"""Round bounds within a decade, the finest first."""
UNKNOWN = -1  # class of a cutting move whose feed is not known


@dataclass(frozen=True, kw_only=True)
class FeedClasses:
    """Classes of reached feed between ``bounds`` [mm/min], ascending; the first is the slowest."""

    bounds: tuple[float, ...]

    def __len__(self) -> int:
        return len(self.bounds) + 1

    def of(self, feed: np.ndarray) -> np.ndarray:
        """Class of each feed; :data:`UNKNOWN` where it is not known."""
        found = np.searchsorted(np.array(self.bounds), feed, side="right")
        return np.where(np.isfinite(feed), found, UNKNOWN)

    def colour(self, index: int) -> str:
        """CSS name of a class's colour; few classes lie as far apart as many."""
        if index == UNKNOWN:
            return "f-none"
        return f"f{round(index * (COLOURS - 1) / max(1, len(self) - 1))}"

    def words(self, index: int) -> str:
        """What a class holds, in words."""
        ends = [number(round(b) if b >= 1 else b) for b in self.bounds]
        if index == UNKNOWN:
            return "feed not known"
        if not ends:
            return "at one feed"
        if index == 0:
            return f"below {ends[0]} mm/min"
        if index == len(ends):
            return f"{ends[-1]} mm/min and more"
        return f"{ends[index - 1]} to {ends[index]}"


def feed_classes(programs: list[ProgramMoves]) -> FeedClasses:
    """At most six classes over the feeds that take 95 of 100 seconds of cutting."""
    chosen = [m.cutting & np.isfinite(m.reached) & (m.time > 0) for m in programs]
    feed = np.concatenate([*(m.reached[c] for m, c in zip(programs, chosen, strict=True)), []])
    time = np.concatenate([*(m.time[c] for m, c in zip(programs, chosen, strict=True)), []])
    if len(feed) == 0:
        return FeedClasses(bounds=())
    order = np.argsort(feed)
    passed = np.cumsum(time[order]) / time.sum()
    low, high = (float(feed[order][np.searchsorted(passed, q)]) for q in (0.025, 0.97))
    return FeedClasses(bounds=tuple(_bounds(low, high)))


def _bounds(low: float, high: float) -> list[float]:
    """Round feeds inside ``low`` to ``high``: evenly spaced within a span, else by ratio."""
    if high < 4 * low:
        even = [b for b in svg.ticks(low, high, most=5) if low < b < high]
        return even[: COLOURS - 1] if high > 1.02 * low else []
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    for series in SERIES:
        inside = [m * 10.0**k for k in decades for m in series if low < m * 10.0**k < high]
        if len(inside) <= COLOURS + 1:  # one or two too many: what is slowest is one class
            break
    return inside[-(COLOURS - 1) :]
