"""Bad files through ``kerf ingest``: accounted for or refused in a sentence, never a traceback."""

import gzip
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

import pipeline.app.incident_commands
import pipeline.app.life_commands
import pipeline.app.program_commands  # noqa: F401, its commands
from pipeline.app.commands import app
from pipeline.schema.identity import MachineIdentity
from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout, source_of
from pipeline.signals.ingest import ingest
from tests.fuzz.seeds import DOCUMENTS, LOGS, TREES
from tests.small_project import ROOT, inside

RECORDINGS = os.environ.get("KERF_RECORDINGS")

MACHINE = """\
identity: {name: bench01, origin: recorded}
records:
  - {format: shdr, files: "*.txt"}
  - &table
    format: csv
    files: "*.csv"
    table:
      time: Time
      time_unit: iso
      columns: {spindle_load: {column: Load, unit: percent}}
  - {<<: *table, format: parquet, files: "*.parquet"}
  - {<<: *table, format: matlab, files: "*.mat"}
  - {<<: *table, format: hdf5, files: "*.h5"}
"""

LOG, DOCUMENT, TREE = LOGS[0], DOCUMENTS[0], TREES[0]
TABLE = "Time,Load\n" + "".join(f"2024-03-04T10:00:{s:02d},{s}.5\n" for s in range(60))
NOISE = np.random.default_rng(7).bytes(100_000)


def columns(**values: list[object]) -> bytes:
    target = io.BytesIO()
    pq.write_table(pa.table(values), target)
    return target.getvalue()


PARQUET = columns(Time=[f"2024-03-04T10:00:{s:02d}" for s in range(60)], Load=[1.5] * 60)
HDF5 = b"\x89HDF\r\n\x1a\n"


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("project")
    (folder / "conf").symlink_to(make_conf(tmp_path_factory.mktemp("conf")))
    return folder


def make_conf(folder: Path) -> Path:
    """The project's conf with one more machine."""
    for path in (ROOT / "conf").iterdir():
        (folder / path.name).symlink_to(path)
    (folder / "machine").unlink()
    (folder / "machine").mkdir()
    (folder / "machine/bench01.yaml").write_text(MACHINE)
    for name in ("mill01", "mill02"):  # the fleet that is active
        (folder / f"machine/{name}.yaml").symlink_to(ROOT / f"conf/machine/{name}.yaml")
    (folder / "fleet").unlink()
    (folder / "fleet").mkdir()
    shutil.copy(ROOT / "conf/fleet/simulated.yaml", folder / "fleet/active.yaml")
    return folder


@dataclass(frozen=True)
class Answer:
    """What ``kerf ingest`` answered to one file."""

    status: int
    read: int
    kept: int
    rejected: int
    reasons: list[str]
    lines: list[int | None]
    out: Path


Kerf = Callable[..., Answer]


@pytest.fixture
def kerf(project: Path, tmp_path: Path) -> Kerf:
    """Write a file, ingest it, and hold the answer to what every answer must be."""

    def answer(name: str, data: bytes | str) -> Answer:
        path = tmp_path / name
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        out = tmp_path / f"{name}.out"
        with inside(project):
            done = CliRunner().invoke(
                app, ["ingest", str(path), "--machine", "bench01", "--out", str(out)]
            )
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        assert done.exit_code in (0, 2), done.output
        (row,) = (line for line in done.stdout.splitlines() if line.startswith(f"{path} "))
        read, kept, rejected = map(int, row.removeprefix(str(path)).split())
        assert read == kept + rejected
        said = pq.read_table(out / "rejected.parquet").to_pylist()
        assert len(said) == rejected and all(r["reason"] and r["file"] == name for r in said)
        if done.exit_code == 2:
            assert (read, kept, rejected) == (1, 0, 1)
            assert done.stderr == f"kerf: {path}: {said[0]['reason']}\n"
        assert bool(rejected) == ("each with its reason in" in done.stdout)
        for one in said:  # what ends early is said where it is read, and by the manifest
            if kept and one["reason"].startswith("the gzip stream"):
                entry = json.loads((out / "manifest.json").read_text())["files"][name]
                ends = f"{one['reason']}, for all from line {one['line']} on is lost"
                assert done.stderr == f"kerf: {path}: {ends}\n"
                assert entry["notes"] == {"ends_early": ends}
        return Answer(
            done.exit_code, read, kept, rejected,
            [r["reason"] for r in said], [r["line"] for r in said], out,
        )  # fmt: skip

    return answer


