"""Growth of the spindle: the network's equation, recovery of what made a record, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.thermal.deformation import (
    DeformationNetwork,
    GrowthRecord,
    LaggedExpansion,
    fit_expansion,
    simulate,
    start_of_nodes,
)
from pipeline.thermal.growth_fit import fit_network

Array = NDArray[np.float64]
TRUTH = DeformationNetwork(
    bearing_friction=2.5e-7,
    windage=2e-9,
    preload_friction=5e-6,
    cooling_rate=5e-4,
    coupling_rate=8e-4,
    capacity_ratio=0.2,
    structure_cooling_rate=1e-4,
    spindle_expansion=2e-6,
    structure_expansion=-1e-6,
    centrifugal=4e-12,
    sensor_shares=(1.0, 0.6, 0.1),
)
STEP = 60.0


def record(seed: int, *, many: int = 300, noise: float = 1.0, warm: bool = False) -> GrowthRecord:
    """Speeds held for half an hour, then a standstill; every tenth value is missing."""
    rng = np.random.default_rng(seed)
    speed = np.repeat(rng.uniform(0, 1200, many // 30 + 1), 30)[:many]
    speed[2 * many // 3 :] = 0.0
    time = STEP * np.arange(many)
    ambient = 20 + rng.uniform(-2, 2) * np.sin(time / 9000)
    start = ambient[0] + (np.array([12.0, 6.0]) if warm else np.zeros(2))
    nodes = simulate(speed, ambient, STEP, TRUTH, start)
    shares = np.array(TRUTH.sensor_shares)[:, None]
    sensors = (shares * nodes[0] + (1 - shares) * nodes[1]).T
    sensors += noise * 0.05 * rng.normal(size=sensors.shape)
    growth = TRUTH.growth(nodes, speed) + noise * 0.2e-6 * rng.normal(size=many)
    sensors[1:][rng.random((many - 1, 3)) < 0.1] = np.nan
    growth[1:][rng.random(many - 1) < 0.1] = np.nan
    return GrowthRecord(
        time_s=time, speed_rad_s=speed, ambient_C=ambient, temperatures_C=sensors, growth_m=growth
    )


def predicted(network: DeformationNetwork, one: GrowthRecord) -> Array:
    return network.predict(one.speed_rad_s, one.ambient_C, one.temperatures_C[0], one.step)


def test_the_growth_solves_its_equations():
    speed, ambient = np.full(40, 800.0), np.full(40, 21.0)
    speed[20:] = 300.0
    p = TRUTH

    def rate(_: float, T: Array, n: float) -> list[float]:
        heat = p.bearing_friction * n ** (5 / 3) + p.windage * n**2 + p.preload_friction * n
        return [
            heat - p.cooling_rate * (T[0] - 21.0) - p.coupling_rate * (T[0] - T[1]),
            p.capacity_ratio * p.coupling_rate * (T[0] - T[1])
            - p.structure_cooling_rate * (T[1] - 21.0),
        ]

    T = [np.array([25.0, 22.0])]
    for n in speed[:-1]:
        T.append(solve_ivp(rate, (0, STEP), T[-1], args=(n,), rtol=1e-11, atol=1e-11).y[:, -1])
    rise = np.array(T) - T[0]
    expected = rise @ [2e-6, -1e-6] + 4e-12 * (speed**2 - 800.0**2)
    nodes = simulate(speed, ambient, STEP, p, [25.0, 22.0])
    np.testing.assert_allclose(p.growth(nodes, speed), expected, atol=1e-13)


def test_half_steps_change_nothing_where_the_inputs_are_held():
    one = record(0)
    whole = predicted(TRUTH, one)
    half = TRUTH.predict(
        np.repeat(one.speed_rad_s, 2), np.repeat(one.ambient_C, 2), one.temperatures_C[0], STEP / 2
    )
    np.testing.assert_allclose(half[::2], whole, atol=1e-15)


def test_the_future_changes_no_growth_before_it():
    one = record(0)
    faster = one.speed_rad_s.copy()
    faster[150:] += 500.0
    changed = predicted(TRUTH, replace(one, speed_rad_s=faster))
    assert np.array_equal(changed[:150], predicted(TRUTH, one)[:150])
    assert changed[150] > predicted(TRUTH, one)[150]  # centrifugal: at once


def test_leading_axes_carry_several_records():
    some = [record(k) for k in range(3)]
    together = TRUTH.predict(
        np.stack([one.speed_rad_s for one in some]), np.stack([one.ambient_C for one in some]),
        np.stack([one.temperatures_C[0] for one in some]), STEP,
    )  # fmt: skip
    np.testing.assert_allclose(together, [predicted(TRUTH, one) for one in some], atol=1e-18)


def test_the_start_is_seen_in_the_sensors():
    shares = np.array(TRUTH.sensor_shares)
    shown = shares * 32.0 + (1 - shares) * 26.0
    np.testing.assert_allclose(
        start_of_nodes(TRUTH.sensor_shares, shown, 20.0), [32.0, 26.0], atol=0.1
    )
    np.testing.assert_allclose(
        start_of_nodes(TRUTH.sensor_shares, [25.0] * 3, 20.0), [25.0, 25.0], atol=1e-12
    )
    assert start_of_nodes(TRUTH.sensor_shares, [np.nan] * 3, 20.0).tolist() == [20.0, 20.0]
    lost = start_of_nodes(TRUTH.sensor_shares, [shown[0], np.nan, shown[2]], 20.0)
    np.testing.assert_allclose(lost, [32.0, 26.0], atol=0.1)


@pytest.fixture(scope="module")
def fitted() -> DeformationNetwork:
    """The network can explain these records: their starts are fitted freely."""
    return fit_network([record(k, warm=k % 3 == 2) for k in range(6)], start_error_K=30.0)


def test_the_fit_recovers_what_made_the_records(fitted):
    rates = ("cooling_rate", "coupling_rate", "capacity_ratio", "structure_cooling_rate")
    for name in rates:
        assert getattr(fitted, name) == pytest.approx(getattr(TRUTH, name), rel=0.1), name
    for name in ("spindle_expansion", "structure_expansion", "centrifugal"):
        assert getattr(fitted, name) == pytest.approx(getattr(TRUTH, name), rel=0.05), name
    np.testing.assert_allclose(fitted.sensor_shares, TRUTH.sensor_shares, atol=0.02)


@pytest.mark.parametrize("warm", [False, True], ids=["cold", "warm start"])
def test_it_predicts_another_record_heating_and_cooling(fitted, warm):
    one = record(99, noise=0.0, warm=warm)
    error = np.abs(predicted(fitted, one) - one.growth_m)
    assert np.nanmax(np.abs(one.growth_m)) > 10e-6
    assert np.nanmax(error) < 0.5e-6


@pytest.mark.parametrize("shown", [0.0, np.nan], ids=["no sensor", "a lost sensor"])
def test_growth_is_fitted_without_sensors_too(shown):
    some = [record(k, noise=0.3) for k in range(3)]
    blind = [
        replace(one, temperatures_C=one.temperatures_C * [1.0, np.nan, 1.0])
        if np.isnan(shown) else replace(one, temperatures_C=np.zeros((300, 0)))
        for one in some
    ]  # fmt: skip
    network = fit_network(blind)
    left = np.concatenate([predicted(network, one) - one.growth_m for one in blind])
    assert np.sqrt(np.nanmean(left**2)) < 1e-6


def test_expansions_and_lags_are_recovered_from_measured_temperatures():
    truth = LaggedExpansion(expansions=(3e-6, -1e-6), lags_s=(200.0, 1500.0), centrifugal=4e-12)
    rng = np.random.default_rng(0)

    def made(seed: int) -> GrowthRecord:
        one = record(seed, noise=0.0)
        nodes = simulate(one.speed_rad_s, one.ambient_C, STEP, TRUTH, [20.0, 20.0]).T
        growth = truth.predict(one.time_s, one.speed_rad_s, nodes)
        growth += 0.1e-6 * rng.normal(size=len(growth))
        growth[rng.random(len(growth)) < 0.1] = np.nan
        return replace(one, temperatures_C=nodes, growth_m=growth)

    found = fit_expansion([made(k) for k in range(4)])
    np.testing.assert_allclose(found.lags_s, truth.lags_s, rtol=0.05)
    np.testing.assert_allclose(found.expansions, truth.expansions, rtol=0.05)
    assert found.centrifugal == pytest.approx(truth.centrifugal, rel=0.05)
    other = made(9)
    whole = found.predict(other.time_s, other.speed_rad_s, other.temperatures_C)
    cut = found.predict(other.time_s[:80], other.speed_rad_s[:80], other.temperatures_C[:80])
    assert np.array_equal(whole[:80], cut)


def test_what_cannot_be_fitted_is_refused():
    with pytest.raises(ValueError, match="speed_rad_s of 1 records is 0 throughout"):
        fit_network([replace(record(0), speed_rad_s=np.zeros(300))])
    with pytest.raises(ValueError, match="lags_s of 1 must be as many as the 2 expansions"):
        LaggedExpansion(expansions=(1e-6, 1e-6), lags_s=(60.0,), centrifugal=0.0)


def test_a_record_of_one_sample_is_refused():
    with pytest.raises(ValueError, match="1 samples must have at least 2"):
        GrowthRecord(**{name: values[:1] for name, values in vars(record(0)).items()})
