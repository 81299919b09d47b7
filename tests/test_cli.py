"""The command ``kerf`` in a project of its own."""

import gzip
import json
import os
import pty
import re
import subprocess
import sys
import threading
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, get_args, get_type_hints
from unittest import mock

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from click.testing import Result
from numba import njit
from typer.testing import CliRunner

import pipeline.app.incident_commands
import pipeline.app.kerf as kerf_options
import pipeline.app.life_commands
import pipeline.app.program_commands  # noqa: F401, its commands
from pipeline.app.commands import app
from pipeline.app.compiling import announced
from pipeline.app.fleet import machine_parameters
from pipeline.app.golden_sets import chosen_set, freeze, shared
from pipeline.app.output import log_to_standard_error
from pipeline.app.programs import CHAMPION, LATEST
from pipeline.app.thermal_growth import FORMATS
from pipeline.gcode.setup import Setup
from pipeline.optimisation.settings import Grouping
from pipeline.schema.golden import Days, FrozenSet, GoldenSets, read_golden
from pipeline.schema.model import SourceFile
from pipeline.schema.part import Objective
from pipeline.schema.store import write_json
from pipeline.schema.verdict import GoldenUsed, Verdict
from pipeline.submodels.cases import Roles, role_of
from pipeline.submodels.contract import submodel, submodels
from tests import bundled_project
from tests.fuzz.seeds import LOGS
from tests.small_project import (
    MACHINE,
    MONDAY,
    ROOT,
    SUBMODELS,
    build,
    change,
    inside,
    leave,
    new_project,
    params,
)

COMMANDS = (
    "ingest", "status", "report", "fleet", "golden", "promote", "predict", "interpret", "simulate",
    "check", "optimise", "transfer", "thermal-growth", "wear", "synthesise", "verify",
)  # fmt: skip


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("KERF_RECORDINGS", "MLFLOW_TRACKING_URI"):
        monkeypatch.delenv(name, raising=False)
    return new_project(tmp_path / "project")


def kerf(project: Path, *words: str | Path) -> Result:
    """Run the command; what is no exit is an error of the test."""
    with inside(project):
        done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def refused(project: Path, *words: str | Path) -> str:
    """The one sentence with which the command ends."""
    done = kerf(project, *words)
    assert done.exit_code == 2 and done.stdout == ""
    assert done.stderr.startswith("kerf: ") and done.stderr.count("\n") == 1
    return done.stderr


def test_help_names_every_command(project: Path) -> None:
    done = kerf(project, "--help")
    assert done.exit_code == 0
    assert all(command in done.stdout for command in COMMANDS)
    for command in COMMANDS:
        assert kerf(project, command, "--help").exit_code == 0


def test_the_command_starts_without_the_heavy_libraries() -> None:
    heavy = "{'mlflow', 'pandas', 'torch', 'sklearn', 'numba', 'hydra', 'matplotlib', 'pyarrow'}"
    code = f"import sys, pipeline.app; sys.exit(str({heavy} & set(sys.modules) or ''))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_ingest_prints_a_row_a_file(project: Path, tmp_path: Path) -> None:
    good, dirty = tmp_path / "good.txt", tmp_path / "dirty.txt"
    good.write_bytes(LOGS[6])
    dirty.write_bytes(LOGS[6] + b"no line of a log\n")
    out = tmp_path / "out"
    done = kerf(project, "ingest", good, dirty, "--machine", MACHINE, "--out", out)
    assert done.exit_code == 0
    lines = done.stdout.splitlines()
    assert lines[0].split() == ["file", "read", "kept", "rejected"]
    assert [line.split() for line in lines[1:3]] == [
        [str(good), "40", "40", "0"],
        [str(dirty), "41", "40", "1"],
    ]
    assert lines[3] == f"1 rejected, each with its reason in {out / 'rejected.parquet'}"
    assert {len(line) for line in lines[:3]} == {len(lines[0])}  # columns stand under each other
    assert done.stderr == "".join(
        f"kerf: {path}: data/raw/{MACHINE}/Devices.xml does not exist, nor does it stand "
        "beside the file: kinds and units are not known\n"
        for path in (good, dirty)
    )


def test_ingest_takes_the_device_document_that_the_project_has(
    project: Path, tmp_path: Path
) -> None:
    log = tmp_path / "log.txt"
    log.write_text("2024-03-04T10:00:00Z|S1n|fast\n2024-03-04T10:00:01Z|S1n|100\n")
    device = '<Device id="d" name="m"><DataItems><DataItem id="s" name="S1n" category="SAMPLE" '
    device += 'type="ROTARY_VELOCITY" units="REVOLUTION/MINUTE"/></DataItems></Device>'
    (project / f"data/raw/{MACHINE}").mkdir()
    (project / f"data/raw/{MACHINE}/Devices.xml").write_text(device)
    done = kerf(project, "ingest", log, "--machine", MACHINE, "--out", tmp_path / "out")
    assert done.stderr == ""
    (said,) = pq.read_table(tmp_path / "out/rejected.parquet").to_pylist()
    assert said["line"] == 1 and "'fast'" in said["reason"]
    assert pq.read_table(tmp_path / "out/data_items.parquet")["units"].to_pylist() == [
        "REVOLUTION/MINUTE"
    ]


