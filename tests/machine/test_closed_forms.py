"""Moves whose time is known in closed form."""

import numpy as np
import pytest

from pipeline.gcode.moves import FeedMode, Kind, PathMode
from pipeline.machine.control.parameters import AuxiliaryParameters, ControlParameters
from pipeline.machine.control.path import Binding
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import Writer, axis, control, row_times

EXACT = 1e-9  # planner and closed form are the same formula up to rounding


def planned(writer, control):
    return plan(limited_path(writer.moves, control))


def total(writer, control):
    return planned(writer, control).total


def test_trapezoid_reaches_its_feed():
    # 3000 mm/min = 0.05 m/s, 2 m/s^2: L / v + v / a
    writer = Writer().set(feed=3000).to(X=100)
    assert total(writer, control()) == pytest.approx(0.1 / 0.05 + 0.05 / 2, rel=EXACT)


def test_triangle_does_not():
    writer = Writer().set(feed=15000).to(X=1)
    result = planned(writer, control())
    assert result.total == pytest.approx(2 * np.sqrt(0.001 / 2), rel=EXACT)
    assert result.v_peak[0] == pytest.approx(np.sqrt(2 * 0.001), rel=EXACT)
    assert result.limit[0] == Binding.EXACT_STOP


def test_slowest_axis_rules_a_slanted_line():
    axes = {
        "X": axis(cutting_speed=6000, cutting_acceleration=1000),
        "Y": axis(cutting_speed=3000, cutting_acceleration=4000),
    }
    writer = Writer().set(feed=20000).to(X=30, Y=40)
    # Y allows 0.05 / 0.8 m/s, X 1 / 0.6 m/s^2
    v, a = 0.05 / 0.8, 1 / 0.6
    result = planned(writer, ControlParameters(axes=axes))
    assert result.total == pytest.approx(0.05 / v + v / a, rel=EXACT)
    assert result.limit[0] == Binding.AXIS_SPEED


@pytest.mark.parametrize("length", [0.01, 0.5, 4.0, 300.0])
def test_seven_phases_from_rest_to_rest(length):
    a, jerk, v = 2.0, 50.0, 0.25
    distance = length * 1e-3
    short = 32 ** (1 / 3) * (distance / jerk) ** (1 / 3)  # four phases of jerk
    if (short / 4) * jerk > a:
        top = (-(a**2) / jerk + np.sqrt(a**4 / jerk**2 + 4 * a * distance)) / 2
        short = distance / top + top / a + a / jerk if top < v else np.inf
    long = distance / v + v / a + a / jerk
    writer = Writer().set(feed=15000).to(Y=length)
    result = total(writer, control(profile="s_curve", limits={"jerk": 50000}))
    assert result == pytest.approx(min(short, long), rel=EXACT)


def test_corner_is_passed_with_the_jump_that_it_allows():
    # a right angle: each axis jumps by v; 400 mm/min = 1 / 150 m/s
    writer = Writer().set(feed=3000).to(X=50).to(Y=50)
    result = planned(writer, control())
    corner = 400 / 60e3
    v, a = 0.05, 2.0
    one = (v / a) + (v - corner) / a + (0.05 - (2 * v**2 - corner**2) / (2 * a)) / v
    assert result.v_out[0] == pytest.approx(corner, rel=EXACT)
    assert result.time.tolist() == pytest.approx([one, one], rel=EXACT)


def test_return_jumps_by_twice_the_speed():
    writer = Writer().set(feed=3000).to(X=50).to(X=0)
    assert planned(writer, control()).v_out[0] == pytest.approx(200 / 60e3, rel=EXACT)


def test_circle_is_bound_by_its_centripetal_acceleration():
    writer = Writer().set(feed=15000).arc((5, 0), 2 * np.pi)
    v, length = np.sqrt(1.0 * 0.005), 2 * np.pi * 0.005
    result = planned(writer, control())
    assert result.total == pytest.approx(length / v + v / 2, rel=EXACT)
    assert result.limit[0] == Binding.ARC


