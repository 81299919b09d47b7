"""Paths and figures of part programs: arcs as they are, strokes that lose nothing, feeds, bars."""

import math
import re

import numpy as np
import pyarrow as pa
import pytest
from control_folders import Programmer, part
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.report.programs.moves import (
    COLUMNS,
    MAP_UNITS,
    UNKNOWN,
    Classes,
    ProgramMoves,
    dots,
    map_figure,
    pieces,
    program_moves,
    stroke,
    view,
)
from pipeline.report.programs.panels import (
    BINS,
    bars_figure,
    cause_bars,
    timeline,
    timeline_figure,
    tool_bars,
)
from pipeline.report.programs.simulated import feed_classes
from pipeline.schema.program_cut import SimulatedProgram, ToolTime

NONE = math.nan


def moves(*rows: dict, origin=(0.0, 0.0, 0.0)) -> ProgramMoves:
    plain = {"kind": "feed", "x": 0.0, "y": 0.0, "z": 0.0, "cx": NONE, "cy": NONE, "cz": NONE,
             "angle": 0.0, "plane": 17, "programmed_feed": 1000.0, "reached_feed": 1000.0,
             "time": 1.0, "tool": 1}  # fmt: skip
    full = [{**plain, **row} for row in rows]
    return program_moves(pa.table({c: [r[c] for r in full] for c in COLUMNS}), tuple(origin))


QUARTERS = {  # start, centre, end and middle of a quarter turn of radius 10 in each plane
    17: ((10, 0, 3), (0, 0, 3), (0, 10, 3), (10 * math.sqrt(0.5), 10 * math.sqrt(0.5), 3)),
    18: ((0, 3, 10), (0, 3, 0), (10, 3, 0), (10 * math.sqrt(0.5), 3, 10 * math.sqrt(0.5))),
    19: ((3, 10, 0), (3, 0, 0), (3, 0, 10), (3, 10 * math.sqrt(0.5), 10 * math.sqrt(0.5))),
}


@pytest.mark.parametrize("plane", QUARTERS)
def test_a_positive_quarter_runs_anticlockwise_about_its_planes_normal(plane):
    start, (cx, cy, cz), (x, y, z), middle = QUARTERS[plane]
    arc = {"kind": "arc", "x": x, "y": y, "z": z, "cx": cx, "cy": cy, "cz": cz, "plane": plane}
    cut = pieces(moves({**arc, "angle": math.pi / 2}, origin=start), 1e-3)
    assert np.allclose(cut.a[0], start, atol=1e-12) and np.allclose(cut.b[-1], (x, y, z))
    nearest = np.linalg.norm(cut.a - middle, axis=1).min()
    assert nearest < 10 * math.pi / 2 / len(cut.a)  # a piece's length


@settings(max_examples=60, deadline=None)
@given(
    r=st.floats(0.5, 200), angle=st.floats(0.1, 6 * math.pi), sign=st.sampled_from([-1, 1]),
    tolerance=st.floats(0.02, 1),
)  # fmt: skip
def test_no_piece_leaves_its_arc_by_more_than_the_tolerance(r, angle, sign, tolerance):
    end = {"x": r * math.cos(sign * angle), "y": r * math.sin(sign * angle)}
    arc = {"kind": "arc", **end, "cx": 0.0, "cy": 0.0, "cz": 0.0, "angle": sign * angle}
    cut = pieces(moves(arc, origin=(r, 0.0, 0.0)), tolerance)
    middle = np.linalg.norm((cut.a + cut.b) / 2, axis=1)
    at_least_eight_a_turn = r * (1 - math.cos(math.pi / 8))
    assert r - middle.min() <= min(tolerance, at_least_eight_a_turn) + 1e-9
    assert np.allclose(cut.a[1:], cut.b[:-1])


def test_length_of_a_helix_of_three_turns():
    arc = {"kind": "arc", "x": 20.0, "z": -6.0, "cx": 0.0, "cy": 0.0, "cz": 0.0}
    helix = moves({**arc, "angle": 6 * math.pi}, origin=(20.0, 0.0, 0.0))
    cut = pieces(helix, 1e-3)
    # chords that leave their arc by 1e-3 of 20 mm are 3e-5 shorter than it: (1 - cos) / 1.5
    length = math.hypot(20 * 6 * math.pi, 6)
    assert np.linalg.norm(cut.b - cut.a, axis=1).sum() == pytest.approx(length, rel=5e-5)


def test_a_move_to_nowhere_is_left_out_and_an_arc_without_centre_is_straight():
    lost = moves({"x": 1.0}, {"x": NONE}, {"x": 3.0}, {"kind": "arc", "x": 9.0, "angle": 1.0})
    assert pieces(lost, 0.1).row.tolist() == [0, 3]