def test_items_of_another_machine_are_counted(project: Path, tmp_path: Path) -> None:
    log, devices = tmp_path / "log.txt", tmp_path / "Devices.xml"
    devices.write_text(
        '<Device id="d" name="m"><DataItems><DataItem id="s" name="S1n" category="SAMPLE" '
        'type="ROTARY_VELOCITY" units="REVOLUTION/MINUTE"/></DataItems></Device>'
    )
    rows = ["S1n|100", "Xpos|7", "Xpos|8", "Feed_Rate|3", "Ypos|UNAVAILABLE"]
    log.write_text("".join(f"2024-03-04T10:00:0{n}Z|{row}\n" for n, row in enumerate(rows)))
    done = kerf(project, "ingest", log, "--machine", MACHINE, "--out", tmp_path / "out")
    assert done.stderr == (
        "kerf: 2 items with 3 values are not in the Devices document (Xpos, Feed_Rate): is a log "
        "of another machine among these?\n"
    )


def test_files_of_one_name_are_kept_apart(project: Path, tmp_path: Path) -> None:
    paths = [tmp_path / day / "log.txt" for day in ("monday", "tuesday")]
    for n, path in enumerate(paths, 1):
        path.parent.mkdir()
        path.write_bytes(b"".join(LOGS[6].splitlines(keepends=True)[:n]))
    out = tmp_path / "out"
    done = kerf(project, "ingest", *paths, "--machine", MACHINE, "--out", out)
    rows = [line.split() for line in done.stdout.splitlines()[1:]]
    assert rows == [[str(paths[0]), "2", "2", "0"], [str(paths[1]), "4", "4", "0"]]
    assert len(list((out / "observations").iterdir())) == 2


def test_hidden_and_odd_names_are_read(project: Path, tmp_path: Path) -> None:
    for name in (b".log.txt", b"[1]*?.txt", b"\xff \xc3\xbc.txt", b"Devices.xml"):
        path = tmp_path / os.fsdecode(name)
        path.write_bytes(LOGS[6])
        done = kerf(project, "ingest", path, "--machine", MACHINE, "--out", tmp_path / "out")
        assert done.exit_code == 0
        assert done.stdout.splitlines()[1].split()[-3:] == ["40", "40", "0"]


