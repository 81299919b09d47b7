"""What answers are measured against: each is what its name says, and costs what it says."""

from functools import cache

import numpy as np
import pytest

from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.genes import Method, method_of
from pipeline.optimisation.methods.genetic import baselines
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.settings import Grouping, SearchSettings
from pipeline.schema.limits import CutLimit
from pipeline.twin.cut.document import document_of
from tests.optimisation.problem_parts import basis_of, cut_on, problem_on
from tests.optimisation.zigzags import zigzag_problem

PER_TURN = """T1 M6
G95
G0 X-10 Y20 S5000 M3
Z5
G1 Z-2 F0.1
X30
X70 F0.15
G94
G0 Z5
M30
"""


@cache
def problem() -> Problem:
    return zigzag_problem(1)


@cache
def found(objective: str = "time") -> tuple[Method, ...]:
    groups = blockwise_optimum(problem(), objective, Grouping()).groups
    return tuple(baselines(problem(), groups, objective, SearchSettings()))


def test_they_stand_in_their_order() -> None:
    assert [method.name for method in found()] == [
        "as programmed", "genetic, random start, 10 generations", "best of 5000 evaluations",
    ]  # fmt: skip


def test_as_programmed_is_what_the_cut_tells_of_the_program() -> None:
    summary = document_of(problem().cut, basis_of(problem().cut)).summary
    told = [
        summary.time_s, summary.cost.sum, summary.energy_kWh,
        summary.tool_life_share,
    ]  # fmt: skip
    # the document gives four digits and more
    assert found()[0].objectives == pytest.approx(np.array(told), rel=1e-4)
    assert found()[0].evaluations == 1 and found()[0].decision is None


def test_many_evaluations_are_counted_and_no_more_than_said() -> None:
    # a population of 48, of which one stays: 47 children a generation
    assert found()[1].evaluations == 48 + 9 * 47
    assert 5000 - 47 < found()[2].evaluations <= 5000


def test_limits_come_first_only_where_they_do() -> None:
    published, best = found()[1:]
    # ten generations of F and S of forty genes do not get inside; the penalty lets them stay out
    assert published.violation > 0 and best.violation == 0


def test_what_is_told_is_what_the_decision_comes_to() -> None:
    for method in found("cost")[1:]:
        again = method_of(problem(), method.name, method.decision, method.evaluations)
        assert (again.objectives == method.objectives).all()
        assert again.violation == method.violation
        assert (method.decision.speeds == np.round(method.decision.speeds)).all()


def test_the_published_search_asks_for_f_and_s_of_their_ranges() -> None:
    decision = found()[1].decision
    cuts = problem().cuts
    assert (decision.row_feeds[cuts] >= 100).all() and (decision.row_feeds[cuts] <= 1500).all()
    assert (decision.row_speeds[cuts] >= 1000).all() and (decision.row_speeds[cuts] <= 8000).all()


def test_feeds_of_a_turn_keep_ranges_of_a_minute() -> None:
    limits = CutLimit(load_N=200.0, feed_mm_min=(100.0, 900.0), speed_rpm=(2000.0, 8000.0))
    part = problem_on(cut_on(PER_TURN), limits)
    groups = blockwise_optimum(part, "time", Grouping()).groups
    for method in baselines(part, groups, "time", SearchSettings(baseline=500))[1:]:
        rows = part.cuts
        per_minute = (method.decision.row_feeds * method.decision.row_speeds)[rows]
        assert (per_minute >= 100 * (1 - 1e-9)).all() and (per_minute <= 900 * (1 + 1e-9)).all()


def test_the_same_seed_gives_the_same_bytes() -> None:
    def run(seed: int) -> list[bytes]:
        groups = blockwise_optimum(problem(), "time", Grouping()).groups
        settings = SearchSettings(population=8, baseline=100, seed=seed)
        return [
            method.decision.feeds.tobytes() + method.decision.speeds.tobytes()
            for method in baselines(problem(), groups, "time", settings)[1:]
        ]

    assert run(3) == run(3)
    assert all(one != other for one, other in zip(run(3), run(4), strict=True))


def test_none_leaves_the_many_out_and_a_callback_ends_them() -> None:
    groups = blockwise_optimum(problem(), "time", Grouping()).groups
    assert len(baselines(problem(), groups, "time", SearchSettings(baseline=0))) == 2
    ended = baselines(problem(), groups, "time", SearchSettings(), lambda *_: True)
    assert [method.evaluations for method in ended] == [1, 48, 48]
