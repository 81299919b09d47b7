"""Values beyond a band are marked at its edge, and said."""

import re

import numpy as np

from pipeline.charts.bands import Band
from pipeline.submodels.spindle.figures import Curves, Frame, golden_figure

BAND = Band(top=100.0, height=50.0, low=-2.0, high=2.0)


def test_each_stretch_beyond_a_band_has_one_arrow_with_its_greatest_value() -> None:
    x = np.linspace(0.0, 100.0, 101)
    values = np.zeros(101)
    values[20:23], values[60], values[62] = (3.0, 5.25, 4.0), -2.5, np.nan
    up, down = map(str, BAND.beyond(x, values, "K"))
    assert "▲<title>5.25 K</title>" in up and 'x="21%"' in up and 'y="108"' in up
    assert "▼<title>−2.5 K</title>" in down and 'x="60%"' in down and 'y="149"' in down


def test_values_within_a_band_have_none() -> None:
    assert BAND.beyond(np.arange(3.0), np.array([-2.0, np.nan, 2.0]), "K") == []


def test_an_error_beyond_the_axis_is_marked_and_counted_in_the_head() -> None:
    axes = Frame(hours=(0, 24), span=(20.0, 60.0), error=2.0, limit=None, top_speed=1000.0)
    measured = np.full(1000, 30.0)
    modelled = measured + np.where(np.arange(1000) < 5, 7.5, 0.5)
    curves = Curves(day="2026-01-05", seconds=np.linspace(0, 86_000.0, 1000),
                    values={"measured": measured, "model_window": modelled})  # fmt: skip
    drawn = str(golden_figure(curves, None, axes, "a day"))
    assert re.search(r"Model less measured, K; ▲▼ 0\.50?\s% beyond, up to 7.5", drawn)
    assert drawn.count("▲<title>") == 1
    curves.values["model_window"] = measured + 0.5
    assert "▲" not in str(golden_figure(curves, None, axes, "a day"))
