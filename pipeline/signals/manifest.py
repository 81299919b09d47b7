"""What an ingest remembers and hands on: manifest, rejections, recordings.

Every file is written under another name and renamed when it is whole.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.signals.records import RecordSource, Rejection, UnreadableFile

Entry = dict[str, Any]
"""One raw file in the manifest."""

LONGEST = 160
"""Bytes of a raw file's name that go into the name of its Parquet; file systems allow 255."""

RUNS = pa.schema(
    [
        ("recording", pa.string()),
        ("file", pa.string()),
        ("format", pa.string()),
        ("start", pa.timestamp("ns", tz="UTC")),
        ("end", pa.timestamp("ns", tz="UTC")),
        ("rows", pa.int64()),
    ]
)


def read_manifest(out: Path) -> dict[str, Entry]:
    """Entries of the last ingest; none when there is no manifest that can be read."""
    try:
        files: dict[str, Entry] = json.loads((out / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError, TypeError):
        return {}  # all is read anew
    return files


def write_manifest(out: Path, content: dict[str, Any]) -> None:
    """Write ``content`` as ``manifest.json``."""
    text = json.dumps(content, indent=1, sort_keys=True) + "\n"
    whole(out / "manifest.json", lambda part: part.write_text(text))


def read_rejections(out: Path) -> dict[str, list[Rejection]]:
    """Rejections of the last ingest by raw file; none when they cannot be read."""
    try:
        rows = pq.read_table(out / "rejected.parquet").to_pylist()
    except (OSError, pa.ArrowException):
        return {}  # files that had some are read anew
    found: dict[str, list[Rejection]] = {}
    for row in rows:
        rejection = Rejection(line=row["line"], reason=row["reason"], excerpt=row["excerpt"] or "")
        found.setdefault(row["file"], []).append(rejection)
    return found


def write_runs(out: Path, entries: dict[str, Entry]) -> None:
    """Write ``runs.parquet``: one row a recording that was read."""
    rows = [
        {
            "recording": Path(name).stem,
            "file": name,
            "format": entry["format"],
            "start": entry["first"],
            "end": entry["last"],
            "rows": entry["rows"],
        }
        for name, entry in sorted(entries.items())
        if entry["output"] is not None
    ]
    columns = {
        name: pa.array([row[name] for row in rows], pa.string()) for name in ("start", "end")
    }
    table = pa.table(
        {
            field.name: columns[field.name].cast(field.type)
            if field.name in columns
            else pa.array([row[field.name] for row in rows], field.type)
            for field in RUNS
        }
    )
    whole(out / "runs.parquet", lambda part: pq.write_table(table, part, compression="zstd"))


def write_data_items(
    raw: Path, sources: Sequence[RecordSource], out: Path
) -> dict[str, dict[str, Any]]:
    """Write the data items of every Devices document that a source names; say what was found.

    One that cannot be read takes the files that need it with it, not the machine's other files.
    """
    from pipeline.signals.mtconnect.devices import data_items_table, read_devices

    tables, found = [], {}
    for name, device in sorted({(s.devices, s.device) for s in sources if s.devices}, key=str):
        if not (raw / name).exists():
            continue
        said: dict[str, Any] = {"data_items": 0, "reason": None}
        try:
            tables.append(data_items_table(read_devices(raw / name, device)))
            said["data_items"] = tables[-1].num_rows
        except UnreadableFile as error:
            said["reason"] = str(error)
        found[name if device is None else f"{name} {device}"] = said
    target = out / "data_items.parquet"
    if tables:
        items = pa.concat_tables(tables)
        whole(target, lambda part: pq.write_table(items, part, compression="zstd"))
    else:
        target.unlink(missing_ok=True)
    return found


def tidy(out: Path, entries: dict[str, Entry]) -> None:
    """Remove the Parquet of raw files that are gone, and what an ingest cut short left behind."""
    wanted = {e["output"] for e in entries.values()}
    for folder in ("observations", "traces"):
        for path in [*(out / folder).glob("*.parquet"), *(out / folder).glob(".*.part")]:
            if f"{folder}/{path.name}" not in wanted:
                path.unlink()


def whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` write to another name and rename that to ``path``, replacing what was there."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        write(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def parquet_name(name: str) -> str:
    """Name of the Parquet of the raw file ``name``: another one for every file.

    Examples
    --------
    >>> parquet_name("agent/2026-01-05.txt")
    'agent__2026-01-05.txt.parquet'
    """
    flat = name.replace("/", "__")
    if flat.replace("__", "/") != name or len(flat.encode()) > LONGEST:
        kept = flat.encode()[:LONGEST].decode(errors="ignore")
        flat = f"{kept}.{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return f"{flat}.parquet"


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
