"""What to record next: designs whose optimum is known in closed form, and what goes without one."""

from dataclasses import replace

import numpy as np
import pytest

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


def line(half=(0.1, 0.1), **changed):
    """A line measured ten times at -1 and ten times at 1, judged at 0 and at 2."""
    own = {
        "names": ("level", "slope"), "units": ("N", "N/mm"), "half_widths": np.array(half),
        "floors": np.zeros(2), "sizes": np.array([1.0, 1.0]), "rows": at(-1, 1, many=10),
        "judged": at(0, 2), "interval": "force", "unit": "N", "limit": 1.0,
        "candidates": [
            Candidate(record="at the middle", minutes=20.0, rows=at(0, many=20)),
            Candidate(record="at the ends", minutes=20.0, rows=at(-1, 1, many=10)),
            Candidate(record="beyond one end", minutes=20.0, rows=at(1.5, many=2)),
        ],
    }  # fmt: skip
    return Design(**(own | changed))


def test_now_is_what_the_stated_intervals_leave_open():
    # X'X = 20 I: level and slope are independent, and the mean variance is that of 1 + 0 and 1 + 4
    assert line().half_width(np.ones(2, bool)) == pytest.approx(0.1 * np.sqrt((1 + 5) / 2))


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
        half_widths=np.array((0.1, 0.1)) * scale, sizes=scale, rows=at(-1, 1, many=10) / scale,
        judged=at(0, 2) / scale,
        candidates=[replace(c, rows=c.rows / scale) for c in line().candidates],
    )  # fmt: skip
    assert by_design(small) == by_design(line())


def test_what_no_recording_narrows_stays():
    floored = line(half=(0.1, 0.1), floors=np.array([0.08, 0.08]))
    every = np.ones(2, bool)
    assert floored.half_width(every) == pytest.approx(line().half_width(every))
    much = at(-1, 1, many=10**6)
    # 0.08 of both, over judged variances 1 and 5
    assert floored.half_width(every, much) == pytest.approx(0.08 * np.sqrt(3), rel=1e-3)


def test_a_nuisance_of_known_spread_is_not_averaged_out():
    # a common offset of the sensor, standard deviation 3 of a row's, read by every row
    def offset(rows):
        return np.column_stack([rows, np.ones(len(rows))])

    own = line(
        half=(0.1, 0.1, 0.0), names=("level", "slope", "offset"), units=("N", "N/mm", "1"),
        floors=np.zeros(3), sizes=np.ones(3),
        rows=np.vstack([offset(at(-1, 1, many=10)), [(0.0, 0.0, 1 / 3)]]),
        judged=np.pad(at(0), ((0, 0), (0, 1))),
    )  # fmt: skip
    every, more = np.ones(3, bool), offset(at(-1, 1, many=10))
    ratio = own.half_width(every, more) / own.half_width(every)
    assert ratio == pytest.approx(np.sqrt((9 + 1 / 40) / (9 + 1 / 20)), rel=1e-6)


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
    assert by_design(line(candidates=())) == []


def test_the_axis_whose_interval_is_widest_for_its_size_comes_first():
    wide, narrow = line(limit=0.5), line(limit=5.0, interval="other")
    found = next_recordings("a", "b", MODEL, VERDICT, [narrow, wide])
    assert [one.interval for one in found] == ["force"] * 3 + ["other"]
    lost = line(half=(0.1, np.nan), rows=at(0, many=20), noise=0.2, limit=50.0)
    found = next_recordings("a", "b", MODEL, VERDICT, [wide, lost])
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
    remedy, covers, groups = next_recordings("toy", "its signals", MODEL, VERDICT, ())
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
    assert [one.method for one in next_recordings("toy", "x", MODEL, bare, ())] == [REMEDY]
    known = replace(MODEL, parameters={})
    assert next_recordings("toy", "x", known, bare, ()) == ()
