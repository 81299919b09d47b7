"""Microseconds a window and epoch that a training takes on one core: 50 units, 48 rows."""

from time import process_time

import numpy as np
import pytest

from pipeline.nets.settings import (
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    SequenceSettings,
    TcnSettings,
    WindowTraining,
)
from pipeline.nets.window_training import train_windows, usable_precision
from pipeline.nets.windows import Windows

KINDS = (CnnLstmAttentionSettings(), CnnLstmSettings(), LstmSettings(), TcnSettings())


@pytest.mark.benchmark(timer=process_time)
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_epoch(benchmark, kind: SequenceSettings, precision: str) -> None:
    """The least of ten epochs of 1500 windows with four channels."""
    if usable_precision(precision) != precision:
        pytest.skip("this processor has no bfloat16")
    rng = np.random.default_rng(0)
    x = rng.normal(size=(1500, 48, 4))
    windows = Windows(x=x, y=np.tanh(x[:, -5, 0]) + x[:, -20, 1], group=np.full(1500, "a"))
    settings = WindowTraining(epochs=10, patience=10, validation=0.0, precision=precision)
    times: list[float] = []

    def train() -> None:
        train_windows(
            kind, windows, settings=settings, watch=lambda _: times.append(process_time())
        )

    benchmark.pedantic(train, rounds=1, warmup_rounds=0)
    least = np.diff(times).min() / 1500
    benchmark.extra_info["us_a_window_and_epoch"] = 1e6 * least
    assert least < 100e-6
