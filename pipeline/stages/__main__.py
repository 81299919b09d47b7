"""Entry point of a DVC stage: ``python -m pipeline.stages NAME[@MACHINE] PATH...``."""

import importlib
import inspect
import json
import logging
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from typing import Any, TextIO

from pipeline.parameters import read_params, section_path, structure
from pipeline.schema.files import ended_by_signals
from pipeline.stages.code import NO_STAGES
from pipeline.stages.inputs import check_unchanged, declared, inputs, items
from pipeline.submodels.contract import sections, submodel, submodels

RECORDS = ("read", "kept", "rejected")
"""Counts of records that a manifest holds for each file."""
SHOWN_AFTER_S = 10.0
"""Duration from which on a stage shows on a terminal that it runs [s]."""


def place(name: str, root: Path = Path()) -> str:
    """Place of a stage in the fleet's build, ``(7 of 31)``; empty without dvc.yaml or stage."""
    known = declared(root)
    if known is None:
        return ""
    stages, fleet = known
    names = [f"{stage}@{one}".rstrip("@") for stage, text in stages.items()
             for one in items(text, fleet)]  # fmt: skip
    return f"({names.index(name) + 1} of {len(names)})" if name in names else ""


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


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A stage as the command line calls it."""

    modules: tuple[str, ...]
    """Modules whose imports are the stage's dependencies."""
    paths: list[str]
    """Names of its paths, in order."""
    sections: dict[str, Any]
    """Sections of params.yaml."""
    call: Callable[..., None]
    """Takes the paths, then the loaded sections by name."""


def load_stage(name: str) -> Entry:
    """The stage ``name``: a module of this room, or ``identify_…`` and ``judge_…`` a sub-model."""
    verb, _, which = name.partition("_")
    if verb in ("identify", "judge") and which in submodels():
        return _of_submodel(verb, which)
    stages = {path.stem for path in Path(__file__).parent.glob("[a-z]*.py")}
    known = sorted(stages - NO_STAGES)
    if name not in known:
        every = [*known, *(f"{v}_{s}" for v in ("identify", "judge") for s in submodels())]
        raise ValueError(f"there is no stage {name!r}; there are {', '.join(every)}")
    stage = getattr(importlib.import_module(f"pipeline.stages.{name}"), name)
    parameters = inspect.signature(stage, eval_str=True).parameters.values()
    return Entry(
        modules=(f"pipeline.stages.{name}",),
        paths=[p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD],
        sections={p.name: p.annotation for p in parameters if p.kind is p.KEYWORD_ONLY},
        call=stage,
    )


def _of_submodel(verb: str, which: str) -> Entry:
    """The shared stage of a sub-model: its records, its folder, what is frozen; two to judge it."""
    module = importlib.import_module("pipeline.stages.identify")
    one = submodel(which)
    settings = one.fitting if verb == "identify" else one.judging

    def call(*paths: Path, **loaded: Any) -> None:
        reads = dict(zip(one.reads, paths, strict=False))
        others = paths[len(one.reads) :]
        getattr(module, verb)(one, reads, *others, settings=settings(**loaded))

    more = ["folder", "golden"] + ([] if verb == "identify" else ["metrics", "plots"])
    return Entry(
        modules=("pipeline.stages.identify", f"pipeline.submodels.{which}.submodel"),
        paths=[*one.reads, *more],
        sections=sections(settings),
        call=call,
    )


def run(name: str, *paths: str, written: str = "") -> None:
    """Load the sections that the stage needs and call it; ValueError if an input changes then.

    ``written`` is the path of those that it writes where that is not the one of dvc.yaml.
    """
    run_as, (name, _, item) = name, name.partition("@")
    stage = load_stage(name)
    if len(paths) != len(stage.paths):
        raise ValueError(
            f"stage {name} takes {len(stage.paths)} paths ({', '.join(stage.paths)}), "
            f"{len(paths)} given"
        )
    values = read_params() if stage.sections else {}
    loaded = {
        section: structure(values, section_path(values, section, item or None), wanted)
        for section, wanted in stage.sections.items()
    }
    for path in paths:  # DVC removes outs before a stage, with the folder when it held no more
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    read = [path for path in paths if path != written]
    before = inputs(run_as, read)
    stage.call(*map(Path, paths), **loaded)
    check_unchanged(before, inputs(run_as, read))


def main() -> None:
    """Run the stage on the command line; bad input is one sentence and exit status 2."""
    if len(sys.argv) < 2:
        sys.stderr.write("usage: python -m pipeline.stages NAME[@MACHINE] PATH...\n")
        sys.exit(2)
    log = logging.getLogger("pipeline.stages")
    log.addHandler(logging.StreamHandler())  # standard error: no stage's output holds it
    began = time.time()
    with ended_by_signals():
        try:
            log.setLevel(os.environ.get("KERF_LOG", "INFO").upper())
            name = f"{sys.argv[1]} {place(sys.argv[1])}".rstrip()
            with running(name, sys.stderr):
                run(*sys.argv[1:])
            log.info("%s", line(name, [Path(one) for one in sys.argv[2:]], began))
        except (ValueError, OSError) as error:
            sys.stderr.write(f"{sys.argv[1]}: {error}\n")
            sys.exit(2)


if __name__ == "__main__":
    main()
