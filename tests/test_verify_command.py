"""kerf verify: a digit changed on a page, an input changed, a verdict that its predictions do not
give, a stale number in a document."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from typer.testing import Result

from pipeline.app.document_figures import document_figures, filled
from pipeline.report.provenance import PageRecord, record_of
from pipeline.schema.store import read_json
from tests import bundled_project
from tests.bundled_project import MACHINE
from tests.small_project import leave, with_conf
from tests.test_cli import kerf
from tests.test_optimise_command import GIVEN, PART

PAGE = Path(f"reports/{MACHINE}_spindle.html")
FOLDER = f"data/models/{MACHINE}/spindle"


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project with one judged sub-model and its report."""
    root = bundled_project.project(tmp_path_factory.mktemp("built") / "project")
    bundled_project.spindle(root, error_K=1.0)
    manifest = root / f"data/signals/{MACHINE}/manifest.json"
    identity = {"machine": {"name": MACHINE, "origin": "simulated"}}
    manifest.write_text(json.dumps(json.loads(manifest.read_text()) | identity))
    params = yaml.safe_load((root / "params.yaml").read_text())
    more = {"budget": "default", "pages": {"language": "en"}}
    (root / "params.yaml").write_text(yaml.safe_dump(params | more))
    settings = root / f"data/settings/sections/{MACHINE}.json"
    settings.parent.mkdir(parents=True)
    settings.write_text('{"spindle_fit": "0"}\n')
    (root / "data/code.json").write_text('{"report": "abcdef0123456789"}\n')
    assert kerf(root, "report").exit_code == 0
    return root


@pytest.fixture
def project(built: Path, tmp_path: Path) -> Path:
    return shutil.copytree(built, tmp_path / "project")


def changed(file: Path, change: Callable[[str], str]) -> None:
    before = file.read_text(encoding="utf-8")
    file.write_text(change(before), encoding="utf-8")
    assert file.read_text(encoding="utf-8") != before


def failed(done: Result) -> list[str]:
    """Lines of mismatches of a page that is not what its inputs give."""
    assert done.exit_code == 1, done.output
    *mismatches, last = done.stdout.splitlines()
    assert f": {len(mismatches)} mismatches" in last
    return mismatches


def test_a_report_is_what_its_inputs_give(project: Path) -> None:
    pages = sorted((project / "reports").glob("*.html"))
    done = kerf(project, "verify", *(one.relative_to(project) for one in pages))
    assert done.exit_code == 0, done.output
    assert len(pages) == 4 and done.stdout.count(": as shown") == 4


def test_each_figure_names_its_hashes_in_its_title_and_its_files_beside_the_page(
    project: Path,
) -> None:
    html, record = (project / PAGE).read_text(), read_json(record_of(project / PAGE), PageRecord)
    stems = re.findall(
        r'title="(data \w{12}, code abcdef012345, settings \w{12}, model \w{12})"', html
    )
    assert len(stems) == len(record.figures) > 5
    assert record.made.code == "abcdef0123456789" and not record.made.version
    for name, files in record.figures.items():
        assert f'id="{name}"' in html and set(files) <= set(record.files)
    assert set(record.figures["keys"]) == {f"{FOLDER}/model.json", f"{FOLDER}/verdict.json"}


def test_a_report_written_again_is_the_same_bytes(project: Path) -> None:
    def content() -> dict[str, bytes]:
        return {one.name: one.read_bytes() for one in (project / "reports").iterdir()}

    before = content()
    assert kerf(project, "report").exit_code == 0
    assert content() == before


def test_one_digit_changed_in_a_page_is_named_with_the_figure(project: Path) -> None:
    verdict = json.loads((project / FOLDER / "verdict.json").read_text())
    html = (project / PAGE).read_text()
    cell = next(found for found in re.finditer(r'class="num"><span>(\d\.\d\d)</span>', html))
    right = cell[1]
    wrong = right[:-1] + str((int(right[-1]) + 1) % 10)
    (project / PAGE).write_text(html[: cell.start(1)] + wrong + html[cell.end(1) :])
    assert verdict["scores"]
    (line,) = failed(kerf(project, "verify", PAGE))
    figure = re.match(rf"{PAGE}: (spindle\S*-t\d+) shows '{wrong}', recomputed '{right}'", line)
    assert figure and f"{FOLDER}/" in line
    assert f'id="{figure[1]}"' in html


