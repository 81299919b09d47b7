"""Where a command writes and speaks: files, ``-`` for standard output, and its log."""

import json
import logging
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typer

LOG = logging.getLogger("pipeline")
LEVELS = (logging.WARNING, logging.INFO, logging.DEBUG)
"""Of the log by the number of times that ``-v`` is given."""
STANDARD = Path("-")
"""Name of standard output where a file is named."""


@dataclass
class Outputs:
    """Files of a command; what one named ``-`` holds goes to standard output in the end."""

    folder: Path
    """For the file that is ``-``."""
    taken: Path | None = None
    """That file, None where no output is ``-``."""

    def file(self, path: Path | None, suffix: str = "") -> Path | None:
        """The file to write for an output that was named, with an end of its name for ``-``."""
        if path != STANDARD:
            return path
        if self.taken is not None:
            raise ValueError("- is named for two outputs: standard output takes one document")
        self.taken = self.folder / f"standard output{suffix}"
        return self.taken

    def say(self, line: str) -> None:
        """Say a line, on standard error where standard output holds a document."""
        typer.echo(line, err=self.taken is not None)

    def names(self, *paths: Path | None) -> str:
        """Files that were written, by the names that they were given."""
        return ", ".join(
            "standard output" if path == self.taken else str(path)
            for path in paths
            if path is not None
        )


@contextmanager
def outputs() -> Iterator[Outputs]:
    """Outputs of a command; the document that is ``-`` is written whole when all went well."""
    with TemporaryDirectory() as folder:
        found = Outputs(Path(folder))
        yield found
        if found.taken is not None and found.taken.exists():
            sys.stdout.flush()
            with found.taken.open("rb") as file:
                shutil.copyfileobj(file, sys.stdout.buffer)
            sys.stdout.buffer.flush()


def say_json(document: Any) -> None:
    """Say a document as JSON on standard output."""
    typer.echo(json.dumps(document, indent=1, ensure_ascii=False))


class _Standard(logging.Handler):
    """A line on standard error as it is at the time of the record."""

    def emit(self, record: logging.LogRecord) -> None:
        typer.echo(f"kerf: {self.format(record)}", err=True)


def log_to_standard_error(verbose: int, quiet: bool) -> None:
    """Show warnings of kerf, with ``verbose`` also its steps; only errors with ``quiet``."""
    for known in [one for one in LOG.handlers if isinstance(one, _Standard)]:
        LOG.removeHandler(known)
    LOG.addHandler(_Standard())
    LOG.propagate = False
    LOG.setLevel(logging.ERROR if quiet else LEVELS[min(verbose, len(LEVELS) - 1)])


@dataclass
class Step:
    """What a step of a command found, for its line in the log."""

    found: list[str] = field(default_factory=list)

    def add(self, words: str) -> None:
        """Say what was found."""
        self.found.append(words)


@contextmanager
def step(what: str) -> Iterator[Step]:
    """One line in the log when a step has ended: what it did, found and took."""
    started, one = time.perf_counter(), Step()
    yield one
    took = time.perf_counter() - started
    LOG.info("%s", "; ".join([what, *one.found, f"took {took:.2f} s"]))
