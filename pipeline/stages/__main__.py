"""Run one DVC stage: ``python -m pipeline.stages NAME[@MACHINE] PATH...``.

Positional parameters of the stage are paths, in the order of the command; keyword-only parameters
are sections of params.yaml, those of the machine first.
"""

import importlib
import inspect
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pipeline.parameters import read_params, section_path, structure

Stage = Callable[..., None]

# One thread for linear algebra: the same sums in the same order everywhere, and for matrices as
# narrow as ours three times as fast as two.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")


def load_stage(name: str) -> Stage:
    """The function ``name`` of ``pipeline/stages/<name>.py``.

    Raises
    ------
    ValueError
        When there is no such stage.
    """
    known = sorted(p.stem for p in Path(__file__).parent.glob("[a-z]*.py"))
    if name not in known:
        raise ValueError(f"there is no stage {name!r}; there are {', '.join(known)}")
    stage: Stage = getattr(importlib.import_module(f"pipeline.stages.{name}"), name)
    return stage


def split_signature(stage: Stage) -> tuple[list[str], dict[str, Any]]:
    """Names of the path parameters, and type of each params section."""
    parameters = inspect.signature(stage, eval_str=True).parameters.values()
    paths = [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    sections = {p.name: p.annotation for p in parameters if p.kind is p.KEYWORD_ONLY}
    return paths, sections


def run(name: str, *paths: str) -> None:
    """Load the sections that the stage asks for and call it.

    Raises
    ------
    ValueError
        When the number of paths is not the stage's, or params.yaml does not fit.
    """
    name, _, item = name.partition("@")
    stage = load_stage(name)
    wanted, sections = split_signature(stage)
    if len(paths) != len(wanted):
        raise ValueError(
            f"stage {name} takes {len(wanted)} paths ({', '.join(wanted)}), {len(paths)} given"
        )
    values = read_params() if sections else {}
    loaded = {
        section: structure(values, section_path(values, section, item or None), wanted_type)
        for section, wanted_type in sections.items()
    }
    for path in paths:  # DVC removes outs before a stage, with the folder when it held no more
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    stage(*map(Path, paths), **loaded)


def main() -> None:
    """Run the stage on the command line; bad input is one sentence and exit status 2."""
    if len(sys.argv) < 2:
        sys.stderr.write("usage: python -m pipeline.stages NAME[@MACHINE] PATH...\n")
        sys.exit(2)
    try:
        run(*sys.argv[1:])
    except (ValueError, OSError) as error:
        sys.stderr.write(f"{sys.argv[1]}: {error}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