def test_a_digit_changed_in_a_sentence_or_a_drawing_is_found(project: Path) -> None:
    changed(project / PAGE, lambda text: re.sub(r'(cx="\d)\d(\.\d+%)', r"\g<1>x\2", text, count=1))
    (line,) = failed(kerf(project, "verify", PAGE))
    assert re.search(r"spindle-judged-f\d+-\d shows '\dx", line)
    changed(project / PAGE, lambda text: text.replace(" passed on ", " failed on ", 1))
    assert len(failed(kerf(project, "verify", PAGE))) == 2


def test_a_page_older_than_its_input_is_one_sentence(project: Path) -> None:
    model = f"{FOLDER}/model.json"
    document = json.loads((project / model).read_text())
    document["parameters"][""]["cooling_rate"]["value"] *= 2
    (project / model).write_text(json.dumps(document))
    line = older(kerf(project, "verify", PAGE, "--json", "found.json"))
    differ = re.match(
        rf"{PAGE}: 3 inputs, 12 figures: made before input {model} \(\w{{12}}, is \w{{12}}\) "
        r"changed: make it anew; (\d+) of the figures differ$", line
    )  # fmt: skip
    assert differ and 0 < int(differ[1]) <= 12
    (found,) = json.loads((project / "found.json").read_text())
    assert [one["file"] for one in found["changed"]] == [model]
    assert any(re.match(r"spindle-t\d", one["figure"]) and model in one["file"]
               for one in found["mismatches"])  # fmt: skip
    shutil.rmtree(project / f"data/clean/{MACHINE}")
    line = older(kerf(project, "verify", f"reports/{MACHINE}_records.html"))
    assert "is not there)" in line and " more changed: make it anew" in line


def older(done: Result) -> str:
    """The line on a page that is older than its inputs."""
    assert done.exit_code == 1, done.output
    (line,) = done.stdout.splitlines()
    return line


def test_a_verdict_that_its_predictions_do_not_give_is_found(project: Path) -> None:
    """The report is whole and rests on the verdict as it is; the predictions tell."""
    file = project / FOLDER / "verdict.json"
    verdict = json.loads(file.read_text())
    score = next(one for one in verdict["scores"] if one["group"] == "all" and one["mae"])
    right, score["mae"] = score["mae"], score["mae"] / 2
    file.write_text(json.dumps(verdict))
    assert kerf(project, "report").exit_code == 0
    (line,) = failed(kerf(project, "verify", PAGE))
    assert f"mae of {score['quantity']}" in line and f"recomputed '{right}'" in line
    assert line.endswith("predictions.parquet")


def test_a_sample_compares_so_many_figures(project: Path) -> None:
    done = kerf(project, "verify", PAGE, "--sample", "2")
    assert done.exit_code == 0 and " 2 of 12 figures: as shown" in done.stdout
    assert kerf(project, "verify", PAGE, "--sample", "0").exit_code == 2


def test_a_sample_is_drawn_afresh_and_again_by_its_seed(project: Path) -> None:
    path = project / PAGE
    path.write_text(path.read_text().replace("0", "9"))  # so that what was drawn is named
    seeds = {n: kerf(project, "verify", PAGE, "--sample", "1", "--seed", str(n)).stdout
             for n in (1, 2, 3, 4)}  # fmt: skip
    assert len({text.replace(f"--seed {n}", "") for n, text in seeds.items()}) > 1
    assert kerf(project, "verify", PAGE, "--sample", "1", "--seed", "2").stdout == seeds[2]
    drawn = {kerf(project, "verify", PAGE, "--sample", "1").stdout.splitlines()[-1]
             for _ in range(3)}  # fmt: skip
    assert len(drawn) > 1 and all(one.startswith("drawn by --seed ") for one in drawn)


def test_code_that_is_not_the_page_s_is_said(project: Path) -> None:
    (project / "data/code.json").write_text('{"report": "0123456789abcdef"}\n')
    done = kerf(project, "verify", PAGE)
    assert "(made by code abcdef012345, verified by 0123456789ab)" in done.stdout


