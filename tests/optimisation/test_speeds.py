"""Viterbi's path through the grid of speeds against all; groups of blocks that share an F."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.machine.spindle import run_up_time
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.feed_groups import Curves, merged
from pipeline.optimisation.methods.speeds import speed_pieces, viterbi
from pipeline.optimisation.settings import Grouping
from pipeline.schema.limits import CutLimit
from tests.optimisation.direct_parts import control, problem, slots


def price(path, values, change, kind, word):
    """What a way costs, added up as it stands in the docstring."""
    total = sum(values[stage, state] for stage, state in enumerate(path))
    for stage in range(1, len(path)):
        before, after = path[stage - 1], path[stage]
        if before != after:
            total += change[kind[stage], before, after] + word[stage]
    return total


@st.composite
def stages(draw):
    """Up to 5 stages of up to 4 states, some forbidden, two kinds of change."""
    many, states = draw(st.integers(1, 5)), draw(st.integers(1, 4))
    cost = st.one_of(st.floats(0.0, 10.0), st.just(np.inf))
    numbers = draw(st.lists(cost, min_size=many * states, max_size=many * states))
    moves = draw(st.lists(cost, min_size=2 * states**2, max_size=2 * states**2))
    kind = draw(st.lists(st.integers(0, 1), min_size=many, max_size=many))
    word = draw(st.lists(st.floats(0.0, 3.0), min_size=many, max_size=many))
    change = np.reshape(moves, (2, states, states))
    change[:, range(states), range(states)] = 0.0
    return np.reshape(numbers, (many, states)), change, np.array(kind), np.array(word)


@given(stages())
@settings(max_examples=30)
def test_no_way_is_cheaper(given_stages):
    """Exhaustive search; sums of at most 9 terms below 10 agree to 1e-12."""
    values, change, kind, word = given_stages
    least = min(
        price(path, values, change, kind, word)
        for path in product(range(values.shape[1]), repeat=len(values))
    )
    found = price(viterbi(values, change, kind, word), values, change, kind, word)
    assert found == least or found == pytest.approx(least, rel=1e-12, abs=1e-12)


def test_of_equal_speeds_the_lowest_is_taken_and_kept():
    values = np.array([[2.0, 1.0, 1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 2.0]])
    path = viterbi(values, np.full((1, 3, 3), 0.5), np.zeros(3, int), np.zeros(3))
    assert path.tolist() == [1, 1, 1]


def test_equal_changes_come_early():
    """S changes in the air before a cut rather than with it."""
    values = np.array([[0.0, 5.0], [0.0, 0.0], [5.0, 0.0]])
    change = np.ones((1, 2, 2))
    path = viterbi(values, change, np.zeros(3, int), np.zeros(3))
    assert path.tolist() == [0, 1, 1]


GROUPING = Grouping(least_gain=0.0, least_speed_gain=0.0)
RATE, BASE = 4000.0, 3000.0


LIMITS = CutLimit(load_N=60.0, feed_mm_min=(50, 600), speed_rpm=(1000, 12000))
TEXT = slots(0.5, 2.0, 1.0).replace("G1 X280 F200", "G1 X100 F200\nG1 X280", 1)


def of_slots(**auxiliary):
    machine = control(spindle_acceleration=RATE, spindle_base_speed=BASE, **auxiliary)
    return problem(TEXT, LIMITS, machine=machine)


def test_a_word_is_added_at_the_first_line_after_a_cut_and_before_another():
    part = of_slots()
    pieces = speed_pieces(part.cut.plan, part.editable, part.cuts, GROUPING)
    cuts_of_piece = np.bincount(pieces.piece[part.cuts], minlength=len(pieces))
    assert len(pieces) > 1
    assert (cuts_of_piece > 0).all()
    for one in range(1, len(pieces)):
        first = int(np.argmax(pieces.piece == one))
        moving = np.flatnonzero(part.cut.plan.path.moving[:first])
        assert part.cuts[moving[-1]], "the way before the word cuts nothing"


def test_ways_in_air_keep_the_speed_of_a_cut_beside_them():
    part = of_slots()
    speed = blockwise_optimum(part, "cost", GROUPING).row_speeds
    moves = part.cut.plan.path.moves
    cut_at = set(speed[part.cuts].tolist())
    assert set(speed[moves.direction != 0].tolist()) <= cut_at


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["rise", "fall"])
def test_a_change_that_the_spindle_is_too_slow_for_is_beyond_the_limits(sign):
    part = of_slots()
    plan = part.cut.plan
    row = int(np.flatnonzero(part.cuts)[1])  # a cut after a cut: no time in between
    low = plan.path.moves.speed
    changed = low.copy()
    changed[row:] += sign * 1000.0
    violation = part.speed_changes.violation(np.stack([low, changed]), 0.0)
    lead = part.speed_changes.lead[part.speed_changes.pairs[:, 1] == row]
    needed = abs(run_up_time(changed[row], RATE, BASE) - run_up_time(low[row], RATE, BASE))
    assert lead.item() < needed
    assert violation.tolist() == pytest.approx([0.0, 1 - lead.item() / needed], abs=1e-9)
    found = part.evaluate_rows(plan.path.moves.feed[None], changed[None])
    assert found.violation.item() >= violation[1] > 0


def test_a_control_that_waits_has_time_for_any_change():
    part = of_slots(speed_change_waits=True)
    moves = part.cut.plan.path.moves
    changed = moves.speed.copy()
    changed[int(np.flatnonzero(part.cuts)[1]) :] += 1000.0
    assert part.speed_changes.violation(changed[None], 0.0).item() == 0.0


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
@settings(max_examples=30)
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
@settings(max_examples=30)
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
@settings(max_examples=30)
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


def test_a_short_slow_block_does_not_slow_its_long_neighbours():
    """0.02 s at F 100 between two of 20 s at F 500: merged it would cost 80 s."""
    group = merged(
        time_curves([10_000.0, 2.0, 10_000.0], [60.0] * 3, [500.0, 100.0, 500.0]),
        np.ones(2, bool), gain=1e-3, least_time=0.05,
    )  # fmt: skip
    assert group.tolist() == [0, 1, 2]


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


def test_nothing_to_merge():
    none = np.zeros(0)
    curves = Curves(
        feeds=FEEDS, values=np.zeros((0, 49)), times=np.zeros((0, 49)), low=none, high=none,
        own=none,
    )  # fmt: skip
    assert merged(curves, np.zeros(0, bool), gain=1.0, least_time=1.0).shape == (0,)
