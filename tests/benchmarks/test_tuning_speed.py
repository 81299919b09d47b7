"""Minutes that the tuning of Feed2025 takes: 8 x 20 candidates, 100 epochs, 1500 windows."""

from time import perf_counter

import numpy as np
import pytest

from pipeline.nets.settings import (
    CnnLstmAttentionSettings,
    TuningSettings,
    WindowTraining,
)
from pipeline.nets.tuning import tune
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of

PUBLISHED = 20
"""Generations."""


def lagged() -> Windows:
    """Ten recordings of four smooth signals; the target follows three of them late, with noise."""
    rng = np.random.default_rng(0)
    recordings = []
    for k in range(10):
        signals = {
            name: np.convolve(rng.normal(size=197 + 8), np.ones(9) / 3.0, "valid")
            for name in "abcd"
        }
        a, b, c = (np.roll(signals[name], late) for name, late in (("a", 4), ("b", 9), ("c", 20)))
        y = np.tanh(2.0 * a) + 0.5 * b * c + rng.normal(0.0, 0.1, len(a))
        recordings.append(Recording(name=f"r{k}", step_s=0.01, signals={**signals, "y": y}))
    return windows_of(recordings, [WindowInput(name=name) for name in "abcd"], "y", 48, np.inf)


@pytest.mark.parametrize("generations", [2, PUBLISHED])
@pytest.mark.parametrize("method", ["genetic", "whale"])
def test_published_search(benchmark, method: str, generations: int) -> None:
    """By the clock; two generations are a tenth of it, and nothing is pruned in the first."""
    data = lagged()
    assert data.x.shape == (1500, 48, 4)
    settings = TuningSettings(
        method=method, population=8, generations=generations, epochs=100, windows=1500
    )
    started = perf_counter()
    found = benchmark.pedantic(
        lambda: tune(
            CnnLstmAttentionSettings(), data, WindowTraining(precision="bfloat16"), settings
        ),
        rounds=1, warmup_rounds=0,
    )  # fmt: skip
    seconds = perf_counter() - started
    epochs = sum(one.epochs for one in found.candidates)
    benchmark.extra_info.update(
        epochs=epochs, share_of_epochs=epochs / (8 * generations * 100),
        pruned=sum(one.pruned for one in found.candidates),
        us_a_window_and_epoch_by_the_clock=1e6 * seconds / (1500 * epochs),
        bounds_hit=found.bounds_hit,
    )  # fmt: skip
    assert found.evaluations == 8 * generations
    if generations == PUBLISHED:
        assert seconds < 600.0  # on two cores of their own
