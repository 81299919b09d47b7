"""The page of an optimised program: each figure and table of its document, all text escaped."""

import re
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optimise_documents import HASHES, blocks, change, group, optimised, part, trace

from pipeline.report.optimised import figures
from pipeline.report.optimised.changes import feeds_table, increases, listing
from pipeline.report.optimised.page import write_optimised_page
from pipeline.report.optimised.path import SCRIPT
from pipeline.report.optimised.tables import methods_table
from pipeline.report.optimised.verdict import verdict
from pipeline.schema.part import LoadTrace, WordCounts
from pipeline.schema.store import structured
from tests.report.page_reader import outline, words

KEPT = {**optimised()["before"], "beyond": 0}
NAME = 'SLOT <script>"&'


def page(tmp_path: Path, document: dict) -> Path:
    out = tmp_path / "optimised.html"
    write_optimised_page(part(document), out)
    return out


def said(tmp_path: Path, document: dict) -> str:
    """The page's text with plain blanks."""
    text = words(page(tmp_path, document))
    return text.replace("\u202f", " ").replace("\xa0", " ").replace("\u2212", "-")


def test_the_page_has_every_figure_and_table(tmp_path):
    tags = outline(page(tmp_path, optimised())).tags
    labels = [a["aria-label"] for tag, a in tags if tag == "svg" and "aria-label" in a]
    for word in ("From above: Path of SLOT as programmed", "From the front: Path of SLOT optimised",
                 "Load along the path", "F and S of the blocks", "Time and cost of the blocks",
                 "The front in two", "The front and other"):  # fmt: skip
        assert any(label.startswith(word) for label in labels), word
    text = said(tmp_path, optimised())
    for word in ("Before and after", "What holds the program back", "F and S of 24 groups",
                 "Uncertain quantities", "What other ways find", "The front: 30 programs",
                 "Proof", "Limits", "Threads keep their feed", "3 moves, the first in SLOT.nc:9",
                 "Stability: not known", *HASHES):  # fmt: skip
        assert word in text, word


def test_the_summary_says_what_a_process_engineer_asks(tmp_path):
    text = said(tmp_path, optimised())
    for word in ("36 % less cost", "24.51 s instead of 29.48 s (-16.9 %)",
                 "costs 76.40 KRW instead of 120.1 (-36.4 %)",
                 "No block passes a limit; as programmed 3 did (load, stability).",
                 "The highest predicted load is 57.9 N of 60 N.",
                 "in 0.71 % of parts (0.30 % to 1.4 %), 1 % is allowed",
                 "being that sure costs 2.9 % of time",
                 "What holds it back longest is the load limit, as surely as asked, in 9 blocks.",
                 "Only F and S words changed: 26 words", "Not known: stability."):  # fmt: skip
        assert word in text, word


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"objective": "time"}, "17 % less time"),
        ({"objective": "wear"}, "28 % less wear"),
        ({"gain": {"cost_percent": -0.01}, "before": KEPT}, "nothing gained"),
        ({"gain": {"cost_percent": 2.0}, "before": KEPT}, "nothing gained"),
        ({"gain": {"cost_percent": 2.0}}, "inside its limits"),
        ({"interrupted": True}, "interrupted"),
        ({"after": {**optimised()["after"], "beyond": 2}}, "beyond its limits"),
        ({"proof": {**optimised()["proof"], "same": False, "first": "line 9"}}, "not proved"),
    ],
)
def test_the_verdict_follows_what_was_found(tmp_path, change, word):
    out = outline(page(tmp_path, optimised() | change))
    text = " ".join(out.text).replace("\u202f", " ")
    assert (
        word in text.split("The part takes")[0].split("It was")[0].split("The program written")[0]
    )


def test_a_failed_proof_is_said_before_any_gain_and_claims_nothing(tmp_path):
    proof = {**optimised()["proof"], "same": False, "first": "line 9: X moved"}
    text = said(tmp_path, optimised() | {"proof": proof})
    assert text.index("do not cut it") < text.index("The part takes")
    assert "line 9: X moved" in text and "words changed" not in text
    assert "every other byte" not in text


