"""The servo drive: single steps against closed forms and balances, traces against plain Python."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.kernels import compiled
from pipeline.machine.axis.drive import (
    FARTHEST,
    NO_RULES,
    Servo,
    ServoState,
    _followed,
    decay,
    servo_step,
    simulate,
)
from pipeline.machine.axis.drive_parameters import (
    DriveColumn,
    DriveStart,
    ServoParameters,
    drive_row,
    friction_force,
)
from pipeline.machine.axis.motor import force_constant
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from tests.machine.steps import both, screw_step, speed_after
from tests.twin.axes import AXIS, DriveParameters, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=0.9,
)  # fmt: skip
STEPS = 4000


def varied(individuals: int) -> list[DriveParameters]:
    rng = np.random.default_rng(1)
    return [
        with_servo(
            with_drive(FULL, mass=150 * rng.uniform(0.8, 1.2)),
            position_gain=40 * rng.uniform(0.5, 1.5),
        )
        for _ in range(individuals)
    ]


def rows(individuals: int) -> NDArray[np.float64]:
    return np.array([drive_row(one.servo, one.feed_drive) for one in varied(individuals)])


def references(axes: int, steps: int = STEPS) -> NDArray[np.float64]:
    """Reversals, steps that reach the limit, and a crawl that sticks and slips."""
    t = T * np.arange(steps)
    every = [to_and_fro(steps), 0.01 * np.round(np.sin(t), 1), 0.0003 * t]
    return np.stack([every[a % 3] for a in range(axes)], axis=1)


def loads(axes: int) -> NDArray[np.float64]:
    return np.outer(30 * np.sin(7 * T * np.arange(STEPS)), np.ones(axes))


def test_variants_do_not_depend_on_their_company() -> None:
    table, reference = rows(5), references(1)[:, 0]
    whole = simulate(reference, T, table, load=loads(1)[:, 0])
    for i in range(5):
        alone = simulate(reference, T, table[i : i + 1], load=loads(1)[:, 0])
        np.testing.assert_array_equal(alone.command[0], whole.command[i])


def test_load_factor_multiplies_the_load() -> None:
    half = rows(1)
    half[:, DriveColumn.LOAD_FACTOR] = 0.5
    reference, load = references(1)[:, 0], loads(1)[:, 0]
    found = simulate(reference, T, half, load=load)
    expected = simulate(reference, T, rows(1), load=0.5 * load)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-12)


def test_variants_start_where_they_are_told() -> None:
    drive = varied(1)[0]
    start = DriveStart(position=0.001, velocity=0.02, command=0.4, reference_velocity=0.03)
    reference = references(1)[500:1500, 0]
    row = drive_row(drive.servo, drive.feed_drive)
    found = simulate(reference, T, np.stack((row, row)), start=start)
    assert found.position[1, 0] == 0.001 and found.velocity[1, 0] == 0.02
    assert found.command[1, 0] == pytest.approx(0.4, rel=1e-12)


def test_a_row_holds_the_parameters_in_the_order_of_its_columns() -> None:
    row = drive_row(FULL.servo, FULL.feed_drive, load_factor=0.5)
    sides = {"POSITIVE": FULL.feed_drive.friction.positive}
    sides["NEGATIVE"] = FULL.feed_drive.friction.negative
    expected = {"LOAD_FACTOR": 0.5}
    for column in DriveColumn:
        name, _, side = column.name.rpartition("_")
        if side in sides:
            name = {"STRIBECK": "stribeck_velocity"}.get(name, name.lower())
            expected[column.name] = getattr(sides[side], name)
        elif column.name != "LOAD_FACTOR":
            owner = FULL.servo if hasattr(FULL.servo, column.name.lower()) else FULL.feed_drive
            expected[column.name] = getattr(owner, column.name.lower())
    assert row.tolist() == [expected[column.name] for column in DriveColumn]


@compiled
def _decays(y, out):  # type: ignore[no-untyped-def]
    for i in range(y.shape[0]):
        out[i] = decay(y[i])


def test_decay_is_the_exponential() -> None:
    y = np.r_[0.0, np.geomspace(1e-18, FARTHEST, 200_000), np.linspace(FARTHEST, 100, 1000)]
    found = np.empty_like(y)
    _decays(y, found)
    near = y <= FARTHEST
    assert found[0] == 1.0
    assert np.abs(found[near] / np.exp(-32 * y[near]) - 1).max() < 6e-11
    assert np.abs(found - np.exp(-32 * y)).max() < 6e-11


def test_an_unstable_variant_leaves_the_others_alone() -> None:
    table, reference = rows(3), references(1)[:, 0]
    table[:, DriveColumn.CURRENT_LIMIT] = np.inf
    expected = simulate(reference, T, table)
    table[1, DriveColumn.PROPORTIONAL] *= 100
    found = simulate(reference, T, table)
    assert not np.isfinite(found.position[1, -1])
    for p in (0, 2):
        np.testing.assert_array_equal(found.position[p], expected.position[p])


@pytest.mark.parametrize(
    "change, said",
    [
        ({"reference": np.zeros((10, 2))}, r"reference has shape \(10, 2\): give one row"),
        ({"reference": np.full(10, np.nan)}, r"reference\[0\] = nan"),
        ({"load": np.full(10, np.inf)}, r"load\[0\] = inf"),
        ({"load": np.zeros(9)}, "load has 9 samples, the reference 10"),
        ({"period": 0.0}, "period = 0.0 s must be finite and positive"),
        ({"substeps": 0}, "substeps = 0 must be at least 1"),
    ],
)
def test_inputs_out_of_range_are_refused(change: dict[str, object], said: str) -> None:
    known = {"reference": np.zeros(10), "period": T, "table": rows(2)}
    with pytest.raises(ValueError, match=said):
        simulate(**{**known, **change})


def plain(
    reference: NDArray[np.float64],
    load: NDArray[np.float64],
    row: NDArray[np.float64],
    *,
    held: int = 1,
    spring: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """Position and command of one axis from rest, (2, T), by the equations as they are written."""
    loop, p, i, ahead, further, limit, mass, k, offset, factor = row[:10]
    sides = {True: row[10:14], False: row[14:18]}
    seen_share, held_share = (-np.expm1(-T / lag) if lag > 0 else 1.0 for lag in row[19:21])
    x, v, z, v_ref, seen, summed = float(reference[0]), 0.0, 0.0, 0.0, 0.0, offset / k
    last, rate, step, traces = x, 0.0, T / held, []
    for x_ref, push in zip(reference, load, strict=True):
        new = (x_ref - last) / T
        change, last, rate = (new - rate) / T, x_ref, new
        v_ref += held_share * (loop * (x_ref - x) + ahead * rate - v_ref)
        seen += seen_share * (v - seen)
        demand = p * (v_ref - seen) + summed + further * change
        command = np.clip(demand, -limit, limit)
        if (demand - command) * (v_ref - seen) <= 0:
            summed += T * i * (v_ref - seen)
        traces.append((x, command))
        force = k * command - offset - factor * push
        for _ in range(held):
            coulomb, static, stribeck, viscous = sides[bool(v > 0)]
            curve = coulomb + (static - coulomb) * np.exp(-((v / stribeck) ** 2))
            if spring is not None:
                z = (z + step * v) / (1 + step * (spring[0] * abs(v) / curve + spring[1]))
                after = (v + step / mass * (force - spring[0] * z)) / (1 + step * viscous / mass)
            else:
                free = v + step / mass * (force - viscous * v / 2)
                low, high, _, slow = sides[bool(free > 0)]
                level = (
                    high
                    if v * free <= 0
                    else low + (high - low) * np.exp(-((v / sides[bool(v > 0)][2]) ** 2))
                )
                slip = max(abs(free) - step / mass * level, 0.0) / (1 + step / mass * slow / 2)
                after = np.sign(free) * slip
            x, v = x + step * (v + after) / 2, after
    return np.array(traces).T


@pytest.mark.parametrize("held", [1, 3])
def test_traces_are_those_of_the_equations_in_plain_python(held: int) -> None:
    """Unequal lags, friction by direction, limit, feed-forward: each has its place in the row."""
    for reference in references(3).T:
        load, table = loads(1)[:, 0], rows(1)
        traces = simulate(reference, T, table, load=load, substeps=held)
        position, command = plain(reference, load, table[0], held=held)
        np.testing.assert_allclose(traces.position[0], position, atol=1e-9)
        np.testing.assert_allclose(traces.command[0], command, atol=1e-6)


def test_presliding_is_that_of_the_equations_in_both_directions() -> None:
    spring, table = (2e7, 3.0), rows(1)
    for sign in (1.0, -1.0):
        reference = sign * 2e-5 * np.sin(8 * T * np.arange(STEPS))
        load = 40 * np.sin(11 * T * np.arange(STEPS))
        traces = simulate(reference, T, table, load=load, substeps=4, spring=spring)
        position, command = plain(reference, load, table[0], held=4, spring=spring)
        np.testing.assert_allclose(traces.position[0], position, atol=1e-10)
        np.testing.assert_allclose(traces.command[0], command, atol=1e-6)


MASS, DT = 150.0, 1e-3
UP = DirectionFriction(coulomb=60.0, static=90.0, stribeck_velocity=0.01, viscous=200.0)
DOWN = DirectionFriction(coulomb=50.0, static=80.0, stribeck_velocity=0.02, viscous=400.0)
BOTH = FrictionParameters(positive=UP, negative=DOWN)


def same(**values: float) -> FrictionParameters:
    return both(DirectionFriction(**{"stribeck_velocity": 0.005, "viscous": 0.0} | values))


def screw(friction: FrictionParameters = BOTH, **values: float) -> FeedDriveParameters:
    return FeedDriveParameters(mass=MASS, force_constant=300.0, friction=friction, **values)


@given(st.floats(-80, 90), st.floats(1e-6, 1.0))
def test_below_the_breakaway_level_nothing_moves(force: float, period: float) -> None:
    v, held = speed_after(0.0, force, MASS, period, BOTH)
    assert v == 0.0
    assert held == force


@pytest.mark.parametrize("force, sign", [(90.001, 1), (-80.001, -1)])
def test_above_the_breakaway_level_it_moves(force: float, sign: int) -> None:
    v, _ = speed_after(0.0, force, MASS, DT, BOTH)
    assert v * sign > 0


@given(st.floats(1e-5, 1.0), st.sampled_from([1, -1]))
def test_steady_speed_is_kept_by_the_force_of_the_curve(speed: float, sign: int) -> None:
    """The step's fixed point is Stribeck's curve, in each direction with its own set."""
    one = UP if sign > 0 else DOWN
    dip = (one.static - one.coulomb) * np.exp(-((speed / one.stribeck_velocity) ** 2))
    force = sign * (one.coulomb + dip + one.viscous * speed)
    assert friction_force(sign * speed, BOTH) == pytest.approx(force, rel=1e-14)
    v, mean = speed_after(sign * speed, force, MASS, DT, BOTH)
    # rounding: force and speed cancel against each other once
    assert v == pytest.approx(sign * speed, rel=1e-12)
    assert mean == pytest.approx(force, rel=1e-9)


def test_coulomb_friction_stops_after_the_time_and_way_of_constant_deceleration() -> None:
    friction, v, x, t = same(coulomb=60.0, static=60.0), 0.1003, 0.0, 0.0
    while v > 0:
        last, (v, _) = v, speed_after(v, 0.0, MASS, DT, friction)
        x, t = x + 0.5 * DT * (last + v), t + DT
    assert t - DT < MASS * 0.1003 / 60 <= t
    # the trapezoid is wrong in the step that stops only, by less than a dt^2 / 2
    assert x == pytest.approx(MASS * 0.1003**2 / (2 * 60), abs=60 / MASS * DT**2 / 2)
    assert speed_after(0.0, 0.0, MASS, DT, friction) == (0.0, 0.0)


def stick_and_slip(period: float, K: float, belt: float, end: float) -> np.ndarray:
    """Durations of the mass that a spring pulls along: slip, stick, slip, stick ..."""
    friction = same(coulomb=60.0, static=90.0, stribeck_velocity=0.02)
    x, v, moving, changes = -90 / K, 0.0, False, [0.0]
    for k in range(round(end / period)):
        # the spring's force in the middle of the step
        force = K * (belt * (k + 0.5) * period - x - 0.5 * period * v)
        last, (v, _) = v, speed_after(v, force, MASS, period, friction)
        x += 0.5 * period * (last + v)
        if (v != 0) != moving:
            moving = v != 0
            changes.append(k * period)
    return np.diff(changes)


def exact_stick_and_slip(K: float, belt: float) -> tuple[float, float]:
    def slip(t: float, s: np.ndarray) -> list[float]:
        level = 60 + 30 * np.exp(-((s[1] / 0.02) ** 2))
        return [s[1], (K * (belt * t - s[0]) - level) / MASS]

    def stops(t: float, s: np.ndarray) -> float:
        return s[1] if t > 1e-3 else 1.0

    stops.terminal, stops.direction = True, -1
    found = solve_ivp(
        slip, (0, 10), [-90 / K, 1e-9], events=stops, rtol=1e-11, atol=1e-14, method="DOP853"
    )
    t, x = found.t[-1], found.y[0, -1]
    return t, (90 - K * (belt * t - x)) / (K * belt)


@pytest.mark.parametrize("period", [1e-3, 2e-4, 2e-5])
def test_stick_slip_has_the_durations_of_the_exact_motion(period: float) -> None:
    K, belt = 4e4, 0.002
    slip, stick = exact_stick_and_slip(K, belt)
    # the first is the wait for the first start
    found = stick_and_slip(period, K, belt, 2.0)[1:]
    assert len(found) >= 7
    # both ends of a duration are known to a period; 335 ms and 65 ms
    assert found[::2] == pytest.approx(slip, abs=2 * period)
    assert found[1::2] == pytest.approx(stick, abs=2 * period)


def test_force_constant_is_the_power_balance_of_the_screw() -> None:
    """Motor's power k_t A omega is the carriage's F v, with v = omega L / 2 pi."""
    k_t, lead, omega = 0.7, 0.01, 40.0
    assert force_constant(k_t, lead) * omega * lead / (2 * pi) == pytest.approx(k_t * omega)


@given(
    st.floats(-0.5, 0.5), st.floats(-3, 3), st.floats(-200, 200), st.floats(-300, 300),
    st.floats(1e-5, 2e-3),
)  # fmt: skip
def test_energy_balance_closes_in_each_step(
    v: float, command: float, load: float, offset: float, period: float
) -> None:
    drive = screw(both(UP), offset=offset)
    x, after, friction = screw_step(0.0, v, command, load, period, drive)
    work = (300.0 * command - offset - load - friction) * x
    gained = 0.5 * 150.0 * (after**2 - v**2)
    assert work == pytest.approx(gained, abs=1e-12 * (1 + 75 * v**2 + abs(300 * command * x)))


def test_position_is_of_second_order_in_smooth_motion() -> None:
    """Against the closed form of M v' = F - mu v with F = 300 * 2 - 40 N, mu = 800 N s/m."""
    end, rate, top = 0.2, 800 / 150, 560 / 800
    drive = screw(same(coulomb=40.0, static=40.0, viscous=800.0))
    exact = top * end + (0.1 - top) / rate * (1 - np.exp(-rate * end))

    def error(steps: int) -> float:
        x, v = 0.0, 0.1
        for _ in range(steps):
            x, v, _ = screw_step(x, v, 2.0, 0.0, end / steps, drive)
        return abs(x - exact)

    orders = np.log2([error(10) / error(20), error(20) / error(40)])
    assert orders == pytest.approx(2.0, abs=0.02)


