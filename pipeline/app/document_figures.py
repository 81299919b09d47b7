"""Figures in Markdown with their source, filled in from it and held against it.

A figure stands between two comments, which no reader of the page sees:
``<!-- data/metrics/mill02_optimise.json#O6281_after_time_s as .3g -->64.5<!-- / -->``.  The source
is a JSON file below the project and the keys in it, parted by ``/``.  ``#A to B`` is the relative
change from one key to another.  ``as`` names a format of Python's, ``.0%`` for shares; without one
a number has three digits and a word stands as it is.
"""

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

MARK = re.compile(
    r"<!-- (?P<file>[^\s#]+\.json)#(?P<keys>[^<>]+?)(?: as (?P<form>\S+))? -->"
    r"(?P<shown>[^<]*)<!-- / -->"
)
"""A figure: file, keys, format, and its text."""
OPEN = re.compile(r"<!-- \S+\.json#")
"""Beginning of a figure."""
CODE = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
CHANGE = " to "
"""Word between the keys of a relative change."""


@dataclass(frozen=True, kw_only=True)
class DocumentFigure:
    """A figure of a document, with what its source says now."""

    line: int
    place: tuple[int, int]
    """Beginning and end of the text."""
    shown: str
    source: str
    """File and keys."""
    recomputed: str


def document_figures(text: str, root: Path, name: str) -> Iterator[DocumentFigure]:
    """Figures of a Markdown text with a source below ``root``, those in blocks of code left out.

    ValueError, with ``name`` and line, where a source or a figure cannot be read.
    """
    plain = CODE.sub(lambda block: re.sub(r"[^\n]", " ", block[0]), text)
    read = cache(lambda path: json.loads(path.read_text(encoding="utf-8")))
    for begun in OPEN.finditer(plain):
        line, one = plain.count("\n", 0, begun.start()) + 1, MARK.match(plain, begun.start())
        if one is None:
            raise ValueError(
                f"{name}, line {line}: the figure has no end, write "
                "<!-- FILE.json#KEY -->FIGURE<!-- / -->"
            )
        if not plain[: begun.start()].rpartition("\n")[2].strip():
            raise ValueError(
                f"{name}, line {line}: a line that begins with a comment is no Markdown, put a "
                "word before the figure"
            )
        source = f"{one['file']}#{one['keys']}"
        try:
            now = _words(_value(read(root / one["file"]), one["keys"]), one["form"])
        except (OSError, ValueError) as error:
            raise ValueError(f"{name}, line {line}: {source}: {error}") from error
        yield DocumentFigure(line=line, place=one.span("shown"), shown=one["shown"],
                             source=source, recomputed=now)  # fmt: skip


def filled(text: str, root: Path, name: str) -> str:
    """The text with each figure as its source says it."""
    for one in reversed(list(document_figures(text, root, name))):
        text = text[: one.place[0]] + one.recomputed + text[one.place[1] :]
    return text


def _value(document: Any, keys: str) -> Any:
    """Value under ``keys``, or the relative change from one to another."""
    if CHANGE in keys:
        before, after = (_value(document, one) for one in keys.split(CHANGE, 1))
        if not all(isinstance(one, int | float) for one in (before, after)) or not before:
            raise ValueError("a change needs two numbers, the first not 0")
        return after / before - 1
    found = document
    for key in keys.split("/"):
        if not isinstance(found, dict) or key not in found:
            there = ", ".join(list(found)[:5]) if isinstance(found, dict) else repr(found)
            raise ValueError(f"there is no {key!r}, there is {there}")
        found = found[key]
    if isinstance(found, dict | list):
        raise ValueError(f"{keys!r} is no single value")
    return found


def _words(value: Any, form: str | None) -> str:
    if isinstance(value, str | bool) or value is None:
        return str(value)
    digits = ".0f" if abs(value) >= 1000 else ".3g"
    return format(value, form or digits).replace("-", "\N{MINUS SIGN}").replace("%", " %")
