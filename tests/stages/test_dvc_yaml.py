"""dvc.yaml against the signatures of the stages, the rooms they reach, and params.yaml."""

import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.parameters import CATALOGUES, parted, read_params, section_path, structure
from pipeline.stages.__main__ import load_stage
from pipeline.stages.index import FROZEN, TIMED
from pipeline.stages.sections import BY_HAND as SINGLE

ROOT = Path(__file__).parents[2]
DVC: dict[str, Any] = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
BY_HAND = {name if name == "promotion" else f"machine.*.{name}": wanted
           for name, wanted in SINGLE.items()}  # fmt: skip
"""Sections that no stage reads; their types by the pattern of their path."""
INDEX, MACHINE_FILE = "data/index/${item}.json", "data/settings/sections/${item}.json"


def listed(each: str, fleet: dict[str, Any]) -> list[str]:
    """Machines that a stage goes over: ``${machines}``, ``${submodels.drive}``, … of a fleet."""
    found: Any = fleet
    for key in each.removeprefix("${").removesuffix("}").split("."):
        found = found[key]
    return list(found)


FLEETS = sorted(p.stem for p in (ROOT / "conf/fleet").glob("*.yaml") if p.stem != "active")


def definition(name: str) -> dict[str, Any]:
    """A stage; where it goes over machines with their folders, the folder is ``${folder}``."""
    stage: dict[str, Any] = DVC[name]
    if "${key}" in str(stage):
        text = yaml.safe_dump(stage).replace("${item}", "${folder}").replace("${key}", "${item}")
        stage = yaml.safe_load(text)
    return stage.get("do", stage)


def paths(entries: list[Any]) -> set[str]:
    """Paths of deps or outs; an entry with options is a mapping of one key."""
    return {next(iter(e)) if isinstance(e, dict) else e for e in entries}


def parameters(stage: dict[str, Any]) -> dict[str, list[str]]:
    """Keys that a stage depends on by file: ``""`` for params.yaml."""
    entries = stage.get("params", [])
    found: dict[str, list[str]] = {"": [one for one in entries if isinstance(one, str)]}
    for one in entries:
        if isinstance(one, dict):
            found |= one
    return found


@pytest.mark.parametrize("name", DVC)
def test_the_command_gives_the_stage_its_paths(name: str) -> None:
    stage = definition(name)
    wanted = load_stage(name).paths
    words = shlex.split(stage["cmd"])
    assert words[:3] == ["python", "-m", "pipeline.stages"]
    assert words[3] == (f"{name}@${{item}}" if "foreach" in DVC[name] else name)
    given = words[4:]
    assert len(given) == len(wanted), f"{name} takes {wanted}"
    known = paths(stage.get("deps", [])) | paths(stage["outs"]) | paths(stage.get("metrics", []))
    known |= paths(stage.get("plots", []))
    known |= set(parameters(stage))
    if INDEX in parameters(stage):  # by their hashes, not as a whole
        known |= {"data/raw/${item}", "data/signals/${item}", "data/golden"}
    for path in given:
        parents = {p.as_posix() for p in Path(path).parents} | {path}
        inside = any(k == path or k.startswith(path + "/") for k in known)
        assert parents & known or inside, f"{name}: {path} is neither a dep nor an out"


@pytest.mark.parametrize("name", DVC)
def test_the_stage_declares_its_sections(name: str) -> None:
    stage = definition(name)
    sections = load_stage(name).sections
    values = read_params(ROOT / "params.yaml")
    each = DVC[name].get("foreach")
    machines = listed(each, values["fleet"]) if each else []
    if each and not machines:
        pytest.skip(f"no machine of the active fleet is in its list {each}")
    some = machines[0] if each else None
    found = {section_path(values, s, some) for s in sections}
    of_machine = parameters(stage).get(MACHINE_FILE, [])
    declared = {section_path(values, one, some) for one in of_machine}
    if "data/settings/catalogue.json" in paths(stage.get("deps", [])):
        declared |= found & set(CATALOGUES)
    if MACHINE_FILE in paths(stage.get("deps", [])):  # every section
        declared |= found
    assert declared | set(parameters(stage)[""]) == found


@pytest.mark.parametrize("name", [name for name in DVC if name != "code"])
def test_a_stage_depends_on_its_code(name: str) -> None:
    assert parameters(definition(name))["data/code.json"] == [name]


@pytest.mark.parametrize("name", DVC)
def test_the_recordings_that_a_stage_depends_on_are_those_of_its_sections(name: str) -> None:
    found = parameters(definition(name))
    named = {one for one in found.get(INDEX, []) if one not in (TIMED, FROZEN)}
    assert named <= set(found.get(MACHINE_FILE, [])), "of sections that the stage does not read"
    stage = definition(name)
    whole = {"data/raw/${item}", "data/signals/${item}"} & set(stage["cmd"].split())
    if whole - paths(stage.get("deps", [])) - paths(stage["outs"]):
        assert named, f"{name} reads recordings, and no hash says which"


