"""Two programs as a process engineer writes them, with the default limits: would one load them?"""

import re
from itertools import pairwise

import numpy as np
import pytest

from pipeline.gcode.setup import Tool
from tests.gcode.following import follow
from tests.gcode.rs274 import RS274, Oracle
from tests.gcode.test_rs274 import assert_same
from tests.optimisation.machinist import (
    ALUMINIUM,
    BRACKET,
    PROGRAMS,
    SLOTS,
    Order,
    moves_of,
    optimised,
    tools_of,
)

ORDERS = pytest.mark.parametrize("order", [BRACKET, ALUMINIUM], ids=lambda one: one.name)
UP, DOWN = 1.5, 0.5
"""Greatest change of feed per tooth and cutting speed by default."""
SHORT = ("G1 X90. F420", "G1 X40. F420\nX40.02\nX90.")
"""A slot with a block in it that is too short to reach its F."""
EXACT = 1e-9
"""What a ratio of two printed numbers may differ by."""
FINISHING = [(BRACKET, "FINISH FLOOR"), (BRACKET, "FINISH WALLS"), (BRACKET, "FINISH CONTOUR"),
             (ALUMINIUM, "FINISH SURFACE")]  # fmt: skip


def test_the_tables_leave_the_ranges_to_the_defaults() -> None:
    for order in (BRACKET, ALUMINIUM):
        for tool in tools_of(order.name).values():
            assert tool.feed_per_tooth_mm is None and tool.cutting_speed_m_min is None


@ORDERS
def test_the_program_is_followed(order: Order) -> None:
    text = (PROGRAMS / f"{order.name}.nc").read_text()
    assert set(np.unique(moves_of(text).tool).tolist()) >= set(tools_of(order.name))


@pytest.mark.skipif(not RS274.exists(), reason=f"{RS274} is not installed")
@ORDERS
def test_linuxcnc_follows_it_alike(order: Order, tmp_path) -> None:
    """Without the O number and the M29 of a Fanuc, which it does not know."""
    text = (PROGRAMS / f"{order.name}.nc").read_text()
    text = re.sub(r"^(O\d+|M29 .*)", "", text, flags=re.MULTILINE)
    lengths = {number: (0.0, tool.diameter_mm) for number, tool in tools_of(order.name).items()}
    answer = Oracle(tmp_path, lengths).ask_text(text)
    assert answer.error == "" and len(answer.ends) > 100
    tools = {number: Tool(length=z, diameter=d) for number, (z, d) in lengths.items()}
    assert_same(follow(text, dialect="linuxcnc", tools=tools, inch_machine=True), answer)


def test_the_bracket_has_what_it_is_to_try() -> None:
    """Ramps and plunges in the cut, moves over a clamp in air at feed, a floor 0.05 mm deep."""
    read = optimised(BRACKET)
    rows = read.rows
    falls = rows.in_cut & (rows.drop > 0)
    assert (falls & (rows.tool == 2)).sum() >= 3 and (falls & (rows.tool == 3)).sum() >= 6
    clamp = read.among(read.section("OVER THE CLAMP")) & rows.in_air
    assert rows.feed[0, clamp].tolist() == [4000.0, 4000.0]
    floor = read.among(read.section("FINISH FLOOR")) & rows.in_cut & (rows.feed[0] == 300)
    assert floor.sum() >= 10 and rows.f_z[0, floor] == pytest.approx(0.025)


def test_the_cover_has_repeated_points() -> None:
    lines = (PROGRAMS / "aluminium.nc").read_text().splitlines()
    points = [line.split(" F")[0] for line in lines if line.startswith("X")]
    assert sum(one == after for one, after in pairwise(points)) > 30


@ORDERS
def test_feed_per_tooth_and_cutting_speed_stay_near_what_was_programmed(order: Order) -> None:
    rows = optimised(order).rows
    for values in (rows.f_z, rows.v_c):
        before, after = values[:, rows.in_cut]
        ratio = after / before
        assert (ratio <= UP + EXACT).all() and (ratio >= DOWN - EXACT).all()


@ORDERS
def test_nothing_is_faster_in_air_at_feed(order: Order) -> None:
    rows = optimised(order).rows
    assert rows.in_air.sum() >= 3
    assert (rows.feed[1] <= rows.feed[0])[rows.in_air].all()


@pytest.mark.parametrize(("order", "tool", "name"), [
    (BRACKET, 6, "M10 TAP"),
    pytest.param(BRACKET, 7, "10H7 REAMER"),
    pytest.param(BRACKET, 8, "12MM THREAD MILL"),
])  # fmt: skip
def test_taps_reamers_and_thread_mills_are_left_alone(order: Order, tool: int, name: str) -> None:
    read = optimised(order)
    assert tools_of(order.name)[tool].name.startswith(name)
    lines = read.of_tool(tool)
    assert [read.after[k - 1] for k in lines] == [read.before[k - 1] for k in lines]


