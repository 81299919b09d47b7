"""A program on axes: what is far behind, where, against the closed form of the lag."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.schema.model import Condition
from pipeline.twin.control import planned_program
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import (
    AxisFigures,
    between,
    commanded_positions,
    driven,
    driven_by_fuzzy,
    follow_program,
    program_figures,
)

GAIN, FEED = 40.0, 3000.0
PROGRAM = b"G21 G90 G94\nG1 X200 F3000\nY20 F600\nG4 P500\nM30\n"
AXIS = AxisParameters(
    rapid_speed=20000, cutting_speed=15000, rapid_acceleration=2000, cutting_acceleration=2000,
    arc_acceleration=1000, corner_jump=0,
)  # fmt: skip


def drive(**servo: float) -> IdentifiedDrive:
    one = DirectionFriction(coulomb=100.0, static=120.0, stribeck_velocity=0.005, viscous=500.0)
    return IdentifiedDrive(
        feed_drive=FeedDriveParameters(
            mass=800.0, force_constant=400.0,
            friction=FrictionParameters(positive=one, negative=one),
        ),
        servo=ServoParameters(
            position_gain=GAIN, velocity_gain=600.0, integral_gain=30000.0, **servo
        ),
        command_unit="A", force_unit="N",
    )  # fmt: skip


@pytest.fixture(scope="module")
def plan():
    moves = interpret(parse_program(PROGRAM, "lag"), Setup())
    return planned_program(moves, ControlParameters(axes={"X": AXIS, "Y": AXIS, "Z": AXIS}))


def test_at_constant_feed_an_axis_is_behind_by_speed_over_loop_gain(plan) -> None:
    found = follow_program(plan, {"X": drive(), "Y": drive()})
    for letter, feed in (("X", FEED), ("Y", 600.0)):
        expected = feed / 60e3 / GAIN
        one = found[letter]
        # most of the way is run at constant feed: there the integral leaves nothing but the lag
        steady = np.abs(one.error - expected) < 1e-6
        assert steady.sum() > 500
    # the command there is friction over the force constant
    x = found["X"]
    middle = int(np.argmin(np.abs(x.time - 2.0)))
    assert x.command[middle] == pytest.approx((100 + 500 * FEED / 60e3) / 400, rel=1e-4)


def test_the_worst_place_is_a_row_that_moves_the_axis(plan) -> None:
    found = follow_program(plan, {"X": drive(), "Y": drive()})
    lines = plan.path.moves.line
    assert [int(lines[found[a].row[found[a].worst]]) for a in "XY"] == [2, 3]


def test_feed_forward_takes_the_lag_away(plan) -> None:
    behind = follow_program(plan, {"X": drive()})["X"]
    ahead = follow_program(plan, {"X": drive(velocity_feedforward=1.0)})["X"]
    assert ahead.rms_error < 0.05 * behind.rms_error


def test_axes_that_stand_or_have_no_servo_are_left_out(plan) -> None:
    bare = IdentifiedDrive(
        feed_drive=drive().feed_drive, servo=None, command_unit="A", force_unit="N"
    )
    assert list(follow_program(plan, {"X": bare, "Z": drive(), "Y": drive()})) == ["Y"]


def test_a_program_too_long_to_be_held_is_one_sentence(plan, monkeypatch) -> None:
    monkeypatch.setattr("pipeline.twin.program_axes.MOST", 100)
    with pytest.raises(ValueError, match="more than 100 positions: simulate a shorter program"):
        follow_program(plan, {"X": drive()})


@pytest.mark.parametrize("stiffness", [None, 2e7])
def test_figures_of_a_program_in_parts_are_those_of_the_whole(
    plan, monkeypatch, stiffness: float | None
) -> None:
    """Parts of 500 positions: in cuts, in corners, in the dwell; friction that holds is kept."""
    axis = replace(
        drive(), presliding_stiffness=stiffness, following_half_width=1e-6,
        speeds=Condition(unit="mm/min", low=1000.0, high=2000.0),
    )  # fmt: skip
    drives = {"X": axis, "Y": axis, "Z": axis}
    whole = {one: AxisFigures.of(axis) for one, axis in follow_program(plan, drives).items()}
    monkeypatch.setattr("pipeline.twin.program_axes.PART", 500)
    monkeypatch.setattr("pipeline.twin.program_axes.MOST", 100)
    found = program_figures(plan, drives)
    assert list(found) == list(whole) == ["X", "Y"]
    for letter, one in found.items():
        other = whole[letter]
        assert (one.worst_row, one.command_unit) == (other.worst_row, "A")
        for name in ("max_error", "rms_error", "max_command", "half_width"):
            # the curve through the neighbours differs by 0.27^24 = 2e-14 of what lies beyond them
            assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-7), name


def test_between_goes_through_the_samples_and_follows_a_parabola() -> None:
    t = np.arange(50.0)
    fine = between(t**2, 4)
    np.testing.assert_array_equal(fine[::4], t**2)
    np.testing.assert_allclose(fine[:-4], (np.arange(196) / 4) ** 2, atol=1e-9)
    np.testing.assert_array_equal(between(t, 1), t)
    np.testing.assert_array_equal(between(np.array([3.0]), 4), [3.0] * 4)


def test_a_residual_is_added_to_what_the_model_says(plan) -> None:
    """It sees reference, error and command of the model, and is the difference to the bit."""

    def residual(letter, reference, modelled_error, modelled_command, period):
        left = 0.1 * modelled_error + 1e-7 * modelled_command + 1e-5 * reference
        width = np.nan if letter == "Y" else 2e-6
        return left * (letter == "X"), np.full(len(reference), width)

    both = {"X": drive(), "Y": drive()}
    bare, found = follow_program(plan, both), follow_program(plan, both, residual)
    positions = commanded_positions(plan).position
    left = 0.1 * bare["X"].error + 1e-7 * bare["X"].command + 1e-5 * positions[:, 0]
    np.testing.assert_array_equal(found["X"].error, bare["X"].error + left)
    np.testing.assert_array_equal(found["X"].command, bare["X"].command)
    np.testing.assert_array_equal(found["X"].half_width, np.full(len(left), 2e-6))
    # an axis that was not learnt keeps its model, and has no interval
    np.testing.assert_array_equal(found["Y"].error, bare["Y"].error)
    assert found["Y"].half_width is None and bare["X"].half_width is None


def there_and_back() -> np.ndarray:
    """40 mm at 50 mm/s to and fro, smoothly, and a rest [m], each millisecond."""
    speed = np.repeat([0.0, 0.05, 0.0, -0.05, 0.0], [200, 800, 200, 800, 400])
    return np.cumsum(np.convolve(speed, np.ones(60) / 60, "same")) * 1e-3


def test_a_fuzzy_speed_loop_follows_as_far_behind_at_constant_speed() -> None:
    """The lag there is speed over loop gain, whatever the speed loop."""
    reference = there_and_back()
    plain, _ = driven("X", drive(), reference, 1e-3)
    fuzzy = driven_by_fuzzy("X", drive(), reference, 1e-3)
    assert (reference - fuzzy)[900] == pytest.approx(0.05 / GAIN, rel=1e-3)
    apart = np.abs(fuzzy - plain)
    assert 0.5e-6 < apart.max() < 0.05 * np.abs(reference - plain).max()
    assert apart[900] < 0.2 * apart.max()


def test_a_fuzzy_speed_loop_needs_a_servo() -> None:
    bare = replace(drive(), servo=None, servo_reason="no reference was recorded")
    with pytest.raises(ValueError, match="axis X has no servo: no reference was recorded"):
        driven_by_fuzzy("X", bare, np.zeros(9), 1e-3)