def test_its_one_script_is_named_by_its_hash_and_names_are_escaped(tmp_path):
    out = page(tmp_path, optimised(name=NAME))
    text = out.read_text()
    scripts = re.findall("<script>(.*?)</script>", text, re.DOTALL)
    assert scripts == [str(SCRIPT)] and text.count("<script") == 1 and NAME in words(out)
    digest = b64encode(sha256(scripts[0].encode()).digest()).decode()
    policy = f"style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'\""
    assert f"default-src 'none'; {policy}" in text
    tags = outline(out).tags
    assert not any("src" in a or a.get("href", "").startswith("http") for _, a in tags)


def test_only_simulated_records_are_labelled_simulated(tmp_path):
    labels = [a.get("class") for _, a in outline(page(tmp_path, optimised())).tags]
    assert labels.count("label simulated") > 8  # the head, each figure, each table
    other = outline(page(tmp_path, optimised() | {"origin": "recorded"})).tags
    assert not any(a.get("class") == "label simulated" for _, a in other)


def test_a_page_without_a_path_runs_no_script(tmp_path):
    text = page(tmp_path, optimised() | {"path": None}).read_text()
    assert "<script" not in text and "script-src" not in text and "runs no script" in text


def test_increases_come_first_the_largest_first_and_no_decrease_among_them(tmp_path):
    found = increases(part(optimised()).changes)
    assert [round(row.factor, 6) for row in found] == [2.5, 1.5, 1.1]
    assert [row.change.feed_after for row in found] == [500.0, 300.0, 220.0]
    said_lines = [line for row in found for line in row.lines.split(" and ")[0].split(", ")]
    assert "11–12" in said_lines and "5–6" not in said_lines  # F 500, and F 100
    text = said(tmp_path, optimised())
    table = text[text.index("Largest increases") :]
    assert table.index("× 2.50") < table.index("× 1.50") < table.index("× 1.10")
    assert "200 → 500" in table and "0.0400 → 0.100" in table


def test_in_air_f_alone_counts_as_an_increase():
    air = change(2) | {"feed_per_tooth_before_mm": None, "feed_per_tooth_after_mm": None}
    slower = air | {"feed_before": 3000.0, "feed_after": 2660.0, "speed_after": 3750.0}
    faster = change(3) | {"feed_before": 200.0, "feed_after": 200.0, "speed_after": 3000.0,
                          "feed_per_tooth_after_mm": 0.0333}  # fmt: skip
    found = increases(part(optimised() | {"changes": [slower, air, faster]}).changes)
    assert [(row.what, round(row.factor, 3)) for row in found] == [("F", 1.5), ("S", 1.2)]


def test_long_sources_are_numbered_and_listed_once(tmp_path):
    document, long = optimised(), "A maker’s catalogue with a very long name, page 17"
    for use in document["tools"]:
        use["range_source"] = long
    text = said(tmp_path, document)
    assert text.count(long) == 1 and text.count("[1]") == 3


def test_a_word_that_changes_nothing_says_so():
    document = optimised()
    document["lines"][0] |= {"feed_before": 100.0}
    assert listing(part(document), []).lines[0].notes[0].startswith("as before")


def test_grave_warnings_make_the_verdict(tmp_path):
    warning = {"what": "rapids go through the material", "do": "Retract further.", "lines": [7, 8],
               "blocks": 2, "grave": True}  # fmt: skip
    text = said(tmp_path, optimised() | {"warnings": [warning]})
    assert "look at the warnings" in text and "36 % less cost" not in text
    first = text.index("Rapids go through the material (lines 7–8).")
    assert first < text.index("The part takes")


def test_a_feed_per_tooth_outside_of_its_range_is_marked_and_one_inside_is_not():
    table = feeds_table(part(optimised()), [])
    inside, outside = (row[1] for row in table.rows)
    assert (inside.text, inside.status) == ("0.0500 → 0.0833", "")
    assert (outside.text, outside.status) == ("0.0500 → 0.200", "failed")
    low = optimised()
    low["tools"][0]["after"]["feed_per_tooth_mm"] = 0.01
    assert feeds_table(part(low), []).rows[0][1].status == "attention"


def test_a_tool_that_is_kept_says_why(tmp_path):
    document = optimised()
    document["tools"][1]["kept"] = "reaming keeps F and S"
    text = said(tmp_path, document)
    assert "F and S stay as programmed: reaming keeps F and S." in text
    assert "kept as programmed" in text


