"""The line that a stage says when it has ended: what it read, found, wrote, and took."""

import json
import time
from collections.abc import Sequence
from pathlib import Path

RECORDS = ("read", "kept", "rejected")
"""Counts of records that a manifest holds for each file."""


def line(name: str, paths: Sequence[Path], began: float) -> str:
    """One line on a stage.

    Parameters
    ----------
    name : str
        Of the stage, with its machine.
    paths : sequence of Path
        That it was called with; those that changed since it began were written.
    began : float
        When, as :func:`time.time` says it [s].
    """
    files = {path: _files(path) for path in paths}
    written = [path for path, found in files.items() if _changed(found, began)]
    read = [path for path in paths if path not in written]
    parts = [f"read {_sizes([file for path in read for file in files[path]])}"] if read else []
    parts += [found for path in written for found in _found(files[path])]
    parts += [f"wrote {path} ({_sizes(files[path])})" for path in written]
    return f"{name}: " + "; ".join([*parts, f"took {time.time() - began:.1f} s"])


def _files(path: Path) -> list[Path]:
    if path.is_dir():
        return sorted(file for file in path.rglob("*") if file.is_file())
    return [path] if path.is_file() else []


def _changed(files: Sequence[Path], began: float) -> bool:
    return any(file.stat().st_mtime >= began for file in files)


def _sizes(files: Sequence[Path]) -> str:
    size = sum(file.stat().st_size for file in files)
    return f"{len(files)} file{'s' * (len(files) != 1)}, {size / 1e6:.3g} MB"


def _found(files: Sequence[Path]) -> list[str]:
    """What a written folder says of itself: verdicts of sub-models, counts of records."""
    found = []
    for file in files:
        if file.name == "verdict.json":
            found.append(f"found: {json.loads(file.read_text(encoding='utf-8'))['status']}")
        elif file.name == "manifest.json":
            entries = json.loads(file.read_text(encoding="utf-8")).get("files", {}).values()
            sums = {one: sum(entry.get(one) or 0 for entry in entries) for one in RECORDS}
            found.append("found: " + ", ".join(f"{n} records {one}" for one, n in sums.items()))
    return found
