"""Tables of the pages: heads, units, cells in words, and their sources."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from string import ascii_lowercase
from typing import Generic, TypeVar

from pipeline.charts.numbers import number
from pipeline.charts.sources import Source, SourceRegistry

Thing = TypeVar("Thing", contravariant=True)


@dataclass(frozen=True, kw_only=True)
class Head:
    """Head of a column: its name, its unit, whether it holds numbers."""

    name: str
    unit: str = ""
    numeric: bool = False
    group: str = ""

    @property
    def label(self) -> str:
        """Name, group and unit in one line, for narrow screens."""
        name = f"{self.group}: {self.name}" if self.group else self.name
        return f"{name}, {self.unit}" if self.unit else name


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A cell whose ``status`` is a word and a shape, or that is machine text (``code``)."""

    text: str
    status: str = ""
    code: bool = False


@dataclass(frozen=True, kw_only=True)
class Table:
    """Table, rows named by their first cells; ``folded`` ones state their size in ``caption``."""

    caption: str
    heads: list[Head]
    rows: list[list[Cell]]
    sources: list[Source] = field(default_factory=list)
    folded: bool = False
    note: str = ""

    @property
    def groups(self) -> list[tuple[str, int]]:
        """Heads over several columns: name and how many columns; empty without any."""
        if not any(h.group for h in self.heads):
            return []
        found: list[tuple[str, int]] = []
        for head in self.heads:
            if found and head.group and found[-1][0] == head.group:
                found[-1] = (head.group, found[-1][1] + 1)
            else:
                found.append((head.group, 1))
        return found


@dataclass(frozen=True)
class Column(Generic[Thing]):
    """Column: its head, its cell of each thing; ``unit`` None for words, "" for plain numbers."""

    name: str
    cell: Callable[[Thing], str | Cell]
    unit: str | None = None
    group: str = ""

    @property
    def head(self) -> Head:
        """Head of the column."""
        numeric = self.unit is not None
        return Head(name=self.name, unit=self.unit or "", numeric=numeric, group=self.group)


def tabulated(
    caption: str, things: Sequence[Thing] | None, columns: Sequence[Column[Thing]],
    sources: Sequence[Source] = (), *, most: int | None = None, folded: bool = False,
    note: str = "",
) -> Table | None:  # fmt: skip
    """Table with a row for each of some things; None where there is none.

    Beyond ``most`` rows the others are left out, and the caption says so.
    """
    if not things:
        return None
    rows = [
        [v if isinstance(v := column.cell(thing), Cell) else Cell(text=v) for column in columns]
        for thing in things[:most]
    ]
    return Table(
        caption=caption + left_out(len(things), len(rows)),
        heads=[column.head for column in columns],
        rows=rows,
        sources=list(sources),
        folded=folded,
        note=note,
    )


def code(text: str) -> Cell:
    """A cell of machine text: a file, a hash, a parameter's key."""
    return Cell(text=text, code=True)


def lettered(words: Iterable[str]) -> dict[str, str]:
    """A mark of each of some sentences, which stand once below a table.

    >>> lettered(["too few", "", "too short", "too few"])
    {'too few': '(a)', 'too short': '(b)'}
    """
    each = dict.fromkeys(one for one in words if one)
    return {one: f"({mark})" for one, mark in zip(each, ascii_lowercase, strict=False)}


def marks_note(marks: Mapping[str, str]) -> str:
    """The sentences behind their marks."""
    return " ".join(f"{mark} {one.rstrip('.')}." for one, mark in marks.items())


MOST_ROWS = 200  # of a folded table; the whole is in the file named below it
MANY = 3  # files of one folder that are named one by one below a figure


def sources(shelf: SourceRegistry, *paths: Path) -> list[Source]:
    """Sources of a figure; more than three files of one folder are named together."""
    found = [s for p in paths if (s := shelf.source(p)) is not None]
    folders: dict[str, list[Source]] = {}
    for source in found:
        folders.setdefault(source.path.rpartition("/")[0], []).append(source)
    return [s for folder, group in folders.items() for s in _together(folder, group)]


def _together(folder: str, group: list[Source]) -> list[Source]:
    if len(group) <= MANY:
        return group
    path = f"{folder}/ ({len(group)} files)"
    made_from = group[0].made_from
    return [Source(path=path, sha256="", made_from=made_from, files=tuple(group))]


def left_out(count: int, shown: int) -> str:
    """Words of a caption on a table's omissions."""
    return f" ({shown} of {number(count)} shown)" if count > shown else ""
