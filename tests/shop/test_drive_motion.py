"""The simulated axes and their motor: balances, steady states, other solvers, limits."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.schema.si import RPM
from pipeline.shop.drives.axis import Followed, follow, truth
from pipeline.shop.drives.motor import (
    FIELD,
    HOLD,
    I_D,
    I_Q,
    RATE,
    SPEED,
    SPEEDS,
    TORQUE,
    U_D,
    U_Q,
    WARMTH,
    _change,
    _machine,
    driven,
    speed_steps,
)
from pipeline.shop.drives.parameters import Axis, Cascade, Drives, Friction
from pipeline.shop.drives.records import Move, travel

from .conftest import shop_parameters

LIMITS = (3000.0, 50000.0)  # [mm/s2], [mm/s3]
FINE = {"scale_step": 1e-3, "steps_per_turn": 2**26}
"""Encoders whose steps count for nothing."""


def quiet(axis: Axis, friction: Friction | None = None, **cascade: object) -> Axis:
    """The axis without what makes its forces waver."""
    motor = replace(axis.motor, cogging=0.0, torque_ripple=0.0, current_noise=0.0)
    friction = replace(friction or axis.friction, pitch_ripple=0.0)
    loops = replace(axis.cascade, **cascade)  # type: ignore[arg-type]
    return replace(axis, motor=motor, friction=friction, cascade=loops)


def way(axis: Axis, *moves: Move) -> np.ndarray:
    return travel(moves, LIMITS, axis.cascade.position_frequency) * 1e-3


def run(axis: Axis, reference: np.ndarray, **outside: np.ndarray) -> Followed:
    return follow(axis, reference, np.random.default_rng(1), **outside)


def axes() -> list[tuple[str, Axis]]:
    return [
        (f"{machine} {letter}", axis)
        for machine in ("mill01", "mill02")
        for letter, axis in shop_parameters(machine).drives.axes.items()
    ]


every_axis = pytest.mark.parametrize("axis", [a for _, a in axes()], ids=[n for n, _ in axes()])


def stribeck(axis: Axis, v: float) -> float:
    """Force at a steady speed [m/s] by the formula alone [N]."""
    found = truth(axis)
    side = "positive" if v > 0 else "negative"
    c, s, v_s, b = (
        found[f"{name}_{side}"] for name in ("coulomb", "static", "stribeck_velocity", "viscous")
    )
    return float(np.sign(v) * (c + (s - c) * np.exp(-((v / v_s) ** 2))) + b * v + found["offset"])


@every_axis
@pytest.mark.parametrize("speed", [1.0, 5.0, 40.0, 200.0])
def test_steady_force_is_the_friction_curve_and_the_lag_that_of_the_loop(axis, speed):
    """At constant feed the current carries F(v), and e = (1 - f_v) v / (S_pp P_p).

    5e-5 of the force: three times what is found, the steps of the finest encoder; 0.1 nm of the
    lag: the same, beside 1 nm of the scale.
    """
    calm = quiet(axis, velocity_filter=0.1, **FINE)
    for sign in (1, -1):
        reference = way(calm, Move(length=sign * speed * 2.5, speed=speed))
        out = run(calm, reference)
        last = int((0.3 + 2.3) * calm.cascade.position_frequency)
        rows = slice(last - calm.cascade.position_frequency // 10, last)
        force = axis.force_constant * out.current[rows].mean()
        assert force == pytest.approx(stribeck(axis, sign * speed * 1e-3), rel=5e-5)
        c = axis.cascade
        lag = (1 - c.velocity_feedforward) * speed * 1e-3 / (c.position_scale * c.position_gain)
        seen = (reference - out.measured)[rows].mean()
        assert seen == pytest.approx(sign * lag, abs=1e-10)


@every_axis
def test_what_the_motor_gives_is_kept_lifted_or_lost(axis):
    """Work in = kinetic + elastic + potential energy + friction, over strokes under load.

    Recorded at each step; semi-implicit Euler keeps the balance to first order in its step, 2e-4
    of what the motor turns over.
    """
    calm = quiet(axis, position_frequency=40000, velocity_frequency=40000)
    reference = way(calm, Move(length=30.0, speed=150.0), Move(length=-30.0, speed=150.0))
    load = np.full(reference.size, 200.0)
    out = run(calm, reference, load=load)
    h = 1 / 40000
    stretch = out.motor - out.carriage
    gap = calm.backlash * 1e-6 / 2
    spring = calm.stiffness * 1e6 * (stretch - np.clip(stretch, -gap, gap))
    force = np.gradient(out.motor_speed, h) * calm.motor_mass
    force = out.force - force - calm.motor_viscous * calm.gear**2 * out.motor_speed
    given = np.sum(out.force * out.motor_speed) * h
    kept = 0.5 * calm.motor_mass * out.motor_speed**2 + 0.5 * calm.carriage * out.speed**2
    kept += 0.5 * spring**2 / (calm.stiffness * 1e6)
    lifted = (calm.weight + load[0]) * (out.carriage[-1] - out.carriage[0])
    lost = np.sum(out.friction * out.speed) * h
    lost += np.sum(calm.motor_viscous * calm.gear**2 * out.motor_speed**2) * h
    lost += np.sum((force - spring) * (out.motor_speed - out.speed)) * h  # in the screw
    turned = np.sum(np.abs(out.force * out.motor_speed)) * h
    assert given == pytest.approx(kept[-1] - kept[0] + lifted + lost, abs=5e-4 * turned)
    assert lost > 0.1 * turned


@every_axis
def test_friction_never_gives_more_than_its_bristles_hold(axis):
    """LuGre's friction is passive: its work from the start is at least the bristles' energy."""
    calm = quiet(axis, position_frequency=40000, velocity_frequency=40000)
    out = run(calm, way(calm, *[Move(length=s * 2.0, speed=30.0, pause=0.02) for s in (1, -1)]))
    work = np.cumsum(out.friction * out.speed) / 40000
    held = 0.5 * axis.friction.bristle_stiffness * 1e6 * out.bristle**2
    assert np.all(work >= held - 1e-4)  # J; of the sum for an integral


def test_a_push_at_standstill_bends_screw_and_bristles():
    """Before it slides the carriage gives way by F / (K + sigma_0); the motor holds its place.

    A push of a fiftieth of static friction: creep of the bristles and half a step of the scale, by
    which the motor stands off, change 2 % at most.
    """
    axis = quiet(Drives().x, feedback="motor", **FINE)
    reference = np.zeros(8 * axis.cascade.position_frequency)
    push = 8.0 * np.clip(np.arange(reference.size) / reference.size * 8, 0, 1)
    out = run(axis, reference, load=push)
    stiffness = axis.stiffness * 1e6 + axis.friction.bristle_stiffness * 1e6
    settled = int(1.5 * axis.cascade.position_frequency)
    assert -out.carriage[settled] == pytest.approx(8.0 / stiffness, rel=0.02)
    assert abs(out.motor[settled]) < 0.5e-9


def test_play_is_lost_at_each_reversal():
    """Carriage behind screw, there less back: the play and twice what friction bends the screw."""
    axis = quiet(shop_parameters("mill02").drives.y, **FINE)
    assert axis.backlash > 0
    out = run(axis, way(axis, Move(length=10.0, speed=10.0), Move(length=-10.0, speed=10.0)))
    f = axis.cascade.position_frequency
    there, back = (np.mean((out.motor - out.carriage)[k - 100 : k]) for k in (f, int(2.4 * f)))
    b = axis.motor_viscous * axis.gear**2 * 0.01  # borne before the screw
    bend = (stribeck(axis, 0.01) - stribeck(axis, -0.01) - 2 * b) / (axis.stiffness * 1e6)
    assert there - back == pytest.approx(axis.backlash * 1e-6 + bend, rel=5e-3)


@every_axis
def test_at_rest_it_hangs_on_the_current_that_carries_its_weight(axis):
    out = run(quiet(axis), np.full(axis.cascade.position_frequency, 0.1234))
    assert out.current * axis.force_constant == pytest.approx(
        np.full(out.current.size, axis.weight), abs=1.0
    )
    assert np.ptp(out.carriage) < 1e-6 * axis.cascade.scale_step
    assert (axis.weight > 0) == axis.vertical


def test_the_current_keeps_its_limit_and_the_integral_does_not_wind_up():
    """Driven far into the limit, the current turns as soon as the velocity's error does.

    20 ms: the filter of the velocity, the delay and the current's lag, many times; an integral that
    had wound up would take more than the whole run.
    """
    axis = quiet(Drives().x, current_limit=4.0, velocity_feedforward=0.0)
    reference = way(axis, Move(length=200.0, speed=600.0, pause=1.5))
    out = run(axis, reference)
    assert np.abs(out.current).max() == pytest.approx(4.0, rel=1e-6)
    assert np.mean(np.abs(out.current) > 3.99) > 0.1
    c = axis.cascade
    error = c.position_scale * c.position_gain * (reference - out.measured) - out.motor_speed
    turned = np.flatnonzero((error[:-1] > 0) & (error[1:] <= 0) & (out.current[1:] > 3.99))
    later = turned + int(0.02 * c.position_frequency)
    assert len(later) >= 1
    assert np.all(out.current[later] < 0)
    assert out.carriage[-1] == pytest.approx(0.2, abs=1e-5)


def by_another_solver(axis: Axis, moves: tuple[Move, ...], times: np.ndarray) -> np.ndarray:
    """Carriage and current by SciPy's implicit solver; loops without ticks, no encoder steps."""
    f, c = axis.friction, axis.cascade
    k, d, gap = axis.stiffness * 1e6, axis.damping * 1e3, axis.backlash * 1e-6 / 2
    kt, viscous = axis.force_constant, axis.motor_viscous * (2 * pi / axis.lead * 1e3) ** 2
    grid = np.arange(int(times[-1] * 40000) + 2) / 40000
    command = travel(moves, LIMITS, 40000)[: grid.size] * 1e-3
    rate = np.gradient(command, grid)

    def change(t: float, y: np.ndarray) -> list[float]:
        x_m, v_m, x_c, v_c, z, integral, current, seen = y
        stretch = x_m - x_c
        force = k * (stretch - np.clip(stretch, -gap, gap)) + d * (v_m - v_c) * (
            gap == 0 or abs(stretch) > gap
        )
        side = "positive" if v_c > 0 else "negative"
        v_s = getattr(f, f"stribeck_velocity_{side}") * 1e-3
        slow = np.exp(-((v_c / v_s) ** 2))
        coulomb, static = getattr(f, f"coulomb_{side}"), getattr(f, f"static_{side}")
        bent = v_c - f.bristle_stiffness * 1e6 * abs(v_c) * z / (
            coulomb + (static - coulomb) * slow
        )
        friction = f.bristle_stiffness * 1e6 * z + f.bristle_damping * 1e3 * slow * bent
        friction += getattr(f, f"viscous_{side}") * v_c
        measured = x_m if c.feedback == "motor" else x_c
        wanted = c.position_scale * c.position_gain * (np.interp(t, grid, command) - measured)
        wanted += c.velocity_feedforward * np.interp(t, grid, rate)
        error = wanted - seen
        asked = c.velocity_scale * c.velocity_gain * error + integral
        return [
            v_m, (kt * current - force - viscous * v_m) / axis.motor_mass,
            v_c, (force - friction - axis.weight) / axis.carriage, bent,
            c.integral_scale * c.integral_gain * error,
            (asked - current) / (axis.motor.current_lag * 1e-3),
            (v_m - seen) / (c.velocity_filter * 1e-3),
        ]  # fmt: skip

    hold = axis.weight / kt
    start = [0.0, 0.0, -axis.weight / k, 0.0, 0.0, hold, hold, 0.0]
    if c.feedback == "scale":
        start[0], start[2] = axis.weight / k, 0.0
    found = solve_ivp(change, (0, times[-1]), start, method="LSODA", t_eval=times, rtol=1e-8,
                      atol=1e-11, max_step=2e-4)  # fmt: skip
    return found.y[[2, 6]]