def drawn(data: str) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """Straight steps of path data, as pairs of points."""
    steps = []
    for stretch in re.findall(r"M[^M]*", data):
        values = list(map(int, re.findall(r"-?\d+", stretch)))
        here = (values[0], values[1])
        for dx, dy in zip(values[2::2], values[3::2], strict=True):
            there = (here[0] + dx, here[1] + dy)
            steps.append((here, there))
            here = there
    return steps


WALK = st.lists(st.tuples(st.integers(-3, 3), st.integers(-3, 3)), min_size=1, max_size=60)


@settings(max_examples=200, deadline=None)
@given(WALK, st.sets(st.integers(0, 59)))
def test_strokes_cover_each_piece_once(walk, lifted):
    points = np.cumsum([(0, 0), *walk], axis=0)
    keep = np.array([i not in lifted for i in range(len(walk))])
    a, b = points[:-1][keep], points[1:][keep]
    once = {
        frozenset((tuple(p), tuple(q)))
        for p, q in zip(a.tolist(), b.tolist(), strict=True) if p != q
    }  # fmt: skip
    steps = drawn(stroke(a, b))
    length = sum(math.dist(p, q) for p, q in steps)
    assert length == pytest.approx(sum(math.dist(*pair) for pair in once))
    ends = {point for pair in once for point in pair}
    assert {point for step in steps for point in step} <= ends
    assert all(p != q for p, q in steps)


def test_a_straight_chain_is_one_step_and_a_way_back_is_drawn_once():
    x = np.stack([np.arange(6), np.zeros(6, int)], axis=1)
    assert stroke(x[:-1], x[1:]) == "M0 0l5 0"
    assert stroke(np.vstack([x[:-1], x[:0:-1]]), np.vstack([x[1:], x[-2::-1]])) == "M0 0l5 0"
    assert stroke(x, x) == ""


def test_dots_stand_once_each():
    assert dots(np.array([[4, 5], [4, 5], [-1, 2]])) == "M-1 2h0M4 5h0"


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(*[st.floats(-500, 500)] * 3), min_size=1, max_size=12))
def test_the_frame_holds_all_that_is_cut_in_fair_proportions(points):
    program = moves(*({"x": x, "y": y, "z": z} for x, y, z in points), origin=points[0])
    frame = view(program)
    ends = np.array(points)
    assert np.all(ends >= frame.low - 1e-9) and np.all(ends <= frame.low + frame.span + 1e-9)
    wide, above, front = frame.span
    assert 0.27 * wide <= above <= 1.01 * wide and 0.13 * wide <= front <= 0.71 * wide


def test_rapids_do_not_widen_the_frame():
    program = moves({"kind": "rapid", "z": 400.0}, {"kind": "rapid", "x": 5.0, "z": 1.0},
                    {"x": 30.0, "y": 10.0, "z": 1.0})  # fmt: skip
    frame = view(program)
    assert frame.low[2] + frame.span[2] < 10.0
    assert frame.span[0] / MAP_UNITS < 0.1


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
    assert np.allclose(shown.programmed[first], 1000) and np.allclose(shown.reached[first], 500)
    assert np.allclose(shown.reached[second], shown.programmed[second])
    assert np.isnan(shown.reached[rapid]).all() and set(shown.doing[rapid]) == {1}
    assert shown.tools == [(3, 0.0, 0.25), (7, 0.25, 1.0)]


def test_a_program_that_takes_no_time_has_no_time_axis():
    assert timeline(moves({"x": 1.0, "time": 0.0})) is None
    assert timeline(moves({"x": 1.0, "time": math.nan})) is None


def test_bars_are_as_long_as_the_times_that_they_name():
    program = SimulatedProgram(
        program="p", by_cause={"feed": 60.0, "corner": 30.0, "exact stop": 0.0},
        by_tool=(ToolTime(tool=4, time_s=20.0, cutting_s=12.0, rapid_s=5.0),),
    )  # fmt: skip
    drawn = bars_figure(cause_bars(program), 90.0, "label")
    widths = [float(w) for w in re.findall(r'width="([\d.]+)%" y', drawn)]
    assert widths[0] == pytest.approx(2 * widths[1]) and len(widths) == 2
    assert "30 s · 33" in re.sub(r"\s+", " ", drawn.replace("30.0", "30"))
    (head, (bar,)), *rest = tool_bars(program)
    assert (head, bar.name, rest) == ("By tool", "T4", [])
    assert [seconds for seconds, _ in bar.parts] == [12.0, 5.0, 3.0]


def test_more_tools_than_fit_are_summed_not_dropped():
    tools = tuple(ToolTime(tool=i, time_s=float(i + 1)) for i in range(30))
    ((_, bars),) = tool_bars(SimulatedProgram(program="p", by_tool=tools))
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
