"""The part of Sim2023's kind: what it is, then optimised and cut on its machine.

``KERF_TRIAL_SEEDS=100 pytest -s`` cuts 100 parts for each program and prints what came out.
"""

import os
import sys
from functools import cache, partial

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.optimise import optimise
from pipeline.optimisation.settings import OptimisationSettings, ReliabilitySettings
from pipeline.schema.part import Objective
from pipeline.shop.cutting.dynamometer import write_dynamometer
from pipeline.shop.cutting.records import dynamometer_truth
from pipeline.shop.trial.trials import prepare, trial, trials
from pipeline.twin.control import planned_program
from pipeline.twin.cut.coefficients import identified_coefficients
from pipeline.twin.cut.loads import cut_program
from tests.optimisation.paper_part import (
    CONTROL,
    LIMITS,
    MACHINE,
    NAME,
    PROGRAM,
    SETUP,
    TRIAL,
    paper_job,
    paper_knowledge,
)
from tests.optimisation.several_tools import QUICK

K_T, K_E = 1.23e9, 0.5


@pytest.fixture(scope="module")
def cut():
    job = paper_job("time")
    return cut_program(planned_program(interpret(job.program, SETUP), CONTROL), job.cut)


def test_it_takes_as_long_as_the_program_of_the_paper(cut):
    """29.48 s there; 1 % is less than what any feed of it could be wrong by."""
    assert cut.plan.total == pytest.approx(29.5, rel=0.01)


def test_its_load_as_programmed_is_that_of_the_papers_coefficients(cut):
    """Slots of 1 and 1.2 mm at 0.03 mm: K_t d f_z sqrt(1 + K_e^2), below 60 N; 0.5 % of chords."""
    peaks = cut.loads().peak
    slots = [K_T * d * 0.03e-3 * np.hypot(1, K_E) for d in (1e-3, 1.2e-3)]
    assert peaks.max() == pytest.approx(slots[1], rel=5e-3) and peaks.max() < LIMITS.load_N
    assert (np.abs(peaks - slots[0]) < 0.5).sum() >= 10
    assert (np.abs(peaks - slots[1]) < 0.5).sum() >= 8


@pytest.mark.parametrize("parts", [3, pytest.param(20, marks=pytest.mark.proof)])
def test_its_machine_takes_as_long_and_loads_the_tool_below_the_limit(cut, parts):
    """Another planner, S-curves, lag: 2 %; parts as programmed by a person who is careful."""
    its = prepare(PROGRAM, NAME, TRIAL, MACHINE)
    found = [trial(its, TRIAL, MACHINE, seed) for seed in range(parts)]
    times = [one.time_s for one in found]
    assert times == pytest.approx([cut.plan.total] * parts, rel=0.02)
    peaks = [one.peak_load_N for one in found]
    assert max(peaks) < LIMITS.load_N and min(peaks) > 0.7 * LIMITS.load_N


@pytest.mark.proof
def test_what_is_identified_of_its_machine_holds_the_truth(tmp_path):
    """Every interval that is told; the law's load in a slot is the shop's truth to 5 %."""
    model = paper_knowledge(tmp_path / "known").model
    recorded = write_dynamometer(tmp_path / "again", MACHINE)
    true = dynamometer_truth(MACHINE.cutting, recorded)["parameters"]
    told = {k: v for k, v in model.coefficients.items() if k in true and v.determined}
    assert {"K_tc", "K_rc", "K_te", "K_re", "runout"} <= set(told)
    for name, one in told.items():
        assert one.interval_95 is not None
        low, high = one.interval_95
        assert low <= true[name] <= high, name
    identified = identified_coefficients(model)
    assert identified is not None
    law, f_z = identified.law, 0.03e-3
    expected = np.hypot(
        true["K_tc"] * 1e6 * f_z + true["K_te"] * 1e3, true["K_rc"] * 1e6 * f_z + true["K_re"] * 1e3
    )
    found = np.hypot(law.K_tc * f_z + law.K_te, law.K_rc * f_z + law.K_re)
    assert found == pytest.approx(expected, rel=0.05)


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
    result = optimise(paper_job("time", None, QUICK))
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
    assert cut["after"]["above"] == 0  # with 100 seeds too
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