@ORDERS
def test_a_new_s_stands_where_its_tool_cuts_next_and_nowhere_else(order: Order) -> None:
    """Not in a block of M codes, a return to reference, or after the tool's last cut."""
    read = optimised(order)
    rows = read.rows
    for line in read.new_words("S"):
        text = read.before[line - 1]
        assert not re.search(r"M0*(0|1|2|5|6|9|30)\b|G28|G80", text), (
            f"{line}: {read.after[line - 1]}"
        )
        tool = rows.tool[rows.line <= line][-1]
        later = rows.in_cut & (rows.line >= line) & (rows.tool == tool)
        assert later.any(), f"{line}: {read.after[line - 1]}"
    for line, _ in read.changed_words("S"):
        assert "M9" not in read.after[line - 1].split()


@pytest.mark.parametrize(("order", "comment"), FINISHING, ids=[comment for _, comment in FINISHING])
def test_finishing_has_one_f_where_it_had_one(order: Order, comment: str) -> None:
    read = optimised(order)
    before, after = read.rows.feed[:, read.among(read.section(comment)) & read.rows.in_cut]
    for feed in np.unique(before):
        assert len(np.unique(after[before == feed])) == 1, (
            f"F{feed:g} became {after[before == feed]}"
        )


@pytest.mark.parametrize(("order", "comment"), FINISHING, ids=[comment for _, comment in FINISHING])
def test_finishing_keeps_its_feed_mark(order: Order, comment: str) -> None:
    """R_t grows with the square of feed per tooth."""
    read = optimised(order)
    before, after = read.rows.f_z[:, read.among(read.section(comment)) & read.rows.in_cut]
    assert len(before) >= 5 and (after <= before * (1 + EXACT)).all()


def test_ramps_and_plunges_get_no_more_per_tooth() -> None:
    rows = optimised(BRACKET).rows
    before, after = rows.f_z[:, rows.in_cut & (rows.drop > 1e-6) & (rows.tool < 4)]
    assert (after <= before * (1 + EXACT)).all()


@ORDERS
def test_f_and_s_are_round_numbers(order: Order) -> None:
    read = optimised(order)
    assert read.changed_words("F") or read.changed_words("S")
    for letter, step in (("F", 10.0), ("S", 50.0)):
        for line, value in read.changed_words(letter):
            assert float(value) % step == 0, f"{line}: {read.after[line - 1]}"


@ORDERS
@pytest.mark.proof
def test_there_is_still_something_to_gain(order: Order) -> None:
    """Limits that leave all as it was would keep every rule above; S is asked for."""
    document = optimised(order, "--speed", "100", "12000").document
    assert document["gain"]["time_percent"] < -5.0 and document["after"]["beyond"] == 0


@ORDERS
def test_no_tool_goes_farther_out_of_the_range_of_the_catalogue(order: Order) -> None:
    """Each tool in each operation; one without a range keeps what it has."""
    tools = optimised(order).document["tools"]
    assert {use["operation"] for use in tools} >= {"slotting"}
    for use in tools:
        for name, span in (
            ("feed_per_tooth_mm", use["feed_per_tooth_range_mm"]),
            ("cutting_speed_m_min", use["cutting_speed_range_m_min"]),
        ):
            before, after = use["before"][name], use["after"][name]
            if use["kept"] is not None or before is None:
                assert after == before, (use["tool"], use["operation"], name)
            elif span is not None:
                assert after <= max(span[1], before) * (1 + 1e-6), (use["tool"], name)


def test_what_chatters_as_programmed_may_stay() -> None:
    """Usual values of a spindle let each slot in steel chatter: the program runs as it is today.

    A subprogram that cuts in one run and is in air in the next has one F, and drills no lobes.
    """
    read = optimised(SLOTS, edit=(SHORT,))
    document, rows = read.document, read.rows
    first = document["warnings"][0]["what"]
    assert first.startswith("T1 in the program as it is: chatter is predicted from")
    after, before = document["after"], document["before"]
    assert after["time_s"] < before["time_s"]
    drilled = rows.in_cut & (rows.tool == 2)
    assert (rows.feed[1, drilled] >= rows.feed[0, drilled]).all() and drilled.any()
    air = rows.in_air
    assert (rows.feed[1, air] <= rows.feed[0, air]).all()


def test_the_least_feed_of_a_short_block_is_that_of_its_word() -> None:
    """A block in the cut that is too short to reach its F keeps to the F of its neighbours."""
    rows = optimised(SLOTS, edit=(SHORT,)).rows
    slot = np.flatnonzero(rows.in_cut & (rows.tool == 1))[:3]
    assert rows.length[slot[1]] < 0.03
    assert rows.feed[1, slot[1]] >= 0.5 * rows.feed[0, slot[1]]
