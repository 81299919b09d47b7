"""Identification recovers the network that made the records, and says no more than they do."""

import numpy as np
import pytest

from pipeline.submodels.spindle.fit import (
    ONE as ONE_NODE,
)
from pipeline.submodels.spindle.fit import (
    TWO as TWO_NODES,
)
from pipeline.submodels.spindle.fit import (
    Given,
    Problem,
    SpindleFitSettings,
    fit_network,
    is_determined,
    solve,
    window_errors,
)
from pipeline.submodels.spindle.structure import days_left_out, identify_spindle_network
from pipeline.thermal.network import SOURCES, SpindleThermalParameters, heat_sources, temperatures
from pipeline.twin.spindle import SpindleRecords, heat_of
from tests.submodels.spindle.spindle_days import ONE, RECORDS, TWO, day_of, days_of

QUICK = SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,))
HELD = SpindleRecords(position_control=True)
DIRT = {"noise_K": 0.3, "whole_degrees": True, "gap": True}


def test_clean_records_give_the_network_back():
    """No noise: only the optimiser's tolerance and the finite differences are left."""
    fit = fit_network(Given(days_of(ONE, 1, 3), RECORDS, QUICK), ONE_NODE)
    assert fit.parameters.cooling_rate == pytest.approx(ONE.cooling_rate, rel=1e-4)
    assert fit.parameters.ambient == pytest.approx(ONE.ambient, abs=1e-3)
    for name in ONE.heating:
        assert fit.parameters.heating[name] == pytest.approx(ONE.heating[name], rel=1e-2)


def test_whole_degrees_noise_and_gaps_leave_a_few_percent():
    """Ten days: the standard error of a coefficient is about 1 %, so 5 % is five of them."""
    pieces = days_of(ONE, 2, 10, **DIRT)
    problem = Problem(Given(pieces, RECORDS, QUICK), list(ONE.heating), ONE_NODE)
    fit = solve(problem, [problem.start(1500.0)])
    assert fit.parameters.cooling_rate == pytest.approx(ONE.cooling_rate, rel=0.05)
    assert fit.parameters.ambient == pytest.approx(ONE.ambient, abs=0.5)
    for name, value in ONE.heating.items():
        assert fit.parameters.heating[name] == pytest.approx(value, rel=0.05)


def test_a_measured_ambient_gives_its_offset():
    truth = SpindleThermalParameters(heating=ONE.heating, cooling_rate=1 / 900, ambient_offset=2.5)
    ambient = 18 + 4 * np.sin(np.arange(360) / 60)
    records = SpindleRecords(ambient=True)
    days = days_of(truth, 3, 6, ambient=ambient, **DIRT)
    fit = fit_network(Given(days, records, QUICK), ONE_NODE)
    assert "ambient" not in fit.names
    assert fit.parameters.ambient_offset == pytest.approx(2.5, abs=0.4)


@pytest.mark.parametrize(
    ("nodes", "seeds", "days", "least"),
    [
        (1, 10, 4, 0.7),
        pytest.param(1, 100, 4, 0.85, marks=pytest.mark.proof),
        # blocks of an hour are short against a body's hours
        pytest.param(2, 50, 6, 0.78, marks=pytest.mark.proof),
    ],
)
def test_the_95_percent_interval_holds_the_truth(nodes, seeds, days, least):
    """At least 85 of 100: 95 of 100 less more than four standard deviations of the count.

    The noise is correlated and as large as soft L1's bend, so that an interval for independent
    samples, or one that takes soft L1 for squares, is too narrow by half.
    """
    structure = (ONE_NODE, TWO_NODES)[nodes - 1]
    truth, sources = (ONE, TWO)[nodes - 1], ["bearing_friction", "copper"]
    held = np.zeros(
        len(Problem(Given([day_of(truth, 0)], RECORDS, QUICK), sources, structure).names)
    )
    for seed in range(seeds):
        pieces = days_of(truth, seed, days, noise_K=1.5, whole_degrees=True, gap=True)
        problem = Problem(Given(pieces, RECORDS, QUICK), sources, structure)
        fit = solve(problem, [problem.start(1500.0)])
        held += np.abs(fit.values - problem.position(truth)) <= fit.uncertainty.half_width
    assert (held >= least * seeds).all(), dict(zip(problem.names, held, strict=True))


def test_a_source_that_is_never_excited_is_said_to_be_so():
    days = days_of(ONE, 4, 4, excited=("speed",), **DIRT)
    fit = fit_network(Given(days, HELD, QUICK), ONE_NODE)
    for name in ("load_speed", "copper", "position_hold"):
        assert fit.left_out[name] == "the records never excite it"
    assert "bearing_friction" in fit.parameters.heating


def test_a_source_that_is_held_is_found():
    truth = SpindleThermalParameters(
        heating={**ONE.heating, "position_hold": 0.02}, cooling_rate=1 / 900, ambient=24.0
    )
    days = days_of(truth, 5, 8, excited=("speed", "load", "hold"), **DIRT)
    fit = fit_network(Given(days, HELD, QUICK), ONE_NODE)
    assert fit.parameters.heating["position_hold"] == pytest.approx(0.02, rel=0.1)