def test_small_arc_counts_only_the_directions_it_has():
    # 2 deg about phi = 0: the acceleration is along X, speed along Y; X may speed up only weakly
    axes = {"X": axis(cutting_acceleration=100), "Y": axis(), "Z": axis()}
    writer = Writer((100, 0, 0, 0, 0, 0)).set(feed=15000).arc((0, 0), np.deg2rad(2))
    path = limited_path(writer.moves, ControlParameters(axes=axes))
    assert path.acceleration[0] == pytest.approx(2.0, rel=EXACT)
    assert path.cap[0] == pytest.approx(min(np.sqrt(0.1), 0.25), rel=EXACT)


def test_helix_has_the_length_of_its_thread_and_its_lesser_curvature():
    radius, rise, turns = 4.0, 3.0, 5
    writer = Writer((radius, 0, 0, 0, 0, 0)).set(feed=15000)
    writer.arc((0, 0), 2 * np.pi * turns, rise=rise * turns)
    pitch = rise / (2 * np.pi)
    length = turns * 2 * np.pi * np.hypot(radius, pitch) * 1e-3
    curvature = radius / (radius**2 + pitch**2) * 1e3
    v = np.sqrt(1.0 / curvature)
    a = 2.0 * np.hypot(radius, pitch) / radius  # X and Y go slower than the path
    result = planned(writer, control())
    assert result.path.length[0] == pytest.approx(length, rel=EXACT)
    assert result.total == pytest.approx(length / v + v / a, rel=EXACT)


@pytest.mark.parametrize("growth", [1e-7, 1e-3, 0.8, 20.0])
def test_spiral_has_the_length_that_moves_gives_it(growth):
    moves = Writer((2, 1, 0, 0, 0, 0)).arc((0, 0), 5.0, rise=0.3, growth=growth).moves
    length = limited_path(moves, control()).length[0]
    # 16 points of Gauss on a smooth integrand; the steep spiral is the hardest
    assert length * 1e3 == pytest.approx(moves.length[0], rel=1e-9)


def test_circle_of_chords_is_as_fast_as_the_arc():
    """The rule for dense corners in the limit of short chords, in all directions the same."""
    radius, chords = 5.0, 720
    angle = np.linspace(0, 2 * np.pi, chords + 1)[1:]
    writer = Writer((radius, 0, 0, 0, 0, 0)).set(feed=15000)
    for phi in angle:
        writer.to(X=radius * np.cos(phi), Y=radius * np.sin(phi))
    speed = limited_path(writer.moves, control()).cap[5:-5]
    # the axis that turns most is the one that bounds; at 45 deg both do less by sqrt(2)
    most = np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))[5:-5]
    assert speed == pytest.approx(np.sqrt(0.005 / most), rel=0.01)


def test_inverse_time_takes_its_time():
    writer = Writer().set(feed=2.0, feed_mode=FeedMode.INVERSE_TIME).to(X=100)
    v = 0.1 / 30  # half a minute
    assert total(writer, control()) == pytest.approx(30 + v / 2, rel=EXACT)


def test_feed_per_revolution_follows_the_spindle():
    writer = (
        Writer().set(feed=0.2, feed_mode=FeedMode.PER_REVOLUTION, speed=1500, direction=1).to(X=100)
    )
    path = limited_path(writer.moves, control())
    assert plan(path).total == pytest.approx(0.1 / 0.005 + 0.005 / 2, rel=EXACT)
    assert plan(path, speeds=[3000]).total == pytest.approx(0.1 / 0.01 + 0.01 / 2, rel=EXACT)


def test_constant_surface_speed_turns_by_the_greater_diameter():
    writer = Writer((40, 0, 0, 0, 0, 0)).set(
        feed=0.5, feed_mode=FeedMode.PER_REVOLUTION, speed=120, direction=1,
        constant_surface_speed=True,
    ).to(X=20)  # fmt: skip
    turns = 120 / (2 * np.pi * 0.04)
    v = 0.5e-3 * turns / 60
    assert total(writer, control()) == pytest.approx(0.02 / v + v / 2, rel=EXACT)


def test_rotary_axis_reads_its_feed_in_degrees():
    writer = Writer().set(feed=3600).to(A=90)
    a = np.deg2rad(2000)
    v = np.deg2rad(60)
    assert total(writer, control(letters="XYZA")) == pytest.approx(1.5 + v / a, rel=EXACT)


def test_rotary_axis_beside_a_line_counts_by_its_own_limits():
    # 10 mm and 90 deg: A may turn by 15000 deg/min, so 10 mm take 0.36 s at least
    writer = Writer().set(feed=15000).to(X=10, A=90)
    assert limited_path(writer.moves, control(letters="XA")).cap[0] == pytest.approx(0.01 / 0.36)


