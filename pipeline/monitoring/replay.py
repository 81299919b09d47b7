"""Replay of a span: what stands beyond the intervals, and the part of the twin that explains it.

z is the distance of a window's measured from its estimated value, over that half of the 90 %
interval on its side.  What stands of a quantity are the windows in a row with the greatest sum of
z^2 - 1 (the greatest rise of a cumulative sum, Page 1954), where it passes the greatest of a
known-good day by a margin.  Each part is fitted to every other block of what stands and leaves
sum max(|z| - 1, 0)^2 on the blocks between, so that a part with more parameters wins nothing by
them.  A sub-model is named where it removes at least half, and alone leaves clearly the least in
nine of ten samples of the blocks drawn with replacement (Künsch 1989).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.monitoring.day_estimates import TEMPERATURE
from pipeline.monitoring.replay_parts import Part
from pipeline.monitoring.replay_windows import CYCLES, MORNING, USUAL, Series, units
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.replay import Outcome, ReplayedQuantity, Replacement

MOST_Z = 10.0
"""Most that one window counts, in half intervals."""
RISE_Z = 5.0
"""Most that one window counts where what stands is looked for, so that no single one stands."""
MARGIN = 2.0
"""Limit of the sum over the most of a known-good day [1]."""
FLOOR, FLOORS = 120.0, {TEMPERATURE: 600.0, MORNING: 600.0, CYCLES: 200.0}
"""Least limit: an hour at 1.4 half intervals; five hours of a temperature, which hangs together
over hours; eight slow cycles.  Of a span with fewer windows, but for cycles, it is their number:
all of them at 1.4 half intervals."""
START_S = 3600.0
"""Time after the begin of a day's records within which what stands began with them [s]."""
BLOCK_S, BLOCKS = 1800.0, 8
"""Longest block [s]; least number of blocks of what stands, each at least a window."""
LEAST_REMOVED, CLEAR, SURE = 0.5, 0.8, 0.9
"""Least share that a named part removes; most that it leaves over what the best other sub-model
leaves; share of the samples that must say so [1]."""
DRAWS, LIKELY = 500, 0.1
"""Samples of the blocks; share of them from which on a sub-model is not ruled out [1]."""


def distance(table: pd.DataFrame, estimated: Floats | None = None) -> Floats:
    """Distance z (W,) from the champion's interval, kept around another estimate, clipped."""
    middle, measured = (table[name].to_numpy(float) for name in ("estimated", "measured"))
    residual = measured - (middle if estimated is None else estimated)
    ends = table["high"].to_numpy(float) - middle, middle - table["low"].to_numpy(float)
    half = np.maximum(np.where(residual > 0, *ends), 1e-9)
    return np.clip(residual / half, -MOST_Z, MOST_Z)


def largest_rise(z: Floats) -> tuple[float, int, int]:
    """Greatest sum of z^2 - 1 over windows in a row, (W,), the first of them and the one after.

    >>> largest_rise(np.array([0.5, 2.0, 3.0, 0.5]))
    (11.0, 1, 3)
    """
    total = np.concatenate([[0.0], np.cumsum(np.minimum(np.abs(z), RISE_Z) ** 2 - 1.0)])
    rise = total - np.minimum.accumulate(total)
    end = int(np.argmax(rise))
    return float(rise[end]), int(np.argmin(total[: end + 1])), end


