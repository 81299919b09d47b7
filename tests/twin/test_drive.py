"""One axis: closed forms of the cascade, exact motion, energy, starts, refusals, its file."""

import json
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from pipeline.machine.axis.drive import simulate
from pipeline.machine.axis.drive_parameters import (
    DriveStart,
    ServoParameters,
    drive_row,
    friction_force,
)
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.schema.store import StoreError
from pipeline.twin.drive import loop_matrix, read_drives, stable
from tests.machine.steps import simulate_drive
from tests.twin.axes import (
    AXIS,
    BOTH,
    NONE,
    DriveParameters,
    T,
    ramp,
    to_and_fro,
    with_drive,
    with_servo,
)


def row_of(axis: DriveParameters) -> NDArray[np.float64]:
    return drive_row(axis.servo, axis.feed_drive)


@pytest.mark.parametrize("speed", [0.05, -0.05, 0.002])
def test_constant_feed(speed: float) -> None:
    """e = v / (S_pp P_p) and A = F_f(v) / k, whatever the gains of the velocity loop."""
    axis = with_servo(AXIS, position_scale=1.25, velocity_lag=0.001)
    trace = simulate_drive(ramp(speed, 4.0), T, axis)
    # the slowest mode, 20 1/s, has gone by exp(-80)
    assert trace.following_error[-1] == pytest.approx(speed / 50, rel=1e-9)
    assert trace.velocity[-1] == pytest.approx(speed, rel=1e-9)
    force = float(friction_force(speed, BOTH))
    assert trace.command[-1] == pytest.approx(force / 300, rel=1e-9)


def test_full_velocity_feedforward_leaves_no_error_at_constant_feed() -> None:
    trace = simulate_drive(ramp(0.05, 4.0), T, with_servo(AXIS, velocity_feedforward=1.0))
    assert abs(trace.following_error[-1]) < 1e-12


