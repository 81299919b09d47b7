"""What to record next: designs whose optimum is known in closed form, and what goes without one."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.charts.judged import gain_words
from pipeline.schema.model import Condition, Model, Parameter, Training
from pipeline.schema.verdict import Fact, JudgedCase, OutsideConditions, Score, Verdict
from pipeline.submodels.next_recording import (
    COVERS,
    DETERMINES,
    GROUPS,
    OPTIMAL,
    PRIOR,
    REMEDY,
    Candidate,
    Design,
    by_design,
    next_recordings,
)
from pipeline.submodels.statistics import NORMAL_95, student_quantile


def at(*places, many=1):
    """Rows of a straight line at some places, each ``many`` times."""
    return np.repeat([(1.0, x) for x in places], many, axis=0)


def told(*rows):
    """Information of some rows."""
    return np.vstack(rows).T @ np.vstack(rows)


ENDS = at(-1, 1, many=10)
CANDIDATES = {
    "at the middle": at(0, many=20), "at the ends": ENDS,
    "beyond one end": at(1.5, many=2),
}  # fmt: skip


def line(half=(0.1, 0.1), rows=ENDS, candidates=CANDIDATES, **changed):
    """A line measured ten times at -1 and ten times at 1, judged at 0 and at 2."""
    own = {
        "names": ("level", "slope"), "units": ("N", "N/mm"), "half_widths": np.array(half),
        "floors": np.zeros(2), "sizes": np.array([1.0, 1.0]), "information": told(rows),
        "judged": at(0, 2), "interval": "force", "unit": "N", "limit": 1.0, "independent": 1000,
        "candidates": [
            Candidate(record=words, information=told(rows, more))
            for words, more in candidates.items()
        ],
    }  # fmt: skip
    return Design(**(own | changed))


def test_now_is_what_the_stated_intervals_leave_open():
    # X'X = 20 I: level and slope are independent, and the mean variance is that of 1 + 0 and 1 + 4
    assert line().half_width() == pytest.approx(0.1 * np.sqrt((1 + 5) / 2))


def test_the_best_of_a_line_is_measured_at_its_ends_and_gains_as_known():
    best, *others = by_design(line())
    assert best.record == "at the ends"
    assert best.method == OPTIMAL
    # twice the information in every direction
    assert best.expected == pytest.approx(best.now / np.sqrt(2), rel=0.01)
    assert best.gain_percent == pytest.approx(29.3, abs=0.1)
    middle = next(one for one in others if one.record == "at the middle")
    # the level alone: variances 1/40 and 1/20 against 1/20 each
    known = np.sqrt((1 / 2 + (1 / 2 + 4)) / (1 + 5))
    assert middle.gain_percent == pytest.approx(100 * (1 - known), abs=0.1)
    gains = [one.gain_percent for one in (best, *others)]
    assert gains == sorted(gains, reverse=True)


def test_units_of_the_parameters_do_not_matter():
    scale = np.array([1e6, 1e-6])
    small = line(
        np.array((0.1, 0.1)) * scale, at(-1, 1, many=10) / scale,
        {words: rows / scale for words, rows in CANDIDATES.items()}, sizes=scale,
        judged=at(0, 2) / scale,
    )  # fmt: skip
    assert by_design(small) == by_design(line())


def test_what_no_recording_narrows_stays():
    floored = line(half=(0.1, 0.1), floors=np.array([0.08, 0.08]))
    assert floored.half_width() == pytest.approx(line().half_width())
    much = told(at(-1, 1, many=10**6))
    # 0.08 of both, over judged variances 1 and 5
    assert floored.half_width(much) == pytest.approx(0.08 * np.sqrt(3), rel=1e-3)


def test_a_gain_below_what_chance_does_is_not_promised():
    # 29.3 % at the ends; an interval from n units varies by 1 / sqrt(2 (n - 1))
    seen, lost = by_design(line(independent=8)), by_design(line(independent=6))
    assert (seen[0].uncertain_percent, lost[0].uncertain_percent) == (26.7, 31.6)
    assert seen[0].noticed and seen[0].proposal == "at the ends"
    (best,) = lost
    assert best.gain_percent == seen[0].gain_percent and best.expected == seen[0].expected
    assert best.proposal == (
        "no recording of 20 minutes narrows it noticeably; the best would be: at the ends"
    )
    assert "(29.3 %, it varies by chance by 31.6 %)" in gain_words(best)


def test_what_determines_a_lost_parameter_comes_first():
    lost = line(half=(0.1, np.nan), rows=at(0, 0, many=10), noise=0.2)
    best = by_design(lost)[0]
    assert (best.record, best.method, best.interval) == ("at the ends", DETERMINES, "slope")
    assert (best.now, best.gain_percent) == (None, None)
    # 20 rows at places of unit square, and the prior
    variance = 0.2**2 / (20 + (0.2 / PRIOR) ** 2)
    assert best.expected == pytest.approx(NORMAL_95 * np.sqrt(variance), rel=0.01)
    # none of them can: the known level is narrowed
    middle = replace(lost, candidates=lost.candidates[:1])
    assert [one.interval for one in by_design(middle)] == ["force"]


def test_nothing_known_gives_nothing():
    assert by_design(line(half=(np.nan, np.nan))) == []
    assert by_design(line(judged=np.zeros((0, 2)))) == []
    assert by_design(line(candidates={})) == []


def test_the_axis_whose_interval_is_widest_for_its_size_comes_first():
    wide, narrow = line(limit=0.5), line(limit=5.0, interval="other")
    found = next_recordings("a", MODEL, VERDICT, [narrow, wide])
    assert [one.interval for one in found] == ["force"] * 3 + ["other"]
    lost = line(half=(0.1, np.nan), rows=at(0, many=20), noise=0.2, limit=50.0)
    found = next_recordings("a", MODEL, VERDICT, [wide, lost])
    assert found[0].interval == "slope"


MODEL = Model(
    submodel="toy", machine="mill", origin="simulated",
    parameters={"X": {
        "mass": Parameter(
            value=1.0, unit="kg", interval_95=(0.9, 1.1), determined=True, method="fit"
        ),
        "play": Parameter(
            value=None, unit="m", interval_95=None, determined=False, method="no reversal",
            remedy="record reversals",
        ),
    }},
    trained_on=tuple(Training(case=name, group=name) for name in "abcd"),
    conditions={"speed": Condition(unit="mm/s", low=10.0, high=20.0)},
)  # fmt: skip


def score(group, rmse, **more):
    return Score(
        quantity="force", unit="N", group=group, regime="", role="golden", n=10, rmse=rmse,
        limits={"rmse": 5.0}, status="passed", **more,
    )  # fmt: skip


VERDICT = Verdict(
    submodel="toy", machine="mill", origin="simulated", status="passed", reasons=(),
    judged_role="golden", golden=None,
    scores=(score("e", 1.0), score("f", 2.0), score("all", 1.5, half_width=3.0)),
    outside=(OutsideConditions(
        case="f", condition="speed", value=30.0, unit="mm/s", learnt="10 to 20"
    ),),
    cases=tuple(
        JudgedCase(
            case=name, group=name, role="golden",
            conditions={"speed": Fact(value=speed, unit="mm/s")},
        )
        for name, speed in (("e", 15.0), ("f", 30.0))
    ),
)  # fmt: skip


def test_without_a_design_remedy_conditions_and_groups_speak():
    remedy, covers, groups = next_recordings("toy", MODEL, VERDICT, ())
    assert (remedy.record, remedy.interval, remedy.method) == ("record reversals", "X play", REMEDY)
    assert remedy.now is None
    # of the two cases one is a width of the learnt range beyond it: factors 1 and 2
    assert covers.method == COVERS
    assert covers.record.startswith("speed at 30 mm/s")
    assert (covers.now, covers.expected) == (3.0, 2.0)
    spread = float(np.std([1.0, 2.0], ddof=1))
    assert groups.method == GROUPS
    assert groups.record.startswith("one more like f (speed 30 mm/s)")
    assert groups.now == pytest.approx(student_quantile(3) * spread / 2, rel=0.01)
    assert groups.expected == pytest.approx(student_quantile(4) * spread / 5**0.5, rel=0.01)


def test_without_a_verdict_on_anything_the_remedy_stands_alone():
    bare = replace(VERDICT, scores=(), outside=(), cases=(), judged_role=None)
    assert [one.method for one in next_recordings("toy", MODEL, bare, ())] == [REMEDY]
    known = replace(MODEL, parameters={})
    assert next_recordings("toy", known, bare, ()) == ()
