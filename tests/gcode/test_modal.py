"""The table of modal groups, and what it says of codes in one block."""

import pytest

from pipeline.gcode.codes.execution import HANDLERS
from pipeline.gcode.modal import GROUPS, M_STEPS, ONE_SHOT, WORD_STEPS, excludes, g_code, step_of
from tests.gcode.following import follow, kinds, points, refusal


def test_every_code_belongs_to_one_group():
    codes = [code for group in GROUPS.values() for code in group.codes]
    assert len(codes) == len(set(codes))


def test_defaults_are_of_their_groups():
    assert all(group.default in group.codes for group in GROUPS.values())


def test_every_known_code_has_someone_who_carries_it_out():
    known = {code for group in GROUPS.values() for code in group.codes} | ONE_SHOT.keys()
    assert known - HANDLERS.keys() == set()


@pytest.mark.parametrize("dialect", M_STEPS)
def test_what_starts_comes_before_the_motion_and_what_ends_after(dialect):
    motion, steps = GROUPS["motion"].step, M_STEPS[dialect]
    assert WORD_STEPS["F"] < WORD_STEPS["S"] < steps[3] < motion < steps[30]


def test_exclusion_is_symmetric():
    codes = [code for group in GROUPS.values() for code in group.codes] + list(ONE_SHOT)
    assert all(excludes(a, b) == excludes(b, a) for a in codes for b in codes)


def test_codes_are_shown_as_written():
    assert [g_code(code) for code in (0, 10, 541, 901)] == ["G0", "G1", "G54.1", "G90.1"]


def test_codes_of_other_dialects_are_not_known():
    assert step_of(680, "fanuc") and step_of(680, "linuxcnc") is None
    assert step_of(911, "linuxcnc") and step_of(50, "linuxcnc") is None
    assert "G68 is not known in the dialect linuxcnc" in refusal("G68 R1", dialect="linuxcnc")


def test_on_a_fanuc_the_last_of_a_group_counts():
    assert kinds(follow("F9 G0 G1 X1")) == ["FEED"]
    assert kinds(follow("F9 G1 G0 X1")) == ["RAPID"]
    assert points(follow("G90 G91 G0 X1\nX1")) == [[1, 0, 0], [2, 0, 0]]


def test_of_a_word_twice_the_last_counts_on_a_fanuc():
    assert points(follow("G0 X1 X2")) == [[2, 0, 0]]
    assert "stands twice" in refusal("G0 X1 X2", dialect="linuxcnc")


@pytest.mark.parametrize(
    "text", ["G0 G1", "G17 G18", "G20 G21", "G40 G41", "G54 G55", "G28 X1 G0", "M3 M5", "M0 M30"]
)
def test_codes_of_one_group_exclude_each_other_in_linuxcnc(text):
    assert "exclude each other" in refusal(text, dialect="linuxcnc")
