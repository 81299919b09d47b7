"""A corrected command: the axis is where it is wanted, also where it is not quite the model."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.trials import CommandedPath
from pipeline.twin.command_correction import (
    AxisBounds,
    CommandCorrectionSettings,
    CorrectedProgram,
    bounded,
    corrected_command,
    corrected_program,
    cutoff,
    fading,
    reference_response,
    write_corrected,
)
from pipeline.twin.control import planned_program
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import commanded_positions, driven
from tests.twin.shop_drives import shop_drives
from tests.twin.test_program_axes import drive

T = 1e-3
AXIS = AxisParameters(
    rapid_speed=30000, cutting_speed=15000, rapid_acceleration=3000, cutting_acceleration=2000,
    arc_acceleration=1000, corner_jump=600,
)  # fmt: skip
CONTROL = ControlParameters(
    axes={"X": AXIS, "Y": AXIS, "Z": AXIS}, rapid_filter=(0.03, 0.02), cutting_filter=(0.03, 0.02)
)
STROKE = b"G21 G90 G94\nG4 P200\nG1 X100 F6000\nX0\nG4 P200\nM30\n"
CIRCLE = b"G21 G90 G94 G17\nG4 P200\nG1 X20 F3000\nG2 I-20\nG1 X0\nG4 P200\nM30\n"
DRIVES = {
    "plain": drive(), "fed forward": drive(velocity_feedforward=0.9),
    **shop_drives(ShopParameters(machine="mill77").drives),
}  # fmt: skip


def planned(text: bytes):
    return planned_program(interpret(parse_program(text, "part"), Setup()), CONTROL)


def commanded(text: bytes):
    return commanded_positions(planned(text))


def reference(text: bytes):
    return commanded(text).position[:, 0]


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def speed_and_acceleration(position) -> tuple[float, float]:
    speed = np.diff(position, prepend=position[0], append=position[-1]) / T
    return float(np.abs(speed).max()), float(np.abs(np.diff(speed)).max() / T)


def heavier(one: IdentifiedDrive) -> IdentifiedDrive:
    """Mass and friction 10 % above those that the correction knows."""
    screw = one.feed_drive
    up, down = (
        replace(side, coulomb=1.1 * side.coulomb, static=1.1 * side.static,
                viscous=1.1 * side.viscous)
        for side in (screw.friction.positive, screw.friction.negative)
    )  # fmt: skip
    friction = replace(screw.friction, positive=up, negative=down)
    return replace(one, feed_drive=replace(screw, mass=1.1 * screw.mass, friction=friction))


@pytest.mark.parametrize("text", [STROKE, CIRCLE], ids=["stroke", "circle"])
@pytest.mark.parametrize("name", DRIVES)
def test_an_axis_is_where_it_is_wanted_also_with_another_mass_and_friction(
    name, text, record_property
) -> None:
    wanted, one = reference(text), DRIVES[name]
    found = corrected_command("X", wanted, T, one)
    assert rms(found.error_after) < 0.05 * rms(found.error_before)
    # what is said of both is what the model does
    for u, error in ((wanted, found.error_before), (found.corrected, found.error_after)):
        np.testing.assert_allclose(wanted - driven("X", one, u, T)[0], error, atol=1e-15)
    other = heavier(one)
    before, after = (wanted - driven("X", other, u, T)[0] for u in (wanted, found.corrected))
    assert rms(after) < 0.1 * rms(before)
    for what, pair in (("model", (found.error_before, found.error_after)),
                       ("heavier", (before, after))):  # fmt: skip
        record_property(f"{what}_um", " -> ".join(f"{rms(one) * 1e6:.1f}" for one in pair))


@pytest.mark.parametrize("name", DRIVES)
def test_a_corrected_command_begins_and_ends_where_it_should_and_is_as_smooth(name) -> None:
    wanted = reference(STROKE)
    found = corrected_command("X", wanted, T, DRIVES[name])
    correction = found.corrected - wanted
    assert correction[0] == correction[-1] == 0.0
    # little is asked of an axis that stands: friction holds it by some um where it stopped
    assert np.abs(correction[:100]).max() < 1e-8 and np.abs(correction[-100:]).max() < 5e-6
    # the ideal correction of a lag L is L v: its acceleration L jerk adds to that of the motion
    jerk = np.abs(np.diff(wanted, 3)).max() / T**3
    lag = float(np.abs(found.error_before).max() / (np.abs(np.diff(wanted)).max() / T))
    before, after = speed_and_acceleration(wanted)[1], speed_and_acceleration(found.corrected)[1]
    assert after < before + 1.2 * lag * jerk


def test_an_axis_that_stands_is_left_alone() -> None:
    found = corrected_command("X", np.full(400, 0.3), T, drive())
    np.testing.assert_array_equal(found.corrected, found.reference)
    assert rms(found.error_after) < 1e-12


def bend(letter, reference, modelled_error, modelled_command, period):
    """A scale that errs by 30 um along 40 mm, and 5 um of windup with the sense of motion."""
    assert letter == "X" and period == T
    speed = np.gradient(reference, period)
    found = 30e-6 * np.sin(2 * np.pi * reference / 0.04) + 5e-6 * np.tanh(speed / 0.005)
    return found, np.full(len(reference), 2e-6)


def test_what_the_twin_leaves_over_is_inverted_too() -> None:
    wanted, one = reference(STROKE), DRIVES["X"]
    without = corrected_command("X", wanted, T, one)
    found = corrected_command("X", wanted, T, one, bend)
    assert rms(found.error_after) < 0.02 * rms(found.error_before)
    assert found.half_width is not None and without.half_width is None
    np.testing.assert_array_equal(found.half_width, 2e-6)

    def true_error(u):
        position, command = driven("X", one, u, T)
        return wanted - position + bend("X", u, u - position, command, T)[0]

    np.testing.assert_allclose(true_error(found.corrected), found.error_after, atol=1e-15)
    assert rms(true_error(found.corrected)) < 0.4 * rms(true_error(without.corrected))


def test_noise_of_a_residual_is_not_amplified() -> None:
    """A residual that trembles by 1 um makes no command that shakes the axis."""
    noise = 1e-6 * np.random.default_rng(1).standard_normal(len(reference(STROKE)))

    def trembling(letter, reference, modelled_error, modelled_command, period):
        return noise, np.abs(noise)

    wanted = reference(STROKE)
    for name in DRIVES:
        quiet = corrected_command("X", wanted, T, DRIVES[name])
        found = corrected_command("X", wanted, T, DRIVES[name], trembling)
        assert np.std((found.corrected - quiet.corrected)[:150]) < 0.75e-6
        most = speed_and_acceleration(quiet.corrected)[1]
        assert speed_and_acceleration(found.corrected)[1] < 1.1 * most


def test_the_best_step_is_kept_where_further_ones_do_harm() -> None:
    """A residual that answers the correction with three times its size: no loop inverts it."""
    wanted = reference(STROKE)

    def contrary(letter, reference, modelled_error, modelled_command, period):
        return -3.0 * (reference - wanted), np.zeros(len(wanted))

    found = corrected_command("X", wanted, T, drive(), contrary)
    assert rms(found.error_after) < rms(found.error_before)
    one = corrected_command(
        "X", wanted, T, drive(), settings=CommandCorrectionSettings(iterations=1)
    )
    more = corrected_command("X", wanted, T, drive())
    assert rms(more.error_after) <= rms(one.error_after) < rms(one.error_before)


@pytest.mark.parametrize(("speed", "acceleration"), [(0.12, 2.2), (0.1001, 9.0), (9.0, 1.5)])
def test_bounds_hold_at_every_sample(speed, acceleration) -> None:
    wanted = reference(STROKE)
    own = speed_and_acceleration(wanted)
    bounds = AxisBounds(speed=speed, acceleration=acceleration)
    found = corrected_command("X", wanted, T, DRIVES["X"], bounds=bounds)
    reached = speed_and_acceleration(found.corrected)
    assert reached[0] <= max(speed, own[0]) * (1 + 1e-9)
    assert reached[1] <= max(acceleration, own[1]) * (1 + 1e-6)
    assert found.limited.any() and found.corrected[-1] == pytest.approx(wanted[-1], abs=1e-9)
    assert rms(found.error_after) < rms(found.error_before)


def test_a_rapid_at_its_bounds_costs_no_correction_of_the_cut_after_it() -> None:
    text = b"G21 G90 G94\nG4 P200\nG0 X300\nG1 X320 F1200\nX300\nG0 X0\nG4 P200\nM30\n"
    trace = commanded(text)
    wanted, row = trace.position[:, 0], trace.row
    cut = np.isin(row, np.unique(row)[2:4])
    bounds = AxisBounds(speed=0.5, acceleration=3.34)
    found = corrected_command("X", wanted, T, DRIVES["X"], bounds=bounds)
    assert 0.0 < found.limited.mean() < 0.5
    inner = np.flatnonzero(cut)[200:-200]  # the rapid before is still under way in the filters
    assert rms(found.error_after[inner]) < 0.05 * rms(found.error_before[inner])


def test_bounds_that_hold_change_nothing() -> None:
    wanted = reference(STROKE)
    smooth = 1e-6 * np.sin(np.pi * np.arange(len(wanted)) / (len(wanted) - 1)) ** 2
    assert bounded(wanted, smooth, T, AxisBounds(speed=1.0, acceleration=9.0), 50) is smooth
    assert bounded(wanted, smooth, T, AxisBounds(), 50) is smooth


@pytest.mark.parametrize("name", DRIVES)
def test_the_response_is_that_of_the_simulated_loop(name) -> None:
    """Without friction a sine comes back with the amplitude and phase of G."""
    one = DRIVES[name]
    screw = one.feed_drive
    sides = {
        side: replace(getattr(screw.friction, side), coulomb=0.0, static=0.0, viscous=300.0)
        for side in ("positive", "negative")
    }
    screw = replace(screw, friction=replace(screw.friction, **sides))
    one = replace(one, feed_drive=screw, presliding_stiffness=None)
    edge = cutoff(one.servo, screw, T)
    response = abs(reference_response(one.servo, screw, np.array([edge]))[0])
    assert response == pytest.approx(np.sqrt(0.5), rel=0.01)
    for omega in (0.2 * edge, edge):
        time = T * np.arange(round(40 * 2 * np.pi / omega / T))
        position, _ = driven("X", one, 1e-3 * np.sin(omega * time), T)
        later = time > 0.5 * time[-1]
        table = np.column_stack([np.sin(omega * time), np.cos(omega * time)])[later]
        (a, b), *_ = np.linalg.lstsq(table, position[later], rcond=None)
        expected = 1e-3 * reference_response(one.servo, screw, np.array([omega]))[0]
        assert abs(complex(a, b) - expected) < 0.1 * abs(expected)  # sampling is left out of G


def test_what_cannot_be_corrected_is_one_sentence() -> None:
    bare = replace(drive(), servo=None, servo_reason="no reference was recorded")
    with pytest.raises(ValueError, match="axis X has no servo: no reference was recorded"):
        corrected_command("X", np.zeros(9), T, bare)
    with pytest.raises(ValueError, match="reference has 2 samples: give at least 3"):
        corrected_command("X", np.zeros(2), T, drive())
    with pytest.raises(ValueError, match="no linear axis with an identified servo moves"):
        corrected_program(planned(STROKE), {"Y": drive()})
    with pytest.raises(ValueError, match=r"speed = 0.*must be positive"):
        AxisBounds(speed=0.0)


def test_a_program_keeps_its_bounds_and_its_axes_stand_before_and_after() -> None:
    plan = planned(b"G21 G90 G94 G17\nG0 X50 Y10\nG1 X100 F3000\nG3 Y50 J20\nG0 X0 Y0\nM30\n")
    trace = commanded_positions(plan)
    axes, cutting = corrected_program(plan, {letter: DRIVES[letter] for letter in "XYZ"})
    assert list(axes) == ["X", "Y"]
    most = CONTROL.filtered_acceleration("X") * 1e-3
    for one in axes.values():
        np.testing.assert_allclose(np.diff(one.time), T)
        assert one.time[0] < 0 and one.time[-1] > trace.time[-1]
        now = (one.time > -0.5 * T) & (one.time < trace.time[-1] + 0.5 * T)
        assert now.sum() == len(trace)
        reached = speed_and_acceleration(one.corrected)
        assert reached[0] <= 0.5 * (1 + 1e-9) and reached[1] <= most * (1 + 1e-6)
        assert rms(one.error_after[cutting]) < 0.05 * rms(one.error_before[cutting])
        assert one.error_after[-1] == pytest.approx(one.error_before[-1], abs=10e-6)
        assert abs(one.corrected[-1] - one.reference[-1]) < 1e-9
    np.testing.assert_array_equal(axes["X"].reference[now], trace.position[:, 0])


def test_a_rapid_between_cuts_stays_as_near_to_its_path_as_without_a_correction() -> None:
    plan = planned(b"G21 G90 G94\nG0 X50 Y10\nG1 X60 F3000\nG0 X400 Y120\nG1 Y140\nG0 X0 Y0\nM30\n")
    drives = {"X": DRIVES["X"], "Y": DRIVES["Y"]}
    axes, cutting = corrected_program(plan, drives)
    share = fading(cutting, round(-axes["X"].time[0] / T))
    far = share == 0
    assert far.sum() > 0.1 / T
    wanted = np.stack([axes[letter].reference for letter in "XY"], axis=1)
    for letter in "XY":
        np.testing.assert_array_equal(axes[letter].corrected[far], axes[letter].reference[far])
    off = {
        when: CommandedPath(wanted).distance(
            wanted - np.stack([getattr(axes[a], when) for a in "XY"], axis=1)
        )
        for when in ("error_before", "error_after")
    }
    assert rms(off["error_after"][cutting]) < 0.1 * rms(off["error_before"][cutting])
    assert off["error_after"].max() < 0.5 * off["error_before"].max()


def test_a_share_fades_alike_before_and_after_a_cut() -> None:
    cuts = np.zeros(60, bool)
    cuts[20:25] = cuts[40:42] = True
    share = fading(cuts, 9)
    assert (share[cuts] == 1).all() and (share[:11] == 0).all() and (share[51:] == 0).all()
    np.testing.assert_allclose(share[10:20], share[42:52][::-1])
    assert 0 < share[25:40].min() < 1 and np.abs(np.diff(share)).max() < 0.25
    np.testing.assert_array_equal(fading(np.zeros(5, bool), 3), np.zeros(5))


def test_of_a_long_program_the_beginning_is_corrected(tmp_path) -> None:
    trace = commanded(STROKE)
    plan, drives = planned(STROKE), {"X": DRIVES["X"]}
    whole = corrected_program(plan, drives)[0]["X"]
    begun = corrected_program(plan, drives, longest=0.9)[0]["X"]
    assert begun.time[-1] == pytest.approx(0.9) and len(begun.corrected) == len(begun.time)
    rows = len(begun.time)
    np.testing.assert_allclose(begun.corrected, whole.corrected[:rows], atol=0.1e-3)
    assert rms(begun.error_after) < 0.02 * rms(begun.error_before)
    done = CorrectedProgram(
        machine="mill77", origin="simulated", program="part", champion="version 3, bundle 0123",
        residual="none", total=trace.time[-1], axes={"X": begun},
        cutting=begun.time > 0.5,
    )  # fmt: skip
    write_corrected(done, tmp_path / "part.csv")
    lines = (tmp_path / "part.csv").read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    assert "# Kerf: corrected command of the feed axes of mill77 (simulated)" in head
    assert any("only the first 0.9 s" in line for line in head)
    assert lines[len(head)] == "t,X,X_corrected,cutting" and len(lines) == len(head) + 1 + rows
    table = np.loadtxt(tmp_path / "part.csv", delimiter=",", skiprows=len(head) + 1)
    columns = np.column_stack([begun.time, begun.reference * 1e3, begun.corrected * 1e3,
                               begun.time > 0.5])  # fmt: skip
    np.testing.assert_allclose(table, columns, atol=0.5e-6 + 1e-12)
