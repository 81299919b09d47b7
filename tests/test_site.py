"""The documentation as a site: no broken link, nothing from elsewhere, notebooks with plots."""

import json
import re
import subprocess
import sys
from importlib import util
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).parents[1]
HOST = re.compile(r"""(?:src|href)=["']?(?:https?:)?//[^"'\s>]+\.(?:js|css|woff2?|png|svg|jpg)""")


SHORT = ("thermal", "search")
"""Folders of the package whose reference is written in the ordinary suite."""


def written(source: Path, folder: Path) -> Path:
    """The site of the project in ``source``, without a warning."""
    answer = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder],
        cwd=source, capture_output=True, text=True, check=False,
        env={"PATH": "", "KERF_NOTEBOOKS": "no", "NO_MKDOCS_2_WARNING": "1", "HOME": str(folder)},
    )  # fmt: skip
    assert answer.returncode == 0, answer.stdout + answer.stderr
    return folder


@pytest.fixture(scope="module", params=[SHORT, pytest.param((), marks=pytest.mark.proof)],
                ids=["two rooms", "all"])  # fmt: skip
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All pages with the reference of a few folders, or of all."""
    folder, source = tmp_path_factory.mktemp("site"), ROOT
    if request.param:
        source = tmp_path_factory.mktemp("short")
        (source / "pipeline").mkdir()
        names = ("docs", "notebooks", "mkdocs.yml", "README.md", "CHANGELOG.md", "CONTRIBUTING.md")
        rooms = (f"pipeline/{name}" for name in ("__init__.py", *request.param))
        for name in (*names, *rooms):
            (source / name).symlink_to(ROOT / name)
    return written(source, folder)


def test_every_page_and_notebook_is_there(site: Path) -> None:
    pages = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md")}
    assert {page.with_suffix(".html") for page in pages} <= {
        path.relative_to(site) for path in site.rglob("*.html")
    }
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        assert "Not run" in (site / f"notebooks/{notebook.stem}.html").read_text()
    assert "twin" in (site / "index.html").read_text()


def test_settings_and_schemas_are_made(site: Path) -> None:
    assert "position_gain" in (site / "settings.html").read_text()
    assert json.loads((site / "schema/machine.json").read_text())["$defs"]


def test_validation_shows_the_figures_of_every_machine(site: Path) -> None:
    metrics = sorted((ROOT / "data/metrics").glob("*_drive.json"))
    page = (site / "validation/drive.html").read_text()
    for path in metrics:
        machine = path.stem.removesuffix("_drive")
        assert machine in page
        assert f"{json.loads(path.read_text())['force X']['rmse']:.3g}" in page
    assert "mill01 (simulated)" in page and "emps (simulated)" not in page


def test_the_reference_shows_units_and_shapes(site: Path) -> None:
    text = (site / "reference/thermal.html").read_text()
    assert "heat_sources" in text and "Spindle speed [rad/s]" in text


def test_no_page_loads_from_another_host(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    written_out = [*(ROOT / "docs").glob("*.md"), *(ROOT / "notebooks").glob("*.ipynb")]
    assert len(pages) > len(written_out)  # and the reference
    assert not [(page, found[0]) for page in pages if (found := HOST.search(page.read_text()))]


def test_a_notebook_that_runs_becomes_a_page_with_its_plots(tmp_path: Path) -> None:
    spec = util.spec_from_file_location("notebook_pages", ROOT / "docs/site/notebook_pages.py")
    assert spec is not None and spec.loader is not None
    pages = util.module_from_spec(spec)
    spec.loader.exec_module(pages)
    v4 = nbformat.v4
    plot = "import matplotlib.pyplot as plt\nplt.plot([1, 2])\nplt.show()\nprint(6 * 7)"
    cells = [
        v4.new_markdown_cell("# How long?\n\nShort."),
        v4.new_code_cell(plot),
    ]
    path = tmp_path / "01_how_long.ipynb"
    nbformat.write(v4.new_notebook(cells=cells), path)
    text, pictures = pages.rendered(path)
    assert text.startswith("# How long?") and "```text\n42\n```" in text
    assert "Not run" not in text and "![Figure 1](01_how_long-1.png)" in text
    assert pictures["01_how_long-1.png"].startswith(b"\x89PNG")
    cells[1].source = "open('records.parquet')"
    nbformat.write(v4.new_notebook(cells=cells), path)
    text, pictures = pages.rendered(path)
    assert "run `make repro`" in text and not pictures
    cells[1].source = "1 / 0"
    nbformat.write(v4.new_notebook(cells=cells), path)
    with pytest.raises(pages.CellExecutionError, match="ZeroDivisionError"):
        pages.rendered(path)
