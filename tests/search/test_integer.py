"""Whole numbers in the box: equal shares, bounds, round trip, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from pipeline.search.box import Box


def test_each_whole_number_is_equally_likely_the_bounds_among_them() -> None:
    box = Box.of([-3, 0.0], [4, 1.0], integer=[True, False])
    x = box.place(np.random.default_rng(0).random((16000, 2)))
    numbers, counts = np.unique(x[:, 0], return_counts=True)
    assert numbers.tolist() == list(range(-3, 5))
    assert stats.chisquare(counts).pvalue > 1e-3
    # the other axis stays continuous
    assert len(np.unique(x[:, 1])) == len(x)


def test_on_a_logarithmic_scale_each_has_the_share_of_its_half_steps() -> None:
    box = Box.of([1], [9], log=True, integer=True)
    x = box.place(np.random.default_rng(1).random((16000, 1)))[:, 0]
    numbers, counts = np.unique(x, return_counts=True)
    assert numbers.tolist() == list(range(1, 10))
    shares = np.log((numbers + 0.5) / (numbers - 0.5)) / np.log(9.5 / 0.5)
    assert stats.chisquare(counts, shares * len(x)).pvalue > 1e-3


@given(data=st.data())
def test_whole_numbers_lie_in_the_box_and_lead_back(data: st.DataObject) -> None:
    log = data.draw(st.booleans())
    low = data.draw(st.integers(1 if log else -1000, 1000))
    high = low + data.draw(st.integers(0, 1000))
    box = Box.of([low], [high], log, True)
    x = box.place(np.array([[data.draw(st.floats(0, 1))]]))
    assert low <= x[0, 0] <= high and x[0, 0] == int(x[0, 0])
    assert (box.place(box.unit(x)) == x).all()
    value = data.draw(st.integers(low, high))
    assert box.place(box.unit([[value]]))[0, 0] == value


def test_the_corners_are_the_bounds() -> None:
    box = Box.of([2, 3], [7, 50], [False, True], integer=True)
    assert box.place(np.array([[0.0, 0.0], [1.0, 1.0]])).tolist() == [[2, 3], [7, 50]]


@pytest.mark.parametrize("log", [False, True])
def test_one_that_is_held_stays(log: bool) -> None:
    box = Box.of([5], [5], log, True)
    assert (box.place(np.random.default_rng(1).random((50, 1))) == 5).all()
    assert box.unit([[5]]).tolist() == [[0.5]]
    assert box.at_bounds(np.array([5.0])).tolist() == [0]


@pytest.mark.parametrize(
    ("low", "high", "integer", "words"),
    [
        ([0, 0.5], [1, 4], True, "parameter 1 are 0.5 to 4.0"),
        ([0, 0], [1, 4.5], [False, True], "parameter 1 are 0.0 to 4.5"),
        ([0, 0], [1, 4], [True], "kind of number has shape (1,)"),
    ],
)
def test_bounds_that_are_no_whole_numbers_are_refused(low, high, integer, words: str) -> None:
    with pytest.raises(ValueError) as refused:
        Box.of(low, high, integer=integer)
    assert words in str(refused.value)


def test_a_start_between_whole_numbers_is_refused() -> None:
    with pytest.raises(ValueError, match=r"individual 1 has parameter 0 = 2\.5"):
        Box.of([0], [4], integer=True).unit([[2], [2.5]])


def test_what_is_at_a_bound_is_said_by_side_and_how_near_depends_on_the_kind() -> None:
    low, high = [0, 0, 0, 0, 1e-4, 1e-4, 3], [1, 1, 1, 1000, 1e-1, 1e-1, 3]
    integer = [False, False, False, True, False, False, False]
    box = Box.of(low, high, [False] * 4 + [True] * 2 + [False], integer)
    # 1e-4 of three decades is 1.0007 times the bound; 1 of 1000 whole numbers is no bound
    x = np.array([0.0005, 0.9995, 0.5, 1, 1.0005e-4, 0.05, 3])
    assert box.at_bounds(x).tolist() == [-1, 1, 0, 0, -1, 0, 0]
    x = np.array([0.002, 0.998, 0.0, 1000, 1.02e-4, 0.1, 3])
    assert box.at_bounds(x).tolist() == [0, 0, -1, 1, 0, 1, 0]
