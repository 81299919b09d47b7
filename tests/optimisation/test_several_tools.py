"""Programs of several tools: limits of each, tools that cannot keep theirs, held drills."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from pipeline.app.optimise import optimise_lines
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.tool import Tool, tool_limits
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.problem.feasible import LimitsError
from pipeline.report.optimised.tables import limits_table
from pipeline.schema.part import part_values
from tests.optimisation.several_tools import (
    EIGHT,
    HOLE,
    SHOULDER,
    SIXTEEN,
    SLOTTED,
    STOCK,
    TEN,
    THREAD,
    THREADS,
    TOOLS,
    document,
    optimised,
    written,
)

WHOLE = SLOTTED + SHOULDER + HOLE + THREAD


@cache
def with_own(load_1: float | None, load_N: float | None) -> Result:
    """The whole program with a load limit of T1's own, and one of the part."""
    return optimised(WHOLE, {**TOOLS, 1: replace(SIXTEEN, limit_load_N=load_1)}, load_N=load_N)


def peak_of(result: Result, tool: int) -> float:
    """Greatest load of a tool in the program after [N]."""
    cut = result.answer.cut
    mine = cut.plan.path.moves.tool == tool
    return float(cut.block_loads.peak[mine].max())


def test_a_tool_s_own_limit_goes_before_that_of_the_part() -> None:
    result, alone = with_own(400.0, 700.0), with_own(400.0, None)
    assert peak_of(result, 1) < 0.8 * peak_of(with_own(None, 700.0), 1)
    assert result.risk is not None and result.risk.interval_95[0] <= 0.01
    assert written(alone)[4] == pytest.approx(written(result)[4], abs=10.0)
    assert written(alone)[14] == 160.0  # the drill, which no limit holds for
    said = document(result)
    assert said.certainty is not None and said.certainty.limits_N == "700 N, T1 400 N"
    assert (said.load_limit_N, document(with_own(None, 700.0)).load_limit_N) == (None, 700.0)
    table = limits_table(said, [])
    assert table is not None and "oad across the tool’s axis of T1" in str(table)


def test_a_tool_that_cannot_keep_its_limit_does_not_stop_the_others() -> None:
    result = with_own(100.0, 700.0)
    assert list(result.given_up) == [1]
    words = written(result)
    assert (words[4], words[14] < 160.0) == (300.0, True)
    said = document(result)
    assert said.warnings[0].grave and said.warnings[0].what.startswith(
        "T1 cannot keep its limits and stays as programmed, the certainty is that of the other "
        "tools: P.nc:4: no F and S of their ranges keep the load limit of 100 N"
    )
    assert said.after.beyond_of == {"load": 1}
    assert said.certainty is not None and said.certainty.without == (1, 7)
    lines = list(optimise_lines(said))
    first = next(k for k, line in enumerate(lines) if "WARNING" in line)
    assert "T1 cannot keep" in lines[first] and not any("before" in line for line in lines[:first])
    assert any("P(load > 700 N)" in line and line.endswith("without T1, T7") for line in lines)
    stored = json.loads(json.dumps(part_values(said), allow_nan=False))
    assert "T1 cannot keep" in stored["warnings"][0]["what"]


def test_tools_that_all_cannot_keep_a_limit_are_refused() -> None:
    with pytest.raises(LimitsError, match=r"keeps? the load limit of 0\.5 N"):
        optimised(WHOLE, load_N=0.5)


def test_the_load_of_a_thread_mill_is_not_computed_and_said_not_to_be() -> None:
    """A flat end mill in its place has a load of more than half a kilonewton."""
    result = with_own(None, 700.0)
    said = document(result)
    assert peak_of(result, 7) == 0.0
    use = next(use for use in said.tools if use.tool == 7)
    assert use.after.peak_load_N is None and use.after.feed_per_tooth_mm is not None
    assert [row.why for row in said.not_known if row.what.endswith("of T7")] == [
        "the contact of a thread mill’s profile is not computed, and no limit of them holds for it"
    ]
    assert written(result)[19] == 100.0
    flat, named = (
        replace(THREADS, role="", name=""),
        replace(THREADS, role="", name="M12 THREADMILL"),
    )
    assert peak_of(optimised(HOLE + THREAD, {**TOOLS, 7: flat}), 7) > 500.0
    assert peak_of(optimised(HOLE + THREAD, {**TOOLS, 7: named}), 7) == 0.0


