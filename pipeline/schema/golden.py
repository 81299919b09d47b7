"""Golden and sealed sets: raw files frozen by hash, and the days inside them that count.

Files without a clock belong to a set as a whole, files of an agent's log on its days.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from pipeline.schema.days import is_day
from pipeline.schema.model import SourceFile
from pipeline.schema.store import read_json


@dataclass(frozen=True, kw_only=True)
class Days:
    """First and last day of the plant, ``YYYY-MM-DD``, both included."""

    first: str
    last: str

    def __post_init__(self) -> None:
        for name in ("first", "last"):
            day = getattr(self, name)
            if not is_day(day):
                raise ValueError(f"the {name} day {day!r} is no day YYYY-MM-DD")
        if self.last < self.first:
            raise ValueError(f"the last day {self.last} is before the first, {self.first}")

    def __contains__(self, day: str) -> bool:
        return self.first <= day <= self.last


@dataclass(frozen=True, kw_only=True)
class FrozenSet:
    """Raw files by hash; ``days`` are those that count in files that have a clock."""

    files: tuple[SourceFile, ...]
    """Path below ``data/raw/<machine>`` and SHA-256 of the bytes; of a part of a table,
    ``<file>#<column>=<value>``, those of the table."""
    days: Days | None = None
    """Days that count; None where no file has a clock."""
    time_zone: str = "UTC"
    """Time zone of the plant, whose days they are."""
    whole: tuple[str, ...] = ()
    """Names in ``files`` that were given beside the days: all of their days count."""

    @property
    def sha256(self) -> str:
        """One hash of the whole set: of its files' names and hashes, and of what counts in them."""
        lines = [f"{one.sha256}  {one.file}\n" for one in self.files]
        if self.days is not None:
            lines += [f"{self.days.first} {self.days.last} {self.time_zone}\n"]
            lines += [f"whole {name}\n" for name in self.whole]
        return hashlib.sha256("".join(lines).encode()).hexdigest()


@dataclass(frozen=True, kw_only=True)
class GoldenSets:
    """Frozen sets of a machine: its golden set, and the sealed one beside it."""

    machine: str
    golden: FrozenSet | None = None
    sealed: FrozenSet | None = None


def read_golden(path: Path) -> GoldenSets | None:
    """The frozen sets in ``data/golden/<machine>.json``; None when nothing was frozen."""
    if not path.exists():
        return None
    return read_json(path, GoldenSets, f"freeze it again with `kerf golden --machine {path.stem}`")
