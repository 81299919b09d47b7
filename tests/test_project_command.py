"""The distribution kerf-twin and its wheel; a project outside of the checkout, run by it."""

import os
import re
import shutil
import site
import subprocess
import sys
import tomllib
import venv
from pathlib import Path
from zipfile import ZipFile

import pytest
import yaml

from pipeline.app.project import CODE, new_project
from pipeline.parameters import read_params
from pipeline.registry.provenance import requirements
from pipeline.submodels.contract import submodels
from tests.test_cli import refused

ROOT = Path(__file__).parents[1]
TAKEN = ("pipeline", "conf", "dvc.yaml", "pyproject.toml", "README.md", "LICENSE")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Kerf's wheel, built from a copy of what it takes."""
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in TAKEN:
        place = ROOT / name
        if place.is_dir():
            shutil.copytree(
                place, source / name, ignore=shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
            )
        else:
            shutil.copy(place, source / name)
    code = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
    subprocess.run(
        [sys.executable, "-c", code, str(folder)], cwd=source, check=True, capture_output=True
    )
    (built,) = folder.glob("kerf_twin-*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Commands of a fresh environment with the wheel; what it needs is borrowed from ours."""
    folder = tmp_path_factory.mktemp("installed")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q"]
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv/bin/python"
    subprocess.run([*pip, "--python", str(python), "install", "--no-deps", str(wheel)], check=True)
    (own,) = (folder / "venv/lib").glob("python*/site-packages")
    (own / "borrowed.pth").write_text("\n".join(site.getsitepackages()) + "\n")
    return folder / "venv/bin"


def run(bin_: Path, *words: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    path = f"{bin_}{os.pathsep}{os.environ['PATH']}"
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"PATH": path}
    return subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)


def test_a_wheel_holds_the_code_its_templates_and_what_a_project_is_made_of(wheel: Path) -> None:
    with ZipFile(wheel) as packed:
        held = {name.partition("data/data/")[2] or name for name in packed.namelist()}
    ends = (".py", ".j2", ".css", ".toml", "loops.json")
    code = {p.relative_to(ROOT).as_posix() for p in (ROOT / "pipeline").rglob("*.*")
            if p.name.endswith(ends)}  # fmt: skip
    conf = {p.relative_to(ROOT).as_posix() for p in (ROOT / "conf").rglob("*.yaml")}
    assert code | {f"share/kerf-twin/{name}" for name in conf | {"dvc.yaml"}} <= held


@pytest.mark.proof
def test_a_project_of_an_installed_kerf_is_composed_and_built(
    installed: Path, tmp_path: Path
) -> None:
    kerf, python = str(installed / "kerf"), str(installed / "python")
    where = run(installed, python, "-c", "import pipeline; print(pipeline.__file__)", cwd=tmp_path)
    assert str(installed.parent) in where.stdout  # not the checkout's
    made = run(installed, kerf, "init", "shop", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    assert made.stdout == "made shop: `cd shop` and `dvc repro`\n"
    project = tmp_path / "shop"
    before = run(installed, kerf, "-C", "shop", "status", cwd=tmp_path)
    assert before.returncode == 0 and "mill00" in before.stdout, before.stderr
    built = run(installed, python, "-m", "dvc", "repro", "-q", "compose", cwd=project)
    assert built.returncode == 0, built.stderr
    params = read_params(project / "params.yaml")
    assert params["fleet"]["name"] == "demo" and "mill00" in params["machine"]
    graph = run(installed, python, "-m", "dvc", "status", "report", cwd=project)
    assert graph.returncode == 0, graph.stderr  # every stage resolves without the checkout's files
    said = run(installed, kerf, "-C", "shop", "status", cwd=tmp_path)
    assert said.returncode == 0, said.stderr
    assert "mill00" in said.stdout and "not built" in said.stdout


def test_a_project_is_brought_up_and_keeps_its_own_conf(tmp_path: Path) -> None:
    project = tmp_path / "shop"
    assert new_project(project) == "made"
    (project / "conf/budget/default.yaml").write_text("# mine\n")
    (project / "dvc.yaml").write_text("stages: {}\n")
    (project / CODE).write_text("0.0.1\n")
    assert new_project(project) == "brought up"
    assert (project / "conf/budget/default.yaml").read_text() == "# mine\n"
    assert "kerf-twin" not in (project / CODE).read_text() != "0.0.1\n"
    stages = yaml.safe_load((project / "dvc.yaml").read_text())["stages"]
    ours = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    assert list(stages) == list(ours)
    assert stages.pop("code")["deps"] == [CODE]  # in place of the checkout's code
    assert ours.pop("code")["deps"] == ["pipeline"]
    assert stages == ours


def test_a_folder_that_holds_something_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(ValueError, match="is no empty folder and no project of Kerf"):
        new_project(tmp_path)
    with pytest.raises(ValueError, match="is no empty folder"):
        new_project(tmp_path / "letter.txt")
    assert [p.name for p in tmp_path.iterdir()] == ["letter.txt"]


def test_a_project_that_is_not_there_is_said_in_one_sentence(tmp_path: Path) -> None:
    said = refused(tmp_path, "-C", "nowhere", "status")
    assert "nowhere is no folder: `kerf init nowhere` makes a project" in said


@pytest.mark.proof
def test_a_mixed_fleet_goes_through_and_each_machine_gets_what_it_can(tmp_path: Path) -> None:
    """A simulated machine, one without any sub-model, and a recorded one where its records are."""
    kerf, dvc = ([sys.executable, "-m", one] for one in ("pipeline.app", "dvc"))
    project = tmp_path / "shop"
    new_project(project)
    (project / "tables").mkdir()
    rows = "".join(f"2026-01-05T06:{k // 60:02d}:{k % 60:02d}Z,{30 + k % 7}\n" for k in range(600))
    (project / "tables/cabinet.csv").write_text(f"Time,Cabinet\n,degC\n{rows}")
    recorded = ["emps"] * (Path(os.environ.get("KERF_RECORDINGS", "nowhere")) / "emps").is_dir()
    machines = [*recorded, "mill00", "lathe7"]
    lists: dict[str, list[str]] = {one: [] for one in submodels()}
    fleet = {"name": "mixed", "chosen_budget": "quick", "machines": machines,
             "simulated": ["mill00"], "submodels": lists | {"control": ["mill00"],
             "drive": recorded}, "drives_under": {}, "optimised": [], "trials": []}  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}

    def done(*words: str) -> str:
        answer = subprocess.run(
            words, cwd=project, env=environment, capture_output=True, text=True, check=False
        )
        assert answer.returncode == 0, f"{words}: {answer.stdout[-2000:]}{answer.stderr[-2000:]}"
        return answer.stdout

    done(*kerf, "machine", "new", "lathe7", "--logs", "tables")
    (project / "conf/fleet/mixed.yaml").write_text(yaml.safe_dump(fleet))
    done(*kerf, "fleet", "mixed")
    done(*dvc, "repro", "champion@lathe7")  # one stage alone, on nothing built
    assert (project / "data/champion/lathe7/control/none.json").is_file()
    done(*dvc, "repro")
    for name in machines[:-1]:
        assert (project / f"data/champion/{name}/bundle.json").is_file()
    bare = (project / "reports/lathe7.html").read_text()
    assert "The fleet names no sub-model of this machine" in bare
    assert "version 1" in done(*kerf, "status")


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
