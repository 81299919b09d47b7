"""Stiffness of friction before it slides: its closed form, and recovered from a closed loop."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.machine.axis.drive import NO_RULES, simulate
from pipeline.machine.axis.drive_parameters import ServoParameters, drive_row
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.submodels.drive import presliding
from pipeline.submodels.drive.presliding import PreslidingFit, identify_presliding
from pipeline.submodels.drive.records import AxisRecord, Recording
from tests.machine.steps import simulate_drive
from tests.twin.axes import DriveParameters

SIDE = DirectionFriction(coulomb=300.0, static=400.0, stribeck_velocity=0.006, viscous=900.0)
SCREW = FeedDriveParameters(
    mass=1300.0, force_constant=500.0, friction=FrictionParameters(positive=SIDE, negative=SIDE)
)
SERVO = ServoParameters(
    position_gain=33.0, velocity_gain=550.0, integral_gain=4e4, velocity_feedforward=0.6,
    velocity_lag=1.7e-3, position_lag=1.7e-3,
)  # fmt: skip
STEP, STIFFNESS = 2.5e-4, 3e7


def traced(reference, load=None, stiffness: float = STIFFNESS, loss: float = 0.0):
    """Position [m] and command [A] of the axis."""
    row = drive_row(SERVO, SCREW)[np.newaxis]
    found = simulate(reference, STEP, row, load=load, spring=(stiffness, loss))
    return found.position[0], found.command[0]


def found_in(reference, loss: float = 0.0, noise: float = 0.03) -> PreslidingFit:
    """What is found of a closed loop that is recorded at 1 kHz with a noise of the current [A]."""
    position, command = traced(reference, loss=loss)
    noisy = command[::4] + noise * np.random.default_rng(4).standard_normal(len(command) // 4)
    record = AxisRecord(command=noisy, position=position[::4], reference=reference[::4])
    one = Recording(name="loop", trained=True, period=4 * STEP, axes={"X": record})
    found = identify_presliding([one], "X", SERVO, SCREW, 0.5)
    assert found is not None
    return found


def test_rules_move_the_gains_by_their_spans() -> None:
    """A speed error far above its scale: the increments are those of the tables' corner."""
    reference = 0.02 * np.arange(0, 0.2, STEP)
    row, found = drive_row(SERVO, SCREW), []
    stiffer = drive_row(replace(SERVO, velocity_gain=1.6 * SERVO.velocity_gain), SCREW)
    for one, rules in ((row, NO_RULES), (row, (1e9, 0.0, 0.6, 0.0)), (stiffer, NO_RULES)):
        spring = (STIFFNESS, 0.0)
        trace = simulate(reference, STEP, one[np.newaxis], spring=spring, rules=rules)
        found.append(trace.command[0, 1])
    # E = PB, EC = ZO: K_p by NM, two thirds of the span down
    assert found[1] / found[0] == pytest.approx(1 - 0.6 * 2 / 3, rel=1e-6)
    assert found[2] / found[0] == pytest.approx(1.6, rel=1e-2)


def reversals(feed: float = 0.01) -> np.ndarray:
    """Back and forth at a feed [m/s], with standstill between, smoothly."""
    time = np.arange(0, 4, STEP)
    speed = feed * np.sign(np.sin(2 * np.pi * time)) * (np.abs(np.sin(2 * np.pi * time)) > 0.3)
    smooth = np.convolve(speed, np.ones(80) / 80, "same")
    return np.cumsum(smooth) * STEP


def test_sliding_steadily_it_is_the_axis_without_a_spring() -> None:
    """Stribeck's level and the viscous part hold whatever the stiffness: the same command."""
    reference = 0.02 * np.arange(0, 1, STEP)
    _, command = traced(reference)
    plain = simulate_drive(reference, STEP, DriveParameters(servo=SERVO, feed_drive=SCREW))
    expected = (300 + 100 * np.exp(-((0.02 / 0.006) ** 2)) + 900 * 0.02) / 500
    assert command[-1] == pytest.approx(expected, rel=1e-3)
    assert command[-1] == pytest.approx(plain.command[-1], rel=1e-3)


