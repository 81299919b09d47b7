"""Raw files -> observations and traces in Parquet, each file once.

A manifest remembers for every raw file the hash of its content, of the code that read it and of the
parameters it was read with.  Only what changed is read again; what vanished is removed; the result
is the one that a build from nothing gives.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.signals.columns import REJECTED
from pipeline.signals.records import RecordSource, Rejection, Trace, UnreadableFile

READERS = {
    "shdr": "shdr",
    "mtconnect_xml": "mtconnect_xml",
    "mtconnect_json": "mtconnect_json",
    "csv": "csv_table",
    "parquet": "parquet_table",
    "matlab": "matlab",
    "hdf5": "hdf5",
    "tdms": "tdms",
}
"""Module of each format; those of tables return one Trace, the others batches of observations."""

OBSERVING = {"shdr", "mtconnect_xml", "mtconnect_json"}


@dataclass(frozen=True, kw_only=True)
class MachineIdentity:
    """Who a machine is.

    Parameters
    ----------
    name : str
        As in its file in ``conf/machine/``.
    description : str
        Make and kind, for people.
    origin : str
        ``"simulated"`` or ``"recorded"``; shown wherever its results are.
    credit : str
        Who is to be credited wherever its results are shown.
    recordings : str
        Folder under KERF_RECORDINGS that its files are collected from.
    """

    name: str
    description: str = ""
    origin: str = "recorded"
    credit: str = ""
    recordings: str = ""

    def __post_init__(self) -> None:
        if self.origin not in ("simulated", "recorded"):
            raise ValueError(f"identity.origin = {self.origin!r} must be 'simulated' or 'recorded'")


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of one raw file: its entry in the manifest, and its rejections."""

    entry: dict[str, Any]
    rejected: list[Rejection]


@dataclass(frozen=True, kw_only=True)
class Ingested:
    """What an ingest did: files read now and kept from before, and records over all files."""

    files_read: int
    files_kept: int
    read: int
    kept: int
    rejected: int


def ingest(
    raw: Path,
    out: Path,
    sources: Sequence[RecordSource],
    identity: MachineIdentity,
    *,
    progress: Callable[[str], None] = lambda name: None,
) -> Ingested:
    """Read every raw file that changed since the last time into ``out``.

    Parameters
    ----------
    raw : Path
        Folder of a machine's files as found.
    out : Path
        Folder of Parquet files and manifest; see the data page of the documentation.
    sources : sequence of RecordSource
        What kinds of files there are; a file that none names is rejected with that reason.
    identity : MachineIdentity
        Written into the manifest.
    progress : callable
        Called with each file's name before it is read.

    Raises
    ------
    ValueError
        When ``raw`` does not exist.
    """
    if not raw.is_dir():
        raise ValueError(f"{raw} does not exist: put the machine's files there")
    out.mkdir(parents=True, exist_ok=True)
    before = _manifest(out)
    rejections = _rejections(out)
    entries: dict[str, dict[str, Any]] = {}
    kept = 0
    for name, path, source in _claimed(raw, sources):
        known = before.get(name)
        identity_now = _fingerprint(path, source, raw)
        if known and known["made_from"] == identity_now and _complete(known, out):
            entries[name] = known
            kept += 1
            continue
        progress(name)
        outcome = _read(name, path, source, raw, out)
        entries[name] = {**outcome.entry, "sha256": identity_now["sha256"], "made_from": identity_now}
        rejections[name] = outcome.rejected
    _tidy(out, entries)
    _write_rejections({n: r for n, r in rejections.items() if n in entries}, out)
    _write_runs(entries, out)
    _write_data_items(raw, sources, out)
    manifest = {"machine": asdict(identity), "files": dict(sorted(entries.items()))}
    (out / "manifest.json").write_text(json.dumps(manifest, indent=1, sort_keys=True) + "\n")
    return Ingested(
        files_read=len(entries) - kept,
        files_kept=kept,
        read=sum(e["read"] for e in entries.values()),
        kept=sum(e["kept"] for e in entries.values()),
        rejected=sum(e["rejected"] for e in entries.values()),
    )


def _claimed(
    raw: Path, sources: Sequence[RecordSource]
) -> Iterator[tuple[str, Path, RecordSource | None]]:
    """Every raw file in order of its name with the first source that names it.

    Devices documents are read as such; hidden files are not records.
    """
    claims: dict[str, RecordSource] = {}
    for source in sources:
        for path in sorted(raw.glob(source.files)):
            claims.setdefault(path.relative_to(raw).as_posix(), source)
    devices = {s.devices for s in sources if s.devices}
    for path in sorted(p for p in raw.rglob("*") if p.is_file()):
        name = path.relative_to(raw).as_posix()
        if not (name in devices or any(part.startswith(".") for part in Path(name).parts)):
            yield name, path, claims.get(name)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _code() -> str:
    """Hash of the code that reads: every module of this folder, not of those below."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _fingerprint(path: Path, source: RecordSource | None, raw: Path) -> dict[str, str]:
    """Hashes of all that a file's result depends on."""
    parameters = json.dumps(asdict(source) if source else None, sort_keys=True)
    devices = raw / source.devices if source and source.devices else None
    return {
        "sha256": _sha256(path),
        "code": _code(),
        "parameters": hashlib.sha256(parameters.encode()).hexdigest(),
        "devices": _sha256(devices) if devices and devices.exists() else "",
    }


