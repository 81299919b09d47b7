"""Which files a machine has, which source claims each, and what its result is made from."""

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath

from pipeline.signals.manifest import sha256_of
from pipeline.signals.records import RecordSource


@dataclass(frozen=True, kw_only=True)
class RawFile:
    """A raw file: its name below the folder, who claims it, hashes of all it is made from."""

    name: str
    path: Path
    source: RecordSource | None
    made_from: dict[str, str]
    broken: str | None
    """Why its bytes cannot be read."""


def raw_files(raw: Path, sources: Sequence[RecordSource]) -> Iterator[RawFile]:
    """Every raw file in order of its name.

    Devices documents are read as such; hidden files are no records.
    """
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
            name=shown(below.as_posix()),
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


def shown(name: str | Path) -> str:
    r"""A file's name as text; bytes that are not UTF-8 as ``\xff``."""
    return os.fsencode(name).decode("utf-8", "backslashreplace")


def _claims(raw: Path, sources: Sequence[RecordSource]) -> dict[Path, RecordSource]:
    """The first source that names each file."""
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


def _code() -> str:
    """Hash of the code that reads: every module of this folder and below, but for cleaning."""
    folder, digest = Path(__file__).parent, hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        name = path.relative_to(folder).as_posix()
        if not name.startswith("cleaning/"):
            digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
