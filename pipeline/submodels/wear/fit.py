"""Fit of tool wear: every method on training tools, and the champion by cross-validation.

Whole tools are left out in turn.  A single method serves instead of the median of all only where
its squared errors are lower significantly over the tools: of few tools the one that happens to be
best may go astray on the next.  The blend with the baseline, which rests on the signals and on the
tool's use, serves unless it is worse by more than the standard error of the difference over the
tools, and only where the signals have a share in it.  The blend's weights for a tool come from the
predictions of the others, each of which was left out itself.  The interval's half width is
conformal over tools.

Where wear is a class, worn tools have to be separated from others: there the area under the ROC
curve (Hanley and McNeil 1982) decides, and a part that orders the tools better than the median or
the blend by more than the bootstrapped standard error of the difference serves in its place, where
it orders them better than a coin by as much: with few tools left out all areas may lie below a
half.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.nets.settings import place
from pipeline.parallel import mapped
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.model import Model
from pipeline.signals.wear_windows import ChannelScaling, WearWindows
from pipeline.submodels.conformal import Residuals, bands, splits
from pipeline.submodels.statistics import LEVEL, auc, gains
from pipeline.submodels.wear import model
from pipeline.submodels.wear.due import Lasting
from pipeline.submodels.wear.methods import (
    FeatureScaling,
    KnownConditions,
    blend_weights,
    features,
    fit_curve,
    fit_forest,
    fit_ridge,
)

LEAST_SHARE = 0.05
"""Weight of the signals in the blend below which it is the baseline [1]."""
RESAMPLED = 200
"""Draws of tools with replacement, of the standard error of an area under the curve [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Task:
    """A fold: windows to fit on, and those of the tools left out."""

    training: WearWindows
    left: WearWindows
    progress: str
    settings: model.WearFitSettings
    fold: int


def fit_wear(
    windows: WearWindows,
    progress: str,
    settings: model.WearFitSettings,
    head: Model,
    lasting: Lasting,
) -> tuple[model.WearModel, model.MethodsFile]:
    """Fit every method on training windows of three tools or more, and decide who serves.

    Windows come in the order of tools and of their use; ``progress`` is the condition that is the
    tool's use, empty where there is none; ``head`` is what a model of any sub-model holds.
    """
    tools = list(dict.fromkeys(windows.tool.tolist()))
    _check_tools(windows, tools)
    several = {tool: len(set(windows.recording[windows.tool == tool].tolist())) for tool in tools}
    per_recording = max(several.values()) > 1
    tasks = _tasks(windows, tools, progress, settings)
    steps = len(tasks) * settings.training.steps(min(len(windows), settings.windows))
    done = mapped(_fold, tasks, compute=place(steps if model.RESNET in settings.methods else 0))
    told = [_Readings.of(task.left, found, per_recording) for task, (found, _) in zip(
        tasks, done, strict=True
    )]  # fmt: skip
    out = _Readings.joined(told)
    weights = _with_blend(out)
    scores = {name: _score(out, one, is_class=windows.is_class) for name, one in out.by.items()}
    champion, alone = _who_serves(out, scores, weights, is_class=windows.is_class)
    own = _fitted(windows, progress, settings)
    documents = tuple(document for _, document in done if document is not None)
    return model.WearModel(
        **vars(head), wear_unit=windows.wear_unit,
        learnt=(float(windows.wear.min()), float(windows.wear.max())), channels=windows.channels,
        units=windows.units, rate_Hz=windows.rate_Hz, length=windows.values.shape[2],
        scaling=own.scaling, known=own.known, condition_units=dict(windows.condition_units),
        progress=progress, progress_unit=windows.progress_unit, per_recording=per_recording,
        champion=champion, alone=alone, scores=scores, weights=weights, lasting=lasting,
        bands={} if windows.is_class else {
            name: bands(_residuals(out, name))
            for name in dict.fromkeys((champion, alone))
        },
    ), model.MethodsFile(
        scaling=own.feature_scaling, ridge=own.ridge,
        forest=None if own.forest is None else own.forest.document(), networks=documents,
        guess=own.guess, by_conditions=own.by_conditions, mean=own.mean,
    )  # fmt: skip


def _check_tools(windows: WearWindows, tools: list[str]) -> None:
    if len(tools) < 3:
        raise ValueError(
            f"there are {len(tools)} training tools with windows in cut, three are the least: one "
            "to leave out, one to learn from and one to stop by; name more in roles.training"
        )
    if windows.is_class and len(np.unique(windows.wear)) < 2:
        raise ValueError(
            "all training tools are of one class: name worn ones and others in roles.training"
        )


def _tasks(
    windows: WearWindows, tools: list[str], progress: str, settings: model.WearFitSettings
) -> list[_Task]:
    tasks = []
    # two tools have to be left, one to learn from and one to stop by
    folds = settings.folds if len(tools) > 3 else len(tools)
    for fold, (_, left) in enumerate(splits(_balanced(windows, tools), folds)):
        kept = np.isin(windows.tool, left)
        tasks.append(
            _Task(
                training=windows.of(~kept), left=windows.of(kept), progress=progress,
                settings=settings, fold=fold,
            )
        )  # fmt: skip
    return tasks


def _who_serves(
    out: "_Readings", scores: Mapping[str, model.MethodScore], weights: Mapping[str, float], *,
    is_class: bool,
) -> tuple[str, str]:  # fmt: skip
    """Champion, and the method that would serve without the baseline."""
    methods = [name for name in model.METHODS if name in scores]
    best = min(methods, key=lambda name: scores[name].rmse)
    # the best of several is chosen after the fact: each has its share of the level (Bonferroni)
    surely = gains(
        _squares(out, out.by[model.MEDIAN]), _squares(out, out.by[best]), LEVEL / len(methods)
    )
    alone = best if surely else model.MEDIAN
    if is_class:
        first = max(methods, key=lambda name: scores[name].auc or 0.0)
        than = (out.by[alone], np.zeros(len(out.wear)))  # the median, and a coin
        alone = first if all(_orders_better(out, out.by[first], one) for one in than) else alone
    # the guess alone never serves
    shared = weights.get(model.GUESS, 0.0) > 0 and weights.get(model.MEDIAN, 0.0) >= LEAST_SHARE
    worse = _orders_better if is_class else _errs_less
    return (
        model.BLEND if shared and not worse(out, out.by[alone], out.by[model.BLEND]) else alone
    ), alone


def _errs_less(out: "_Readings", one: Floats, other: Floats) -> bool:
    """Whether a method's squared error is less by more than the standard error over the tools."""
    gain = _squares(out, other) - _squares(out, one)
    return bool(gain.mean() > gain.std(ddof=1) / np.sqrt(len(gain)))


def _orders_better(out: "_Readings", one: Floats, other: Floats) -> bool:
    """Whether a method tells worn tools from others better by more than a standard error."""
    gain = (auc(one, out.wear) or 0.0) - (auc(other, out.wear) or 0.0)
    rows = [np.flatnonzero(out.tool == tool) for tool in np.unique(out.tool)]
    random, found = np.random.default_rng(0), []
    for drawn in random.integers(0, len(rows), (RESAMPLED, len(rows))):
        chosen = np.concatenate([rows[k] for k in drawn])
        pair = [auc(told[chosen], out.wear[chosen]) for told in (one, other)]
        if pair[0] is not None and pair[1] is not None:  # a draw of one class tells nothing
            found.append(pair[0] - pair[1])
    return gain > 0 and gain > float(np.std(found or [0.0]))


def _balanced(windows: WearWindows, tools: list[str]) -> list[str]:
    """Tools in an order whose neighbours differ in wear, so that folds hold either class."""
    if not windows.is_class:
        return tools
    mean = {tool: float(windows.wear[windows.tool == tool].mean()) for tool in tools}
    worn, unworn = ([t for t in tools if (mean[t] > 0.5) is is_worn] for is_worn in (True, False))
    placed = [
        ((k + 0.5) / len(part), tool) for part in (worn, unworn) for k, tool in enumerate(part)
    ]
    return [tool for _, tool in sorted(placed)]


def _fold(task: _Task) -> tuple[dict[str, Floats], dict[str, object] | None]:
    """Predictions of the tools left out by every method, and the network's document."""
    fitted = _fitted(task.training, task.progress, task.settings)
    document = None
    if model.RESNET in task.settings.methods:
        from pipeline.nets.wear import train_judge

        part = task.training.of(_spread(task.training, task.settings.windows))
        budget = task.settings.training
        judge = train_judge(
            part.values, part.wear, part.tool,
            scaling=(fitted.scaling.shift, fitted.scaling.scale), wear_unit=part.wear_unit,
            conditions=fitted.known.columns(part), network=task.settings.network,
            training=replace(budget, seed=budget.seed + task.fold),
        )  # fmt: skip
        fitted = replace(fitted, networks=(judge,))
        document = judge.document()
    return fitted.predict(task.left), document


def _fitted(windows: WearWindows, progress: str, settings: model.WearFitSettings) -> model.Fitted:
    """Every method but the network, on windows of training tools."""
    scaling, known = ChannelScaling.of(windows.values), KnownConditions.of(windows, progress)
    x = features(windows, scaling, known)
    of_features = FeatureScaling.of(x)
    x, tool = of_features.scaled(x), windows.tool
    matrix = known.matrix(windows)
    use = np.asarray(windows.progress, float)
    timed = not windows.is_class and bool(np.isfinite(use).all())
    means = [float(windows.wear[tool == one].mean()) for one in np.unique(tool)]
    chosen = settings.methods
    return model.Fitted(
        scaling=scaling, known=known, feature_scaling=of_features,
        ridge=fit_ridge(x, windows.wear, tool) if model.RIDGE in chosen else None,
        forest=fit_forest(x, windows.wear, tool, settings.forest, settings.seed)
        if model.FOREST in chosen else None,
        networks=(),
        guess=fit_curve(use, windows.wear, tool) if timed else None,
        by_conditions=fit_ridge(matrix, windows.wear, tool)
        if windows.is_class and matrix.shape[1] else None,
        mean=float(np.mean(means)), is_class=windows.is_class,
    )  # fmt: skip


def _spread(windows: WearWindows, most: int) -> Bools:
    """Flags of at most so many windows, evenly spread over each tool; shape (N,)."""
    if len(windows) <= most:
        return np.ones(len(windows), bool)
    every = np.zeros(len(windows), bool)
    tools, count = np.unique(windows.tool, return_counts=True)
    for tool, many in zip(tools, count, strict=True):
        wanted = max(round(most * many / len(windows)), 1)
        rows = np.flatnonzero(windows.tool == tool)
        every[rows[np.linspace(0, many - 1, wanted).round().astype(int)]] = True
    return every


# ---- tools left out


@dataclass(frozen=True, kw_only=True, eq=False)
class _Readings:
    """Readings of held-out tools: measured and predicted wear by every method, (K,) each."""

    by: dict[str, Floats]
    wear: Floats
    tool: np.ndarray
    use: Floats

    @staticmethod
    def of(windows: WearWindows, found: Mapping[str, Floats], per_recording: bool) -> "_Readings":
        readings = model.Readings.among(windows, per_recording=per_recording)
        known = windows.measured[readings.first]
        return _Readings(
            by={name: readings.mean(one)[known] for name, one in found.items()},
            wear=readings.mean(windows.wear)[known], tool=windows.tool[readings.first][known],
            use=np.asarray(windows.progress, float)[readings.first][known],
        )  # fmt: skip

    @staticmethod
    def joined(parts: "list[_Readings]") -> "_Readings":
        return _Readings(
            by={
                name: np.concatenate([one.by[name] for one in parts])
                for name in parts[0].by
                if all(name in one.by for one in parts)
            },
            wear=np.concatenate([one.wear for one in parts]),
            tool=np.concatenate([one.tool for one in parts]),
            use=np.concatenate([one.use for one in parts]),
        )


def _with_blend(out: _Readings) -> dict[str, float]:
    """Add median and blend, each tool's by weights of the others; weights of all tools."""
    out.by[model.MEDIAN] = model.median(out.by)
    names = (model.MEDIAN, model.GUESS)
    if model.GUESS not in out.by:
        return {}
    told = np.stack([out.by[name] for name in names], axis=1)
    blend = np.empty(len(out.wear))
    for tool in np.unique(out.tool):
        own = out.tool == tool
        weights = blend_weights(told[~own], out.wear[~own], out.tool[~own])
        blend[own] = told[own] @ weights
    out.by[model.BLEND] = blend
    found = blend_weights(told, out.wear, out.tool)
    return {name: float(weight) for name, weight in zip(names, found, strict=True)}


def _squares(out: _Readings, told: Floats) -> Floats:
    """Mean squared error of each tool, in the order of their names."""
    error = told - out.wear
    return np.array([np.mean(error[out.tool == tool] ** 2) for tool in np.unique(out.tool)])


def _score(out: _Readings, told: Floats, *, is_class: bool) -> model.MethodScore:
    error = told - out.wear
    squares = _squares(out, told)
    sizes = [float(np.mean(np.abs(error[out.tool == tool]))) for tool in np.unique(out.tool)]
    return model.MethodScore(
        rmse=float(np.sqrt(squares.mean())), mae=float(np.mean(sizes)),
        worst=float(np.sqrt(squares.max())),
        balanced_accuracy=balanced_accuracy(told, out.wear) if is_class else None,
        auc=auc(told, out.wear) if is_class else None,
    )  # fmt: skip


def balanced_accuracy(probability: Floats, truth: Floats) -> float | None:
    """Mean share of either class that is classified right at 0.5 [1]; None with one class only.

    Examples
    --------
    >>> balanced_accuracy(np.array([0.9, 0.2, 0.6]), np.array([1.0, 1.0, 0.0]))
    0.25
    """
    right = (probability > 0.5) == (truth > 0.5)
    shares = [right[truth > 0.5], right[truth <= 0.5]]
    if not all(len(one) for one in shares):
        return None
    return float(np.mean([one.mean() for one in shares]))


def _residuals(out: _Readings, name: str) -> Residuals:
    return Residuals(
        error=out.wear - out.by[name], regime=np.full(len(out.wear), ""), group=out.tool, t=out.use
    )
