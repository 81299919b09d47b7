"""A Fanuc's canned cycles as the moves that they are."""

import pytest

from pipeline.gcode.moves import FeedMode, Kind
from tests.gcode.following import follow, kinds, points, refusal

HEAD = "F100 M3 S500 G0 Z10\n"


def heights(text: str, **choices) -> list[float]:
    """Z where it changes or the tool moves, after the head."""
    return [point[2] for point in points(follow(HEAD + text, **choices))[1:]]


def path(text: str, **choices) -> list[list[float]]:
    return points(follow(HEAD + text, **choices))[1:]


def test_g81_drills_and_returns_to_the_initial_level():
    assert path("G98 G81 X1 Y2 Z-5 R2\nX3\nG80") == [
        [1, 2, 10], [1, 2, 2], [1, 2, -5], [1, 2, 10],
        [3, 2, 10], [3, 2, 2], [3, 2, -5], [3, 2, 10],
    ]  # fmt: skip


def test_g99_returns_to_r_and_the_next_hole_starts_there():
    assert path("G99 G81 X1 Z-5 R2\nX3") == [
        [1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 2], [3, 0, 2], [3, 0, -5], [3, 0, 2],
    ]  # fmt: skip


def test_g98_after_g99_goes_up_to_where_the_cycle_began():
    assert heights("G99 G81 X1 Z-5 R2\nG98 X3\nG80 X4")[-3:] == [-5, 10, 10]


def test_g91_counts_r_from_the_start_and_z_from_r():
    assert path("G91 G99 G81 X1 Z-7 R-8 K2")[:3] == [[1, 0, 10], [1, 0, 2], [1, 0, -5]]
    assert path("G91 G99 G81 X1 Z-7 R-8 K2")[-1] == [2, 0, 2]


def test_k0_drills_nothing_but_keeps_the_words():
    assert path("G81 Z-5 R2 K0\nX1") == [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 10]]


def test_a_block_without_position_drills_nothing():
    assert path("G81 X1 Z-5 R2\nM8\nF50") == path("G81 X1 Z-5 R2")


def test_words_stay_in_force_from_cycle_to_cycle():
    assert heights("G99 G83 X1 Z-5 R2 Q5\nG81 X2")[-3:] == [2, -5, 2]


def test_g80_and_g0_end_a_cycle_and_the_old_motion_returns():
    assert path("G81 X1 Z-5 R2\nG80\nX2 Z9")[-1] == [2, 0, 9]
    assert kinds(follow(HEAD + "G1 X1\nG81 X1 Z-5 R2\nG80\nX2"))[-1] == "FEED"
    assert kinds(follow(HEAD + "G81 X1 Z-5 R2\nG0 X2"))[-1] == "RAPID"


def test_g82_dwells_in_milliseconds():
    moves = follow(HEAD + "G82 X1 Z-5 R2 P500")
    assert moves.value[moves.kind == Kind.DWELL].tolist() == [0.5]


def test_g83_comes_out_to_r_after_each_peck():
    assert heights("G99 G83 X1 Z-5 R2 Q3", peck_clearance=0.5) == [
        10, 2, -1, 2, -0.5, -4, 2, -3.5, -5, 2,
    ]  # fmt: skip


def test_g73_only_breaks_the_chip():
    assert heights("G99 G73 X1 Z-5 R2 Q3", peck_clearance=0.5) == [
        10, 2, -1, -0.5, -4, -3.5, -5, 2,
    ]  # fmt: skip


def test_the_last_peck_ends_at_the_bottom_though_steps_do_not_add_up():
    assert min(heights("G99 G83 X1 Z-0.3 R0 Q0.1")) == pytest.approx(-0.3, abs=1e-12)
    assert heights("G99 G83 X1 Z-0.3 R0 Q0.1").count(-0.3) == 1


@pytest.mark.parametrize(("code", "turns"), [("G84", [-1, 1]), ("G74", [1, -1])])
def test_tapping_turns_back_at_the_bottom(code, turns):
    moves = follow(HEAD + f"M{3 if code == 'G84' else 4}\nG99 {code} X1 Z-5 R2 P100")
    spindle = moves.direction[moves.kind == Kind.SPINDLE]
    assert spindle[-2:].tolist() == turns
    assert kinds(moves)[-5:] == ["FEED", "DWELL", "SPINDLE", "FEED", "SPINDLE"]


def test_rigid_tapping_is_bound_to_the_spindle():
    moves = follow(HEAD + "M29 S500\nG99 G84 X1 Z-5 R2 F625\nG80 G1 X5")
    thread = moves.kind == Kind.THREAD
    assert thread.sum() == 2
    assert (moves.feed[thread] == 1.25).all()
    assert (moves.feed_mode[thread] == FeedMode.PER_REVOLUTION).all()
    assert moves.feed[-1] == 625


