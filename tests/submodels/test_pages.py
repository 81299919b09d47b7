"""Every sub-model declares its page: what the frame needs of it, without any file and with few."""

import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.charts.sources import SourceRegistry
from pipeline.submodels.contract import Shown, submodel, submodels
from tests.submodels.made_pages import made


def bare(folder: Path) -> Shown:
    return Shown(machine="rig", origin="simulated", shelf=SourceRegistry(), folder=folder,
                 model=None, verdict=None, predictions=None)  # fmt: skip


@pytest.mark.parametrize("name", submodels())
def test_without_files_a_page_says_what_to_record_and_judges_nothing(name: str, tmp_path: Path):
    page = made(submodel(name), bare(tmp_path))
    assert page.verdict is None and not page.actions and not page.compared
    (section,) = page.sections
    assert "model.json" in section.text[0] and submodel(name).needs.rstrip(".") in section.text[0]


@pytest.mark.parametrize("name", submodels())
def test_a_declared_page_says_what_it_is_how_it_is_judged_and_what_to_do(name: str, tmp_path: Path):
    content = submodel(name).page(bare(tmp_path))
    if content is None:
        return
    assert content.rules.endswith(".") and content.counts
    assert set(content.todo) == {"passed", "failed", "unknown"}
    assert all(one.rstrip().endswith(".") for one in content.todo.values())
    assert "record" in content.case or content.case in ("day", "run", "tool")
    assert not content.guess or content.guess in content.titles


def test_figures_for_the_next_report_have_keys_of_their_own(tmp_path: Path):
    keys = [one.key for name in submodels()
            if (content := submodel(name).page(bare(tmp_path))) is not None
            for one in content.counts]  # fmt: skip
    assert len(keys) == len(set(keys)) and all(keys)


def test_no_page_imports_torch():
    code = (
        "import sys; from importlib import import_module;"
        "from pipeline.submodels.contract import submodels;"
        "[import_module(f'pipeline.submodels.{n}.page') for n in submodels()];"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
