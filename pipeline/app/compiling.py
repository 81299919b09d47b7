"""Compilation of the product's loops ahead of their use, and the announcement of it.

``loops.json`` names each loop that a build of the first fleet compiles, with the types of its
arguments; ``python -m pipeline.app.compiling`` writes it from this machine's cache.
"""

import json
import logging
import pkgutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from numba.core import event
from numba.core import types as numba_types
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaError

import pipeline
from pipeline.app.output import LOG
from pipeline.kernels import kept_signatures
from pipeline.parallel import mapped

types: Any = numba_types
LOOPS = Path(__file__).with_name("loops.json")

ONCE = "kerf: compiling loops for this processor, which takes some seconds and is done once"


class _Announcing(event.Listener):
    """Say once that loops are compiled, and on a terminal which."""

    def __init__(self) -> None:
        self.loops = 0

    def on_start(self, event: event.Event) -> None:
        self.loops += 1
        name = event.data["dispatcher"].py_func.__name__
        LOG.debug("compiling %s", name)
        if LOG.level >= logging.ERROR:
            return
        if self.loops == 1:
            typer.echo(ONCE, err=True)
        if sys.stderr.isatty():
            typer.echo(f"\r\x1b[K{self.loops} loops: {name}", nl=False, err=True)

    def on_end(self, event: event.Event) -> None:
        if sys.stderr.isatty() and LOG.level < logging.ERROR:
            typer.echo("\r\x1b[K", nl=False, err=True)


@contextmanager
def announced() -> Iterator[None]:
    """While loops are compiled, standard error says so; not under ``--quiet``."""
    with event.install_listener("numba:compile", _Announcing()):
        yield


def compile_loops() -> int:
    """Compile every loop of the list on all cores; the number of those that are compiled.

    A loop whose name or arguments have changed since the list was written is left out: it is
    compiled when it is first used.
    """
    return sum(mapped(_compile, [tuple(one) for one in json.loads(LOOPS.read_text())]))


def _compile(loop: tuple[str, str, list[Any]]) -> bool:
    module, name, arguments = loop
    try:
        getattr(import_module(module), name).compile(tuple(map(_type, arguments)))
    except (ImportError, AttributeError, TypeError, NumbaError):
        return False
    return True


def _written(kind: Any) -> Any:
    """Type of an argument as JSON: words for a scalar or an array, a list for a tuple."""
    if isinstance(kind, types.BaseNamedTuple):
        place = f"{kind.instance_class.__module__}:{kind.instance_class.__qualname__}"
        return {place: [_written(one) for one in kind]}
    if isinstance(kind, types.BaseTuple):
        return [_written(one) for one in kind]
    if isinstance(kind, types.Array):
        return f"{kind.dtype} {kind.ndim} {kind.layout}{'' if kind.mutable else ' readonly'}"
    if isinstance(kind, types.Literal):
        return {"literal": kind.literal_value}
    return str(kind)


def _type(written: Any) -> Any:
    """Inverse of ``_written``; AttributeError or ImportError where a class has gone."""
    if isinstance(written, list):
        return types.BaseTuple.from_types([_type(one) for one in written])
    if isinstance(written, str):
        name, *shape = written.split()
        scalar = getattr(types, name)
        return types.Array(scalar, int(shape[0]), *shape[1:]) if shape else scalar
    [(kind, inner)] = written.items()
    if kind == "literal":
        return types.literal(inner)
    module, _, name = kind.partition(":")
    return types.BaseTuple.from_types(
        [_type(one) for one in inner], getattr(import_module(module), name)
    )


def _is_readable(kind: Any) -> bool:
    """Whether a type is read back as it is written; an enum, which one loop hands another, is not.

    The loop that hands it on compiles the other for it.
    """
    try:
        return bool(_type(_written(kind)) == kind)
    except AttributeError:
        return False


def write_loops() -> int:
    """Write the list of loops that this machine's cache keeps, callees first; their number."""
    kept = []
    for module in pkgutil.walk_packages(pipeline.__path__, "pipeline."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(import_module(module.name)).items():
            if isinstance(value, Dispatcher) and value.__module__ == module.name:
                kept += [(at, [module.name, name, [_written(one) for one in arguments]])
                         for at, arguments in kept_signatures(value)
                         if all(map(_is_readable, arguments))]  # fmt: skip
    lines = [json.dumps(loop) for _, loop in sorted(kept, key=lambda one: one[0])]
    LOOPS.write_text("[\n" + ",\n".join(lines) + "\n]\n")
    return len(kept)


if __name__ == "__main__":
    typer.echo(f"{LOOPS}: {write_loops()} loops")
