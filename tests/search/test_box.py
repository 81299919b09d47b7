"""The box as the unit cube: round trip, even spread, whole numbers, and bounds that are none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from pipeline.search.box import Box


@given(data=st.data())
def test_places_lie_in_the_box_and_lead_back(data: st.DataObject) -> None:
    d = data.draw(st.integers(1, 5))
    log = data.draw(st.lists(st.booleans(), min_size=d, max_size=d))
    low = [data.draw(st.floats(1e-9, 1e3) if one else st.floats(-1e6, 1e6)) for one in log]
    high = [a + data.draw(st.floats(1e-3, 1e6)) for a in low]
    box = Box.of(low, high, log)
    unit = np.array(data.draw(st.lists(st.floats(0, 1), min_size=d, max_size=d)))[None]
    x = box.place(unit)
    assert (x >= low).all() and (x <= high).all()
    # 1e6 +- 1e-3 leaves seven digits of a place
    np.testing.assert_allclose(box.place(box.unit(x)), x, rtol=1e-9, atol=1e-9)


def test_a_logarithmic_scale_spreads_decades_evenly() -> None:
    box = Box.of([1e-6, -1.0], [1e-2, 3.0], [True, False])
    x = box.place(np.random.default_rng(0).random((5000, 2)))
    assert stats.kstest(np.log10(x[:, 0]), stats.uniform(-6, 4).cdf).pvalue > 1e-3
    assert stats.kstest(x[:, 1], stats.uniform(-1, 4).cdf).pvalue > 1e-3


def test_corners_are_the_bounds() -> None:
    low, high = np.array([0.1, 1e-7, -0.3]), np.array([0.7, 0.9, 0.1])
    box = Box.of(low, high, [False, True, False])
    assert (box.place(np.zeros((1, 3))) == low).all()
    # the logarithm of seven decades, 16, is rounded to 2e-15
    np.testing.assert_allclose(box.place(np.ones((1, 3)))[0], high, rtol=1e-14)


def test_a_parameter_that_is_held_stays() -> None:
    box = Box.of([2.0, 0.0], [2.0, 1.0])
    assert (box.place(np.random.default_rng(1).random((50, 2)))[:, 0] == 2.0).all()
    assert box.unit([2.0, 0.25]).tolist() == [[0.5, 0.25]]


@pytest.mark.parametrize(
    ("low", "high", "log", "words"),
    [
        ([0, 1], [1], None, "shapes (2,) and (1,)"),
        ([], [], None, "shapes (0,) and (0,)"),
        ([[0]], [[1]], None, "shapes (1, 1) and (1, 1)"),
        ([0, 5], [1, 4], None, "parameter 1 are 5.0 to 4.0"),
        ([0, np.nan], [1, 4], None, "parameter 1 are nan to 4.0"),
        ([0], [np.inf], None, "parameter 0 are 0.0 to inf"),
        ([1, 0], [2, 1], True, "parameter 1 begin at 0.0"),
        ([1, 0], [2, 1], [True], "scale has shape (1,)"),
    ],
)
def test_bounds_that_are_no_box_are_refused(low, high, log, words: str) -> None:
    with pytest.raises(ValueError) as refused:
        Box.of(low, high, log)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ([0.5], "shape (1, 1)"),
        ([[0.5, 0.5], [0.5, 1.5]], "individual 1 has parameter 1 = 1.5 outside 0.0 to 1.0"),
        ([np.nan, 0.5], "individual 0 has parameter 0 = nan"),
    ],
)
def test_a_start_that_does_not_fit_is_refused(start, words: str) -> None:
    with pytest.raises(ValueError) as refused:
        Box.of([0, 0], [1, 1]).unit(start)
    assert words in str(refused.value)


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
@settings(max_examples=40)
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


def test_corners_of_whole_numbers_are_the_bounds() -> None:
    box = Box.of([2, 3], [7, 50], [False, True], integer=True)
    assert box.place(np.array([[0.0, 0.0], [1.0, 1.0]])).tolist() == [[2, 3], [7, 50]]


@pytest.mark.parametrize("log", [False, True])
def test_a_whole_number_that_is_held_stays(log: bool) -> None:
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
