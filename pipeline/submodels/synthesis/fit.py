"""Training of the generator on the windows of training tools, and the wear read from its output.

The judge is a learner that saw recorded windows alone; it takes no part in the training.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.nets.dcgan_settings import ConditionSpace, GanTraining
from pipeline.nets.diversity import Collapse, collapse, features
from pipeline.nets.settings import place
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.verdict import significant
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.statistics import rank_correlation
from pipeline.submodels.synthesis.model import (
    TOOL,
    WEAR,
    Look,
    Reference,
    Synthesis,
    SynthesisFitSettings,
    WearCurve,
    beside,
    conditions_of_windows,
)

if TYPE_CHECKING:
    from pipeline.nets.dcgan import TrainedGan

THIRDS = 3
"""Intervals of the range of wear whose tendency is looked at."""
SHOWN = 3
"""Windows that a page shows: of the least, the middle and the greatest wear."""
STEP = 4
"""Step of a generator, in steps of a small network [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """A generator with the features of what it was trained on, and whether it collapsed.

    ``earlier`` are its states at stated steps of the training, ``others`` the last of these and
    generators of other seeds, with features of their windows at the same conditions.
    """

    gan: "TrainedGan"
    earlier: Mapping[int, "TrainedGan"]
    others: tuple[tuple["TrainedGan", Floats], ...]
    reference: Reference
    collapse: Collapse
    windows: int


def thinned(windows: WearWindows, most: int) -> WearWindows:
    """Windows, ``most`` at most, evenly over each tool's life."""
    tools = np.unique(windows.tool)
    share = max(most // len(tools), 1)
    rows = []
    for tool in tools:
        mine = np.flatnonzero(windows.tool == tool)
        at = np.linspace(0, len(mine) - 1, min(share, len(mine))).round().astype(int)
        rows.append(mine[np.unique(at)])
    return windows.of(np.sort(np.concatenate(rows)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """A generator to be trained on windows at their conditions."""

    windows: WearWindows
    conditions: Mapping[str, Any]
    settings: SynthesisFitSettings
    training: GanTraining


def _generator(task: _Task) -> tuple["TrainedGan", dict[int, "TrainedGan"]]:
    """The generator, and its states at stated steps."""
    from pipeline.nets.dcgan_training import train_gan

    windows, training, looks = task.windows, task.training, task.settings.looks
    steps, every = training.steps, training.every
    stated = {round(steps * k / looks / every) * every for k in range(1, looks)}
    earlier: dict[int, TrainedGan] = {}

    def look(step: int, so_far: Callable[[], "TrainedGan"]) -> None:
        if step in stated:
            earlier[step] = so_far()

    gan = train_gan(
        task.settings.network, windows.values, task.conditions, training=training,
        channels=windows.channels, units=windows.units,
        condition_units={WEAR: windows.wear_unit, **windows.condition_units}, watch=look,
        read=WEAR,
    )  # fmt: skip
    return gan, earlier


def trained(
    windows: WearWindows, settings: SynthesisFitSettings, hidden: tuple[str, ...] = ()
) -> Trained:
    """Generator of windows, trained on all that are given.

    ``windows`` are of training tools, with known wear; conditions ``hidden`` are none of the
    generator's. ValueError when there are too few windows, or a condition is not known of some.
    """
    windows = thinned(windows, settings.windows)
    not_used = {*hidden, *settings.left_out, *(() if settings.by_tool else (TOOL,))}
    conditions = {k: v for k, v in conditions_of_windows(windows).items() if k not in not_used}
    first = settings.training
    done = mapped(_generator, [
        _Task(windows=windows, conditions=conditions, settings=settings,
              training=replace(first, seed=first.seed + k))
        for k in range(settings.trainings)
    ], compute=place(STEP * settings.trainings * first.steps))  # fmt: skip
    (gan, earlier), *others = done
    made = gan.sample(conditions, seed=settings.seed + 1)
    states = [one for pair in others for one in (pair[0], *_latest(pair[1]))]
    states += _latest(earlier) if others else []
    numbers, words = gan.space.encoded(conditions)
    at = np.hstack([numbers, *(2.0 * np.eye(w.max() + 1)[w] for w in words.T)])
    found = collapse(windows.values, made, at, gan.history[:, 1], seed=settings.seed)
    wear = np.asarray(windows.wear, float)
    rows = np.argsort(wear, kind="stable")[np.linspace(0, len(wear) - 1, SHOWN).astype(int)]
    reference = Reference(
        recorded=features(windows.values), generated=features(made),
        conditions=beside(gan.space, conditions), wear=wear,
        shown=np.asarray(windows.values[rows], float), like=made[rows], shown_wear=wear[rows],
    )  # fmt: skip
    return Trained(
        gan=gan, earlier=earlier, reference=reference, collapse=found, windows=len(windows),
        others=tuple(
            (one, features(one.sample(conditions, seed=settings.seed + 1))) for one in states
        ),
    )  # fmt: skip


def _latest(earlier: Mapping[int, "TrainedGan"]) -> list["TrainedGan"]:
    return [earlier[max(earlier)]] if earlier else []


def looks(
    served: Synthesis, earlier: Mapping[int, "TrainedGan"], last: WearCurve,
    settings: SynthesisFitSettings,
) -> tuple[Look, ...]:  # fmt: skip
    """Curves of the first judge at steps of the training, the ``last`` one among them."""
    name = served.file.judges[0]
    found = {
        step: curves(replace(served, gan=gan), settings, (name,))[name]
        for step, gan in sorted(earlier.items())
    }
    states = {**found, served.file.steps: last}
    return tuple(Look(step=step, mae=one.mae, slope=one.slope) for step, one in states.items())


def curves(
    served: Synthesis, settings: SynthesisFitSettings, judges: Sequence[str]
) -> dict[str, WearCurve]:
    """Some judges' wear of windows generated over the whole range of wear that was learnt.

    The other conditions are those of training windows, drawn with replacement.
    """
    gan = served.gan
    wear = next(one for one in gan.space.continuous if one.name == WEAR)
    asked = np.linspace(wear.low, wear.high, 2 if served.file.is_class else settings.wears)
    rng = np.random.default_rng(settings.seed + 2)
    rows = rng.integers(0, len(served.reference.wear), settings.each)
    conditions = _of_rows(served, rows)
    read = {name: np.empty((len(asked), settings.each)) for name in judges}
    for k, one in enumerate(asked):
        conditions[WEAR] = np.full(settings.each, one)
        made = gan.sample(conditions, seed=settings.seed + 3 + k)
        for name in judges:
            read[name][k] = served.judges[name](made, conditions)
    return {name: curve_of(asked, some) for name, some in read.items()}


def curve_of(requested: Floats, read: Floats) -> WearCurve:
    """Figures of read wear, shape (W, N), over requested wear, shape (W,)."""
    mean = read.mean(axis=1)
    low, high = np.quantile(read, [0.05, 0.95], axis=1)
    error = mean - requested
    still = np.ptp(read) == 0 or np.ptp(requested) == 0
    slope = 0.0 if np.ptp(requested) == 0 else np.polyfit(requested, mean, 1)[0]
    rank = 0.0 if still else rank_correlation(np.repeat(requested, read.shape[1]), read.ravel())
    of_means = 0.0 if still or np.ptp(mean) == 0 else rank_correlation(requested, mean)
    edges = np.linspace(0, len(requested), THIRDS + 1).round().astype(int)
    false = []
    for first, end in pairwise(edges):
        part = slice(max(first - 1, 0), end)
        if np.ptp(requested[part]) > 0 and np.polyfit(requested[part], mean[part], 1)[0] <= 0:
            false.append((significant(requested[part][0]), significant(requested[part][-1])))
    return WearCurve(
        asked=_list(requested), mean=_list(mean), low=_list(low), high=_list(high),
        mae=significant(np.abs(error).mean()), mse=significant((error**2).mean()),
        slope=significant(slope), rank_correlation=significant(rank),
        rank_of_means=significant(of_means), false_intervals=tuple(false),
    )  # fmt: skip


def _of_rows(served: Synthesis, rows: Any) -> dict[str, Any]:
    """Conditions of some training windows, without the wear and the tool."""
    space: ConditionSpace = served.gan.space
    numbers = served.reference.conditions[rows]
    found: dict[str, Any] = {}
    at = 0
    for one in space.continuous:
        if one.name != WEAR:
            found[one.name] = one.low + 0.5 * (numbers[:, at] + 1.0) * (one.high - one.low)
            at += 1
    for word in space.discrete:
        if word.name == TOOL:
            continue  # the mean of all tools
        many = len(word.words) + 1
        index = numbers[:, at : at + many].argmax(axis=1)
        found[word.name] = np.array(["", *word.words])[index]
        at += many
    return found


def _list(values: Floats) -> tuple[float, ...]:
    return tuple(significant(one) for one in values)