@pytest.mark.parametrize(("seeds", "most"), [(4, 1), pytest.param(20, 4, marks=pytest.mark.proof)])
def test_a_source_that_heats_nothing_gets_no_number(seeds, most):
    """Of two absent sources each is kept by chance in 1 of 40: 5 or more of 20 is 1 in 1000."""
    wrong = 0
    for seed in range(seeds):
        fit = fit_network(Given(days_of(ONE, seed, 4, **DIRT), RECORDS, QUICK), ONE_NODE)
        assert set(fit.parameters.heating) >= set(ONE.heating)
        wrong += set(fit.parameters.heating) != set(ONE.heating)
        for name, why in fit.left_out.items():
            assert "includes 0" in why
            assert SOURCES[name] in why
    assert wrong <= most


def test_of_two_collinear_sources_one_is_left_out():
    """At one speed n^(5/3) and n^2 are the same signal: together they would have any number."""
    truth = SpindleThermalParameters(
        heating={"bearing_friction": 6e-7, "windage": 5e-8}, cooling_rate=1 / 900, ambient=24.0
    )
    pieces = []
    for piece in days_of(ONE, 9, 6, excited=("speed",), **DIRT):
        on = (piece.frame["windage"] > 0).to_numpy(float)
        heat = heat_sources(500.0 * on, 0.0 * on, 0.0 * on)
        frame = piece.frame.assign(**{s: heat[:, i] for i, s in enumerate(SOURCES)})
        frame["spindle_temperature"] = _simulated(heat, truth, piece.step)
        pieces.append(type(piece)(day=piece.day, frame=frame, step=piece.step, bridged=0))
    fit = fit_network(Given(pieces, RECORDS, QUICK), ONE_NODE)
    kept = set(fit.parameters.heating) & {"bearing_friction", "windage"}
    assert len(kept) == 1
    assert {"bearing_friction", "windage"} - kept <= set(fit.left_out)
    # what is left carries the heat of both
    power = {"bearing_friction": 500 ** (5 / 3), "windage": 500.0**2}
    given = sum(truth.heating[s] * power[s] for s in power)
    found = sum(fit.parameters.heating[s] * power[s] for s in kept)
    assert found == pytest.approx(given, rel=0.05)


def _simulated(heat: np.ndarray, truth: SpindleThermalParameters, step: float) -> np.ndarray:
    from pipeline.thermal.network import temperatures

    return np.round(temperatures(heat, truth.ambient, truth, step)[0])


def test_two_nodes_are_chosen_when_days_left_out_show_them():
    days = days_of(TWO, 10, 7, noise_K=0.2)
    fit, scores = identify_spindle_network(Given(days, RECORDS, QUICK))
    assert fit.parameters.nodes == 2
    assert scores["2 nodes"] < scores["1 node"]
    assert fit.parameters.coupling_rate == pytest.approx(TWO.coupling_rate, rel=0.15)
    assert fit.parameters.body_cooling_rate == pytest.approx(TWO.body_cooling_rate, rel=0.15)


@pytest.mark.proof
@pytest.mark.parametrize("seed", [11, 13])
def test_one_node_is_kept_when_there_is_one(seed):
    fit, scores = identify_spindle_network(Given(days_of(ONE, seed, 6, **DIRT), RECORDS, QUICK))
    assert fit.parameters.nodes == 1
    assert {"1 node", "2 nodes", "2 nodes, bearings in the body"} <= set(scores)


def test_two_days_are_too_few_to_ask_for_a_second_node():
    fit, _ = identify_spindle_network(Given(days_of(TWO, 13, 2, noise_K=0.2), RECORDS, QUICK))
    assert fit.parameters.nodes == 1


def test_a_source_of_one_day_only_does_not_break_the_days_left_out():
    """Without that day the others never excite it, so it is not known to them."""
    truth = SpindleThermalParameters(
        heating={**ONE.heating, "position_hold": 0.05}, cooling_rate=1 / 900, ambient=24.0
    )
    days = days_of(truth, 14, 3, noise_K=0.1)
    days.append(day_of(truth, 14, number=3, noise_K=0.1, excited=("speed", "load", "hold")))
    whole = fit_network(Given(days, HELD, QUICK), ONE_NODE)
    assert "position_hold" in whole.parameters.heating
    errors = days_left_out(Given(days, HELD, QUICK), whole)
    assert errors.shape == (4,)
    assert errors[3] > 10 * errors[:3].max()


def test_fewer_blocks_than_parameters_determine_nothing():
    """Two hours are two blocks; at an optimum their scores cancel and would look like certainty."""
    fit = fit_network(Given([day_of(ONE, 15, hours=2.0, **DIRT)], RECORDS, QUICK), ONE_NODE)
    assert fit.parameters.heating == {}
    assert not any(is_determined(fit, name) for name in fit.names)


