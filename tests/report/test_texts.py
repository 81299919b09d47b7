"""Texts of the lead's and the fleet's page: one catalogue, the same keys in every language."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from string import Formatter

import pyarrow as pa
import pytest
from control_folders import with_control
from optimise_documents import optimised
from page_reader import outline, words
from report_folders import FLEET, UTC_NS, empty_machine, machine, nanoseconds, write_table
from test_part_programs import cuts, with_parts

from pipeline.charts.words import Entry
from pipeline.report.folders import MachineFolders
from pipeline.report.pages import write_report
from pipeline.report.texts import (
    ENGLISH,
    FOLDER,
    ReportSettings,
    Texts,
    check_like,
    languages,
    texts,
)
from pipeline.submodels.contract import submodel, submodels

LEADS = ("index.html", "mill01.html", "mill02.html", "lathe.html", "new_mill.html")
MARKED = re.compile("⟦[^⟦⟧]*⟧")


def each_form(entry: Entry, change: Callable[[str], str]) -> Entry:
    return change(entry) if isinstance(entry, str) else {k: change(v) for k, v in entry.items()}


def marked(text: str) -> str:
    """The words of a text inside marks, its fields outside of them."""
    parts = [
        f"⟦{said}⟧{'' if name is None else f'{{{name}}}'}" if said else f"{{{name}}}"
        for said, name, _, _ in Formatter().parse(text)
    ]
    return "".join(parts)


class EveryPhrase(dict[str, str]):
    """Marks any phrase, as if all were translated."""

    def __contains__(self, phrase: object) -> bool:
        return True

    def __getitem__(self, phrase: str) -> str:
        return f"⟦{phrase}⟧"


DECIMAL = "format.decimal"
MARKS = Texts(
    "x-marks",
    {k: v if k == DECIMAL else each_form(v, marked) for k, v in ENGLISH.entries.items()},
    EveryPhrase(),
)
"""English with every text in marks."""


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> list[MachineFolders]:
    """Machines that between them use most texts: alarms, silence, programs, faults, nothing."""
    root = tmp_path_factory.mktemp("texts")
    better = optimised(name="BORE")
    good = with_parts(
        root, machine(root, "mill01", credit="CREDIT"), {"SLOT": optimised(), "BORE": better},
        {"SLOT": cuts(20, 20)},
    )  # fmt: skip
    bad = machine(root, "mill02", days=11, passed=False, missing=(("WANTED", "WANTED"),))
    (bad.clean / "state" / "2024-03-13.parquet").unlink()
    write_table(
        bad.clean / "audit.parquet",
        {
            "data_item": ["S1temp"] * 900,
            "rule": ["zero"] * 900,
            "time": pa.array([nanoseconds("2024-03-10")] * 900, UTC_NS),
        },
    )
    (bad.clean / "summary.json").write_text(
        '{"absent": ["Ssped", "Xx"], "near": {"Ssped": ["Sp"]}}'
    )
    write_table(bad.clean / "gaps.parquet", {
        "data_item": pa.array([None] * 2, pa.string()), "cause": ["silence"] * 2,
        "start": pa.array([nanoseconds("2024-03-04")] * 2, UTC_NS),
        "end": pa.array([nanoseconds("2024-03-04") + 3600 * 10**9] * 2, UTC_NS),
    })  # fmt: skip
    lathe = with_control(machine(root, "lathe", "recorded", days=3, passed=False))
    new = empty_machine(root, "new_mill", "recorded", submodels=("spindle",))
    return [good, bad, lathe, new]


def written(fleet: list[MachineFolders], say: Texts, out: Path) -> Path:
    """Pages in a language, each compared with a report of one raw file less."""
    info = replace(FLEET, notes=())
    manifest = fleet[0].signals / "manifest.json"
    whole = manifest.read_text()
    manifest.write_text(whole.replace("agent/2024-03-04.txt", "agent/2024-03-01.txt"))
    write_report(fleet, info, None, out, say=say)
    manifest.write_text(whole)
    write_report(fleet, info, out, out, say=say)
    return out


DATA = {
    "mill", "lathe", "new_mill", "CREDIT", "Hall", "numpy", "default", "Ssped", "Xx", "Sp",
    "BORE", "SLOT", "agent", "txt", "shdr", "temp", "servo_c", "coolant_c", "min", "parts", "nc",
    "COOLANT", "LEVEL", "LOW", "FOLLOWING", "ERROR", "run", "UTC",
}  # fmt: skip
"""Words of machines, files, data items, alarms and units: what the records hold is no text."""
SHOWN = {"aria-label", "data-label", "title", "data-word", "data-print"}
"""Attributes whose value a reader meets."""
FOREIGN = re.compile(r'<(th|span) [^>]*lang="en">.*?</\1>|<code[^>]*>.*?</code>|<b[^>]*></b>', re.S)
"""What a sub-model says in English, and machine text."""


@pytest.fixture(scope="module")
def in_marks(fleet: list[MachineFolders], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(fleet, MARKS, tmp_path_factory.mktemp("marked"))


@pytest.mark.parametrize("name", LEADS)
def test_every_word_of_a_lead_s_page_is_a_text_or_data(in_marks: Path, name: str) -> None:
    """With every text in marks, what is left beside them is data, or a sub-model's sentence."""
    page = in_marks / name
    said = [a[k] for _, a in outline(page).tags for k in SHOWN & {*a} if "lang" not in a]
    page.write_text(FOREIGN.sub(" ", page.read_text()))
    text = " ".join([words(page), *(one for one in said if not one.startswith("⟦Evidence"))])
    assert len(MARKED.findall(text)) > 15
    text = re.sub(r"\b[0-9a-f]{12}\b", " ", text)  # hashes of a figure's title
    left = set(re.findall(r"[A-Za-zÀ-ž_]{2,}", MARKED.sub(" ", text)))
    assert left <= DATA


