"""kerf transfer --page: both files or none, a curve for each of the parameters, what it refuses."""

import re
from collections.abc import Callable
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.app import transfer as command
from pipeline.app.commands import app
from pipeline.app.transfer import transfer_page, write_transfer_page
from pipeline.schema.store import read_json
from pipeline.submodels.spindle.transfer import Transfer, TransferPoint, leader
from tests.browser import foreign, look, needs_browser, requests
from tests.report.page_reader import outline, section, words
from tests.small_project import inside
from tests.submodels.spindle.test_transfer import small_transfer

GOLDEN, OWN, POOLED = "batch", "before", "after"
HOSTILE = "<script>document.title='owned'</script>"


def transferred(*rows: tuple[float, float | None, float], origin: str = "recorded") -> Transfer:
    """A curve of pooled, own and golden errors, a row each length of the record."""
    points = tuple(
        TransferPoint(minutes=15.0 * 2**i, pooled=p, own=o, golden=g)
        for i, (p, o, g) in enumerate(rows)
    )
    return Transfer(
        machine="sibling", golden="first", origin=origin, days_judged=("2026-01-19",),
        resolution_K=1.0, points=points, pooled={}, not_transferred=(),
        sentence=leader(points, 1.0),
    )  # fmt: skip


def written(found: Transfer, folder: Path) -> Path:
    write_transfer_page(found, folder / "page.html")
    return folder / "page.html"


