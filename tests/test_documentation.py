"""Documentation: no page grows back, figures and pictures are those of the build that they show."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from pipeline.app.document_figures import document_figures
from pipeline.app.json_schema import schema_files

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs/site"))

import pictures  # noqa: E402
import validation  # noqa: E402

README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").rglob("*.md"))
SUBJECTS = [subject.page for subject in validation.SUBJECTS.values()]
HOW_TO = [ROOT / "docs" / f"{name}.md" for name in (*SUBJECTS, "optimisation", "tools")]
INDEX = json.loads(pictures.INDEX.read_text())
REMEDY = "build its fleet and run `make pictures`"
SHOWN = re.compile(r"!\[[^\]]*\]\((?:docs/|\.\./)?pictures/(\w+)\.png\)\s*(\*[^*]+\*)?")


def words(page: Path) -> int:
    """Words of a page without its code."""
    return len(re.sub(r"^```.*?^```", "", read(page), flags=re.M | re.S).split())


def read(page: Path) -> str:
    """What a reader of a page reads: comments are not shown."""
    return re.sub(r"<!--.*?-->", "", page.read_text(), flags=re.S)


@pytest.mark.parametrize("page", HOW_TO, ids=lambda page: page.stem)
def test_a_how_to_is_short_and_shows_a_picture(page: Path) -> None:
    assert words(page) <= 500
    assert SHOWN.search(page.read_text())


@pytest.mark.parametrize("page", [p for p in PAGES if p.parent.name == "theory"],
                         ids=lambda page: page.stem)  # fmt: skip
def test_a_theory_is_short_and_says_where_it_holds(page: Path) -> None:
    assert words(page) <= 1200
    assert re.search(r"^(## |\*\*)Validity", page.read_text(), re.M)


def test_documentation_fits_on_a_desk() -> None:
    assert sum(len(read(page).split()) for page in PAGES) <= 30_000
    assert len(read(README).split()) <= 1200


def test_figures_of_readme_and_docs_are_what_their_sources_say() -> None:
    assert validation.documents() == [README, *PAGES]
    assert [said for path in validation.documents() for said in validation.stale(path)] == []
    assert len(list(document_figures(README.read_text(), ROOT, "README.md"))) >= 30


def test_each_picture_is_shown_and_each_shown_is_taken() -> None:
    shown = {name for page in [README, *PAGES] for name, _ in SHOWN.findall(page.read_text())}
    assert shown == set(pictures.PICTURES) == set(INDEX)
    assert {path.stem for path in pictures.FOLDER.glob("*.png")} == shown


@pytest.mark.parametrize("name", pictures.PICTURES)
def test_a_picture_shows_the_build(name: str) -> None:
    shown, taken = pictures.PICTURES[name], INDEX[name]
    picture = pictures.FOLDER / f"{name}.png"
    assert pictures.picture_digest(picture) == taken["picture"], f"{name} was changed by hand"
    figures = pictures.figures_digest(ROOT / "data/metrics", shown.figures)
    assert figures == taken["figures"], f"the figures of {shown.page} changed: {REMEDY}"


@pytest.mark.parametrize("name", [n for n, p in pictures.PICTURES.items() if not p.command])
def test_a_picture_shows_the_page_of_the_built_fleet(name: str) -> None:
    shown = pictures.PICTURES[name]
    fleet = yaml.safe_load((ROOT / "conf/fleet/active.yaml").read_text())["name"]
    page = ROOT / "reports" / shown.page
    if fleet != shown.fleet or not page.exists():
        pytest.skip(f"the fleet {shown.fleet} is not built here")
    assert pictures.text_digest(page) == INDEX[name]["text"], f"{shown.page} changed: {REMEDY}"


@pytest.mark.parametrize("page", [README, *PAGES], ids=lambda page: page.stem)
def test_a_picture_is_called_simulated_where_it_is(page: Path) -> None:
    simulated = validation.simulated_machines()
    text = page.read_text()
    everything = "All results on this page are of simulated records." in text
    for name, caption in SHOWN.findall(text):
        named = everything or "(simulated)" in caption
        assert named == (pictures.PICTURES[name].machine in simulated), f"{page.name}: {name}"


def test_a_digest_sees_the_third_digit_and_no_more(tmp_path: Path) -> None:
    def digest(value: float) -> str:
        (tmp_path / "m_drive.json").write_text(json.dumps({"force X": {"rmse": value}}))
        return pictures.figures_digest(tmp_path, "m_drive")

    assert digest(1.2345) == digest(1.2345001) != digest(1.2445)


def sections() -> list[Any]:
    """Sections of machines' files that the pages show, by page and name."""
    found = []
    for page in PAGES:
        for block in re.findall(r"^```yaml\n(.*?)^```", page.read_text(), re.M | re.S):
            shown = yaml.safe_load(block)
            for name in set(shown) & set(MACHINE["properties"]):
                found.append(pytest.param(name, shown[name], id=f"{page.stem}-{name}"))
    return found


MACHINE = json.loads(schema_files()["machine.json"])


@pytest.mark.parametrize(("name", "shown"), sections())
def test_a_section_that_a_page_shows_is_one(name: str, shown: Any) -> None:
    whole = {"$defs": MACHINE["$defs"], **MACHINE["properties"][name]}
    faults = Draft202012Validator(whole).iter_errors(json.loads(json.dumps(shown, default=str)))
    leaves = [leaf for fault in faults for leaf in (fault.context or [fault])]
    wrong = [leaf.message for leaf in leaves if leaf.validator != "required"]  # it may be a part
    assert not wrong
