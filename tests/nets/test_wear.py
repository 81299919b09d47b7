"""Judge of wear: what it learns from windows, its document, and what it refuses."""

import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.nets.settings import ResNetSettings, WindowTraining
from pipeline.nets.wear import WearJudge, restore_judge, train_judge
from pipeline.schema.arrays import Floats

NETWORK = ResNetSettings(filters=4, kernel=5, blocks=2)
TRAINING = WindowTraining(epochs=30, patience=30, batch=16, learning_rate=0.01, validation=0.25)
SCALING = ((10.0, 0.0), (4.0, 1.0))


class Worn(NamedTuple):
    values: NDArray[np.float32]
    wear: Floats
    tool: NDArray[np.str_]
    feed: Floats


def worn(many: int = 96, seed: int = 0) -> Worn:
    """The force's amplitude grows with wear and with the feed, which is known."""
    random = np.random.default_rng(seed)
    wear, feed = random.uniform(0, 200, many), random.choice([100.0, 300.0], many)
    t = np.arange(64)
    phase = random.uniform(0, 6.28, many)
    wave = np.sin(0.4 * t[None] + phase[:, None]) * (1 + wear / 50 + feed / 100)[:, None]
    noise = random.standard_normal((many, 2, 64))
    values = np.stack([10.0 + wave, np.zeros_like(wave)], axis=1) + 0.2 * noise
    return Worn(values.astype(np.float32), wear, np.array([f"T{k % 8}" for k in range(many)]), feed)


def judge_of(data: Worn, **changes) -> WearJudge:  # type: ignore[no-untyped-def]
    given = {
        "scaling": SCALING, "wear_unit": "um", "conditions": {"feed": data.feed},
        "network": NETWORK, "training": TRAINING, **changes,
    }  # fmt: skip
    return train_judge(data.values, data.wear, data.tool, **given)


@pytest.fixture(scope="module")
def judge() -> WearJudge:
    return judge_of(worn())


def test_it_judges_windows_that_it_has_not_seen(judge: WearJudge) -> None:
    """The feed doubles to triples the amplitude: without it the error is greater."""
    other = worn(seed=1)
    error = judge.predict(other.values, {"feed": other.feed}) - other.wear
    assert np.sqrt(np.mean(error**2)) < 20.0  # of 58 um that the wear scatters
    blind = judge_of(worn(), conditions={}).predict(other.values) - other.wear
    assert np.mean(error**2) < 0.7 * np.mean(blind**2)


def test_it_cannot_learn_swapped_labels() -> None:
    data = worn()
    swapped = data._replace(wear=np.random.default_rng(2).permutation(data.wear))
    other = worn(seed=1)
    error = judge_of(swapped).predict(other.values, {"feed": other.feed}) - other.wear
    assert np.sqrt(np.mean(error**2)) > 40.0


def test_the_same_training_gives_the_same_bits(judge: WearJudge) -> None:
    again, other = judge_of(worn()), worn(seed=1)
    assert np.array_equal(
        again.predict(other.values, {"feed": other.feed}),
        judge.predict(other.values, {"feed": other.feed}),
    )


def test_a_document_restores_it_to_the_same_bits(judge: WearJudge) -> None:
    restored = restore_judge(json.loads(json.dumps(judge.document())))
    data = worn(seed=1)
    assert np.array_equal(
        restored.predict(data.values, {"feed": 200.0}), judge.predict(data.values, {"feed": 200.0})
    )
    with pytest.raises(ValueError, match="wear_unit"):
        restore_judge({k: v for k, v in judge.document().items() if k != "wear_unit"})


def test_whole_tools_are_kept_for_early_stopping(judge: WearJudge) -> None:
    assert len(judge.trained.validation_groups) == 2  # a quarter of eight
    assert set(judge.trained.validation_groups) < set(worn().tool)


def test_a_class_is_a_share_from_0_to_1() -> None:
    data = worn()
    classes = data._replace(wear=(data.wear > 100).astype(float))
    found = judge_of(classes, wear_unit="1")
    other = worn(seed=1)
    share = found.predict(other.values, {"feed": other.feed})
    assert share.min() >= 0.0 and share.max() <= 1.0
    assert np.mean((share > 0.5) == (other.wear > 100)) > 0.85


def test_a_glitch_is_bounded(judge: WearJudge) -> None:
    data = worn(seed=1)
    wild = data.values.copy()
    wild[0, 1, 5] = 1e12
    found = judge.predict(wild, {"feed": data.feed})
    assert np.isfinite(found).all() and abs(found[0]) < 1e4


def test_what_does_not_fit_is_refused(judge: WearJudge) -> None:
    data = worn(many=3)
    with pytest.raises(ValueError, match=r"\(N, 2, L\)"):
        judge.predict(data.values[:, :1], {"feed": data.feed})
    with pytest.raises(ValueError, match="'feed' of the windows is missing"):
        judge.predict(data.values)
    with pytest.raises(ValueError, match="64 rows"):
        judge.predict(data.values[..., :50], {"feed": data.feed})
    with pytest.raises(ValueError, match="not finite"):
        judge.predict(np.where(data.values > 10, np.nan, data.values), {"feed": data.feed})
    with pytest.raises(ValueError, match="one recording"):
        judge_of(data._replace(tool=np.array(["T0"] * 3)))
    with pytest.raises(ValueError, match="kernel = 4 is even"):
        replace(NETWORK, kernel=4)
