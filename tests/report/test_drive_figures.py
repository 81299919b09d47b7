"""Figures of the drives: where things stand, odd records, whether words overlap."""

import re
from itertools import pairwise

import numpy as np
import pytest
from drive_folders import (
    RUNS,
    axis_document,
    drive_run,
    recursive,
    trace,
    with_drives,
    write_traces,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from report_folders import FLEET, empty_machine

from pipeline.charts import svg
from pipeline.charts.sources import Shelf
from pipeline.report.drive_frame import UNITS, Band, band
from pipeline.report.drive_friction_figure import friction_figure, friction_shown
from pipeline.report.drive_inertia_figure import inertia_figure, inertia_shown
from pipeline.report.drive_trace_figure import closest_look, drawn_bands, trace_figure, whole
from pipeline.report.drive_traces import DriveTrace, drive_traces
from pipeline.report.driven import Driven
from pipeline.report.pages import write_report
from tests.browser import look, needs_browser

NOT_A_NUMBER = re.compile(r"(?<![a-z])(nan|inf)(?![a-z])", re.I)


def points(*rows: tuple[float, float, float]) -> dict:
    return {
        "force_unit": "N",
        "friction_points": [
            {"velocity_mm_s": v, "force": f, "half_width": h, "seconds": 1.0} for v, f, h in rows
        ],
    }


def circles(drawn: str, kind: str) -> np.ndarray:
    """Places (N, 2) of the points of one direction: percent, pixels."""
    found = re.findall(rf'<circle cx="([\d.]+)%" cy="([\d.]+)" r="3.5" class="point {kind}"', drawn)
    return np.array(found, dtype=float)


def test_speeds_of_equal_ratio_stand_at_equal_distances():
    shown = friction_shown(points((0.1, 400, 1), (1, 300, 1), (10, 250, 1), (100, 300, 1)))
    x = circles(str(friction_figure(shown, "")), "p-positive")[:, 0]
    assert np.diff(x) == pytest.approx(np.diff(x)[0], abs=0.02)  # two decimals of a percent
    assert 0 < x[0] < x[-1] < 100


def test_both_directions_share_one_scale_of_force_against_motion():
    shown = friction_shown(points((5, 300, 1), (-5, -300, 1), (-50, -400, 1)))
    drawn = str(friction_figure(shown, ""))
    there, back = circles(drawn, "p-positive"), circles(drawn, "p-negative")
    assert np.array_equal(there[0], back[0])
    assert back[1, 1] < back[0, 1]  # a larger force stands higher


def test_error_bars_are_as_long_as_their_intervals_and_centred_on_their_points():
    shown = friction_shown(points((1, 300, 20), (10, 250, 40), (100, 320, 0)))
    drawn = str(friction_figure(shown, ""))
    path = re.search(r'<path d="([^"]*)" class="curve bar-positive"', drawn).group(1)
    bars = np.array(re.findall(r"M(\d+) (\d+)v(\d+)", path), dtype=float)
    dots = circles(drawn, "p-positive")
    assert len(bars) == 2  # of no width there is no bar
    assert bars[1, 2] / bars[0, 2] == pytest.approx(2.0, rel=0.01)  # whole units of 1000
    middle = 18 + 260 * (bars[:, 1] + bars[:, 2] / 2) / svg.FULL
    assert middle == pytest.approx(dots[:2, 1], abs=0.3)
    assert bars[:, 0] / UNITS * 100 == pytest.approx(dots[:2, 0], abs=0.05)


def test_one_wide_interval_does_not_flatten_the_curve():
    shown = friction_shown(points((1, 400, 5), (10, 300, 4000), (100, 500, 5)))
    y = circles(str(friction_figure(shown, "")), "p-positive")[:, 1]
    assert np.ptp(y) > 0.3 * 260  # 200 N on a scale from 0 to 530 N


def test_the_curve_is_cut_where_nothing_was_measured():
    axis = points((4, 300, 1), (80, 350, 1))
    axis["friction_curve"] = [{"velocity_mm_s": float(v), "force": 300.0 + v}
                              for v in np.geomspace(1e-4, 100, 200)]  # fmt: skip
    drawn = str(friction_figure(friction_shown(axis), ""))
    path = re.search(r'<path d="M(-?\d+) [^"]*" class="curve curve-positive"', drawn)
    assert 0 <= int(path.group(1)) < 0.02 * UNITS  # one step of the curve, 7 % of a decade
    assert "0.1<" not in drawn and ">5<" in drawn


def test_the_longest_stretches_are_drawn_when_there_are_too_many():
    axis = points(*((1 + i, 300, 1) for i in range(900)))
    for i, row in enumerate(axis["friction_points"]):
        row["seconds"] = float(i)
    shown = friction_shown(axis)
    assert shown.count == 300
    assert shown.points["positive"].speed.min() == 601


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.fixed_dictionaries(
            {
                "velocity_mm_s": st.floats() | st.none() | st.text(max_size=2),
                "force": st.floats() | st.none(),
                "half_width": st.floats() | st.none(),
                "seconds": st.floats() | st.none(),
            }
        ),
        max_size=6,
    )
)
def test_any_numbers_of_friction_give_a_figure_or_none(rows):  # fmt: skip
    shown = friction_shown({"friction_points": rows, "friction_curve": rows[:3]})
    assert shown is None or not NOT_A_NUMBER.search(str(friction_figure(shown, "x")))


