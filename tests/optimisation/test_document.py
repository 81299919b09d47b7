"""The document of an optimisation: sums, places and limits restated from its cuts, row by row."""

import json
from dataclasses import replace

import numpy as np
import pytest

from pipeline.app.optimise import optimise_lines
from pipeline.optimisation.comparison import Side, exceeded_limits, load_trace
from pipeline.optimisation.document import optimised_part, optimised_text
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.optimise import optimise
from pipeline.optimisation.proof.prove import prove
from pipeline.optimisation.settings import OptimisationSettings, ReliabilitySettings, SearchSettings
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.structure import structured
from pipeline.twin.cut.document import assessed, document_of
from tests.optimisation.paper_part import paper_job

QUICK = OptimisationSettings(
    certainty=ReliabilitySettings(draws=64),
    search=SearchSettings(population=8, generations=3, baseline=50, paper_generations=2, front=8),
    proof_comment=True,
)


@pytest.fixture(scope="module")
def result() -> Result:
    return optimise(paper_job("time", settings=QUICK))


@pytest.fixture(scope="module")
def document(result: Result) -> dict:
    part = optimised_part(result, machine="mill", origin="simulated", control="identified")
    return part_values(part)


def test_what_is_stored_is_read_as_the_same_part(result: Result, document: dict) -> None:
    text = json.dumps(document, allow_nan=False)
    part = optimised_part(result, machine="mill", origin="simulated", control="identified")
    assert structured(json.loads(text), OptimisedPart, "$") == part
    assert "deflection_um" not in document["limits"]  # not given


def test_the_unit_of_a_machine_is_named_where_there_are_several(document: dict) -> None:
    assert "machine_unit" not in document
    part = structured({**document, "machine_unit": "hurco04"}, OptimisedPart, "$")
    assert part_values(part)["machine_unit"] == "hurco04"
    assert "  on unit hurco04; --unit names another one" in list(optimise_lines(part))


def test_totals_are_those_of_the_two_cuts(result: Result, document: dict) -> None:
    for which, cut in (("before", result.before), ("after", result.answer.cut)):
        told = document_of(cut, result.job.basis).summary
        assert document[which]["time_s"] == told.time_s
        assert document[which]["cost"] == told.cost.sum
        assert document[which]["peak_load_N"] == told.peak_load_N


def test_the_answer_among_the_methods_is_what_is_written(document: dict) -> None:
    """The search's own evaluation against the plan of the text, on another way."""
    answer = next(one for one in document["methods"] if one["method"] == "answer")
    for key in ("time_s", "cost", "energy_kWh", "tool_life_share"):
        told = document["after"][key]  # six digits
        assert answer[key] == (None if told is None else pytest.approx(told, rel=1e-5))
    assert answer["time_s"] is not None and answer["cost"] is not None


def test_rows_that_were_added_count_to_the_row_they_stand_before(result: Result) -> None:
    cut = result.answer.cut
    side = Side.of_rows(cut, assessed(cut, result.job.basis), result.answer.rows)
    assert len(cut.plan.time) >= len(side.time) == len(result.moves)
    assert side.time.sum() == pytest.approx(cut.plan.total, rel=1e-12)
    for row, own in enumerate(result.answer.rows.tolist()):
        first = 0 if row == 0 else int(result.answer.rows[row - 1]) + 1
        last = own if row < len(side.time) - 1 else len(cut.plan.time) - 1
        assert side.time[row] == pytest.approx(cut.plan.time[first : last + 1].sum(), rel=1e-12)


def test_groups_hold_every_block_once_in_order(result: Result, document: dict) -> None:
    groups, problem = document["groups"], result.problem
    decision = result.answer.decision
    held = np.flatnonzero((decision.groups.feed >= 0) | problem.cuts)
    for which, cut in (("before", result.before),):
        spent = sum(g[f"time_{which}_s"] for g in groups)
        assert spent == pytest.approx(cut.plan.time[held].sum(), rel=1e-4)  # six digits of each
    lines = [(g["first_line"], g["last_line"]) for g in groups]
    assert all(a <= b for a, b in lines)
    assert [a for a, _ in lines] == sorted(a for a, _ in lines)
    inside = {line for a, b in lines for line in range(a, b + 1)}
    assert set(result.moves.line[held].tolist()) <= inside
    changed = [g for g in groups if g["feed_before"] != g["feed_after"]]
    assert changed  # else this proves nothing
    feeds = result.answer.cut.plan.path.moves.feed[result.answer.rows]
    for g in groups:
        rows = held[(result.moves.line[held] >= g["first_line"])
                    & (result.moves.line[held] <= g["last_line"])]  # fmt: skip
        assert feeds[rows].min() <= g["feed_after"] * (1 + 1e-5)
        assert feeds[rows].max() >= g["feed_after"] * (1 - 1e-5)


