"""Advice on a program: seconds are those of the program with the change, made by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.moves import Kind, PathMode
from pipeline.twin.control import planned_program
from pipeline.twin.program_advice import program_advice, shorter_order, tour_length
from tests.machine.programs import Writer
from tests.submodels.control.part_programs import truth

PLACES = [(0, 0), (120, 80), (5, 2), (118, 75), (10, 4), (110, 70)]
SHORT = [0, 2, 4, 5, 3, 1]


def drilled(places, *, retract=50.0, begins=2.0, tool_plane=17):
    """Holes one after the other, each from ``begins`` down and back to ``retract``."""
    writer = Writer(origin=(-20, 0, retract, 0, 0, 0)).set(feed=300.0)
    for x, y in places:
        writer.rapid(X=x, Y=y).rapid(Z=begins).to(Z=-5.0).rapid(Z=retract)
    moves = writer.moves
    return replace(moves, plane=np.full(len(moves), tool_plane, np.uint8))


def advice_on(moves, control=None):
    control = control or truth()
    plan = planned_program(moves, control)
    return plan, program_advice(plan)


def only(advice, word):
    (one,) = [one for one in advice if one.what.startswith(word)]
    return one


def test_retracts_above_the_start_of_the_cuts_are_the_same_program_with_lower_ones():
    plan, advice = advice_on(drilled(PLACES))
    one = only(advice, "retract")
    low = Writer(origin=(-20, 0, 50, 0, 0, 0)).set(feed=300.0)
    for number, (x, y) in enumerate(PLACES):  # first approach and last retract stay
        low.rapid(X=x, Y=y).rapid(Z=2.0).to(Z=-5.0)
        low.rapid(Z=50.0 if number == len(PLACES) - 1 else 2.0)
    by_hand = plan.total - planned_program(low.moves, truth()).total
    assert one.seconds == pytest.approx(by_hand, abs=1e-3) and by_hand > 1.0
    assert "5 retracts" in one.what and "48 mm" in one.what and "clamp" in one.assumes


@pytest.mark.parametrize(("begins", "over"), [(2.0, 0), (31.0, 19)])
def test_below_what_another_tool_cut_by_program_coordinates_no_retract_is_lowered(begins, over):
    writer = Writer(origin=(0, 0, 60, 0, 0, 0)).set(feed=3000.0)
    writer.to(Z=30.0).to(X=100.0).rapid(Z=60.0)  # a face at 30 above the holes
    writer.set(tool=2).row(Kind.TOOL_CHANGE).rapid(Z=150.0)
    for x, y in PLACES:  # a tool 100 longer: as high above its zero as the face plus 20
        writer.rapid(X=x, Y=y).rapid(Z=100.0 + begins).to(Z=95.0).rapid(Z=150.0)
    moves = writer.moves
    longer = replace(moves.frames[0], translation=(0, 0, 100, 0, 0, 0))
    of = (moves.tool == 2).astype(np.int32)
    _, advice = advice_on(replace(moves, frames=(moves.frames[0], longer), frame=of))
    said = [one.what for one in advice if one.what.startswith("retract")]
    assert len(said) == bool(over) and all(f"up to {over} mm above" in one for one in said)


@pytest.mark.parametrize("stop", [False, True])
def test_sides_reached_in_rapid_and_a_stop_to_measure_keep_their_retracts(stop):
    writer = Writer(origin=(-20, -20, 50, 0, 0, 0)).set(feed=600.0)
    for y in (0.0, 80.0) * 3:  # at one side of a part, then over it to the other
        writer.rapid(X=-20.0, Y=y).rapid(Z=2.0 if stop else -5.0)
        writer.to(Z=-5.0).to(X=120.0).rapid(Z=50.0)
        if stop:
            writer.row(Kind.STOP)
    assert not [one for one in advice_on(writer.moves)[1] if one.what.startswith("retract")]


def test_holes_are_visited_in_a_shorter_order_with_the_same_holes():
    plan, advice = advice_on(drilled(PLACES, retract=2.0))
    one = only(advice, "visit")
    again = planned_program(drilled([PLACES[i] for i in SHORT], retract=2.0), truth())
    assert one.seconds == pytest.approx(plan.total - again.total, abs=1e-3)
    begins = plan.path.moves.line[::4]
    assert list(one.lines) == [int(begins[i]) for i in SHORT]


def test_what_is_short_already_gets_no_advice():
    _, advice = advice_on(drilled([PLACES[i] for i in SHORT], retract=2.0))
    assert advice == ()


@pytest.mark.parametrize("moves", [
    drilled(PLACES, tool_plane=18),  # a lathe: X is no height
    Writer().moves, Writer().rapid(X=5.0, Z=9.0).moves,
    Writer().set(feed=300.0).rapid(X=9.0).to(Z=-1.0).moves,
])  # fmt: skip
def test_nothing_is_said_where_heights_and_holes_are_not_known(moves):
    assert advice_on(moves)[1] == ()


def test_a_slot_between_holes_is_not_moved():
    writer = Writer(origin=(0, 0, 2, 0, 0, 0)).set(feed=300.0)
    for x, y in PLACES:
        writer.rapid(X=x, Y=y).to(Z=-5.0).to(X=x + 3.0).rapid(Z=2.0)
    assert not [one for one in advice_on(writer.moves)[1] if one.what.startswith("visit")]


def test_exact_stops_cost_what_the_continuous_path_saves():
    def square(mode):
        writer = Writer().set(feed=3000.0, path_mode=mode)
        for _ in range(20):
            for x, y in ((9, 0), (9, 9), (0, 9), (0, 0)):
                writer.to(X=x, Y=y)
        return writer.moves

    plan, advice = advice_on(square(PathMode.EXACT_STOP))
    free = planned_program(square(PathMode.CONTINUOUS), truth()).total
    assert only(advice, "continuous path").seconds == pytest.approx(plan.total - free, abs=1e-3)
    assert advice_on(square(PathMode.CONTINUOUS))[1] == ()


def test_a_tool_that_is_called_twice_costs_its_change():
    writer = Writer().set(feed=3000.0)
    for tool in (1, 2, 1):
        writer.set(tool=tool).row(Kind.TOOL_CHANGE)
        writer.to(X=50.0).to(X=0.0)
    _, advice = advice_on(writer.moves)
    one = only(advice, "one call")
    assert one.seconds == pytest.approx(truth().auxiliary.tool_change, abs=1e-3)
    assert one.what.endswith("1 of the changes call again for T1")


def test_a_wider_tolerance_is_the_same_program_at_twice_of_it():
    control = replace(
        truth(), corner="tolerance", tolerance=0.02, settle_time=0.0, cutting_filter=(0.03, 0.02)
    )
    writer = Writer().set(feed=3000.0)
    for k in range(40):
        writer.to(X=20.0 * k, Y=20.0 * (k % 2))
    moves = writer.moves
    plan, advice = advice_on(moves, control)
    wider = planned_program(moves, replace(control, tolerance=0.04)).total
    assert only(advice, "a path tolerance").seconds == pytest.approx(plan.total - wider, abs=1e-3)


@given(st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=12),
       st.booleans())  # fmt: skip
def test_an_order_is_a_permutation_that_is_never_longer(points, leaves):
    places, begin = np.array(points, float), np.array([-1.0, 3.0])
    leave = np.array([25.0, 25.0]) if leaves else None
    order = shorter_order(places, begin, leave)
    assert sorted(order.tolist()) == list(range(len(points)))
    assert tour_length(places[order], begin, leave) <= tour_length(places, begin, leave) + 1e-9


def test_the_holes_of_a_circle_are_visited_around_it():
    angles = 2 * math.pi * np.random.default_rng(3).permutation(40) / 40
    places = 50 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    order = shorter_order(places, places[0] + 0.1, None)
    shortest = 39 * 2 * 50 * math.sin(math.pi / 40)
    assert tour_length(places[order], places[0], None) == pytest.approx(shortest, rel=0.15)
