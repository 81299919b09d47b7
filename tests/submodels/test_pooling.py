"""Partial pooling: its closed form restated, its limits, and its error over known hierarchies."""

import numpy as np
import pytest

from pipeline.schema.model import Parameter
from pipeline.submodels.contract import submodel
from pipeline.submodels.pooling import ALIKE, BETWEEN, Pooled, expected, pooled, standard_error

Z = 1.96


def parameter(log: float, error: float) -> Parameter:
    """A positive parameter by its logarithm and the standard error of that."""
    ends = float(np.exp(log - Z * error)), float(np.exp(log + Z * error))
    return Parameter(value=float(np.exp(log)), unit="N", interval_95=ends, determined=True,
                     method="")  # fmt: skip


UNKNOWN = Parameter(value=None, unit="N", interval_95=None, determined=False, method="")


def machines(logs: "np.ndarray", errors: "np.ndarray") -> list[Parameter]:
    return [parameter(*one) for one in zip(logs.tolist(), errors.tolist(), strict=True)]


def first(every: list[Parameter]) -> Pooled:
    found = pooled(every[0], every[1:])
    assert found is not None
    return found


def restated(y: "np.ndarray", s: "np.ndarray") -> float:
    """Posterior mean of the first machine's value, from the mean of all (BDA 5.17 and 5.20, 5.21).

    A plain sum over tau by its half-normal prior, beside the machines that do not differ.
    """

    def evidence(tau: "np.ndarray") -> "tuple[np.ndarray, np.ndarray]":
        v = s**2 + tau[:, None] ** 2
        variance = 1 / (1 / v).sum(1)
        mean = variance * (y / v).sum(1)
        found = np.sqrt(variance) * np.prod(v**-0.5, axis=1)
        return mean, found * np.exp(-((y - mean[:, None]) ** 2 / (2 * v)).sum(1))

    (complete,), (alike,) = evidence(np.zeros(1))
    tau = np.linspace(1e-4, 8 * BETWEEN, 20_000)
    mean, differ = evidence(tau)
    half_normal = np.exp(-((tau / BETWEEN) ** 2) / 2)
    differ *= (1 - ALIKE) / ALIKE * half_normal / half_normal.sum()
    shrunk = (y[0] / s[0] ** 2 + mean / tau**2) / (1 / s[0] ** 2 + 1 / tau**2)
    return float((alike * complete + differ @ shrunk) / (alike + differ.sum()))


def test_the_value_is_the_posterior_mean_of_the_hierarchical_model():
    rng = np.random.default_rng(3)
    for many in (2, 3, 8):
        y, s = rng.normal(0, 0.3, many), rng.uniform(0.05, 0.4, many)
        assert np.log(first(machines(y, s)).value) == pytest.approx(restated(y, s), abs=2e-4)


def test_identical_machines_pool_and_a_sharp_record_stands_alone():
    same = first(machines(np.full(8, 1.0), np.full(8, 0.2)))
    assert np.log(same.value) == pytest.approx(1.0, abs=1e-4)  # the interval's ends
    assert same.moved < 0.2, "its share of eight alike is 0.125"
    assert np.log(same.interval_95[1] / same.interval_95[0]) < 0.5 * 2 * Z * 0.2
    sharp = first(machines(np.array([1.5, 1.0, 1.1]), np.array([0.002, 0.1, 0.1])))
    assert sharp.moved > 0.99 and np.log(sharp.value) == pytest.approx(1.5, abs=0.002)
    vague = first(machines(np.array([3.0, 1.0, 1.0]), np.array([2.0, 0.01, 0.01])))
    assert vague.moved < 0.02 and np.log(vague.value) == pytest.approx(1.0, abs=0.05)


