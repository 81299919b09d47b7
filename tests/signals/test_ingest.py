"""Ingest: only what changed is read, and any history ends where a build from nothing does."""

import dataclasses
import json
import os
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st
from proof_sizes import few_and_many

from pipeline.schema.identity import MachineIdentity
from pipeline.signals import ingest as ingesting
from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout
from pipeline.signals.ingest import NOT_NAMED, Ingested, ingest
from pipeline.signals.shdr import log
from pipeline.signals.store import parquet_name
from tests.signals.shdr_log import DEVICES

MILL = MachineIdentity(name="mill", origin="simulated")
LOGS = RecordSource(format="shdr", files="agent/*.txt", devices="Devices.xml")
TABLES = RecordSource(
    format="csv",
    files="air/*.csv",
    table=TableLayout(
        columns={"ambient_temperature": ColumnSource(column="Air", unit="degC")},
        time="Time",
        time_unit="iso",
    ),
)
SOURCES = (LOGS, TABLES)

GOOD = "2024-03-04T10:00:00Z|Xact|1.5|exec|ACTIVE\n2024-03-04T10:00:01Z|Xact|2\n"
DIRTY = "2024-03-04T10:00:02Z|Xact|none\nno line of a log\n2024-03-04T10:00:03Z|Xact|3\n"
TABLE = "Time,Air,Door\n2024-03-04T10:00:00,20.5,1\n2024-03-04T09:59:59,20.4,0\n"
EMPTY = ""


