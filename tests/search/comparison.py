"""Searches on F1 to F13 with the same budget: costs of many seeds, ranks, significance, a table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy import stats

from pipeline.search import methods
from pipeline.search.result import minimise
from tests.search.published import FUNCTIONS, Cost, Published

Search = Callable[..., float]
"""Least cost, from cost, bounds, population, generations and seed."""


@dataclass(frozen=True)
class Budget:
    """What each run may use."""

    dimensions: int
    population: int
    generations: int
    seeds: int


def by_name(name: str, cost: Cost, low, high, budget: Budget, seed: int) -> float:
    found = methods.minimise(
        name, cost, low, high, population=budget.population, generations=budget.generations,
        seed=seed,
    )  # fmt: skip
    return found.cost


def whale_by_axis(cost: Cost, low, high, budget: Budget, seed: int) -> float:
    some = methods.WhaleSettings(
        population=budget.population, generations=budget.generations, seed=seed, by_axis=True
    )
    return minimise(cost, low, high, some).cost


def tpe(cost: Cost, low, high, budget: Budget, seed: int) -> float:
    """Optuna's tree-structured Parzen estimator (Bergstra et al. 2011), one trial after another."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=seed))
    axes = {
        f"x{k}": optuna.distributions.FloatDistribution(a, b)
        for k, (a, b) in enumerate(zip(low, high, strict=True))
    }
    for _ in range(budget.population * budget.generations):
        trial = study.ask(axes)
        study.tell(trial, float(cost(np.array([[trial.params[name] for name in axes]]))[0]))
    return study.best_value


SEARCHES: dict[str, Search] = {
    **{name: partial(by_name, name) for name in methods.METHODS},
    "whale by axis": whale_by_axis,
    "TPE": tpe,
}


def costs(
    searches: list[str], budget: Budget, *, moved: bool, functions: dict[str, Published] = FUNCTIONS
) -> np.ndarray:
    """Least cost of each run, shape (functions, searches, seeds)."""
    return np.array(
        [
            [
                [
                    SEARCHES[name](
                        one.cost(seed, moved=moved, dimensions=budget.dimensions),
                        *one.bounds(budget.dimensions), budget, seed,
                    )
                    for seed in range(budget.seeds)
                ]
                for name in searches
            ]
            for one in functions.values()
        ]
    )  # fmt: skip


@dataclass(frozen=True)
class Ranking:
    """Mean ranks (1 is best) on each function, over all, and how sure their order is."""

    each: np.ndarray  # (functions, searches)
    mean: np.ndarray  # (searches,)
    friedman: float
    against_best: np.ndarray  # (searches,), Wilcoxon's p after Holm, NaN for the best

    @property
    def best(self) -> int:
        return int(self.mean.argmin())


def ranking(found: np.ndarray) -> Ranking:
    """Of costs of shape (functions, searches, seeds); runs of one seed are ranked together.

    Friedman's test over functions, then Wilcoxon's signed ranks of the best against each other
    one, corrected after Holm.
    """
    each = stats.rankdata(found, axis=1).mean(axis=2)
    mean = each.mean(axis=0)
    best = int(mean.argmin())
    others = [k for k in range(len(mean)) if k != best]
    p = np.array([stats.wilcoxon(each[:, best], each[:, k]).pvalue for k in others])
    against = np.full(len(mean), np.nan)
    against[others] = holm(p)
    return Ranking(each, mean, float(stats.friedmanchisquare(*each.T).pvalue), against)


def holm(p: np.ndarray) -> np.ndarray:
    """p values of several tests, such that none below alpha is by chance with more than alpha."""
    order = p.argsort()
    stepped = np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1))
    adjusted = np.empty_like(p)
    adjusted[order] = np.minimum(stepped, 1.0)
    return adjusted


def table(
    searches: list[str], found: np.ndarray, order: Ranking, *, published: bool,
    rows_of: Iterable[str] = FUNCTIONS,
) -> str:  # fmt: skip
    """Mean costs, mean ranks and p values as Markdown; published means only of functions."""
    head = ["", *searches, *(("published: whale", "swarm", "wolf") if published else ())]
    rows = [
        [name, *(f"{mean:.3g}" for mean in means), *(_published(name) if published else ())]
        for name, means in zip(rows_of, found.mean(axis=2), strict=True)
    ]
    blank = [""] * (3 * published)
    rows.append(["mean rank", *(f"{rank:.2f}" for rank in order.mean), *blank])
    against = ["best" if np.isnan(p) else f"{p:.2g}" for p in order.against_best]
    rows.append(["p against the best", *against, *blank])
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + (
        f"\n\nFriedman: p = {order.friedman:.2g}"
    )


def _published(name: str) -> list[str]:
    one = FUNCTIONS[name]
    return [f"{mean:.3g}" for mean in (one.whale, one.swarm, one.wolf)]