@pytest.mark.parametrize("name", [name for name in DVC if name.startswith(("identify_", "judge_"))
                                  and name != "identify_monitoring"])  # fmt: skip
def test_a_fit_and_its_verdict_depend_on_what_is_frozen_of_their_machine(name: str) -> None:
    stage = definition(name)
    assert FROZEN in parameters(stage)[INDEX]
    assert "data/golden" in stage["cmd"].split()
    assert "data/golden" not in paths(stage.get("deps", [])), "a set of another machine"


def test_what_serves_is_scored_by_every_section_that_it_may_be_judged_by() -> None:
    """The night's stage looks sub-models and their limits up by name."""
    assert MACHINE_FILE in paths(definition("nightly")["deps"])
    assert MACHINE_FILE in paths(definition("state")["deps"])


FOR_ALL = ("ingest", "clean", "index", "champion", "nightly", "state", "condition")
"""Stages of every machine, whatever it has records for."""


@pytest.mark.parametrize("one", FOR_ALL)
def test_a_stage_of_every_machine_depends_on_nothing_that_only_some_have(one: str) -> None:
    """DVC refuses a dependency that no stage writes."""
    always = {path for one in FOR_ALL for path in paths(definition(one)["outs"])}
    always |= {"data/raw/${item}", "data/settings/machine/${item}.json", MACHINE_FILE}
    for dep in paths(definition(one).get("deps", [])):
        held = any(dep == out or dep.startswith(f"{out}/") or out.startswith(f"{dep}/")
                   for out in always)  # fmt: skip
        assert held or "${item}" not in dep, f"{one} depends on {dep}"


@pytest.mark.parametrize("name", [name for name in DVC if name not in FOR_ALL])
def test_what_serves_is_depended_on_by_its_folder_which_says_where_there_is_none(name: str) -> None:
    for dep in paths(definition(name).get("deps", [])):
        if dep.startswith("data/champion/${item}/"):
            assert dep.count("/") == 3, f"{name}: {dep} is a file of a model that may not serve"


def by_hand(values: dict[str, Any], pattern: str) -> list[str]:
    """Paths of the sections that ``pattern`` names, of those machines that have them."""
    if "*" not in pattern:
        return [pattern]
    name = pattern.rpartition(".")[2]
    return [
        pattern.replace("*", m) for m, sections in values["machine"].items() if name in sections
    ]


@pytest.mark.parametrize("fleet", FLEETS)
def test_every_section_of_every_machine_is_what_its_stage_asks_for(fleet: str) -> None:
    from pipeline.stages.compose import composed

    values = yaml.safe_load(composed(ROOT / "conf", (f"fleet={fleet}",)))
    used = {"fleet", "machine", "budget"}
    for name in DVC:
        sections = load_stage(name).sections
        each = DVC[name].get("foreach")
        for item in listed(each, values["fleet"]) if each else [None]:
            for section, wanted in sections.items():
                path = section_path(values, section, item)
                structure(values, path, wanted)
                used.add(path)
        if each and not listed(each, values["fleet"]):  # no machine of the fleet has records for it
            shared = {section for section in sections if section in values}
            for section in shared:
                structure(values, section, sections[section])
            used |= shared
    for pattern, wanted in BY_HAND.items():
        for path in by_hand(values, pattern):
            structure(values, path, wanted)
            used.add(path)
    sections_there = {k for k in values if k != "machine"}
    sections_there |= {f"machine.{m}.{s}" for m in values["machine"] for s in values["machine"][m]}
    assert sections_there <= used, f"no stage reads {sorted(sections_there - used)}"


def test_params_yaml_and_the_settings_are_the_composition_of_conf() -> None:
    from pipeline.stages.compose import HEADER, composed

    own, files = parted(yaml.safe_load(composed(ROOT / "conf")))
    text = (ROOT / "params.yaml").read_text()
    assert text.startswith(HEADER) and yaml.safe_load(text) == own
    folder = ROOT / "data/settings"
    assert files == {
        one.relative_to(folder).as_posix(): one.read_text() for one in folder.rglob("*.json")
    }


def test_the_lock_is_what_is_installed() -> None:
    from importlib.metadata import PackageNotFoundError, version

    lines = (ROOT / "requirements.lock").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if "==" in line and not line.startswith("#"))
    assert len(pins) > 50
    for name, pinned in pins.items():
        try:
            found = version(name)
        except PackageNotFoundError:
            continue  # a pin of an extra that is not installed
        assert found.partition("+")[0] == pinned, f"{name} {found} is installed, locked is {pinned}"


def test_the_lock_has_every_dependency() -> None:
    import re
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"].values()
    wanted = project["dependencies"] + [name for extra in extras for name in extra]
    locked = {
        line.partition("==")[0].lower().replace("_", "-")
        for line in (ROOT / "requirements.lock").read_text().splitlines()
    }
    for requirement in wanted:
        name = re.split(r"[\[<>=; ]", requirement)[0].lower().replace("_", "-")
        assert name in locked, f"{name} is not in requirements.lock"
