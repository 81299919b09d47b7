"""Figures of the cut: where things stand, odd numbers, which revolutions are drawn."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.charts import svg
from pipeline.charts.bands import UNITS
from pipeline.charts.sections import Figures
from pipeline.schema.cutting import CHANNEL_FORCE, HIGHEST, LOWEST, NoLoadPoint
from pipeline.submodels.cutting.figures import (
    HEIGHT,
    no_load_curve,
    no_load_figure,
    revolution_figure,
)
from pipeline.submodels.cutting.runs import CutTrace, cut_trace
from tests.submodels.cutting.cutting_files import (
    POWERS,
    SPINDLE,
    TURN,
    cross,
    folds,
    model,
    name_of,
    page,
    parameter,
    predictions,
    recording,
    run,
    verdict,
)

NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)
KINDS = ("measured", "modelled", "plain", "low", "high")


def shown(**values: np.ndarray) -> CutTrace:
    """A revolution, some of whose curves are others: ``<kind>_<channel>``."""
    made = cut_trace(predictions((1200, 0.97)), name_of(1200))
    assert made is not None
    for name, curve in values.items():
        kind, channel = name.split("_")
        made = replace(made, **{kind: {**getattr(made, kind), channel: curve}})
    return made


def without(trace: CutTrace, kind: str, channel: str) -> CutTrace:
    return replace(trace, **{kind: {k: v for k, v in getattr(trace, kind).items() if k != channel}})


def points_of(data: str) -> np.ndarray:
    """Absolute points (N, 2) of one relative path."""
    start = re.match(r"M(-?\d+) (-?\d+)", data).groups()
    moves = np.array(re.search(r"l([-\d ]+)", data).group(1).split(), dtype=float)
    points = np.vstack([np.array(start, dtype=float), moves.reshape(-1, 2)])
    return np.cumsum(points, axis=0)


def paths(drawn: str, kind: str) -> list[str]:
    return re.findall(rf'<path d="([^"]*)" class="(?:curve )?{kind}"', drawn)


def test_each_component_is_a_band_with_its_own_scale_and_zero():
    drawn = str(revolution_figure(shown(), ""))
    assert [f"F{a}, N" in drawn for a in "xyz"] == [True] * 3
    assert drawn.count('class="grid zero"') == 3
    assert [len(paths(drawn, kind)) for kind in ("measured", "modelled", "free", "s-still")] == (
        [3, 3, 3, 3]
    )


def test_the_angle_runs_over_one_turn_from_left_to_right():
    spike = np.zeros(len(TURN))
    spike[TURN == 90.0] = 100.0
    drawn = str(revolution_figure(shown(measured_x=spike), ""))
    points = points_of(paths(drawn, "measured")[0])
    highest = points[np.argmin(points[:, 1]), 0]
    assert highest / UNITS == pytest.approx(0.25, abs=1 / UNITS)
    assert '<line x1="25%"' in drawn and ">90<" in drawn and ">360<" in drawn


def test_the_cloud_holds_the_measured_curve_and_is_as_wide_as_said():
    levels = {"measured": 100.0, "low": 50.0, "high": 150.0, "modelled": 200.0, "plain": 0.0}
    flat = {f"{kind}_z": np.full(len(TURN), level) for kind, level in levels.items()}
    drawn = str(revolution_figure(shown(**flat), ""))
    cloud = points_of(paths(drawn, "s-still")[2])
    level = points_of(paths(drawn, "measured")[2])[0, 1]
    # 0 to 200 N with a margin of 6 % above and below fill the band
    per_newton = svg.FULL / (200 * 1.12)
    assert cloud[:, 1].max() - level == pytest.approx(50 * per_newton, abs=1)
    assert level - cloud[:, 1].min() == pytest.approx(50 * per_newton, abs=1)
    assert np.ptp(cloud[:, 0]) == pytest.approx(UNITS * TURN[-1] / 360, abs=1)


def test_a_hole_in_the_scatter_leaves_two_areas_and_no_bridge():
    low = np.array(shown().low["x"])
    low[100:140] = np.nan
    data = paths(str(revolution_figure(shown(low_x=low), "")), "s-still")[0]
    areas = [points_of(d) for d in data.split("z") if d]
    assert len(areas) == 2
    assert areas[0][:, 0].max() < UNITS * TURN[100] / 360 < areas[1][:, 0].min()


def test_what_was_not_recorded_has_no_band_and_no_guess_no_curve():
    trace = shown()
    for kind, channel in (("measured", "x"), ("plain", "y"), ("low", "z")):
        trace = without(trace, kind, channel)
    drawn = str(revolution_figure(trace, ""))
    assert "Fx, N" not in drawn and "Fy, N" in drawn and "Fz, N" in drawn
    assert len(paths(drawn, "free")) == 1 and len(paths(drawn, "s-still")) == 1


def test_bands_stand_below_one_another():
    drawn = str(revolution_figure(shown(), ""))
    tops = [float(y) for y in re.findall(r'<svg x="0" y="([\d.]+)"', drawn)]
    assert np.all(np.diff(tops) > HEIGHT)


def test_words_of_a_figure_stay_words():
    drawn = str(revolution_figure(shown(), "<script>alert('x')</script>"))
    assert "<script>" not in drawn and "alert" in drawn


SOME = st.lists(st.floats(-1e12, 1e12) | st.just(float("nan")), min_size=2, max_size=8)


@settings(max_examples=60, deadline=None)
@given(SOME, SOME, SOME, SOME)
def test_any_numbers_of_a_revolution_give_a_figure_or_none(angle, measured, modelled, ends):
    rows = min(map(len, (angle, measured, modelled, ends)))
    columns = (("", measured, modelled), (LOWEST, ends, None), (HIGHEST, measured, None))
    frame = pd.concat(
        pd.DataFrame({
            "case": "a", "quantity": CHANNEL_FORCE + "x", "regime": regime,
            "t": np.nan_to_num(angle[:rows]), "measured": first[:rows],
            "predicted": np.nan if second is None else second[:rows], "baseline_plain": ends[:rows],
        })
        for regime, first, second in columns
    )  # fmt: skip
    one = cut_trace(frame, "a")
    assert one is None or not NOT_A_NUMBER.search(str(revolution_figure(one, "x")))
    assert cut_trace(frame, "b") is None and cut_trace(None, "a") is None


# ---- the no-load power

VALUE = st.floats(-1e6, 1e6)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(VALUE | st.none(), min_size=3, max_size=3),
    st.none() | st.tuples(VALUE, VALUE),
    st.lists(st.tuples(st.floats(0, 1e5), VALUE, VALUE, VALUE), max_size=4),
)
def test_any_numbers_of_the_no_load_power_give_a_figure_or_none(values, ends, points):
    names = ("speed_rpm", "power_W", "half_width_95_W", "measured_W")
    powers = {f"p{k}": parameter(value, "W") for k, value in enumerate(values)}
    curve = tuple(NoLoadPoint(**dict(zip(names, one, strict=True))) for one in points)
    spindle = replace(SPINDLE, range_rpm=ends, curve=curve)
    found = no_load_curve(model({"spindle": powers}, spindle=spindle))
    assert found is None or not NOT_A_NUMBER.search(str(no_load_figure(found, "x")))


@pytest.mark.parametrize(
    ("names", "at_top"),
    [(("p0", "p1", "p2"), 84 + 3.2 * 200 + 0.021 * 200**2), (("p0", "p2"), 84 + 0.021 * 200**2)],
)
def test_the_no_load_curve_is_the_polynomial_of_revolutions_in_a_second(names, at_top):
    found = no_load_curve(model({"spindle": {name: POWERS[name] for name in names}}))
    assert (found.speed[0], found.speed[-1]) == (600, 12_000)
    assert found.power[-1] == pytest.approx(at_top, rel=1e-12)


def test_no_curve_is_drawn_with_a_coefficient_that_is_not_determined():
    powers = {**POWERS, "p1": parameter(None, "W s")}
    assert len(no_load_curve(model({"spindle": powers})).power) == 0
    empty = replace(SPINDLE, curve=())
    assert no_load_curve(model({"spindle": powers}, spindle=empty)) is None
    assert no_load_curve(None) is None and no_load_curve(model(spindle=None)) is None


def test_no_load_levels_stand_at_their_speed_and_the_band_about_its_curve():
    rows = tuple(
        NoLoadPoint(speed_rpm=n, power_W=100.0 + n / 20, half_width_95_W=40.0,
                    measured_W=120.0 + n / 20)
        for n in (12_000, 3000, 6000)
    )  # fmt: skip
    spindle = replace(SPINDLE, range_rpm=(3000.0, 12_000.0), curve=rows)
    drawn = str(no_load_figure(no_load_curve(model({"spindle": {}}, spindle=spindle)), ""))
    dots = re.findall(r'<circle cx="([\d.]+)%" cy="([\d.]+)"', drawn)
    assert [float(x) for x, _ in dots] == pytest.approx([25.0, 50.0, 100.0])
    upper, lower = np.split(points_of(paths(drawn, "s-band")[0]), 2)
    assert lower[::-1, 0] == pytest.approx(upper[:, 0])
    wide = lower[::-1, 1] - upper[:, 1]
    assert np.ptp(wide) <= 1  # 80 W everywhere, rounded to whole units
    # a level lies 20 of 40 W above the middle of its band
    level = np.array([float(y) for _, y in dots])
    middle = 18 + 220 * (upper[:, 1] + wide / 2) / svg.FULL
    assert middle - level == pytest.approx(220 * wide / 4 / svg.FULL, abs=0.5)


# ---- what is drawn


def figures_of(found, judged, curves) -> list[str]:
    """Captions of the revolutions on a page."""
    (section,) = (s for s in page(found, judged, curves).sections if s.key == "forces")
    every = [block for block in section.blocks if isinstance(block, Figures)]
    return [figure.caption for block in every for figure in block.figures]


@pytest.mark.parametrize(
    ("runs", "others", "first"),
    [
        ([(600, 3.0, "training"), (1200, 9.0, "held_out"), (1500, 6.0, "held_out")], [], 1200),
        ([(600, 3.0, "training"), (1200, 5.0, "training")], [(600, 9.0), (1200, 4.0)], 600),
    ],
)
def test_the_worst_and_the_best_of_what_was_not_learnt_from_are_drawn(runs, others, first):
    judged = verdict(*(run(f, e, role) for f, e, role in runs), *(cross(*one) for one in others))
    rows = tuple(recording(f, "training") for f in (600, 1200))
    found = model(folds=folds((600, 1200), (1200, 600)), recordings=rows)
    captions = figures_of(found, judged, predictions())
    second = {1200: 1500, 600: 1200}[first]
    assert [re.search(r"revolution of (\S+), (\w+)", one).groups() for one in captions] == [
        (name_of(first), "worst"), (name_of(second), "best")
    ]  # fmt: skip


def test_a_single_recording_is_drawn_once():
    (caption,) = figures_of(model(), verdict(run(1200, 9.0)), predictions())
    assert "worst predicted" not in caption


def test_every_figure_is_labelled_and_small():
    found = page(model(), verdict(), predictions())
    every = [f for s in found.sections for b in s.blocks if isinstance(b, Figures)
             for f in b.figures]  # fmt: skip
    assert len(every) == 3  # no-load power, worst and best revolution
    for figure in every:
        assert len(str(figure.svg)) < 60_000 and len(figure.caption) > 40
        assert 'role="img"' in str(figure.svg)
