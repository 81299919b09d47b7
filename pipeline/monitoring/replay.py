"""Replay of a span: what stands beyond the intervals, and the part of the twin that explains it.

z is the distance of a window's measured from its estimated value, over that half of the 90 %
interval on its side.  What stands of a quantity are the windows in a row with the greatest sum of
z^2 - 1 (the greatest rise of a cumulative sum, Page 1954), where it passes the greatest of a
known-good day by a margin.  Each part is fitted to every other block of what stands and leaves
sum max(|z| - 1, 0)^2 on the blocks between, so that a part with more parameters wins nothing by
them.  How sure its sub-model is: the share of samples of the blocks, drawn with replacement
(Künsch 1989), in which it alone leaves clearly the least.

A day's table has the rows of the twin's state; of each quantity ``_measured``, ``_estimated``,
``_low``, ``_high``, ``_previous`` (the version before) and ``_<sub-model>_<part>``, the estimate
with that part replaced, in windows of half a minute.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.monitoring.day_estimates import TEMPERATURE
from pipeline.monitoring.replay_parts import Part
from pipeline.monitoring.replay_windows import CYCLES, MORNING, OF_CHAMPION, USUAL, Series
from pipeline.schema.arrays import Bools, Floats

MOST_Z, RISE_Z = 10.0, 5.0
"""Most that one window counts, in half intervals; most where what stands is looked for, so that no
single one stands."""
MARGIN, FLOOR, FLOORS = 2.0, 120.0, {TEMPERATURE: 600.0, MORNING: 600.0, CYCLES: 200.0}
"""Limit of the sum over the most of a known-good day; least limit: an hour at 1.4 half intervals,
or all of a shorter span; five hours of a temperature, which hangs together over hours, and eight
slow cycles, of any span."""
START_S = 3600.0
"""Time after the begin of a day's records within which what stands began with them [s]: a sensor
that reads too much stands out as the spindle warms."""
BLOCK, BLOCKS = 60, 16
"""Most windows of a block, half an hour of them; least blocks of a quantity, where it has so many
windows."""
CLEAR, DRAWS = 0.8, 500
"""Most that a clear part leaves over the best of another sub-model [1]; samples of the blocks."""


LEAST_REMOVED, SURE = 0.5, 0.75
"""Least share that a named part removes; share of the samples in which it is clearly best [1]."""


@dataclass(frozen=True, kw_only=True)
class ReplayedQuantity:
    """A quantity over the span."""

    unit: str
    basis: str
    """Where its estimate comes from: the champion, or known-good days."""
    seconds: float
    """Time over which it is compared [s]."""
    excess: float
    limit: float
    """Greatest rise of the sum of squared distances less 1; beyond the limit a residual stands."""

    @property
    def stands(self) -> bool:
        """Whether there is a residual to explain."""
        return self.excess > self.limit


@dataclass(frozen=True, kw_only=True)
class Replacement:
    """A part of the twin with parameters of the span in the place of the champion's."""

    submodel: str
    """Its sub-model, or ``sensor``."""
    part: str
    parameters: Mapping[str, float]
    removed: float
    """Share of what stands that it removes from blocks that it was not fitted to [1]."""
    best: float
    """Share of samples of the blocks in which its sub-model alone clearly leaves the least [1]."""
    spoilt: str = ""
    """Quantity without a residual that would have one with it, which rules it out."""
    borrowed: float | None = None
    """Share that it removes with its parameters of the other span; None without one."""

    @property
    def key(self) -> str:
        """Name of its columns."""
        return f"{self.submodel}_{self.part}".replace(" ", "_")


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The content of ``replay.json``."""

    machine: str
    origin: str
    first: str
    last: str
    """Span as it was named, days or times of the plant."""
    days: tuple[str, ...]
    bundle: str
    version: int
    previous: int | None
    """Hash and version of what serves; version that served before, None without one."""
    known_good: tuple[str, ...]
    borrowed: str
    """Known-good days; the span that parameters are borrowed from, empty without one."""
    quantities: Mapping[str, ReplayedQuantity]
    replaced: tuple[Replacement, ...]
    """Parts, the best first; empty where nothing stands."""
    missing: Mapping[str, str]
    """Quantities that are not compared, and why."""

    @property
    def stands(self) -> list[str]:
        """Quantities with a residual to explain."""
        return [name for name, one in self.quantities.items() if one.stands]

    @property
    def named(self) -> tuple[str, ...]:
        """Sub-models that explain what stands: one, several that are not told apart, or none."""
        fit = [one for one in self.replaced if not one.spoilt and one.removed >= LEAST_REMOVED]
        if not fit or fit[0].best >= SURE:
            return tuple(one.submodel for one in fit[:1])
        return tuple(dict.fromkeys(one.submodel for one in fit))

    @property
    def sentence(self) -> str:
        """What explains the residual, how sure, or why nothing does."""
        what = ", ".join(self.stands).replace("_", " ")
        if not what:
            return "nothing to explain: what was measured lies where the twin expects it"
        if not self.named:
            return f"no sub-model explains the residual of {what}"
        best = self.replaced[0]
        share = f"{best.part}, refitted, removes {100 * best.removed:.0f} % of it"
        sure = f", sure to {100 * best.best:.0f} %" if len(self.named) == 1 else ""
        return f"{' or '.join(self.named)} explains the residual of {what}{sure}: {share}"


def distance(table: pd.DataFrame, estimated: Any = None) -> Floats:
    """Distance z (W,) from the champion's interval, kept around another estimate."""
    middle, measured, low, high = (
        table[name].to_numpy(float) for name in ("estimated", "measured", "low", "high")
    )
    residual = measured - np.asarray(middle if estimated is None else estimated, dtype=float)
    half = np.maximum(np.where(residual > 0, high - middle, middle - low), 1e-9)
    return np.asarray(residual / half, dtype=float)


