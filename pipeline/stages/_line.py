"""Progress lines of a stage: its place in the build, its duration [s], files read and written."""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Thread
from typing import Any, TextIO

from pipeline.parameters import read_yaml

RECORDS = ("read", "kept", "rejected")
"""Counts of records that a manifest holds for each file."""
SHOWN_AFTER_S = 10.0
"""Duration from which on a stage shows on a terminal that it runs [s]."""


def place(name: str, root: Path = Path()) -> str:
    """Place of a stage in the fleet's build, ``(7 of 31)``; empty without dvc.yaml or stage."""
    try:
        stages = read_yaml((root / "dvc.yaml").read_text(encoding="utf-8"))["stages"]
        fleet = read_yaml((root / "conf/fleet/active.yaml").read_text(encoding="utf-8"))
    except (OSError, ValueError, KeyError):
        return ""
    names = [one for stage, text in stages.items() for one in _runs(stage, text, fleet)]
    return f"({names.index(name) + 1} of {len(names)})" if name in names else ""


def _runs(stage: str, text: Mapping[str, Any], fleet: Mapping[str, Any]) -> list[str]:
    if "foreach" not in text:
        return [stage]
    found: Any = fleet
    for key in str(text["foreach"])[2:-1].split("."):
        found = found[key]
    return [f"{stage}@{machine}" for machine in found]


@contextmanager
def running(name: str, stream: TextIO) -> Iterator[None]:
    """Show on a terminal, once a second, for how long a stage runs that takes its time."""
    if not stream.isatty():
        yield
        return
    ended, began = Event(), time.monotonic()

    def show() -> None:
        while not ended.wait(1.0):
            if time.monotonic() - began > SHOWN_AFTER_S:
                stream.write(f"\r{name}: {time.monotonic() - began:.0f} s ")
                stream.flush()

    shown = Thread(target=show, daemon=True)
    shown.start()
    try:
        yield
    finally:
        ended.set()
        shown.join()
        stream.write("\r\033[K")  # the line is free again


def line(name: str, paths: Sequence[Path], began: float) -> str:
    """Line on a stage with the ``paths`` changed since ``began`` (:func:`time.time`) [s]."""
    files = {path: _files(path) for path in paths}
    written = [path for path, found in files.items() if _changed(found, began)]
    read = [path for path in paths if path not in written]
    parts = [f"read {_sizes([file for path in read for file in files[path]])}"] if read else []
    now = [file for path in written for file in files[path] if _changed([file], began)]
    parts += _found(now)  # beside them may lie what a stage before wrote
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
    """Verdicts and counts of records in written files."""
    found = []
    for file in files:
        if file.name == "verdict.json":
            found.append(f"found: {json.loads(file.read_text(encoding='utf-8'))['status']}")
        elif file.name == "manifest.json":
            entries = json.loads(file.read_text(encoding="utf-8")).get("files", {}).values()
            sums = {one: sum(entry.get(one) or 0 for entry in entries) for one in RECORDS}
            found.append("found: " + ", ".join(f"{n} records {one}" for one, n in sums.items()))
    return found
