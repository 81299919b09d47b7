"""The features of the forest: from the past, of known signals only."""

import numpy as np
import pandas as pd
import pytest

from pipeline.twin.spindle import SMOOTHING_S, feature_names, features, smoothed_inputs


def test_a_missing_feature_is_refused_by_its_name() -> None:
    frame = pd.DataFrame({"copper": [0.0, 1.0]})
    with pytest.raises(ValueError, match="the forest needs coolant_flow, which the records do not"):
        smoothed_inputs(frame, 10.0, ["copper", "coolant_flow"])


def test_the_mean_is_the_exponential_one_of_what_was_known() -> None:
    values, step = np.array([3.0, 0.0, 1.0, 5.0]), 60.0
    found = smoothed_inputs(pd.DataFrame({"a": values}), step, ["a"])
    for tau in SMOOTHING_S:
        for t in range(4):
            weight = np.exp(-step / tau) ** np.arange(t, -1, -1)
            by_hand = (weight * values[: t + 1]).sum() / weight.sum()
            assert found[f"a_over_{tau:g}_s"].iloc[t] == pytest.approx(by_hand, rel=1e-12)


def test_the_future_changes_nothing() -> None:
    values = np.random.default_rng(0).normal(size=50)
    changed = np.concatenate([values[:30], np.full(20, 1e6)])
    first = smoothed_inputs(pd.DataFrame({"a": values}), 10.0, ["a"])[:30]
    second = smoothed_inputs(pd.DataFrame({"a": changed}), 10.0, ["a"])[:30]
    pd.testing.assert_frame_equal(first, second)


def test_unknown_stays_unknown() -> None:
    """Not zero, and not what it was before either."""
    values = np.array([np.nan, 2.0, np.nan, np.nan, 4.0])
    found = smoothed_inputs(pd.DataFrame({"a": values}), 10.0, ["a"])
    for name in found:
        np.testing.assert_array_equal(found[name].isna(), np.isnan(values))
        assert 2.0 < found[name].iloc[4] < 4.0


def test_columns_stand_in_the_order_of_their_names() -> None:
    frame = pd.DataFrame({"b": [1.0, 1.0], "a": [2.0, 2.0]})
    inputs = smoothed_inputs(frame, 10.0, ["a", "b"])
    x = features(inputs, np.array([30.0, 31.0]), 25.0, np.array([0.0, 10.0]), ["b"], ["a"])
    names = feature_names(["b"], ["a"])
    assert x.shape == (2, len(names))
    row = dict(zip(names, x[1], strict=True))
    assert (row["physics"], row["start_temperature"], row["horizon_s"]) == (31.0, 25.0, 10.0)
    assert {row[f"b_over_{tau:g}_s"] for tau in SMOOTHING_S} == {1.0}
    assert {row[f"a_over_{tau:g}_s"] for tau in SMOOTHING_S} == {2.0}
