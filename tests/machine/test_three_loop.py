"""The three loops around the motor: closed forms, limits, modulation, energies, refused inputs."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.machine.axis.drive_parameters import friction_force
from pipeline.machine.axis.drive_train import COPPER, INPUT, LOAD, LOST, SHAFT, sliding_friction
from pipeline.machine.axis.loops import FuzzyParameters, increments
from pipeline.machine.axis.three_loop import (
    ThreeLoopParameters,
    ThreeLoopTrace,
    follow_position,
    follow_speed,
    servo_axis,
    shafts,
)
from pipeline.schema.si import RPM
from tests.machine.motor_frames import magnetic_energy, steady_voltages

H = 1e-4
"""Period of the current loops."""
RIGID, TWISTING = servo_axis(rigid=True), servo_axis()


def step(speed: float, samples: int) -> np.ndarray:
    return np.full(samples, speed)


def speed_loop(drive: ThreeLoopParameters, **values: object) -> ThreeLoopParameters:
    return replace(drive, speed_loop=replace(drive.speed_loop, **values))


def position_loop(drive: ThreeLoopParameters, **values: object) -> ThreeLoopParameters:
    return replace(drive, position_loop=replace(drive.position_loop, **values))


def friction(drive: ThreeLoopParameters, level: float, **values: float) -> ThreeLoopParameters:
    """The axis with Coulomb friction of one level [N] at its guideway."""
    one = replace(
        drive.friction.positive, **{"coulomb": level, "static": level, "viscous": 0.0} | values
    )
    return replace(drive, friction=replace(drive.friction, positive=one, negative=one))


def inverter(drive: ThreeLoopParameters, **values: object) -> ThreeLoopParameters:
    return replace(drive, inverter=replace(drive.inverter, **values))


def test_the_current_loop_is_one_lag_of_its_bandwidth() -> None:
    """A guideway that is jammed, a speed loop without integral: one step of the current."""
    drive = speed_loop(friction(RIGID, 1e9), proportional=0.05, integral=0.0)
    trace = follow_speed(step(100.0, 41), H, drive)
    asked = 0.05 * 100.0 / drive.motor.torque_constant
    reached = 1 - np.exp(-drive.current_loop.bandwidth * H * np.arange(41))
    # pole and zero cancel to rounding: the integrator is exact to (R h / L)^5
    assert trace.i_q == pytest.approx(asked * reached, rel=1e-9)
    assert np.all(trace.i_d == 0) and np.all(trace.speed == 0)


def test_the_current_loop_does_not_wind_up_at_the_voltage_limit() -> None:
    """At a tenth of the voltage the current rises as R and L let it, and does not pass its goal."""
    drive = speed_loop(friction(RIGID, 1e9), proportional=0.15, integral=0.0)
    drive = inverter(drive, dc_link=28.0)
    trace = follow_speed(step(100.0, 200), H, drive)
    asked = 15.0 / drive.motor.torque_constant
    R, L, u = drive.motor.resistance, drive.motor.inductance_q, drive.inverter.dc_link / np.sqrt(3)
    free = u / R * (1 - np.exp(-R / L * trace.time))
    rising = free < 0.9 * asked
    assert rising.sum() > 30
    assert trace.i_q[rising] == pytest.approx(free[rising], rel=1e-9)
    assert trace.i_q.max() < asked * (1 + 1e-9)
    assert trace.i_q[-1] == pytest.approx(asked, rel=1e-4)


def test_neither_axis_winds_up_at_a_speed_out_of_reach() -> None:
    """A fifth of a second against the voltage's limit, then braking and a speed within it.

    Against the limit voltage is cut in both axes alike, so that i_d leaves zero; afterwards the
    loop of 500 Hz takes some milliseconds.
    """
    drive = inverter(friction(RIGID, 0.0), dc_link=60.0)
    reference = np.repeat([3000 * RPM, 300 * RPM], [2000, 1000])
    trace = follow_speed(reference, H, drive)
    limit = drive.inverter.dc_link / np.sqrt(3)
    at_limit = np.hypot(trace.u_d, trace.u_q) > limit * (1 - 1e-9)
    assert at_limit[1000:2000].all() and np.abs(trace.i_d).max() > 5
    free = 1 + int(np.flatnonzero(at_limit)[-1])
    assert np.abs(trace.i_d[free + 30 :]).max() < 0.05


def test_full_torque_until_the_speed_loop_leaves_its_limit() -> None:
    """Speed rises by T / J, and conditional integration has kept the integral empty."""
    drive = friction(RIGID, 0.0)
    drive = replace(drive, motor=replace(drive.motor, damping=0.0, coulomb=0.0))
    trace = follow_speed(step(100.0, 400), H, drive)
    inertia = drive.motor.inertia + drive.transmission.load_inertia
    full = slice(40, 80)
    rate = np.diff(trace.speed[full]) / H
    # while the rotor turns away from a held voltage the current falls short by a quarter per mille
    assert rate == pytest.approx(19.1 / inertia, rel=5e-4)
    # the limit is left at |e| = limit / K_p: the first sample with less torque comes right after
    left = int(np.argmax((trace.torque < 0.999 * 19.1) & (trace.time > 4e-3)))
    before, after = 100 - trace.speed[left - 2], 100 - trace.speed[left]
    assert after <= 19.1 / 0.5 <= before
    # the first two periods of the current's rise fall short of the limit by less than a percent
    assert trace.torque.max() <= 19.1 * 1.001


def test_friction_about_the_screw_is_the_guideway_s() -> None:
    """Stribeck's curve at the carriage, times L / 2 pi, each direction its own."""
    down = replace(RIGID.friction.negative, coulomb=190, static=400, stribeck_velocity=0.02)
    drive = replace(RIGID, friction=replace(RIGID.friction, negative=down))
    r = drive.transmission.ratio
    for v in (1e-6, 0.003, 0.01, 0.2, -1e-6, -0.004, -0.03, -0.2):
        torque = sliding_friction(np.sign(v), v / r, shafts(drive))
        assert torque == pytest.approx(friction_force(v, drive.friction) * r, rel=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_speed_settles_on_its_reference_with_the_friction_s_torque(sign: int) -> None:
    """Each direction has its own friction."""
    up, down = RIGID.friction.positive, replace(RIGID.friction.negative, coulomb=190, viscous=500)
    drive = replace(RIGID, friction=replace(RIGID.friction, negative=down))
    trace = follow_speed(step(80.0 * sign, 4000), H, drive, load=500.0 * sign)
    one, r = up if sign > 0 else down, drive.transmission.ratio
    guideway = sign * (one.coulomb + one.viscous * 80.0 * r)
    torque = (guideway + sign * 500.0) * r + sign * (drive.motor.coulomb + 1e-4 * 80.0)
    assert trace.speed[-1] == pytest.approx(sign * 80.0, rel=1e-7)
    assert trace.friction[-1] == pytest.approx(guideway, rel=1e-7)
    # the voltage stands still over a period while the rotor turns by 32 mrad
    assert trace.torque[-1] == pytest.approx(torque, rel=2e-3)
    u = steady_voltages(trace.i_d[-1], trace.i_q[-1], sign * 80.0, drive.motor)
    assert (trace.u_d[-1], trace.u_q[-1]) == pytest.approx(u, abs=0.02)


@pytest.mark.parametrize("drive", [RIGID, TWISTING], ids=["rigid", "twisting"])
@pytest.mark.parametrize("sign", [1, -1])
def test_following_error_at_constant_feed(drive: ThreeLoopParameters, sign: int) -> None:
    """v / K_v without feed-forward, none with all of it; the scale is at the carriage."""
    v = 0.05
    reference = sign * v * 1e-3 * np.arange(600)
    lag = follow_position(reference, 1e-3, drive)
    assert (lag.reference - lag.position)[-50:] == pytest.approx(sign * v / 40, rel=1e-4)
    ahead = follow_position(reference, 1e-3, position_loop(drive, velocity_feedforward=1.0))
    assert (ahead.reference - ahead.position)[-50:] == pytest.approx(0, abs=1e-7)


def test_an_encoder_on_the_motor_does_not_see_the_twist() -> None:
    """Its error is v / K_v, the carriage's more by the load over the stiffness."""
    v, load = 0.05, 1000.0
    drive = position_loop(TWISTING, motor_encoder=True)
    trace = follow_position(v * 1e-3 * np.arange(800), 1e-3, drive, load=load)
    assert (trace.reference - trace.motor_position)[-50:] == pytest.approx(v / 40, rel=1e-4)
    guideway = drive.friction.positive.coulomb + drive.friction.positive.viscous * v
    r = drive.transmission.ratio
    twist = (guideway + load) * r / drive.transmission.stiffness
    assert (trace.motor_position - trace.position)[-1] == pytest.approx(twist * r, rel=1e-4)


def balance(trace: ThreeLoopTrace, drive: ThreeLoopParameters) -> tuple[float, float]:
    """Greatest gap in the motor's and in the shafts' energies, as a share of the work put in."""
    put_in, copper, shaft, lost, load = (trace.states[:, k] for k in (INPUT, COPPER, SHAFT, LOST,
                                                                      LOAD))  # fmt: skip
    motor = put_in - copper - shaft - magnetic_energy(trace.i_d, trace.i_q, drive.motor)
    stored = drive.motor.inertia * trace.speed**2 / 2
    stored += drive.transmission.load_inertia * trace.load_speed**2 / 2
    if np.isfinite(drive.transmission.stiffness):
        twist = (trace.motor_position - trace.position) / drive.transmission.ratio
        stored += drive.transmission.stiffness * twist**2 / 2
    shafts = shaft - lost - load - stored
    size = np.abs(put_in).max()
    return np.abs(motor).max() / size, np.abs(shafts).max() / size


@pytest.mark.parametrize("switched", [False, True], ids=["averaged", "switched"])
@pytest.mark.parametrize("drive", [RIGID, TWISTING], ids=["rigid", "twisting"])
def test_energy_of_a_run_balances(drive: ThreeLoopParameters, switched: bool) -> None:
    """Up, loaded, and back through standstill: heat, field, motion, twist and load are all."""
    speed = np.repeat([1000 * RPM, -500 * RPM], 1500)
    load = np.where(np.arange(3000) % 1500 > 700, 1500.0, 0.0)
    trace = follow_speed(speed, H, inverter(drive, switched=switched), load=load)
    assert max(balance(trace, drive)) < 1e-9


def test_switching_is_the_mean_voltage_at_the_ends_of_the_periods() -> None:
    """The ripple lies within the periods, 1 A high at 10 kHz; at their ends hardly any is left."""

    def difference(period: float) -> float:
        drive = replace(RIGID, current_loop=replace(RIGID.current_loop, period=period))
        runs = [
            follow_speed(step(500 * RPM, 101), 1e-3, inverter(drive, switched=on))
            for on in (False, True)
        ]
        return np.abs(runs[0].i_q - runs[1].i_q)[5:].max()

    coarse, fine = difference(1e-4), difference(2.5e-5)
    assert 0 < coarse < 1e-3
    # the ripple itself falls by 4, and what is left of it at least as fast
    assert fine < coarse / 4


def test_the_voltage_stays_in_the_circle_or_in_the_hexagon() -> None:
    """Speed is out of reach: the inverter's voltage is what holds it back."""
    short = inverter(RIGID, dc_link=60.0)
    traces = [
        follow_speed(step(3000 * RPM, 3000), H, inverter(short, overmodulation=on))
        for on in (False, True)
    ]
    lengths = [np.hypot(trace.u_d, trace.u_q) for trace in traces]
    assert lengths[0].max() == pytest.approx(60 / np.sqrt(3), rel=1e-12)
    assert 60 / np.sqrt(3) * 1.05 < lengths[1].max() <= 60 * 2 / 3 * (1 + 1e-12)
    assert traces[1].speed[-1] > traces[0].speed[-1] > 0


def test_rules_move_the_gains_within_their_ranges() -> None:
    rules = FuzzyParameters(error_scale=10 / (1000 * RPM), change_scale=10 / 6000)
    trace = follow_speed(step(1000 * RPM, 600), H, speed_loop(TWISTING, fuzzy=rules))
    for gain, low, high in ((trace.proportional, 0.2, 0.8), (trace.integral, 20, 60)):
        assert low - 1e-12 <= gain[1:].min() < gain[1:].max() <= high + 1e-12
    # the first error has no change yet
    p, i = increments(10.0, 0.0)
    first = (0.5 * (1 + 0.6 * p), 40 * (1 + 0.5 * i))
    assert (trace.proportional[1], trace.integral[1]) == pytest.approx(first)
    # error and its change are zero at the end: both in the middle
    assert trace.proportional[-1] == pytest.approx(0.5, abs=0.02)
    assert trace.integral[-1] == pytest.approx(40, abs=1)


def test_loops_of_a_slower_period_hold_what_they_ask() -> None:
    """A speed loop at a quarter of the clock changes its gains' torque only every fourth period."""
    drive = speed_loop(friction(RIGID, 1e9), proportional=0.05, integral=4.0, every=4)
    trace = follow_speed(step(10.0, 400), H, drive)
    # jammed: torque asked grows by K_i e h each time; the current settles on it
    asked = 0.5 + 4.0 * 10.0 * 4 * H * (np.arange(400) // 4)
    last = np.arange(207, 400, 4)
    lag = np.exp(-drive.current_loop.bandwidth * 3 * H)
    assert trace.torque[last] == pytest.approx(asked[last], abs=2 * 0.016 * lag + 1e-9)


def test_the_position_loop_acts_in_its_own_periods() -> None:
    """Jammed: each 2 ms the torque goes to K_p K_v x_ref 2 pi / L and stays there."""
    drive = speed_loop(friction(RIGID, 1e9), proportional=0.05, integral=0.0)
    reference = 1e-3 * H * np.arange(200)
    trace = follow_position(reference, H, position_loop(drive, every=20))
    asked = 0.05 * 40 * reference[::20] / drive.transmission.ratio
    # 19 periods of the current loop leave exp(-6) of each step
    rise = np.diff(asked).max() * np.exp(-19 * H * drive.current_loop.bandwidth)
    assert trace.torque[19::20] == pytest.approx(asked, abs=1.1 * rise)


@pytest.mark.parametrize("follow", [follow_speed, follow_position])
def test_what_rests_stays_exactly_at_rest(follow) -> None:
    trace = follow(np.zeros(50), 1e-3, TWISTING)
    for name in ("position", "speed", "i_d", "i_q", "torque", "friction"):
        assert np.all(getattr(trace, name) == 0), name
    assert np.all(trace.states[:, INPUT] == 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"reference": []}, r"reference has shape \(0,\)"),
        ({"load": [1.0, 2.0]}, "load has 2 samples, the reference 5"),
        ({"load": np.inf}, r"load\[0\] = inf: give finite"),
        ({"period": 1.5e-4}, r"period = 0\.00015 s .* multiple of current_loop\.period = 0\.0001"),
        ({"period": np.nan}, "period = nan s"),
        ({"steps": 0}, "steps = 0 must be a whole number"),
        (
            {"drive": replace(TWISTING, transmission=replace(
                TWISTING.transmission, coupling_stiffness=1e9, screw_stiffness=1e9,
                axial_stiffness=1e15))},
            r"steps = 5 are too few for the shaft's resonance of 1\.21e\+06 1/s: take 243 or more",
        ),
        ({"drive": replace(TWISTING, position_loop=None)}, r"drive\.position_loop is missing"),
    ],
)  # fmt: skip
def test_inputs_that_do_not_fit_are_refused(change: dict, words: str) -> None:
    values = {"reference": np.zeros(5), "period": 1e-3, "drive": TWISTING} | change
    with pytest.raises(ValueError, match=words):
        follow_position(**values)


@pytest.mark.parametrize("fuzzy", [None, FuzzyParameters(error_scale=0.1, change_scale=1e-3)])
@pytest.mark.parametrize(("load", "target"), [(1e12, 0.0), (0.0, 1e308)])
def test_a_drive_that_runs_away_says_when_and_what_to_do(fuzzy, load, target) -> None:
    """Dragged beyond any speed; or sent to a place that no number holds."""
    drive = position_loop(speed_loop(TWISTING, fuzzy=fuzzy), gain=1e3)
    reference = np.array([0.0, target, target, target])
    with pytest.raises(ValueError, match=r"runs away at 0 s: lower the gains .* or the load"):
        follow_position(reference, 1e-3, drive, load=load)