def test_without_integral_the_force_costs_an_error() -> None:
    """e = (F / k S_vp V_p + v) / (S_pp P_p)."""
    trace = simulate_drive(ramp(0.05, 4.0), T, with_servo(AXIS, integral_gain=0.0))
    force = float(friction_force(0.05, BOTH))
    expected = (force / (300 * 100) + 0.05) / 40
    assert trace.following_error[-1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ahead", [0.0, 0.5])
def test_backward_difference_costs_half_a_period_at_constant_acceleration(ahead: float) -> None:
    """With f_v = 1 the speed fed forward is a T / 2 late: e = a T / (2 S_pp P_p)."""
    axis = with_servo(
        with_drive(AXIS, friction=NONE), velocity_feedforward=1.0, acceleration_feedforward=ahead
    )
    reference = 0.5 * 0.2 * (T * np.arange(2000)) ** 2
    error = simulate_drive(reference, T, axis).following_error
    assert error[-1] == pytest.approx(0.2 * T / (2 * 40), rel=1e-6)
    # f_a = M / k leaves the integral with nothing to do: the error comes without a detour
    assert (np.abs(error).max() < 1.01 * error[-1]) == (ahead == 0.5)


def exact(reference: NDArray[np.float64], axis: DriveParameters, mu: float) -> NDArray[np.float64]:
    """The same loops on M v' = k A - mu v, solved exactly between samples."""
    servo, M, k = axis.servo, axis.feed_drive.mass, axis.feed_drive.force_constant
    A = np.array([[0, 1, 0], [0, -mu / M, k / M], [0, 0, 0]])
    over = expm(A * T)
    x = v = J = last = forward = 0.0
    out = []
    for r in reference:
        out.append(x)
        speed = (r - last) / T
        ahead, last, forward = (speed - forward) / T, r, speed
        error = servo.position_gain * (r - x) + servo.velocity_feedforward * speed - v
        command = servo.velocity_gain * error + servo.integral_gain * J
        command += servo.acceleration_feedforward * ahead
        J += T * error
        x, v, _ = over @ (x, v, command)
    return np.array(out)


def test_linear_axis_moves_exactly_without_viscous_friction() -> None:
    axis = with_servo(
        with_drive(AXIS, friction=NONE), velocity_feedforward=0.7, acceleration_feedforward=0.2
    )
    reference = to_and_fro(2000)
    trace = simulate_drive(reference, T, axis)
    assert trace.position == pytest.approx(exact(reference, axis, 0.0), abs=1e-14)


def test_viscous_axis_is_of_second_order_in_substeps() -> None:
    one = DirectionFriction(coulomb=0.0, static=0.0, stribeck_velocity=0.005, viscous=3000.0)
    axis = with_drive(AXIS, friction=FrictionParameters(positive=one, negative=one))
    reference = to_and_fro(500)
    truth = exact(reference, axis, 3000.0)
    error = [
        np.abs(simulate_drive(reference, T, axis, substeps=n).position - truth).max()
        for n in (1, 2, 4)
    ]
    assert np.log2([error[0] / error[1], error[1] / error[2]]) == pytest.approx(2.0, abs=0.05)


def test_servo_in_substeps_is_the_servo_at_their_period() -> None:
    reference, n = to_and_fro(400), 5
    fine = np.interp(np.arange(400 * n) / n, np.arange(400), reference)
    load = 20 * np.sin(np.arange(400) / 9)
    coarse = simulate_drive(reference, T, AXIS, load=load, substeps=n, servo_substeps=True)
    all_steps = simulate_drive(fine, T / n, AXIS, load=np.repeat(load, n))
    # interpolation rounds differently
    assert coarse.position == pytest.approx(all_steps.position[::n], abs=1e-15)
    assert coarse.command == pytest.approx(all_steps.command[::n], abs=1e-9)


def test_work_of_the_command_is_kinetic_dissipated_and_of_the_load() -> None:
    axis = with_drive(AXIS, offset=70.0)
    load = 30 * np.sin(np.arange(3000) / 50)
    trace = simulate_drive(to_and_fro(3000), T, axis, load=load)
    way = np.diff(trace.position)
    work = (300 * trace.command[:-1] * way).sum()
    kinetic = 75 * (trace.velocity[-1] ** 2 - trace.velocity[0] ** 2)
    force = 300 * trace.command[:-1] - 70 - load[:-1]
    friction = force - 150 * np.diff(trace.velocity) / T
    dissipated = (friction * way).sum()
    lifted = ((70 + load[:-1]) * way).sum()
    assert work == pytest.approx(kinetic + dissipated + lifted, rel=1e-12)
    assert dissipated > 0


def test_axis_at_rest_stays_at_rest() -> None:
    """A vertical axis too, whose command carries the offset from the first sample on."""
    trace = simulate_drive(np.full(1000, 0.1), T, with_drive(AXIS, offset=400.0))
    assert (trace.position == 0.1).all()
    assert trace.command == pytest.approx(400 / 300, rel=1e-15)


def test_integral_hunts_about_the_target_when_static_friction_is_higher() -> None:
    """The limit cycle of P-PI: every 0.65 s from rest to rest; none with F_s = F_c."""
    reference = np.r_[np.zeros(100), np.full(9900, 1.003e-3)]

    def starts(static: float, n: int) -> NDArray[np.intp]:
        one = DirectionFriction(coulomb=60.0, static=static, stribeck_velocity=5e-4, viscous=0.0)
        axis = with_drive(AXIS, friction=FrictionParameters(positive=one, negative=one))
        axis = with_servo(axis, position_gain=10.0, velocity_gain=20.0)
        v = simulate(reference, T, row_of(axis)[np.newaxis], substeps=n).velocity[0]
        return np.flatnonzero((v[1:] != 0) & (v[:-1] == 0))

    coarse, fine = np.diff(starts(90.0, 1)[-4:]), np.diff(starts(90.0, 16)[-4:])
    # a cycle: each lasts as long as the one before, to the samples that bound it
    assert np.ptp(coarse) <= 2
    # the dip is of first order in the step
    assert coarse == pytest.approx(fine, rel=0.01)
    assert len(starts(60.0, 1)) == 1


def test_limit_holds_and_the_axis_arrives_without_overshoot_of_windup() -> None:
    limited = with_servo(AXIS, current_limit=1.0)
    reference = np.r_[0.0, np.full(2999, 0.05)]
    trace = simulate_drive(reference, T, limited)
    assert np.abs(trace.command).max() == 1.0
    # greatest speed of the limit: the axis cannot brake from more than 240 N / 150 kg allows
    assert trace.position[-1] == pytest.approx(0.05, abs=1e-5)


def test_start_continues_a_motion() -> None:
    """From a sample of a trace on, at constant speed of the reference, the trace goes on."""
    axis = with_servo(AXIS, velocity_feedforward=0.8, acceleration_feedforward=0.3)
    reference = ramp(0.03, 1.0)
    whole = simulate_drive(reference, T, axis)
    k = 50
    begin = DriveStart(
        position=float(whole.position[k]), velocity=float(whole.velocity[k]),
        command=float(whole.command[k]), reference_velocity=0.03,
    )  # fmt: skip
    rest = simulate_drive(reference[k:], T, axis, start=begin)
    assert rest.position == pytest.approx(whole.position[k:], abs=1e-13)
    assert rest.command == pytest.approx(whole.command[k:], abs=1e-8)


@pytest.mark.parametrize("substeps", [1, 4])
def test_velocity_loop_is_stable_up_to_two_periods(substeps: int) -> None:
    """k S_vp V_p T / M < 2 for a mass without friction whose position loop is slow."""
    for share, expected in ((0.99, True), (1.01, False)):
        axis = with_servo(
            with_drive(AXIS, friction=NONE),
            position_gain=1e-6, velocity_gain=share * 2 / T * 150 / 300, integral_gain=0.0,
        )  # fmt: skip
        assert stable(row_of(axis), T, substeps) == expected


@given(
    st.floats(1, 400), st.floats(0.02, 1.9), st.floats(0.0, 0.4), st.floats(0, 2e-3),
    st.floats(0, 2e-3),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_stability_is_what_the_free_motion_shows(
    gain: float, band: float, integral: float, lag: float, later: float
) -> None:
    """A linear axis that starts beside its reference comes to it if, and only if, it is stable."""
    axis = with_servo(
        with_drive(AXIS, friction=NONE), position_gain=gain, velocity_gain=band / T / 2,
        integral_gain=integral * band / T**2 / 20, velocity_lag=lag, position_lag=later,
    )  # fmt: skip
    row = row_of(axis)
    radius = np.abs(np.linalg.eigvals(loop_matrix(row, T))).max()
    start = DriveStart(position=1e-3)
    motion = simulate(np.zeros(4000), T, row[np.newaxis], start=start).position[0]
    # what grows or fades by less than exp(4) in all is not told from its transient
    if radius < 1 - 1e-3:
        assert np.abs(motion[-500:]).max() < np.abs(motion[:500]).max()
    elif radius > 1 + 1e-3:
        grown = np.abs(motion[-500:]).max()
        assert not grown <= np.abs(motion[:500]).max()


def test_period_that_is_too_long_is_refused_with_one_that_is_not() -> None:
    axis = with_servo(AXIS, velocity_gain=1500.0)
    with pytest.raises(ValueError, match=r"period = 0\.001 s is too long for the loop") as caught:
        simulate_drive(ramp(0.1, 1.0), T, axis)
    good = float(str(caught.value).split("stable up to ")[1].split(" s")[0])
    trace = simulate_drive(ramp(0.1, 0.5, good * 0.99), good * 0.99, axis)
    assert trace.velocity[-1] == pytest.approx(0.1, rel=1e-3)
    simulate_drive(ramp(0.1, 0.5), T, axis, substeps=4, servo_substeps=True)


def test_loop_that_no_period_saves_is_refused() -> None:
    axis = with_servo(AXIS, position_gain=2000.0, velocity_lag=0.01)
    with pytest.raises(ValueError, match=r"unstable at any period .* lower the position gain"):
        simulate_drive(ramp(0.1, 1.0), T, axis)


friction_sets = st.builds(
    lambda coulomb, more, narrow, viscous: DirectionFriction(
        coulomb=coulomb, static=coulomb + more, stribeck_velocity=narrow, viscous=viscous
    ),
    st.floats(0, 500), st.floats(0, 500), st.floats(1e-6, 0.1), st.floats(0, 5e3),
)  # fmt: skip


@given(
    st.floats(1, 5000), friction_sets, friction_sets, st.floats(1, 200), st.floats(0.01, 0.9),
    st.floats(-2000, 2000), st.floats(0, 1.2), st.floats(0.1, 100), st.integers(1, 3),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_stable_axis_stays_finite_and_near(
    mass: float, up: DirectionFriction, down: DirectionFriction, gain: float, band: float,
    offset: float, forward: float, limit: float, substeps: int,
) -> None:  # fmt: skip
    drive = FeedDriveParameters(
        mass=mass, force_constant=10.0, offset=offset,
        friction=FrictionParameters(positive=up, negative=down),
    )  # fmt: skip
    servo = ServoParameters(
        position_gain=gain, velocity_gain=band / T * mass / 10, integral_gain=mass,
        velocity_feedforward=forward, current_limit=limit,
    )  # fmt: skip
    axis = DriveParameters(servo=servo, feed_drive=drive)
    try:
        trace = simulate_drive(to_and_fro(200), T, axis, substeps=substeps)
    except ValueError as error:
        assert "the loop" in str(error)
        return
    for values in (trace.position, trace.velocity, trace.command):
        assert np.isfinite(values).all()
    assert np.abs(trace.command).max() <= limit


def test_start_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match=r"start.velocity = nan m/s must be finite"):
        replace(DriveStart(position=0.0), velocity=float("nan"))


SERVO = ServoParameters(
    position_gain=40.0, velocity_gain=500.0, integral_gain=9e3, position_scale=0.82,
    velocity_lag=1e-3, current_limit=30.0,
)  # fmt: skip
SCREW = FeedDriveParameters(
    mass=95.0, force_constant=35.0, offset=-3.0,
    friction=FrictionParameters(
        positive=DirectionFriction(coulomb=20.0, static=25, stribeck_velocity=0.01, viscous=200.0),
        negative=DirectionFriction(coulomb=22.0, static=22.0, stribeck_velocity=0.01, viscous=0.0),
    ),
)  # fmt: skip


FIT = {"samples": 1, "relative_error_percent": 2.0, "bandwidth_Hz": 40.0, "delay_s": 2e-4,
       "condition": 3.0, "rank": 1, "correlation": {"names": [], "values": []}}  # fmt: skip


def document(**changes) -> str:
    axis = {"command_unit": "V", "force_unit": "N", "servo": asdict(SERVO),
            "feed_drive": asdict(SCREW), "fit": FIT}  # fmt: skip
    return json.dumps({
        "submodel": "drive", "machine": "m", "origin": "recorded", "parameters": {},
        "trained_on": [], "axes": {"X": axis | changes},
    })  # fmt: skip


def read(tmp_path, text):
    path = tmp_path / "model.json"
    path.write_text(text)
    return read_drives(path)


def test_what_was_written_is_read(tmp_path):
    [(letter, found)] = read(tmp_path, document()).items()
    assert letter == "X"
    assert (found.servo, found.feed_drive) == (SERVO, SCREW)
    assert (found.command_unit, found.force_unit) == ("V", "N")
    assert (found.bandwidth_Hz, found.delay) == (40.0, 2e-4)


@pytest.mark.parametrize("limit", [{}, {"current_limit": None}])
def test_a_limit_that_is_left_out_is_infinite(tmp_path, limit):
    servo = {k: v for k, v in asdict(SERVO).items() if k != "current_limit"}
    found = read(tmp_path, document(servo=servo | limit))["X"].servo
    assert found is not None and found.current_limit == float("inf")


def test_without_servo_its_reason_is_kept(tmp_path):
    fit = FIT | {"bandwidth_Hz": None, "delay_s": None}
    changed = document(servo=None, servo_reason="no reference", fit=fit)
    found = read(tmp_path, changed)["X"]
    assert found.servo is None
    assert found.servo_reason == "no reference"
    assert found.bandwidth_Hz is None and found.delay == 0


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"axes": 3}', '{"axes": {"X": {}}}', '{"axes": {"X": null}}',
     document(feed_drive={"mass": 1}), document(feed_drive=asdict(SCREW) | {"weight": 1}),
     document(feed_drive=asdict(SCREW) | {"mass": -1}),
     document(fit=FIT | {"delay_s": "soon"}), "\x00", "{\"axes\": ",
     document(feed_drive=asdict(SCREW)).replace('"viscous"', '"viscosity"', 1),
     re.sub(r'"stribeck_velocity": [^,}]+, ', "", document(feed_drive=asdict(SCREW)), count=1)],
    ids=range(14),
)  # fmt: skip
def test_another_form_is_one_sentence(tmp_path, text):
    with pytest.raises(StoreError, match=r"model\.json holds no identified drives: .+ `dvc repro`"):
        read(tmp_path, text)


def test_a_file_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(ValueError, match=r"holds no identified drives: .* does not exist"):
        read_drives(tmp_path / "none.json")