def test_g85_feeds_out_and_g86_stops_the_spindle():
    assert kinds(follow(HEAD + "G99 G85 X1 Z-5 R2"))[-2:] == ["FEED", "FEED"]
    moves = follow(HEAD + "G99 G86 X1 Z-5 R2")
    assert kinds(moves)[-4:] == ["FEED", "SPINDLE", "RAPID", "SPINDLE"]
    assert moves.direction[-3:].tolist() == [0, 0, 1]


def test_g76_leaves_the_wall_before_it_comes_out():
    found = path("G99 G76 X5 Z-5 R2 Q0.5", boring_shift="+X")
    assert found[2:] == [[5, 0, -5], [5.5, 0, -5], [5.5, 0, 2], [5, 0, 2]]


def test_g87_bores_from_below():
    found = path("G98 G87 X5 Z-3 R-8 Q0.5", boring_shift="-Y")
    assert found == [
        [5, 0, 10], [5, -0.5, 10], [5, -0.5, -8], [5, 0, -8], [5, 0, -3], [5, -0.5, -3],
        [5, -0.5, 10], [5, 0, 10],
    ]  # fmt: skip


def test_g88_stops_and_g89_dwells_and_feeds_out():
    assert "STOP" in kinds(follow(HEAD + "G88 X1 Z-5 R2 P100"))
    assert kinds(follow(HEAD + "G99 G89 X1 Z-5 R2 P100"))[-3:] == ["FEED", "DWELL", "FEED"]


def test_all_rows_of_a_cycle_bear_its_line():
    moves = follow(HEAD + "G83 X1 Z-5 R2 Q1")
    assert set(moves.line[moves.line > 1]) == {2}


def test_cycles_follow_the_plane():
    moves = follow("F100 G18 G0 Y10\nG99 G81 X1 Z2 Y-5 R2")
    assert points(moves)[-3:] == [[1, 2, 2], [1, -5, 2], [1, 2, 2]]


def test_cycles_turn_with_g68():
    assert path("G68 X0 Y0 R90\nG99 G81 X3 Z-5 R2")[-1] == [0, 3, 2]


@pytest.mark.parametrize(("text", "words"), [
    ("G81 X1 Z-5", "begins without R"),
    ("G81 X1 R5", "begins without Z"),
    ("G83 X1 Z-5 R2", "add Q"),
    ("G81 X1 Z5 R2", "exchange"),
    ("G81 X1 Z-5 R2 K1.5", "whole number"),
])  # fmt: skip
def test_what_is_missing_is_said(text, words):
    assert words in refusal(HEAD + text)


@pytest.mark.parametrize("code", ["G83", "G73"])
def test_q_without_a_point_that_is_deeper_than_the_hole_is_asked_about(code):
    text = HEAD + f"G99 {code} X1 Z-10 R2 Q5000 F100\nG80"
    assert "setup.peck_increments" in refusal(text)
    assert follow(text, peck_increments=True).end.tolist() == (
        follow(text.replace("Q5000", "Q5."), peck_increments=True).end.tolist()
    )
    assert heights(text, peck_increments=False) == heights(text.replace("Q5000", "Q12."))
    # as deep as the hole it is asked about no more, and in inches increments are of 0.0001 inch
    assert heights(text.replace("Q5000", "Q12")) == heights(text.replace("Q5000", "Q12."))
    inch = "G20\n" + text.replace("Q5000", "Q50000")
    assert heights(inch, peck_increments=True) == heights(inch.replace("Q50000", "Q5."))


@pytest.mark.parametrize("code", ["G76", "G87"])
def test_a_shift_without_a_point_that_is_wider_than_the_hole_is_deep_is_asked_about(code):
    z, r = (-10, 2) if code == "G76" else (2, -10)
    text = HEAD + f"M3 S100\nG99 {code} X1 Z{z} R{r} Q200 F100\nG80"
    assert "setup.peck_increments" in refusal(text)
    point = text.replace("Q200", "Q0.2")
    assert follow(text, peck_increments=True).end.tolist() == follow(point).end.tolist()


def test_pecks_that_get_smaller_are_refused_by_name():
    assert "I J K of a Haas" in refusal(HEAD + "G83 X1 Z-10 R2 I4 J1 K2 F100")


def test_rigid_tapping_starts_the_spindle_itself():
    moves = follow(HEAD + "M5\nM29 S100\nG95 G84 X1 Z-5 R2 F1.5\nG80")
    assert moves.direction[moves.kind == Kind.THREAD].tolist() == [1, -1]
    assert "the spindle stands" in refusal(HEAD + "M5\nG95 G81 X1 Z-5 R2 F1.5 S100")