def test_a_folder_of_the_pipeline_is_no_place_for_it(project: Path, tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_bytes(LOGS[6])
    out = f"data/signals/{MACHINE}"
    said = refused(project, "ingest", tmp_path / "log.txt", "--machine", MACHINE, "--out", out)
    assert f"{out} is written by `dvc repro`" in said


def test_an_unknown_machine_is_named_with_those_known(project: Path, tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_bytes(LOGS[6])
    for words in (
        ("ingest", tmp_path / "log.txt", "--machine", "lathe9", "--out", tmp_path / "out"),
        ("golden", "-m", "lathe9", "--first", MONDAY, "--last", MONDAY),
    ):
        said = refused(project, *words)
        assert "conf/machine/lathe9.yaml does not exist" in said
        assert "mazak01, mill00, mill01, mill02" in said


def test_outside_a_project_it_says_where_to_run(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_bytes(LOGS[6])
    words = ("ingest", tmp_path / "log.txt", "--machine", MACHINE, "--out", tmp_path / "out")
    assert "Run kerf in the project's folder" in refused(tmp_path, *words)
    assert "params.yaml does not exist" in refused(tmp_path, "status")


def ingest_command(tmp_path: Path) -> list[str]:
    (tmp_path / "log.txt").write_bytes(LOGS[6])
    return [sys.executable, "-m", "pipeline.app", "ingest", str(tmp_path / "log.txt"),
            "--machine", MACHINE, "--out", str(tmp_path / "out")]  # fmt: skip


def test_there_is_no_bar_where_nobody_looks(project: Path, tmp_path: Path) -> None:
    done = subprocess.run(
        ingest_command(tmp_path), cwd=project, capture_output=True, text=True, check=True
    )
    assert done.stderr.startswith("kerf: ") and done.stderr.count("\n") == 1
    assert "\x1b" not in done.stderr + done.stdout


def test_there_is_a_bar_where_a_person_looks(project: Path, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    done = subprocess.Popen(
        ingest_command(tmp_path), cwd=project, stdout=subprocess.DEVNULL, stderr=theirs,
        env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    os.close(theirs)
    seen = b""
    while True:
        try:
            part = os.read(ours, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        seen += part
    assert done.wait() == 0
    assert b"reading" in seen and b"\x1b" in seen


def rows_of(done: Result) -> list[dict[str, str]]:
    """Rows of a table that a command prints, by the names of its columns."""
    assert done.exit_code == 0, done.output
    head, *lines = done.stdout.splitlines()
    names = head.split("  ")
    names = [name.strip() for name in names if name.strip()]
    starts = [head.index(name) for name in names]
    ends = [*starts[1:], None]
    return [
        {name: line[a:b].strip() for name, a, b in zip(names, starts, ends, strict=True)}
        for line in lines
    ]


def test_status_without_a_registry(project: Path) -> None:
    fleet = {name: [MACHINE] for name in SUBMODELS} | {"spindle": [MACHINE, "mill02"]}
    change(project, "fleet", machines=[MACHINE, "mill02"], submodels=fleet)
    rows = rows_of(kerf(project, "status"))
    assert [(row["machine"], row["sub-model"]) for row in rows] == [
        *((MACHINE, name) for name in SUBMODELS), ("mill02", "spindle"),
    ]  # fmt: skip
    for row in rows:
        assert row["latest"] == "not built: run `dvc repro`"
        assert {row[name] for name in ("champion", "serving", "challenger")} == {"-"}
    assert not (project / "mlflow.db").exists()


def test_a_table_is_predicted_with_the_champion_or_the_latest(tmp_path: Path) -> None:
    root = bundled_project.project(tmp_path / "project")
    (root / "conf").symlink_to(ROOT / "conf")
    bundled_project.hour(root).to_parquet(root / "hour.parquet")
    words = ("predict", "-m", MACHINE, "spindle", "hour.parquet", "--out")
    assert "holds no model" in refused(root, *words, "p.parquet")
    bundled_project.spindle(root)
    assert f"data/champion/{MACHINE}/spindle holds no model" in refused(root, *words, "p.parquet")
    done = kerf(root, *words, "p.csv", "--model", "latest")
    with_it = submodel("spindle").serve(root / f"data/models/{MACHINE}/spindle")
    expected = with_it(pd.read_parquet(root / "hour.parquet"))
    assert (done.exit_code, done.stdout) == (0, f"wrote {len(expected)} rows to p.csv\n")
    found = pd.read_csv(root / "p.csv", parse_dates=["time"])
    assert list(found.columns) == list(expected.columns)
    values = [name for name in expected.columns if name != "time"]
    assert found[values].to_numpy() == pytest.approx(expected[values].to_numpy(), nan_ok=True)
    latest = ("--model", "latest")
    (root / "bare.csv").write_text("time\n2026-01-05T08:00:00Z\n")
    (root / "empty.csv").touch()
    (root / "head.csv").write_text("time,spindle_temperature\n")
    (root / "cut.csv.gz").write_bytes(gzip.compress(b"time,t\n" + b"1,2\n" * 999)[:-9])
    for table, said in (
        ("bare.csv", "has no column"), ("none.csv", "none.csv is no file: name a table"),
        ("cut.csv.gz", "is no table of CSV, or is cut off"), ("empty.csv", "empty.csv is empty"),
        ("head.csv", "the table has no row"),
    ):  # fmt: skip
        assert said in refused(
            root, "predict", "-m", MACHINE, "spindle", table, "--out", "q.csv", *latest
        )
    said = refused(
        root, "predict", "-m", MACHINE, "rust", "hour.parquet", "--out", "q.csv", *latest
    )
    assert "'rust'" in said
    words = ("predict", "-m", MACHINE, "compensation", "hour.parquet", "--out", "q.csv")
    assert "compensation is called following_residual now" in refused(root, *words)
    assert not (root / "q.csv").exists()


def test_a_verdict_that_is_broken_is_named(project: Path) -> None:
    verdict = project / f"data/models/{MACHINE}/spindle/verdict.json"
    verdict.parent.mkdir(parents=True)
    verdict.with_name("model.json").write_text("{}")
    verdict.write_text("{")
    said = refused(project, "status")
    assert f"data/models/{MACHINE}/spindle/verdict.json is no JSON" in said and "dvc repro" in said


def active(project: Path) -> str:
    """Name of the fleet in active.yaml, which is a file of its own and no link."""
    path = project / "conf/fleet/active.yaml"
    assert not path.is_symlink()
    name = str(yaml.safe_load(path.read_text())["name"])
    assert path.read_text() == path.with_name(f"{name}.yaml").read_text()
    return name


def test_another_fleet_is_made_active(project: Path) -> None:
    leave(project, "recorded", "mazak01")
    lock, first = project / "dvc.lock", active(project)
    lock.write_text("of the first fleet")
    done = kerf(project, "fleet", "recorded")
    assert (done.exit_code, done.stdout) == (0, "fleet recorded: mazak01\n")
    assert active(project) == "recorded"
    assert not lock.exists(), "of the machines of another fleet"
    assert kerf(project, "fleet", "recorded").exit_code == 0
    with inside(project):
        build(project, "compose")
    assert "mazak01" in params(project)["machine"]
    # dependencies of the report that no stage of this fleet writes
    assert all((project / "data" / name).is_dir() for name in ("truth", "programs", "trials"))
    kerf(project, "fleet", first)
    assert (active(project), lock.read_text()) == (first, "of the first fleet")


def test_what_was_never_built_says_which_fleet_builds_it(project: Path) -> None:
    leave(project, "recorded", "mazak01")
    kerf(project, "fleet", "recorded")
    (row, *_) = rows_of(kerf(project, "status"))
    assert (row["machine"], row["latest"]) == ("mazak01", "not built: run `dvc repro`")
    said = "mill01 is not in the fleet recorded, which is built here: run `kerf fleet demo`"
    for words in (
        ("records", "-m", MACHINE), ("thermal-growth", "-m", MACHINE, "--out", "c.csv"),
        ("transfer", "-m", "mazak01", "--golden", MACHINE, "--out", "t.json"),
    ):  # fmt: skip
        assert said.partition("run")[0] in refused(project, *words)


def test_no_lock_is_lost_where_the_active_fleet_cannot_be_read(project: Path) -> None:
    kept = project / "data/locks/recorded.lock"
    kept.parent.mkdir()
    kept.write_text("of recorded")
    (project / "dvc.lock").write_text("of a fleet")
    (project / "conf/fleet/active.yaml").write_text("<<<<<<< name: [demo\n")
    assert kerf(project, "fleet", "recorded").exit_code == 0
    assert (project / "dvc.lock").read_text() == "of recorded"
    assert kept.with_name("unknown.lock").read_text() == "of a fleet"
    assert kerf(project, "fleet", "simulated").exit_code == 0
    assert kept.read_text() == "of recorded"


def test_no_fleet_is_changed_where_its_recordings_are_missing(project: Path) -> None:
    first = active(project)
    said = refused(project, "fleet", "recorded", "--recordings", "nowhere")
    assert "does not exist" in said and active(project) == first


@pytest.mark.parametrize("name", ["active", "nowhere", "../fleet/recorded"])
def test_a_fleet_that_is_none_is_refused(name: str, project: Path) -> None:
    said = refused(project, "fleet", name)
    assert "known fleets: demo, recorded, simulated" in said
    assert active(project) == "simulated"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: own\nmachines: [mill01]\nsubmodles: {}\n", "submodles"),
        ("name: own\nmachines: [mill01]\nsubmodels: {drive: [mill02]}\n", "['mill02']"),
        ("name: own\nmachines: [lathe9]\n", "lathe9"),
        ("name: [own\n", "conf/fleet/own.yaml is no fleet"),
        ("machines: mill01\nname: own\n", "'mill01' is no list"),
    ],
)
def test_a_fleet_that_is_wrong_is_refused(text: str, said: str, project: Path) -> None:
    (project / "conf/fleet/own.yaml").write_text(text)
    assert said in refused(project, "fleet", "own")
    assert active(project) == "simulated"


@pytest.fixture
def recordings(project: Path, tmp_path: Path) -> Path:
    leave(project, "recorded", "mazak01")
    folder = tmp_path / "recordings/nist_mazak01"
    for name in ("Devices.xml", "week_1/1.txt", "week_1/2.txt", "week_1/notes.md", "other/3.txt"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    return folder


def test_what_is_new_among_the_recordings_is_copied(project: Path, recordings: Path) -> None:
    def collect() -> str:
        done = kerf(project, "fleet", "recorded", "--recordings", recordings.parent)
        assert done.exit_code == 0
        return done.stdout.splitlines()[1]

    raw = project / "data/raw/mazak01"
    assert collect() == "mazak01: 3 files, 3 new"
    assert sorted(p.relative_to(raw).as_posix() for p in raw.rglob("*.*")) == [
        "Devices.xml", "week_1/1.txt", "week_1/2.txt",
    ]  # fmt: skip
    assert collect() == "mazak01: 3 files, 0 new"
    stamp = (recordings / "week_1/1.txt").stat().st_mtime_ns
    (recordings / "week_1/1.txt").write_text("week_1/9.txt")  # as long, and as old as before
    os.utime(recordings / "week_1/1.txt", ns=(stamp, stamp))
    (recordings / "week_1/4.txt").write_text("4")
    before = (raw / "week_1/2.txt").stat().st_mtime_ns
    assert collect() == "mazak01: 4 files, 2 new"
    assert (raw / "week_1/1.txt").read_text() == "week_1/9.txt"
    assert (raw / "week_1/2.txt").stat().st_mtime_ns == before


def test_the_folder_of_recordings_may_stand_in_the_environment(
    project: Path, recordings: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KERF_RECORDINGS", str(recordings.parent))
    assert "3 new" in kerf(project, "fleet", "recorded").stdout
    assert kerf(project, "fleet", "simulated").stdout == "fleet simulated: mill01, mill02\n"


def test_recordings_that_are_not_there_are_named(project: Path, recordings: Path) -> None:
    def said() -> str:
        done = kerf(project, "fleet", "recorded", "--recordings", recordings.parent)
        assert done.exit_code == 2
        return done.stderr

    (recordings / "Devices.xml").unlink()
    assert f"{recordings / 'Devices.xml'} does not exist" in said()
    for path in (recordings / "week_1").glob("*.txt"):
        path.unlink()
    assert "holds no file that the machine's sources name (week_*/*.txt)" in said()
    recordings.rename(recordings.with_name("renamed"))
    assert f"{recordings} does not exist: name the folder that holds nist_mazak01" in said()


LOGGED = {"agent/1.txt": MONDAY, "agent/2.txt": "2026-01-12", "agent/3.txt": "2026-01-19"}
TRACES = ("servo/circle-XY.csv", "servo/load-step-X.csv")


@pytest.fixture
def ingested(project: Path) -> Path:
    """Manifest of three weeks of logs and of two traces, which have no clock."""
    entries = {name: f"{day}T15:00:00Z" for name, day in LOGGED.items()} | dict.fromkeys(TRACES)
    files = {
        name: {"sha256": sha256(name.encode()).hexdigest(), "last": last}
        for name, last in entries.items()
    }
    folder = project / f"data/signals/{MACHINE}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps({"files": files}))
    return project


def sets_of(project: Path) -> GoldenSets:
    found = read_golden(project / f"data/golden/{MACHINE}.json")
    assert found is not None and found.machine == MACHINE
    return found


def frozen(project: Path, *words: str) -> FrozenSet:
    """What ``kerf golden`` freezes; it says how much and with which hash."""
    done = kerf(project, "golden", "-m", MACHINE, *words)
    assert done.exit_code == 0, done.output
    sets = sets_of(project)
    found = sets.sealed if "--sealed" in words else sets.golden
    assert found is not None
    many = "files" if len(found.files) > 1 else "file"
    assert done.stdout == f"froze {len(found.files)} {many}, sha256 {found.sha256[:12]}\n"
    return found


def test_a_golden_week_is_frozen(ingested: Path) -> None:
    found = frozen(ingested, "--first", MONDAY, "--last", "2026-01-11")
    own = sha256(b"agent/1.txt").hexdigest()
    assert found.files == (SourceFile(file="agent/1.txt", sha256=own),)
    assert found.days == Days(first=MONDAY, last="2026-01-11")
    assert sets_of(ingested).sealed is None


def test_files_without_a_clock_are_frozen_by_pattern_beside_the_days(ingested: Path) -> None:
    found = frozen(ingested, "--files", "servo/circle-*")
    assert [one.file for one in found.files] == ["servo/circle-XY.csv"] and found.days is None
    found = frozen(
        ingested, "--first", MONDAY, "--last", MONDAY, "--files", "servo/*", "--files", "*/circle*"
    )
    assert [one.file for one in found.files] == ["agent/1.txt", *TRACES]
    assert found.days == Days(first=MONDAY, last=MONDAY)


def test_a_sealed_set_stands_beside_the_golden_one(ingested: Path) -> None:
    golden = frozen(ingested, "--first", MONDAY, "--last", "2026-01-11")
    sealed = frozen(ingested, "--sealed", "--first", "2026-01-12", "--last", "2026-01-18")
    assert [one.file for one in sealed.files] == ["agent/2.txt"]
    assert sets_of(ingested) == GoldenSets(machine=MACHINE, golden=golden, sealed=sealed)
    assert frozen(ingested, "--files", TRACES[0]) != golden  # frozen anew, the sealed one stays
    assert sets_of(ingested).sealed == sealed


def test_days_of_one_log_may_be_golden_and_others_sealed(ingested: Path) -> None:
    path = ingested / f"data/signals/{MACHINE}/manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"] = {"agent/long.txt": {"sha256": "0" * 64, "first": "2026-01-02T08:00:00Z",
                                            "last": "2026-01-30T08:00:00Z"}}  # fmt: skip
    path.write_text(json.dumps(manifest))
    days = ("2026-01-05", "2026-01-06", "2026-01-12", "2026-01-30")
    for day in days:
        state = ingested / f"data/clean/{MACHINE}/state/{day}.parquet"
        state.parent.mkdir(parents=True, exist_ok=True)
        state.touch()
    frozen(ingested, "--first", days[0], "--last", days[1])
    frozen(ingested, "--sealed", "--first", days[2], "--last", days[2])
    sets, log = sets_of(ingested), ["agent/long.txt"]
    roles = [role_of(log, Roles(), sets, day) for day in days]
    assert roles == ["golden", "golden", "sealed", "held_out"]
    for words in (("--first", days[1], "--last", days[2]), ("--files", "agent/*")):
        said = refused(ingested, "golden", "-m", MACHINE, "--sealed", *words)
        assert f"{days[1] if '--first' in words else log[0]} is in the golden set" in said
    assert sets_of(ingested) == sets


def test_a_part_of_a_table_is_frozen_by_the_values_of_its_columns(ingested: Path) -> None:
    folder = ingested / f"data/signals/{MACHINE}"
    (folder / "traces").mkdir()
    pq.write_table(pa.table({"tool": ["T3", "T3", "T4"], "F": [1.0, 2.0, 3.0]}),
                   folder / "traces/cuts.parquet")  # fmt: skip
    manifest = json.loads((folder / "manifest.json").read_text())
    table = {"sha256": "0" * 64, "last": None, "output": "traces/cuts.parquet"}
    manifest["files"]["cuts.csv"] = table
    (folder / "manifest.json").write_text(json.dumps(manifest))
    found = frozen(ingested, "--files", "cuts.csv#tool=T3")
    assert found.files == (SourceFile(file="cuts.csv#tool=T3", sha256="0" * 64),)
    both = ("--sealed", "--files", "cuts.csv")  # it holds the golden rows
    assert "is in the golden set" in refused(ingested, "golden", "-m", MACHINE, *both)
    assert frozen(ingested, "--sealed", "--files", "cuts.csv#tool=T4").files
    assert "no raw file" in refused(
        ingested, "golden", "-m", MACHINE, "--files", "cuts.csv#tool=T5"
    )
    assert "no column" in refused(ingested, "golden", "-m", MACHINE, "--files", "cuts.csv#tol=T3")


def test_a_log_that_is_named_beside_the_days_counts_as_a_whole(ingested: Path) -> None:
    days = ("--first", MONDAY, "--last", MONDAY)
    assert frozen(ingested, *days, "--files", "agent/1*", "--files", "servo/*").whole == ()
    assert frozen(ingested, *days, "--files", "agent/2*").whole == ("agent/2.txt",)


def test_a_committed_set_is_replaced_after_a_question(ingested: Path) -> None:
    week = ("--first", MONDAY, "--last", "2026-01-11")
    frozen(ingested, *week)
    frozen(ingested, "--files", TRACES[0])  # not committed: no question
    git = ("git", "-C", str(ingested), "-c", "user.name=a", "-c", "user.email=a@b.c")
    for words in (("init", "-q"), ("add", "-f", "data/golden"), ("commit", "-qm", "frozen")):
        subprocess.run([*git, *words], check=True)
    before = sets_of(ingested)
    said = refused(ingested, "golden", "-m", MACHINE, *week)
    assert f"data/golden/{MACHINE}.json is committed" in said and "give --again" in said
    assert sets_of(ingested) == before
    frozen(ingested, "--files", TRACES[0])  # the same set
    frozen(ingested, "--sealed", *week)  # none takes its place
    assert frozen(ingested, "--again", "--files", TRACES[1]) != before.golden


def test_what_rests_on_a_set_that_is_replaced_is_named(ingested: Path) -> None:
    golden = frozen(ingested, "--first", MONDAY, "--last", "2026-01-11")
    used = GoldenUsed(sha256=golden.sha256, files=1)
    verdict = Verdict(submodel="spindle", machine=MACHINE, origin="simulated", status="passed",
                      reasons=(), judged_role="golden", golden=used, scores=())  # fmt: skip
    write_json(verdict, ingested / f"data/models/{MACHINE}/spindle/verdict.json")
    done = kerf(ingested, "golden", "-m", MACHINE, "--files", TRACES[0])
    assert done.stderr == (
        f"kerf: the golden set {golden.sha256[:12]} of {MACHINE}, 1 file is replaced; scores on it "
        f"no longer compare with new ones: models/{MACHINE}/spindle\n"
    )


def test_both_sets_may_change_places_at_once(ingested: Path) -> None:
    with inside(ingested):
        sets = [chosen_set(MACHINE, files=[one]) for one in TRACES]
        for golden, sealed in (sets, reversed(sets)):
            freeze(MACHINE, {"golden": golden, "sealed": sealed})
            assert sets_of(ingested) == GoldenSets(machine=MACHINE, golden=golden, sealed=sealed)
        with pytest.raises(ValueError, match=r"is in the golden set of .* already"):
            freeze(MACHINE, {"golden": golden, "sealed": golden})


def test_days_and_what_counts_as_a_whole_are_in_the_hash() -> None:
    log = FrozenSet(files=(SourceFile(file="a.txt", sha256="0"),))
    day, week = (Days(first=MONDAY, last=last) for last in (MONDAY, "2026-01-11"))
    first = replace(log, days=day)
    sets = [log, first, replace(log, days=week), replace(first, whole=("a.txt",)),
            replace(first, time_zone="Europe/Berlin")]  # fmt: skip
    assert len({one.sha256 for one in sets}) == len(sets)


def test_which_set_is_named_first_does_not_matter() -> None:
    """A log by its days in one set, a part of it by a column, which has none, in the other."""
    known: dict[str, dict[str, str]] = {"a.csv": {"last": f"{MONDAY}T15:00:00Z"}}
    one, other = (
        FrozenSet(files=(SourceFile(file=name, sha256="0"),), days=Days(first=day, last=day))
        for name, day in (("a.csv", MONDAY), ("a.csv#tool=1", "2026-01-12"))
    )
    assert shared(one, other, known) and shared(other, one, known)


@pytest.mark.parametrize(
    ("first", "second"), [((), ("--sealed",)), (("--sealed",), ())], ids=["golden", "sealed"]
)
def test_a_file_is_in_one_of_the_two_sets(
    first: tuple[str, ...], second: tuple[str, ...], ingested: Path
) -> None:
    frozen(ingested, *first, "--first", MONDAY, "--last", "2026-01-18")
    before = sets_of(ingested)
    said = refused(
        ingested, "golden", "-m", MACHINE, *second, "--files", "agent/2*", "--files", "servo/*"
    )
    which = "sealed" if first else "golden"
    assert f"agent/2.txt is in the {which} set of {MACHINE} already" in said
    assert sets_of(ingested) == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--files", "servo/square-*"), f"{MACHINE} has no raw file 'servo/square-*'"),
        (("--files", "servo/*", "--files", "motor/*"), "no raw file 'motor/*'"),
        (("--first", MONDAY), "--first and --last go together"),
        (("--sealed",), "name what to freeze: --first and --last of a week, or --files"),
    ],
)
def test_what_names_no_file_cannot_be_frozen(
    words: tuple[str, ...], said: str, ingested: Path
) -> None:
    assert said in refused(ingested, "golden", "-m", MACHINE, *words)
    assert not list((ingested / "data/golden").iterdir())


def test_without_files_it_shows_what_is_frozen_of_each_sub_model(project: Path) -> None:
    """Here there is no record: each row says so."""
    folder = project / f"data/signals/{MACHINE}"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text('{"files": {}}')
    done = kerf(project, "golden", "-m", MACHINE)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith(f"{MACHINE}: no golden set; no sealed set\n")
    document = json.loads(kerf(project, "golden", "-m", MACHINE, "--json", "-").stdout)
    assert [one["submodel"] for one in document["submodels"]] == sorted(submodels())
    assert all(one["lacking"] for one in document["submodels"])
    assert (document["golden"], document["sealed"], document["looks"]) == (None, None, 0)
    both = ("golden", "-m", MACHINE, "--split", "--sealed")
    assert "--split freezes both sets" in refused(project, *both)


@pytest.mark.parametrize(
    ("first", "last", "said"),
    [
        ("monday", MONDAY, "the first day 'monday' is no day YYYY-MM-DD"),
        (MONDAY, "2026-02-30", "'2026-02-30' is no day"),
        ("2026-01-06", MONDAY, f"the last day {MONDAY} is before the first, 2026-01-06"),
        ("2025-01-06", "2025-01-07", f"{MACHINE} has no record from 2025-01-06 to 2025-01-07"),
        (MONDAY, MONDAY, "manifest.json does not exist: run `dvc repro ingest@mill01` first"),
    ],
)
def test_a_week_that_cannot_be_frozen(first: str, last: str, said: str, project: Path) -> None:
    if "has no record" in said:
        folder = project / f"data/signals/{MACHINE}"
        folder.mkdir()
        (folder / "manifest.json").write_text('{"files": {}}')
    assert said in refused(project, "golden", "-m", MACHINE, "--first", first, "--last", last)
    assert not list((project / "data/golden").iterdir())


def test_days_without_a_record_are_answered_with_those_that_have_some(ingested: Path) -> None:
    said = refused(
        ingested, "golden", "-m", MACHINE, "--first", "2026-01-07", "--last", "2026-01-08"
    )
    assert f"there are records of {MONDAY}, 2026-01-12, 2026-01-19" in said
    state = ingested / f"data/clean/{MACHINE}/state"
    state.mkdir(parents=True)
    for day in (MONDAY, "2026-01-06", "2026-01-08"):
        (state / f"{day}.parquet").touch()
    said = refused(
        ingested, "golden", "-m", MACHINE, "--first", "2026-01-07", "--last", "2026-01-07"
    )
    assert said.endswith(f"there are records of {MONDAY} to 2026-01-06, 2026-01-08\n")


def test_the_report_is_written_where_it_is_asked_for(project: Path, tmp_path: Path) -> None:
    log = project / f"data/raw/{MACHINE}/agent/2026-01-05.txt"
    log.parent.mkdir(parents=True)
    log.write_bytes(LOGS[6])
    build(project, "ingest")
    done = kerf(project, "report", "--out", tmp_path / "pages")
    assert (done.exit_code, done.stdout) == (0, f"wrote {tmp_path / 'pages/index.html'}\n")
    assert MACHINE in (tmp_path / "pages/index.html").read_text()
    (project / "conf/pages/default.yaml").write_text("language: de\n")  # not composed
    done = kerf(project, "report", "--out", tmp_path / "pages")
    assert done.exit_code == 0 and "'de'} and params.yaml {'language': 'en'}" in done.stderr


def test_the_version_is_that_of_the_installed_package(project: Path) -> None:
    done = kerf(project, "--version")
    assert (done.exit_code, done.output) == (0, f"kerf {version('kerf-twin')}\n")


def test_status_is_told_as_json_too(project: Path) -> None:
    rows = json.loads(kerf(project, "status", "--json", "-").stdout)
    table = kerf(project, "status").output.splitlines()
    assert len(rows) == len(table) - 1 > 0
    assert list(rows[0]) == re.split(r"  +", table[0].strip())


def test_a_machine_is_completed(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = {
        "_KERF_COMPLETE": "complete_bash",
        "COMP_WORDS": "kerf simulate --machine mill0",
        "COMP_CWORD": "3",
    }
    for name, value in words.items():
        monkeypatch.setenv(name, value)
    with inside(project):
        done = CliRunner().invoke(app, [], prog_name="kerf")
    assert done.output.split() == sorted(
        p.stem for p in (project / "conf/machine").glob("mill0*.yaml")
    )


CHOICES = [
    (kerf_options.DialectName, get_type_hints(Setup)["dialect"]),
    (kerf_options.ObjectiveName, Objective),
    (kerf_options.SpeedsName, get_type_hints(Grouping)["speeds"]),
    (kerf_options.FormatName, FORMATS),
    (kerf_options.ModelName, (CHAMPION, LATEST)),
]


@pytest.mark.parametrize(("choice", "own"), CHOICES)
def test_choices_of_an_option_are_those_of_what_it_sets(choice: Any, own: Any) -> None:
    assert set(get_args(choice)) == set(own if isinstance(own, tuple) else get_args(own))


def test_choices_stand_in_the_help_and_in_the_refusal(project: Path) -> None:
    shown = kerf(project, "simulate", "--help").output
    assert "champion" in shown and "latest" in shown
    said = refused(project, "interpret", "p.nc", "--out", "m.csv", "--dialect", "heidenhain")
    assert "'heidenhain' is not one of 'fanuc', 'linuxcnc', 'siemens'" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("simulate",), "Missing argument 'program'"),
        (
            ("compensation", "-m", MACHINE),
            "`kerf compensation` is called `kerf thermal-growth` now",
        ),
        (("optimise", "a.nc", "--compensated"), "--compensated is called --residual now"),
        (("golden", MACHINE), "Missing option '--machine' / '-m': name the machine as in `"),
        (("promote", "-m", "mil01", "--why", "x"), "did you mean mill"),
        (("status", "--json"), "--json needs a value: JSON to write, - for standard output"),
        (("check", "a.nc", "b.nc", "--json", "-m", MACHINE), "--json needs a value"),
        (
            ("optimise", "a.nc", "--feed", "50", "--out", "b.nc"),
            "--feed needs 2 values, 50 alone is given: F",
        ),
        (("optimise", "a.nc", "-m", MACHINE, "--seed", "x"), "--seed x is no whole number: give"),
        (("optimise", "a.nc", "-m", MACHINE, "--feed", "5", "y"), "--feed y is no number: give"),
        (("simulate", "p.nc", "--machin", "mill01"), "No such option"),
        (("status", "--json", "a.json", "--json=b.json"), "--json is given twice and holds one"),
        (("simulate", "a.nc", "-m", MACHINE, "-mmill01"), "-m is given twice and holds one value"),
        (("machine", "new", "x", "--devices", "a", "--devices", "b"), "--devices is given twice"),
        (("ingest", "params.yaml", "-m", MACHINE, "--out", "params.yaml"), "params.yaml is a file"),
        (("report", "--out", "params.yaml/in"), "params.yaml is a file: name a folder to write"),
        (("cut",), "No such command 'cut'"),
    ],
)
def test_a_wrong_option_is_one_sentence_too(
    words: tuple[str, ...], said: str, project: Path
) -> None:
    assert said in refused(project, *words)


PART = "G21 G90\nG0 X10\nG1 Y20 F500\nM30\n"


@pytest.fixture
def part(project: Path) -> Path:
    (project / "part.nc").write_text(PART)
    return project


def test_a_document_goes_to_standard_output(part: Path) -> None:
    assert kerf(part, "interpret", "part.nc", "--out", "moves.csv").exit_code == 0  # compiles
    done = kerf(part, "interpret", "part.nc", "--out", "-")
    assert done.stdout == (part / "moves.csv").read_text()
    assert done.stderr == "3 moves, 30.000 mm, wrote standard output\n"
    done = kerf(part, "simulate", "part.nc", "--machine", "hurco", "--json", "-")
    assert json.loads(done.stdout)["path_length_mm"] == 30
    assert "part.nc on hurco" in done.stderr
    assert not (part / "-").exists()


def test_standard_output_takes_one_document(part: Path) -> None:
    words = ("simulate", "part.nc", "--machine", "hurco", "--json", "-", "--out", "-")
    assert "- is named for two outputs" in refused(part, *words)


def test_verbose_says_a_line_a_step_and_nothing_else_changes(part: Path) -> None:
    plain = kerf(part, "interpret", "part.nc", "--out", "plain.csv")
    told = kerf(part, "-v", "interpret", "part.nc", "--out", "told.csv")
    assert told.stdout == plain.stdout.replace("plain", "told")
    (only,) = told.stderr.splitlines()
    said = r"kerf: followed part\.nc; 3 moves, wrote told\.csv; took \d+\.\d\d s"
    assert re.fullmatch(said, only)
    assert (part / "told.csv").read_bytes() == (part / "plain.csv").read_bytes()
    assert kerf(part, "-q", "interpret", "part.nc", "--out", "q.csv").stderr == ""


def test_check_ingest_and_golden_speak_json(part: Path, tmp_path: Path) -> None:
    (part / "faster.nc").write_text(PART.replace("F500", "F700"))
    found = json.loads(kerf(part, "check", "part.nc", "faster.nc", "--json", "-").stdout)
    assert found["same"] is True and found["moves"] == 3
    assert found["differences"] == [{"line": 3, "letter": "F", "before": "F500", "after": "F700"}]
    log = tmp_path / "log.txt"
    log.write_bytes(LOGS[6])
    words = ("ingest", log, "--machine", MACHINE, "--out", tmp_path / "out", "--json", "-")
    (row,) = json.loads(kerf(part, *words).stdout)
    assert (row["path"], row["read"], row["kept"], row["rejected"]) == (str(log), 40, 40, 0)


def test_a_frozen_set_is_told_as_json(ingested: Path) -> None:
    words = ("golden", "-m", MACHINE, "--first", MONDAY, "--last", "2026-01-11", "--json", "-")
    told = json.loads(kerf(ingested, *words).stdout)
    frozen_set = sets_of(ingested).golden
    assert frozen_set is not None and told["sha256"] == frozen_set.sha256
    assert told["days"] == {"first": MONDAY, "last": "2026-01-11"}
    assert [one["file"] for one in told["files"]] == ["agent/1.txt"]


def test_a_first_compilation_is_announced_once(capsys: pytest.CaptureFixture[str]) -> None:
    @njit
    def twice(x: float) -> float:
        return 2 * x

    @njit
    def thrice(x: float) -> float:
        return float(twice(x) + x)

    log_to_standard_error(0, quiet=False)
    with announced():
        assert (thrice(1), thrice(2), twice(1.0)) == (3, 6, 2)
    assert capsys.readouterr().err.count("compiling loops for this processor") == 1


def test_what_conf_composes_to_is_kept_by_its_content(
    project: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("KERF_CACHE", str(tmp_path / "cache"))
    with inside(project):
        first = machine_parameters(MACHINE)
        assert len(list((tmp_path / "cache/conf").iterdir())) == 1
        with mock.patch("pipeline.stages.compose.composed", side_effect=AssertionError):
            assert machine_parameters(MACHINE) == first
        path = Path(f"conf/machine/{MACHINE}.yaml")
        path.write_text(path.read_text().replace("description:", "description: other #"))
        assert machine_parameters(MACHINE) != first
        for broken in (b"\xff", b"\t: [", b""):  # composed again
            for kept in (tmp_path / "cache/conf").iterdir():
                kept.write_bytes(broken or kept.read_bytes()[:-9])
            changed = machine_parameters(MACHINE)
    assert changed["machine"][MACHINE]["identity"]["description"] == "other"


def test_a_command_that_takes_long_says_what_it_is_about_to_who_looks_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for patience, terminal, line in (
        (60.0, True, ""), (0.0, True, "scoring …\n"), (0.0, False, ""),
    ):  # fmt: skip
        monkeypatch.setattr(kerf_options, "PATIENCE_S", patience)
        monkeypatch.setattr(sys.stderr, "isatty", lambda here=terminal: here)
        with kerf_options.progress_line("scoring"):
            for timer in threading.enumerate() if not patience else []:
                if isinstance(timer, threading.Timer):
                    timer.join()
        assert capsys.readouterr().err == line
