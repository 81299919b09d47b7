"""The runner of stages: what is asked wrongly is one sentence and exit status 2."""

import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from pipeline.champions.serving import NO_SUBMODEL, status
from pipeline.fleet import Fleet
from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.model import Model, SourceFile
from pipeline.schema.store import write_json
from pipeline.stages import __main__ as stage_runner
from pipeline.stages.__main__ import Entry, line, load_stage, place, run, running
from pipeline.stages.champion import champion
from pipeline.stages.identify import identify
from pipeline.stages.inputs import HASHED_BYTES, declared, items, written_by
from pipeline.submodels.cases import Case, Cases, Records, Roles, role_of
from tests.small_project import ROOT


def params(folder: Path, *, own: dict[str, object] | None = None, **cleaning: object) -> None:
    """params.yaml of one machine with the sections of the stage clean."""
    machine = {"mapping": {"signals": {}}, **({"cleaning": own} if own else {})}
    values = {"cleaning": cleaning, "machine": {"mill": machine}}
    (folder / "params.yaml").write_text(yaml.safe_dump(values))


def called(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pipeline.stages", *words],
        cwd=folder,
        env={"PYTHONPATH": str(ROOT), "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )


def test_bad_input_is_one_sentence_and_exit_status_2(tmp_path: Path) -> None:
    params(tmp_path, periodd_s=2.0)
    found = called(tmp_path, "clean@mill", "signals", "clean")
    assert found.returncode == 2
    assert found.stderr.count("\n") == 1
    assert found.stderr.startswith("clean@mill: params.yaml, ")
    assert "periodd_s" in found.stderr
    assert "@ cleaning" in found.stderr


def test_no_stage_is_a_usage_and_exit_status_2(tmp_path: Path) -> None:
    found = called(tmp_path)
    assert found.returncode == 2
    assert found.stderr == "usage: python -m pipeline.stages NAME[@MACHINE] PATH...\n"


@pytest.mark.parametrize("name", ["cleen", "__main__", "", "../cli", "clean.py"])
def test_a_stage_that_is_not_there_is_refused_with_those_that_are(name: str) -> None:
    with pytest.raises(ValueError, match=r"there is no stage .*clean, code, compose, .*identify_"):
        load_stage(name)


@pytest.mark.parametrize("paths", [(), ("a",), ("a", "b", "c")])
def test_the_number_of_paths_is_the_stages(paths: tuple[str, ...]) -> None:
    with pytest.raises(
        ValueError, match=rf"clean takes 2 paths \(signals, clean\), {len(paths)} given"
    ):
        run("clean@mill", *paths)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_missing_and_unknown_keys_are_named_with_their_paths(here: Path) -> None:
    params(here, period_s=0.5)
    values = yaml.safe_load((here / "params.yaml").read_text())
    del values["machine"]["mill"]["mapping"]
    (here / "params.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(ValueError, match="no section mapping"):
        run("clean@mill", "signals", "clean")
    values["machine"]["mill"]["mapping"] = {"signals": {}, "sygnals": {}}
    (here / "params.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(ValueError, match=r"sygnals.*@ machine\.mill\.mapping"):
        run("clean@mill", "signals", "clean")


def test_a_machine_that_is_not_in_the_fleet_is_named(here: Path) -> None:
    params(here)
    with pytest.raises(ValueError, match=r"no section machine\.mil, known machines are \['mill'\]"):
        run("clean@mil", "signals", "clean")


def test_the_machines_section_is_preferred_to_the_one_of_all(here: Path) -> None:
    """The machine's own is wrong, that of all is right: the error names the machine's."""
    params(here, own={"period_s": "slow"}, period_s=1.0)
    with pytest.raises(ValueError, match=r"'slow' is no .* @ machine\.mill\.cleaning\.period_s"):
        run("clean@mill", "signals", "clean")


def test_a_stage_gets_paths_and_sections(here: Path) -> None:
    """compose has no section, so it needs no params.yaml: it writes one."""
    assert not (here / "params.yaml").exists()
    run("compose", str(ROOT / "conf"), str(here / "params.yaml"), str(here / "data/settings"))
    assert "fleet" in yaml.safe_load((here / "params.yaml").read_text())
    stage = load_stage("clean")
    assert stage.paths == ["signals", "clean"]
    assert [t.__name__ for t in stage.sections.values()] == ["CleanMachine", "CleanSettings"]


def test_a_fit_is_given_no_case_that_is_frozen(tmp_path: Path) -> None:
    """Of any sub-model: it is told what is frozen, and a copy under another name is left out."""
    frozen = SourceFile(file="a.csv", sha256="1")
    write_json(
        GoldenSets(machine="mill", golden=FrozenSet(files=(frozen,))), tmp_path / "golden/mill.json"
    )
    seen: list[Cases] = []

    class Fake:
        def cases(self, records: Records, settings: Any, sets: GoldenSets | None = None) -> Cases:
            return Cases(cases=tuple(
                Case(name=name, group=name, role=role_of([name], settings.roles, sets),
                     files=(SourceFile(file=name, sha256=digest),), load=lambda: None)
                for name, digest in (("a.csv", "1"), ("b.csv", "2"), ("copy.csv", "1"))
            ))  # fmt: skip

        def fit(self, cases: Cases, settings: Any, folder: Path) -> Model:
            seen.append(cases)
            trained = tuple(one.training for one in cases.of("training"))
            return Model(
                submodel="fake", machine="mill", origin="simulated", parameters={},
                trained_on=trained,
            )  # fmt: skip

    settings = SimpleNamespace(
        identity=SimpleNamespace(name="mill"), roles=Roles(training=("*.csv",))
    )
    identify(Fake(), {}, tmp_path / "model", tmp_path / "golden", settings=settings)  # type: ignore[arg-type]
    assert [one.name for one in seen[0].of("training")] == ["b.csv"]
    assert [one.case for one in seen[0].left_out] == ["copy.csv"]


def test_a_machine_without_a_sub_model_has_its_folders_and_no_champion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a fleet of others too: what depends on a sub-model finds that there is none."""
    monkeypatch.chdir(tmp_path)
    fleet = Fleet(name="two", machines=("bare", "mill"), submodels={"control": ("mill",)})
    models, serves = Path("data/models/bare"), Path("data/champion/bare")
    champion(models, Path("champions.json"), serves, fleet=fleet)
    assert [one.name for one in serves.iterdir()] == ["control"]
    assert not Path("mlflow.db").exists()
    alone = Fleet(name="bare", machines=("bare",))
    champion(models, Path("champions.json"), Path("data/champion/alone"), fleet=alone)
    assert Path("data/champion/alone").is_dir()
    simulate = load_stage("simulate_programs").call
    programs = Path("data/programs/bare")
    simulate(Path("raw"), serves / "control/model.json", programs,
             identity=None, setup=None, control_records=None)  # fmt: skip
    assert list(programs.iterdir()) == []
    (row,) = status("bare", ())
    assert (row["machine"], row["latest"]) == ("bare", NO_SUBMODEL)


def test_a_stage_says_what_it_read_found_wrote_and_took(tmp_path: Path) -> None:
    raw, out = tmp_path / "raw", tmp_path / "model"
    raw.mkdir()
    for name in ("a.txt", "b.txt"):
        (raw / name).write_bytes(b"x" * 1_500_000)
        os.utime(raw / name, (1, 1))
    began = time.time() - 2
    out.mkdir()
    (out / "verdict.json").write_text(json.dumps({"status": "passed"}))
    said = line("judge_drive@mill01", [raw, out, tmp_path / "none"], began)
    assert re.fullmatch(
        r"judge_drive@mill01: read 2 files, 3 MB; found: passed; wrote \S+ \(1 file, 2e-05 MB\); "
        r"took \d\.\d s", said,
    ), said  # fmt: skip


def test_the_verdict_of_a_stage_before_is_not_said(tmp_path: Path) -> None:
    """A model is written into the folder that holds the verdict on the one before it."""
    (tmp_path / "verdict.json").write_text(json.dumps({"status": "failed"}))
    os.utime(tmp_path / "verdict.json", (1, 1))
    (tmp_path / "model.json").write_text("{}")
    said = line("identify_drive@mill01", [tmp_path], time.time() - 2)
    assert "found" not in said and "wrote" in said


def test_records_are_counted(tmp_path: Path) -> None:
    entries = {"a": {"read": 9, "kept": 7, "rejected": 2}, "b": {"read": 1, "kept": 1}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": entries}))
    said = line("ingest@mill01", [tmp_path], 0.0)
    assert "found: 10 records read, 8 records kept, 2 records rejected" in said


def test_a_stage_says_where_it_stands(tmp_path: Path) -> None:
    (tmp_path / "conf/fleet").mkdir(parents=True)
    (tmp_path / "conf/fleet/active.yaml").write_text("machines: [a, b]\nsubmodels: {drive: [b]}\n")
    assert place("clean@b", tmp_path) == ""
    (tmp_path / "dvc.yaml").write_text(
        "stages: {compose: {}, clean: {foreach: '${machines}'}, judge_drive: "
        "{foreach: '${submodels.drive}'}, report: {}}\n"
    )
    assert [place(one, tmp_path) for one in ("compose", "clean@b", "judge_drive@b", "report")] == [
        "(1 of 5)", "(3 of 5)", "(4 of 5)", "(5 of 5)"
    ]  # fmt: skip
    assert place("clean@c", tmp_path) == ""
    assert re.fullmatch(r"\(1 of \d\d\)", place("code", ROOT))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_long_stage_shows_on_a_terminal_that_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage_runner, "SHOWN_AFTER_S", 0.0)
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        with running("shop@mill (3 of 30)", stream):
            while stream is terminal and not terminal.getvalue():
                time.sleep(0.05)
    assert re.match(r"\rshop@mill \(3 of 30\): 1 s ", terminal.getvalue())
    assert terminal.getvalue().endswith("\r\033[K") and not file.getvalue()


DECLARED = """stages:
  trial:
    foreach: ${trials}
    do:
      deps:
        - data/parts/${item}
      outs:
        - data/parts/${item}/cut.json
"""


@pytest.fixture
def trial_stage(here: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run a stage of two inputs that does something to the files meanwhile."""
    (here / "conf/fleet").mkdir(parents=True)
    (here / "dvc.yaml").write_text(DECLARED)
    (here / "conf/fleet/active.yaml").write_text("trials: [mill]\n")
    (here / "data/parts/mill").mkdir(parents=True)
    for name, size in (("small.json", 10), ("large.json", HASHED_BYTES + 1)):
        (here / "data/parts/mill" / name).write_bytes(b"1" * size)
        os.utime(here / "data/parts/mill" / name, (1, 1))  # clocks of files tick in milliseconds

    def run_while(meanwhile: Callable[[], None]) -> None:
        def call(parts: Path, driven: Path) -> None:
            driven.write_text("{}")
            meanwhile()

        entry = Entry(modules=(), paths=["parts", "driven"], sections={}, call=call)
        monkeypatch.setattr(stage_runner, "load_stage", lambda name: entry)
        run("trial@mill", "data/parts/mill", "data/parts/mill/cut.json")

    return run_while


def kept_time(path: str, content: bytes) -> None:
    """Another content of the same size and time of change, as ``cp -p`` over a file leaves it."""
    before = Path(path).stat()
    Path(path).with_suffix(".new").write_bytes(content)
    Path(path).with_suffix(".new").replace(path)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


SMALL, LARGE = "data/parts/mill/small.json", "data/parts/mill/large.json"


@pytest.mark.parametrize(("path", "why", "meanwhile"), [
    (SMALL, "changed", lambda: Path(SMALL).write_bytes(b"1" * 9 + b"2")),
    (SMALL, "changed", lambda: kept_time(SMALL, b"1" * 9 + b"2")),
    (LARGE, "changed", lambda: Path(LARGE).write_bytes(b"2" * (HASHED_BYTES + 1))),
    (LARGE, "was removed", lambda: Path(LARGE).unlink()),
    ("data/parts/mill/new.json", "was added", lambda: Path(SMALL).with_name("new.json").touch()),
])  # fmt: skip
def test_a_stage_whose_input_changes_while_it_runs_fails_and_names_it(
    trial_stage: Any, path: str, why: str, meanwhile: Callable[[], None]
) -> None:
    with pytest.raises(ValueError, match=rf"^{re.escape(path)} {why} while the stage ran.*repro"):
        trial_stage(meanwhile)


def test_a_stage_may_write_its_output_and_a_small_input_may_be_written_as_it_was(
    trial_stage: Any,
) -> None:
    trial_stage(lambda: None)
    trial_stage(lambda: Path(SMALL).write_bytes(b"1" * 10))
    trial_stage(lambda: os.utime(SMALL, (1, 1)))


def test_what_a_stage_writes_is_read_from_dvc_yaml() -> None:
    """Of each kind of stage: one alone, one a machine, one a machine with a folder beside it."""
    assert written_by("code", ROOT) == ["data/code.json"]
    assert written_by("none", ROOT) is None
    (machine, *_) = items(declared(ROOT)[0]["judge_following_residual"], declared(ROOT)[1])  # type: ignore[index]
    assert f"data/models/{machine}/following_residual/verdict.json" in (
        written_by(f"judge_following_residual@{machine}", ROOT) or ()
    )