def test_an_axis_that_stands_gives_way_and_its_integral_takes_the_load_over() -> None:
    """Before the loop answers the spring yields F / sigma; in the end the motor has all of F."""
    load = np.where(np.arange(12000) * STEP > 0.1, 100.0, 0.0)
    position, command = traced(np.zeros(12000), load)
    assert 0.2 * 100 / STIFFNESS < -position.min() < 100 / STIFFNESS
    assert position[-1] == pytest.approx(0.0, abs=1e-8)
    # but for what the overshoot has left in the spring
    assert command[-1] == pytest.approx(100 / 500, rel=0.15)
    # friction that sticks exactly holds it for ever
    drive = DriveParameters(servo=SERVO, feed_drive=SCREW)
    stuck = simulate_drive(np.zeros(2000), STEP, drive, load=load[:2000])
    assert np.abs(stuck.command).max() == 0.0


def test_the_stiffness_is_recovered_from_a_recorded_closed_loop() -> None:
    """Within 10 % and inside its interval's neighbourhood."""
    found = found_in(reversals())
    assert found.stiffness.determined
    assert found.stiffness.value == pytest.approx(STIFFNESS, rel=0.1)
    assert found.stiffness.low < found.stiffness.value < found.stiffness.high


def standstills() -> np.ndarray:
    """Strokes at 10 mm/s there and back, 4 s of standstill after each."""
    time = np.arange(0, 18, STEP)
    speed = 0.01 * (((time > 0.2) & (time < 0.6)) * 1.0 - ((time > 9.2) & (time < 9.6)))
    return np.cumsum(np.convolve(speed, np.ones(80) / 80, "same")) * STEP


def test_the_command_of_a_standing_axis_falls_by_the_time_of_friction() -> None:
    """Where it stands, f' = - f / T; without a loss it holds."""
    _, command = traced(standstills(), loss=1 / 3.0)
    early, late = int(2.0 / STEP), int(5.0 / STEP)
    assert command[late] / command[early] == pytest.approx(np.exp(-1), rel=0.03)
    _, held = traced(standstills())
    assert held[late] == pytest.approx(held[early], rel=1e-3) and abs(held[late]) > 0.1


@pytest.mark.parametrize("time", [0.5, 3.0, None])
def test_the_time_is_recovered_from_standstills(time: float | None) -> None:
    """Within 5 %; where friction holds, none is determined and the remedy says what to record."""
    found = found_in(standstills(), loss=0.0 if time is None else 1 / time)
    assert found.time is not None
    if time is None:
        parameter = found.parameters("N")["presliding_time"]
        assert parameter.value is None and "standing for some seconds" in parameter.remedy
        return
    assert found.time.determined and found.time.value == pytest.approx(time, rel=0.05)
    assert found.time.low < time < found.time.high


def test_the_valley_is_followed_to_the_value_that_all_together_give(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As when every value is tried in every round, which go on until no more than 1 % changes."""
    found = found_in(standstills(), 1 / 3.0, noise=0.0)
    some = presliding._nearest
    monkeypatch.setattr(presliding, "COARSE", 1)
    monkeypatch.setattr(presliding, "_nearest", lambda *given: some(*given[:-1], None))
    whole = found_in(standstills(), 1 / 3.0, noise=0.0)
    assert found.time is not None and whole.time is not None
    assert found.time.determined and whole.time.determined
    assert found.stiffness.value == pytest.approx(whole.stiffness.value, rel=1e-4)
    assert found.time.value == pytest.approx(whole.time.value, rel=1e-4)


def test_without_reversals_it_is_not_determined() -> None:
    reference = 0.02 * np.arange(0, 1, STEP)
    position, command = traced(reference)
    noise = 0.03 * np.random.default_rng(4).standard_normal(1000)
    steady = slice(2000, None, 4)
    record = AxisRecord(
        command=command[steady] + noise[:500], position=position[steady],
        reference=np.zeros(500),
    )  # fmt: skip
    one = Recording(name="creep", trained=True, period=4 * STEP, axes={"X": record})
    found = identify_presliding([one], "X", SERVO, SCREW, 0.5)
    assert found is None or not found.stiffness.determined
    parameter = None if found is None else found.parameters("N")["presliding_stiffness"]
    assert parameter is None or (parameter.value is None and "record reversals" in parameter.remedy)
    assert identify_presliding([], "X", SERVO, SCREW, 0.5) is None
