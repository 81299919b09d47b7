"""Output of the commands: files, ``-`` for standard output, the log, numbers and tables."""

import json
import logging
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import typer

from pipeline.schema.files import NotWrittenError, replacing

LOG = logging.getLogger("pipeline")
LEVELS = (logging.WARNING, logging.INFO, logging.DEBUG)
"""Log levels by the number of times that ``-v`` is given."""
OWN = ("champions.json", "params.yaml", "dvc.yaml", "dvc.lock")
"""Files of a project that no output replaces."""
STANDARD = Path("-")
"""Name of standard output where a file is named."""
NONE = "-"
"""Text in the place of a missing value."""


@dataclass
class Outputs:
    """Files of a command; what one named ``-`` holds goes to standard output in the end."""

    folder: Path
    """Folder of the file that stands for ``-``."""
    taken: Path | None = None
    """File that is written to, None where no output is ``-``."""

    def file(self, path: Path | None, suffix: str = "") -> Path | None:
        """The file to write for an output that was named, with an end of its name for ``-``."""
        if path != STANDARD:
            return path
        if self.taken is not None:
            raise ValueError("- is named for two outputs: standard output takes one document")
        self.taken = self.folder / f"standard output{suffix}"
        return self.taken

    @staticmethod
    def ready(path: Path | None, *read: Path) -> None:
        """Refuse a file of JSON that is none by its name, cannot be written or is read."""
        if path is None or path == STANDARD:
            return
        check_outputs(None, path, inputs=read)
        if path.suffix != ".json" and (path.is_file() or not path.exists()):  # not /dev/null
            raise ValueError(
                f"--json {path} is no name of JSON: name a .json file, or - for standard output"
            )

    def json(self, document: Any, path: Path | None, *read: Path) -> None:
        """Write a document as JSON where it was requested, over none of the files ``read``."""
        self.ready(path, *read)
        if (file := self.file(path)) is not None:
            with replacing(file) as part:
                text = json.dumps(document, indent=1, ensure_ascii=False)
                part.write_text(f"{text}\n", encoding="utf-8")

    def say(self, *lines: str) -> None:
        """Say lines, on standard error where standard output holds a document."""
        for line in lines:
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
    """Result of a step of a command, for its line in the log."""

    results: list[str] = field(default_factory=list)

    def add(self, words: str) -> None:
        """Add a finding."""
        self.results.append(words)


@contextmanager
def step(what: str) -> Iterator[Step]:
    """One line in the log when a step has ended: what it did, found and took."""
    started, one = time.perf_counter(), Step()
    yield one
    took = time.perf_counter() - started
    LOG.info("%s", "; ".join([what, *one.results, f"took {took:.2f} s"]))


def check_outputs(program: Path | None, *outputs: Path | None, inputs: Sequence[Path] = ()) -> None:
    """Refuse files that cannot be written, or would replace what is read or each other."""
    for path in outputs:
        if path is None:
            continue
        if program is not None and _same(path, program):
            raise ValueError(f"{path} is the program itself: name another file to write")
        if path.is_dir():
            raise ValueError(f"{path} is a folder: name a file in it")
        if not path.parent.is_dir():
            raise ValueError(f"{path.parent} does not exist: make that folder first")
        if any(_same(path, Path(own)) for own in OWN):
            raise ValueError(f"{path} is the project's own: name another file to write")
        if any(_same(path, read) for read in inputs):
            raise ValueError(f"{path} is read: name another file to write")
        if Path("conf").resolve() in path.resolve().parents:
            raise ValueError(f"{path} is in conf, which is read: name a file elsewhere")
    written = [path for path in outputs if path is not None]
    written += [_record(path) for path in written if path.suffix == ".html"]
    for i, path in enumerate(written):
        ordinary = path.is_file() or not path.exists()  # not /dev/null
        if ordinary and any(_same(path, other) for other in written[:i]):
            raise ValueError(f"{path} is named for two outputs: name a file for each")
    for path in written:
        _check_writable(path)


def _record(page: Path) -> Path:
    from pipeline.report.provenance import record_of

    return record_of(page)


def check_folder(out: Path) -> None:
    """Refuse a folder to write into that is a file, or would be in one."""
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"{there} is a file: name a folder to write into with --out")


def _same(path: Path, other: Path) -> bool:
    if path.exists() and other.exists():
        return path.samefile(other)
    return path.resolve() == other.resolve()


def _check_writable(path: Path) -> None:
    """Open the file, and one beside it, to write; the content stays."""
    if path.exists() and not path.is_file():
        return
    try:
        if path.exists():
            path.open("ab").close()
        with suppress(_TriedError), replacing(path) as part:
            part.open("xb").close()
            raise _TriedError
    except OSError as error:
        cause = error.__cause__ if isinstance(error, NotWrittenError) else error
        reason = getattr(cause, "strerror", None) or error
        raise ValueError(
            f"{path} cannot be written ({reason}): name a file in a folder that you may write to"
        ) from error


class _TriedError(Exception):
    """A file beside could be begun; it is removed, as after any error."""


def rounded(value: float | None, factor: float = 1, digits: int = 3) -> str:
    """``value`` times ``factor`` with ``digits`` significant digits; integers whole.

    >>> rounded(0.12345), rounded(1234.5), rounded(0.5, 100), rounded(12), rounded(None)
    ('0.123', '1234', '50', '12', '-')
    """
    if value is None:
        return NONE
    if isinstance(value, int):
        return str(int(value * factor))
    shown = value * factor
    return f"{shown:.0f}" if abs(shown) >= 10**digits else f"{shown:.{digits}g}"


def between(low: float | None, high: float | None, factor: float = 1) -> str:
    """The ends of an interval, to stand behind a value; nothing where there are none.

    >>> between(0.5, 2.0), between(None, None)
    (' (0.5 to 2)', '')
    """
    if low is None or high is None:
        return ""
    return f" ({rounded(low, factor)} to {rounded(high, factor)})"


def label(origin: str) -> str:
    """Label of what rests on simulated records, with a blank before it; else empty."""
    return " (simulated)" if origin == "simulated" else ""


def many(count: int, what: str) -> str:
    """A count with its noun: ``1 move``, ``2 moves``."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def aligned(rows: Sequence[Sequence[str]], *, words: int) -> Iterator[str]:
    """Lines whose columns stand under each other; the first ``words`` columns are left aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            word.ljust(width) if i < words else word.rjust(width)
            for i, (word, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()