def _complete(entry: dict[str, Any], out: Path) -> bool:
    return entry["output"] is None or (out / entry["output"]).exists()


def _read(name: str, path: Path, source: RecordSource | None, raw: Path, out: Path) -> Outcome:
    """Read one file into its Parquet; a file that cannot be read is a rejected file."""
    if source is None:
        return _unreadable("no source in the machine's file in conf/machine/ names it", None)
    reader = import_module(f"pipeline.signals.{READERS[source.format]}")
    target = name.replace("/", "__") + ".parquet"
    try:
        if source.format in OBSERVING:
            return _observations(reader.read(path, source, raw), out, target, source.format)
        return _trace(reader.read(path, source, raw), out, target, source.format)
    except UnreadableFile as error:
        (out / "observations" / target).unlink(missing_ok=True)
        return _unreadable(str(error), source.format)


def _observations(batches: Any, out: Path, target: str, form: str) -> Outcome:
    from pipeline.signals.store import write_observations

    (out / "observations").mkdir(exist_ok=True)
    written = write_observations(batches, out / "observations" / target)
    entry = {
        "format": form,
        "read": written.read,
        "kept": written.kept,
        "rejected": written.rejected,
        "rows": written.rows,
        "first": written.first,
        "last": written.last,
        "output": f"observations/{target}",
        "reason": None,
    }
    return Outcome(entry=entry, rejected=written.rejections)


def _trace(trace: Trace, out: Path, target: str, form: str) -> Outcome:
    (out / "traces").mkdir(exist_ok=True)
    pq.write_table(trace.table, out / "traces" / target, compression="zstd")
    first = last = None
    if "time" in trace.table.column_names and trace.table.num_rows:
        import pyarrow.compute as pc

        ends = pc.min_max(trace.table["time"]).as_py()
        first, last = ends["min"], ends["max"]
    entry = {
        "format": form,
        "read": trace.read,
        "kept": trace.kept,
        "rejected": len(trace.rejected),
        "rows": trace.table.num_rows,
        "first": _iso(first),
        "last": _iso(last),
        "output": f"traces/{target}",
        "reason": None,
    }
    return Outcome(entry=entry, rejected=trace.rejected)


def _unreadable(reason: str, form: str | None) -> Outcome:
    entry = {"format": form, "read": 1, "kept": 0, "rejected": 1, "rows": 0}
    missing = {"first": None, "last": None, "output": None, "reason": reason}
    return Outcome(
        entry={**entry, **missing}, rejected=[Rejection(line=None, reason=reason)]
    )


def _iso(time: Any) -> str | None:
    return None if time is None else time.isoformat()


def _manifest(out: Path) -> dict[str, dict[str, Any]]:
    path = out / "manifest.json"
    if not path.exists():
        return {}
    files: dict[str, dict[str, Any]] = json.loads(path.read_text())["files"]
    return files


def _rejections(out: Path) -> dict[str, list[Rejection]]:
    path = out / "rejected.parquet"
    found: dict[str, list[Rejection]] = {}
    if path.exists():
        for row in pq.read_table(path).to_pylist():
            rejection = Rejection(line=row["line"], reason=row["reason"], excerpt=row["excerpt"] or "")
            found.setdefault(row["file"], []).append(rejection)
    return found


def _write_rejections(rejections: dict[str, list[Rejection]], out: Path) -> None:
    rows = [
        {"file": name, "line": r.line, "reason": r.reason, "excerpt": r.excerpt}
        for name, found in sorted(rejections.items())
        for r in found
    ]
    pq.write_table(pa.Table.from_pylist(rows, REJECTED), out / "rejected.parquet", compression="zstd")


def _write_runs(entries: dict[str, dict[str, Any]], out: Path) -> None:
    """One row a recording that was read."""
    schema = pa.schema(
        [("recording", pa.string()), ("file", pa.string()), ("format", pa.string()),
         ("start", pa.string()), ("end", pa.string()), ("rows", pa.int64())]
    )  # fmt: skip
    rows = [
        {"recording": Path(name).stem, "file": name, "format": e["format"], "start": e["first"],
         "end": e["last"], "rows": e["rows"]}
        for name, e in sorted(entries.items())
        if e["output"] is not None
    ]  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, schema), out / "runs.parquet", compression="zstd")


def _write_data_items(raw: Path, sources: Sequence[RecordSource], out: Path) -> None:
    """Data items of every Devices document that a source names."""
    from pipeline.signals.devices import data_items_table, read_devices

    tables = []
    for devices, device in sorted({(s.devices, s.device) for s in sources if s.devices}):
        if (raw / devices).exists():
            tables.append(data_items_table(read_devices(raw / devices, device)))
    target = out / "data_items.parquet"
    if tables:
        pq.write_table(pa.concat_tables(tables), target, compression="zstd")
    else:
        target.unlink(missing_ok=True)


def _tidy(out: Path, entries: dict[str, dict[str, Any]]) -> None:
    """Remove the Parquet of raw files that are gone."""
    wanted = {e["output"] for e in entries.values()}
    for folder in ("observations", "traces"):
        for path in (out / folder).glob("*.parquet"):
            if f"{folder}/{path.name}" not in wanted:
                path.unlink()