def write(raw: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (raw / name).parent.mkdir(parents=True, exist_ok=True)
        (raw / name).write_text(text)


@pytest.fixture
def raw(tmp_path: Path) -> Path:
    folder = tmp_path / "raw"
    write(folder, {"Devices.xml": DEVICES, "agent/1.txt": GOOD, "agent/2.txt": DIRTY,
                   "air/1.csv": TABLE})  # fmt: skip
    return folder


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "signals"


def run(raw: Path, out: Path, sources: Sequence[RecordSource] = SOURCES) -> list[str]:
    """Ingest; the files that were read."""
    read: list[str] = []
    ingest(raw, out, sources, MILL, progress=read.append)
    return read


def entries(out: Path) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = json.loads((out / "manifest.json").read_text())["files"]
    return found


def rejected(out: Path) -> list[tuple[str, int | None, str]]:
    table = pq.read_table(out / "rejected.parquet").to_pylist()
    return [(r["file"], r["line"], r["reason"]) for r in table]


def content(out: Path) -> dict[str, Any]:
    """All that an ingest leaves: every Parquet as its schema and rows, the manifest as it is."""
    found: dict[str, Any] = {}
    for path in sorted(p for p in out.rglob("*") if p.is_file()):
        name = path.relative_to(out).as_posix()
        if path.suffix == ".parquet":
            table = pq.read_table(path)
            found[name] = (table.schema.to_string(), table.to_pylist())
        else:
            found[name] = path.read_text()
    return found


def from_nothing(raw: Path, sources: Sequence[RecordSource] = SOURCES) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        run(raw, Path(folder) / "signals", sources)
        return content(Path(folder) / "signals")


def test_what_is_counted(raw: Path, out: Path) -> None:
    found = ingest(raw, out, SOURCES, MILL)
    assert found == Ingested(files_read=3, files_kept=0, read=8, kept=6, rejected=2)
    rows = [pq.read_table(one).num_rows for one in (out / "observations").glob("*.parquet")]
    assert sum(rows) == 4
    first = entries(out)["agent/1.txt"]
    assert first["first"] == "2024-03-04T10:00:00.000000000Z"
    assert first["last"] == "2024-03-04T10:00:01.000000000Z"
    assert [e["kept"] + e["rejected"] for e in entries(out).values()] == [3, 3, 2]
    assert ingest(raw, out, SOURCES, MILL) == dataclasses.replace(found, files_read=0, files_kept=3)


def test_part_programs_are_kept_and_no_signal(raw: Path, out: Path) -> None:
    (raw / "programs").mkdir()
    (raw / "programs/part.nc").write_bytes(b"%\r\nG1 X1.\xff\r\n%")
    sources = (*SOURCES, RecordSource(format="program", files="programs/*.nc"))
    before = ingest(raw, out, SOURCES, MILL)
    found = ingest(raw, out, sources, MILL)
    assert (found.read, found.kept) == (before.read, before.kept + 1)  # it was a rejected file
    entry = entries(out)["programs/part.nc"]
    assert (entry["format"], entry["rows"], entry["output"]) == ("program", 0, None)
    assert not [r for r in rejected(out) if r[0] == "programs/part.nc"]
    assert run(raw, out, sources) == []


def test_only_what_is_new_is_read(raw: Path, out: Path) -> None:
    assert run(raw, out) == ["agent/1.txt", "agent/2.txt", "air/1.csv"]
    assert run(raw, out) == []
    write(raw, {"agent/3.txt": GOOD})
    assert run(raw, out) == ["agent/3.txt"]
    (raw / "agent/1.txt").touch()  # a new time says nothing about what is in it
    write(raw, {"agent/2.txt": DIRTY + GOOD})
    assert run(raw, out) == ["agent/2.txt"]


FILES = st.sampled_from(["agent/1.txt", "agent/2.txt", "agent/a__b.txt", "agent/a/b.txt",
                         "air/1.csv", "strange.bin", "Devices.xml"])  # fmt: skip
TEXTS = st.sampled_from([GOOD, DIRTY, TABLE, EMPTY, DEVICES, None])


def _ends_as_from_nothing(history: list[dict[str, str | None]]) -> None:
    sources = (dataclasses.replace(LOGS, files="agent/**/*.txt"), TABLES)
    with tempfile.TemporaryDirectory() as folder:
        raw, out = Path(folder) / "raw", Path(folder) / "signals"
        raw.mkdir()
        for changes in history:
            write(raw, {name: text for name, text in changes.items() if text is not None})
            for name in (name for name, text in changes.items() if text is None):
                (raw / name).unlink(missing_ok=True)
            run(raw, out, sources)
        assert content(out) == from_nothing(raw, sources)


test_any_history_ends_where_a_build_from_nothing_does, test_many_histories_end_alike = few_and_many(
    _ends_as_from_nothing, 6, 60,
    history=st.lists(st.dictionaries(FILES, TEXTS, max_size=4), min_size=1, max_size=5),
)  # fmt: skip


def test_a_file_that_no_source_names_is_rejected(raw: Path, out: Path) -> None:
    write(raw, {"notes.md": "said", ".hidden": "x", ".cache/log.txt": GOOD})
    run(raw, out)
    entry = entries(out)["notes.md"]
    assert (entry["read"], entry["kept"], entry["rejected"]) == (1, 0, 1)
    assert entry["reason"] == NOT_NAMED and entry["output"] is None
    assert ("notes.md", None, NOT_NAMED) in rejected(out)
    assert not {".hidden", ".cache/log.txt", "Devices.xml"} & set(entries(out))
    later = RecordSource(format="shdr", files="notes.md")
    write(raw, {"notes.md": GOOD})
    run(raw, out, (*SOURCES, later))
    assert entries(out)["notes.md"]["kept"] == 3
    assert "notes.md" not in {file for file, _, _ in rejected(out)}


def test_a_file_that_cannot_be_read_is_a_rejected_file(raw: Path, out: Path) -> None:
    write(raw, {"agent/1.txt": EMPTY, "agent/3.txt": "words, no log\n" * 3})
    run(raw, out)
    for name, said in (("agent/1.txt", "no record"), ("agent/3.txt", "form of a log")):
        entry = entries(out)[name]
        assert (entry["read"], entry["kept"], entry["rejected"]) == (1, 0, 1)
        assert said in entry["reason"]
        assert (name, None, entry["reason"]) in rejected(out)
        assert not (out / "observations" / parquet_name(name)).exists()
    assert run(raw, out) == []  # it is known to be unreadable


def test_a_link_to_nothing_is_a_rejected_file(raw: Path, out: Path) -> None:
    (raw / "agent/4.txt").symlink_to("gone.txt")
    run(raw, out)
    assert "link to nothing" in entries(out)["agent/4.txt"]["reason"]
    write(raw, {"agent/gone.txt": GOOD})
    assert run(raw, out) == ["agent/4.txt", "agent/gone.txt"]


def test_records_behind_a_linked_folder_are_read(raw: Path, out: Path, tmp_path: Path) -> None:
    (raw / "agent").rename(tmp_path / "elsewhere")
    (raw / "agent").symlink_to(tmp_path / "elsewhere")
    run(raw, out)
    assert entries(out)["agent/1.txt"]["kept"] == 3


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read every file")
def test_a_file_that_may_not_be_read_is_a_rejected_file(raw: Path, out: Path) -> None:
    (raw / "agent/1.txt").chmod(0)
    run(raw, out)
    assert "Permission denied" in entries(out)["agent/1.txt"]["reason"]
    (raw / "agent/1.txt").chmod(0o600)
    assert run(raw, out) == ["agent/1.txt"]


def test_other_code_reads_anew(raw: Path, out: Path, tmp_path: Path) -> None:
    run(raw, out)
    code = tmp_path / "signals_code"
    here = Path(ingesting.__file__)
    shutil.copytree(here.parent, code, ignore=shutil.ignore_patterns("__pycache__"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ingesting, "__file__", str(code / here.name))
        assert run(raw, out) == []  # the same code in another place
        with (code / "tables/csv_table.py").open("a") as file:
            file.write("# changed\n")
        assert run(raw, out) == []  # a comment reads nothing in another way
        with (code / "tables/csv_table.py").open("a") as file:
            file.write("CHANGED = 1\n")
        assert len(run(raw, out)) == 3
    assert len(run(raw, out)) == 3


def test_other_parameters_read_their_files_anew(raw: Path, out: Path) -> None:
    run(raw, out)
    native = dataclasses.replace(LOGS, values="native")
    assert run(raw, out, (native, TABLES)) == ["agent/1.txt", "agent/2.txt"]
    assert content(out) == from_nothing(raw, (native, TABLES))


def test_another_device_document_reads_its_logs_anew(raw: Path, out: Path) -> None:
    run(raw, out)
    write(raw, {"Devices.xml": DEVICES.replace('units="MILLIMETER"', 'units="INCH"')})
    assert run(raw, out) == ["agent/1.txt", "agent/2.txt"]
    items = pq.read_table(out / "data_items.parquet").to_pylist()
    assert {i["data_item"]: i["units"] for i in items}["Xact"] == "INCH"


def test_a_device_document_that_cannot_be_read_takes_only_its_files(raw: Path, out: Path) -> None:
    write(raw, {"Devices.xml": DEVICES[:400]})
    run(raw, out)
    assert "device document" in entries(out)["agent/1.txt"]["reason"]
    assert entries(out)["air/1.csv"]["kept"] == 2
    said = json.loads((out / "manifest.json").read_text())["devices"]["Devices.xml"]
    assert said["data_items"] == 0 and said["reason"]


def test_notes_of_a_table_stand_in_the_manifest(raw: Path, out: Path) -> None:
    run(raw, out)
    assert entries(out)["air/1.csv"]["notes"] == {
        "clock_backwards": {"count": 1, "lines": [3]},
        "columns_left_out": ["Door"],
    }
    assert entries(out)["agent/1.txt"]["notes"] == {}
    entry = entries(out)["air/1.csv"]
    assert entry["first"] == "2024-03-04T09:59:59.000000000Z"


def test_a_run_that_breaks_off_is_made_good_by_the_next(
    raw: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(raw, out)
    write(raw, {"agent/1.txt": DIRTY, "agent/2.txt": GOOD})
    really = log.read

    def breaks_off(path: Path, source: RecordSource, root: Path) -> Any:
        if path.name == "2.txt":
            raise KeyboardInterrupt
        return really(path, source, root)

    with monkeypatch.context() as patch:
        patch.setattr(log, "read", breaks_off)
        with pytest.raises(KeyboardInterrupt):
            run(raw, out)
    write(raw, {"agent/1.txt": GOOD, "agent/2.txt": DIRTY})  # as before it broke off
    run(raw, out)
    assert content(out) == from_nothing(raw)


@pytest.mark.parametrize("spoilt", ["manifest.json", "rejected.parquet"])
@pytest.mark.parametrize("text", [None, "", "{}", '{"files": 3'])
def test_a_memory_that_is_lost_is_made_anew(
    spoilt: str, text: str | None, raw: Path, out: Path
) -> None:
    run(raw, out)
    before = content(out)
    (out / spoilt).unlink()
    if text is not None:
        (out / spoilt).write_text(text)
    assert "agent/2.txt" in run(raw, out)
    assert content(out) == before


def test_a_parquet_that_is_lost_is_made_anew(raw: Path, out: Path) -> None:
    run(raw, out)
    before = content(out)
    (out / "traces" / parquet_name("air/1.csv")).unlink()
    assert run(raw, out) == ["air/1.csv"]
    assert content(out) == before


def test_a_layout_that_is_wrong_is_said_of_its_file(raw: Path, out: Path) -> None:
    bare = dataclasses.replace(TABLES, table=TableLayout(rest=True))
    with pytest.raises(ValueError, match=r"^air/1\.csv: .*neither time nor rate"):
        ingest(raw, out, (LOGS, bare), MILL)


@pytest.mark.parametrize("files", ["/etc/*.txt", "../*.txt", ""])
def test_sources_stay_in_the_machines_folder(files: str, raw: Path, out: Path) -> None:
    with pytest.raises(ValueError, match="below the machine's folder"):
        ingest(raw, out, [RecordSource(format="shdr", files=files)], MILL)


def test_without_records_the_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nowhere does not exist"):
        ingest(tmp_path / "nowhere", tmp_path / "out", SOURCES, MILL)


@given(st.lists(st.text("ab_/.", min_size=1, max_size=8), unique=True, max_size=20))
def test_no_two_files_share_a_parquet(names: list[str]) -> None:
    targets = {parquet_name(name) for name in names}
    assert len(targets) == len(names)
    assert not any("/" in target for target in targets)


def test_long_and_odd_names_find_a_place(raw: Path, out: Path) -> None:
    long = "agent/" + "ü" * 120 + ".txt"
    write(raw, {long: GOOD})
    odd = raw / os.fsdecode(b"agent/\xff.txt")
    odd.write_text(DIRTY)
    run(raw, out)
    assert entries(out)[long]["kept"] == 3
    assert entries(out)["agent/\\xff.txt"]["rejected"] == 2
    assert content(out) == from_nothing(raw)
