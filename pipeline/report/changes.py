"""Key figures of a report as they are stored, and their changes since the report before."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from pipeline.charts.numbers import TOGETHER, powers, unit_words
from pipeline.charts.sections import ChangeNote, Section, present
from pipeline.charts.tables import Column, tabulated
from pipeline.report.facts import MachineFacts, MachineVerdict, passed_words
from pipeline.report.part_programs import part_changes
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.model import Parameter
from pipeline.schema.store import StoreError, read_json, write_json

FORMAT = 2  # of report.json; another one is not compared
VERDICT = "verdict"
"""Key of the figure that holds how many sub-models passed, as ``7/8``."""
MOST_FILES = 5
UNITS = {"active_h": "h", "parts_before_s": "s", "parts_after_s": "s"}
"""Units of the figures of the page itself; the others are counts."""


@dataclass(frozen=True, kw_only=True)
class KeyFigure:
    """Key figure: its name, its unit, its value, and whether that is a count."""

    name: str
    unit: str = ""
    value: float | str | None = None
    whole: bool = False

    def words(self, say: Texts = ENGLISH) -> str:
        """The value in words."""
        if self.value is None:
            return say("format.not_known")
        if isinstance(self.value, str):
            return _text(self.value, say)
        shown = say.number(int(self.value) if self.whole else self.value)
        unit = powers(unit_words(self.unit))
        return f"{shown}{TOGETHER}{unit}" if unit else shown


def _text(value: str, say: Texts) -> str:
    """A value that is a moment, or how many sub-models passed; other text as it is."""
    if value[:4].isdigit() and "T" in value:
        return say.moment(value)
    passed, slash, of = value.partition("/")
    if slash and passed.isdigit() and of.isdigit():
        return passed_words(int(passed), int(of), say)
    return value


def key_figure(name: str, unit: str, value: float | str | None) -> KeyFigure:
    """A key figure, a count where the value is a whole number."""
    return KeyFigure(name=name, unit=unit, value=value, whole=isinstance(value, int))


@dataclass(frozen=True, kw_only=True)
class MachineFigures:
    """Key figures of one machine."""

    figures: Mapping[str, KeyFigure]
    """Key figures in the order in which changes are shown."""
    parameters: Mapping[str, Mapping[str, Mapping[str, Parameter]]] = field(default_factory=dict)
    """Parameters of each sub-model, by group and name, without method and remedy."""
    raw: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each raw file."""


Machines = Mapping[str, MachineFigures]


@dataclass(frozen=True, kw_only=True)
class KeyFigures:
    """The content of ``report.json``: key figures by machine, and those they were compared with."""

    format: int
    machines: Machines
    compared_with: Machines | None = None


@dataclass(frozen=True, kw_only=True)
class Change:
    """Key figure then and now, in words; ``note`` is the meaning of a change."""

    what: str
    before: str
    now: str
    difference: str
    note: str = ""


