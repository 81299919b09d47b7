"""Figures of judged days: what the scale of the errors does not reach is marked."""

import numpy as np

from pipeline.submodels.spindle.figures import Curves, frame, golden_figure


def day(spike: float) -> Curves:
    """Ten hours of which one value in 3600 is off by ``spike`` [K], else by 0.5 K."""
    seconds = 6 * 3600 + 10.0 * np.arange(3600)
    measured = np.full(3600, 30.0)
    off = np.where(np.arange(3600) == 1800, spike, 0.5)
    return Curves(day="Mon", seconds=seconds,
                  values={"measured": measured, "model_window": measured + off})  # fmt: skip


def test_an_error_beyond_the_scale_has_a_mark_and_stands_in_the_head():
    one = day(9.0)
    axes = frame([one], [], 2.0)
    assert axes.error < 9.0  # one value of 3600 does not flatten the rest
    drawn = str(golden_figure(one, None, axes, "a day"))
    assert drawn.count('class="beyond"') == 1 and "beyond the scale: 9 K" in drawn
    assert "Model less measured, K; ▲ beyond, up to 9 K" in drawn


def test_errors_inside_the_scale_have_no_mark():
    one = day(1.0)
    assert "beyond" not in str(golden_figure(one, None, frame([one], [], 2.0), "a day"))