@pytest.mark.parametrize("letter", ["X", "Z"])
@pytest.mark.parametrize("seconds", [0.45, pytest.param(0.9, marks=pytest.mark.proof)])
def test_another_solver_finds_the_same_motion(letter, seconds):
    """Stroke of mill01, as proof also its reversal, by LSODA with loops in continuous time.

    With loops at 40 kHz what is left is their delay of 25 to 50 us and the steps of the encoder:
    0.4 um of 12 mm and 4e-4 of the current are found.
    """
    axis = quiet(
        Drives().axes[letter], position_frequency=40000, velocity_frequency=40000,
        acceleration_feedforward=0.0, **FINE,
    )  # fmt: skip
    moves = (Move(length=12.0, speed=150.0, pause=0.02), Move(length=-12.0, speed=150.0))
    out = run(axis, way(axis, *moves))
    times = np.arange(0, seconds, 1e-3)
    rows = np.round(times * 40000).astype(int)
    carriage, current = by_another_solver(axis, moves, times)
    assert out.carriage[rows] == pytest.approx(carriage, abs=1e-6)
    assert np.sqrt(np.mean((out.current[rows] - current) ** 2)) < 1e-3 * np.abs(current).max()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Cascade(velocity_frequency=3000), "must divide one another"),
        (lambda: Friction(static_positive=100.0), r"static_positive = 100.0 \[N\] must not be"),
        (lambda: Axis(lead=0.0), "Axis.lead = 0.0 mm must lie from 1 to 100"),
        (lambda: Drives(x=Axis(cascade=Cascade(position_frequency=1000))), "one for all axes"),
    ],
)
def test_drives_that_cannot_be_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


