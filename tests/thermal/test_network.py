"""The spindle's network against the differential equation, its balance and its limits."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipeline.signals.columns import column
from pipeline.thermal.network import (
    SOURCES,
    SpindleThermalParameters,
    heat_sources,
    quasi_steady_body,
    slow_share,
    temperatures,
)

ONE = SpindleThermalParameters(
    heating={"bearing_friction": 2e-6, "copper": 0.1, "position_hold": 0.01},
    cooling_rate=1 / 900,
    ambient=22.0,
)
TWO = SpindleThermalParameters(
    heating={"bearing_friction": 2e-6, "load_speed": 5e-5, "windage": 1e-8},
    cooling_rate=1 / 5000,
    ambient=21.0,
    coupling_rate=1 / 600,
    capacity_ratio=0.2,
    body_cooling_rate=1 / 8000,
)
DT = 10.0


def working(steps: int, seed: int = 0) -> NDArray[np.float64]:
    """Sources of a spindle that changes speed and load every half minute, (steps, sources)."""
    rng = np.random.default_rng(seed)
    held = np.repeat(np.arange((steps + 2) // 3), 3)[:steps]
    speed = rng.uniform(-800, 800, held[-1] + 1)[held]
    load = rng.uniform(0, 1, held[-1] + 1)[held]
    return heat_sources(speed, load, (load < 0.2).astype(float))


def integrated(
    sources: NDArray[np.float64],
    p: SpindleThermalParameters,
    ambient: NDArray[np.float64],
    start: list[float],
) -> NDArray[np.float64]:
    """The same network, written down once more and integrated step by step, (nodes, T)."""
    k, r = p.coupling_rate, p.coupling_rate * p.capacity_ratio
    found = [np.array(start)]
    for h, surround in zip(sources[:-1], ambient[:-1], strict=True):
        heat = sum(p.heating.get(name, 0.0) * h[i] for i, name in enumerate(SOURCES))

        def rate(
            _: float, T: NDArray[np.float64], heat: float = heat, surround: float = surround
        ) -> list[float]:
            if len(T) == 1:
                return [heat - p.cooling_rate * (T[0] - surround)]
            return [
                heat - p.cooling_rate * (T[0] - surround) - k * (T[0] - T[1]),
                r * (T[0] - T[1]) - p.body_cooling_rate * (T[1] - surround),
            ]

        end = solve_ivp(rate, (0, DT), found[-1], method="DOP853", rtol=1e-13, atol=1e-13)
        found.append(end.y[:, -1])
    return np.array(found).T


@pytest.mark.parametrize("p", [ONE, TWO], ids=["one node", "two nodes"])
@pytest.mark.parametrize("measured", [False, True], ids=["constant", "measured ambient"])
def test_the_network_solves_its_differential_equation(p, measured):
    sources = working(60)
    ambient = 20 + 3 * np.sin(np.arange(60) / 9) if measured else np.full(60, p.ambient)
    start = [25.0, 23.0][: p.nodes]
    found = temperatures(
        sources, 25.0, p, DT, ambient=ambient if measured else None, body_start=23.0
    )
    # held sources: exact, so only the reference's tolerance is left
    np.testing.assert_allclose(found, integrated(sources, p, ambient, start), rtol=0, atol=1e-9)


@pytest.mark.parametrize("p", [ONE, TWO], ids=["one node", "two nodes"])
def test_the_step_does_not_matter_where_the_sources_are_held(p):
    coarse = working(50)
    fine = np.repeat(coarse, 10, axis=0)
    at_coarse = temperatures(coarse, 30.0, p, DT)
    at_fine = temperatures(fine, 30.0, p, DT / 10)[:, ::10]
    np.testing.assert_allclose(at_fine, at_coarse, rtol=0, atol=1e-10)


def test_the_steady_state_of_one_node_is_heat_over_cooling():
    sources = np.broadcast_to(heat_sources(500.0, 0.4, 1.0), (3000, len(SOURCES)))
    rise = (2e-6 * 500 ** (5 / 3) + 0.1 * 0.4**2 + 0.01) * 900
    found = temperatures(sources, 22.0, ONE, DT)[0, -1]
    assert found == pytest.approx(22.0 + rise, abs=1e-9)


def test_the_steady_state_of_two_nodes_loses_all_heat_to_the_ambient():
    sources = np.broadcast_to(heat_sources(500.0, 0.4, 0.0), (40_000, len(SOURCES)))
    first, body = temperatures(sources, 21.0, TWO, DT)[:, -1]
    heat = 2e-6 * 500 ** (5 / 3) + 5e-5 * 0.4 * 500 + 1e-8 * 500**2
    # in units of the measured node's capacity: the body's is 1 / capacity_ratio
    lost = TWO.cooling_rate * (first - 21) + TWO.body_cooling_rate / 0.2 * (body - 21)
    assert lost == pytest.approx(heat, rel=1e-9)
    assert first > body > 21


def test_two_nodes_keep_the_energy_that_they_are_given():
    p = SpindleThermalParameters(
        heating={"copper": 0.05}, cooling_rate=0.0, coupling_rate=1 / 300, capacity_ratio=0.5
    )
    sources = working(400)
    T = temperatures(sources, 20.0, p, DT, body_start=35.0)
    given = DT * np.concatenate([[0.0], np.cumsum(0.05 * sources[:-1, 2])])
    stored = (T[0] - 20.0) + (T[1] - 35.0) / 0.5
    np.testing.assert_allclose(stored, given, rtol=0, atol=1e-9)


@pytest.mark.parametrize("p", [ONE, TWO], ids=["one node", "two nodes"])
def test_without_heat_a_spindle_falls_to_the_ambient_and_never_below(p):
    T = temperatures(np.zeros((60_000, len(SOURCES))), 60.0, p, DT)[0]
    assert np.all(np.diff(T) <= 1e-12)
    assert T.min() >= p.ambient - 1e-9
    assert T[-1] == pytest.approx(p.ambient, abs=1e-6)


def test_a_stiff_coupling_makes_two_nodes_one_of_both_capacities():
    rigid = SpindleThermalParameters(
        heating={"copper": 0.1}, cooling_rate=1 / 900, ambient=20.0, coupling_rate=50.0,
        capacity_ratio=0.25, body_cooling_rate=1 / 3000,
    )  # fmt: skip
    # C of both is 5 C1: heat and losses are shared out over it
    both = SpindleThermalParameters(
        heating={"copper": 0.1 / 5}, cooling_rate=(1 / 900 + 4 / 3000) / 5, ambient=20.0
    )
    sources = working(500)
    found = temperatures(sources, 20.0, rigid, DT, body_start=20.0)
    # the nodes differ by heat / coupling = 0.1 / 50 K at most
    np.testing.assert_allclose(found[0], temperatures(sources, 20.0, both, DT)[0], atol=2e-3)
    np.testing.assert_allclose(found[0], found[1], atol=2e-3)


def test_a_body_without_end_is_one_node_that_cools_into_it():
    huge = SpindleThermalParameters(
        heating={"copper": 0.1}, cooling_rate=0.0, ambient=20.0, coupling_rate=1 / 900,
        capacity_ratio=1e-12,
    )  # fmt: skip
    one = SpindleThermalParameters(heating={"copper": 0.1}, cooling_rate=1 / 900, ambient=20.0)
    sources = working(500)
    found = temperatures(sources, 30.0, huge, DT, body_start=20.0)[0]
    np.testing.assert_allclose(found, temperatures(sources, 30.0, one, DT)[0], atol=1e-7)


@pytest.mark.parametrize("ratio", [1e-9, 1e-3, 1.0, 1e3])
def test_modes_stay_real_and_exact_where_both_nodes_cool_alike(ratio):
    # k + cooling = r + body loss: the eigenvectors of the plain matrix nearly coincide
    k, r = 1 / 600, ratio / 600
    p = SpindleThermalParameters(
        heating={"copper": 0.1}, cooling_rate=max(r - k, 0) + 1e-4, coupling_rate=k,
        capacity_ratio=ratio, body_cooling_rate=max(k - r, 0) + 1e-4, ambient=20.0,
    )  # fmt: skip
    sources = working(30)
    found = temperatures(sources, 25.0, p, DT, body_start=22.0)
    np.testing.assert_allclose(
        found, integrated(sources, p, np.full(30, 20.0), [25.0, 22.0]), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("p", [ONE, TWO], ids=["one node", "two nodes"])
def test_a_population_is_a_loop(p):
    sources = np.stack([[working(40, 3 * i + j) for j in range(3)] for i in range(2)])
    starts = np.arange(6.0).reshape(2, 3) + 20
    ambient = np.linspace(15, 25, 40) + np.arange(2)[:, None, None] + np.zeros((2, 3, 1))
    together = temperatures(sources, starts, p, DT, ambient=ambient)
    assert together.shape == (p.nodes, 2, 3, 40)
    for i in range(2):
        for j in range(3):
            alone = temperatures(sources[i, j], starts[i, j], p, DT, ambient=ambient[i, j])
            np.testing.assert_allclose(together[:, i, j], alone, rtol=0, atol=1e-11)


@pytest.mark.parametrize("p", [ONE, TWO], ids=["one node", "two nodes"])
def test_a_run_can_be_cut_in_two(p):
    sources = working(100)
    whole = temperatures(sources, 30.0, p, DT)
    body = whole[1, 37] if p.nodes == 2 else None
    second = temperatures(sources[37:], whole[0, 37], p, DT, body_start=body)
    np.testing.assert_allclose(second, whole[:, 37:], rtol=0, atol=1e-11)


def test_the_body_starts_where_it_neither_warms_nor_cools():
    body = float(quasi_steady_body(40.0, 18.0, TWO))
    r = TWO.coupling_rate * TWO.capacity_ratio
    assert r * (40 - body) == pytest.approx(TWO.body_cooling_rate * (body - 18), rel=1e-12)
    insulated = SpindleThermalParameters(
        cooling_rate=0, coupling_rate=1e-3, capacity_ratio=0.1, body_cooling_rate=0
    )
    assert float(quasi_steady_body(40.0, 18.0, insulated)) == pytest.approx(40.0)


def test_the_offset_adds_to_a_measured_ambient_only():
    p = SpindleThermalParameters(cooling_rate=1.0, ambient=5.0, ambient_offset=3.0)
    rest = np.zeros((200, len(SOURCES)))
    assert temperatures(rest, 0.0, p, DT)[0, -1] == pytest.approx(5.0)
    assert temperatures(rest, 0.0, p, DT, ambient=np.full(200, 18.0))[0, -1] == pytest.approx(21.0)


def test_signs_of_speed_and_load_do_not_matter():
    np.testing.assert_array_equal(heat_sources(-7.0, -0.3, 1.0), heat_sources(7.0, 0.3, 1.0))


def test_sources_of_table_units_are_si():
    """1000 rpm is 104.72 rad/s and 50 % is a half, worked out by hand."""
    speed, load = column("spindle_speed"), column("spindle_load")
    found = heat_sources(1000 * speed.factor + speed.offset, 50 * load.factor + load.offset, 1.0)
    omega = 104.71975511965977
    by_hand = [omega ** (5 / 3), 0.5 * omega, 0.25, omega**2, 1.0]
    np.testing.assert_allclose(found, by_hand, rtol=1e-12)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"cooling_rate": -1e-3}, r"cooling_rate = -0\.001 1/s"),
        (
            {"cooling_rate": 0.0, "coupling_rate": 1e-3, "body_cooling_rate": 1e-4},
            "capacity_ratio = 0 with body_cooling_rate",
        ),
        ({"cooling_rate": 1e-3, "heating": {"friction": 1.0}}, "friction.*bearing_friction"),
        ({"cooling_rate": 1e-3, "heating": {"copper": -0.1}}, r"heating\[copper\] = -0\.1 K/s"),
        ({"cooling_rate": 1e-3, "heating": {"copper": float("nan")}}, r"heating\[copper\] = nan"),
    ],
)
def test_parameters_that_no_spindle_has_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        SpindleThermalParameters(**wrong)  # type: ignore[arg-type]


def test_a_winding_on_a_fixed_body_relaxes_to_where_it_began():
    """Heated by 0.02 K/s for 20 time constants of 300 s it is 6 K above the body, then at it."""
    p = SpindleThermalParameters(
        heating={"position_hold": 0.02}, cooling_rate=0.0, coupling_rate=1 / 300
    )
    held = np.repeat([1.0, 0.0], 600)
    T = temperatures(heat_sources(0 * held, 0 * held, held), 24.0, p, 10.0)
    np.testing.assert_allclose(T[0, [599, 1199]], [30.0, 24.0], atol=1e-6)
    np.testing.assert_array_equal(T[1], 24.0)


def test_a_nearly_massless_winding_tends_to_the_fixed_body():
    held = heat_sources(np.zeros(500), np.zeros(500), np.arange(500) % 100 < 50)
    given = {"heating": {"position_hold": 0.02}, "cooling_rate": 0.0, "coupling_rate": 1 / 300}
    fixed = temperatures(held, 24.0, SpindleThermalParameters(**given), 10.0)
    nearly = SpindleThermalParameters(**given, capacity_ratio=1e-8)
    np.testing.assert_allclose(temperatures(held, 24.0, nearly, 10.0), fixed, atol=1e-4)


def test_bearings_in_the_body_warm_it_first():
    """Without losses the heat a h over the body's capacity is all there is: a mean rise."""
    p = SpindleThermalParameters(
        heating={"bearing_friction": 1e-6}, cooling_rate=0.0, coupling_rate=1 / 300,
        capacity_ratio=0.5, friction_in_body=True,
    )  # fmt: skip
    T = temperatures(heat_sources(np.full(361, 500.0), np.zeros(361), np.zeros(361)), 20.0, p, 10.0)
    assert T[1, 30] > T[0, 30]
    mean = (0.5 * T[0] + T[1]) / 1.5  # capacities 0.5 to 1
    np.testing.assert_allclose(mean[-1] - 20, 1e-6 * 500 ** (5 / 3) * 3600 / 1.5, rtol=1e-6)


def test_an_old_error_stands_in_the_slow_mode():
    """Two runs that differ by the slow mode keep its shape for ever."""
    p = SpindleThermalParameters(
        cooling_rate=0.0, coupling_rate=1 / 300, capacity_ratio=0.2, body_cooling_rate=1 / 8000
    )
    none = np.zeros((200, len(SOURCES)))
    one = temperatures(none, 20.0, p, 60.0, body_start=20.0)
    two = temperatures(none, 21.0, p, 60.0, body_start=20.0 + slow_share(p))
    off = two - one
    np.testing.assert_allclose(off[1] / off[0], slow_share(p), rtol=1e-9)
