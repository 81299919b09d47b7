"""Alarms of a machine, as its control reported them: facts and section."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from pipeline.charts.numbers import counted, duration, moment, number
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import MOST_ROWS, Cell, Column, code, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.report.records import CLEANED, NS, RAW, nanoseconds

TITLE = "Alarms"
MOST_KINDS = 5
"""Kinds of alarm on the lead's page; all of them are on that of the records."""
OPEN = np.iinfo(np.int64).min
ENDS = {
    "cleared": "",
    "changed": "until it changed its level",
    "unavailable": "until the control fell silent",
    "open": "at the end of the records",
}
"""How an alarm ended, for people; what was simply cleared needs no word."""


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """One warning or fault; times in nanoseconds since 1970, ``end`` None while it is open."""

    item: str
    where: str
    level: str
    code: str
    message: str
    start: int
    end: int | None
    ended: str
    program: str
    line: float | None

    @property
    def seconds(self) -> float | None:
        """How long it was active [s]; None while it is open."""
        return None if self.end is None else (self.end - self.start) / NS

    @property
    def kind(self) -> tuple[str, str, str, str]:
        """What alarms have in common that are counted together."""
        return self.level, self.item, self.code, self.message


@dataclass(frozen=True, kw_only=True)
class Alarms:
    """Alarms of a machine in the order of time, and how many conditions its agent describes."""

    folders: MachineFolders
    shelf: SourceRegistry
    alarms: list[Alarm]
    watched: int = 0

    @property
    def kinds(self) -> list[list[Alarm]]:
        """Those of one kind together: open ones first, then faults, then the most frequent."""
        found: dict[tuple[str, str, str, str], list[Alarm]] = {}
        for one in self.alarms:
            found.setdefault(one.kind, []).append(one)
        return sorted(
            found.values(),
            key=lambda same: (
                not any(one.ended == "open" for one in same), same[0].level != "fault", -len(same),
                same[0].kind,
            ),
        )  # fmt: skip


def machine_alarms(folders: MachineFolders, shelf: SourceRegistry) -> Alarms:
    """Alarms of a machine, from its clean tables."""
    columns = ("data_item", "level", "code", "message", "start", "end", "ended", "program", "line")
    table = shelf.table(folders.clean / "alarms.parquet", columns, CLEANED)
    if table is None:
        return Alarms(folders=folders, shelf=shelf, alarms=[])
    components = _components(folders, shelf)
    start, end = (nanoseconds(table.column(name)) for name in ("start", "end"))
    rows = table.drop_columns(["start", "end"]).to_pylist()
    found = [
        Alarm(
            item=str(row["data_item"]), where=components.get(str(row["data_item"]), ""),
            level=str(row["level"]), code=str(row["code"] or ""),
            message=str(row["message"] or ""), start=int(start[i]),
            end=None if end[i] == OPEN else int(end[i]), ended=str(row["ended"]),
            program=str(row["program"] or ""), line=row["line"],
        )
        for i, row in enumerate(rows)
    ]  # fmt: skip
    return Alarms(folders=folders, shelf=shelf, alarms=found, watched=len(components))


def _components(folders: MachineFolders, shelf: SourceRegistry) -> Mapping[str, str]:
    """Part of the machine that each condition belongs to, by data item."""
    path = folders.signals / "data_items.parquet"
    table = shelf.table(path, ("data_item", "component", "component_name", "category"), RAW)
    if table is None:
        return {}
    words = [column.cast(pa.string()).to_pylist() for column in table.columns]
    return {
        str(item): _component(kind or "", name or "")
        for item, kind, name, category in zip(*words, strict=True)
        if category == "CONDITION"
    }


def _component(kind: str, name: str) -> str:
    """A component by its type and its name, said once where they are one word."""
    return kind if kind.casefold() == name.casefold() else f"{kind} {name}".strip()


KINDS: tuple[Column[list[Alarm]], ...] = (
    Column("Level", lambda same: (
        Cell(text="fault", status="failed") if same[0].level == "fault"
        else Cell(text="warning", status="attention")
    )),
    Column("alarm", lambda same: f"{same[0].code} {same[0].message}".strip() or "no text"),
    Column("reported by", lambda same: f"{same[0].where} ({same[0].item})".strip()),
    Column("times", lambda same: number(len(same)), ""),
    Column("in all", lambda same: duration(sum(one.seconds or 0.0 for one in same)), ""),
    Column("longest", lambda same: duration(max(one.seconds or 0.0 for one in same)), ""),
    Column("last", lambda same: moment(same[-1].start)),
    Column("then in", lambda same: _place(same[-1])),
)  # fmt: skip
EACH: tuple[Column[Alarm], ...] = (
    Column("From", lambda one: moment(one.start)),
    Column("to", lambda one: "open" if one.end is None else moment(one.end)),
    Column("lasted", lambda one: duration(one.seconds), ""),
    Column("level", lambda one: one.level),
    Column("alarm", lambda one: f"{one.code} {one.message}".strip() or "no text"),
    Column("reported by", lambda one: f"{one.where} ({one.item})".strip()),
    Column("in", lambda one: _place(one)),
    Column("ended", lambda one: ENDS.get(one.ended, one.ended) or "cleared"),
)


def _place(one: Alarm) -> Cell | str:
    """Program, and line, that were in the control."""
    if not one.program:
        return "–"
    return code(one.program if one.line is None else f"{one.program}, line {one.line:.0f}")


def alarms_section(found: Alarms) -> Section | None:
    """What the control warned of; nothing of a machine whose records hold no conditions."""
    if not found.alarms and not found.watched:
        return None
    if not found.alarms:
        said = f"None of {counted(found.watched, 'condition')} was a warning or a fault."
        return Section(key="alarms", title=TITLE, text=[said])
    made = sources(found.shelf, found.folders.clean / "alarms.parquet")
    newest = found.alarms[::-1]
    blocks = present(
        tabulated("What was reported, faults first", found.kinds, KINDS, made, most=12),
        tabulated("Each alarm, the newest first", newest, EACH, made, most=MOST_ROWS, folded=True),
    )
    return Section(key="alarms", title=TITLE, text=[_words(found.alarms)], blocks=blocks)


def lead_alarms(found: Alarms) -> Section | None:
    """The same for the lead's page, shorter; nothing where records hold no conditions."""
    whole = alarms_section(found)
    if whole is None or not found.alarms:
        return whole
    made = sources(found.shelf, found.folders.clean / "alarms.parquet")
    kinds = tabulated("Alarms by kind, those still active first", found.kinds, KINDS, made,
                      most=MOST_KINDS)  # fmt: skip
    return Section(key="alarms", title=TITLE, text=whole.text, blocks=present(kinds))


def _words(alarms: list[Alarm]) -> str:
    faults = [one for one in alarms if one.level == "fault"]
    warnings = len(alarms) - len(faults)
    still = [one for one in alarms if one.ended == "open"]
    said = (
        f"The control reported {counted(len(faults), 'fault')} and {counted(warnings, 'warning')}"
    )
    known = [one for one in alarms if one.seconds is not None]
    if known:
        longest = max(known, key=lambda one: one.seconds or 0.0)
        name = f"{longest.code} {longest.message}".strip() or longest.item
        said += f"; the longest was {name}, {duration(longest.seconds)}"
    if not still:
        return f"{said}."
    count = f"{counted(len(still), 'alarm')} {'was' if len(still) == 1 else 'were'}"
    return f"{said}. At the end of the records {count} still active."
