"""Every command that writes, on a full disk, ended by a signal, and run twice at once.

What it writes is the old file or the new one, never a part, and nothing is left beside it.
"""

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from tests import bundled_project
from tests.fuzz.seeds import LOGS
from tests.small_project import MACHINE, ROOT, leave, with_conf
from tests.submodels.synthesis import generated_lives
from tests.test_optimise_command import GIVEN, PART

CUT = [word for pair in GIVEN.items() for word in pair if pair[0] != "--objective"]
MOMENTS = 50
OLD = b"what was there before\n"


@dataclass(frozen=True, kw_only=True)
class Written:
    """A command, and the files that it writes (a folder stands for all in it)."""

    words: tuple[str, ...]
    outputs: tuple[str, ...]
    stated: bool = True  # whether the outputs are named by the person


COMMANDS = {
    "interpret": Written(words=("interpret", "part.nc", "--out", "moves.csv"),
                         outputs=("moves.csv",)),
    "simulate": Written(
        words=("simulate", "part.nc", *CUT, "--out", "s.parquet", "--json", "s.json",
               "--page", "s.html"),
        outputs=("s.parquet", "s.json", "s.html"),
    ),
    "optimise": Written(
        words=("optimise", "part.nc", *CUT, "--feed", "50", "1000", "--speed", "1000", "8000",
               "--out", "o.nc", "--json", "o.json", "--page", "o.html"),
        outputs=("o.nc", "o.json", "o.html"),
    ),
    "predict": Written(
        words=("predict", "-m", MACHINE, "spindle", "hour.parquet", "--out", "p.csv"),
        outputs=("p.csv",),
    ),
    "synthesise": Written(
        words=("synthesise", "--machine", MACHINE, "--wear", "100", "--set", "feed=300", "--n", "3",
               "--out", "g.parquet", "--anyway"),
        outputs=("g.parquet",),
    ),
    "ingest": Written(words=("ingest", "log.txt", "--machine", MACHINE, "--out", "in"),
                      outputs=("in",), stated=False),
    "report": Written(words=("report", "--out", "pages"), outputs=("pages",), stated=False),
    "golden": Written(
        words=("golden", "-m", MACHINE, "--first", "2026-01-19", "--last", "2026-01-20"),
        outputs=(f"data/golden/{MACHINE}.json",), stated=False,
    ),
    "fleet": Written(words=("fleet", "recorded"), outputs=("conf/fleet/active.yaml",),
                     stated=False),
    "promote": Written(words=("promote", "-m", MACHINE, "--why", "w", "--to", "2"),
                       outputs=("champions.json",), stated=False),
}  # fmt: skip
QUICK = ("interpret", "fleet")


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project in which the quick commands have something to write."""
    root = tmp_path_factory.mktemp("plain") / "project"
    leave(with_conf(root), "recorded", "mazak01")
    (root / "params.yaml").write_text("fleet: {name: one}\n")
    (root / "part.nc").write_text(PART)
    return root


@pytest.fixture(scope="module")
def full(plain: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project in which every command has something to write."""
    before = os.environ.pop("MLFLOW_TRACKING_URI", None)
    root = bundled_project.project(tmp_path_factory.mktemp("whole") / "project")
    shutil.copytree(plain / "conf", root / "conf", symlinks=True)
    config = root / "conf/config.yaml"
    config.write_text(config.read_text().replace("budget: default", "budget: quick"))
    here = Path.cwd()
    os.chdir(root)
    try:
        for error in (2.0, 0.0):
            bundled_project.spindle(root, error_K=error)
            bundled_project.registered(root)
    finally:
        os.chdir(here)
        if before is not None:
            os.environ["MLFLOW_TRACKING_URI"] = before
    manifest = root / f"data/signals/{MACHINE}/manifest.json"
    known = json.loads(manifest.read_text())
    known["machine"] = {"name": MACHINE, "origin": "simulated"}
    manifest.write_text(json.dumps(known))
    params = root / "params.yaml"
    params.write_text(params.read_text() + "budget: quick\npages: {language: en}\n")
    bundled_project.hour(root).to_parquet(root / "hour.parquet")
    lives = generated_lives.build(root.parent / "lives", settings=generated_lives.SHORT)
    shutil.copytree(lives.folder, root / f"data/champion/{MACHINE}/synthesis", dirs_exist_ok=True)
    (root / "part.nc").write_text(PART)
    (root / "log.txt").write_bytes(LOGS[6])
    return root


