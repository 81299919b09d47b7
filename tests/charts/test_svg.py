import re

import numpy as np

from pipeline.charts import svg


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
