"""Alarms of a machine, as its control reported them: facts and section."""

from dataclasses import dataclass

import numpy as np

from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, sources, tabulated
from pipeline.report.folders import MachineFolders
from pipeline.report.records import CLEANED, components, nanoseconds
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.si import NS

MOST_ON_RECORDS = 12
OPEN = np.iinfo(np.int64).min


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """Warning or fault; times in nanoseconds since 1970, ``end`` None while it is open."""

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
        """Duration of the alarm [s]; None while it is open."""
        return None if self.end is None else (self.end - self.start) / NS

    @property
    def text(self) -> str:
        """Code and message; empty where the control gave neither."""
        return f"{self.code} {self.message}".strip()

    @property
    def by(self) -> str:
        """Part of the machine, and data item."""
        return f"{self.where} ({self.item})".strip()

    @property
    def kind(self) -> tuple[str, str, str, str]:
        """Key of alarms that are counted together."""
        return self.level, self.item, self.code, self.message


@dataclass(frozen=True, kw_only=True)
class Alarms:
    """Alarms of a machine in the order of time, and parts whose conditions its agent describes."""

    folders: MachineFolders
    shelf: SourceRegistry
    alarms: list[Alarm]
    watched: tuple[str, ...] = ()

    @property
    def kinds(self) -> list[list[Alarm]]:
        """Alarms by kind: open ones first, then faults, then the most frequent."""
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
    items = components(folders, shelf).items()
    conditions = {item: where for item, (category, where) in items if category == "CONDITION"}
    start, end = (nanoseconds(table.column(name)) for name in ("start", "end"))
    rows = table.drop_columns(["start", "end"]).to_pylist()
    found = [
        Alarm(
            item=str(row["data_item"]), where=conditions.get(str(row["data_item"]), ""),
            level=str(row["level"]), code=str(row["code"] or ""),
            message=str(row["message"] or ""), start=int(start[i]),
            end=None if end[i] == OPEN else int(end[i]), ended=str(row["ended"]),
            program=str(row["program"] or ""), line=row["line"],
        )
        for i, row in enumerate(rows)
    ]  # fmt: skip
    return Alarms(folders=folders, shelf=shelf, alarms=found, watched=tuple(conditions.values()))


def kind_columns(say: Texts) -> tuple[Column[list[Alarm]], ...]:
    """Columns of a table of alarms by kind."""
    return (
        Column(say("alarms.level"), lambda same: (
            Cell(text=say("alarms.fault"), status="failed") if same[0].level == "fault"
            else Cell(text=say("alarms.warning"), status="attention")
        )),
        Column(say("alarms.alarm"), lambda same: same[0].text or say("alarms.no_text")),
        Column(say("alarms.by"), lambda same: same[0].by),
        Column(say("alarms.times"), lambda same: say.number(len(same)), ""),
        Column(say("alarms.in_all"), lambda same: (
            say.duration(sum(one.seconds or 0.0 for one in same))
        ), ""),
        Column(say("alarms.longest"), lambda same: (
            say.duration(max(one.seconds or 0.0 for one in same))
        ), ""),
        Column(say("alarms.last"), lambda same: say.moment(same[-1].start)),
        Column(say("alarms.then_in"), lambda same: _place(same[-1], say)),
    )  # fmt: skip


def columns(say: Texts) -> tuple[Column[Alarm], ...]:
    """Columns of a table of single alarms."""
    return (
        Column(say("alarms.from"), lambda one: say.moment(one.start)),
        Column(say("alarms.to"), lambda one: (
            say("alarms.open") if one.end is None else say.moment(one.end)
        )),
        Column(say("alarms.lasted"), lambda one: say.duration(one.seconds), ""),
        Column(say("alarms.of_level"), lambda one: (
            say(f"alarms.{'fault' if one.level == 'fault' else 'warning'}")
        )),
        Column(say("alarms.alarm"), lambda one: one.text or say("alarms.no_text")),
        Column(say("alarms.by"), lambda one: one.by),
        Column(say("alarms.in"), lambda one: _place(one, say)),
        Column(say("alarms.ended"), lambda one: (
            say(f"alarm_end.{one.ended}") if say.has(f"alarm_end.{one.ended}") else one.ended
        )),
    )  # fmt: skip


def _place(one: Alarm, say: Texts) -> Cell | str:
    if not one.program:
        return "–"
    if one.line is None:
        return code(one.program)
    return code(say("alarms.line", program=one.program, line=f"{one.line:.0f}"))


def alarms_section(alarms: Alarms, say: Texts = ENGLISH) -> Section | None:
    """Section on the alarms; nothing of a machine whose records hold no conditions."""
    if not alarms.alarms:
        return no_alarms(alarms, say)
    made = sources(alarms.shelf, alarms.folders.clean / "alarms.parquet")
    each = tabulated(say("alarms.each"), alarms.alarms[::-1], columns(say), made, most=MOST_ROWS,
                     folded=True)  # fmt: skip
    kinds = _kinds(alarms, "alarms.all_kinds", MOST_ON_RECORDS, say)
    return Section(key="alarms", title=say("alarms.title"), text=[_words(alarms.alarms, say)],
                   blocks=present(kinds, each))  # fmt: skip


def no_alarms(found: Alarms, say: Texts) -> Section | None:
    """Section of a machine without alarms; None where its records hold no conditions."""
    if not found.watched:
        return None
    said = say("alarms.none", count=len(found.watched))
    return Section(key="alarms", title=say("alarms.title"), text=[said])


def _kinds(found: Alarms, caption: str, most: int, say: Texts) -> Table | None:
    kinds, words = found.kinds, say(caption)
    if len(kinds) > most:
        words = say("alarms.shown", caption=words, shown=most, count=len(kinds))
    made = sources(found.shelf, found.folders.clean / "alarms.parquet")
    return tabulated(words, kinds[:most], kind_columns(say), made)


def _words(alarms: list[Alarm], say: Texts) -> str:
    faults = sum(one.level == "fault" for one in alarms)
    still = sum(one.ended == "open" for one in alarms)
    of_faults = say("alarms.faults", count=faults)
    of_warnings = say("alarms.warnings", count=len(alarms) - faults)
    said = [say("alarms.said", faults=of_faults, warnings=of_warnings)]
    known = [one for one in alarms if one.seconds is not None]
    if known:
        longest = max(known, key=lambda one: one.seconds or 0.0)
        said = [
            say("alarms.said_longest", faults=of_faults, warnings=of_warnings,
                alarm=longest.text or longest.item, duration=say.duration(longest.seconds))
        ]  # fmt: skip
    if still:
        said.append(say("alarms.still", count=still))
    return " ".join(said)
