"""The forest: judged by days that it did not see, used only when it helps there."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.ensemble import RandomForestRegressor

from pipeline.schema.forest import Trees
from pipeline.submodels.cases import Case
from pipeline.submodels.spindle.calibration import (
    Examples,
    ForestSettings,
    Recipe,
    days_left_out,
    examples,
    fitted_forest,
    forest_of,
)
from pipeline.submodels.spindle.days import IntervalSettings
from pipeline.submodels.spindle.fit import SpindleFitSettings
from pipeline.twin.spindle import (
    NODES,
    TARGET,
    Forest,
    SpindleRecords,
    feature_names,
    load_forest,
    save_forest,
    spindle_stretches,
)
from tests.submodels.spindle.spindle_days import ONE, RECORDS, days_of, state_table

QUICK = ForestSettings(trees=8, depth=6, leaf=5, every_s=1800.0, sample_s=300.0)
ABOUT = Forest(
    used=True, why="", sources=tuple(RECORDS.sources), extra=(), days=(), examples=300,
    rmse_days_left_out_K=None, rmse_without_K=None,
)  # fmt: skip

Change = Callable[[int, pd.DataFrame, np.random.Generator], pd.DataFrame]


def judged(
    days: int, change: Change, records: SpindleRecords = RECORDS, forest: ForestSettings = QUICK
) -> tuple[Forest, Trees, Examples]:
    """What days left out say of a forest, and the forest of all days with its examples."""
    rng, cases = np.random.default_rng(0), []
    for number in range(days):
        name = f"2026-01-{5 + number:02d}"
        table = change(number, state_table(ONE, number, name), rng)
        cases.append(Case(name=name, group=name, role="training", files=(), load=lambda t=table: t))
    pieces = [
        piece
        for one in cases
        for piece in spindle_stretches(
            one.load(), one.name, records, step=60.0, bridge_s=600.0, shortest_s=3600.0
        )
    ]
    recipe = Recipe(
        records=records, network=SpindleFitSettings(step_s=60.0, compute="serial"), forest=forest,
        whole=ONE,
    )  # fmt: skip
    found = days_left_out(cases, pieces, recipe, IntervalSettings(folds=4))
    data = examples(pieces, records, ONE, forest)
    about = forest_of(found, [one.name for one in cases], data, records)
    return about, fitted_forest(data, forest), data


def with_extra(name: str) -> SpindleRecords:
    return replace(RECORDS, extra=(name,))


def test_a_forest_helps_where_a_signal_explains_what_is_left():
    """Coolant, unknown to the network, takes 3 K: the forest sees it and finds it on other days."""

    def cooled(number: int, table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
        on = np.repeat(rng.integers(0, 2, len(table) // 3600 + 1), 3600)[: len(table)]
        measured = table[TARGET] - 3.0 * on + rng.normal(0, 0.1, len(on))
        return table.assign(coolant=on.astype(float), **{TARGET: measured})

    about, _, _ = judged(6, cooled, with_extra("coolant"))
    assert about.used is True
    assert about.rmse_days_left_out_K < 0.8 * about.rmse_without_K
    assert about.days == tuple(f"2026-01-{5 + number:02d}" for number in range(6))


def test_a_signal_that_only_tells_the_day_does_not_help():
    """Every day is off by its own amount and ``batch`` says which day it is.

    Were days shared between training and judging, the forest would look the offset up.
    """
    offsets = [2.0, -2.0, 1.5, -1.5, 2.5, -2.5, 1.0, -1.0]

    def drifting(number: int, table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
        drift = offsets[number] * (1 - np.exp(-np.arange(len(table)) / 900.0))
        return table.assign(batch=float(7 * number % 8), **{TARGET: table[TARGET] + drift})

    # windows from the beginning only: there the network is off by the day's own drift
    settings = replace(QUICK, every_s=1e6, sample_s=60.0)
    about, forest, data = judged(8, drifting, with_extra("batch"), settings)
    assert about.used is False
    assert "does not lower" in str(about.why)
    # the leak is real: on the days it was trained on the forest takes most of the error away
    left = data.error - forest.predict(data.x)
    assert np.mean(left**2) < 0.3 * np.mean(data.error**2)


def noise(number: int, table: pd.DataFrame, rng: np.random.Generator) -> pd.DataFrame:
    return table.assign(**{TARGET: table[TARGET] + rng.normal(0, 0.5, len(table))})


def test_noise_is_not_worth_a_forest():
    assert judged(5, noise)[0].used is False


def test_one_day_says_nothing_of_another():
    about, _, _ = judged(1, noise)
    assert about.used is False
    assert "only 1 day" in str(about.why)
    assert about.rmse_days_left_out_K is None


def test_examples_are_measured_minus_network_from_each_windows_start():
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


def test_an_unknown_signal_stays_unknown_in_the_examples():
    piece = days_of(ONE, 6, 1)[0]
    flow = np.ones(len(piece.frame))
    flow[100:150] = np.nan
    piece = replace(piece, frame=piece.frame.assign(flow=flow))
    data = examples([piece], with_extra("flow"), ONE, QUICK)
    unknown = np.isnan(data.x[:, -3:])
    assert unknown.any()
    assert not unknown.all()
    assert np.isfinite(data.x[:, :-3]).all()
    assert np.isfinite(fitted_forest(data, QUICK).predict(data.x)).all()


def test_no_window_is_an_error_with_its_remedy():
    piece = days_of(ONE, 7, 1)[0]
    blind = replace(piece, frame=piece.frame.assign(**{TARGET: np.nan}))
    with pytest.raises(ValueError, match="record a working day"):
        examples([blind], RECORDS, ONE, QUICK)
    with pytest.raises(ValueError, match="record a working day"):
        # two steps are less than the first sample of a window
        examples([replace(piece, frame=piece.frame.iloc[:2])], RECORDS, ONE, QUICK)


def test_the_trees_predict_as_scikit_learn_does_unknown_features_as_well():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(400, 5))
    x[rng.random(x.shape) < 0.1] = np.nan
    y = np.nan_to_num(x[:, 0]) + rng.normal(size=400)
    made = RandomForestRegressor(n_estimators=7, max_depth=6, random_state=0).fit(x, y)
    other = rng.normal(size=(300, 5))
    other[rng.random(other.shape) < 0.3] = np.nan
    trees = Trees.of(made)
    np.testing.assert_allclose(trees.predict(other), made.predict(other), rtol=1e-12)
    each = [tree.predict(other) for tree in made.estimators_]
    np.testing.assert_array_equal(trees.by_tree(other), each)
    again = Trees.restored(trees.document())
    np.testing.assert_array_equal(again.predict(other), trees.predict(other))


def test_forests_drawn_scatter_as_those_of_other_seeds():
    data = noisy()
    settings = replace(QUICK, trees=40)
    drawn = fitted_forest(data, settings).drawn(data.x, 40)
    seeds = np.array(
        [fitted_forest(data, replace(settings, seed=seed)).predict(data.x) for seed in range(1, 13)]
    )
    np.testing.assert_allclose(drawn[0], fitted_forest(data, settings).predict(data.x))
    # of 12 seeds and 40 draws the ratio of mean deviations is known to some 10 %
    ratio = drawn[1:].std(axis=0, ddof=1).mean() / seeds.std(axis=0, ddof=1).mean()
    assert 0.75 < ratio < 1.35


def noisy() -> Examples:
    """Examples, the same in every process."""
    rng = np.random.default_rng(8)
    x = rng.normal(size=(300, len(feature_names(RECORDS.sources, ()))))
    return Examples(x=x, error=x[:, 0] + rng.normal(size=300))


SAVE = """
import sys
from pathlib import Path
from pipeline.submodels.spindle.calibration import fitted_forest
from pipeline.twin.spindle import save_forest
from tests.submodels.spindle.test_residual import QUICK, noisy
save_forest(fitted_forest(noisy(), QUICK), Path(sys.argv[1]))
"""


@pytest.mark.proof
def test_two_processes_write_the_same_bytes(tmp_path):
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
    assert set(hashes[0]) == {NODES}


def test_a_stored_forest_is_the_one_that_was_trained(tmp_path):
    data = noisy()
    forest = fitted_forest(data, QUICK)
    save_forest(forest, tmp_path)
    loaded = load_forest(tmp_path, ABOUT)
    assert loaded is not None
    assert (loaded.sources, loaded.extra) == (ABOUT.sources, ABOUT.extra)
    np.testing.assert_array_equal(loaded.forest.predict(data.x), forest.predict(data.x))


def test_a_forest_that_does_not_help_is_not_loaded(tmp_path):
    assert load_forest(tmp_path, replace(ABOUT, used=False)) is None


def test_a_forest_that_cannot_be_read_or_has_other_time_constants_is_refused(tmp_path):
    save_forest(fitted_forest(noisy(), QUICK), tmp_path)
    with pytest.raises(ValueError, match=r"means over \[60.0\] s.*train it again"):
        load_forest(tmp_path, replace(ABOUT, smoothing_s=(60.0,)))
    (tmp_path / NODES).write_text("{}")
    with pytest.raises(ValueError, match="the document of a forest has no roots"):
        load_forest(tmp_path, ABOUT)
    (tmp_path / NODES).write_bytes(b"no document")
    with pytest.raises(ValueError, match=r"forest\.json .*run `dvc repro`"):
        load_forest(tmp_path, ABOUT)