SERVO = ServoParameters(
    position_gain=40.0, velocity_gain=50.0, integral_gain=1000.0, position_scale=1.5,
    velocity_scale=2.0, integral_scale=0.5, velocity_feedforward=0.25, acceleration_feedforward=0.3,
)  # fmt: skip


def servo_command(
    reference: tuple[float, float, float],
    x: float,
    v: float,
    integral: float,
    servo: ServoParameters,
) -> tuple[float, ServoState]:
    """Command of one sample of 1 ms and the state for the next one; the integral in amperes."""
    loops = Servo(
        servo.loop_gain, servo.proportional, servo.integral, servo.velocity_feedforward,
        servo.acceleration_feedforward, servo.current_limit, 1e-3,
        _followed(servo.position_lag, 1e-3), _followed(servo.velocity_lag, 1e-3),
    )  # fmt: skip
    state = ServoState(integral, 0.0, 0.0, 0.0)
    command, after = servo_step(*reference, x, v, state, loops, NO_RULES)
    return command, ServoState(*after)


def test_command_by_hand() -> None:
    """v_ref = 60 * 1e-3 + 0.25 * 0.2 = 0.11; error 0.11 - 0.05; A = 6 + 500 * 2e-3 + 0.3 * 4."""
    command, after = servo_command((0.011, 0.2, 4.0), 0.010, 0.05, 500 * 2e-3, SERVO)
    assert command == pytest.approx(6.0 + 1.0 + 1.2, rel=1e-12)
    assert after.integral == pytest.approx(500 * (2e-3 + 1e-3 * 0.06), rel=1e-12)


def test_integral_stays_while_the_limit_holds_and_unwinds_at_once() -> None:
    """A blocked axis: it stays as it was, and falls in the sample in which the error turns."""
    servo = replace(SERVO, current_limit=5.0)
    command, state = servo_command((0.1, 0.0, 0.0), 0.0, 0.0, 0.5, servo)
    assert (command, state.integral) == (5.0, 0.5)
    command, state = servo_command((-1e-4, 0.0, 0.0), 0.0, 0.0, 50.0, servo)
    assert command == 5.0
    assert state.integral == pytest.approx(500 * (0.1 - 1e-3 * 60 * 1e-4), rel=1e-12)


def test_static_friction_below_coulomb_is_refused() -> None:
    with pytest.raises(ValueError, match=r"friction.static = 1.0 N must not be below coulomb"):
        DirectionFriction(coulomb=2.0, static=1.0, stribeck_velocity=0.005, viscous=0.0)
