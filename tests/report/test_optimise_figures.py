"""Figures of optimised programs: levels, places and sums are those of the document."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optimise_documents import blocks, group, optimised, part, trace

from pipeline.report.optimised.figures import (
    MOST,
    compared,
    front_figure,
    front_places,
    load_figure,
    pairs_figure,
    path_load,
    per_pair,
    words_figure,
)
from pipeline.report.optimised.verdict import verdict
from pipeline.schema.part import LoadTrace, WordCounts
from pipeline.schema.store import structured

COLUMN = re.compile(r"M(-?\d+) (-?\d+)h10v(-?\d+)h-10z")


def paths(svg: str, kind: str) -> list[str]:
    """Data of the paths of one class."""
    return re.findall(rf'<path d="([^"]*)" class="{kind}"', svg)


@given(st.lists(st.one_of(st.none(), st.floats(0, 500)), min_size=1, max_size=2000))
def test_no_peak_of_the_load_is_lost_in_columns(load):
    many = len(load)
    made = {"total_mm": 3.0 * many, "way_mm": [3.0 * k for k in range(many)], "load_N": load,
            "line": list(range(many))}  # fmt: skip
    found = path_load(structured(made, LoadTrace, "trace"))
    known = [v for v in load if v is not None]
    if not known:
        assert found is None
        return
    assert len(found.load) == min(many, MOST)
    assert np.nanmax(found.load) == max(known)
    width = many / len(found.load)
    for k in np.flatnonzero(np.isfinite(found.load)).tolist():
        inside = [v for i, v in enumerate(load) if v is not None and int((i + 1e-6) / width) == k]
        assert found.load[k] == max(inside)


def test_what_lies_above_the_limit_is_drawn_above_it_and_nothing_else():
    made = (trace(90, level) for level in (66.0, 55.0))
    before, after = (path_load(structured(one, LoadTrace, "trace")) for one in made)
    drawn = str(load_figure(before, after, 60.0, [], "x"))
    upper, lower = paths(drawn, "s-over")
    assert len(COLUMN.findall(upper)) == int((before.load > 60).sum()) > 0
    assert COLUMN.findall(lower) == []
    most = 1.1 * max(np.nanmax(before.load), 60.0)
    for _, top, height in COLUMN.findall(upper):
        assert int(top) + int(height) == pytest.approx(1000 * (1 - 60 / most), abs=1)


def test_each_group_has_its_level_of_f_and_s_over_its_place():
    rows = [group(k) for k in range(4)]
    drawn = str(words_figure(blocks(rows), "x"))
    feeds, speeds = paths(drawn, "curve after")
    for data, values in ((feeds, [r["feed_after"] for r in rows]),
                         (speeds, [r["speed_after"] for r in rows])):  # fmt: skip
        most = 1.1 * max(values)  # all are above those as programmed
        steps = np.array([int(n) for n in re.findall(r"-?\d+", data)]).reshape(-1, 2).cumsum(axis=0)
        for k, value in enumerate(values):
            level = 1000 * (1 - value / most)
            inside = [y for x, y in steps.tolist() if x in (250 * k, 250 * (k + 1))]
            assert any(abs(y - level) <= 1 for y in inside)
    assert steps[0, 0] == 0 and steps[-1, 0] == 1000


def test_feeds_of_a_turn_have_a_panel_of_their_own():
    rows = [group(0), group(1) | {"feed_unit": "mm/rev", "feed_before": 0.1, "feed_after": 0.2}]
    drawn = str(words_figure(blocks(rows), "x"))
    assert "F, mm/min" in drawn and "F, mm/rev" in drawn
    assert "F, mm/rev" not in str(words_figure(blocks(rows[:1]), "x"))


def test_lanes_mark_the_groups_that_a_limit_binds():
    rows = [group(k) for k in range(8)]  # load, torque, chip, nothing, twice
    drawn = str(words_figure(blocks(rows), "x"))
    lanes = paths(drawn, "s-after")
    marks = [re.findall(r"M(\d+) 0h(\d+)", lane) for lane in lanes]
    assert sorted(marks) == [[("0", "125"), ("500", "125")], [("125", "125"), ("625", "125")],
                             [("250", "125"), ("750", "125")]]  # fmt: skip
    for name in ("Load limit binds", "Spindle torque binds", "Greatest chip binds"):
        assert name in drawn


@given(st.integers(1, 500))
def test_pairs_of_columns_hold_the_whole_time(groups):
    rows = [group(k) for k in range(groups)]
    drawn = str(pairs_figure(blocks(rows), [("Time, s", "time_{}_s")], "x"))
    before, after = (COLUMN.findall(paths(drawn, f"s-{which}")[0]) for which in ("before", "after"))
    assert len(before) == len(after) == -(-groups // per_pair(groups)) <= 60
    sums = np.add.reduceat(
        [r["time_before_s"] for r in rows], np.arange(0, groups, per_pair(groups))
    )
    heights = np.array([int(h) for *_, h in before])
    others = np.add.reduceat(
        [r["time_after_s"] for r in rows], np.arange(0, groups, per_pair(groups))
    )
    most = 1.08 * max(sums.max(), others.max())
    assert heights == pytest.approx(1000 * sums / most, abs=1)  # to a unit of the viewport


def test_a_pair_without_any_number_is_no_figure():
    rows = [{**group(0), "time_before_s": None, "time_after_s": None}]
    assert pairs_figure(blocks(rows), [("Time, s", "time_{}_s")], "x") is None


def test_the_front_is_drawn_in_the_two_quantities_that_differ():
    document = optimised(members=5)
    assert compared(part(document)) == ("time_s", "cost")
    for row in document["front"]:
        row["cost"] = None
    assert compared(part(document)) == ("time_s", "tool_life_share")
    for k, row in enumerate(document["front"]):  # cost follows time, energy runs against it
        row |= {"cost": 2 * row["time_s"], "energy_kWh": (7 * k) % 5, "tool_life_share": -k}
    assert compared(part(document)) == ("time_s", "tool_life_share")
    assert compared(part(document | {"front": []})) is None


def test_only_members_that_none_beats_in_both_are_joined():
    document = optimised(members=6)
    document["front"][2]["cost"] += 30.0  # beaten in these two by its neighbour, not in a third
    drawn = str(front_figure(front_places(part(document), ("time_s", "cost")), ("x", "y"), "x"))
    (line,) = paths(drawn, "curve front")
    assert len(re.findall(r"-?\d+ -?\d+", line)) == 5 and drawn.count("<circle") == 8


def test_every_member_of_the_front_is_a_point_and_the_knee_is_marked_once():
    document = optimised(members=12)
    places = front_places(part(document), ("time_s", "cost"))
    kinds = [p.kind for p in places]
    assert (kinds.count("p-front"), kinds.count("p-knee"), kinds.count("p-after")) == (12, 1, 1)
    drawn = str(front_figure(places, ("Time, s", "Cost"), "x"))
    assert drawn.count("<circle") == 14
    places_x = [float(v) for v in re.findall(r'cx="([\d.]+)%"', drawn)]
    assert min(places_x) > 0 and max(places_x) < 100


@given(st.fixed_dictionaries({
    key: st.integers(0, 10**6) for key in ("F_changed", "F_added", "S_changed", "S_added")
}))  # fmt: skip
def test_words_are_counted_as_they_are(counts):
    assert structured(counts, WordCounts, "words").total == sum(counts.values())


@given(st.floats(-99, 99), st.sampled_from(["time", "cost", "energy", "wear", "pareto"]))
def test_only_what_is_less_is_a_gain(change, objective):
    gain = dict.fromkeys(
        ("time_percent", "cost_percent", "energy_percent", "tool_life_percent"), change
    )
    document = optimised() | {"gain": gain, "objective": objective}
    status, word, _ = verdict(part(document | {"before": {**document["before"], "beyond": 0}}))
    assert status == ("passed" if change <= -0.05 else "unknown")
    assert ("%" in word) == (change <= -0.05)
