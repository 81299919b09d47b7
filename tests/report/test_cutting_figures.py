"""Figures of the cut: where things stand, odd records, whether words overlap."""

import re

import numpy as np
import pytest
from cutting_folders import (
    SPINDLE,
    TURN,
    cut_parameter,
    cut_run,
    name_of,
    trace,
    with_cutting,
    write_cutting_traces,
)
from drive_folders import report, section
from hypothesis import given, settings
from hypothesis import strategies as st
from report_folders import FLEET, empty_machine

from pipeline.charts import svg
from pipeline.charts.bands import UNITS
from pipeline.charts.sources import Shelf
from pipeline.report.cutting_spindle import no_load, no_load_figure
from pipeline.report.cutting_trace_figure import HEIGHT, revolution_figure
from pipeline.report.cutting_traces import CURVES, CutTrace, cut_traces
from pipeline.report.pages import write_report
from tests.browser import look, needs_browser

NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)


def shown(**values: np.ndarray) -> CutTrace:
    made = {k: np.array(v) for k, v in trace(1200).items() if k in CURVES} | values
    return CutTrace(recording="a", angle=TURN, values=made)


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
    wide = np.full(len(TURN), 50.0)
    flat = {
        f"{kind}_z": level + 0 * wide
        for kind, level in (
            ("measured", 100.0),
            ("low", 50.0),
            ("high", 150.0),
            ("modelled", 200.0),
            ("plain", 0.0),
        )
    }
    drawn = str(revolution_figure(shown(**flat), ""))
    cloud = points_of(paths(drawn, "s-still")[2])
    level = points_of(paths(drawn, "measured")[2])[0, 1]
    # 0 to 200 N with a margin of 6 % above and below fill the band
    per_newton = svg.FULL / (200 * 1.12)
    assert cloud[:, 1].max() - level == pytest.approx(50 * per_newton, abs=1)
    assert level - cloud[:, 1].min() == pytest.approx(50 * per_newton, abs=1)
    assert np.ptp(cloud[:, 0]) == pytest.approx(UNITS * TURN[-1] / 360, abs=1)


def test_a_hole_in_the_spread_leaves_two_areas_and_no_bridge():
    low = np.array(trace(1200)["low_x"])
    low[100:140] = np.nan
    data = paths(str(revolution_figure(shown(low_x=low), "")), "s-still")[0]
    areas = [points_of(d) for d in data.split("z") if d]
    assert len(areas) == 2
    assert areas[0][:, 0].max() < UNITS * TURN[100] / 360 < areas[1][:, 0].min()


def test_what_was_not_recorded_has_no_band_and_no_guess_no_curve():
    nothing = np.full(len(TURN), np.nan)
    drawn = str(revolution_figure(shown(measured_x=nothing, plain_y=nothing, low_z=nothing), ""))
    assert "Fx, N" not in drawn and "Fy, N" in drawn and "Fz, N" in drawn
    assert len(paths(drawn, "free")) == 1 and len(paths(drawn, "s-still")) == 1


ROW_KEYS = ("speed_rpm", "power_W", "half_width_95_W", "measured_W")
SOME = st.lists(st.floats(), min_size=2, max_size=8)


@settings(max_examples=60, deadline=None)
@given(SOME, SOME, SOME, SOME)
def test_any_numbers_of_a_revolution_give_a_figure_or_none(
    tmp_path_factory, angle, measured, modelled, ends
):
    rows = min(map(len, (angle, measured, modelled, ends)))
    folders = empty_machine(tmp_path_factory.getbasetemp(), "odd")
    write_cutting_traces(folders, [{
        "recording": ["a"] * rows, "angle_deg": angle[:rows], "measured_x": measured[:rows],
        "modelled_x": modelled[:rows], "low_x": ends[:rows], "high_x": measured[:rows],
        "plain_x": ends[:rows]}])  # fmt: skip
    for one in cut_traces(folders, Shelf()):
        assert not NOT_A_NUMBER.search(str(revolution_figure(one, "x")))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.floats() | st.none(), min_size=3, max_size=3),
    st.lists(st.floats() | st.none(), min_size=2, max_size=2),
    st.lists(
        st.fixed_dictionaries({k: st.floats() | st.none() for k in ROW_KEYS}), max_size=4
    ),
)  # fmt: skip
def test_any_numbers_of_the_no_load_power_give_a_figure_or_none(values, ends, points):
    coefficients = {f"p{i}": {"value": v} for i, v in enumerate(values)}
    found = no_load({"spindle": {"no_load": {"coefficients": coefficients, "range_rpm": ends,
                                             "curve": points}}})  # fmt: skip
    assert found is None or not NOT_A_NUMBER.search(str(no_load_figure(found, "x")))


