"""Hashes of the code of the stages: what they run changes them, what is only said does not."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.stages.code import (
    VERBS,
    Module,
    _beside,
    fingerprints,
    modules,
    reached,
    stages,
)
from tests.small_project import ROOT

SOURCES = {
    "__init__.py": "",
    "stages/__init__.py": "",
    "stages/identify.py": "from house.submodels.contract import fit\n",
    "stages/clean.py": "from importlib import import_module\n\n\ndef clean(form):\n"
    "    return import_module(f'house.readers.{form}')\n",
    "stages/report.py": "from house.charts import bars\n",
    "submodels/__init__.py": "",
    "submodels/contract.py": "from importlib import import_module\n\n\ndef fit(name):\n"
    "    return import_module(f'house.submodels.{name}.submodel')\n",
    "submodels/drive/__init__.py": "",
    "submodels/drive/submodel.py": "from typing import TYPE_CHECKING\n"
    "from house.physics import mass\n"
    "if TYPE_CHECKING:\n    from house import typed\n\n\n"
    "class Drive:\n    def page(self):\n"
    "        from house.submodels.drive import page\n"
    "        return page\n",
    "submodels/drive/page.py": "from house.charts import bars\n",
    "physics.py": "mass = 2.0\n'Of the table [kg].'\n",
    "typed.py": "a = 1\n",
    "charts/__init__.py": "bars = 1\n",
    "charts/frame.css": "body {}\n",
    "readers/__init__.py": "",
    "readers/csv.py": "a = 1\n",
}
DRIVE = {"identify_drive", "judge_drive"}


@pytest.fixture
def house(tmp_path: Path) -> Path:
    for name, text in SOURCES.items():
        path = tmp_path / "house" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "house"


@pytest.mark.parametrize(
    ("name", "text", "changed"),
    [
        ("physics.py", '"""Physics."""\n\n# weighed\nmass = 2.0\n"""Mass [kg]."""\n', set()),
        ("physics.py", "mass = 2.1\n", {*DRIVE, "report"}),
        ("typed.py", "a = 2\n", set()),
        ("submodels/drive/page.py", "from house.charts import bars\nwide = bars\n", {"report"}),
        ("charts/__init__.py", "bars = 2\n", {"report"}),
        ("charts/frame.css", "body {margin: 0}\n", {"report"}),
        ("readers/csv.py", "a = 2\n", {"clean"}),
        ("readers/json.py", "a = 1\n", {"clean"}),
        ("submodels/contract.py", "def fit(name):\n    return name\n", DRIVE),
    ],
)
def test_a_change_is_that_of_the_stages_that_run_it(
    house: Path, name: str, text: str, changed: set[str]
) -> None:
    before = fingerprints(house)
    (house / name).write_text(text)
    after = fingerprints(house)
    assert {one for one in before if before[one] != after[one]} == changed


@pytest.fixture(scope="module")
def known() -> dict[str, Module]:
    return modules(ROOT / "pipeline")


@pytest.mark.parametrize(
    "name",
    [
        "optimise",
        *(
            pytest.param(one, marks=pytest.mark.proof)
            for one in ("identify_following_residual", "judge_cutting")
        ),
    ],
)
def test_what_a_stage_imports_is_part_of_its_hash(name: str, known: dict[str, Module]) -> None:
    """Python itself says which of our modules stand loaded once the stage is."""
    code = f"from pipeline.stages.__main__ import load_stage\nload_stage({name!r})\n" + (
        "import sys\nprint(*[one for one in sys.modules if one.startswith('pipeline')])"
    )
    told = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    entries = stages(known, "pipeline")
    runner = reached(known, ["pipeline.stages.__main__"], shown=True)
    mine = reached(known, entries[name], shown=not name.startswith(VERBS))
    assert set(told.stdout.split()) <= mine | runner


def test_a_template_belongs_to_its_package_alone(tmp_path: Path) -> None:
    """In a folder below that is no package it is that of the nearest package above."""
    package = tmp_path / "house"
    for folder in (package, package / "report"):
        folder.mkdir()
        (folder / "__init__.py").touch()
    template = package / "report/templates/page.j2"
    template.parent.mkdir()
    template.write_text("one")
    before = [_beside(package, name) for name in ("house", "house.report")]
    template.write_text("two")
    after = [_beside(package, name) for name in ("house", "house.report")]
    assert before[0] == after[0] and before[1] != after[1]