def test_lines_show_their_words_and_say_the_size_of_a_change_without_colour():
    shown = listing(part(optimised()), [])
    assert shown.caption == "The program, line by line: 24 lines changed" and shown.unfolded
    less, same, more = shown.lines[0], shown.lines[1], shown.lines[6]
    assert less.tone == "less3 changed" and less.notes == ("F\u202f200 → 100 ▼▼▼",)
    assert more.tone == "more3 changed" and more.notes == ("F\u202f200 → 500 ▲▲▲",)
    assert same.notes == () and str(same.after) == "" and "<b>" not in same.before
    assert str(more.after) == "G1 X11. <b>F500.</b> (SLOT F7)"  # a comment's F is none


def test_long_programs_are_cut_short_and_folded(tmp_path):
    shown = listing(part(optimised(4000)), [])
    assert len(shown.lines) == 1500 and not shown.unfolded
    assert "the first 1\u202f500 of 8\u202f000 shown" in shown.caption


def test_the_set_up_sheet_names_tools_offsets_blank_and_warnings(tmp_path):
    text = said(tmp_path, optimised())
    sheet = text[text.index("Set-up sheet") :]
    for word in ("60 × 40 × 10 mm (X 0 to 60, Y 0 to 40, Z -10 to 0)", "zero is that of G54",
                 "T1 SLOT", "127.711", "-410", "G55",
                 "Rapids go through the material", "Lines 7–9, 21."):  # fmt: skip
        assert word in sheet, word


def test_methods_stand_beside_each_other_under_the_same_limits(tmp_path):
    table = methods_table(part(optimised()), [])
    heads = [(head.group, head.name) for head in table.heads]
    assert ("As sure as asked", "time") in heads and ("At nominal values", "time") in heads
    rows = {row[0].text: [cell.text for cell in row] for row in table.rows}
    price = heads.index(("Certainty costs", "in time"))
    assert rows["This answer"][price].replace("\u202f", " ") == "+3.4 %"  # 24.51 s over 23.7 s
    assert rows["As programmed"][price] == "–"  # it has no row at nominal values


def test_numbers_that_are_not_known_are_a_dash_not_a_number(tmp_path):
    blank = {key: None for key in optimised()["after"]}
    document = optimised() | {"before": blank, "after": blank, "front": []}
    document["gain"] = {key: None for key in document["gain"]}
    document["groups"] = [{**group(0), "cost_before": None, "cost_after": None, "binds": None}]
    text = said(tmp_path, document)
    assert "not known" in text and "nan" not in text.lower().split() and "None" not in text


def test_four_thousand_blocks_make_a_page_below_two_megabytes(tmp_path):
    out = page(tmp_path, optimised(4000, columns=900, members=60))
    assert out.stat().st_size < 2e6
    assert "F and S of 4 000 groups of blocks (200 of 4 000 shown)" in said(
        tmp_path, optimised(4000, columns=900)
    )


def test_one_block_is_enough(tmp_path):
    text = said(tmp_path, optimised(1, columns=1, members=0))
    assert "F and S of 1 group of blocks" in text and "The front" not in text


COLUMN = re.compile(r"M(-?\d+) (-?\d+)h10v(-?\d+)h-10z")


def paths(svg: str, kind: str) -> list[str]:
    """Data of the paths of one class."""
    return re.findall(rf'<path d="([^"]*)" class="{kind}"', svg)


@given(st.lists(st.one_of(st.none(), st.floats(0, 500)), min_size=1, max_size=2000))
def test_no_peak_of_the_load_is_lost_in_columns(load):
    many = len(load)
    made = {"total_mm": 3.0 * many, "way_mm": [3.0 * k for k in range(many)], "load_N": load,
            "line": list(range(many))}  # fmt: skip
    found = figures.path_load(structured(made, LoadTrace, "trace"))
    known = [v for v in load if v is not None]
    if not known:
        assert found is None
        return
    assert len(found.load) == min(many, figures.MOST)
    assert np.nanmax(found.load) == max(known)
    width = many / len(found.load)
    for k in np.flatnonzero(np.isfinite(found.load)).tolist():
        inside = [v for i, v in enumerate(load) if v is not None and int((i + 1e-6) / width) == k]
        assert found.load[k] == max(inside)