STATES = np.random.default_rng(4).uniform(-1, 1, (200, 7)) * [15, 15, 240, 3.0, 0, 300, 300]


def test_electric_power_is_heat_field_and_work():
    """1.5 (u i) = 1.5 R i^2 + d/dt 1.5 (L_d i_d^2 + L_q' i_q^2)/2 + T w, to rounding."""
    m = _machine(Drives().x)._replace(lost_voltage=0.0, viscous=0.0, coulomb=0.0)
    for i_d, i_q, speed, angle, _, u_d, u_q in STATES.tolist():
        d_d, d_q, d_speed, _, _ = _change(m, (i_d, i_q, speed, angle, 0.0), u_d, u_q, 0.0)
        given = 1.5 * (u_d * i_d + u_q * i_q)
        heat = 1.5 * m.resistance * (i_d**2 + i_q**2)
        slope_q = m.inductance_q * (1 - 3 * m.saturation * i_q**2)
        field = 1.5 * (m.inductance_d * i_d * d_d + slope_q * i_q * d_q)
        work = m.inertia * d_speed * speed
        assert given == pytest.approx(heat + field + work, abs=1e-9 * (abs(given) + 1000))


def test_the_dead_time_takes_power_and_is_gone_without_current():
    m = _machine(Drives().x)
    free = m._replace(lost_voltage=0.0)
    for i_d, i_q, speed, angle, _, u_d, u_q in STATES.tolist():
        x = (i_d, i_q, speed, angle, 0.0)
        with_, without = (_change(k, x, u_d, u_q, 0.0) for k in (m, free))
        lost = 1.5 * (
            i_d * m.inductance_d * (without[0] - with_[0])
            + i_q * m.inductance_q * (1 - 3 * m.saturation * i_q**2) * (without[1] - with_[1])
        )
        phases = [i_d * np.cos(angle - k) - i_q * np.sin(angle - k) for k in (0, 2.0944, -2.0944)]
        spent = sum(m.lost_voltage * p * p / (abs(p) + 0.1) for p in phases)
        assert lost == pytest.approx(spent, rel=1e-4, abs=1e-3)  # 2.0944 for a third of a turn
    still = _change(m, (0.0, 0.0, 0.0, 1.0, 0.0), 5.0, 7.0, 0.0)
    assert still[:2] == pytest.approx((5.0 / m.inductance_d, 7.0 / m.inductance_q))


