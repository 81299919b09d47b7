"""Bands of figures: values beyond the scale are marked, and said in words."""

import re

import numpy as np

from pipeline.charts.bands import Band, beyond, beyond_words

INTO = Band(top=10.0, height=80.0, low=-2.0, high=2.0)


def test_values_beyond_the_scale_have_a_triangle_at_their_place_and_edge():
    values = np.array([0.0, 3.5, -1.0, np.nan, -4.25])
    one = beyond(np.array([0.0, 25.0, 50.0, 75.0, 100.0]), values, INTO, "K")
    assert one.count == 2 and one.farthest == -4.25
    above, below = map(str, one.marks)
    assert 'x="25.00%" y="10"' in above and "l-5 -7" in above  # at the top, pointing up
    assert 'x="100.00%" y="90"' in below and "l-5 7" in below
    assert "beyond the scale: 3.5 K" in above and "beyond the scale: −4.25 K" in below


def test_neighbours_beyond_the_scale_share_the_triangle_of_the_farthest():
    across = np.linspace(0.0, 10.0, 101)
    values = np.where((across >= 4) & (across <= 6), 2.0 + across, 0.0)
    one = beyond(across, values, INTO, "K")
    assert one.count == 21 and len(one.marks) == 1
    assert re.search(r"beyond the scale: 8 K", str(one.marks[0]))


def test_the_head_says_the_farthest_value_of_all_curves_and_nothing_inside_the_scale():
    inside = beyond(np.array([1.0]), np.array([2.0]), INTO, "K")
    assert beyond_words([inside], "K") == "" and not inside.marks
    curves = [beyond(np.array([1.0]), np.array([v]), INTO, "K") for v in (2.5, -3.0)]
    assert beyond_words([inside, *curves], "K") == ("; ▲ beyond, up to −3 K")