def largest_rise(z: Floats) -> tuple[float, int, int]:
    """Greatest sum of z^2 - 1 over windows in a row, (W,), the first of them and the one after.

    >>> largest_rise(np.array([0.5, 2.0, 3.0, 0.5]))
    (11.0, 1, 3)
    """
    total = np.concatenate([[0.0], np.cumsum(np.minimum(np.abs(z), RISE_Z) ** 2 - 1.0)])
    rise = total - np.minimum.accumulate(total)
    end = int(np.argmax(rise))
    return float(rise[end]), int(np.argmin(total[: end + 1])), end


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """Windows of some quantities to explain, N in all."""

    series: Series
    quantities: Mapping[str, ReplayedQuantity]
    masks: Mapping[str, Bools]
    """Windows of each quantity; shape (W,) of its table."""
    begin: float = 0.0
    """When what stands begins [s since 1970]."""

    def blocks(self) -> Any:
        """Number of the block of each window, none of two quantities; shape (N,)."""
        found, first = [np.zeros(0, dtype=int)], 0
        for mask in self.masks.values():
            place = np.arange(n := int(mask.sum()))
            found.append(first + place // min(BLOCK, max(n // BLOCKS, 1)))
            first = int(found[-1].max()) + 1
        return np.concatenate(found)

    def z(self, estimates: Mapping[str, Any]) -> Floats:
        """Distances (N,) with some estimates (W,) in the place of the champion's."""
        return np.concatenate([
            distance(self.series[name], estimates.get(name))[mask]
            for name, mask in self.masks.items()
        ])  # fmt: skip

    def excess(self, estimates: Mapping[str, Any]) -> Floats:
        """Squared distance beyond the interval (N,), over the limit of the quantity."""
        limits = [np.full(mask.sum(), self.quantities[name].limit)
                  for name, mask in self.masks.items()]  # fmt: skip
        beyond = np.clip(np.abs(self.z(estimates)) - 1.0, 0.0, MOST_Z)
        return beyond**2 / np.concatenate(limits)

    def estimates(self, part: Part, p: Floats) -> dict[str, Any]:
        """Estimates of those of the quantities that a part has, by its parameters (P,)."""
        return {name: one(p) for name, one in part.estimates.items() if name in self.masks}

    def fitted(self, part: Part, chosen: Any) -> Floats:
        """Parameters (P,) by robust least squares on chosen windows (N,)."""
        from scipy.optimize import least_squares

        if not part.words:
            return np.zeros(0)

        def residuals(p: Floats) -> Floats:
            return self.z(self.estimates(part, p))[chosen]

        start = np.zeros(len(part.words))
        found = least_squares(residuals, start, loss="soft_l1", diff_step=start + 1e-2,
                              max_nfev=20)  # fmt: skip
        return np.asarray(found.x, dtype=float)

    def spoilt(self, part: Part, p: Floats) -> str:
        """A quantity that does not stand and would with the part; empty without one."""
        for name, other in self.estimates(part, p).items():
            rise = largest_rise(distance(self.series[name], other)[self.masks[name]])[0]
            if not self.quantities[name].stands and rise > self.quantities[name].limit:
                return name
        return ""

    def over(self, span: tuple[float, float]) -> "Standing":
        """What stands, over another span."""
        found = {name: self.series[name]["t"].between(*span).to_numpy()
                 for name, one in self.quantities.items() if one.stands}  # fmt: skip
        masks = {name: mask for name, mask in found.items() if mask.any()}
        return Standing(series=self.series, quantities=self.quantities, masks=masks)


def standing_of(series: Series, span: tuple[float, float], known_good: Sequence[str]) -> Standing:
    """What stands of each quantity within a span [s since 1970], and of others in that time."""
    masks, found = dict[str, Bools](), dict[str, ReplayedQuantity]()
    for name, table in series.items():
        t, z, day = table["t"].to_numpy(float), distance(table), table["day"].to_numpy(str)
        here = np.flatnonzero((t >= span[0]) & (t < span[1]))
        if not len(here):
            continue
        least = FLOORS.get(name, min(FLOOR, len(here)))
        usual = [MARGIN * largest_rise(z[day == one])[0] for one in known_good]
        rise, first, after = largest_rise(z[here])
        found[name] = ReplayedQuantity(
            unit=OF_CHAMPION.get(name) or USUAL[name][0], excess=round(rise, 1),
            basis="champion" if name in OF_CHAMPION else "known-good days",
            seconds=float(table["seconds"].to_numpy()[here].sum()),
            limit=round(max([least, *usual]), 1),
        )  # fmt: skip
        if found[name].stands:
            masks[name] = np.isin(np.arange(len(t)), here[first:after])
    times = [series[name]["t"].to_numpy(float)[mask] for name, mask in masks.items()]
    if not times:
        return Standing(series=series, quantities=found, masks={})
    begin, end = min(map(min, times)), max(map(max, times))
    for name in found.keys() - masks:
        t = series[name]["t"].to_numpy(float)
        masks |= {name: mask} if (mask := (t >= begin) & (t <= end)).any() else {}
    days = pd.concat([one[["t", "day"]] for one in series.values()]).groupby("day")["t"].min()
    start = float(days[days <= begin].max())
    return Standing(series=series, quantities=found, masks=masks,
                    begin=start if begin - start < START_S else begin)  # fmt: skip


def replacements(
    standing: Standing, parts: Iterable[Part], other: Standing | None = None
) -> list[tuple[Replacement, Part, Floats]]:
    """Parts, the best first, with their parameters (P,), the mean of both fits.

    ``other``: a span to borrow parameters from.
    """
    if not standing.masks:
        return []
    blocks, before = standing.blocks(), standing.excess({}).sum()
    even, found, left = blocks % 2 == 0, [], dict[str, Floats]()
    stands = {name for name, one in standing.quantities.items() if one.stands}
    for part in parts:
        if not stands & part.estimates.keys():
            continue
        halves = [standing.fitted(part, half) for half in (~even, even)]
        own = np.where(even, *(standing.excess(standing.estimates(part, p)) for p in halves))
        whole, borrowed = np.mean(halves, axis=0), None
        if other is not None and other.masks.keys() & part.estimates.keys():
            lent = standing.estimates(part, other.fitted(part, slice(None)))
            borrowed = round(1 - float(standing.excess(lent).sum() / before), 4)
        spoilt = standing.spoilt(part, whole)
        if not spoilt and own.sum() < left.get(part.submodel, np.inf * np.ones(1)).sum():
            left[part.submodel] = own
        found.append((Replacement(
            submodel=part.submodel, part=part.name, parameters=part.parameters(whole),
            removed=round(1 - float(own.sum() / before), 4), best=0.0, spoilt=spoilt,
            borrowed=borrowed,
        ), part, whole))  # fmt: skip
    sure = _sure(left, blocks)
    rows = [(replace(row, best=sure.get(row.submodel, 0.0)), *rest) for row, *rest in found]
    return sorted(rows, key=lambda one: (bool(one[0].spoilt), -one[0].removed))


def _sure(left: Mapping[str, Floats], blocks: Any) -> dict[str, float]:
    """Share of samples of the blocks in which each sub-model clearly leaves the least."""
    if not left:
        return {}
    sums = np.array([np.bincount(blocks, own) for own in left.values()])
    n = sums.shape[1]
    drawn = np.random.default_rng(0).multinomial(n, np.full(n, 1 / n), DRAWS) @ sums.T
    others = [np.delete(drawn, k, axis=1).min(axis=1, initial=np.inf) for k in range(len(left))]
    return {name: round(float(np.mean(drawn[:, k] < CLEAR * others[k])), 3)
            for k, name in enumerate(left)}  # fmt: skip
