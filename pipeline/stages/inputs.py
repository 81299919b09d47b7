"""Inputs of a stage while it runs: the files that its command names and that it does not write.

A stage that reads a file before it changed and another after it has a result of no state of the
records.  DVC hashes dependencies only after the command, and would store that result as the one of
the new state.  So each input is noted at the start, by its content or, of a large file, by size,
time of change and inode, and looked at again at the end.
"""

from collections.abc import Iterable, Mapping
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


def inputs(name: str, paths: Iterable[str], root: Path = Path()) -> dict[str, object]:
    """State of the inputs of the stage ``name@machine`` among the ``paths`` of its command."""
    outs = written_by(name, root)
    if outs is None:
        return {}
    own, found = tuple(f"{one.rstrip('/')}/" for one in outs), {}
    for path in map(Path, paths):
        for file in path.rglob("*") if path.is_dir() else [path]:
            if file.suffix != PART and not f"{file.as_posix()}/".startswith(own):
                found[file.as_posix()] = _state(file)
    return {file: state for file, state in found.items() if state is not None}


def _state(file: Path) -> object:
    """Content of a small file, else size, time of change and inode; None where there is no file."""
    try:
        state = file.stat()
        if not file.is_file():
            return None
        if state.st_size <= HASHED_BYTES:
            return sha256(file.read_bytes()).hexdigest()
        return state.st_size, state.st_mtime_ns, state.st_ino
    except OSError:  # gone in this moment
        return None


def check_unchanged(before: Mapping[str, object], after: Mapping[str, object]) -> None:
    """ValueError with the first input that is not as it was ``before``."""
    for path in sorted({*before, *after}):
        if before.get(path) == after.get(path):
            continue
        both = path in before and path in after
        why = "changed" if both else "was removed" if path in before else "was added"
        raise ValueError(
            f"{path} {why} while the stage ran, so its result is of neither state: leave its "
            "inputs alone and run `dvc repro` again"
        )
