"""The command ``kerf`` in a project of its own."""

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import Result
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.registry import register
from tests.fuzz.seeds import LOGS
from tests.small_project import MACHINE, MONDAY, ROOT, build, change, inside, new_project

COMMANDS = (
    "ingest", "status", "report", "fleet", "golden", "promote", "interpret", "simulate", "check",
    "optimise",
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
        f"kerf: {path}: data/raw/{MACHINE}/Devices.xml does not exist: kinds and units are not "
        "known\n"
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
        ("golden", "lathe9", "--first", MONDAY, "--last", MONDAY),
    ):
        said = refused(project, *words)
        assert "conf/machine/lathe9.yaml does not exist" in said
        assert "mazak01, mill01, mill02" in said


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


def test_status_without_a_registry(project: Path) -> None:
    change(project, "fleet", machines=[MACHINE, "mill02"])
    done = kerf(project, "status")
    head, first, second = done.stdout.splitlines()
    assert done.exit_code == 0
    assert head.split("  ")[0] == "machine" and head.endswith("previous")
    assert first.split("  ")[0] == MACHINE and second.split("  ")[0] == "mill02"
    for line in (first, second):
        assert "simulated" in line and "not judged: run `dvc repro`" in line
        assert line.split()[-4:] == ["-", "-", "-", "-"]
    assert not (project / "mlflow.db").exists()


def judged(project: Path, verdict: str, mae: float) -> Path:
    """A folder as the stages leave it; the model in it is not one that predicts."""
    folder = project / f"data/models/{MACHINE}"
    (folder / "residual").mkdir(parents=True, exist_ok=True)
    (folder / "residual/features.json").write_text("{}")
    (folder / "spindle_thermal.json").write_text(json.dumps({"mae": mae}))
    scores = {"model": {"mae_K": mae, "rmse_K": mae, "max_K": None}}
    (folder / "validation.json").write_text(
        json.dumps(
            {"machine": MACHINE, "origin": "simulated", "verdict": verdict, "golden": None,
             "windows": {"all": scores, "days": []}}
        )
    )  # fmt: skip
    return folder


def test_status_and_promotion_with_a_registry(project: Path) -> None:
    assert f"{MACHINE} has no challenger" in refused(project, "promote", MACHINE)
    for verdict, mae in (("passed", 1.25), ("passed", 0.75)):
        register(MACHINE, judged(project, verdict, mae), {}, project)
    row = kerf(project, "status").stdout.splitlines()[1]
    assert row.split("  ")[0] == MACHINE
    assert "passed" in row and "0.75" in row
    assert "version 1, passed  version 2, passed" in row and row.endswith("-")
    done = kerf(project, "promote", MACHINE)
    assert (done.exit_code, done.stdout) == (0, f"{MACHINE}: version 2 is champion\n")
    assert kerf(project, "status").stdout.splitlines()[1].endswith("version 1, passed")
    register(MACHINE, judged(project, "failed", 3.0), {}, project)
    assert "has the verdict 'failed'" in refused(project, "promote", MACHINE)


def test_a_verdict_that_is_broken_is_named(project: Path) -> None:
    (judged(project, "passed", 1.0) / "validation.json").write_text("{")
    assert f"data/models/{MACHINE}/validation.json is no JSON" in refused(project, "status")


def active(project: Path) -> str:
    return (project / "conf/fleet/active.yaml").readlink().name


def test_another_fleet_is_made_active(project: Path) -> None:
    done = kerf(project, "fleet", "recorded")
    assert (done.exit_code, done.stdout) == (
        0,
        "fleet recorded: mazak01, hurco, emps, umich_mill, kistler_slot\n",
    )
    assert active(project) == "recorded.yaml"
    assert kerf(project, "fleet", "recorded").exit_code == 0
    with inside(project):
        build(project, "compose")
    assert "mazak01" in (project / "params.yaml").read_text()
    assert (project / "data/truth").is_dir()
    kerf(project, "fleet", "simulated")
    assert active(project) == "simulated.yaml"