SOME = st.lists(st.floats(), min_size=3, max_size=9)


@settings(max_examples=60, deadline=None)
@given(SOME, SOME, SOME)
def test_any_numbers_of_a_trace_give_a_figure_or_none(
    tmp_path_factory, measured, modelled, seconds
):
    rows = min(len(measured), len(modelled), len(seconds))
    folders = empty_machine(tmp_path_factory.getbasetemp(), "odd")
    write_traces(folders, [{
        "axis": ["X"] * rows, "recording": ["a"] * rows, "time_s": seconds[:rows],
        "following_measured_um": measured[:rows], "following_modelled_um": modelled[:rows],
        "command_measured": measured[:rows]}])  # fmt: skip
    drawn = Driven(traces=drive_traces(folders, Shelf())).telling("X")
    if drawn is None:
        return
    bands = drawn_bands(drawn, "A")
    for span in (whole(drawn), closest_look(drawn)):
        if span is not None and bands:
            assert not NOT_A_NUMBER.search(str(trace_figure(drawn, bands, span, "x")))


@settings(max_examples=60, deadline=None)
@given(SOME, SOME, SOME)
def test_any_numbers_of_a_recursive_estimate_give_a_figure_or_none(seconds, value, half):
    found = {"time_s": seconds, "value": value, "half_width": half, "unit": "kg"}
    shown = inertia_shown({"recursive": found, "parameters": {"mass": {"value": value[0]}}})
    assert shown is None or not NOT_A_NUMBER.search(str(inertia_figure(shown, "x")))


def shown_trace(**values) -> DriveTrace:
    made = trace("a", "X", rows=2000)
    curves = {k: np.array(v) for k, v in {**made, **values}.items() if k not in (
        "axis", "recording", "role", "time_s", "reference_mm")}  # fmt: skip
    return DriveTrace(axis="X", recording="a", seconds=made["time_s"], values=curves)


def test_the_close_look_is_where_the_model_is_farthest_off():
    quiet = shown_trace()
    modelled = quiet.values["following_modelled_um"].copy()
    modelled[[700, 1999]] += [400.0, 500.0]
    one = shown_trace(following_modelled_um=modelled)
    start, end = closest_look(one)
    assert end == one.seconds[-1] and end - start == pytest.approx(0.08 * 24.6)
    modelled[1999] = np.nan
    start, end = closest_look(shown_trace(following_modelled_um=modelled))
    assert (start + end) / 2 == pytest.approx(one.seconds[700])


def test_a_record_too_short_to_look_closer_is_drawn_once():
    made = shown_trace()
    short = DriveTrace(axis="X", recording="a", seconds=made.seconds / 30, values=made.values)
    assert closest_look(short) is None


