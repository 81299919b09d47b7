"""Inputs of a stage while it runs: the files that its command names and that it does not write.

A stage that reads a file before it changed and another after it has a result of no state of the
records.  DVC hashes dependencies only after the command, and would store that result as the one of
the new state.  So each input is noted at the start, by size, time of change, inode and, of a small
file, content, and looked at again at the end.
"""

import os
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from pipeline.parameters import read_yaml
from pipeline.schema.files import PART

HASHED_BYTES = 256 * 1024
"""Size up to which the content counts, so that a file that was written again as it was has not
changed; of larger ones the hash would take longer than a stage's start may."""


def declared(root: Path) -> tuple[Mapping[str, Any], Mapping[str, Any]] | None:
    """Stages of dvc.yaml, and the active fleet that they go over; None where there is neither."""
    try:
        texts = [(root / name).read_text(encoding="utf-8")
                 for name in ("dvc.yaml", "conf/fleet/active.yaml")]  # fmt: skip
        return _parsed(texts[0])["stages"], _parsed(texts[1])
    except (OSError, ValueError, KeyError):
        return None


@cache
def _parsed(text: str) -> dict[str, Any]:
    return read_yaml(text)


def items(stage: Mapping[str, Any], fleet: Mapping[str, Any]) -> Mapping[str, str]:
    """What a stage goes over: machine -> its item; one nameless item where it does not."""
    if "foreach" not in stage:
        return {"": ""}
    found: Any = fleet
    for key in str(stage["foreach"])[2:-1].split("."):
        found = found[key]
    return found if isinstance(found, Mapping) else {one: one for one in found}


def written_by(name: str, root: Path) -> list[str] | None:
    """Paths that the stage ``name@machine`` writes by dvc.yaml; None where that does not say."""
    known = declared(root)
    stage, _, machine = name.partition("@")
    if known is None or stage not in known[0]:
        return None
    item = items(known[0][stage], known[1]).get(machine)
    if item is None:
        return None
    text = known[0][stage].get("do", known[0][stage])
    entries = [one for kind in ("outs", "metrics", "plots") for one in text.get(kind, ())]
    paths = [next(iter(one)) if isinstance(one, dict) else str(one) for one in entries]
    return [one.replace("${item}", item).replace("${key}", machine) for one in paths]


@dataclass(frozen=True)
class Seen:
    """State of a file: size [byte], time of change [ns], inode, and hash of a small one."""

    size: int
    changed_ns: int
    inode: int
    sha256: str = ""


Inputs = Mapping[str, Seen]
"""State of each input by its path."""


def inputs(name: str, paths: Iterable[str], root: Path = Path()) -> Inputs:
    """State of the inputs of the stage ``name@machine`` among the ``paths`` of its command."""
    outs = written_by(name, root)
    if outs is None:
        return {}
    own = tuple(f"{one.rstrip('/')}/" for one in outs)
    return {
        file: Seen(state.st_size, state.st_mtime_ns, state.st_ino,
                   _hash(file) if state.st_size <= HASHED_BYTES else "")
        for path in paths for file, state in _files(path) if not f"{file}/".startswith(own)
    }  # fmt: skip


def check_unchanged(before: Inputs, after: Inputs) -> None:
    """ValueError with the first input that is not as it was ``before``."""
    for path in sorted({*before, *after}):
        one, other = before.get(path), after.get(path)
        if one is None or other is None:
            why = "was added" if one is None else "was removed"
        elif one == other or (one.sha256 and one.sha256 == other.sha256):
            continue
        else:
            why = "changed"
        raise ValueError(
            f"{path} {why} while the stage ran, so its result is of neither state: leave its "
            "inputs alone and run `dvc repro` again"
        )


def _files(path: str) -> Iterator[tuple[str, os.stat_result]]:
    """Files at or below a path with their state, without those that are not written yet."""
    try:
        if not Path(path).is_dir():
            yield path, Path(path).stat()
            return
        with os.scandir(path) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    yield from _files(entry.path)
                elif not entry.name.endswith(PART):
                    yield entry.path, entry.stat()
    except OSError:  # not there, or gone in this moment
        return


def _hash(path: str) -> str:
    try:
        return sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""
