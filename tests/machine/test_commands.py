"""What takes time without moving: dwell, tool change, M codes, the spindle."""

import numpy as np
import pytest

from pipeline.gcode.moves import Kind
from pipeline.machine.control.parameters import AuxiliaryParameters
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import Writer, control, row_times

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
