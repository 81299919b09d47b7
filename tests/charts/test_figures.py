"""Figures: values beyond the scale are marked and said; curves lose nothing; round ticks."""

import re

import numpy as np

from pipeline.charts import svg
from pipeline.charts.bands import Band, beyond, beyond_words

INTO = Band(top=10.0, height=80.0, low=-2.0, high=2.0)


def test_values_beyond_the_scale_have_a_triangle_at_their_place_and_edge():
    values = np.array([0.0, 3.5, -1.0, np.nan, -4.25])
    one = beyond(np.array([0.0, 25.0, 50.0, 75.0, 100.0]), values, INTO, "K")
    assert one.ends == {True: 3.5, False: -4.25}
    above, below = map(str, one.marks)
    assert 'x="25.00%" y="10"' in above and "l-5 -7" in above  # at the top, pointing up
    assert 'x="100.00%" y="90"' in below and "l-5 7" in below
    assert "beyond the scale: 3.5 K" in above and "beyond the scale: −4.25 K" in below


def test_neighbours_beyond_the_scale_share_the_triangle_of_the_farthest():
    across = np.linspace(0.0, 10.0, 101)
    values = np.where((across >= 4) & (across <= 6), 2.0 + across, 0.0)
    one = beyond(across, values, INTO, "K")
    assert one.ends == {True: 8.0} and len(one.marks) == 1
    assert re.search(r"beyond the scale: 8 K", str(one.marks[0]))


def test_the_head_says_the_ends_of_all_curves_and_nothing_inside_the_scale():
    inside = beyond(np.array([1.0]), np.array([2.0]), INTO, "K")
    assert beyond_words([inside], "K") == "" and not inside.marks
    curves = [beyond(np.array([1.0]), np.array([v]), INTO, "K") for v in (2.5, -3.0)]
    assert beyond_words([inside, *curves], "K") == "; ▲ above, up to 2.5 K; ▼ below, down to −3 K"
    assert beyond_words(curves[:1], "") == "; ▲ above, up to 2.5"


def test_the_farthest_value_below_a_scale_that_begins_above_0_is_the_lowest():
    low = Band(top=10.0, height=80.0, low=100.0, high=200.0)
    one = beyond(np.array([50.0, 50.5]), np.array([80.0, 20.0]), low, "N")
    assert beyond_words([one], "N") == "; ▼ below, down to 20 N"
    assert [bool(re.search("beyond the scale: 20 N", str(mark))) for mark in one.marks] == [True]


def points(path: str) -> np.ndarray:
    """Absolute points of path data with one M and one l."""
    x, y = map(int, re.match(r"M(-?\d+) (-?\d+)", path).groups())
    steps = np.array(re.findall(r"-?\d+", path.split("l")[1]), dtype=int).reshape(-1, 2)
    return np.vstack([[x, y], [x, y] + np.cumsum(steps, axis=0)])


def test_relative_path_returns_to_where_the_curve_ends():
    x, y = np.arange(50.0), np.round(500 * np.sin(np.arange(50.0)))
    assert np.array_equal(points(svg.path_data(x, y)), np.stack([x, y], axis=1))


def test_a_gap_lifts_the_pen_and_a_lonely_value_is_still_drawn():
    y = np.array([1.0, 2.0, np.nan, 4.0, np.nan])
    path = svg.path_data(np.arange(5.0), y)
    assert path == "M0 1l1 1M3 4h1"


def test_horizontal_stretches_are_one_step():
    assert svg.path_data(np.arange(5.0), np.array([1.0, 1, 1, 1, 2])) == "M0 1l3 0 1 1"


def test_thinning_keeps_the_extremes_and_the_gaps():
    rng = np.random.default_rng(3)
    x, y = np.arange(8640) * 10.0, rng.normal(size=8640)
    y[4000:4400] = np.nan
    thin_x, thin_y = svg.thinned(x, y, 600.0)
    assert len(thin_x) <= 2 * 144
    assert np.nanmax(thin_y) == np.nanmax(y) and np.nanmin(thin_y) == np.nanmin(y)
    assert np.isnan(thin_y).sum() >= 6
    assert np.all(np.diff(thin_x) > 0)


def test_ticks_are_round_inside_and_not_too_many():
    for low, high in ((17.3, 42.9), (-2.2, 2.2), (0.0, 0.013), (19.0, 19.4)):
        marks = svg.ticks(low, high)
        assert 2 <= len(marks) <= 6
        assert all(low - 1e-9 <= m <= high + 1e-9 for m in marks)


def test_words_in_figures_are_escaped():
    drawn = svg.figure([svg.text(0, 0, "<script>")], height=1, label='"><script>')
    assert "<script>" not in drawn


def test_a_scale_has_two_ticks_so_that_its_size_can_be_read():
    assert svg.ticks(-900.0, 900.0, most=1) == [-500.0, 0.0, 500.0]
    assert svg.ticks(-900.0, 950.0, most=2) == [-500.0, 0.0, 500.0]