def test_no_stretch_is_said_with_its_remedy():
    with pytest.raises(ValueError, match=r"on the training days: record a working day"):
        fit_network(Given([], RECORDS, QUICK), ONE_NODE)


def test_window_errors_start_from_a_measured_temperature():
    """A window begins at the first measured step after the one before has ended."""
    piece = day_of(ONE, 16, hours=3.0)
    piece.frame.iloc[60:63, piece.frame.columns.get_loc("spindle_temperature")] = np.nan
    wrong = SpindleThermalParameters(heating={}, cooling_rate=1 / 900, ambient=24.0)
    errors = window_errors(Given([piece], RECORDS, QUICK), wrong)
    assert len(errors) == 180 - 3
    starts = [0, 60, 120]  # of the steps with a temperature: 0, 63, 123 in the stretch
    np.testing.assert_array_equal(errors[starts], 0.0)
    right = window_errors(Given([piece], RECORDS, QUICK), ONE)
    np.testing.assert_allclose(right, 0.0, atol=1e-9)


def test_position_and_parameters_are_inverse():
    pieces = days_of(TWO, 17, 2)
    problem = Problem(Given(pieces, RECORDS, QUICK), ["bearing_friction", "copper"], TWO_NODES)
    back = problem.parameters(problem.position(TWO))
    for name in ("coupling_rate", "capacity_ratio", "body_cooling_rate", "ambient"):
        assert getattr(back, name) == pytest.approx(getattr(TWO, name), rel=1e-7)
    assert back.heating == pytest.approx(TWO.heating, rel=1e-6)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"nodes": ()}, "nodes"),
        ({"time_constants_s": ()}, "time_constants_s"),
    ],
)
def test_settings_that_make_no_sense_are_refused(wrong, words):
    with pytest.raises(ValueError, match=words):
        SpindleFitSettings(**wrong)  # type: ignore[arg-type]


SINGLE = SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,), nodes=(1,))
COOLED = SpindleRecords(coolant=True)


def cooled_days(truth: SpindleThermalParameters, count: int = 6):
    """Days with a coolant that warms by another amount each, and noise of 0.1 K."""
    rng = np.random.default_rng(1)
    found = []
    for number, piece in enumerate(days_of(ONE, 7, count)):
        steps = len(piece.frame)
        coolant = 22 + rng.uniform(2, 12) * np.sin(np.arange(steps) / rng.uniform(40, 90)) ** 2
        T = temperatures(heat_of(piece.frame), 24.0, truth, piece.step, coolant=coolant)[0]
        noise = 0.1 * np.random.default_rng(number).normal(size=steps)
        piece.frame["spindle_temperature"] = T + noise
        piece.frame["coolant_temperature"] = coolant
        found.append(piece)
    return found


def test_a_spindle_that_the_coolant_cools_gets_its_sink():
    truth = SpindleThermalParameters(
        heating=ONE.heating, cooling_rate=1 / 1500, coolant_rate=1 / 1200, ambient=24.0
    )
    fit, scores = identify_spindle_network(Given(cooled_days(truth), COOLED, SINGLE))
    assert fit.parameters.coolant_rate == pytest.approx(1 / 1200, rel=0.05)
    assert scores["1 node with coolant"] < scores["1 node"]


def test_a_coolant_that_does_nothing_is_no_sink():
    fit, scores = identify_spindle_network(Given(cooled_days(ONE), COOLED, SINGLE))
    assert fit.parameters.coolant_rate == 0.0
    assert set(scores) == {"1 node", "1 node with coolant"}


@pytest.mark.parametrize("nodes", [1, 2])
def test_without_heat_all_nodes_end_between_air_and_coolant_by_their_rates(nodes):
    more = {"coupling_rate": 1 / 300, "capacity_ratio": 0.5, "body_cooling_rate": 1 / 2000}
    p = SpindleThermalParameters(
        cooling_rate=1 / 2000 if nodes == 1 else 0.0, coolant_rate=1 / 1000, ambient=20.0,
        **(more if nodes == 2 else {}),
    )  # fmt: skip
    end = temperatures(np.zeros((20_000, len(SOURCES))), 50.0, p, 10.0, coolant=np.full(20_000, 35))
    # balance of the two sinks: (20 / 2000 + 35 / 1000) / (1 / 2000 + 1 / 1000)
    np.testing.assert_allclose(end[:, -1], 30.0, atol=1e-6)
    still = temperatures(np.zeros((3, len(SOURCES))), end[0, -1], p, 10.0, coolant=np.full(3, 35.0))
    np.testing.assert_allclose(still, 30.0, atol=1e-6)  # the body starts in balance too


def test_a_sink_without_the_temperature_of_its_coolant_is_refused():
    p = SpindleThermalParameters(cooling_rate=1e-3, coolant_rate=1e-3)
    with pytest.raises(ValueError, match=r"coolant_rate = 0\.001 1/s needs the coolant"):
        temperatures(np.zeros((3, len(SOURCES))), 20.0, p, 10.0)
