"""Figures of part programs: feed classes, feed over time, bars, size."""

import math
import re

import numpy as np
import pytest
from control_folders import Programmer, part
from test_program_paths import moves

from pipeline.report.programs.map import map_figure
from pipeline.report.programs.panels import UNKNOWN, Classes
from pipeline.report.programs.simulated import feed_classes, lost_seconds
from pipeline.report.programs.times import (
    BINS,
    bars_figure,
    limit_bars,
    timeline,
    timeline_figure,
    tool_and_type_bars,
)
from pipeline.schema.program_cut import SimulatedProgram, ToolTime

LARGEST = 250_000  # bytes of a figure


def feeds(*values: float):
    return moves(*({"x": float(i), "reached_feed": f} for i, f in enumerate(values)))


@pytest.mark.parametrize(
    ("values", "bounds"),
    [
        ([800.0] * 5, ()),
        ([], ()),
        (list(np.geomspace(40, 4500, 400)), (100, 200, 500, 1000, 2000)),
        (list(np.linspace(1000, 2000, 400)), (1200, 1400, 1600, 1800)),
    ],
)
def test_bounds_of_classes_are_round_and_few(values, bounds):
    assert feed_classes([feeds(*values)] if values else []).bounds == bounds


def test_what_lies_on_a_bound_is_of_the_faster_class_and_nothing_of_none():
    classes = Classes(bounds=(100.0, 200.0))
    assert classes.of(np.array([99.9, 100.0, 200.0, np.nan])).tolist() == [0, 1, 2, UNKNOWN]
    assert [classes.words(i) for i in (0, 1, 2, UNKNOWN)] == [
        "below 100 mm/min", "100 to 200", "200 mm/min and more", "feed not known"
    ]  # fmt: skip
    assert [classes.colour(i) for i in (0, 2)] == ["f0", "f5"]  # both ends of the scale


def test_feed_over_time_shows_where_and_how_much_is_missing():
    program = moves(
        {"x": 1.0, "time": 10.0, "programmed_feed": 1000.0, "reached_feed": 500.0, "tool": 3},
        {"x": 2.0, "time": 10.0, "programmed_feed": 2000.0, "reached_feed": 2000.0, "tool": 7},
        {"kind": "rapid", "x": 9.0, "time": 20.0, "tool": 7},
    )
    shown = timeline(program)
    first, second, rapid = np.split(np.arange(BINS), [BINS // 4, BINS // 2])
    assert np.allclose(shown.share[first], 0.5) and np.allclose(shown.share[second], 1.0)
    assert np.allclose(shown.reached[first], 500) and np.allclose(shown.programmed[second], 2000)
    assert np.isnan(shown.share[rapid]).all() and set(shown.doing[rapid]) == {1}
    assert shown.tools == [(3, 0.0, 0.25), (7, 0.25, 1.0)]


def test_a_program_that_takes_no_time_has_no_time_axis():
    assert timeline(moves({"x": 1.0, "time": 0.0})) is None
    assert timeline(moves({"x": 1.0, "time": math.nan})) is None


def test_lost_time_is_what_exceeds_length_over_feed():
    program = moves({"x": 100.0, "programmed_feed": 6000.0, "time": 1.6},  # 1 s at that feed
                    {"x": 100.0, "time": 5.0},  # rotary axes alone: no path
                    {"kind": "rapid", "x": 0.0, "time": 9.0})  # fmt: skip
    assert lost_seconds(program) == pytest.approx(0.6)
    assert lost_seconds(moves({"kind": "rapid", "x": 1.0})) is None


def test_bars_are_as_long_as_the_times_that_they_name():
    program = SimulatedProgram(
        program="p", by_limit={"feed": 60.0, "corner": 30.0, "EXACT_STOP": 0.0},
        by_tool=(ToolTime(tool=4, time_s=20.0, cutting_s=12.0, rapid_s=5.0),),
    )  # fmt: skip
    drawn = bars_figure(limit_bars(program), 90.0, "label")
    widths = [float(w) for w in re.findall(r'width="([\d.]+)%" y', drawn)]
    assert widths[0] == pytest.approx(2 * widths[1]) and len(widths) == 2
    assert "30 s · 33" in re.sub(r"\s+", " ", drawn.replace("30.0", "30"))
    (head, (bar,)), *rest = tool_and_type_bars(program)
    assert (head, bar.name, rest) == ("By tool", "T4", [])
    assert [seconds for seconds, _ in bar.parts] == [12.0, 5.0, 3.0]


def test_more_tools_than_fit_are_summed_not_dropped():
    tools = tuple(ToolTime(tool=i, time_s=float(i + 1)) for i in range(30))
    ((_, bars),) = tool_and_type_bars(SimulatedProgram(program="p", by_tool=tools))
    assert len(bars) == 10 and bars[-1].name == "21 others"
    assert sum(bar.seconds for bar in bars) == pytest.approx(sum(range(1, 31)))


def scattered(count: int) -> Programmer:
    """Chords to random points at random feeds: no two alike, nothing to merge."""
    rng = np.random.default_rng(11)
    program = Programmer()
    for x, y, z, feed in zip(*rng.uniform(0, 300, (3, count)), rng.uniform(50, 6000, count),
                             strict=True):  # fmt: skip
        program.move("feed", feed, x=x, y=y, z=z)
    return program


@pytest.mark.parametrize("written", [scattered(30_000), part(chords=4000, passes=20)])
def test_a_figure_of_tens_of_thousands_of_moves_stays_small(written):
    program = moves(*written.rows, origin=written.origin)
    classes = feed_classes([program])
    assert len(map_figure(program, classes, "label")) < LARGEST
    assert len(timeline_figure(timeline(program), classes, "label")) < 60_000