PECKS = "T3 M6\nG0 X30 Y25 S1600 M3\nZ2\n" + "".join(
    f"G1 Z-{depth} F160\nG0 Z2\n" for depth in (20, 40, 60, 80)
)
DEEP = "box:0,60,0,50,-100,0"
OPEN = "G0 Z20\n"


HSS = replace(EIGHT, material="hss", point_angle_deg=118.0)


@pytest.mark.parametrize(("text", "stock", "drill"), [
    (PECKS + OPEN, DEEP, EIGHT), (PECKS + OPEN, DEEP, HSS),  # 10 D, in four pecks
    (SLOTTED + HOLE.replace("Y44", "Y28"), STOCK, EIGHT),  # the slot is 12 to 28
    (HOLE.replace("X50", "X59.5"), STOCK, HSS),  # at the edge of the blank
])  # fmt: skip
def test_a_drill_in_a_deep_hole_or_on_one_side_has_no_more_than_programmed(
    text: str, stock: str, drill: Tool
) -> None:
    result = optimised(text, {**TOOLS, 3: drill}, stock=stock)
    moves = result.moves
    mine = (moves.tool == 3) & (result.before.tool >= 0)
    lines = sorted(set(moves.line[mine].tolist()))
    assert lines and all(written(result).get(line, 160.0) <= 160.0 for line in lines)
    after = result.answer.cut
    assert (np.asarray(after.plan.path.moves.speed[after.tool >= 0])[-1]) <= 1600.0
    named = [one.reason for one in document(result).held if "on one side" in one.reason]
    one_sided = stock == STOCK
    assert named == (["F and S: T3 drills on one side only, no more than programmed"] * one_sided)


def test_a_plain_hole_of_two_diameters_has_more() -> None:
    assert written(optimised(HOLE.replace("X50 Y44", "X30 Y25")))[4] > 160.0


def test_a_bare_limit_is_one_of_each_tool() -> None:
    own = {number: replace(tool, limit_load_N=700.0) for number, tool in TOOLS.items()}
    alike = optimised(WHOLE, own)
    assert alike.answer.text == with_own(None, 700.0).answer.text
    assert vars(alike.risk) == vars(with_own(None, 700.0).risk)


def test_limits_of_deflection_are_by_tool_too() -> None:
    result = optimised(SLOTTED + SHOULDER, {**TOOLS, 2: replace(TEN, limit_deflection_um=8.0)},
                       deflection_um=40.0)  # fmt: skip
    bending = result.problem.bounds.most[1]
    tool = result.problem.cut.tool
    free = optimised(SLOTTED + SHOULDER, deflection_um=40.0).problem.bounds.most[1]
    assert (bending[tool == 0] == free[tool == 0]).all()
    assert (bending[tool == 1] < free[tool == 1]).all()


def test_a_tool_beyond_the_drive_does_not_stop_the_others() -> None:
    """No S and F of the slot stay within the power; the shoulder behind it does."""
    weak = SpindleDrive(rated_power_kW=0.6, base_speed_rpm=1500.0, top_speed_rpm=8000.0)
    result = optimised(SLOTTED + SHOULDER, drive=weak, speed_rpm=(1600.0, 2600.0))
    first = document(result).warnings[0]
    assert first.grave and first.what.startswith(
        "T1 cannot keep its limits and stays as programmed:"
    )
    assert "certainty" not in first.what
    assert set(result.given_up) == {1}


def test_a_limit_without_decimals_may_be_outside_of_a_tool() -> None:
    assert tool_limits((SIXTEEN, THREADS), "load_N", 5000).tolist() == [5000.0, np.inf]
