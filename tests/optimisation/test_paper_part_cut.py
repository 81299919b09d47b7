"""Sim2023's kind of part: optimised from its machine's records, then cut on that machine.

``KERF_TRIAL_SEEDS=100 pytest -s`` cuts 100 parts for each program and prints what came out.
"""

import os
import sys
from functools import cache, partial

import pytest

from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.optimise import optimise
from pipeline.optimisation.settings import OptimisationSettings, ReliabilitySettings, SearchSettings
from pipeline.schema.part import Objective
from pipeline.shop.trial.trials import trials
from tests.optimisation.paper_part import MACHINE, PROGRAM, TRIAL, paper_job, paper_knowledge

SEEDS = int(os.environ.get("KERF_TRIAL_SEEDS", "20"))
CERTAIN, EVEN = 0.01, 0.5

OBJECTIVES = pytest.mark.parametrize("objective", ["time", "cost"])


@pytest.fixture(scope="module")
def knowledge(tmp_path_factory):
    return paper_knowledge(tmp_path_factory.mktemp("paper"))


@pytest.fixture(scope="module")
def found(knowledge):
    """Parts by objective and demand of certainty, each optimised when it is first asked for."""
    return cache(partial(_optimised, knowledge))


def _optimised(knowledge, objective: Objective, epsilon: float) -> Result:
    settings = OptimisationSettings(certainty=ReliabilitySettings(epsilon=epsilon))
    return optimise(paper_job(objective, knowledge, settings))


def _cut(result: Result):
    return trials(PROGRAM.encode(), result.answer.text, TRIAL, MACHINE, range(SEEDS))


def test_a_short_search_is_faster_and_inside_the_limit_where_it_is_cut():
    """With coefficients that others measured, which err by 10 %, and a search of a moment."""
    search = SearchSettings(population=8, generations=3, baseline=50, paper_generations=2, front=8)
    settings = OptimisationSettings(certainty=ReliabilitySettings(draws=64), search=search)
    result = optimise(paper_job("time", None, settings))
    cut = trials(PROGRAM.encode(), result.answer.text, TRIAL, MACHINE, range(3))
    assert cut["after"]["above"] == 0
    assert cut["after"]["time_s"]["mean"] < cut["before"]["time_s"]["mean"]


@pytest.mark.proof
@pytest.mark.slow
@OBJECTIVES
def test_faster_and_cheaper_and_inside_the_limit_where_it_is_cut(found, objective):
    result = found(objective, CERTAIN)
    before, after = (
        next(one.objectives for one in result.methods if one.name == name)
        for name in ("as programmed", "answer")
    )
    time, cost = (100 * (after[k] / before[k] - 1) for k in (0, 1))
    cut = _cut(result)
    sys.stdout.write(
        f"\n{objective}, epsilon 1 %: time {before[0]:.2f} -> {after[0]:.2f} s ({time:.1f} %; "
        f"Sim2023 -16.9 %), cost {before[1]:.1f} -> {after[1]:.1f} ({cost:.1f} %; Sim2023 -36.4 %)"
        f"\n  cut (simulated): {cut['before']} -> {cut['after']}"
    )
    assert time < -16.9
    assert cost < -4
    # of 100 parts one is expected at most
    assert cut["after"]["above"] <= max(1, SEEDS // 100)
    assert cut["after"]["time_s"]["mean"] == pytest.approx(after[0], rel=0.05)


@pytest.mark.proof
@pytest.mark.slow
def test_without_a_demand_of_certainty_the_limit_is_passed(found):
    above = _cut(found("time", EVEN))["after"]["above"]
    sys.stdout.write(f"\ntime, epsilon 50 %: {above} of {SEEDS} above 60 N (simulated)")
    assert above > SEEDS // 10


@pytest.mark.proof
@pytest.mark.slow
def test_certainty_has_its_price(found):
    certain, even = (found("time", epsilon).answer.objectives[0] for epsilon in (CERTAIN, EVEN))
    assert certain > even


@pytest.mark.proof
@pytest.mark.slow
@OBJECTIVES
def test_never_worse_than_direct_and_as_good_as_5000_evaluations(found, objective):
    result = found(objective, CERTAIN)
    index = ("time", "cost").index(objective)
    value = {one.name: float(one.objectives[index]) for one in result.methods}
    assert value["answer"] <= value["direct"]
    # words hold F rounded down by less than 0.1 %
    assert value["answer"] <= value["best of 5000 evaluations"] * 1.001
    assert result.evaluated <= 50


@pytest.mark.proof
@pytest.mark.slow
def test_the_same_seed_gives_the_same_bytes(found, knowledge):
    again = _optimised(knowledge, "time", CERTAIN)
    assert again.answer.text == found("time", CERTAIN).answer.text
    assert vars(again.risk) == vars(found("time", CERTAIN).risk)