def key_figures(facts: MachineFacts, verdict: MachineVerdict) -> MachineFigures:
    """Key figures of a machine, named in English."""
    records, work = facts.records, facts.work
    known, gaps, cleaned = records.files is not None, records.gap_causes, records.changes
    passed = None if verdict.passed is None else "/".join(map(str, verdict.passed))
    values: dict[str, float | str | None] = {
        VERDICT: passed,
        "days": len(work.worked_days),
        "last_record": records.newest.isoformat() if records.newest else None,
        "files": len(records.files) if records.files is not None else None,
        "records": records.records if known else None,
        "rejected": records.rejected if known else None,
        "gaps": None if gaps is None else sum(n for _, n, _ in gaps),
        "changes": None if cleaned is None else sum(one.count for one in cleaned),
        "active_h": round(work.active / 3600, 3) if work.days else None,
        "cycles": None if work.cycles is None else len(work.cycles),
    }
    compared = {
        name: key_figure(one.name, one.unit, one.value)
        for page in facts.pages for name, one in page.compared.items()
    }  # fmt: skip
    if facts.programs:
        values["programs"] = len(facts.programs)
    values |= part_changes(facts.parts)
    figures = {
        name: key_figure(ENGLISH(f"figure.{name}"), UNITS.get(name, ""), value)
        for name, value in values.items()
    }
    return MachineFigures(
        figures=figures | compared,
        parameters={
            one.name: {
                group: {name: replace(p, method="", remedy="") for name, p in of_group.items()}
                for group, of_group in one.model.parameters.items()
            }
            for one in facts.models if one.model is not None
        },
        raw={name: f.sha256 for name, f in (records.files or {}).items()},
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Earlier:
    """Figures of one machine to compare with, or ``why_not``, the key of a text."""

    figures: MachineFigures | None
    why_not: str = ""


def last_report(path: Path | None) -> KeyFigures | str:
    """The last ``report.json``, ``path`` or in it; the key of the text that says why there is none.

    >>> last_report(None)
    'changes.not_given'
    """
    if path is None:
        return "changes.not_given"
    file = path / "report.json" if path.is_dir() else path
    if not file.is_file():
        return "changes.first"
    try:
        last = read_json(file, KeyFigures)
    except StoreError:
        return "changes.unreadable"
    return last if last.format == FORMAT else "changes.other_format"


def earlier(last: KeyFigures | str, machine: str, now: MachineFigures) -> Earlier:
    """What a machine with the key figures ``now`` is to be compared with.

    Where the last report has the same figures nothing has changed since, and they are compared with
    what those were compared with: a report written twice is the same report.
    """
    if isinstance(last, str):
        return Earlier(figures=None, why_not=last)
    same = last.machines.get(machine) == now
    return Earlier(figures=((last.compared_with or {}) if same else last.machines).get(machine),
                   why_not="changes.first")  # fmt: skip


def write_key_figures(path: Path, machines: Mapping[str, tuple[MachineFigures, Earlier]]) -> None:
    """Write ``report.json`` with what it was compared with; equal reports are equal files."""
    document = KeyFigures(
        format=FORMAT, machines={name: now for name, (now, _) in machines.items()},
        compared_with={name: one.figures for name, (_, one) in machines.items()
                       if one.figures is not None},
    )  # fmt: skip
    write_json(document, path)


def changes(
    before: MachineFigures, now: MachineFigures, notes: Mapping[str, ChangeNote],
    say: Texts = ENGLISH,
) -> list[Change]:  # fmt: skip
    """Changes of a machine's key figures; ``notes`` gives the meaning of a parameter's change."""
    found = []
    for key in dict.fromkeys([*now.figures, *before.figures]):
        old, new = before.figures.get(key), now.figures.get(key)
        if (old.value if old else None) != (new.value if new else None):
            found.append(_change(key, old, new, say))
    found += _parameter_changes(before, now, notes, say)
    return [*found, *_raw_changes(before.raw, now.raw, say)]


def _parameter_changes(
    before: MachineFigures, now: MachineFigures, notes: Mapping[str, ChangeNote], say: Texts
) -> Iterator[Change]:
    old, new = _flat(before), _flat(now)
    for key in sorted(set(old) | set(new)):
        submodel, group, name = key
        words = " ".join(word for word in key if word)
        p, q = old.get(key), new.get(key)
        title = say("figure.parameter", name=words.replace("_", " "))
        a, b = (
            None
            if one is None
            else key_figure(title, one.unit, one.value if one.determined else None)
            for one in (p, q)
        )
        # a sub-model may compare a parameter itself, in units of the shop floor
        if words in now.figures or (a.value if a else None) == (b.value if b else None):
            continue
        note = ""
        if p is not None and q is not None and p.determined and q.determined and submodel in notes:
            note = notes[submodel](group, name, p, q)
        yield replace(_change("", a, b, say), note=note)


def _flat(figures: MachineFigures) -> dict[tuple[str, str, str], Parameter]:
    return {
        (submodel, group, name): p
        for submodel, groups in figures.parameters.items()
        for group, of_group in groups.items()
        for name, p in of_group.items()
    }


def _change(key: str, before: KeyFigure | None, now: KeyFigure | None, say: Texts) -> Change:
    said = now or before or KeyFigure(name="")
    unknown = KeyFigure(name=said.name, unit=said.unit)
    old, new = before or unknown, now or unknown
    difference = ""
    if isinstance(old.value, int | float) and isinstance(new.value, int | float):
        step = new.value - old.value
        counts = replace(said, value=step, whole=old.whole and new.whole)
        difference = ("+" if step > 0 else "") + counts.words(say)
    name = say(f"figure.{key}") if say.has(f"figure.{key}") else say.given(said.name)
    return Change(what=name, before=old.words(say), now=new.words(say), difference=difference)


def _raw_changes(old: Mapping[str, str], new: Mapping[str, str], say: Texts) -> list[Change]:
    added, gone = sorted(set(new) - set(old)), sorted(set(old) - set(new))
    changed = sorted(f for f in set(old) & set(new) if old[f] != new[f])
    return [
        Change(what=say(f"changes.{key}"), before="", now=say.some(files, MOST_FILES),
               difference="")
        for key, files in (("new_files", added), ("gone_files", gone), ("changed_files", changed))
        if files
    ]  # fmt: skip


def since_words(before: MachineFigures | None, say: Texts) -> str:
    """The earlier report by the newest record that it knew: a report holds no date of its own."""
    last = None if before is None else before.figures.get("last_record")
    if last is None or last.value is None:
        return say("changes.last_report")
    return say("changes.report_of", moment=last.words(say))


def columns(say: Texts) -> tuple[Column[Change], ...]:
    """Columns of a table of changes."""
    return (
        Column(say("changes.figure"), lambda change: change.what),
        Column(say("changes.before"), lambda change: change.before or "–"),
        Column(say("changes.now"), lambda change: change.now),
        Column(say("changes.change"), lambda change: change.difference or "–"),
    )


def changes_section(differences: list[Change], why_none: str, say: Texts = ENGLISH) -> Section:
    """Key figures that differ from the last report, or why there are none."""
    title = say("changes.title")
    return Section(
        key="changes",
        title=title,
        text=[why_none] if why_none else [d.note for d in differences if d.note],
        blocks=present(tabulated(title, differences, columns(say))),
    )