def words_in(folder: Path) -> str:
    """All that stands in the tables and documents of a folder."""
    tables = [str(pq.read_table(p).to_pylist()) for p in folder.rglob("*.parquet")]
    return " ".join([*tables, *(p.read_text() for p in folder.rglob("*.json"))])


GOOD = {
    "log.txt": LOG, "log.txt.gz": gzip.compress(LOG), "streams.xml": DOCUMENT,
    "streams.json": TREE, "table.csv": TABLE, "table.csv.gz": gzip.compress(TABLE.encode()),
    "table.parquet": PARQUET,
}  # fmt: skip


@pytest.mark.parametrize("name", GOOD)
def test_good_files_are_read(name: str, kerf: Kerf) -> None:
    found = kerf(name, GOOD[name])
    assert (found.status, found.rejected) == (0, 0)
    assert found.kept >= 7


@pytest.mark.parametrize("name", [*GOOD, "x.mat", "x.h5", "x", ".txt"])
def test_an_empty_file_is_refused(name: str, kerf: Kerf) -> None:
    if name.startswith("."):
        name = "hidden.txt"
    assert kerf(name, b"").status == 2


@pytest.mark.parametrize("magic", [b"", b"PAR1", HDF5, b"MATLAB 5.0 MAT-file", b"\x1f\x8b\x08",
                                   b"<?xml ", b"{", b"\xff\xfe", b"--", b"\0\0\0"])  # fmt: skip
@pytest.mark.parametrize("name", [
    "noise.txt", pytest.param("noise.csv", marks=pytest.mark.proof),
])  # fmt: skip
def test_noise_is_refused(name: str, magic: bytes, kerf: Kerf) -> None:
    assert kerf(name, magic + NOISE).kept == 0


SHARES = [0.02, 0.3, 0.5, 0.8, 0.97]
MANY = pytest.mark.proof
"""Of further cases of one claim."""


def mostly_proof(cases: list[Any], *ordinary: Any) -> list[Any]:
    """All cases; those that are not ``ordinary`` as proof."""
    return [one if one in ordinary else pytest.param(one, marks=MANY) for one in cases]


@pytest.mark.parametrize("share", mostly_proof(SHARES, 0.8))
@pytest.mark.parametrize("name", GOOD)
def test_a_file_that_is_cut_says_so(name: str, share: float, kerf: Kerf) -> None:
    data = GOOD[name].encode() if isinstance(GOOD[name], str) else GOOD[name]
    found = kerf(name, data[: int(share * len(data))])
    if not name.endswith((".txt", ".csv")):  # a line that is cut may be a line
        assert found.rejected > 0


