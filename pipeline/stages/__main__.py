"""Entry point of a DVC stage: ``python -m pipeline.stages NAME[@MACHINE] PATH...``."""

import importlib
import inspect
import logging
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.parameters import read_params, section_path, structure
from pipeline.schema.files import ended_by_signals
from pipeline.stages._line import line, place, running
from pipeline.stages.code import NO_STAGES
from pipeline.submodels.contract import sections, submodel, submodels


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


def run(name: str, *paths: str) -> None:
    """Load the sections that the stage needs and call it."""
    name, _, item = name.partition("@")
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
    stage.call(*map(Path, paths), **loaded)


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