def test_what_lies_above_the_limit_is_drawn_above_it_and_nothing_else():
    made = (trace(90, level) for level in (66.0, 55.0))
    before, after = (figures.path_load(structured(one, LoadTrace, "trace")) for one in made)
    drawn = str(figures.load_figure(before, after, 60.0, [], "x"))
    upper, lower = paths(drawn, "s-over")
    assert len(COLUMN.findall(upper)) == int((before.load > 60).sum()) > 0
    assert COLUMN.findall(lower) == []
    most = 1.1 * max(np.nanmax(before.load), 60.0)
    for _, top, height in COLUMN.findall(upper):
        assert int(top) + int(height) == pytest.approx(1000 * (1 - 60 / most), abs=1)


def test_each_group_has_its_level_of_f_and_s_over_its_place():
    rows = [group(k) for k in range(4)]
    drawn = str(figures.words_figure(blocks(rows), "x"))
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
    drawn = str(figures.words_figure(blocks(rows), "x"))
    assert "F, mm/min" in drawn and "F, mm/rev" in drawn
    assert "F, mm/rev" not in str(figures.words_figure(blocks(rows[:1]), "x"))


def test_lanes_mark_the_groups_that_a_limit_binds():
    rows = [group(k) for k in range(8)]  # load, torque, chip, nothing, twice
    drawn = str(figures.words_figure(blocks(rows), "x"))
    lanes = paths(drawn, "s-after")
    marks = [re.findall(r"M(\d+) 0h(\d+)", lane) for lane in lanes]
    assert sorted(marks) == [[("0", "125"), ("500", "125")], [("125", "125"), ("625", "125")],
                             [("250", "125"), ("750", "125")]]  # fmt: skip
    for name in ("Load limit binds", "Spindle torque binds", "Greatest chip binds"):
        assert name in drawn


@given(st.integers(1, 500))
def test_pairs_of_columns_hold_the_whole_time(groups):
    rows = [group(k) for k in range(groups)]
    drawn = str(figures.pairs_figure(blocks(rows), [("Time, s", "time_{}_s")], "x"))
    before, after = (COLUMN.findall(paths(drawn, f"s-{which}")[0]) for which in ("before", "after"))
    assert len(before) == len(after) == -(-groups // figures.per_pair(groups)) <= 60
    sums = np.add.reduceat(
        [r["time_before_s"] for r in rows], np.arange(0, groups, figures.per_pair(groups))
    )
    heights = np.array([int(h) for *_, h in before])
    others = np.add.reduceat(
        [r["time_after_s"] for r in rows], np.arange(0, groups, figures.per_pair(groups))
    )
    most = 1.08 * max(sums.max(), others.max())
    assert heights == pytest.approx(1000 * sums / most, abs=1)  # to a unit of the viewport


def test_a_pair_without_any_number_is_no_figure():
    rows = [{**group(0), "time_before_s": None, "time_after_s": None}]
    assert figures.pairs_figure(blocks(rows), [("Time, s", "time_{}_s")], "x") is None


def test_the_front_is_drawn_in_the_two_quantities_that_differ():
    document = optimised(members=5)
    assert figures.compared(part(document)) == ("time_s", "cost")
    for row in document["front"]:
        row["cost"] = None
    assert figures.compared(part(document)) == ("time_s", "tool_life_share")
    for k, row in enumerate(document["front"]):  # cost follows time, energy runs against it
        row |= {"cost": 2 * row["time_s"], "energy_kWh": (7 * k) % 5, "tool_life_share": -k}
    assert figures.compared(part(document)) == ("time_s", "tool_life_share")
    assert figures.compared(part(document | {"front": []})) is None


def test_only_members_that_none_beats_in_both_are_joined():
    document = optimised(members=6)
    document["front"][2]["cost"] += 30.0  # beaten in these two by its neighbour, not in a third
    drawn = str(
        figures.front_figure(
            figures.front_places(part(document), ("time_s", "cost")), ("x", "y"), "x"
        )
    )
    (line,) = paths(drawn, "curve front")
    assert len(re.findall(r"-?\d+ -?\d+", line)) == 5 and drawn.count("<circle") == 8


def test_every_member_of_the_front_is_a_point_and_the_knee_is_marked_once():
    document = optimised(members=12)
    places = figures.front_places(part(document), ("time_s", "cost"))
    kinds = [p.kind for p in places]
    assert (kinds.count("p-front"), kinds.count("p-knee"), kinds.count("p-after")) == (12, 1, 1)
    drawn = str(figures.front_figure(places, ("Time, s", "Cost"), "x"))
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