def test_rapid_in_a_line_or_each_axis_by_itself():
    writer = Writer().rapid(X=300, Y=40)
    v, a = 0.5, 5.0
    alone = 0.3 / v + v / a  # X takes longest; Y would be there before
    slope = np.hypot(300, 40) / 300
    together = 0.3 * slope / (v * slope) + v / a
    assert total(writer, control(rapid_mode="independent")) == pytest.approx(alone, rel=EXACT)
    assert total(writer, control()) == pytest.approx(together, rel=EXACT)


def test_filters_run_empty_at_each_standstill_only():
    filters = {"cutting_filter": (0.012, 0.02), "settle_time": 0.005}
    path = PathMode.EXACT_STOP
    through = Writer().set(feed=3000).to(X=50).to(X=100)
    stopped = Writer().set(feed=3000).set(path_mode=path).to(X=50).to(X=100)
    one = 0.1 / 0.05 + 0.05 / 2 + 0.032
    assert total(through, control(**filters)) == pytest.approx(one, rel=EXACT)
    two = 2 * (0.05 / 0.05 + 0.05 / 2 + 0.032 + 0.005)
    assert total(stopped, control(**filters)) == pytest.approx(two, rel=EXACT)


def test_mixed_rapid_and_feed_stop_between():
    writer = Writer().set(feed=3000).rapid(X=-10).to(X=90).row(Kind.END)
    rapid = 2 * np.sqrt(0.01 / 5)
    feed = 0.1 / 0.05 + 0.05 / 2
    assert total(writer, control(settle_time=0.01)) == pytest.approx(rapid + feed + 0.02, rel=EXACT)
    through = Writer().set(feed=3000).rapid(X=10).to(X=90)
    plan_through = planned(through, control(rapid_stop="never"))
    assert plan_through.v_out[0] == pytest.approx(0.05, rel=EXACT)


MOVE = 0.1 / 0.05 + 0.05 / 2  # 100 mm at 3000 mm/min and 2 m/s^2
SPINDLE = {"spindle_acceleration": 2000.0, "spindle_delay": 0.1}


def times(writer, **auxiliary):
    path = limited_path(writer.moves, control(auxiliary=AuxiliaryParameters(**auxiliary)))
    return plan(path).time.tolist()


def start():
    return Writer().set(feed=3000)


def test_dwell_in_seconds_and_in_revolutions():
    writer = start().row(Kind.DWELL, value=0.7)
    writer.set(speed=1200, direction=1).row(Kind.DWELL, value=5, code=1)
    assert times(writer) == pytest.approx([0.7, 0.25])


@pytest.mark.parametrize("value", [-1, np.nan])
def test_dwell_that_cannot_be_is_refused(value):
    with pytest.raises(ValueError, match=r"part\.nc:1: dwell of"):
        times(start().row(Kind.DWELL, value=value))


def test_revolutions_of_a_standing_spindle_are_refused():
    with pytest.raises(ValueError, match=r"dwell of 3\.0 rev with the spindle standing"):
        times(start().row(Kind.DWELL, value=3, code=1))


def test_tool_change_takes_its_own_and_the_tools_time():
    writer = start().set(tool=4).row(Kind.TOOL_CHANGE).set(tool=7).row(Kind.TOOL_CHANGE)
    assert times(writer, tool_change=3.0, tools={7: 1.5}) == [3.0, 4.5]


def test_m_codes_by_number_stops_and_end():
    writer = start().row(Kind.M_CODE, code=8).row(Kind.M_CODE, code=10)
    writer.row(Kind.STOP).row(Kind.END)
    assert times(writer, m_code=0.2, m_codes={8: 0.5}, stop=9.0) == [0.5, 0.2, 9.0, 0.0]


def test_m_code_stops_the_axes_unless_it_flies():
    writer = start().to(X=100).row(Kind.M_CODE, code=8).to(X=200)
    assert times(writer, m_codes={8: 0.5}) == pytest.approx([MOVE, 0.5, MOVE])
    flying = times(writer, m_codes={8: 0.5}, flying_m_codes=(8,))
    assert flying[1] == 0
    assert sum(flying) == pytest.approx(0.2 / 0.05 + 0.05 / 2)


