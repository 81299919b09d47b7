"""Conditions of recordings (tool, feed, depth, wear, each with its unit), and parts of tables.

A part of a recorded table by the values of some columns is a recording of its own, called
``<file>#<column>=<value>,…`` in section ``roles`` of the machine's file, with the hash of its own
samples.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from hashlib import sha256
from math import isfinite
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Floats
from pipeline.signals.columns import RUNS, unit_of
from pipeline.signals.units import conversion

SAME_CONDITION = 1e-6
"""Relative difference [1] below which two numbers stand for one condition."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """One condition of a recording: tool, material, feed, speed, depth, wear."""

    value: float | str
    """Number in ``unit``, or a word."""
    unit: str = ""
    """Unit, ``""`` for none."""
    source: str = ""
    """Place of the condition, as the end of a sentence: ``"its name"``, ``"runs.parquet"``."""

    def to(self, unit: str) -> float:
        """The number in ``unit``; a word, or a unit of another quantity, is a ValueError."""
        if isinstance(self.value, str):
            raise ValueError(f"{self.value!r} is a word, no number in {unit}")
        factor, offset = conversion(self.unit, unit)
        return self.value * factor + offset


@dataclass(frozen=True, kw_only=True)
class ConditionSources:
    """Conditions of recordings: for all, by pattern, in names, and columns of ``runs.parquet``."""

    everywhere: Mapping[str, float | str] = field(default_factory=dict)
    """Conditions of all recordings."""
    by_pattern: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    """Pattern of recordings' names -> their conditions."""
    name: str | None = None
    """Regular expression on a recording's name whose named groups are conditions."""
    units: Mapping[str, str | None] = field(default_factory=dict)
    """Condition -> its unit, None for words.  Where it is not empty these are all conditions that a
    name may give."""
    section: str = "recordings"
    """Section of the machine's file that they come from, for messages."""

    def of(
        self, recording: str, row: Mapping[str, Condition] | None = None
    ) -> dict[str, Condition]:
        """Conditions of ``recording``; ``row`` holds those of ``runs.parquet``.

        Sources that contradict each other, and a regular expression that is none or names what is
        no condition, are a ValueError.
        """
        found: dict[str, Condition] = {}
        self._add(found, self._given(self.everywhere, f"{self.section}.conditions"))
        for pattern, given in self.by_pattern.items():
            if fnmatchcase(recording, pattern):
                self._add(found, self._given(given, f"{self.section}.by_pattern, {pattern!r}"))
        self._add(found, row or {})
        if self.name is not None:
            self._add(found, self._in_name(recording, self.name))
        return found

    def _given(self, given: Mapping[str, float | str], source: str) -> dict[str, Condition]:
        return {
            name: Condition(value=value, unit=self.units.get(name) or "", source=source)
            for name, value in given.items()
        }

    @staticmethod
    def _add(found: dict[str, Condition], new: Mapping[str, Condition]) -> None:
        for name, one in new.items():
            before = found.get(name)
            if before is not None and not _agree(before, one):
                raise ValueError(
                    f"its {name} is {before.value} by {before.source} and {one.value} by "
                    f"{one.source}: correct one of them"
                )
            found[name] = one

    def _in_name(self, recording: str, pattern: str) -> dict[str, Condition]:
        """Named groups of the regular expression in a recording's name."""
        try:
            expression = re.compile(pattern)
        except re.error as error:
            raise ValueError(
                f"{self.section}.name = {pattern!r} is no regular expression: {error}"
            ) from error
        if self.units and (strange := sorted(set(expression.groupindex) - set(self.units))):
            raise ValueError(
                f"{self.section}.name has the group {strange[0]!r}, which is no condition: use "
                f"{', '.join(self.units)}"
            )
        match = expression.search(recording)
        groups = {} if match is None else match.groupdict()
        return {
            name: Condition(
                value=self._value(name, text), unit=self.units.get(name) or "", source="its name"
            )
            for name, text in groups.items()
            if text is not None
        }

    def _value(self, name: str, text: str) -> float | str:
        """Number or word that a group matched; a number where a unit is declared."""
        if name in self.units and self.units[name] is None:
            return text
        try:
            return float(text.strip(".").replace(",", "."))
        except ValueError as error:
            if name not in self.units:
                return text
            raise ValueError(
                f"its name has {name} = {text!r}, which is no number: correct {self.section}.name"
            ) from error