@pytest.mark.parametrize("name", ["active", "nowhere", "../fleet/recorded"])
def test_a_fleet_that_is_none_is_refused(name: str, project: Path) -> None:
    said = refused(project, "fleet", name)
    assert "known fleets: recorded, simulated" in said
    assert active(project) == "simulated.yaml"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: own\nmachines: [mill01]\nspindels: [mill01]\n", "spindels"),
        ("name: own\nmachines: [mill01]\nspindles: [mill02]\n", "['mill02']"),
        ("name: own\nmachines: [lathe9]\n", "lathe9"),
        ("name: [own\n", "conf/fleet/own.yaml is no fleet"),
        ("machines: mill01\nname: own\n", "'mill01' is no list"),
    ],
)
def test_a_fleet_that_is_wrong_is_refused(text: str, said: str, project: Path) -> None:
    (project / "conf/fleet/own.yaml").write_text(text)
    assert said in refused(project, "fleet", "own")
    assert active(project) == "simulated.yaml"


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings/nist_mazak01"
    for name in ("Devices.xml", "week_1/1.txt", "week_1/2.txt", "week_1/notes.md", "other/3.txt"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(name)
    for name in ("nist_box/logs/1.txt", "emps/1.mat", "umich_mill/experiment_01.csv",
                 "kistler_slot/n6000f600ap3.csv"):  # fmt: skip
        (tmp_path / "recordings" / name).parent.mkdir(parents=True)
        (tmp_path / "recordings" / name).write_text("1")
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


def test_a_golden_week_is_frozen(project: Path) -> None:
    entry = {"sha256": "ab" * 32, "last": f"{MONDAY}T15:00:00Z"}
    folder = project / f"data/signals/{MACHINE}"
    folder.mkdir(parents=True)
    (folder / "manifest.json").write_text(json.dumps({"files": {"agent/1.txt": entry}}))
    done = kerf(project, "golden", MACHINE, "--first", MONDAY, "--last", "2026-01-11")
    assert done.exit_code == 0 and done.stdout.startswith("froze 1 files, sha256 ")
    frozen = json.loads((project / f"data/golden/{MACHINE}.json").read_text())
    assert frozen["files"] == [{"file": "agent/1.txt", "sha256": "ab" * 32}]
    assert frozen["week"] == {"first": MONDAY, "last": "2026-01-11"}


@pytest.mark.parametrize(
    ("first", "last", "said"),
    [
        ("monday", MONDAY, "'monday' is no day: write it as YYYY-MM-DD"),
        (MONDAY, "2026-02-30", "'2026-02-30' is no day"),
        ("2026-01-06", MONDAY, f"--first 2026-01-06 lies after --last {MONDAY}"),
        ("2025-01-06", "2025-01-07", f"{MACHINE} has no record from 2025-01-06 to 2025-01-07"),
        (MONDAY, MONDAY, "manifest.json does not exist: run `dvc repro ingest@mill01` first"),
    ],
)
def test_a_week_that_cannot_be_frozen(first: str, last: str, said: str, project: Path) -> None:
    if "has no record" in said:
        folder = project / f"data/signals/{MACHINE}"
        folder.mkdir(parents=True)
        (folder / "manifest.json").write_text('{"files": {}}')
    assert said in refused(project, "golden", MACHINE, "--first", first, "--last", last)
    assert not list((project / "data/golden").iterdir())


def test_the_report_is_written_where_it_is_asked_for(project: Path, tmp_path: Path) -> None:
    log = project / f"data/raw/{MACHINE}/agent/2026-01-05.txt"
    log.parent.mkdir(parents=True)
    log.write_bytes(LOGS[6])
    build(project, "ingest")
    done = kerf(project, "report", "--out", tmp_path / "pages")
    assert (done.exit_code, done.stdout) == (0, f"wrote {tmp_path / 'pages/index.html'}\n")
    assert MACHINE in (tmp_path / "pages/index.html").read_text()


def test_the_installed_command_is_this_one() -> None:
    done = subprocess.run(
        [Path(sys.executable).with_name("kerf"), "--help"], capture_output=True, text=True,
        cwd=ROOT, check=True,
    )  # fmt: skip
    assert "ingest" in done.stdout
