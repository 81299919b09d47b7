"""Stage: hashes of the recordings that each section of a machine's settings names.

A stage depends on its entries here, so that a new day of the machine's log fits nothing again that
reads servo traces.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from fnmatch import fnmatchcase
from hashlib import sha256
from pathlib import Path
from typing import Any

from pipeline.schema.golden import read_golden
from pipeline.schema.store import write_json
from pipeline.submodels.cases import Records, changes

NAME_NO_RECORDINGS = {"identity", "records", "roles", "shop"}
"""Sections whose patterns say how files are read and used, not which ones a stage reads."""
TIMED, FROZEN = "timed", "frozen"


def index(manifest: Path, settings: Path, golden: Path, index: Path, machine: Path) -> None:
    """Write a hash for each section of a machine, of the recordings that its texts name.

    ``index``: JSON of section -> hash, ``timed`` of files with a clock, and ``frozen``;
    ``machine``: file beside the machine's models with its name.
    """
    files = Records(manifest=manifest).files
    sections = json.loads(settings.read_text())
    found = {
        name: _hash(file for file in files.items() if is_named(file[0], texts(content)))
        for name, content in sections.items()
        if name not in NAME_NO_RECORDINGS
    }
    sets = read_golden(golden / settings.name)
    frozen = [] if sets is None else [one for one in (sets.golden, sets.sealed) if one is not None]
    content = None if sets is None else asdict(sets)
    found[TIMED] = _hash(file for file in files.items() if file[1].get("last"))
    found[FROZEN] = _digest([content, *(changes(one, files) for one in frozen)])
    write_json(found, index)
    write_json({"machine": settings.stem}, machine)


def _hash(files: Iterable[tuple[str, Mapping[str, Any]]]) -> str:
    """Hash of raw files with all that their tables were made from."""
    return _digest([(name, entry["sha256"], entry.get("made_from")) for name, entry in files])


def _digest(content: Any) -> str:
    return sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def is_named(file: str, patterns: Iterable[str]) -> bool:
    """Whether a raw file matches one of the patterns."""
    return any(fnmatchcase(file, pattern) for pattern in patterns)


def texts(content: Any) -> list[str]:
    """All texts of a section, patterns of files among them."""
    return list(_leaves(content))


def _leaves(content: Any) -> Iterator[str]:
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping):
        for one in content.values():
            yield from _leaves(one)
    elif isinstance(content, list):
        for one in content:
            yield from _leaves(one)