def _agree(one: Condition, other: Condition) -> bool:
    if isinstance(one.value, str) or isinstance(other.value, str):
        return one.value == other.value
    value = other.value if one.unit == other.unit else other.to(one.unit)
    return abs(one.value - value) <= SAME_CONDITION * max(abs(one.value), abs(value))


def conditions_in_runs(path: Path) -> dict[str, dict[str, Condition]]:
    """Conditions in the further columns of ``runs.parquet`` by raw file; empty without the file."""
    try:
        table = pq.read_table(path)
    except (OSError, pa.ArrowException):
        return {}
    names = [name for name in table.column_names if name not in RUNS.names]
    rows = conditions_in_rows(table.select(names), "runs.parquet")
    return dict(zip(table["file"].to_pylist(), rows, strict=True))


def conditions_in_rows(table: pa.Table, source: str) -> list[dict[str, Condition]]:
    """Conditions in each row of a table, by column; those without a value are left out."""
    units = {field.name: unit_of(field) for field in table.schema}
    return [
        {
            name: Condition(value=value, unit=units[name], source=source)
            for name, value in row.items()
            if value is not None and (not isinstance(value, float) or isfinite(value))
        }
        for row in table.to_pylist()
    ]


PART = "#"
"""Separator of the name of a raw file and that of a part of it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TablePart:
    """Rows of a table in which some columns hold the same values."""

    values: Mapping[str, str]
    """Column -> its value, as a word."""
    rows: Bools
    """Rows of the table; shape (T,)."""

    def name(self, file: str) -> str:
        """Name of the part of the raw file ``file``."""
        named = ",".join(f"{key}={value}" for key, value in self.values.items())
        return f"{file}{PART}{named}"


def selection(name: str) -> tuple[str, dict[str, str]]:
    """Raw file of a recording or of a part of one, and the column values that select the part.

    >>> selection("cuts.csv#tool=T3,cut=1 (part 2)")
    ('cuts.csv', {'tool': 'T3', 'cut': '1'})
    >>> selection("trace #1.csv")
    ('trace #1.csv', {})
    """
    file, _, part = name.partition(PART)
    words = [one.partition("=") for one in part.partition(" (part ")[0].split(",")]
    values = {column: value for column, sign, value in words if sign}
    return (file, values) if values else (name, {})


def share_rows(one: str, other: str) -> bool:
    """Whether two recordings, or parts of them, may hold the same rows of one file."""
    (file, values), (another, others) = selection(one), selection(other)
    same = all(others[column] == value for column, value in values.items() if column in others)
    return file == another and same


def parts_of(path: Path, columns: Sequence[str], section: str) -> list[TablePart]:
    """Parts of an ingested table by the values of ``columns``, in the order of their first rows."""
    names = pq.read_schema(path).names
    for name in columns:
        if name not in names:
            raise ValueError(f"it has no column {name!r}, which {section} names: correct it")
    table = pq.read_table(path, columns=list(columns))
    words = [as_words(table[name]) for name in columns]
    joined = np.array(["\x1f".join(row) for row in zip(*words, strict=True)])
    kinds, first = np.unique(joined, return_index=True)
    return [
        TablePart(
            values=dict(zip(columns, kinds[k].split("\x1f"), strict=True)), rows=joined == kinds[k]
        )
        for k in np.argsort(first).tolist()
    ]


def as_words(column: pa.ChunkedArray) -> list[str]:
    """Values of a column as words; whole numbers without a fraction, ``""`` for none."""
    return [
        "" if value is None
        else f"{value:g}" if isinstance(value, float) and abs(value) < 1e6
        else f"{value:.0f}" if isinstance(value, float) and value == int(value)
        else str(value)
        for value in column.to_pylist()
    ]  # fmt: skip


def samples_sha256(named: Iterable[tuple[str, Floats]]) -> str:
    """SHA-256 of named channels: a copy has the same, whatever its file is called."""
    digest = sha256()
    for name, values in named:
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values, dtype="<f8").tobytes())
    return digest.hexdigest()
