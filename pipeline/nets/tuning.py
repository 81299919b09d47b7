"""Search for learning rate, units and penalty of a network on windows.

The candidates of a generation are trained side by side, on few windows and for few epochs.  One is
stopped at a milestone when its error is above the median of the best of earlier generations by
then, as many as a generation has (median stopping, Golovin et al. 2017).  The best settings are
trained again in full, with a seed of their own each; the network of least validation error is the
result.  An optimum at a bound says that the range may be too small: that of Feed2025 lies at the
lower bounds of all three.

Sources: Feed2025 (whale optimisation, 8 candidates, 20 generations); Golovin et al. 2017, "Google
Vizier".
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from math import inf
from statistics import median

import numpy as np

from pipeline.nets.descent import Diverged
from pipeline.nets.settings import (
    ArxSettings,
    SequenceSettings,
    TuningSettings,
    WindowTraining,
)
from pipeline.nets.window_training import TrainedSequence, train_windows
from pipeline.nets.windows import Windows
from pipeline.parallel import Compute, mapped
from pipeline.schema.arrays import Floats
from pipeline.search.box import Box
from pipeline.search.methods import minimise

Values = dict[str, float]
"""Values of what is tuned, by name."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """One that was trained in the search."""

    generation: int
    """Number of the generation, from 1."""
    values: Values
    """Values of the tuned settings."""
    errors: Floats
    """RMSE of the validation windows after each epoch, in the unit of the target; empty where the
    first epoch diverged; shape (E,)."""
    pruned: bool
    """Whether it was stopped at a milestone."""

    @property
    def epochs(self) -> int:
        """Epochs that were trained [1]."""
        return len(self.errors)

    @property
    def validation(self) -> float:
        """Least RMSE of the validation windows; infinite where the training diverged."""
        return float(self.errors.min(initial=inf))

    def by(self, epoch: int) -> float | None:
        """Least error up to an epoch; None where it was pruned before."""
        if self.pruned and self.epochs < epoch:
            return None
        return float(self.errors[:epoch].min(initial=inf))


@dataclass(frozen=True, kw_only=True, eq=False)
class Tuned:
    """Result of a search for the settings of a network."""

    settings: TuningSettings
    """Settings of the search."""
    names: tuple[str, ...]
    """Names of the tuned settings."""
    candidates: tuple[Candidate, ...]
    """Candidates that were trained, in the order of the search."""
    history: Floats
    """Least validation RMSE of the candidates up to each generation; shape (G,)."""
    evaluations: int
    """Candidates of the search; one that occurs again is not trained again."""
    retrained: tuple[TrainedSequence, ...]
    """Networks trained in full, the best by validation error first."""
    bounds_hit: dict[str, str]
    """Bound, ``low`` or ``high``, at which a value of the best settings lies."""

    @property
    def network(self) -> TrainedSequence:
        """The best of those that were trained in full."""
        return self.retrained[0]


def tune(
    kind: SequenceSettings, windows: Windows, training: WindowTraining, settings: TuningSettings,
    *, compute: Compute = "processes",
) -> Tuned:  # fmt: skip
    """The best settings within their ranges, and the network that was trained with them.

    ``units`` of ``kind`` is tuned where it has them, the rest is kept. ``training`` is that of the
    trainings in full, of which the k-th of the best has the seed ``training.seed`` + k, from 0;
    those of candidates differ in what :class:`TuningSettings` says. Groups of ``windows`` are whole
    recordings.  Raises ValueError when the network has nothing to tune, no recordings are kept for
    validation, all candidates diverge, or the windows do not fit (:func:`train_windows`).
    """
    if isinstance(kind, ArxSettings):
        raise ValueError(
            f"a network of kind {kind.kind} is solved at once and has no {' or '.join(_RANGES)} to "
            "tune: give one that is trained in epochs"
        )
    if training.validation == 0:
        raise ValueError(
            "settings are compared by recordings that are not learnt from: set "
            "window_training.validation above 0"
        )
    search = _Search(kind, thinned(windows, settings.windows), training, settings, compute)
    box = search.box
    found = minimise(
        settings.method, search.cost, box.low, box.high, population=settings.population,
        generations=settings.generations, seed=settings.seed, log=box.log, integer=box.integer,
    )  # fmt: skip
    candidates = tuple(search.known.values())
    retrained = _in_full(search, windows, training)
    if not retrained:
        raise ValueError(
            f"none of {len(candidates)} candidates could be trained without divergence: lower the "
            f"bounds of tuning.learning_rate from {settings.learning_rate[0]:g} to "
            f"{settings.learning_rate[1]:g}"
        )
    chosen = _values(retrained[0], search.names)
    sides = zip(search.names, box.at_bounds(np.array(list(chosen.values()))).tolist(), strict=True)
    return Tuned(
        settings=settings, names=search.names, candidates=candidates, history=found.history,
        evaluations=found.evaluations, retrained=tuple(retrained),
        bounds_hit={name: "low" if side < 0 else "high" for name, side in sides if side},
    )  # fmt: skip


def thinned(windows: Windows, most: int) -> Windows:
    """Some windows of each recording, spread evenly in their order, ``most`` in all.

    At least one of each stays, so that the choice of recordings by a seed stays the same.
    """
    if len(windows.y) <= most:
        return windows
    rows = []
    for name in np.unique(windows.group):
        own = np.flatnonzero(windows.group == name)
        many = max(most * len(own) // len(windows.y), 1)
        rows.append(own[(np.arange(many) * len(own)) // many])
    kept = np.sort(np.concatenate(rows))
    at = np.broadcast_to(windows.at, windows.group.shape)
    return replace(
        windows, x=windows.x[kept], y=windows.y[kept], group=windows.group[kept], at=at[kept]
    )


_RANGES = ("learning_rate", "units", "l2")
"""Tuned settings, where the network has them."""
_LOGARITHMIC = ("learning_rate", "l2")

Task = tuple[SequenceSettings, WindowTraining]
"""Settings that differ from training to training."""


class _Search:
    """Costs of generations, and all candidates that were trained for them."""

    def __init__(
        self, kind: SequenceSettings, windows: Windows, training: WindowTraining,
        settings: TuningSettings, place: Compute,
    ) -> None:  # fmt: skip
        self.kind, self.windows, self.settings = kind, windows, settings
        self.training = replace(training, epochs=settings.epochs, patience=settings.patience)
        self.place: Compute = place
        self.generation = 0
        self.known: dict[tuple[float, ...], Candidate] = {}
        own = {item.name for item in (*fields(kind), *fields(training))}  # type: ignore[arg-type]
        self.names = tuple(name for name in _RANGES if name in own)
        low, high = zip(*(getattr(settings, name) for name in self.names), strict=True)
        log = [name in _LOGARITHMIC and a > 0 for name, a in zip(self.names, low, strict=True)]
        self.box = Box.of(low, high, log, [name == "units" for name in self.names])

    def cost(self, x: Floats) -> Floats:
        """Validation RMSE, shape (P,), of candidates, shape (P, D); infinite where one diverges."""
        self.generation += 1
        asked = [tuple(row) for row in x.tolist()]
        new = [one for one in dict.fromkeys(asked) if one not in self.known]
        limits = self._limits()
        tasks = [_with(self.kind, self.training, self._named(one)) for one in new]
        attempt = partial(_attempt, windows=self.windows, limits=limits)
        for one, (errors, pruned) in zip(
            new, mapped(attempt, tasks, compute=self.place), strict=True
        ):
            self.known[one] = Candidate(
                generation=self.generation, values=self._named(one), errors=errors, pruned=pruned
            )
        return np.array([self.known[one].validation for one in asked])

    def _limits(self) -> dict[int, float]:
        """Milestone -> median of the least errors by then, of the generations that are done."""
        limits = {}
        for epoch in self.settings.milestones:
            found = [one.by(epoch) for one in self.known.values()]
            errors = [error for error in found if error is not None]
            if len(errors) >= self.settings.fewest and epoch < self.settings.epochs:
                limits[epoch] = median(sorted(errors)[: self.settings.population])
        return limits

    def _named(self, row: Sequence[float]) -> Values:
        return {
            name: int(value) if name == "units" else value
            for name, value in zip(self.names, row, strict=True)
        }


def _in_full(search: _Search, windows: Windows, training: WindowTraining) -> list[TrainedSequence]:
    """The best candidates trained in full, the best first, without those that diverge."""
    candidates = (one for one in search.known.values() if one.epochs)
    best = sorted(candidates, key=lambda one: one.validation)
    split = training.seed if training.validation_seed is None else training.validation_seed
    tasks = []
    for k, one in enumerate(best[: search.settings.retrained]):
        full = replace(training, seed=training.seed + k, validation_seed=split)
        tasks.append(_with(search.kind, full, one.values))
    train = partial(_trained, windows=windows)
    again = mapped(train, tasks, compute=search.place)
    return sorted((one for one in again if one is not None), key=_error)


def _with(kind: SequenceSettings, training: WindowTraining, values: Values) -> Task:
    own = {name: value for name, value in values.items() if hasattr(kind, name)}
    rest = {name: value for name, value in values.items() if name not in own}
    return replace(kind, **own), replace(training, **rest)  # type: ignore[type-var, arg-type]


def _values(found: TrainedSequence, names: Sequence[str]) -> Values:
    return {
        name: getattr(found.kind if hasattr(found.kind, name) else found.settings, name)
        for name in names
    }


def _attempt(task: Task, windows: Windows, limits: dict[int, float]) -> tuple[Floats, bool]:
    """Validation errors of a candidate after each epoch, and whether it was pruned."""
    least, pruned = inf, False

    def watch(epoch: int, error: float) -> bool:
        nonlocal least, pruned
        least = min(least, error)
        pruned = least > limits.get(epoch, inf)
        return pruned

    try:
        found = train_windows(task[0], windows, settings=task[1], watch=watch)
    except Diverged:
        return np.empty(0), False
    return found.history[:, 2], pruned


def _trained(task: Task, windows: Windows) -> TrainedSequence | None:
    """Network of a training in full; None where it diverges."""
    try:
        return train_windows(task[0], windows, settings=task[1])
    except Diverged:
        return None


def _error(found: TrainedSequence) -> float:
    return float(found.history[:, 2].min())