@pytest.mark.parametrize(
    ("names", "at_top"),
    [(("p0", "p1", "p2"), 84 + 3.2 * 200 + 0.021 * 200**2), (("p0", "p2"), 84 + 0.021 * 200**2)],
)
def test_the_no_load_curve_is_the_polynomial_of_revolutions_in_a_second(names, at_top):
    every = SPINDLE["no_load"]["coefficients"]
    document = {**SPINDLE["no_load"], "coefficients": {n: every[n] for n in names}}
    found = no_load({"spindle": {"no_load": document}})
    assert (found.speed[0], found.speed[-1]) == (600, 12_000)
    assert found.power[-1] == pytest.approx(at_top, rel=1e-12)


def test_no_curve_is_drawn_with_a_coefficient_that_nobody_knows():
    idle = SPINDLE["no_load"]
    coefficients = {**idle["coefficients"], "p1": cut_parameter(None, "W s")}
    lost = {**idle, "coefficients": coefficients}
    assert len(no_load({"spindle": {"no_load": lost}}).power) == 0
    assert no_load({"spindle": {"no_load": {**lost, "curve": []}}}) is None


def test_no_load_levels_stand_at_their_speed_and_the_band_about_its_curve():
    rows = [{"speed_rpm": n, "power_W": 100.0 + n / 20, "half_width_95_W": 40.0,
             "measured_W": 120.0 + n / 20} for n in (12_000, 3000, 6000)]  # fmt: skip
    idle = {"coefficients": {}, "range_rpm": [3000, 12_000], "curve": rows}
    drawn = str(no_load_figure(no_load({"spindle": {"no_load": idle}}), ""))
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


@pytest.mark.parametrize(
    ("runs", "cross", "first"),
    [
        ([(600, 3.0, "training"), (1200, 9.0, "judged"), (1500, 6.0, "judged")], [], 1200),
        ([(600, 3.0, "training"), (1200, 5.0, "training")], [(600, 9.0), (1200, 4.0)], 600),
    ],
)
def test_the_worst_and_the_best_of_what_was_not_learnt_from_are_drawn(tmp_path, runs, cross, first):
    folders = with_cutting(
        empty_machine(tmp_path, "m", "recorded"), [cut_run(f, e, role) for f, e, role in runs],
        [cut_run(f, e, **{"from": ["other"]}) for f, e in cross],
    )  # fmt: skip
    report(folders, tmp_path)
    captions = re.findall(r"One revolution of (\S+), (worst|best) predicted", section(
        tmp_path / "out/m.html", "forces"))  # fmt: skip
    second = {1200: 1500, 600: 1200}[first]
    assert list(dict.fromkeys(captions)) == [(name_of(first), "worst"), (name_of(second), "best")]


def test_a_single_recording_is_drawn_once(tmp_path):
    folders = with_cutting(empty_machine(tmp_path, "m", "recorded"), [cut_run(1200, 9.0)])
    report(folders, tmp_path)
    text = section(tmp_path / "out/m.html", "forces")
    assert text.count("<figure>") == 1 and "worst predicted" not in text


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    root = tmp_path_factory.mktemp("rig")
    folders = with_cutting(empty_machine(root, "rig", "recorded", credit="Records: Test Works"))
    write_report([folders], FLEET, None, root / "out")
    return root / "out" / "rig.html"


OVERLAPS = """
const found = [];
for (const plot of document.querySelectorAll('#cutting .plot, #forces .plot')) {
  const all = [...plot.querySelectorAll('text')].map(
    e => [e.textContent, e.getBoundingClientRect()]);
  all.forEach(([a, p], i) => all.slice(i + 1).forEach(([b, q]) => {
    if (p.left < q.right && q.left < p.right && p.top + 2 < q.bottom && q.top + 2 < p.bottom)
      found.push(a + ' | ' + b);
  }));
  all.forEach(([a, p]) => { if (p.left < 0 || p.right > innerWidth) found.push('cut off: ' + a); });
}
return found;
"""


@needs_browser
@pytest.mark.parametrize("width", [380, 768, 1280])
def test_words_of_the_figures_neither_overlap_nor_leave_the_page(browser, rig, width):
    look(browser, rig, width, "light")
    count = "return document.querySelectorAll('#cutting .plot, #forces .plot').length"
    assert browser.execute_script(count) == 3
    assert browser.execute_script(OVERLAPS) == []
    beyond = browser.execute_script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    assert beyond <= 0


def test_bands_stand_below_one_another():
    drawn = str(revolution_figure(shown(), ""))
    tops = [float(y) for y in re.findall(r'<svg x="0" y="([\d.]+)"', drawn)]
    assert np.all(np.diff(tops) > HEIGHT)
