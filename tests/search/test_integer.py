"""Whole numbers in the box: equal shares, bounds, round trip, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from pipeline.search.box import Box
from pipeline.search.compass import compass


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


def test_neighbours_are_the_next_whole_numbers_inside_the_bounds() -> None:
    box = Box.of([0, 0, 0.0], [4, 4, 1.0], integer=[True, True, False])
    below, above = box.next_whole(np.array([0.5, 0.99, 0.3]))
    assert box.place(below[None])[0].tolist() == [1, 3, 0.3]
    assert box.place(above[None])[0].tolist() == [3, 4, 0.3]
    centred = box.centred(np.array([[0.41, 0.99, 0.3]]))
    assert centred[0] == pytest.approx([0.5, 0.9, 0.3])


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


@pytest.mark.parametrize("start", [2, 9])
def test_compass_steps_to_the_next_whole_number_at_least(start: int) -> None:
    """Its step is a hundredth of the box, and the next whole number is a tenth of it away."""

    def cost(x: np.ndarray) -> np.ndarray:
        assert (x[:, 0] == np.floor(x[:, 0])).all()
        return (x[:, 0] - 7) ** 2 + (x[:, 1] - 0.31) ** 2

    found = compass(
        cost, [0, 0], [9, 1], [start, 0.5], evaluations=80, step=0.01, integer=[True, False]
    )
    assert found.x[0] == 7
    assert found.x[1] == pytest.approx(0.31, abs=1e-6)


def test_the_first_round_asks_for_both_next_whole_numbers() -> None:
    asked = []

    def cost(x: np.ndarray) -> np.ndarray:
        asked.append(x[:, 0].tolist())
        return np.zeros(len(x))

    compass(cost, [0], [9], [4], evaluations=5, step=0.001, integer=True)
    assert asked[:2] == [[4.0], [3.0, 5.0]]


def test_its_parabolas_stand_on_the_whole_numbers_that_were_evaluated() -> None:
    """A step of 1.5 ends on the second whole number; 4 further is the minimum, in one round."""
    found = compass(
        lambda x: (x[:, 0] - 44) ** 2, [0], [100], [40], evaluations=5, step=0.0149, integer=True
    )
    assert found.x.tolist() == [44.0]


def test_compass_stays_among_whole_numbers_to_its_end() -> None:
    found = compass(
        lambda x: (x[:, 0] - 9.4) ** 2, [0], [9], [0], evaluations=300, integer=True
    )  # fmt: skip
    assert found.x.tolist() == [9.0] and found.at_bounds.tolist() == [1]
