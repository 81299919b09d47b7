"""The simulated spindle keeps the balance of heat and the limits of its formulas."""

import numpy as np
import pytest

from pipeline.shop.motion import slewed
from pipeline.shop.parameters import ChillerParameters, SpindleParameters
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
