"""The page of an optimised program: each figure and table of its document, all text escaped."""

import copy
from pathlib import Path

import pytest
from optimise_documents import HASHES, group, optimised, part

from pipeline.report.optimised_page import write_optimised_page
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
    for word in ("Load along the way", "F and S of the blocks", "Time and cost of the blocks",
                 "The front in two", "The front and other"):  # fmt: skip
        assert any(label.startswith(word) for label in labels), word
    text = said(tmp_path, optimised())
    for word in ("Before and after", "What holds the program back", "F and S of 24 groups",
                 "What the certainty allows for", "What other ways find", "The front: 30 programs",
                 "Proof", "Limits", "Threads keep their feed", "3 moves, the first in SLOT.nc:9",
                 "Stability: not known", *HASHES):  # fmt: skip
        assert word in text, word


def test_the_summary_says_what_a_process_engineer_asks(tmp_path):
    text = said(tmp_path, optimised())
    for word in ("36 % cheaper", "24.51 s instead of 29.48 s (-16.9 %)",
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
        ({"objective": "time"}, "17 % faster"),
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


def test_it_runs_no_script_loads_nothing_and_escapes_names(tmp_path):
    out = page(tmp_path, optimised(name=NAME))
    assert "<script" not in out.read_text() and NAME in words(out)
    assert "default-src 'none'" in out.read_text()
    tags = outline(out).tags
    assert not any("src" in a or a.get("href", "").startswith("http") for _, a in tags)


def test_only_simulated_records_are_labelled_simulated(tmp_path):
    labels = [a.get("class") for _, a in outline(page(tmp_path, optimised())).tags]
    assert labels.count("label simulated") > 8  # the head, each figure, each table
    other = outline(page(tmp_path, optimised() | {"origin": "recorded"})).tags
    assert not any(a.get("class") == "label simulated" for _, a in other)


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
