"""Ingest of raw files as observations and traces in Parquet, each file once.

A manifest holds the hashes of each file's content, of the code that read it and its parameters.
Only what changed is read again; the result is the one that a build from nothing gives.
"""

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from pathlib import Path, PurePosixPath
from typing import Any

from pipeline.parallel import mapped
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.imports import modules
from pipeline.signals.formats import RecordSource, Rejection, UnreadableFile
from pipeline.signals.store import (
    Entry,
    Outcome,
    parquet_name,
    read_manifest,
    read_rejections,
    remove_stale,
    sha256_of,
    write_data_items,
    write_manifest,
    write_observations,
    write_rejected,
    write_runs,
    write_trace,
)


@dataclass(frozen=True, kw_only=True)
class RawFile:
    """A raw file: its name below the folder, who claims it, hashes of all it is made from."""

    name: str
    path: Path
    source: RecordSource | None
    made_from: dict[str, str]
    broken: str | None
    """Reason why its bytes cannot be read."""


def raw_files(raw: Path, sources: Sequence[RecordSource]) -> Iterator[RawFile]:
    """Raw files in order of name, Devices documents as such, without hidden ones."""
    claims = _claims(raw, sources)
    code = _code()
    devices = {s.devices: raw / s.devices for s in sources if s.devices}
    hashes = {name: _hash_of(p)[0] for name, p in devices.items()}
    # A pattern reaches through linked folders, rglob does not.
    for path in sorted(p for p in {*raw.rglob("*"), *claims} if not p.is_dir()):
        below = path.relative_to(raw)
        if path in devices.values() or any(part.startswith(".") for part in below.parts):
            continue
        source = claims.get(path)
        sha256, broken = _hash_of(path)
        parameters = json.dumps(asdict(source) if source else None, sort_keys=True)
        yield RawFile(
            name=display_name(below.as_posix()),
            path=path,
            source=source,
            broken=broken,
            made_from={
                "sha256": sha256,
                "code": code,
                "parameters": hashlib.sha256(parameters.encode()).hexdigest(),
                "devices": hashes[source.devices] if source and source.devices else "",
            },
        )


