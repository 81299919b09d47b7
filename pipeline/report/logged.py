"""What a machine's cleaned log holds: items that no record has, and signals with values."""

import re
from collections.abc import Mapping

import pyarrow.parquet as pq

from pipeline.charts.sources import SourceRegistry, shown
from pipeline.report.folders import MachineFolders

WORD = re.compile(r"[a-z]+")


def absent_items(folders: MachineFolders, shelf: SourceRegistry) -> Mapping[str, list[str]]:
    """Data items that the machine's file names and no record has, each with those called like it.

    From ``summary.json`` of cleaning; one that cannot be read is told, not raised.
    """
    path = folders.clean / "summary.json"
    summary = shelf.document(path, "data/signals observations, by cleaning") or {}
    absent, near = summary.get("absent", []), summary.get("near", {})
    if not isinstance(absent, list) or not isinstance(near, dict):
        shelf.broken[shown(path)] = "not a summary of cleaning: absent is a list, near an object"
        return {}
    like = {str(item): near.get(item) for item in absent}
    return {
        item: [str(one) for one in (found if isinstance(found, list) else [])]
        for item, found in like.items()
    }


def logged_signals(folders: MachineFolders) -> tuple[str, ...]:
    """Signals of numbers of which the newest cleaned day has a value, in their file's order."""
    days = sorted((folders.clean / "state").glob("*.parquet"))
    if not days:
        return ()
    try:
        table = pq.read_table(days[-1])
    except (OSError, ValueError):
        return ()  # the section on the work says that the file is broken
    return tuple(
        name for name in table.column_names
        if _is_number(table.schema.field(name).type) and table.column(name).drop_null().length()
    )  # fmt: skip


def _is_number(kind: object) -> bool:
    return any(word in str(kind) for word in ("int", "float", "double")) and "[" not in str(kind)


def already(wanted: str, signals: tuple[str, ...]) -> list[str]:
    """Of ``signals`` those that the sentence ``wanted`` asks for: it has every word of the name."""
    asked = {_singular(word) for word in WORD.findall(wanted.lower())}
    found = [name for name in signals if {_singular(w) for w in name.lower().split("_")} <= asked]
    return [name.replace("_", " ") for name in found]


def _singular(word: str) -> str:
    return word.removesuffix("s")