LONG = 2_000_000


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("log.txt", f"2024-03-04T10:00:00Z|msg|{'x' * LONG}\n2024-03-04T10:00:01Z|a|1\n"),
        ("log.txt", f"{'x' * LONG}\n2024-03-04T10:00:01Z|a|1\n"),
        ("log.txt", f"2024-03-04T10:00:00Z{'|a|1' * (LONG // 4)}\n"),
        ("log.txt", "|" * LONG),
        ("table.csv", f"{TABLE}2024-03-04T10:01:00,{'9' * LONG}\n"),
        ("table.csv", f"{TABLE}{',' * LONG}\n"),
        ("table.csv", '"' * LONG + "\n" + TABLE),
        ("streams.xml", DOCUMENT.replace(b"ACTIVE", b"x" * LONG)),
        ("streams.xml", DOCUMENT.replace(b"'", b"&#65;").replace(b"over", b"&#65;" * (LONG // 5))),
        ("streams.xml", DOCUMENT.replace(b"<Samples>", b"<a>" * (LONG // 3))),
        ("streams.json", TREE.replace(b"ACTIVE", b"x" * LONG)),
        ("streams.json", b"[" * LONG),
        ("streams.json", TREE.replace(b"1.5", b"9" * LONG)),
    ],
    ids=lambda value: value if isinstance(value, str) and len(value) < 20 else "",
)
def test_two_million_characters_on_a_line(name: str, data: str | bytes, kerf: Kerf) -> None:
    kerf(name, data)


def test_another_encoding_is_said(kerf: Kerf) -> None:
    table = "Zeit;Wärme\n1;2,5\n"
    assert kerf("table.csv", table.encode("cp1252")).status == 2
    late = TABLE.encode() + "2024-03-04T10:01:00,1.5 µ\n".encode("cp1252")
    assert kerf("late.csv", late).rejected > 0
    log = "2024-03-04T10:00:00Z|msg|Kühlmittel\n"
    for encoding in ("latin-1", "utf-16"):
        found = kerf(f"{encoding}.txt", log.encode(encoding))
        assert found.kept == 1 and "Kühlmittel" in words_in(found.out)
    wrong = kerf("wrong.xml", DOCUMENT.replace(b"over", b"\xfcber"))
    assert (wrong.kept, wrong.rejected) == (9, 1)


LAUGHS = "".join(f'<!ENTITY a{n + 1} "{f"&a{n};" * 10}">' for n in range(12))
DECLARED = '<?xml version="1.0"?><!DOCTYPE m [{}]>' + DOCUMENT.decode().partition("?>")[2]


ENTITIES = (
    f'<!ENTITY a0 "ha">{LAUGHS}',
    '<!ENTITY a12 SYSTEM "file://{secret}">',
    '<!ENTITY % outside SYSTEM "file://{secret}"> %outside; <!ENTITY a12 "x">',
)
"""Billion laughs, an external entity, an external parameter entity."""


def test_entities_are_neither_expanded_nor_fetched(project: Path, tmp_path: Path) -> None:
    """In records and in device documents."""
    secret, out, paths = tmp_path / "secret.txt", tmp_path / "out", []
    secret.write_text("the-combination-is-4711")
    for number, declared in enumerate(ENTITIES):
        document = DECLARED.format(declared.format(secret=secret)).replace("over travel", "&a12;")
        for kind in ("Streams", "Devices"):
            paths.append(tmp_path / f"{number}-{kind}.xml")
            paths[-1].write_text(document.replace("MTConnectStreams", f"MTConnect{kind}"))
    # a quarter of the memory that ten to the twelfth power of laughs would need
    words = ["-m", "pipeline.app", "ingest", *map(str, paths), "--machine", "bench01"]
    limited = f"ulimit -v 8000000; exec {shlex.join([sys.executable, *words])}"
    done = subprocess.run(
        ["bash", "-c", f"{limited} --out {out}"],
        cwd=project, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    for path, line in zip(paths, done.stderr.splitlines(), strict=True):
        assert line.startswith(f"kerf: {path}: ") and "document type declaration" in line
    assert "combination-is" not in done.stdout + done.stderr + words_in(out)


def refused(project: Path, *files: str | Path, machine: str = "bench01") -> str:
    """The one sentence with which a command is refused as a whole."""
    words = ["ingest", *map(str, files), "--machine", machine, "--out", str(project / "never")]
    with inside(project):
        done = CliRunner().invoke(app, words)
    assert isinstance(done.exception, SystemExit) and done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert not (project / "never").exists()
    return done.stderr


def test_what_is_no_file_is_named(project: Path, tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_bytes(LOG)
    (tmp_path / "dangling.txt").symlink_to("gone")
    for path, said in (
        (tmp_path, "is no file"),
        (tmp_path / "missing.txt", "does not exist"),
        (tmp_path / "dangling.txt", "does not exist"),
    ):
        assert refused(project, tmp_path / "log.txt", path).startswith(f"kerf: {path} {said}")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_a_file_without_permission_is_refused(kerf: Kerf, tmp_path: Path, project: Path) -> None:
    (tmp_path / "closed.txt").write_bytes(LOG)
    (tmp_path / "closed.txt").chmod(0)
    with inside(project):
        done = CliRunner().invoke(
            app, ["ingest", str(tmp_path / "closed.txt"), "--machine", "bench01", "--out",
                  str(tmp_path / "out")]
        )  # fmt: skip
    assert done.exit_code == 2 and "Permission denied" in done.stderr


def test_a_bad_file_does_not_take_the_good_with_it(project: Path, tmp_path: Path) -> None:
    names = {"a.txt": LOG, "b.csv": b"", "c.parquet": PARQUET[:100], "d.xml": DOCUMENT}
    for name, data in names.items():
        (tmp_path / name).write_bytes(data)
    with inside(project):
        done = CliRunner().invoke(
            app, ["ingest", *(str(tmp_path / n) for n in names), "--machine", "bench01", "--out",
                  str(tmp_path / "out")]
        )  # fmt: skip
    assert done.exit_code == 2
    rows = {line.split()[0]: line.split()[1:] for line in done.stdout.splitlines()[1:5]}
    assert [rows[str(tmp_path / n)][2] for n in names] == ["0", "1", "1", "0"]
    assert [line.split(": ")[1] for line in done.stderr.splitlines()] == [
        str(tmp_path / "b.csv"), str(tmp_path / "c.parquet"),
    ]  # fmt: skip


MIXED = ("mtconnect_docs/*", "nist_box/logs/*", "nist_mazak01/xml_streams/*")
FOUND = [p for pattern in MIXED for p in sorted(Path(RECORDINGS or "/nowhere").glob(pattern))]
ANY_TABLE = RecordSource(
    format="csv",
    files="*.csv",
    table=TableLayout(columns={"a": ColumnSource(column="x", unit="")}, time="x"),
)


@pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder of recordings")
def test_the_recordings_are_there() -> None:
    assert len(FOUND) > 150


@pytest.mark.parametrize("path", mostly_proof(FOUND, *FOUND[::15]), ids=lambda path: path.name)
def test_every_recording_is_read_or_rejected_with_a_reason(path: Path, tmp_path: Path) -> None:
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw" / path.name).symlink_to(path)
    source = source_of(path, [ANY_TABLE])
    assert source is not None
    found = ingest(tmp_path / "raw", tmp_path / "out", [source], MachineIdentity(name="any"))
    assert found.read == found.kept + found.rejected
    said = pq.read_table(tmp_path / "out/rejected.parquet").to_pylist()
    assert len(said) == found.rejected and all(r["reason"] for r in said)
    (entry,) = json.loads((tmp_path / "out/manifest.json").read_text())["files"].values()
    assert (entry["output"] is None) == (entry["reason"] is not None)
    expected = records_in(path)
    if expected is not None and not found.rejected:
        assert found.read == expected


def records_in(path: Path) -> int | None:
    """Records of a file, counted without knowing more than how one begins; None when that fails."""
    text = re.sub(rb"<!--.*?-->", b"", path.read_bytes(), flags=re.S)
    if b"<MTConnectStreams" in text[:2000]:
        return len(re.findall(rb"<(?:\w+:)?\w+\s[^>]*?\bdataItemId\s*=[^>]*?\btimestamp\s*=", text))
    if b"<MTConnectDevices" in text[:2000]:
        return len(re.findall(rb"<(?:\w+:)?DataItem[\s>]", text))
    return len(text.splitlines()) if path.parts[-3:-1] == ("nist_box", "logs") else None