@pytest.mark.parametrize(("largest", "unit"), [(2990.0, "µm"), (3010.0, "mm")])
def test_large_following_errors_are_drawn_in_millimetres(largest, unit):
    measured = np.linspace(-largest, 0, 2000)
    bands = drawn_bands(shown_trace(following_measured_um=measured,
                                    following_modelled_um=measured * 0.9), "A")  # fmt: skip
    shown = next(b for b in bands if b.head == f"Following error, {unit}")
    factor = 1e-3 if unit == "mm" else 1.0
    assert shown.curves["measured"].min() == pytest.approx(-largest * factor)
    left = next(b for b in bands if b.head == f"Modelled less measured, {unit}")
    assert left.curves["modelled"].max() == pytest.approx(0.1 * largest * factor)


def test_what_was_not_recorded_has_no_band():
    nothing = np.full(2000, np.nan)
    bands = drawn_bands(shown_trace(following_measured_um=nothing, following_modelled_um=nothing),
                        "V")  # fmt: skip
    assert [b.head for b in bands] == ["Speed, mm/s", "Command, V"]
    alone = {"following_measured_um": nothing, "command_modelled": nothing}
    assert drawn_bands(shown_trace(**alone), "V") == []


def test_a_judged_recording_tells_more_than_a_longer_one_that_was_learnt_from():
    runs = {
        "X": [
            drive_run("long", 1, 1, "training", seconds=90.0),
            drive_run("short", 1, 1, seconds=5.0),
            drive_run("middle", 1, 1, seconds=9.0),
        ]
    }
    traces = [DriveTrace(axis="X", recording=name, seconds=np.arange(3.0), values={})
              for name in ("long", "middle", "short")]  # fmt: skip
    drives = Driven(validation={"axes": runs}, traces=traces)
    assert drives.telling("X").recording == "middle"
    assert Driven(validation={"axes": RUNS}, traces=traces[:1]).telling("X").recording == "long"
    assert drives.telling("Y") is None


def test_the_batch_value_stands_at_its_level_and_only_if_it_was_determined():
    axis = axis_document("X")
    drawn = str(inertia_figure(inertia_shown(axis), ""))
    level = float(re.search(r'<line x1="0" x2="100%" y1="([\d.]+)" [^>]*class="batch"', drawn)[1])
    grid = dict(re.findall(r'<text x="0%" y="([\d.]+)" dx="-6" class="tick end">(\d+)<', drawn))
    heights = {float(value): float(y) - 4 for y, value in grid.items()}
    low, high = min(heights), max(heights)
    share = (420.0 - low) / (high - low)
    assert level == pytest.approx(heights[low] + share * (heights[high] - heights[low]), abs=0.1)
    axis["parameters"]["mass"]["determined"] = False
    assert 'class="batch"' not in str(inertia_figure(inertia_shown(axis), ""))


def test_a_wide_start_does_not_flatten_the_rest_of_the_estimate():
    found = recursive()
    found["half_width"][0], found["value"][1] = 1e6, -1e5
    drawn = str(inertia_figure(inertia_shown({**axis_document("X"), "recursive": found}), ""))
    assert ">450<" in drawn and ">500<" in drawn


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20), st.booleans())
def test_a_band_holds_all_its_values_upright(values, zero):
    into = band(10.0, 100.0, np.array(values), zero=zero)
    drawn = [into.pixel(v) for v in sorted(values)]
    assert all(10.0 < y < 110.0 for y in drawn)
    assert all(a >= b for a, b in pairwise(drawn))
    assert not zero or into.low < 0 < into.high
    assert isinstance(into, Band)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    root = tmp_path_factory.mktemp("rig")
    folders = with_drives(empty_machine(root, "rig", "recorded", credit="Records: Test Works"))
    write_report([folders], FLEET, None, root / "out")
    return root / "out" / "rig.html"


OVERLAPS = """
const found = [];
for (const plot of document.querySelectorAll('#drives .plot, #following .plot')) {
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
    assert (
        browser.execute_script("return document.querySelectorAll('#following .plot').length") == 6
    )
    assert browser.execute_script(OVERLAPS) == []
    beyond = browser.execute_script(
        "return document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )
    assert beyond <= 0