def limit_of(name: str, table: pd.DataFrame, known_good: Sequence[str], windows: int) -> float:
    """Limit of :func:`largest_rise` of a quantity over so many windows."""
    z, day = distance(table), table["day"].to_numpy(str)
    least = FLOORS.get(name, FLOOR)
    if name != CYCLES:
        least = min(least, float(max(windows, 1)))
    return max([least, *(MARGIN * largest_rise(z[day == one])[0] for one in known_good)])


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """Windows of some quantities that have a residual to explain, N in all."""

    series: Series
    masks: Mapping[str, Bools]
    """Windows of each quantity; shape (W,) of its table."""
    limits: Mapping[str, float]
    """Limit of each quantity."""
    stands: frozenset[str]
    """Those beyond it."""
    weights: Floats
    """One over the limit of the window's quantity; shape (N,)."""
    blocks: Any
    """Number of the block of each window; shape (N,)."""

    @classmethod
    def of(
        cls,
        series: Series,
        masks: Mapping[str, Bools],
        limits: Mapping[str, float],
        stands: Iterable[str],
    ) -> "Standing":
        """Blocks in the order of time, none of them of two quantities."""
        found, weights, first = [np.zeros(0, dtype=int)], [np.zeros(0)], 0
        for name, mask in masks.items():
            t = series[name]["t"].to_numpy(float)[mask]
            length = min(BLOCK_S, max((t[-1] - t[0]) / BLOCKS, 1e-6))
            number = np.unique(np.floor((t - t[0]) / length), return_inverse=True)[1]
            found.append(first + number)
            weights.append(np.full(len(t), 1.0 / limits[name]))
            first += int(number.max()) + 1
        return cls(series=series, masks=masks, limits=limits, stands=frozenset(stands), weights=np.concatenate(weights),
                   blocks=np.concatenate(found))  # fmt: skip

    def z(self, estimates: Mapping[str, Floats] | None = None) -> Floats:
        """Distances (N,) with some estimates (W,) in the place of the champion's."""
        other = estimates or {}
        return np.concatenate([np.zeros(0), *(
            distance(self.series[name], other.get(name))[mask] for name, mask in self.masks.items()
        )])  # fmt: skip

    def excess(self, estimates: Mapping[str, Floats] | None = None) -> Floats:
        """Squared distance beyond the interval (N,), over what may stand of the quantity."""
        return self.weights * np.maximum(np.abs(self.z(estimates)) - 1.0, 0.0) ** 2

    def spoilt(self, part: Part, parameters: Floats) -> str:
        """A quantity that does not stand and would with the part; empty without one."""
        for name, other in self.estimates(part, parameters).items():
            z = distance(self.series[name], other)[self.masks[name]]
            if name not in self.stands and largest_rise(z)[0] > self.limits[name]:
                return name
        return ""

    def touched(self, part: Part) -> bool:
        """Whether a part estimates some of the quantities."""
        return bool(self.stands & part.estimates.keys())

    def fitted(self, part: Part, chosen: Bools) -> Floats:
        """Parameters (P,) by robust least squares on chosen windows (N,)."""
        from scipy.optimize import least_squares

        if not part.start:
            return np.zeros(0)
        scale = np.maximum(np.abs(part.start), 1.0)
        found = least_squares(
            lambda p: self.z(self.estimates(part, p))[chosen], part.start, loss="soft_l1",
            bounds=(part.low, part.high), x_scale=scale, diff_step=1e-2, max_nfev=40,
        )  # fmt: skip
        return np.asarray(found.x, dtype=float)

    def estimates(self, part: Part, parameters: Floats) -> dict[str, Floats]:
        """Estimates of those of the quantities that a part has, by its parameters."""
        return {name: one(parameters) for name, one in part.estimates.items() if name in self.masks}

    def left(self, part: Part, parameters: Sequence[Floats]) -> Floats:
        """Excess (N,) that a part leaves; of two sets of parameters each on its every other block."""
        every = [self.excess(self.estimates(part, p)) for p in parameters]
        return every[0] if len(every) == 1 else np.where(self.blocks % 2 == 0, *every)


def standing_of(
    series: Series, span: tuple[float, float], known_good: Sequence[str]
) -> tuple[Standing, dict[str, ReplayedQuantity]]:
    """What stands of each quantity within a span [s since 1970], and of others in that time."""
    masks, found, limits = dict[str, Bools](), dict[str, ReplayedQuantity](), dict[str, float]()
    for name, table in series.items():
        t, z = table["t"].to_numpy(float), distance(table)
        here = np.flatnonzero((t >= span[0]) & (t < span[1]))
        limits[name] = limit_of(name, table, known_good, len(here))
        rise, first, after = largest_rise(z[here])
        masks[name] = np.isin(np.arange(len(t)), here[first:after])
        if len(here):
            found[name] = ReplayedQuantity(
                unit=units()[name], basis="known-good days" if name in USUAL else "champion",
                seconds=float(table["seconds"].to_numpy()[here].sum()), excess=round(rise, 1),
                limit=round(limits[name], 1),
                span=tuple(t[here[[first, after - 1]]].tolist()) if after > first else (),
            )  # fmt: skip
    stands = {name for name, one in found.items() if one.stands}
    begin = min((found[name].span[0] for name in stands), default=0.0)
    end = max((found[name].span[1] for name in stands), default=0.0)
    for name in found.keys() - stands:
        t = series[name]["t"].to_numpy(float)
        masks[name] = (t >= max(begin, span[0])) & (t <= end) & (t < span[1])
    masks = {name: mask for name, mask in masks.items() if stands and mask.any()}
    return Standing.of(series, masks, limits, stands), found


