"""Announcement of loops that are compiled for the first time on a machine."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer
from numba.core import event

from pipeline.app.output import LOG

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