@pytest.mark.parametrize(("name", "content", "said"), [
    ("none.html", None, "none.html does not exist: name a page"),
    ("old.html", "<html></html>", "old.figures.json does not exist: build the page again"),
    ("a.html", b"\xff", "a.html is no page of Kerf"),
    ("a.md", "see <!-- m.json#a -->1\n", "a.md, line 1: the figure has no end"),
    ("a.md", "<!-- m.json#a -->1<!-- / -->\n", "a.md, line 1: a line that begins with a comment"),
    ("a.md", "is <!-- m.json#b -->1<!-- / -->\n", "m.json#b: there is no 'b', there is a, c"),
    ("a.md", "is <!-- n.json#b -->1<!-- / -->\n", "a.md, line 1: n.json#b: "),
    ("a.md", "is <!-- m.json#a to c/d -->1<!-- / -->\n", "a change needs two numbers"),
])  # fmt: skip
def test_bad_input_is_one_sentence(
    project: Path, name: str, content: str | bytes | None, said: str
) -> None:
    (project / "m.json").write_text('{"a": 1, "c": {"d": "80"}}')
    if content is not None:
        (project / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    done = kerf(project, "verify", name)
    assert done.exit_code == 2 and said in done.stderr and done.stderr.count("\n") == 1


def test_a_record_runs_no_command_but_those_that_make_pages(project: Path) -> None:
    record = record_of(project / PAGE)
    document = json.loads(record.read_text())
    document["made"]["command"] = ["report"]
    record.write_text(json.dumps(document))
    assert "names `kerf report`, which makes no page" in kerf(project, "verify", PAGE).stderr


def test_a_stale_number_in_a_document_is_named_and_filled_in(project: Path) -> None:
    (project / "m.json").write_text('{"O1_before_s": 80.75, "O1_after_s": 68.56, "ok": "passed"}')
    text = (
        "O1 takes <!-- m.json#O1_after_s -->67.4<!-- / --> s, "
        "<!-- m.json#O1_before_s to O1_after_s as .0% -->−16 %<!-- / -->.\n\n"
        "It <!-- m.json#ok -->passed<!-- / -->.\n\n```\n<!-- m.json#none -->1<!-- / -->\n```\n"
    )
    (project / "docs").mkdir()
    (project / "docs/a.md").write_text(text)
    lines = failed(kerf(project, "verify", "docs"))
    assert lines == [
        "docs/a.md: line 1 shows '67.4', recomputed '68.6' from m.json#O1_after_s",
        "docs/a.md: line 1 shows '−16 %', recomputed '−15 %' from m.json#O1_before_s to O1_after_s",
    ]
    whole = filled(text, project, "a.md")
    assert whole == text.replace("67.4", "68.6").replace("−16 %", "−15 %")
    assert all(one.shown == one.recomputed for one in document_figures(whole, project, "a.md"))


def test_the_page_of_a_command_is_made_again_by_it(tmp_path: Path) -> None:
    root = tmp_path / "project"
    leave(with_conf(root), "recorded", "mazak01")
    (root / "part.nc").write_text(PART)
    words = [word for pair in GIVEN.items() for word in pair if pair[0] != "--objective"]
    done = kerf(root, "simulate", "part.nc", *words, "--json", "cut.json", "--page", "cut.html")
    assert done.exit_code == 0, done.output
    record = read_json(record_of(root / "cut.html"), PageRecord)
    assert record.made.command[:2] == ("simulate", "part.nc") and "part.nc" in record.files
    assert re.fullmatch(r"[0-9a-f]{40}", record.made.code) and record.made.dirty
    assert kerf(root, "verify", "cut.html").exit_code == 0
    done = kerf(
        root, "simulate", "part.nc", *words, "--json", "cut.figures.json", "--page", "cut.html"
    )
    assert done.exit_code == 2 and "is named for two outputs" in done.stderr
    changed(root / "part.nc", lambda text: text.replace("X30.", "X20."))
    assert "made before input part.nc (" in older(kerf(root, "verify", "cut.html"))
