"""Comparison of generated windows with recorded ones of a tool, as rows of the shared judge.

Each figure is a quantity of its own: the wear that a judge reads from generated windows; the wear
of recorded windows by learners that saw generated ones only, or both; distances between windows of
the same conditions; distance to the nearest training window; power in bands; spindle orders.

Density and coverage: Naeem et al. 2020.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np
import pandas as pd

from pipeline.nets.diversity import band_edges, features
from pipeline.schema.arrays import Floats
from pipeline.schema.predictions import AGAIN
from pipeline.schema.verdict import Fact, significant
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.contract import Prediction
from pipeline.submodels.statistics import rank_correlation
from pipeline.submodels.synthesis.model import FOREST, Learner, Synthesis, beside

GENERATED = "wear of generated windows"
LEARNT = "wear learnt from generated windows"
AUGMENTED = "wear learnt from recorded and generated windows"
SPREAD = "distance between windows of the same conditions"
COPY = "distance to the nearest training window"
SPECTRUM = "power in a band"
ORDERS = "power at a spindle order"
RECORDED, NEAREST, MEAN = "recorded", "nearest", "mean"
TITLES = {RECORDED: "recorded signals", NEAREST: "nearest training windows", MEAN: "mean wear"}
"""Baselines, and their names in words."""
SPEED = ("spindle_speed", "speed", "spindle speed")
"""Names of the condition of the spindle orders."""
ORDER_COUNT = 12
"""Spindle orders that are compared [1]; those of tooth passing are among them."""
NEPERS_TO_DB = 10.0 / np.log(10.0)
WINDOW_OF_AN_ORDER = 0.5
"""Half width of an order, in orders [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Recorded windows of a case and generated ones at their conditions, as features too."""

    served: Synthesis
    windows: WearWindows
    conditions: Mapping[str, Any]
    made: Floats
    real: Floats
    fake: Floats
    beside: Floats
    nearest: Any
    others: tuple[tuple[Floats, Floats, Learner], ...]

    @property
    def scaled(self) -> tuple[Floats, Floats]:
        return self.served.scaling(self.real), self.served.scaling(self.fake)

    def again(self, figure: Callable[[Floats, Floats, Learner], Floats]) -> dict[str, Floats]:
        """A figure by each training, from its windows, their features and what learns from them."""
        return {f"{AGAIN}{k}": figure(*one) for k, one in enumerate(self.others)}


def compared(
    windows: WearWindows, served: Synthesis, name: str, *, again: bool = False
) -> Prediction:
    """Comparison of generated and recorded windows of a tool.

    ``windows`` are recorded, with known wear; ``name`` of the case seeds the noise; ``again``
    compares what decides of generators of other seeds as well.
    """
    many = served.file.judged
    rows = np.unique(np.linspace(0, len(windows) - 1, min(many, len(windows))).round().astype(int))
    windows = windows.of(rows)
    conditions = served.known(windows)
    inside = served.inside(conditions)
    facts = {"windows outside of what was learnt": Fact(value=float((~inside).sum()), unit="1")}
    strange = sorted({
        str(word) for one in served.gan.space.discrete
        for word in served_words(windows, one.name) if word not in one.words
    })  # fmt: skip
    if strange:
        facts["words that were not learnt"] = Fact(value=", ".join(strange))
    if inside.sum() < 3:
        note = "fewer than three windows lie in the conditions that were learnt"
        return Prediction(frame=pd.DataFrame(), facts=facts, note=note)
    windows = windows.of(inside)
    conditions = {key: values[inside] for key, values in conditions.items()}
    seed = crc32(name.encode())
    made = served.gan.sample(conditions, seed=seed)
    others = [
        (some := gan.sample(conditions, seed=seed), features(some), learner)
        for gan, learner in (served.trainings if again and served.stored else ())
    ]
    known = beside(served.gan.space, conditions)
    pair = _Pair(
        served=served, windows=windows, conditions=conditions, made=made,
        real=features(windows.values), fake=features(made), beside=known,
        nearest=_nearest(served, known, windows.wear), others=tuple(others),
    )  # fmt: skip
    frame = pd.concat([*_wears(pair), *_distances(pair), *_spectra(pair)], ignore_index=True)
    return Prediction(frame=frame, facts=facts | _facts(pair))


def served_words(windows: WearWindows, name: str) -> Any:
    """Words of a discrete condition of windows."""
    return windows.tool if name == "tool" else windows.conditions[name]


def _nearest(served: Synthesis, known: Floats, wear: Floats) -> Any:
    """Training window of the nearest conditions and wear, for each window."""
    mine = served.reference
    low, high = mine.wear.min(), mine.wear.max()
    width = max(high - low, 1e-12)
    here = np.hstack([known, 2.0 * (wear[:, None] - low) / width])
    there = np.hstack([mine.conditions, 2.0 * (mine.wear[:, None] - low) / width])
    return squared_distances(here, there).argmin(axis=1)


def squared_distances(a: Floats, b: Floats) -> Floats:
    """Mean squared differences of rows, shape (N, M)."""
    both = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2.0 * a @ b.T
    return np.maximum(both, 0.0) / max(a.shape[1], 1)


def _frame(quantity: str, unit: str, t: Any, regime: str = "", **columns: Any) -> pd.DataFrame:
    found = pd.DataFrame({"t": np.asarray(t, float), **columns})
    return found.assign(quantity=quantity, unit=unit, regime=regime)


def _wears(pair: _Pair) -> list[pd.DataFrame]:
    """Wear read from generated windows, and wear of recorded ones by what learners saw."""
    served, windows = pair.served, pair.windows
    unit, asked = served.file.wear_unit, np.asarray(windows.wear, float)
    judged = served.judge(pair.real, pair.beside)
    near = served.judge(served.reference.recorded[pair.nearest], pair.beside)
    mean = np.full(len(asked), float(served.reference.wear.mean()))
    t = windows.progress
    read = [
        _frame(
            GENERATED,
            unit,
            t,
            name,
            measured=asked,
            predicted=judge(pair.made, pair.conditions),
            baseline_recorded=judge(np.asarray(windows.values, float), pair.conditions),
            baseline_nearest=near if name == FOREST else np.full(len(asked), np.nan),
            baseline_mean=mean,
        ).assign(**pair.again(lambda made, *_, judge=judge: judge(made, pair.conditions)))
        for name, judge in served.judges.items()
    ]
    return [
        *read,
        _frame(
            LEARNT, unit, t, measured=asked,
            predicted=served.from_generated(pair.real, pair.beside), baseline_recorded=judged,
            baseline_mean=mean,
        ).assign(**pair.again(lambda *one: one[2](pair.real, pair.beside))),
        _frame(
            AUGMENTED, unit, t, measured=asked,
            predicted=served.augmented(pair.real, pair.beside), baseline_recorded=judged,
            baseline_mean=mean,
        ),
    ]  # fmt: skip


def _distances(pair: _Pair) -> list[pd.DataFrame]:
    """Distances between neighbours in wear and conditions, and to the nearest training window."""
    t, other, scaling = pair.windows.progress, _neighbour(pair), pair.served.scaling
    training = scaling(pair.served.reference.recorded)

    def apart(features: Floats) -> Floats:
        one = scaling(features)
        return np.asarray(np.sqrt(((one - one[other]) ** 2).mean(axis=1)))

    def nearest(features: Floats) -> Floats:
        return np.asarray(np.sqrt(squared_distances(scaling(features), training).min(axis=1)))

    return [
        _frame(
            quantity, "1", t, measured=distance(pair.real), predicted=distance(pair.fake)
        ).assign(**pair.again(lambda _, fake, *rest, distance=distance: distance(fake)))
        for quantity, distance in ((SPREAD, apart), (COPY, nearest))
    ]


def _neighbour(pair: _Pair) -> Any:
    """Another window next to it in conditions and wear, for each window of the case."""
    place = np.hstack([pair.beside, _standard(np.asarray(pair.windows.wear, float))[:, None]])
    apart = squared_distances(place, place)
    np.fill_diagonal(apart, np.inf)
    return apart.argmin(axis=1)


def _standard(values: Floats) -> Floats:
    return (values - values.mean()) / max(float(values.std()), 1e-12)


def _spectra(pair: _Pair) -> list[pd.DataFrame]:
    """Mean level of the power in bands of each channel [dB], and in spindle orders."""
    file = pair.served.file
    edges = band_edges(file.length)
    centre = np.sqrt(edges[:-1] * (edges[1:] - 1.0)) * file.rate_Hz / file.length
    each = pair.real.shape[1] // len(file.channels)
    near = pair.served.reference.recorded[pair.nearest]
    found = []
    for k, channel in enumerate(file.channels):
        columns = slice((k + 1) * each - len(centre), (k + 1) * each)
        real, fake, other = (
            NEPERS_TO_DB * one[:, columns].mean(axis=0) for one in (pair.real, pair.fake, near)
        )
        found.append(
            _frame(
                SPECTRUM, "dB", centre, channel, measured=real, predicted=fake,
                baseline_nearest=other,
            )
        )  # fmt: skip
    speed = _speed(pair.windows)
    if speed is not None:
        for k, channel in enumerate(file.channels):
            real, fake = (
                order_levels(one[:, k], speed, file.rate_Hz)
                for one in (np.asarray(pair.windows.values, float), pair.made)
            )
            seen = np.isfinite(real) & np.isfinite(fake)
            orders = np.arange(1.0, ORDER_COUNT + 1)[seen]
            found.append(
                _frame(ORDERS, "dB", orders, channel, measured=real[seen], predicted=fake[seen])
            )
    return found


def recorded_readings(frame: pd.DataFrame, role: str | None) -> dict[str, tuple[float, float]]:
    """Slope and rank correlation of each wear reader over recorded windows of a role's tools."""
    found: dict[str, tuple[float, float]] = {}
    if "baseline_recorded" not in frame:
        return found
    frame = frame[(frame["quantity"] == GENERATED) & (frame["role"] == role)]
    for name, one in frame.groupby("regime"):
        one = one.dropna(subset=["measured", "baseline_recorded"])
        wear, read = one["measured"].to_numpy(), one["baseline_recorded"].to_numpy()
        if len(one) > 2 and np.ptp(wear) > 0 and np.ptp(read) > 0:
            slope = float(np.polyfit(wear, read, 1)[0])
            found[str(name)] = slope, rank_correlation(wear, read)
    return found


def _speed(windows: WearWindows) -> Floats | None:
    """Speed of the spindle [1/s] of windows, where it is among their conditions."""
    for name in SPEED:
        unit = windows.condition_units.get(name, "")
        if name in windows.conditions and unit:
            factor, _ = conversion(unit, "1/min")
            found: Floats = factor * np.asarray(windows.conditions[name], float) / 60.0
            return found if (found > 0).all() else None
    return None


def order_levels(signal: Floats, speed: Floats, rate_Hz: float) -> Floats:
    """Mean level of windows (N, L) at multiples of the spindle's frequency [dB], shape (orders,).

    NaN where an order lies above half of the sampling rate or is narrower than a line.
    """
    length = signal.shape[1]
    power = np.abs(np.fft.rfft(signal - signal.mean(axis=1, keepdims=True), axis=1)) ** 2
    power /= length**2
    frequency = np.fft.rfftfreq(length, 1.0 / rate_Hz)
    found = np.full((len(signal), ORDER_COUNT), np.nan)
    for order in range(1, ORDER_COUNT + 1):
        near = np.abs(frequency[None] / speed[:, None] - order) <= WINDOW_OF_AN_ORDER
        near &= frequency[None] > 0
        many = near.sum(axis=1)
        level = np.where(near, power, 0.0).sum(axis=1)
        there = (many > 0) & (level > 0)
        found[there, order - 1] = 10.0 * np.log10(level[there])
    every = np.isfinite(found).all(axis=0)
    out = np.full(ORDER_COUNT, np.nan)
    out[every] = found[:, every].mean(axis=0)
    return out


def _facts(pair: _Pair) -> dict[str, Fact]:
    """Density and coverage of generated windows about the recorded ones of the case."""
    real, fake = pair.scaled
    near = min(pair.served.file.neighbours, len(real) - 1)
    apart = np.sqrt(squared_distances(real, real))
    radius = np.sort(apart, axis=1)[:, near]  # the first is the window itself
    reached = np.sqrt(squared_distances(real, fake)) <= radius[:, None]
    from_training = np.sqrt(
        squared_distances(real, pair.served.scaling(pair.served.reference.recorded[pair.nearest]))
    ) <= radius[:, None]  # fmt: skip
    asked = np.asarray(pair.windows.wear, float)
    bias = float((pair.served.judge(pair.fake, pair.beside) - asked).mean())
    return {
        "density": Fact(value=significant(reached.mean() * len(real) / near, 4), unit="1"),
        "coverage": Fact(value=significant(reached.any(axis=1).mean(), 4), unit="1"),
        "coverage by training windows": Fact(
            value=significant(from_training.any(axis=1).mean(), 4), unit="1"
        ),
        "bias of generated wear": Fact(value=significant(bias, 4), unit=pair.served.file.wear_unit),
    }