def test_what_binds_is_counted_over_the_blocks_that_cut(result: Result, document: dict) -> None:
    binding = document["binding"]
    assert sum(row["blocks"] for row in binding) == int(result.problem.cuts.sum())
    cutting = result.before.plan.time[result.problem.cuts].sum()
    assert 0 < sum(row["time_s"] for row in binding) <= document["after"]["time_s"]
    assert cutting > 0


@pytest.mark.parametrize("columns", [7, 60, 900])
def test_columns_of_the_way_hold_the_peak_of_each_station(result: Result, columns: int) -> None:
    """Restated station by station with numbers of Python."""
    cut, found = result.before, result.before.engagement
    pieces = cut.path.pieces
    begin, way = [], 0.0
    for length, fed in zip(pieces.length.tolist(), pieces.feed.tolist(), strict=True):
        begin.append(way)
        way += length if fed else 0.0
    trace = load_trace(cut, columns)
    assert trace.total_mm == pytest.approx(way * 1e3, abs=1e-3)
    peak = cut.station_loads.peak
    for k, load in enumerate(trace.load_N):
        a, b = k * way / columns, (k + 1) * way / columns
        # a station that ends within rounding of a column's edge may count there or not
        sure = [
            peak[s] for s in np.flatnonzero(found.feed).tolist()
            if (start := begin[found.piece[s]] + found.along[s]) < b - 1e-9
            and start + found.length[s] > a + 1e-9
        ]  # fmt: skip
        maybe = [
            peak[s] for s in np.flatnonzero(found.feed).tolist()
            if (start := begin[found.piece[s]] + found.along[s]) < b + 1e-9
            and start + found.length[s] > a - 1e-9
        ]  # fmt: skip
        assert load is not None or not sure
        if load is not None:
            assert max(sure, default=0) * (1 - 1e-3) <= load <= max(maybe) * (1 + 1e-3)


LIMITED = {
    "load_N": lambda b, k: b.peak[k],
    "chip_um": lambda b, k: b.thickness[k] * 1e6,
    "torque_Nm": lambda b, k: b.torque[k],
    "cutting_speed_m_min": lambda b, k: np.pi * 6e-3 * b.spindle_speed[k],
    "speed_rpm": lambda b, k: b.spindle_speed[k],
    "feed_mm_min": lambda b, k: b.feed[k],
    "roughness_um": lambda b, k: b.feed_per_tooth[k] ** 2 / (8 * 3e-3) * 1e6,
}
"""What each limit is of, for a flat end mill of 6 mm without runout."""


@pytest.mark.parametrize("name", sorted(LIMITED))
def test_a_block_passes_what_lies_below_its_value_and_not_what_lies_above(
    result: Result, name: str
) -> None:
    of = assessed(result.before, result.job.basis)

    def exceeded(limit: object) -> np.ndarray:
        limits = replace(CutLimit(), **{name: limit})
        return np.logical_or.reduce([*exceeded_limits(of, limits).values()])

    values = np.array([LIMITED[name](of.results.blocks, k) for k in range(len(of.results.blocks))])
    middle = 0.5 * (values.min() + values.max()) or 1.0
    ranged = name in ("chip_um", "cutting_speed_m_min", "speed_rpm", "feed_mm_min")
    for limit in (0.5 * values.min(), middle, 2 * values.max()):
        if limit <= 0:
            continue
        given = (0.0, float(limit)) if ranged else float(limit)
        found = exceeded(given)
        clear = np.abs(values / limit - 1) > 2e-3  # rounding is none of these
        assert (found[clear] == (values > limit)[clear]).all()
    if ranged and name != "feed_mm_min":
        assert exceeded((2 * float(values.max()), 1e9)).all()


def test_the_proof_stands_in_the_comment_and_the_hash_is_that_of_the_file(
    result: Result, document: dict
) -> None:
    text = optimised_text(result)
    assert document["proof"]["sha256"].upper().encode() in text.upper()
    assert text != result.answer.text
    job = result.job
    again = prove(job.program.data, text, "a", "b", job.setup)
    assert again.same and again.sha256 == document["proof"]["sha256"]
    assert again.after_sha256 == document["proof"]["after_sha256"]
    assert again.before_sha256 == document["proof"]["before_sha256"]


def test_words_are_those_of_the_proof(result: Result, document: dict) -> None:
    """The writer's count against that of the check, which shares no code with it."""
    found = result.proof.differences
    for letter in "FS":
        mine = [one for one in found if one.letter == letter]
        added = sum(one.before is None for one in mine)
        assert document["words"][f"{letter}_added"] == added
        assert document["words"][f"{letter}_changed"] == len(mine) - added