def display_name(name: str | Path) -> str:
    r"""A file's name as text; bytes that are not UTF-8 as ``\xff``."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _claims(raw: Path, sources: Sequence[RecordSource]) -> dict[Path, RecordSource]:
    claims: dict[Path, RecordSource] = {}
    for source in sources:
        for pattern in (source.files, source.devices or "."):
            if not pattern or pattern.startswith("/") or ".." in PurePosixPath(pattern).parts:
                raise ValueError(
                    f"records name the files {pattern!r}: name them below the machine's folder"
                )
        for path in sorted(raw.glob(source.files)):
            claims.setdefault(path, source)
    return claims


def _hash_of(path: Path) -> tuple[str, str | None]:
    """Hash of the bytes of a file, or why they cannot be read."""
    if not path.is_file():
        return "", "it is a link to nothing, or no regular file"
    try:
        return sha256_of(path), None
    except OSError as error:
        return "", f"it cannot be opened: {error.strerror or error}"


_DOWNSTREAM = (
    "cleaning",
    "conditions",
    "contracts",
    "recordings",
    "wear_lives",
    "wear_windows",
    "windows",
)
"""Modules that read what the ingest wrote; they have no part in it."""


def _code() -> str:
    """Hash of the code that reads: every module of this folder and below, without docstrings."""
    folder, digest = Path(__file__).parent, hashlib.sha256()
    for name, module in modules(folder).items():
        inner = name.partition(".")[2]
        if not inner.startswith(_DOWNSTREAM):
            digest.update(f"{inner}\0{module.digest}".encode())
    return digest.hexdigest()


READERS = {
    "shdr": "shdr.log:read",
    "mtconnect_xml": "mtconnect.xml_document:read",
    "mtconnect_json": "mtconnect.json_document:read",
    "csv": "tables.csv_table:read",
    "parquet": "tables.columnar:read_parquet",
    "matlab": "tables.arrays:read_mat",
    "hdf5": "tables.arrays:read_hdf5",
    "tdms": "tables.columnar:read_tdms",
    "wav": "tables.columnar:read_wav",
}
"""Module and function of each format; those of tables return one Trace, the others batches of
observations."""

OBSERVING = {"shdr", "mtconnect_xml", "mtconnect_json"}

NOT_NAMED = "no source in the machine's file in conf/machine/ names it"


@dataclass(frozen=True, kw_only=True)
class Ingested:
    """Result of an ingest: files read now and kept from before, and records over all files."""

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
    """Read every file of a machine in ``raw`` that changed since the last time into ``out``.

    A file that none of ``sources`` names is rejected; ``progress`` gets each file's name.  A source
    that contradicts its files is a ValueError.
    """
    if not raw.is_dir():
        raise ValueError(f"{raw} does not exist: put the machine's files there")
    out.mkdir(parents=True, exist_ok=True)
    before, rejections = read_manifest(out), read_rejections(out)
    files = list(raw_files(raw, sources))
    entries = {
        f.name: before[f.name]
        for f in files
        if _is_current(before.get(f.name), f, rejections.get(f.name, []), out)
    }
    head = {"machine": asdict(identity), "devices": write_data_items(raw, sources, out)}
    # An ingest that is cut short leaves no entry of a file whose Parquet it had begun to replace.
    write_manifest(out, {**head, "files": entries})
    kept = len(entries)

    def outcome(file: RawFile) -> Outcome:
        progress(file.name)
        return _read(file, raw, out)

    todo = [file for file in files if file.name not in entries]
    for file, found in zip(todo, mapped(outcome, todo, compute="threads"), strict=True):
        entries[file.name], rejections[file.name] = found.entry(file.made_from), found.rejected
    remove_stale(out, entries)
    write_rejected({n: rejections.get(n, []) for n in sorted(entries)}, out / "rejected.parquet")
    write_runs(out, entries)
    write_manifest(out, {**head, "files": entries})
    return Ingested(
        files_read=len(entries) - kept,
        files_kept=kept,
        read=sum(e["read"] for e in entries.values()),
        kept=sum(e["kept"] for e in entries.values()),
        rejected=sum(e["rejected"] for e in entries.values()),
    )


def _is_current(known: Entry | None, file: RawFile, rejections: list[Rejection], out: Path) -> bool:
    """Whether what stands in ``out`` is what reading the file would give."""
    if known is None or known.get("made_from") != file.made_from:
        return False
    written = known["output"] is None or (out / known["output"]).exists()
    return written and known["rejected"] == len(rejections)


def _read(file: RawFile, raw: Path, out: Path) -> Outcome:
    """Read one file into its Parquet; a file that cannot be read is a rejected file."""
    source = file.source
    if file.broken:
        return _unreadable(file.broken, source.format if source else None)
    if source is None:
        return _unreadable(NOT_NAMED, None)
    if source.format == "program":  # nothing of it is a signal
        return Outcome(format="program", kept=1)
    write: Callable[..., Outcome] = write_trace
    folder = "traces"
    if source.format in OBSERVING:
        write, folder = write_observations, "observations"
    target = f"{folder}/{parquet_name(file.name)}"
    try:
        outcome = write(reader_of(source.format)(file.path, source, raw), out / target)
    except UnreadableFile as error:
        return _unreadable(str(error), source.format)
    except ValueError as error:
        raise ValueError(f"{file.name}: {error}") from error
    return replace(outcome, format=source.format, output=target)


def reader_of(form: str) -> Callable[..., Any]:
    """The reader of a format: of a path, its source, and the folder of the raw files."""
    module, _, function = READERS[form].partition(":")
    return getattr(import_module(f"pipeline.signals.{module}"), function)


def _unreadable(reason: str, form: str | None) -> Outcome:
    return Outcome(format=form, reason=reason, rejected=[Rejection(line=None, reason=reason)])
