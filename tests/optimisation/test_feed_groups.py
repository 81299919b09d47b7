"""Groups of blocks that share an F: what merging loses, and what it keeps to."""

from time import process_time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.optimisation.methods.feed_groups import Curves, merged

FEEDS = np.geomspace(50, 2000, 49)


def time_curves(length, low, high, own=None):
    """Blocks that take length / F [s], F in mm/s here: linear in 1/F as the table holds it."""
    length, low, high = (np.asarray(values, float) for values in (length, low, high))
    table = length[:, None] / FEEDS
    kept = np.full(len(length), np.nan) if own is None else np.asarray(own, float)
    return Curves(feeds=FEEDS, values=table, times=table, low=low, high=high, own=kept)


def taken(group, length, low, high):
    """Time with groups at the greatest F that suits all their blocks [s]."""
    feeds = np.array([high[group == g].min() for g in range(group.max() + 1)])
    lows = np.array([low[group == g].max() for g in range(group.max() + 1)])
    assert (lows <= feeds).all()
    return length / feeds[group]


@st.composite
def parts(draw):
    many = draw(st.integers(1, 12))
    numbers = st.lists(st.floats(0.0, 1.0), min_size=many, max_size=many)
    length = 10.0 ** (4 * np.array(draw(numbers)) - 1)
    high = 100.0 * 10.0 ** np.array(draw(numbers))
    low = high * (1 - 0.5 * np.array(draw(numbers)))
    joint = np.array(draw(st.lists(st.booleans(), min_size=many - 1, max_size=many - 1)), bool)
    return length, low, high, joint


@given(parts(), st.floats(0, 10))
def test_each_word_saved_loses_less_than_it_may(part, gain):
    """Also groups only join what may be joined; 1e-9 is the rounding of the sums."""
    length, low, high, joint = part
    group = merged(time_curves(length, low, high), joint, gain=gain, least_time=0.0)
    loss = taken(group, length, low, high).sum() - (length / high).sum()
    words = len(length) - 1 - group.max()
    assert loss <= gain * words * (1 + 1e-9) + 1e-9
    assert (np.diff(group)[~joint] == 1).all()
    assert np.isin(np.diff(group), (0, 1)).all()


@given(parts(), st.floats(0, 10))
def test_no_pair_is_left_that_could_be_merged(part, gain):
    """Every two neighbours left would lose more than a word is worth, or do not suit each other."""
    length, low, high, joint = part
    group = merged(time_curves(length, low, high), joint, gain=gain, least_time=0.0)
    apart = taken(group, length, low, high)
    for left in range(group.max()):
        pair = np.isin(group, (left, left + 1))
        last = int(np.flatnonzero(group == left)[-1])
        feed = high[pair].min()
        if joint[last] and low[pair].max() <= feed:
            loss = (length[pair] / feed).sum() - apart[pair].sum()
            assert loss > gain * (1 - 1e-9) - 1e-9


@given(parts(), st.floats(0.01, 100))
def test_a_group_is_short_only_where_its_neighbours_would_lose_more_than_it_takes(part, least):
    length, low, high, joint = part
    group = merged(time_curves(length, low, high), joint, gain=0.0, least_time=least)
    apart = taken(group, length, low, high)
    for left in range(group.max()):
        pair = np.isin(group, (left, left + 1))
        last = int(np.flatnonzero(group == left)[-1])
        feed = high[pair].min()
        if not joint[last] or low[pair].max() > feed:
            continue
        loss = (length[pair] / feed).sum() - apart[pair].sum()
        for one in (left, left + 1):
            time = apart[group == one].sum()
            assert time >= least * (1 - 1e-9) or loss > time * (1 - 1e-9)


def test_blocks_of_one_feed_are_one_group():
    group = merged(
        time_curves(np.full(50, 10.0), np.full(50, 60.0), np.full(50, 500.0)),
        np.ones(49, bool), gain=0.0, least_time=0.0,
    )  # fmt: skip
    assert group.max() == 0


def test_a_short_slow_block_does_not_slow_its_long_neighbours():
    """0.02 s at F 100 between two of 20 s at F 500: merged it would cost 80 s."""
    group = merged(
        time_curves([10_000.0, 2.0, 10_000.0], [60.0] * 3, [500.0, 100.0, 500.0]),
        np.ones(2, bool), gain=1e-3, least_time=0.05,
    )  # fmt: skip
    assert group.tolist() == [0, 1, 2]


def test_a_short_fast_block_goes_with_its_neighbours():
    group = merged(
        time_curves([10_000.0, 16.0, 10_000.0], [60.0] * 3, [500.0, 800.0, 500.0]),
        np.ones(2, bool), gain=1e-3, least_time=0.05,
    )  # fmt: skip
    assert group.tolist() == [0, 0, 0]


def test_blocks_as_programmed_cost_no_word_and_are_not_merged_for_one():
    """What merging would save is nothing: both keep their words."""
    curves = time_curves([100.0, 100.0], [60.0] * 2, [500.0, 499.0], own=[500.0, 499.0])
    assert merged(curves, np.ones(1, bool), gain=0.01, least_time=0.0).tolist() == [0, 1]
    changed = time_curves([100.0, 100.0], [60.0] * 2, [500.0, 499.0], own=[400.0, 499.0])
    assert merged(changed, np.ones(1, bool), gain=0.01, least_time=0.0).tolist() == [0, 0]


def test_a_valley_inside_the_range_is_found():
    """Wear that rises with the chip: value 1/F + F / 250 000 is least at F 500, for two blocks."""
    table = np.tile(1 / FEEDS + FEEDS / 250_000, (2, 1))
    curves = Curves(
        feeds=FEEDS, values=table, times=table, low=np.array([60.0, 400.0]),
        high=np.array([1900.0, 600.0]), own=np.full(2, np.nan),
    )  # fmt: skip
    assert merged(curves, np.ones(1, bool), gain=1e-9, least_time=0.0).tolist() == [0, 0]


def test_the_time_grows_with_the_blocks_not_with_their_square():
    """B log B: four times the blocks take less than ten times as long (sixteen if squared)."""

    def seconds(many):
        rng = np.random.default_rng(0)
        high = rng.uniform(100, 1000, many)
        curves = time_curves(rng.uniform(1, 100, many), 0.9 * high, high)
        least = np.inf
        for _ in range(3):
            start = process_time()
            merged(curves, np.ones(many - 1, bool), gain=0.01, least_time=0.05)
            least = min(least, process_time() - start)
        return least

    assert seconds(4000) < 10 * seconds(1000)


def test_nothing_to_merge():
    none = np.zeros(0)
    curves = Curves(
        feeds=FEEDS, values=np.zeros((0, 49)), times=np.zeros((0, 49)), low=none, high=none,
        own=none,
    )  # fmt: skip
    assert merged(curves, np.zeros(0, bool), gain=1.0, least_time=1.0).shape == (0,)


@pytest.mark.parametrize("seed", range(5))
def test_merging_everything_is_never_better_than_apart(seed):
    rng = np.random.default_rng(seed)
    high = rng.uniform(100, 1000, 40)
    length, low = rng.uniform(1, 100, 40), np.full(40, 60.0)
    few, many = (
        merged(time_curves(length, low, high), np.ones(39, bool), gain=gain, least_time=0.0)
        for gain in (1.0, 0.01)
    )
    assert few.max() < many.max()
    assert taken(few, length, low, high).sum() >= taken(many, length, low, high).sum()
