"""Training and comparison: networks on folds of the training recordings, the best one serves.

Every kind is trained on all but one fold, and predicts that fold; the kind with the least error
there serves, as the mean of its networks, and its errors there calibrate the 90 % interval.  Where
there are fewer recordings than folds, stretches of time take their place, which is said.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from pipeline.nets.settings import TuningSettings, WindowTraining, place
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.verdict import significant
from pipeline.submodels.conformal import Residuals, bands, splits
from pipeline.submodels.following_residual.features import MEASURED, RESIDUAL, Features, inputs_of
from pipeline.submodels.following_residual.model import (
    ARX,
    ESTIMATION,
    PERSISTENCE,
    PREDICTION,
    TWIN,
    KindScore,
    LeakShown,
    ResidualFitSettings,
    SearchFacts,
    UseModel,
    key_of,
)

UM = 1e6
"""Micrometres of a metre."""
LEFT_OUT = 500
"""Windows of a recording left out by which kinds are compared, at most, evenly [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """All windows of one axis in one use, with what they are sampled and judged by."""

    windows: Windows
    """Whose groups are those of splits."""
    regime: Any
    """Regime of each window's last row; shape (B,)."""
    time: Floats
    """Time of that row in its recording [s]; shape (B,)."""

    @property
    def groups(self) -> list[str]:
        """Names in order."""
        return list(dict.fromkeys(self.windows.group.tolist()))


def sampled(
    features: Sequence[Features], inputs: Sequence[WindowInput], use: str,
    settings: ResidualFitSettings, *, allow_leaks: bool = False,
) -> Sampled:  # fmt: skip
    """Windows of recordings after the time in which the drives' model settles."""
    horizon = inf if use == PREDICTION else settings.horizon_s
    found = windows_of(
        [one.recording for one in features], inputs, RESIDUAL, settings.length, horizon,
        allow_leaks=allow_leaks, joined=True,
    )  # fmt: skip
    by_name = {one.recording.name: one for one in features}
    keep = np.zeros(len(found.y), bool)
    regime = np.empty(len(found.y), object)
    time, group = np.zeros(len(found.y)), found.group.astype(object)
    for name, one in by_name.items():
        rows = found.group == name
        at = found.at[rows]
        keep[rows] = (at * one.recording.step_s >= settings.settle_s) & one.known[at]
        regime[rows], time[rows], group[rows] = one.regime[at], one.time[at], one.group
    all_of_them: Any = found.x
    windows = replace(
        found, x=all_of_them.of(keep), y=found.y[keep], group=group[keep].astype(str),
        at=found.at[keep],
    )  # fmt: skip
    return Sampled(windows=windows, regime=regime[keep].astype(str), time=time[keep])


def chosen(windows: Windows, rows: Any) -> Windows:
    """Some of the windows."""
    return replace(
        windows, x=windows.x[rows], y=windows.y[rows], group=windows.group[rows],
        at=np.broadcast_to(windows.at, windows.group.shape)[rows],
    )  # fmt: skip


def stratified(regime: Any, among: Any, many: int, seed: int) -> Any:
    """Rows, ``many`` at most: as many of each regime, the rest from those that have more."""
    random = np.random.default_rng(seed)
    found: list[Any] = []
    kinds = sorted(
        np.unique(regime[among]).tolist(), key=lambda kind: int((among & (regime == kind)).sum())
    )
    for k, kind in enumerate(kinds):
        rows = random.permutation(np.flatnonzero(among & (regime == kind)))
        share = (many - sum(map(len, found))) // (len(kinds) - k)
        found.append(rows[:share])
    return np.sort(np.concatenate(found)) if found else np.zeros(0, int)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    kind: str
    windows: Windows
    others: Floats
    settings: ResidualFitSettings
    training: WindowTraining


def _trained(task: _Task) -> tuple[Mapping[str, Any], Floats]:
    from pipeline.nets.window_training import train_windows

    training = task.training
    if len(set(task.windows.group.tolist())) < 2:
        training = replace(training, validation=0.0)
    choices = [
        train_windows(one, task.windows, settings=training)
        for one in task.settings.networks(task.kind)
    ]
    found = min(choices, key=lambda one: float(one.history[:, 2].min()))
    return found.document(), found.predict(task.others)


def _all_trained(tasks: Sequence[_Task]) -> list[tuple[Mapping[str, Any], Floats]]:
    """Result of each task, on all cores where that is worth it."""
    steps = sum(one.training.steps(len(one.windows.y)) for one in tasks if one.kind != ARX)
    return mapped(_trained, tasks, compute=place(steps))


@dataclass(frozen=True, kw_only=True, eq=False)
class UseFit:
    """Use of an axis with its networks' documents by kind."""

    model: UseModel
    documents: Mapping[str, tuple[Mapping[str, Any], ...]]


def fit_axes(
    axes: Mapping[str, Sequence[Features]], settings: ResidualFitSettings
) -> dict[tuple[str, str], UseFit]:
    """Every use of every axis, by letter and use.

    ValueError when no recording is long enough for a window, or too little is left of them to leave
    some out.
    """
    parts: dict[tuple[str, str], tuple[Sampled, bool]] = {}
    for letter, features in axes.items():
        cut, by_time = enough(features, settings)
        for use, horizon in ((PREDICTION, None), (ESTIMATION, settings.horizon_s)):
            inputs = inputs_of(cut, horizon)
            if inputs:
                parts[letter, use] = sampled(cut, inputs, use, settings), by_time
    tasks, places = [], []
    for (letter, use), (part, _) in parts.items():
        kinds = settings.kinds if use == PREDICTION else settings.estimators
        for fold, (task, _) in enumerate(_folds(part, settings)):
            for kind in kinds:
                tasks.append(replace(task, kind=kind))
                places.append((letter, use, kind, fold))
    done = dict(zip(places, _all_trained(tasks), strict=True))
    return {
        place: _use_fit(part, place, by_time, settings, done)
        for place, (part, by_time) in parts.items()
    }


def _folds(part: Sampled, settings: ResidualFitSettings) -> list[tuple[_Task, Any]]:
    """Task without its kind, and rows left out, for each fold."""
    groups = _two_or_more(part, settings)
    order = [name for k in range(settings.folds) for name in groups[k :: settings.folds]]
    found = []
    for fold, (fitted, out) in enumerate(splits(order, settings.folds)):
        among = np.isin(part.windows.group, fitted)
        rows = stratified(part.regime, among, settings.windows, settings.training.seed + fold)
        left = _thinned(part, out)
        training = replace(settings.training, seed=settings.training.seed + fold)
        task = _Task(
            kind="", windows=chosen(part.windows, rows), others=part.windows.x[left],
            settings=settings, training=training,
        )  # fmt: skip
        found.append((task, left))
    return found


def _two_or_more(part: Sampled, settings: ResidualFitSettings) -> list[str]:
    groups = part.groups
    if len(groups) < 2:
        raise ValueError(
            f"of {len(groups)} training recordings or stretches of them something is left after "
            f"the first following_residual_fit.settle_s = {settings.settle_s:g} s, two are the "
            "least: record longer ones, or lower it"
        )
    return groups


def _thinned(part: Sampled, groups: Sequence[str]) -> Any:
    """Rows of recordings left out, evenly, so that no long one costs all the time."""
    found = []
    for name in groups:
        rows = np.flatnonzero(part.windows.group == name)
        found.append(rows[:: max(-(-len(rows) // LEFT_OUT), 1)])
    return np.concatenate(found)


def _use_fit(
    part: Sampled, place: tuple[str, str], by_time: bool, settings: ResidualFitSettings,
    done: Mapping[tuple[str, str, str, int], tuple[Mapping[str, Any], Floats]],
) -> UseFit:  # fmt: skip
    letter, use = place
    kinds = settings.kinds if use == PREDICTION else settings.estimators
    lefts = [left for _, left in _folds(part, settings)]
    rows = np.concatenate(lefts)
    y = part.windows.y
    base = TWIN if use == PREDICTION else PERSISTENCE
    errors = {base: [y[left] - _baseline(part, base, left) for left in lefts]}
    documents = {}
    for kind in kinds:
        found = [done[letter, use, kind, fold] for fold in range(len(lefts))]
        documents[kind] = tuple(document for document, _ in found)
        errors[kind] = [y[left] - got for left, (_, got) in zip(lefts, found, strict=True)]
    scores = {kind: _score(some) for kind, some in errors.items()}
    champion = min(scores, key=lambda kind: scores[kind].rmse_um)
    left_out = Residuals(
        error=UM * np.concatenate(errors[champion]), regime=part.regime[rows],
        group=part.windows.group[rows], t=part.time[rows],
    )  # fmt: skip
    model = UseModel(
        champion=champion, scores=scores, bands=bands(left_out), inputs=part.windows.inputs,
        by_time=by_time,
    )  # fmt: skip
    return UseFit(model=model, documents={key_of(*place, k): d for k, d in documents.items()})


def _baseline(part: Sampled, name: str, rows: Any) -> Floats:
    if name == TWIN:
        return np.zeros(len(rows))
    names = [one.name for one in part.windows.inputs]
    return part.windows.x[rows, -1, names.index(RESIDUAL)]


def _score(errors: Sequence[Floats]) -> KindScore:
    every = np.concatenate(errors)
    each = [float(np.sqrt(np.mean(one**2))) for one in errors]
    return KindScore(
        rmse_um=significant(UM * np.sqrt(np.mean(every**2)), 5),
        max_um=significant(UM * np.abs(every).max(), 5),
        spread_um=significant(UM * np.std(each), 5),
    )


def enough(
    features: Sequence[Features], settings: ResidualFitSettings
) -> tuple[list[Features], bool]:
    """Recordings, or stretches of them where they are of fewer groups than there are folds.

    As many groups as folds at least, and one more for early stopping; and whether they are
    stretches.
    """
    many = len({one.group for one in features})
    if many > settings.folds:
        return list(features), False
    pieces = -(-(settings.folds + 1) // many)
    return [part for one in features for part in _stretches(one, pieces)], True


def _stretches(one: Features, many: int) -> list[Features]:
    """Equal stretches of time of a recording, each a group of its own."""
    edges = np.linspace(0, len(one.time), many + 1).astype(int)
    found = []
    for k in range(many):
        rows = slice(int(edges[k]), int(edges[k + 1]))
        name = f"{one.recording.name}, stretch {k + 1}"
        recording = replace(
            one.recording, name=name,
            signals={key: values[rows] for key, values in one.recording.signals.items()},
        )  # fmt: skip
        found.append(
            Features(
                recording=recording, group=f"{one.group}, stretch {k + 1}", time=one.time[rows],
                measured=one.measured[rows], modelled=one.modelled[rows], regime=one.regime[rows],
                known=one.known[rows],
            )
        )  # fmt: skip
    return found


def searched(
    axes: Mapping[str, Sequence[Features]], settings: ResidualFitSettings,
    tuning: TuningSettings,
) -> tuple[ResidualFitSettings, SearchFacts | None]:  # fmt: skip
    """Settings with what a search found on the first axis that can be predicted, and its facts.

    Learning rate, units and penalty hold for the networks of all kinds and axes: what was cut
    short is that they are searched once.
    """
    letter = next((one for one, some in axes.items() if inputs_of(some, None)), None)
    use = ESTIMATION if letter is None else PREDICTION
    letter = letter or next(iter(axes))
    inputs = inputs_of(axes[letter], None if use == PREDICTION else settings.horizon_s)
    if not settings.searched or not inputs or settings.training.validation == 0:
        return settings, None
    from pipeline.nets.tuning import tune

    cut, _ = enough(axes[letter], settings)
    part = sampled(cut, inputs, use, settings)
    _two_or_more(part, settings)
    rows = stratified(
        part.regime, np.ones(len(part.regime), bool), settings.windows, settings.training.seed
    )
    candidates = replace(settings.training, epochs=tuning.epochs).steps(tuning.windows)
    steps = tuning.population * tuning.generations * candidates
    found = tune(
        settings.network(settings.searched), chosen(part.windows, rows), settings.training, tuning,
        compute=place(steps + tuning.retrained * settings.training.steps(len(rows))),
    )  # fmt: skip
    best = found.retrained[0]
    units = getattr(best.kind, "units", settings.units)
    training = replace(
        settings.training, learning_rate=best.settings.learning_rate, l2=best.settings.l2
    )
    values = {"learning_rate": training.learning_rate, "units": float(units), "l2": training.l2}
    facts = SearchFacts(
        kind=settings.searched, axis=letter, method=tuning.method,
        candidates=len(found.candidates), pruned=sum(one.pruned for one in found.candidates),
        history_um=tuple(significant(UM * one, 5) for one in found.history.tolist()),
        chosen={name: significant(value, 5) for name, value in values.items()},
        bounds_hit=found.bounds_hit,
    )  # fmt: skip
    return replace(settings, units=units, training=training), facts


def leak_shown(
    letter: str, features: Sequence[Features], settings: ResidualFitSettings, honest: KindScore
) -> LeakShown:
    """Apparent gain of the published inputs, with the measured error among them, on one axis.

    Feed2025 gives the network the measured displacement beside the modelled one, of which the
    target is the difference.
    """
    kind = settings.searched or settings.kinds[0]
    cut, _ = enough(features, settings)
    told = (*inputs_of(cut, None), WindowInput(name="measured error"))
    leaky = [replace(one, recording=_with_measured(one)) for one in cut]
    part = sampled(leaky, told, PREDICTION, settings, allow_leaks=True)
    folds = _folds(part, settings)
    done = _all_trained([replace(task, kind=kind) for task, _ in folds])
    score = _score(
        [part.windows.y[left] - got for (_, left), (_, got) in zip(folds, done, strict=True)]
    )
    return LeakShown(
        axis=letter, kind=kind, inputs=part.windows.leaks, rmse_um=score.rmse_um,
        honest_um=honest.rmse_um, max_um=score.max_um, honest_max_um=honest.max_um,
    )  # fmt: skip


def _with_measured(one: Features) -> Recording:
    signals = {**one.recording.signals, "measured error": one.measured}
    measured = MEASURED | {"measured error"}
    return replace(one.recording, signals=signals, measured=measured)