@pytest.fixture
def template(name: str, request: pytest.FixtureRequest) -> Path:
    """The project of the command ``name``: that of models is made where one writes of them."""
    found: Path = request.getfixturevalue("plain" if name in QUICK else "full")
    return found


@pytest.fixture(scope="module")
def known_outputs() -> dict[str, dict[str, bytes | None]]:
    """What each command wrote that was left alone, for all tests of it."""
    return {}


@pytest.fixture
def new(
    name: str, template: Path, tmp_path: Path, known_outputs: dict[str, dict[str, bytes | None]]
) -> dict[str, bytes | None]:
    """What the command writes when it is left alone."""
    if name not in known_outputs:
        other = Path(shutil.copytree(template, tmp_path / "other", symlinks=True))
        known_outputs[name] = finished(other, COMMANDS[name])
    return known_outputs[name]


@pytest.fixture
def project(template: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(template, tmp_path / "project", symlinks=True))


def started(project: Path, words: tuple[str, ...], most: int | None = None) -> subprocess.Popen:
    """The command under way, on a disk on which no file grows beyond ``most`` bytes."""

    def small_disk() -> None:
        if most is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

    known = {k: v for k, v in os.environ.items() if k not in ("KERF_RECORDINGS", "COLUMNS")}
    return subprocess.Popen(
        [sys.executable, "-m", "pipeline.app", *words], cwd=project, text=True,
        env={**known, "PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=small_disk,
    )  # fmt: skip


def ran(project: Path, words: tuple[str, ...], most: int | None = None) -> tuple[int, str]:
    done = started(project, words, most)
    said = done.communicate(timeout=600)
    return done.returncode, "".join(said)


def contents(project: Path, command: Written) -> dict[str, bytes | None]:
    """Bytes of the outputs; None where there is no file.

    What a run that was killed has begun beside them is none.
    """
    begun = unfinished(project)
    found: dict[str, bytes | None] = {}
    for name in command.outputs:
        path = project / name
        if path.is_dir():
            found |= {str(p.relative_to(project)): p.read_bytes()
                      for p in path.rglob("*") if p.is_file() and p not in begun}  # fmt: skip
        else:
            found[name] = path.read_bytes() if path.exists() else None
    return found


def unfinished(project: Path) -> list[Path]:
    return [p for p in project.rglob(".*") if ".part" in p.name]


def put_old(project: Path, command: Written) -> dict[str, bytes | None]:
    """Old files in the places of those that are named; the others as they are."""
    if command.stated:
        for name in command.outputs:
            (project / name).write_bytes(OLD)
    return contents(project, command)


def whole(name: str, data: bytes | None, old: bytes | None, new: bytes | None) -> bool:
    """Whether a file is the old one, or one as whole as the new."""
    if data in (old, new):
        return True
    if data is None or new is None:
        return False
    if name.endswith(".parquet"):
        return data[:4] == data[-4:] == b"PAR1"
    if name == "o.json":  # a search that is ended early writes the best that it has
        return set(json.loads(data)) == set(json.loads(new))
    if name in ("o.nc", "o.html"):
        return data.endswith(new[-8:])
    if name.endswith("manifest.json"):  # written as the files are read
        return set(json.loads(data)) == set(json.loads(new))
    if name.endswith("champions.json"):  # holds the time of the promotion
        return data.endswith(b"}\n") and abs(len(data) - len(new)) < 100
    return False


def checked(project: Path, command: Written, old: dict, new: dict) -> None:
    found = contents(project, command)
    for name, data in found.items():
        known = name in old or name in new
        assert known and whole(name, data, old.get(name), new.get(name)), (
            f"{name} is neither the old file nor the new one: {(data or b'')[:80]!r} ..."
        )


def cases(*quick: str) -> list:
    """Every command; in the ordinary suite those that are ``quick``."""
    slow = pytest.mark.proof
    return [n if n in quick else pytest.param(n, marks=slow) for n in COMMANDS]


def finished(project: Path, command: Written) -> dict[str, bytes | None]:
    status, said = ran(project, command.words)
    assert status == 0, said
    assert not unfinished(project)
    return contents(project, command)


@pytest.mark.parametrize("name", cases(*QUICK))
def test_a_full_disk_leaves_the_old_files_and_one_sentence(
    name: str, project: Path, new: dict[str, bytes | None]
) -> None:
    command = COMMANDS[name]
    old = put_old(project, command)
    changed = [data for key, data in new.items() if data is not None and data != old.get(key)]
    largest = max(len(data) for data in changed)
    status, said = ran(project, command.words, most=largest - 1)
    reason = "disk I/O error" if name == "promote" else "File too large"  # its database is first
    sentence = next(line for line in said.splitlines() if line.startswith("kerf: "))
    assert status == 2 and "cannot be written (" in sentence and reason in sentence, said
    assert "Traceback" not in said
    assert name == "promote" or any(Path(key).name in sentence for key in new)
    checked(project, command, old, new)
    if command.stated:  # together, or none of them
        assert contents(project, command) == old
    assert not unfinished(project)


@pytest.mark.proof
@pytest.mark.parametrize("name", COMMANDS)
def test_a_signal_at_any_moment(
    name: str, project: Path, template: Path, tmp_path: Path, record_property
) -> None:
    """Half of the moments anywhere in the run, half right after the first file is begun."""
    command, rng = COMMANDS[name], random.Random(name)
    other = Path(shutil.copytree(template, tmp_path / "other", symlinks=True))
    begin = time.monotonic()
    new, length = finished(other, command), time.monotonic() - begin
    statuses, writing = [], 0
    for moment in range(MOMENTS):
        shutil.rmtree(project)
        shutil.copytree(template, project, symlinks=True)
        old = put_old(project, command)
        number = rng.choice((signal.SIGTERM, signal.SIGTERM, signal.SIGINT, signal.SIGKILL))
        done = started(project, command.words)
        if moment % 2:
            folders = {(project / out).parent for out in command.outputs}
            folders |= {project / out for out in command.outputs}
            while done.poll() is None and not any(
                entry.name.endswith(".part")
                for folder in folders if folder.is_dir() for entry in os.scandir(folder)
            ):  # fmt: skip
                time.sleep(1e-4)
            time.sleep(rng.uniform(0.0, 0.01))
        else:
            time.sleep(rng.uniform(0.0, length))
        writing += done.poll() is None and bool(unfinished(project))
        done.send_signal(number)
        said = "".join(done.communicate(timeout=600))
        statuses.append(done.returncode)
        checked(project, command, old, new)
        assert "Traceback" not in said or done.returncode in (-2, 1, 130), said
        if number != signal.SIGKILL:
            assert not unfinished(project), (number, done.returncode, said)
        if number == signal.SIGTERM:  # -15 before the command has begun
            assert done.returncode in (0, 143, -15), said
    record_property("measured", f"{name}: {length:.1f} s, {MOMENTS} signals, {writing} while a "
                    f"file was being written, exit statuses {sorted(set(statuses))}")  # fmt: skip


@pytest.mark.parametrize("name", cases("interpret"))
def test_two_runs_at_once_leave_whole_files(
    name: str, project: Path, new: dict[str, bytes | None]
) -> None:
    command = COMMANDS[name]
    old = put_old(project, command)
    both = [started(project, command.words) for _ in range(2)]
    while any(one.poll() is None for one in both):
        if command.stated:
            checked(project, command, old, new)
        time.sleep(0.01)
    said = ["".join(one.communicate()) for one in both]
    if command.stated:
        assert [one.returncode for one in both] == [0, 0], said
    checked(project, command, old, new)
    assert not unfinished(project)
    for path in project.rglob("*.parquet"):
        pq.read_metadata(path)


BEGUN = """
import atexit, os, signal, sys, time, weakref
from pathlib import Path
from pipeline.schema.files import ended_by_signals, replacing
class Thing: pass
def signalled():
    thing = Thing()
    ref = weakref.ref(thing, lambda _: os.kill(os.getpid(), signal.SIGTERM))
    del thing
    time.sleep(20)
def changed():
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(20)
    finally:
        None.nothing
with ended_by_signals(), replacing(Path(sys.argv[1])) as part:
    part.write_text("half")
    %s
"""
"""What a run does with a file that it has begun."""


@pytest.mark.parametrize("way", ["signalled()", "changed()", "atexit.register(signalled)"])
def test_a_signal_ends_the_run_whatever_happens_on_its_way(way: str, tmp_path: Path) -> None:
    """In a callback Python ignores what is raised, a library raises another, the end has begun."""
    path = tmp_path / "file"
    done = subprocess.run(
        [sys.executable, "-c", BEGUN % way, path], capture_output=True, text=True, timeout=60,
        env={**os.environ, "PYTHONPATH": str(ROOT)}, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (143, "")
    assert [p.name for p in tmp_path.iterdir()] == (["file"] if "atexit" in way else [])