def test_machines_that_do_not_differ_pool_to_their_mean_and_others_do_not():
    """The own record's share goes to 1 of K where K machines agree as well as their records can."""
    rng = np.random.default_rng(5)
    for many in (20, 50):
        s = rng.uniform(0.15, 0.25, many)
        found = first(machines(np.full(many, 1.0), s))
        assert found.moved < 1.5 / many
        alike = 1.0 + rng.normal(0, s)
        complete = np.average(alike, weights=s**-2)
        pooled_value = np.log(first(machines(alike, s)).value)
        assert abs(pooled_value - complete) < 0.15 * abs(alike[0] - complete)
    differ = first(machines(rng.normal(1.0, 0.6, 20), np.full(20, 0.1)))
    assert differ.moved > 0.95


def test_what_records_do_not_determine_has_the_siblings_value_as_a_proposal():
    others = machines(np.array([1.0, 1.2]), np.array([0.05, 0.05]))
    found = pooled(UNKNOWN, others)
    assert found is not None and (found.siblings, found.moved) == (2, 0.0)
    assert found.value == pytest.approx(found.expected) == pytest.approx(np.exp(1.1), rel=1e-3)
    assert found.interval_95[0] < np.exp(1.0) and found.interval_95[1] > np.exp(1.2)


def test_nothing_is_pooled_without_a_sibling_that_has_an_estimate():
    assert pooled(parameter(1.0, 0.1), []) is None
    assert pooled(parameter(1.0, 0.1), [UNKNOWN]) is None


def test_values_of_both_signs_are_pooled_as_they_are():
    signed = [Parameter(value=v, unit="K", interval_95=(v - 1, v + 1), determined=True, method="")
              for v in (-2.0, 3.0, 2.5)]  # fmt: skip
    found = first(signed)
    assert -2.0 < found.value < found.expected and found.interval_95[0] < -2.0


def test_one_machine_leaves_the_prior_between_machines():
    mean, deviation = expected([0.7], [0.4], 0.3)
    off = 2 * (1 - ALIKE) * 0.3**2
    assert (mean, deviation) == (pytest.approx(0.7), pytest.approx((0.16 + off) ** 0.5, rel=1e-3))


def test_a_standard_error_is_of_the_logarithm_where_the_interval_allows():
    assert standard_error(parameter(2.0, 0.3), logarithmic=True) == pytest.approx(0.3)
    across = Parameter(value=2.0, unit="N", interval_95=(-1.0, 5.0), determined=True, method="")
    assert standard_error(across, logarithmic=True) == pytest.approx(6 / (2 * Z * 2))
    assert standard_error(UNKNOWN, logarithmic=False) is None


@pytest.mark.parametrize(
    ("name", "shared", "own"),
    [
        ("drive", "X coulomb_positive", "X mass"),
        ("drive", "Z stribeck_velocity_negative", "motor R"),
        ("cutting", "K_tc", "runout"),
        ("cutting", "kienzle.m_c", "mean force K_tc"),
    ],
)
def test_sub_models_share_what_is_of_the_type(name: str, shared: str, own: str):
    import re

    pattern = submodel(name).shared
    assert re.fullmatch(pattern, shared) and not re.fullmatch(pattern, own)


@pytest.mark.proof
@pytest.mark.parametrize("many", [3, 5, 10])
def test_error_and_coverage_over_known_hierarchies(many: int):
    """Below each machine alone and below complete pooling; 90 to 97 % inside of 95 %."""
    rng, errors, inside = np.random.default_rng(many), [], []
    for _ in range(400):
        truth = rng.normal(1.0, 0.2, many)
        s = rng.uniform(0.1, 0.4, many)
        y = truth + rng.normal(0, s)
        found = first(machines(y, s))
        complete = np.average(y, weights=s**-2)
        errors.append(np.array([np.log(found.value), y[0], complete]) - truth[0])
        low, high = np.log(found.interval_95)
        inside.append(low <= truth[0] <= high)
    mse = np.mean(np.square(errors), axis=0)
    assert mse[0] < 0.9 * min(mse[1:]), f"pooled, alone, complete: {mse}"
    assert 0.90 <= np.mean(inside) <= 0.97
