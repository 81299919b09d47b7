"""Searches on the tuning of a network with the published budget, Optuna's TPE beside them."""

import sys
from collections import Counter
from functools import partial

import numpy as np
import pytest

from pipeline.nets.descent import Diverged
from pipeline.nets.settings import LstmSettings, TuningSettings, WindowTraining
from pipeline.nets.window_training import train_windows
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of
from pipeline.parallel import mapped
from pipeline.search.box import Box
from pipeline.search.methods import METHODS
from tests.search.test_published import SEARCHES, Budget, ranking, table

NAMES = ("learning_rate", "units", "l2")
RANGES = TuningSettings(learning_rate=(1e-3, 1e-1), units=(2, 16))
"""As published, but few units and quick learning: a training of 60 steps takes 0.1 s."""
BOX = Box.of(
    *zip(*(getattr(RANGES, name) for name in NAMES), strict=True),
    log=[True, False, True], integer=[False, True, False],
)  # fmt: skip
BUDGET = Budget(dimensions=len(NAMES), population=8, generations=20, seeds=10)


def lagged(seed: int, recordings: int = 6, samples: int = 44) -> Windows:
    """Bent functions of two inputs, each with a delay of its own, and noise."""
    rng = np.random.default_rng(seed)
    delays = rng.integers(1, 4, 2)
    found = []
    for k in range(recordings):
        u, v = rng.uniform(-1.0, 1.0, (2, samples))
        y = np.tanh(3.0 * np.roll(u, delays[0])) + 0.5 * np.roll(v, delays[1]) ** 2
        y += rng.normal(0.0, 0.05, samples)
        found.append(Recording(name=f"r{k}", step_s=0.01, signals={"u": u, "v": v, "y": y}))
    return windows_of(found, [WindowInput(name="u"), WindowInput(name="v")], "y", 6, np.inf)


class Task:
    """Validation RMSE of a training, over the unit cube of the settings."""

    def __init__(self, seed: int) -> None:
        self.data, self.seed = lagged(seed), seed
        self.best, self.x = np.inf, np.full(len(NAMES), np.nan)

    def __call__(self, unit: np.ndarray) -> np.ndarray:
        return np.array([self._error(x) for x in BOX.place(np.array(unit))])

    def _error(self, x: np.ndarray) -> float:
        rate, units, l2 = x.tolist()
        settings = WindowTraining(
            epochs=6, patience=6, batch=16, learning_rate=rate, l2=l2, seed=self.seed
        )
        kind = LstmSettings(units=int(units))
        try:
            error = float(train_windows(kind, self.data, settings=settings).history[:, 2].min())
        except Diverged:
            return np.inf
        if error < self.best:
            self.best, self.x = error, x
        return error


def run(task: tuple[str, int], budget: Budget) -> tuple[float, dict[str, int]]:
    """Least error of a search, and the bounds that its best settings hit."""
    search, seed = task
    cost = Task(seed)
    least = SEARCHES[search](cost, np.zeros(len(NAMES)), np.ones(len(NAMES)), budget, seed)
    assert least == cost.best
    return least, dict(zip(NAMES, BOX.at_bounds(cost.x).tolist(), strict=True))


def compared(searches: list[str], budget: Budget) -> tuple[np.ndarray, dict[str, Counter[str]]]:
    """Least errors, shape (seeds, searches, 1), and how often each search hit which bounds."""
    tasks = [(search, seed) for seed in range(budget.seeds) for search in searches]
    found = mapped(partial(run, budget=budget), tasks)
    hit: dict[str, Counter[str]] = {search: Counter() for search in searches}
    for (search, _), (_, sides) in zip(tasks, found, strict=True):
        names = (f"{name} {'low' if side < 0 else 'high'}" for name, side in sides.items() if side)
        hit[search].update(names)
    errors = np.array([least for least, _ in found])
    return errors.reshape(budget.seeds, len(searches), 1), hit


@pytest.mark.proof
def test_tuning_of_a_network_by_each_search(capsys: pytest.CaptureFixture[str]) -> None:
    """Who wins, as docs/theory/search.md states it; a seed is a task that all searches share."""
    searches = [*METHODS, "TPE"]
    found, hit = compared(searches, BUDGET)
    order = ranking(found)
    rows = [f"seed {seed}" for seed in range(BUDGET.seeds)]
    with capsys.disabled():
        sys.stdout.write("\n\n8 x 20 trainings, RMSE of validation\n\n")
        sys.stdout.write(table(searches, found, order, published=False, rows_of=rows))
        for search, counts in hit.items():
            said = ", ".join(f"{name} {many} times" for name, many in counts.most_common())
            sys.stdout.write(f"\n{search}: bounds hit in {BUDGET.seeds} runs: {said or 'none'}")
        sys.stdout.write("\n")
    assert order.friedman < 0.05
    rank = dict(zip(searches, order.mean, strict=True))
    assert rank["random"] > min(rank.values()) + 0.5
