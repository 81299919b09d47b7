"""Seconds that a network on nine sensors takes to be trained, and microseconds to predict."""

from time import process_time

import numpy as np
import pytest

from pipeline.nets.settings import NetworkSettings, TrainingSettings
from pipeline.nets.training import METHODS, train
from tests.nets.samples import KINDS, WAYS, warm_up

DATA = warm_up(3000, groups=12)


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize(("kind", "method"), WAYS, ids=repr)
def test_training(benchmark, kind: NetworkSettings, method: str) -> None:
    """The whole budget: nothing stops it early."""
    settings = TrainingSettings(patience=TrainingSettings().passes)
    found = benchmark.pedantic(
        lambda: train(kind, method, *DATA, settings=settings), rounds=1, warmup_rounds=0
    )
    assert found.passes > settings.passes - settings.population
    assert benchmark.stats["min"] < 30.0


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_prediction(benchmark, kind: NetworkSettings) -> None:
    many = 100_000
    x, c = (np.resize(part, (many, part.shape[1])) for part in (DATA.x, DATA.c))
    settings = TrainingSettings(passes=20)
    found = train(kind, METHODS[kind.kind][0], *DATA, settings=settings)
    benchmark(lambda: found.predict(x, c))
    assert benchmark.stats["min"] / many < 1e-6
