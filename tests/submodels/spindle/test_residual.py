"""The forest: judged by days that it did not see, used only when it helps there."""

import os
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.submodels.spindle.residual import (
    Examples,
    ForestSettings,
    examples,
    train_residual_forest,
)
from pipeline.twin.residual import feature_names, load_forest, save_forest
from pipeline.twin.spindle import TARGET, SpindleRecords
from tests.submodels.spindle.spindle_days import ONE, RECORDS, days_of

QUICK = ForestSettings(trees=8, depth=6, leaf=5, folds=4, every_s=1800.0, sample_s=300.0)


def with_extra(name: str) -> SpindleRecords:
    return replace(RECORDS, extra=(name,))


def test_a_forest_helps_where_a_signal_explains_what_is_left() -> None:
    """Coolant, unknown to the network, takes 3 K: the forest sees it and finds it on other days."""
    rng = np.random.default_rng(0)
    days = []
    for piece in days_of(ONE, 1, 6):
        on = np.repeat(rng.integers(0, 2, len(piece.frame) // 60 + 1), 60)[: len(piece.frame)]
        frame = piece.frame.assign(coolant=on.astype(float))
        frame[TARGET] = frame[TARGET] - 3.0 * on + rng.normal(0, 0.1, len(on))
        days.append(replace(piece, frame=frame))
    data = examples(days, with_extra("coolant"), ONE, QUICK)
    _, about = train_residual_forest(data, with_extra("coolant"), QUICK)
    assert about.used is True
    assert about.rmse_days_left_out_K < 0.8 * about.rmse_without_K
    assert about.days == tuple(p.day for p in days)


def test_a_signal_that_only_tells_the_day_does_not_help() -> None:
    """Every day is off by its own amount and ``batch`` says which day it is.

    Were days shared between training and judging, the forest would look the offset up.
    """
    offsets = [2.0, -2.0, 1.5, -1.5, 2.5, -2.5, 1.0, -1.0]
    days = []
    for number, (piece, offset) in enumerate(zip(days_of(ONE, 2, 8), offsets, strict=True)):
        drift = offset * (1 - np.exp(-np.arange(len(piece.frame)) * piece.step / 900.0))
        frame = piece.frame.assign(batch=float(7 * number % 8))
        frame[TARGET] = frame[TARGET] + drift
        days.append(replace(piece, frame=frame))
    # windows from the beginning only: there the network is off by the day's own drift
    settings = replace(QUICK, every_s=1e6, sample_s=60.0)
    data = examples(days, with_extra("batch"), ONE, settings)
    forest, about = train_residual_forest(data, with_extra("batch"), settings)
    assert about.used is False
    assert "does not lower" in str(about.why)
    # the leak is real: on the days it was trained on the forest takes most of the error away
    left = data.error - forest.predict(data.x)
    assert np.mean(left**2) < 0.3 * np.mean(data.error**2)


def test_noise_is_not_worth_a_forest() -> None:
    days = days_of(ONE, 3, 5, noise_K=0.5)
    data = examples(days, RECORDS, ONE, QUICK)
    _, about = train_residual_forest(data, RECORDS, QUICK)
    assert about.used is False


def test_one_day_says_nothing_of_another() -> None:
    data = examples(days_of(ONE, 4, 1, noise_K=0.5), RECORDS, ONE, QUICK)
    _, about = train_residual_forest(data, RECORDS, QUICK)
    assert about.used is False
    assert "only 1 day" in str(about.why)
    assert about.rmse_days_left_out_K is None


def test_examples_are_measured_minus_network_from_each_windows_start() -> None:
    days = days_of(ONE, 5, 1)
    frame = days[0].frame.copy()
    frame.iloc[30:, frame.columns.get_loc(TARGET)] += 1.0  # a step between two windows' starts
    piece = replace(days[0], frame=frame)
    settings = replace(QUICK, every_s=1800.0, window_s=3600.0, sample_s=300.0)
    data = examples([piece], RECORDS, ONE, settings)
    names = feature_names(RECORDS.sources, ())
    horizon = data.x[:, names.index("horizon_s")]
    # first window: measured jumps by 1 K, half an hour in
    np.testing.assert_allclose(data.error[:5], 0.0, atol=1e-9)
    np.testing.assert_allclose(data.error[5:11], 1.0, atol=1e-9)
    np.testing.assert_array_equal(horizon[:11], 300.0 * np.arange(1, 12))
    # second window starts 1 K too warm for the truth, which decays with the time constant
    np.testing.assert_allclose(data.error[11:15], 1 - np.exp(-horizon[11:15] / 900), atol=1e-9)


def test_an_unknown_signal_stays_unknown_in_the_examples() -> None:
    piece = days_of(ONE, 6, 1)[0]
    flow = np.ones(len(piece.frame))
    flow[100:150] = np.nan
    piece = replace(piece, frame=piece.frame.assign(flow=flow))
    data = examples([piece], with_extra("flow"), ONE, QUICK)
    unknown = np.isnan(data.x[:, -3:])
    assert unknown.any()
    assert not unknown.all()
    assert np.isfinite(data.x[:, :-3]).all()
    forest, _ = train_residual_forest(data, with_extra("flow"), QUICK)
    assert np.isfinite(forest.predict(data.x)).all()


def test_no_window_is_an_error_with_its_remedy() -> None:
    piece = days_of(ONE, 7, 1)[0]
    blind = replace(piece, frame=piece.frame.assign(**{TARGET: np.nan}))
    with pytest.raises(ValueError, match="record a working day"):
        examples([blind], RECORDS, ONE, QUICK)
    with pytest.raises(ValueError, match="record a working day"):
        # two steps are less than the first sample of a window
        examples([replace(piece, frame=piece.frame.iloc[:2])], RECORDS, ONE, QUICK)


@pytest.mark.parametrize(
    ("name", "value"), [("trees", 0), ("folds", 1), ("sample_s", -1.0), ("window_s", 0.0)]
)
def test_settings_that_make_no_sense_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"residual_forest.{name} = {value}"):
        ForestSettings(**{name: value})  # type: ignore[arg-type]


def test_a_forest_predicts_the_same_bits_on_any_number_of_cores() -> None:
    """Threads would add the trees up in the order in which they finish."""
    data = noisy()
    forest, _ = train_residual_forest(data, RECORDS, QUICK)
    assert forest.n_jobs == 1
    by_hand = sum(tree.predict(data.x) for tree in forest.estimators_) / QUICK.trees
    np.testing.assert_array_equal(forest.predict(data.x), by_hand)


def noisy() -> Examples:
    """Examples of three days, the same in every process."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(300, len(feature_names(RECORDS.sources, ()))))
    return Examples(x=x, error=x[:, 0] + rng.normal(size=300), day=np.repeat(["a", "b", "c"], 100))


SAVE = """
import sys
from pathlib import Path
from pipeline.submodels.spindle.residual import train_residual_forest
from pipeline.twin.residual import save_forest
from tests.submodels.spindle.test_residual import QUICK, RECORDS, noisy
forest, about = train_residual_forest(noisy(), RECORDS, QUICK)
save_forest(forest, Path(sys.argv[1]))
"""


@pytest.mark.proof
def test_two_processes_write_the_same_bytes(tmp_path: Path) -> None:
    hashes = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        subprocess.run(
            [sys.executable, "-c", SAVE, str(folder)],
            check=True,
            cwd=Path(__file__).parents[3],
            env={**os.environ, "PYTHONHASHSEED": seed},
        )
        hashes.append({p.name: sha256(p.read_bytes()).hexdigest() for p in folder.iterdir()})
    assert hashes[0] == hashes[1]
    assert set(hashes[0]) == {"forest.skops"}


def test_a_stored_forest_is_the_one_that_was_trained(tmp_path: Path) -> None:
    data = noisy()
    forest, about = train_residual_forest(data, RECORDS, QUICK)
    save_forest(forest, tmp_path)
    loaded = load_forest(tmp_path, replace(about, used=True))
    assert loaded is not None
    assert (loaded.sources, loaded.extra) == (about.sources, about.extra)
    np.testing.assert_array_equal(loaded.forest.predict(data.x), forest.predict(data.x))


def test_a_forest_that_does_not_help_is_not_loaded(tmp_path: Path) -> None:
    _, about = train_residual_forest(noisy(), RECORDS, QUICK)
    assert load_forest(tmp_path, replace(about, used=False)) is None


def test_a_forest_that_cannot_be_read_or_has_other_time_constants_is_refused(
    tmp_path: Path,
) -> None:
    forest, about = train_residual_forest(noisy(), RECORDS, QUICK)
    save_forest(forest, tmp_path)
    used = replace(about, used=True)
    with pytest.raises(ValueError, match=r"means over \[60.0\] s.*train it again"):
        load_forest(tmp_path, replace(used, smoothing_s=(60.0,)))
    (tmp_path / "forest.skops").write_bytes(b"no archive")
    with pytest.raises(ValueError, match=r"forest\.skops cannot be read .*: run `dvc repro`"):
        load_forest(tmp_path, used)


def test_no_day_is_on_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every fit but the last leaves out whole days, and each day is left out once."""
    from pipeline.submodels.spindle import residual

    data = noisy()
    marked = replace(data, x=np.column_stack([data.x, pd.factorize(data.day)[0]]))
    seen: list[set[float]] = []
    plain = residual.fitted_forest

    def watched(x: np.ndarray, error: np.ndarray, settings: ForestSettings) -> object:
        seen.append(set(x[:, -1]))
        return plain(x, error, settings)

    monkeypatch.setattr(residual, "fitted_forest", watched)
    train_residual_forest(marked, RECORDS, QUICK)
    *folds, everything = seen
    assert everything == {0.0, 1.0, 2.0}
    left_out = [everything - fold for fold in folds]
    assert sorted(day for group in left_out for day in group) == [0.0, 1.0, 2.0]
