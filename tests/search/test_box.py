"""The box as the unit cube: round trip, even spread, and bounds that are none."""

import numpy as np
import pytest
from hypothesis import given
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
