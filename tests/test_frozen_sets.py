"""Every sub-model of every machine has golden and sealed records, or too little to freeze."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.app.fleet import _composed, collect, use_fleet
from pipeline.app.frozen_cases import lacking, sealed_of
from pipeline.schema.golden import FrozenSet, read_golden
from pipeline.schema.model import SourceFile
from pipeline.schema.verdict import Fact
from pipeline.signals.conditions import selection
from pipeline.stages.__main__ import run
from pipeline.stages.index import is_named, texts
from pipeline.submodels.cases import Case, Cases
from tests.small_project import ROOT, inside, leave, with_conf

RECORDINGS = os.environ.get("KERF_RECORDINGS")
TOO_LITTLE = {
    ("emps", "drive"): {"golden", "sealed"},
    ("emps", "following_residual"): {"golden", "sealed"},
    ("kistler_slot", "cutting"): {"golden", "sealed"},
    ("mill00", "deformation"): {"sealed"},
    ("mill00", "synthesis"): {"sealed"},
    ("mill00", "wear"): {"sealed"},
}
"""Sets for which a sub-model has too few records: under four groups, or all are learnt from."""
SECTIONS = {"synthesis": "wear_records"}


def fleets() -> dict[str, list[str]]:
    """Sub-models of each machine of the fleets."""
    found: dict[str, list[str]] = {}
    for path in sorted((ROOT / "conf/fleet").glob("*.yaml")):
        for name, machines in yaml.safe_load(path.read_text())["submodels"].items():
            for machine in machines:
                if name not in found.setdefault(machine, []):
                    found[machine].append(name)
    return found


@pytest.fixture(scope="module")
def machines() -> Any:
    with inside(ROOT):
        return _composed(f"fleet.machines={sorted(fleets())}")["machine"]


def frozen_of(name: str, frozen: FrozenSet | None, settings: Any) -> bool:
    """Whether a set holds a record that the settings of a sub-model name."""
    if frozen is None:
        return False
    if name == "spindle":
        return frozen.days is not None
    patterns = texts(settings[SECTIONS.get(name, f"{name}_records")])
    return any(is_named(selection(one.file)[0], patterns) for one in frozen.files)


@pytest.mark.parametrize("machine", fleets())
def test_each_sub_model_has_both_sets_or_too_little(machine: str, machines: Any) -> None:
    sets = read_golden(ROOT / f"data/golden/{machine}.json")
    for name in fleets()[machine]:
        missing = {
            which for which in ("golden", "sealed")
            if sets is None or not frozen_of(name, getattr(sets, which), machines[machine])
        }  # fmt: skip
        assert missing == TOO_LITTLE.get((machine, name), set()), name


def test_no_file_is_in_both_sets() -> None:
    for path in (ROOT / "data/golden").glob("*.json"):
        sets = read_golden(path)
        assert sets is not None and sets.golden is not None and sets.machine == path.stem
        if sets.sealed is not None:
            golden = {one.file for one in sets.golden.files}
            assert not golden & {one.file for one in sets.sealed.files}, path.stem


def case(name: str, role: Any = "held_out", *, file: str = "", **conditions: float) -> Case:
    source = SourceFile(file=file or f"{name}.csv", sha256=file or name)
    facts = {key: Fact(value=value) for key, value in conditions.items()}
    return Case(name=name, group=name, role=role, files=(source,), load=str, conditions=facts)


def test_one_group_of_four_is_sealed_and_none_that_golden_ones_cannot_replace() -> None:
    plain = {name: [case(name)] for name in "abcdefgh"}
    assert sealed_of(plain) == {"d", "h"}
    assert sealed_of({name: plain[name] for name in "abc"}) == set()
    axes = {name: [case(name, X=1.0)] for name in "abc"} | {"d": [case("d", X=1.0, Z=1.0)]}
    assert sealed_of(axes) == {"c"}  # Z moves in d alone
    days = {f"2026-01-{day}": [case(f"2026-01-{day}")] for day in range(10, 19)}
    assert sealed_of(days) == {"2026-01-17", "2026-01-18"}


def test_what_is_too_little_to_freeze_says_why() -> None:
    three = tuple(case(name) for name in "abc")
    assert lacking(Cases(cases=three)).startswith("too little to freeze: 3 groups that nothing")
    frozen = tuple(replace(one, role="golden") for one in three)
    assert lacking(Cases(cases=frozen)).startswith("too little to seal: 3 groups")
    both = (*frozen, case("d", "sealed"))
    assert lacking(Cases(cases=both)) == ""
    assert "freeze them with `kerf golden --split`" in lacking(Cases(cases=(*three, case("d"))))
    learnt = case("t", "training", file="one.mat#begin")
    part = case("u", file="one.mat#end")
    assert "0 groups" in lacking(Cases(cases=(learnt, part)))
    tools = tuple(case(f"t{k}", file=f"cuts.csv#tool={k}") for k in range(4))
    assert "4 groups" in lacking(Cases(cases=(case("t9", "training", file="cuts.csv#tool=9"),
                                              *tools)))  # fmt: skip


@pytest.mark.slow
@pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings")
@pytest.mark.parametrize("machine", ["umich_mill", "uniwear", "emps"])
def test_the_command_freezes_what_stands_in_the_repository(machine: str, tmp_path: Path) -> None:
    """Of whole files, of parts of a table, and of one recording, which cannot be frozen."""
    with_conf(tmp_path, "recorded")
    leave(tmp_path, "recorded", machine)
    shutil.copy(ROOT / "champions.json", tmp_path)
    with inside(tmp_path):
        fleet = replace(use_fleet("recorded"), machines=(machine,), submodels={}, optimised=())
        list(collect(fleet, Path(RECORDINGS or "")))
        run("compose", "conf", "params.yaml", "data/settings")
        run(f"ingest@{machine}", f"data/raw/{machine}", f"data/signals/{machine}")
        (tmp_path / "data/golden").mkdir(exist_ok=True)
        done = CliRunner().invoke(app, ["golden", "-m", machine, "--split", "--json", "-"])
    assert done.exit_code == 0, done.output
    mine, theirs = (root / f"data/golden/{machine}.json" for root in (tmp_path, ROOT))
    assert read_golden(mine) == read_golden(theirs)
    rows = {one["submodel"]: one for one in json.loads(done.stdout)["submodels"]}
    assert set(rows) == set(fleets()[machine])
    for name, row in rows.items():
        lacks = (machine, name) in TOO_LITTLE
        assert row["lacking"].startswith("too little to freeze") if lacks else not row["lacking"]
        assert lacks or (row["golden"] >= 3 and row["sealed"] >= 1)
