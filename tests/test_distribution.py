"""The distribution is ``kerf-twin``: the name ``kerf`` is somebody else's on PyPI."""

import re
import tomllib
from pathlib import Path

from pipeline.registry.provenance import requirements
from pipeline.submodels.contract import submodels

ROOT = Path(__file__).parents[1]
ANOTHERS = re.compile(
    r"""\bkerf(\[|\s*(==|~=|>=|<=|@\s*(git|https?|file)))  # a requirement: kerf[stl], kerf==1.0
    |install\s+(-\S+\s+)*["']?kerf(?!-twin)\b              # pip install kerf
    |version\(["']kerf["']\)                               # importlib.metadata""",
    re.VERBOSE,
)
READ = {".py", ".md", ".toml", ".lock", ".yaml", ".json", ".ipynb", ".j2", ".txt", ""}


def test_the_distribution_is_kerf_twin_and_the_command_kerf() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["name"] == "kerf-twin"
    assert project["scripts"] == {"kerf": "pipeline.app:main"}


def test_no_requirement_names_kerf() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    asked = project["dependencies"] + [line for extra in extras for line in extra]
    asked += (ROOT / "requirements.lock").read_text().splitlines()
    asked += requirements(submodels(), ROOT)  # of a bundle
    assert len(asked) > 100
    assert not [line for line in asked if re.match(r"kerf\b", line, re.IGNORECASE)]


def test_no_message_or_page_asks_for_a_package_called_kerf() -> None:
    assert ANOTHERS.search("pip install 'kerf[tdms]'") and ANOTHERS.search("install kerf[stl]")
    assert not ANOTHERS.search("pip install -e '.[tdms]'")
    places = [ROOT / name for name in ("pyproject.toml", "Makefile", "README.md", ".ci/run")]
    for room in ("pipeline", "docs", "conf", "notebooks"):
        places += [f for f in sorted((ROOT / room).rglob("*")) if f.suffix in READ and f.is_file()]
    assert len(places) > 300
    assert not [str(f) for f in places if ANOTHERS.search(f.read_text(encoding="utf-8"))]
