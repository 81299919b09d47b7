"""The simulated spindle's heat networks: balances, steady states, steps, growth by hand."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.shop.growth.heat import (
    SUBSTEPS,
    Course,
    Heated,
    Path,
    heated,
    network,
    ring_lever,
    speed_growth,
    thermal_growth,
)
from pipeline.shop.growth.parameters import Body, Instruments
from pipeline.shop.motion import slewed
from pipeline.shop.parameters import ChillerParameters, ShopParameters, SpindleParameters
from pipeline.shop.spindle import (
    NODES,
    Heat,
    Inputs,
    capacities,
    copper_share,
    flux,
    friction_torque,
    heat,
    iron_loss,
    state_at_rest,
    viscosity,
    viscosity_line,
)

from .conftest import shop_parameters

SPINDLE = SpindleParameters()
FRONT, WINDING, BED = (NODES.index(n) for n in ("front_bearing", "winding", "bed"))


def _inputs(seconds: int, speed: float = 0.0, cut: float = 0.0, hold: bool = False) -> Inputs:
    on, off = np.ones(seconds, bool), np.zeros(seconds, bool)
    return Inputs(
        speed=np.full(seconds, speed), cut_power=np.full(seconds, cut), hold=on if hold else off,
        power=on, coolant=off, moving=off, ambient=np.full(seconds, 20.0),
    )  # fmt: skip


def _varied(seconds: int) -> Inputs:
    random = np.random.Generator(np.random.PCG64(5))
    blocks = seconds // 300
    steps = np.repeat(random.choice([0.0, 2400.0, 6000.0, 12000.0], blocks), 300)
    speed = slewed(steps, SPINDLE.motor.acceleration)
    cut = np.where(
        (steps > 0) & (speed == steps), np.repeat(random.uniform(0, 6000, blocks), 300), 0.0
    )
    flags = np.repeat(random.random((3, blocks)) < 0.6, 300, axis=1)
    air = 20 + 3 * np.sin(np.arange(seconds) / 5000)
    return Inputs(speed, cut, (speed == 0) & flags[0], np.ones(seconds, bool), flags[1], flags[2],
                  air)  # fmt: skip


def _imbalance(before: np.ndarray, result: Heat) -> float:
    stored = capacities(SPINDLE) @ (result.temperatures[-1] - before[:-1])
    return float(result.generated - result.to_air - result.to_chiller - stored)


def test_heat_made_is_heat_stored_or_carried_away():
    start = state_at_rest(17.0)
    result = heat(start, _varied(36000), SPINDLE)
    # an edge that gave to one node what it did not take from the other would show as megajoules
    assert abs(_imbalance(start, result)) < 1e-9 * result.generated
    assert result.generated > 1e6 and result.to_chiller > 1e6


def test_nothing_happens_at_rest_in_air_of_the_same_temperature():
    inputs = _inputs(3600)._replace(power=np.zeros(3600, bool))
    result = heat(state_at_rest(20.0), inputs, SPINDLE)
    np.testing.assert_allclose(result.temperatures, 20.0, atol=1e-12)
    assert result.generated == 0.0


def test_halving_the_step_halves_the_error():
    """Explicit Euler is of first order.

    The chiller is kept out, since its switching has no derivative.
    """
    p = SpindleParameters(chiller=ChillerParameters(setpoint=40.0))
    inputs = _inputs(1200, speed=9000.0, cut=3000.0)
    one, two, four = (heat(state_at_rest(20.0), inputs, p, n).temperatures[200] for n in (1, 2, 4))
    ratio = np.linalg.norm(one - two) / np.linalg.norm(two - four)
    assert ratio == pytest.approx(2.0, rel=0.1)


def test_one_second_is_fine_enough():
    inputs = _varied(7200)
    coarse, fine = (heat(state_at_rest(20.0), inputs, SPINDLE, n).temperatures for n in (1, 8))
    # 0.1 K is what the logger resolves; the chiller's water is left out, since its switching
    # falls out of step
    difference = np.delete(np.abs(coarse - fine), NODES.index("chiller"), axis=1)
    assert difference.max() < 0.1


def test_holding_position_heats_the_winding_and_standing_does_not():
    held = heat(state_at_rest(20.0), _inputs(7200, hold=True), SPINDLE).temperatures[-1]
    stood = heat(state_at_rest(20.0), _inputs(7200), SPINDLE).temperatures[-1]
    assert held[WINDING] - stood[WINDING] > 3.0
    assert stood[WINDING] - 20.0 < 3.0  # the chiller's water may be above the air


def test_the_front_bearing_warms_faster_than_the_bed():
    result = heat(state_at_rest(20.0), _inputs(1800, speed=12000.0), SPINDLE).temperatures
    assert result[-1, FRONT] - 20 > 10 > 3 > result[-1, BED] - 20


def test_a_weak_chiller_saturates():
    weak = SpindleParameters(chiller=ChillerParameters(capacity=200.0))
    hot, cool = (
        heat(state_at_rest(20.0), _inputs(14400, 12000.0, 4000.0), p).temperatures[-1]
        for p in (weak, SPINDLE)
    )
    water = NODES.index("chiller")
    assert cool[water] < SPINDLE.chiller.setpoint + SPINDLE.chiller.hysteresis + 0.2
    assert hot[water] > weak.chiller.setpoint + 5


def test_warm_oil_brakes_less():
    slope, intercept = viscosity_line(22.0, 4.4)
    assert viscosity(40.0, slope, intercept) == pytest.approx(22.0, rel=1e-9)
    assert viscosity(100.0, slope, intercept) == pytest.approx(4.4, rel=1e-9)
    cold, warm = (
        friction_torque(9000.0, viscosity(t, slope, intercept), 450.0, 0.0825, 1.0, 29e3)
        for t in (20.0, 60.0)
    )
    assert cold > 1.5 * warm


def test_palmgrens_torque_by_hand():
    """n = 10 000 rev/min, nu = 10 mm2/s, d_m = 80 mm, f0 = 2, no load.

    M0 = 1e-7 * 2 * (1e5)^(2/3) * 80^3 N mm = 220.6 N mm.
    """
    assert friction_torque(1e4, 10.0, 0.0, 0.08, 2.0, 2e4) == pytest.approx(0.22062, rel=1e-4)


def test_lubricant_torque_grows_with_two_thirds_power():
    a, b = (friction_torque(n, 20.0, 0.0, 0.08, 1.0, 2e4) for n in (2000.0, 16000.0))
    assert b / a == pytest.approx(4.0, rel=1e-9)
    low = [friction_torque(n, 20.0, 0.0, 0.08, 1.0, 2e4) for n in (1.0, 99.0)]
    assert low[0] == low[1]  # nu n < 2000


def test_motor_at_its_rated_point_and_in_field_weakening():
    assert copper_share(1.0, 1.0, 0.5) == pytest.approx(1.0)
    assert flux(1000.0, 2500.0) == 1.0
    assert flux(10000.0, 2500.0) == pytest.approx(0.25)
    # hysteresis loss falls as 1/n, eddy loss stays above the base speed
    assert iron_loss(flux(1e4, 2500.0), 4.0, 200.0, 100.0) == pytest.approx(50.0 + 100.0)


MACHINES = pytest.mark.parametrize("machine", ["mill01", "mill02"])
TOP = 12000.0


def _course(speed: np.ndarray, air: float = 20.0) -> Course:
    return Course(speed, np.full(speed.size, air), np.ones(speed.size, bool))


def _varied_course(seconds: int) -> Course:
    random = np.random.Generator(np.random.PCG64(3))
    steps = np.repeat(random.choice([0.0, 3000.0, 8000.0, TOP], seconds // 900), 900)
    course = _course(slewed(steps, 3500.0))
    return course._replace(air=20 + 3 * np.sin(np.arange(seconds) / 4000))


def _warmed(p: ShopParameters, course: Course, substeps: int = SUBSTEPS) -> Heated:
    """A machine that stood in air of 20 degC over a course."""
    net = network(p)
    return heated(net, state_at_rest(20.0, len(net.names)), course, p, substeps)


def _growth(parameters: ShopParameters, hot: Heated, speed: np.ndarray) -> np.ndarray:
    """Growth at each kept instant [um], from the weights of the nodes."""
    names, weights = network(parameters).names, thermal_growth(parameters.growth)
    at = np.minimum(np.arange(len(hot.temperatures)) * 10, speed.size - 1)
    thermal = hot.temperatures @ np.array([weights.get(name, 0.0) for name in names])
    total = (thermal + speed_growth(speed[at], parameters.growth)) * 1e6
    return np.asarray(total - total[0])


@MACHINES
def test_growth_keeps_the_balance_of_heat(machine):
    p = shop_parameters(machine)
    net = network(p)
    start = state_at_rest(20.0, len(net.names))
    hot = heated(net, start, _varied_course(14400), p)
    stored = np.array(net.capacity) @ (hot.state[:-1] - start[:-1])
    balance = hot.generated - hot.to_air - hot.to_chiller - stored
    # a path that gave to one node what it did not take from the other would show as kilojoules
    assert abs(balance) < 1e-9 * hot.generated and abs(hot.to_chiller) > 1e6 and hot.to_air != 0


def test_the_steady_state_is_that_of_the_linear_equations():
    """The bed's heat alone, the spindle at rest, the chiller's setpoint never reached.

    The equations are put together here from the list of paths, solved by linear algebra with the
    natural convection of the last solution, and so on until they agree; the flow of the jacket
    mixes its cells and the tank.
    """
    p = shop_parameters("mill01")
    p = replace(p, spindle=replace(p.spindle, chiller=ChillerParameters(setpoint=40.0)))
    net, air = network(p), 20.0
    t = np.full(len(net.names), air + 1)
    for _ in range(200):
        matrix, right = np.zeros((t.size, t.size)), np.zeros(t.size)
        right[net.names.index("bed")] = p.spindle.bed_heat
        for a, b, nominal, path in net.edges:
            over = abs(t[a] - (air if b < 0 else t[b]))
            g = nominal * {Path.NATURAL: (over / 10) ** 0.25, Path.ROTATING: 0.0}.get(path, 1.0)
            matrix[a, a] += g
            if b < 0:
                right[a] += g * air
            else:
                matrix[a, b] -= g
                matrix[b, b] += g
                matrix[b, a] -= g
        for k, node in enumerate(net.flow):
            matrix[node, node] += p.growth.paths.flow
            matrix[node, net.flow[k - 1]] -= p.growth.paths.flow
        t = 0.5 * (t + np.linalg.solve(matrix, right))
    assert t[net.names.index("bed")] - air > 2.0  # 160 W over some 40 W/K
    hot = heated(net, np.append(t, 0.0), _course(np.zeros(7200)), p)
    np.testing.assert_allclose(hot.state[:-1], t, atol=1e-6)


def test_the_probes_stand_follows_the_air_with_its_time_constant():
    p = shop_parameters("mill01")
    net, lag = network(p), p.growth.paths.stand_lag
    hot = heated(
        net, state_at_rest(20.0, len(net.names)), _course(np.zeros(round(lag)), air=25.0), p
    )
    rise = hot.state[net.names.index("stand")] - 20.0
    assert rise == pytest.approx(5 * (1 - np.exp(-1)), rel=1e-3)


@MACHINES
def test_a_finer_step_changes_growth_by_less_than_a_hundredth(machine):
    p, course = shop_parameters(machine), _varied_course(10800)
    coarse, fine = (
        _growth(p, _warmed(p, course, n), course.speed) for n in (SUBSTEPS, 4 * SUBSTEPS)
    )
    assert np.abs(coarse - fine).max() < 0.01 * np.ptp(fine)


@MACHINES
def test_growth_at_top_speed_is_some_tens_of_micrometres(machine):
    p = shop_parameters(machine)
    course = _course(slewed(np.full(4 * 3600, TOP), 3500.0))
    growth = _growth(p, _warmed(p, course), course.speed)
    assert 30 < growth.max() < 70 and growth[-1] > 25
    # the column warms for hours, and lifts the nose again
    assert growth.argmax() < len(growth) - 1


def test_a_uniformly_warmer_machine_grows_by_its_lengths():
    """Steel from the flange to the nose, cast iron of head less column, steel of the stand."""
    growth = shop_parameters("mill01").growth
    body, e = growth.body, growth.expansion
    per_kelvin = sum(thermal_growth(growth).values())
    by_hand = e.steel * (body.flange + body.stand)
    by_hand += e.cast_iron * (body.head_length - body.column_share * body.column_height)
    assert per_kelvin == pytest.approx(by_hand, rel=1e-9)


def test_growth_by_speed_by_hand():
    """rho w^2 / E = 7850 * 1256.64^2 / 2.1e11 = 0.05903 1/m2 at 12 000 rev/min.

    Rings of r = 38 mm widen by 3.239 um; of that 0.3 / tan(18 deg) = 0.9233 becomes a shift of
    2.991 um; the shaft of 0.13 m gets shorter by 0.3 * 0.05903 * 0.13 * 6.845e-4 m2 = 1.576 um.
    """
    growth = shop_parameters("mill01").growth
    assert ring_lever(growth) == pytest.approx(0.92330, rel=1e-4)
    assert speed_growth(np.array([TOP]), growth)[0] * 1e6 == pytest.approx(1.415, abs=2e-3)
    half, whole = speed_growth(np.array([TOP / 2, TOP]), growth)
    assert whole == pytest.approx(4 * half)


def test_a_tighter_bearing_makes_more_heat():
    p = shop_parameters("mill01")
    loose = replace(
        p, growth=replace(p.growth, paths=replace(p.growth.paths, centrifugal_load=0.0))
    )
    course = _course(np.full(600, TOP))
    tight, less = (_warmed(q, course).generated for q in (p, loose))
    assert tight > less


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Body(front=0.2), "must follow one another from the nose"),
        (lambda: Body(housing_wall=0.06), "must leave room for the stator"),
        (
            lambda: Instruments(drifting=7),
            "Instruments.drifting = 7 must be another sensor than dead",
        ),
        (lambda: Instruments(dead_from=27), "Instruments.dead_from = 27 must lie from 1 to 26"),
    ],
)
def test_values_that_do_not_fit_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()