def test_every_text_of_a_page_is_used_by_one(fleet: list[MachineFolders], tmp_path: Path) -> None:
    """No key of the catalogue is left over: each stands somewhere in the code, or by its group."""
    source = "".join(
        path.read_text() for path in FOLDER.parent.rglob("*") if path.suffix in (".py", ".j2")
    )
    groups = re.findall(r"""["'](\w+(?:\.\w+)*)\.(?:["'] ~|\{)|["'](\w+)\.\w*_\{""", source)
    for key in ENGLISH.entries:
        at = key.rpartition(".")[0]
        assert f'"{key}"' in source or any(at in group for group in groups), key


@pytest.mark.parametrize("language", languages())
def test_a_language_has_the_keys_and_fields_of_the_english_one(language: str) -> None:
    found = texts(language)
    check_like(found, ENGLISH)
    assert found.entries.keys() == ENGLISH.entries.keys()
    for one in submodels():
        assert language == "en" or submodel(one).title in found.contributed


@pytest.mark.parametrize("language", languages())
def test_pages_are_written_in_each_language(
    fleet: list[MachineFolders], tmp_path: Path, language: str
) -> None:
    out, say = written(fleet, texts(language), tmp_path), texts(language)
    for name in LEADS:
        page = out / name
        assert next(a for t, a in outline(page).tags if t == "html")["lang"] == language
        assert say("page.skip") in words(page)
    lead = words(out / "mill02.html")
    assert say("actions.title") in lead and say("score.title") in lead
    why = say("action.sensor_why", 900, rule=say("rule.zero"), a_day=say.number(90),
              moment=say.moment("2024-03-10T00:00:00Z"))  # fmt: skip
    assert why.replace("\xa0", " ") in lead
    assert f"2{say('format.decimal')}80 K" in lead  # the mean error on the worst day
    evidence = out / "mill02_spindle.html"
    assert next(a for t, a in outline(evidence).tags if t == "html")["lang"] == "en"


def test_numbers_times_and_lists_follow_the_language() -> None:
    de = texts("de")
    assert de.number(1234.5678, 6) == "1\u202f234,57"
    assert de.moment("2026-02-04T08:51:00Z") == "Mi\u00a04.\u00a0Feb.\u00a02026, 08:51\u00a0UTC"
    assert de.duration(2.4 * 86400) == "2,4\u202fTage"
    assert de.joined(["X", "Y", "Z"]) == "X, Y und Z"
    assert de.number(None) == "nicht bekannt"
    assert ENGLISH.day_list(["2024-03-13"] * 6).endswith(" and 2 more")
    assert (de("alarms.faults", 1), de("alarms.faults", 2)) == ("1 Störung", "2 Störungen")
    assert de.given("Spindle temperature") == "Spindeltemperatur"
    assert de.given("not in the list") == "not in the list"


def test_a_text_that_is_missing_or_has_another_field_is_one_sentence() -> None:
    less = Texts("xx", {"a": "{count} files", "b": "b"})
    with pytest.raises(ValueError, match=r"languages/xx\.toml has no text 'c': add it there"):
        less("c")
    with pytest.raises(ValueError, match=r"'a' of languages/xx\.toml has the field 'count', and"):
        less("a", number=3)
    with pytest.raises(
        ValueError, match=r"xx\.toml lacks the text 'c', which languages/en\.toml has"
    ):
        check_like(less, Texts("en", {"a": "{count}", "b": "b", "c": "c"}))
    with pytest.raises(
        ValueError, match=r"'a' of languages/xx\.toml has the fields count, and that"
    ):
        check_like(less, Texts("en", {"a": "{number} files", "b": "b"}))
    with pytest.raises(ValueError, match=r"no texts in the language 'xx': choose one of de, en"):
        texts("xx")
    with pytest.raises(ValueError, match=r"pages\.language is 'xx': choose one of de, en"):
        ReportSettings(language="xx")
