"""The page of an optimised program: each figure and table of its document, all text escaped."""

import copy
import re
from base64 import b64encode
from hashlib import sha256
from pathlib import Path

import pytest
from optimise_documents import HASHES, change, group, optimised, part

from pipeline.report.optimised.changes import feeds_table, increases, listing
from pipeline.report.optimised.page import write_optimised_page
from pipeline.report.optimised.path import SCRIPT
from pipeline.report.optimised.tables import methods_table
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


@pytest.mark.parametrize("key", sorted(optimised()))
def test_a_document_that_lacks_a_part_is_refused_with_its_name(key):
    document = copy.deepcopy(optimised())
    del document[key]
    with pytest.raises(ValueError, match=key):
        part(document)


@pytest.mark.parametrize("key", ["limits", "before", "proof", "groups", "words", "trace"])
@pytest.mark.parametrize("value", [None, "text", 3])
def test_a_part_of_another_shape_is_refused_with_its_name(key, value):
    with pytest.raises(ValueError, match=key):
        part(optimised() | {key: value})


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


def test_the_same_document_makes_the_same_bytes(tmp_path):
    first = page(tmp_path, optimised()).read_bytes()
    assert page(tmp_path, optimised()).read_bytes() == first