def begin_of(series: Series, found: Mapping[str, ReplayedQuantity]) -> float:
    """When what stands begins [s since 1970]: with a day's records within :data:`START_S` of them.

    What warms up with a spindle stands out late, though it was there from the start.
    """
    begins = {one.span[0]: name for name, one in found.items() if one.stands}
    if not begins:
        return 0.0
    first = min(begins)
    table = series[begins[first]]
    day = table["day"][table["t"] <= first].iloc[-1]
    start = min(float(one["t"][one["day"] == day].min()) for one in series.values()
                if (one["day"] == day).any())  # fmt: skip
    return start if first - start < START_S else first


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """Parts that were tried, the best first, and what they say together."""

    parts: tuple[tuple[Part, Replacement, Floats], ...]
    """Each with its parameters (P,) of all that stands."""
    outcome: Outcome
    named: tuple[str, ...]
    sure: float | None


def explained(
    standing: Standing, parts: Sequence[Part], other: Standing | None = None
) -> Explained:
    """The sub-models that explain what stands; ``other`` is a span to borrow parameters from."""
    if not len(standing.blocks):
        return Explained(parts=(), outcome="nothing to explain", named=(), sure=None)
    even = standing.blocks % 2 == 0
    before, every = standing.excess(), np.ones(len(even), dtype=bool)
    tried: list[tuple[Part, Floats, Floats, float | None, str]] = []
    for part in filter(standing.touched, parts):
        halves = [standing.fitted(part, ~even), standing.fitted(part, even)]
        borrowed = None
        if other is not None and other.touched(part):
            lent = other.fitted(part, np.ones(len(other.blocks), dtype=bool))
            borrowed = round(1 - float(standing.left(part, [lent]).sum() / before.sum()), 4)
        whole = standing.fitted(part, every)
        spoilt = standing.spoilt(part, whole)
        tried.append((part, standing.left(part, halves), whole, borrowed, spoilt))
    left = {}
    for part, own, _, _, spoilt in tried:
        if not spoilt and (part.submodel not in left or own.sum() < left[part.submodel].sum()):
            left[part.submodel] = own
    best = _samples(left, standing.blocks)
    rows = sorted((
        (part, Replacement(
            submodel=part.submodel, part=part.name, borrowed=borrowed,
            parameters=dict(zip(part.parameters, map(_rounded, found), strict=True)),
            removed=round(1 - float(own.sum() / before.sum()), 4), spoilt=spoilt,
            best=best.get(part.submodel, 0.0),
        ), found)
        for part, own, found, borrowed, spoilt in tried
    ), key=lambda row: (bool(row[1].spoilt), -row[1].removed))  # fmt: skip
    if not rows or rows[0][1].spoilt or rows[0][1].removed < LEAST_REMOVED:
        return Explained(parts=tuple(rows), outcome="none explains", named=(), sure=None)
    first = rows[0][1].submodel
    if best[first] >= SURE:
        return Explained(parts=tuple(rows), outcome="named", named=(first,), sure=best[first])
    rest = rows[0][1].removed
    close = {row.submodel: None for _, row, _ in rows
             if not row.spoilt and row.removed >= LEAST_REMOVED and 1 - rest > CLEAR**2 * (1 - row.removed)}  # fmt: skip
    named = tuple({first: None, **close})
    return Explained(parts=tuple(rows), outcome="not told apart", named=named, sure=None)


def _samples(left: Mapping[str, Floats], blocks: Any) -> dict[str, float]:
    """Share of samples of the blocks in which each sub-model clearly leaves the least."""
    names, random = list(left), np.random.default_rng(0)
    if not names:
        return {}
    sums = np.array([np.bincount(blocks, left[name]) for name in names])
    n = sums.shape[1]
    drawn = random.multinomial(n, np.full(n, 1 / n), DRAWS) @ sums.T
    found = {}
    for k, name in enumerate(names):
        others = np.delete(drawn, k, axis=1).min(axis=1, initial=np.inf)
        found[name] = round(float(np.mean(drawn[:, k] < CLEAR * others)), 3)
    return found


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
