"""A program held against travel, spindle speeds, feeds and tool lengths of a machine."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import MachineLimits, Setup, Tool
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.twin.control import planned_program
from pipeline.twin.preflight import extents, limits_of, preflight, violation_lines

LIMITS = MachineLimits(
    travel={"X": (-100.0, 100.0), "Y": (-50.0, 50.0), "Z": (-200.0, 0.0)},
    spindle_rpm=(100.0, 12000.0), feed_mm_min=(1.0, 15000.0), tool_length_mm=(50.0, 200.0),
)  # fmt: skip
SETUP = Setup(
    limits=LIMITS, work_offsets={"G54": (0, 0, -180.0, 0, 0, 0)}, tools={1: Tool(length=120.0)}
)


def violations(text: str, setup: Setup = SETUP) -> list[tuple[int, str, float]]:
    moves = interpret(parse_program(text.encode(), "part.nc"), setup)
    found = preflight(moves, setup, limits_of(setup))
    return [(one.line, one.what, one.value) for one in found.violations]


@pytest.mark.parametrize(("text", "said"), [
    ("G0 X100 Y-50 Z180\nS12000 M3\nG1 X0 F15000\nM30\n", []),
    ("G0 X100.1\nX-5000\nM30\n", [(1, "X", 100.1), (2, "X", -5000.0)]),
    ("G91 G1 X60 F100\nX60\nX-60\nM30\n", [(2, "X", 120.0)]),
    ("S30000 M3\nG1 X5 F100\nX0\nM30\n", [(1, "S", 30000.0)]),
    ("S50 M3\nM30\n", [(1, "S", 50.0)]),
    ("S30000\nG1 X5 F100\nM30\n", []),  # the spindle stands
    ("G1 X5 F99000\nX0\nX5 F100\nX0 F99000\nM30\n", [(1, "F", 99000.0), (4, "F", 99000.0)]),
    ("S2000 M3\nG95 G1 X5 F8\nM30\n", [(2, "F", 16000.0)]),
    ("G93 G1 X50 F400\nM30\n", [(1, "F", 20000.0)]),
    ("G20\nG1 X1 F600\nM30\n", [(2, "F", 15240.0)]),
    # circle about Y40 of radius 20: its top passes the travel, its ends do not
    ("G0 X-20 Y40\nG2 X20 Y40 I20 J0 F100\nM30\n", [(2, "Y", 60.0)]),
    ("G0 X-20 Y40\nG3 X20 Y40 I20 J0 F100\nM30\n", []),
    ("G0 X90 Y0\nG2 I-20 F100\nM30\n", []),
    ("G0 X90 Y0\nG2 I20 F100\nM30\n", [(2, "X", 130.0)]),
])  # fmt: skip
def test_each_line_that_leaves_the_machine(text: str, said: list[tuple[int, str, float]]) -> None:
    assert violations(text) == [(line, what, pytest.approx(value)) for line, what, value in said]


def test_a_tools_length_counts_against_travel() -> None:
    """Z 70 of the program is Z -110 without the tool and +10 with its 120 mm."""
    text = "T1 M6\nG0 Z70\nG43 H1 Z70\nM30\n"
    assert violations(text) == [(3, "Z", pytest.approx(10.0))]
    moves = interpret(parse_program(text.encode(), "part.nc"), SETUP)
    (line,) = violation_lines(preflight(moves, SETUP, LIMITS).violations)
    assert line == (
        "line 3: Z moves to 10 mm in machine coordinates (G54+G43; T1 is 120 mm long), 10 mm "
        "above its travel of -200 to 0 mm"
    )
    long = replace(SETUP, tools={1: Tool(length=250.0)})
    assert (1, "length", 250.0) in violations(text, long)


def test_what_is_not_listed_is_named_and_not_checked() -> None:
    text = "T7 M6\nS99999 M3\nG0 X9999\nG2 I5 F99999\nM30\n"
    moves = interpret(parse_program(text.encode(), "part.nc"), Setup())
    found = preflight(moves, Setup(), limits_of(Setup()))
    assert found.violations == ()
    said = "; ".join(found.not_checked)
    for what in ("travel of X, Y", "spindle speed", "feed", "tool length", "length of T7"):
        assert what in said


def test_a_line_of_a_loop_is_said_once() -> None:
    text = "G65 P9 L3\nM30\nO9\nG0 X200\nX0\nM99\n"
    assert [(what, value) for _, what, value in violations(text)] == [("X", 200.0)]


@pytest.mark.parametrize("plane", ["G17", "G18", "G19"])
def test_extents_are_those_of_the_interpolated_path(plane: str) -> None:
    """Random arcs, spirals and helices: the independent path is sampled every 2 ms."""
    rng, letters = np.random.default_rng(1), {"G17": "XYIJ", "G18": "ZXKI", "G19": "YZJK"}[plane]
    axis = AxisParameters(
        rapid_speed=60000, cutting_speed=60000, rapid_acceleration=5000,
        cutting_acceleration=5000, arc_acceleration=50000, corner_jump=600,
    )  # fmt: skip
    control = ControlParameters(axes=dict.fromkeys("XYZ", axis), interpolation_period=0.002)
    for _ in range(8):
        a, b, i, j = rng.uniform(-20, 20, 4)
        angle, code = rng.uniform(-np.pi, np.pi), rng.choice(["G2", "G3"])
        u, v = a + i + np.hypot(i, j) * np.cos(angle), b + j + np.hypot(i, j) * np.sin(angle)
        text = (
            f"{plane} G0 {letters[0]}{a:.4f} {letters[1]}{b:.4f}\n{code} {letters[0]}{u:.4f} "
            f"{letters[1]}{v:.4f} {letters[2]}{i:.4f} {letters[3]}{j:.4f} F3000\nM30\n"
        )
        moves = interpret(parse_program(text.encode(), "arc.nc"), Setup())
        low, high = extents(moves)
        sampled = trace(planned_program(moves, control))
        rows = sampled.row == np.flatnonzero(moves.angle)[0]
        path = sampled.programmed[rows, :3] * 1e3
        arc = int(np.flatnonzero(moves.angle)[0])
        moved = np.isfinite(low[arc, :3])
        # 0.1 mm a sample: a quadrant is missed by at most 0.05²/2r, the ends by 0.1 mm
        least = np.fmin(low[arc], moves.start[arc])[:3]
        most = np.fmax(high[arc], moves.start[arc])[:3]
        assert np.all(np.abs(path.min(0) - least)[moved] < 0.11)
        assert np.all(np.abs(path.max(0) - most)[moved] < 0.11)


@pytest.mark.parametrize(("limits", "said"), [
    ({"travel": {"U": (0.0, 1.0)}}, "travel names U"),
    ({"travel": {"X": (5.0, -5.0)}}, r"travel.X = \[5, -5\] must rise"),
    ({"spindle_rpm": (12000.0, 0.0)}, "spindle_rpm"),
    ({"feed_mm_min": (-1.0, 5.0)}, "feed_mm_min = -1.0 must be"),
])  # fmt: skip
def test_limits_that_are_none_are_refused(limits: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        MachineLimits(**limits)  # type: ignore[arg-type]
