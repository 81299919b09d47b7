"""The coolant as a sink: kept where days left out say that it helps, and nowhere else."""

import numpy as np
import pytest

from pipeline.submodels.spindle.fit import Given, SpindleFitSettings
from pipeline.submodels.spindle.structure import identify_spindle_network
from pipeline.thermal.network import SOURCES, SpindleThermalParameters, temperatures
from pipeline.twin.spindle import SpindleRecords, heat_of
from tests.submodels.spindle.spindle_days import ONE, days_of

QUICK = SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,), nodes=(1,))
RECORDS = SpindleRecords(coolant=True)


def days(truth: SpindleThermalParameters, count: int = 6):
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
    fit, scores = identify_spindle_network(Given(days(truth), RECORDS, QUICK))
    assert fit.parameters.coolant_rate == pytest.approx(1 / 1200, rel=0.05)
    assert scores["1 node with coolant"] < scores["1 node"]


def test_a_coolant_that_does_nothing_is_no_sink():
    fit, scores = identify_spindle_network(Given(days(ONE), RECORDS, QUICK))
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