def test_currents_go_as_another_solver_goes():
    """SciPy's solver with the recorded voltages, period for period, finds the recorded state.

    1e-8 A: of Runge-Kutta steps of 20 us with time constants of 8 ms; without the dead time, whose
    kink at zero current no step of fixed length meets.
    """
    m = _machine(Drives().x)._replace(lost_voltage=0.0)
    part = np.arange(120)
    out = driven(m, np.full(part.size, 900 * RPM), np.where(part > 60, -3.0, 0.0),
                 np.where(part > 90, 5.0, 0.0))  # fmt: skip
    x = np.zeros(5)
    for k in range(part.size):
        assert out[k, [I_D, I_Q, SPEED]] == pytest.approx(x[:3], abs=1e-8)
        load = 5.0 if k > 90 else 0.0
        x = solve_ivp(
            lambda _, y, k=k, load=load: _change(m, tuple(y), *out[k, [U_D, U_Q]], load),
            (0, m.period), x, rtol=1e-10, atol=1e-12,
        ).y[:, -1]  # fmt: skip
    assert np.abs(out[:, I_D]).max() > 2


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_at_steady_speed_the_voltages_are_those_of_the_equations(machine):
    """u_q = R i_q + w (L_d i_d + flux) and u_d = R i_d - w L_q i_q, but for the dead time.

    Means of the last tenths before each change; the dead time takes 4/pi of its voltage at most.
    """
    axis = shop_parameters(machine).drives.x
    m, out = _machine(axis), speed_steps(axis)
    spread = []
    for k in range(len(SPEEDS) * len(FIELD)):
        last = int((k + 1) * HOLD / len(FIELD) * RATE) - 2
        u_d, u_q, i_d, i_q, speed, warmth = out[last - 200 : last, : WARMTH + 1].mean(axis=0)
        w, r = m.pole_pairs * speed, m.resistance * (1 + 0.00393 * warmth)
        flux_q = m.inductance_q * i_q * (1 - m.saturation * i_q**2)
        settled = np.ptp(out[last - 200 : last, SPEED]) < 1.0
        if settled:
            spread.append(u_q - r * i_q - w * (m.inductance_d * i_d + m.flux))
            spread.append(u_d - r * i_d + w * flux_q)
    assert len(spread) > 30
    assert np.abs(spread).max() < 4 / np.pi * axis.motor.dead_time_error + 0.1
    assert np.abs(spread).max() > 0.5 * axis.motor.dead_time_error


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_the_motor_is_the_one_of_the_axis(machine):
    """Torque for each ampere without i_d is the axis' torque constant; its limits are kept."""
    axis = shop_parameters(machine).drives.x
    out = speed_steps(axis)
    plain = (np.abs(out[:, I_D]) < 0.02) & (np.abs(out[:, I_Q]) > 3)
    constant = out[plain, TORQUE] / out[plain, I_Q]
    assert constant == pytest.approx(np.full(plain.sum(), axis.motor.torque_constant), rel=1e-3)
    limit = axis.motor.bus_voltage / np.sqrt(3)
    assert np.hypot(out[:, U_D], out[:, U_Q]).max() <= limit * (1 + 1e-9)
    assert 0.2 < out[-1, WARMTH] < 10
    travel = np.cumsum(out[:, SPEED]) / RATE / axis.gear
    assert np.ptp(travel) < 0.6  # m
