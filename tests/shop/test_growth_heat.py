"""The finer network of spindle, head and column: balance, steady state, step, expansion by hand."""

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
from pipeline.shop.parameters import ChillerParameters, ShopParameters
from pipeline.shop.spindle import state_at_rest

from .conftest import shop_parameters

MACHINES = pytest.mark.parametrize("machine", ["mill01", "mill02"])
TOP = 12000.0


def _course(speed: np.ndarray, air: float = 20.0) -> Course:
    return Course(speed, np.full(speed.size, air), np.ones(speed.size, bool))


def _varied(seconds: int) -> Course:
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
def test_heat_made_is_heat_stored_or_carried_away(machine):
    p = shop_parameters(machine)
    net = network(p)
    start = state_at_rest(20.0, len(net.names))
    hot = heated(net, start, _varied(14400), p)
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
    p, course = shop_parameters(machine), _varied(10800)
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
    loose = replace(p, growth=replace(
        p.growth, paths=replace(p.growth.paths, centrifugal_load=0.0)
    ))  # fmt: skip
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
