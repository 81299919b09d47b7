"""The cascade's step: its formula, its limit, conditional integration, lags."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.machine.axis.drive import NO_RULES, Servo, ServoState, _followed
from pipeline.machine.axis.drive import servo_step as compiled_step
from pipeline.machine.axis.drive_parameters import ServoParameters

SERVO = ServoParameters(
    position_gain=40.0, velocity_gain=50.0, integral_gain=1000.0, position_scale=1.5,
    velocity_scale=2.0, integral_scale=0.5, velocity_feedforward=0.25,
    acceleration_feedforward=0.3,
)  # fmt: skip
REST = ServoState(0.0, 0.0, 0.0, 0.0)


def servo_step(
    reference: tuple[float, float, float], x: float, v: float, state: ServoState, period: float,
    servo: ServoParameters,
) -> tuple[float, ServoState]:  # fmt: skip
    """Command of one sample and the state for the next one; the integral is in amperes."""
    loops = Servo(
        servo.loop_gain, servo.proportional, servo.integral, servo.velocity_feedforward,
        servo.acceleration_feedforward, servo.current_limit, period,
        _followed(servo.position_lag, period), _followed(servo.velocity_lag, period),
    )  # fmt: skip
    command, after = compiled_step(*reference, x, v, state, loops, NO_RULES)
    return command, ServoState(*after)


def test_command_by_hand() -> None:
    """v_ref = 60 * 1e-3 + 0.25 * 0.2 = 0.11; error 0.11 - 0.05; A = 6 + 500 * 2e-3 + 0.3 * 4."""
    state = ServoState(500 * 2e-3, 0.0, 0.0, 0.0)
    command, after = servo_step((0.011, 0.2, 4.0), 0.010, 0.05, state, 1e-3, SERVO)
    assert command == pytest.approx(6.0 + 1.0 + 1.2, rel=1e-12)
    assert after.integral == pytest.approx(500 * (2e-3 + 1e-3 * 0.06), rel=1e-12)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.1, 0.1), st.floats(0.1, 10))
def test_command_never_passes_the_limit(x: float, v: float, integral: float, limit: float) -> None:
    servo = replace(SERVO, current_limit=limit)
    command, _ = servo_step(
        (0.0, 0.0, 0.0), x, v, ServoState(500 * integral, 0.0, 0.0, 0.0), 1e-3, servo
    )
    assert abs(command) <= limit


def test_integral_stays_while_the_limit_holds_and_leaves_it_at_once() -> None:
    """A blocked axis: the command leaves the limit in the sample in which the error turns."""
    servo = replace(SERVO, current_limit=5.0)
    state = ServoState(0.5, 0.0, 0.0, 0.0)
    for _ in range(1000):
        command, state = servo_step((0.1, 0.0, 0.0), 0.0, 0.0, state, 1e-3, servo)
        assert (command, state.integral) == (5.0, 0.5)
    command, state = servo_step((-1e-4, 0.0, 0.0), 0.0, 0.0, state, 1e-3, servo)
    # 100 * 60 * -1e-4 + 500 * 1e-3
    assert command == pytest.approx(-0.6 + 0.5, rel=1e-12)


def test_integral_unwinds_while_the_limit_holds() -> None:
    servo = replace(SERVO, current_limit=5.0)
    command, state = servo_step(
        (-1e-4, 0.0, 0.0), 0.0, 0.0, ServoState(50.0, 0.0, 0.0, 0.0), 1e-3, servo
    )
    assert command == 5.0
    assert state.integral == pytest.approx(500 * (0.1 - 1e-3 * 60 * 1e-4), rel=1e-12)


def test_integral_of_a_constant_error_grows_in_proportion_to_time() -> None:
    state = REST
    for _ in range(500):
        command, state = servo_step((1e-5, 0.0, 0.0), 0.0, 0.0, state, 1e-3, SERVO)
    error = 60 * 1e-5
    # the last command saw 499 periods
    assert command == pytest.approx(100 * error + 500 * 0.499 * error, rel=1e-9)


def test_lag_follows_the_exact_exponential() -> None:
    servo = replace(SERVO, velocity_lag=0.004, position_lag=0.010)
    state = REST
    for k in range(1, 30):
        _, state = servo_step((1e-3, 0.0, 0.0), 0.0, 0.2, state, 1e-3, servo)
        assert state.v_seen == pytest.approx(0.2 * (1 - np.exp(-k / 4)), rel=1e-12)
        assert state.v_ref == pytest.approx(0.06 * (1 - np.exp(-k / 10)), rel=1e-12)