def drawn(page: Path, kind: str) -> list[int]:
    """Corners of each curve of a CSS class in the figure, legend left out."""
    figure = re.search(r"<figure .*?</figure>", page.read_text(), flags=re.S)
    assert figure
    paths = re.findall(rf'<path d="([^"]*)" class="curve {kind}">', figure.group())
    return [1 + len(path.partition("l")[2].split()) // 2 for path in paths]


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_transfer(tmp_path_factory.mktemp("transfer") / "project")


def run(project: Path, *given: str) -> tuple[int, str]:
    with inside(project):
        done = CliRunner().invoke(app, ["transfer", "-m", "mill02", "--golden", "mill01", *given])
    return done.exit_code, done.output


@pytest.fixture(scope="module")
def project(template: Path) -> Path:
    """With the curve and its page written."""
    status, said = run(template, "--out", "curve.json", "--page", "curve.html")
    assert status == 0, said
    assert "wrote curve.json, curve.html" in said
    return template


def test_the_command_writes_the_page_of_its_curve(project: Path) -> None:
    page, found = project / "curve.html", read_json(project / "curve.json", Transfer)
    said = words(page)
    assert found.sentence.replace("'", "’") in said
    for one in found.points:
        assert all(f"{v:.2f}" in section(page, "curve") for v in (one.pooled, one.own, one.golden))
    for file in ("curve.json", "data/models/mill01/spindle/model.json",
                 "data/signals/mill02/manifest.json"):  # fmt: skip
        assert f"{file} sha256 {sha256((project / file).read_bytes()).hexdigest()[:12]}" in said
    assert "Simulated records" in said  # the credit


def test_the_figure_has_a_curve_through_every_point_of_each_parameters(
    project: Path, tmp_path: Path
) -> None:
    page, count = project / "curve.html", len(read_json(project / "curve.json", Transfer).points)
    assert [len(drawn(page, kind)) for kind in (POOLED, OWN, GOLDEN)] == [1, 1, 1]
    for kind in ("p-after", "p-before", "p-knee"):
        assert page.read_text().count(f'class="point {kind}"') == count
    rows = ((1.0, 9.0, 4.0), (2.0, 8.0, 5.0), (4.0, 6.0, 6.0))  # no level stretch to be merged
    page = written(transferred(*rows), tmp_path)
    assert [drawn(page, kind) for kind in (POOLED, OWN, GOLDEN)] == [[3], [3], [3]]


def test_points_stand_by_the_logarithm_of_minutes_and_by_the_error(tmp_path: Path) -> None:
    page = written(transferred((1.0, 9.0, 4.0), (2.0, 8.0, 5.0), (4.0, 6.0, 6.0)), tmp_path)
    found = re.findall(r'<circle cx="([0-9.]+)%" cy="([0-9.]+)" r="4" class="point p-after">',
                       page.read_text())  # fmt: skip
    x, y = ([float(one) for one in ends] for ends in zip(*found, strict=True))
    assert x == pytest.approx([0.0, 50.0, 100.0])  # 15, 30 and 60 minutes
    assert y[1] - y[2] == pytest.approx(2 * (y[0] - y[1]), abs=0.03)  # two decimals of a pixel


def test_simulated_is_said_at_head_figure_and_table_and_of_nothing_recorded(
    project: Path, tmp_path: Path
) -> None:
    label = 'class="label simulated"'
    assert (project / "curve.html").read_text().count(label) == 3
    page = written(transferred((1.0, 2.0, 3.0)), tmp_path)
    assert label not in page.read_text() and "simulated" not in words(page).lower()


@pytest.mark.parametrize(
    ("rows", "status", "word"),
    [
        (((1.0, 4.0, 3.0), (1.0, 4.0, 3.0)), "passed", "pooled leads"),
        (((4.0, 1.0, 3.0), (4.0, 1.0, 3.0)), "attention", "own record leads"),
        (((4.0, None, 1.0), (4.0, None, 1.0)), "attention", "golden leads"),
        (((1.0, 1.5, 1.2), (1.0, 1.5, 1.2)), "unknown", "none leads"),
        (((4.0, 4.0, 4.0), (1.0, 4.0, 4.0)), "unknown", "none leads"),  # once only
    ],
)
def test_who_leads_is_said_only_where_the_curve_says_so(
    rows: tuple[tuple[float, float | None, float], ...], status: str, word: str
) -> None:
    page = transfer_page(transferred(*rows), [])
    assert (page.status, page.word) == (status, word)


def test_a_record_that_alone_gives_nothing_leaves_its_curve_open(tmp_path: Path) -> None:
    rows = ((1.0, None, 3.0), (1.0, 4.0, 3.0), (1.0, 5.0, 3.0))
    page = written(transferred(*rows), tmp_path)
    assert (drawn(page, OWN), drawn(page, POOLED)) == ([2], [2])  # level ones have two ends
    assert page.read_text().count('class="point p-before"') == 2
    assert "alone gives no parameters with 15 minutes" in words(page)


def test_heat_sources_without_a_golden_parameter_are_named(tmp_path: Path) -> None:
    found = transferred((1.0, 2.0, 3.0))
    assert "lacking" not in words(written(found, tmp_path))
    page = written(replace(found, not_transferred=("position_hold",)), tmp_path)
    assert "position hold" in section(page, "lacking")


def test_names_of_machines_are_text(tmp_path: Path) -> None:
    page = written(replace(transferred((1.0, 2.0, 3.0)), machine=HOSTILE), tmp_path)
    assert not [tag for tag, _ in outline(page).tags if tag == "script"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--out", "a.json", "--page", "./a.json"), "a.json is named for two outputs"),
        (("--out", "a.json", "--page", "none/a.html"), "none does not exist: make that folder"),
        (("--out", "a.json", "--page", "data"), "data is a folder: name a file in it"),
        (("--out", "a.json", "--page", "conf/a.html"), "conf/a.html is in conf, which is read"),
        (("--out", "a.json", "--page", "data/models/mill01/spindle/model.json"),
         "model.json is read: name another file"),
        (("--out", "data/clean/mill02/state/2026-01-05.parquet"),
         "2026-01-05.parquet is read: name another file"),
        (("--out", "a.json", "--page", "/proc/a.html"), "/proc/a.html cannot be written"),
    ],
)  # fmt: skip
def test_outputs_replace_nothing(template: Path, given: tuple[str, ...], said: str) -> None:
    before = {p: p.read_bytes() for p in template.rglob("*") if p.is_file()}
    status, sentence = run(template, *given)
    assert status == 2 and said in sentence and sentence.count("\n") == 1, sentence
    assert {p: p.read_bytes() for p in template.rglob("*") if p.is_file()} == before


def test_a_page_that_fails_leaves_the_old_curve(
    project: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command, "write_transfer_page", full)
    before = {p: p.read_bytes() for p in project.iterdir() if p.is_file()}
    status, said = run(project, "--out", "curve.json", "--page", "curve.html", "--between", "0.1")
    assert status == 2 and "No space left" in said
    assert {p: p.read_bytes() for p in project.iterdir() if p.is_file()} == before


def full(*given: object) -> None:
    """A full disk."""
    raise OSError(28, "No space left on device")


@needs_browser
@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_the_screen_and_loads_nothing(browser, project: Path, width: int) -> None:
    look(browser, project / "curve.html", width, "light")
    assert foreign(requests(browser)) == [] and browser.get_log("browser") == []
    seen: Callable[[str], float] = browser.execute_script
    root = "document.documentElement"
    assert seen(f"return {root}.scrollWidth - {root}.clientWidth") <= 0