def test_spindle_is_waited_for_at_its_code():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE).to(X=100)
    writer.set(direction=0).row(Kind.SPINDLE)
    assert times(writer, **SPINDLE) == pytest.approx([1.6, MOVE, 1.6])


def test_reversal_takes_both_speeds():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE)
    writer.set(direction=-1, speed=1000).row(Kind.SPINDLE)
    assert times(writer, **SPINDLE) == pytest.approx([1.6, 2.1])


def test_new_speed_of_a_turning_spindle_is_waited_for_only_where_that_is_asked():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE).to(X=100)
    writer.set(speed=1000).row(Kind.SPINDLE).to(X=200)
    through = times(writer, **SPINDLE)
    assert sum(through) == pytest.approx(1.6 + 0.2 / 0.05 + 0.05 / 2)
    waiting = times(writer, speed_change_waits=True, **SPINDLE)
    assert waiting == pytest.approx([1.6, MOVE, 1.1, MOVE])


def test_rapids_go_on_while_the_spindle_runs_up():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE).rapid(X=300).to(X=400)
    rapid = 0.3 / 0.5 + 0.5 / 5
    found = times(writer, spindle_wait="before_cutting", **SPINDLE)
    assert sum(found) == pytest.approx(1.6 + MOVE)
    assert found[2] == pytest.approx(MOVE)
    slow = {"spindle_acceleration": 1e5}
    assert sum(times(writer, spindle_wait="before_cutting", **slow)) == pytest.approx(rapid + MOVE)


def test_nothing_waits_for_a_spindle_that_is_not_waited_for():
    writer = start().to(X=100).set(speed=3000, direction=1).row(Kind.SPINDLE).to(X=200)
    assert sum(times(writer, spindle_wait="none", **SPINDLE)) == pytest.approx(0.2 / 0.05 + 0.025)


def test_orientation_adds_its_time():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE)
    writer.set(direction=0).row(Kind.SPINDLE, code=19)
    assert times(writer, spindle_orientation=0.4, **SPINDLE) == pytest.approx([1.6, 2.0])


def test_a_population_of_speeds_has_its_own_run_ups():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE).rapid(X=300).to(X=400)
    parameters = control(auxiliary=AuxiliaryParameters(spindle_wait="before_cutting", **SPINDLE))
    path = limited_path(writer.moves, parameters)
    speeds = np.array([[3000.0] * 3, [6000.0] * 3, [100.0] * 3])
    expected = [plan(path, speeds=s).time for s in speeds]
    assert row_times(path, np.tile(path.moves.feed, (3, 1)), speeds) == pytest.approx(
        np.array(expected)
    )


def test_above_its_base_speed_the_spindle_gains_slower():
    # constant power: n dn/dt = alpha n_b
    writer = start().set(speed=6000, direction=1).row(Kind.SPINDLE)
    writer.set(direction=0).row(Kind.SPINDLE)
    n = np.linspace(0, 6000, 200_001)
    slowness = np.maximum(n, 3000) / (2000 * 3000)
    up = float(np.trapezoid(slowness, n))
    found = times(
        writer, spindle_acceleration=2000, spindle_base_speed=3000, spindle_deceleration=4000
    )
    assert found == pytest.approx([up, up / 2], rel=1e-8)


def test_next_line_waits_for_what_its_own_line_does_not():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE).rapid(X=300).to(X=400)
    moves = writer.moves
    moves.line[:] = [1, 1, 2]
    parameters = AuxiliaryParameters(spindle_wait="next_line", **SPINDLE)
    found = plan(limited_path(moves, control(auxiliary=parameters))).time
    assert found[:2].sum() == pytest.approx(1.6)
    assert found[2] == pytest.approx(MOVE)


def test_stopping_spindle_is_waited_for_only_by_what_needs_it_at_rest():
    writer = start().set(speed=3000, direction=1).row(Kind.SPINDLE)
    writer.set(direction=0).row(Kind.SPINDLE).to(X=20).row(Kind.TOOL_CHANGE)
    found = times(writer, spindle_stop_wait="before_change", tool_change=2.0, **SPINDLE)
    # the move of 20 mm takes less than the 1.6 s of the spindle
    assert sum(found) == pytest.approx(1.6 + 1.6 + 2.0)
