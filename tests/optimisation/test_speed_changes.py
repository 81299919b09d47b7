"""Where S may change: between cuts, early enough for the spindle, and nowhere else."""

import numpy as np
import pytest

from pipeline.machine.spindle import run_up_time
from pipeline.optimisation.direct.direct import direct
from pipeline.optimisation.direct.speed_pieces import speed_pieces
from pipeline.optimisation.settings import CutLimit, Grouping
from tests.optimisation.direct_parts import control, problem, slots

GROUPING = Grouping(least_gain=0.0)
RATE, BASE = 4000.0, 3000.0


LIMITS = CutLimit(load_N=60.0, feed_mm_min=(50, 600), speed_rpm=(1000, 12000))
TEXT = slots(0.5, 2.0, 1.0).replace("G1 X280 F200", "G1 X100 F200\nG1 X280", 1)


def of_slots(**auxiliary):
    machine = control(spindle_acceleration=RATE, spindle_base_speed=BASE, **auxiliary)
    return problem(TEXT, LIMITS, machine=machine)


def test_a_word_is_added_at_the_first_line_after_a_cut_and_before_another():
    part = of_slots()
    pieces = speed_pieces(part.cut.plan, part.editable, part.cuts, GROUPING)
    cuts_of_piece = np.bincount(pieces.piece[part.cuts], minlength=len(pieces))
    assert len(pieces) > 1
    assert (cuts_of_piece > 0).all()
    for one in range(1, len(pieces)):
        first = int(np.argmax(pieces.piece == one))
        moving = np.flatnonzero(part.cut.plan.path.moving[:first])
        assert part.cuts[moving[-1]], "the way before the word cuts nothing"


def test_ways_in_air_keep_the_speed_of_a_cut_beside_them():
    part = of_slots()
    speed = direct(part, "cost", GROUPING).row_speeds
    moves = part.cut.plan.path.moves
    cut_at = set(speed[part.cuts].tolist())
    assert set(speed[moves.direction != 0].tolist()) <= cut_at


@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["rise", "fall"])
def test_a_change_that_the_spindle_is_too_slow_for_is_beyond_the_limits(sign):
    part = of_slots()
    plan = part.cut.plan
    row = int(np.flatnonzero(part.cuts)[1])  # a cut after a cut: no time in between
    low = plan.path.moves.speed
    changed = low.copy()
    changed[row:] += sign * 1000.0
    violation = part.speed_changes.violation(np.stack([low, changed]), 0.0)
    lead = part.speed_changes.lead[part.speed_changes.pairs[:, 1] == row]
    needed = abs(run_up_time(changed[row], RATE, BASE) - run_up_time(low[row], RATE, BASE))
    assert lead.item() < needed
    assert violation.tolist() == pytest.approx([0.0, 1 - lead.item() / needed], abs=1e-9)
    found = part.evaluate_rows(plan.path.moves.feed[None], changed[None])
    assert found.violation.item() >= violation[1] > 0


def test_a_control_that_waits_has_time_for_any_change():
    part = of_slots(speed_change_waits=True)
    moves = part.cut.plan.path.moves
    changed = moves.speed.copy()
    changed[int(np.flatnonzero(part.cuts)[1]) :] += 1000.0
    assert part.speed_changes.violation(changed[None], 0.0).item() == 0.0
