"""Facts about one machine, the input of its page: records, sub-models, truth, actions, states."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow.parquet as pq
from markupsafe import Markup

from pipeline.charts.sections import Action, PartVerdict, SubModelPage
from pipeline.charts.sources import SourceRegistry, picked, shown
from pipeline.charts.submodel_page import PageContent, Subject, submodel_page
from pipeline.charts.svg import sparkline
from pipeline.report.alarms import Alarms, machine_alarms
from pipeline.report.condition import week_reports
from pipeline.report.folders import CHOICES, MachineFolders, program_pages
from pipeline.report.incidents import monitored
from pipeline.report.part_programs import MODELS, PartPrograms, part_programs
from pipeline.report.programs.simulated import Program, program_of, simulated_programs
from pipeline.report.records import Changed, RecordsRead, records_read
from pipeline.report.texts import Texts
from pipeline.report.work import Work, days_between, work
from pipeline.schema.bundle import BUNDLE, Bundle, model_hash
from pipeline.schema.condition import WeekReport
from pipeline.schema.days import day_of
from pipeline.schema.golden import Days, GoldenSets
from pipeline.schema.history import Entry, read_history
from pipeline.schema.incident import Monitored
from pipeline.schema.ledger import Night, read_ledger
from pipeline.schema.ledger import serving as of_serving
from pipeline.schema.model import Model
from pipeline.schema.program_cut import AS_WRITTEN, CutProgram
from pipeline.schema.si import DAY, NS
from pipeline.schema.store import StoreError
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown, submodel
from pipeline.submodels.siblings import siblings_section

Status = Literal["failed", "attention", "passed", "unknown"]
AT_MACHINE = ("maintenance", "tool room")
"""Who works at the machine itself."""


@dataclass(frozen=True, kw_only=True)
class ActionRow:
    """Action with the page that shows why, ``href`` if any; ``english`` names English fields."""

    action: Action
    href: str = ""
    english: tuple[str, ...] = ()
    risk: Literal[0, 1, 2] = 0
    """2 where the machine, a part or the judgement is at stake, 1 where something is to be watched,
    0 of what only makes the twin better."""
    since: str = ""
    """ISO day since when it is known; empty where it has none."""
    course: tuple[float, ...] = ()
    """Its course over days or weeks up to the newest, for a sparkline; NaN where unknown."""

    @property
    def status(self) -> Status:
        """Look of the risk."""
        looks: tuple[Status, Status, Status] = ("unknown", "attention", "failed")
        return looks[self.risk]

    def spark(self, say: Texts) -> Markup:
        """Its course as a curve, with the values on hover."""
        known = [say.number(one) for one in self.course if isfinite(one)]
        return sparkline(self.course, say("actions.course", values=", ".join(known)))

    @property
    def engineers(self) -> bool:
        """Whether it is for engineers, and nothing is at stake before they come to it."""
        return self.risk < 2 and self.action.who not in AT_MACHINE

    def until(self, say: Texts) -> str:
        """Deadline, in words."""
        key = f"until.{self.action.until}"
        return say(key) if say.has(key) else say.given(self.action.until)

    def who(self, say: Texts) -> str:
        """Who does it, in words."""
        return say(f"who.{self.action.who.replace(' ', '_')}")

    def where(self, say: Texts) -> str:
        """Place, in words."""
        return say.given(self.action.where)


@dataclass(frozen=True, kw_only=True)
class StateLine:
    """State of one thing: its status, a few words, and sentences that say why."""

    status: Status
    word: str
    sentences: list[str]


@dataclass(frozen=True, kw_only=True)
class MachineVerdict:
    """Head of a page: the machine's condition, its twin, and what is to be done.

    ``passed`` is how many of the sub-models that count passed, and of how many; None without any.
    """

    condition: StateLine
    twin: StateLine
    actions: list[ActionRow]
    passed: tuple[int, int] | None = None
    read: tuple[str, ...] = ()
    """Sentences to be read aloud: the machine, what comes first, what the twin is good for."""

    @property
    def status(self) -> Status:
        """Status of the twin."""
        return self.twin.status

    def word(self, say: Texts) -> str:
        """Both lines in one, for tables and titles."""
        return say("twin.state", condition=self.condition.word, twin=self.twin.word)


def first_action(actions: list[ActionRow]) -> ActionRow:
    """The first of some actions by their order, those at the machine before the engineers'."""
    return next((row for row in actions if not row.engineers), actions[0])


def passed_words(passed: int, of: int, say: Texts) -> str:
    """Number of sub-models that passed, in words."""
    if passed == of:
        return say("twin.all_passed", count=passed)
    return say("twin.some_passed", passed=passed, all=of)


TRAINING = "the raw files that it names"
JUDGED = "the model and records that it was not fitted on"


@dataclass(frozen=True, kw_only=True)
class ModelledPart:
    """Sub-model of a machine: its name, its title, its files, its page."""

    name: str
    title: str
    shown: Shown[Any]
    page: SubModelPage
    sha256: str = ""
    """Hash of the files that predict; empty where there is no model."""

    @property
    def model(self) -> Model | None:
        """The stored model; None where there is none."""
        return self.shown.model

    @property
    def judged(self) -> Verdict | None:
        """The stored verdict; None where there is none."""
        return self.shown.verdict

    def leaked(self, sets: GoldenSets | None) -> list[str]:
        """Cases or frozen files to judge by that the model was also fitted on."""
        if self.model is None:
            return []
        fitted = self.model.training_files
        frozen = () if sets is None or sets.golden is None else sets.golden.files
        found = [one.file for one in frozen if one.sha256 in fitted]
        trained = {one.case for one in self.model.trained_on}
        cases = () if self.judged is None else self.judged.cases
        return found or [
            one.case for one in cases if one.role in ("golden", "held_out") and one.case in trained
        ]


def modelled_parts(
    folders: MachineFolders, shelf: SourceRegistry, truth: Mapping[str, Any] | None
) -> list[ModelledPart]:
    """Sub-models of a machine, in the order of the fleet."""
    return [_part(name, folders, shelf, truth) for name in folders.submodels]


def _part(
    name: str, folders: MachineFolders, shelf: SourceRegistry, truth: Mapping[str, Any] | None
) -> ModelledPart:
    one, folder = submodel(name), folders.models / name
    shown: Shown[Any] = Shown(
        machine=folders.name,
        origin=folders.origin,
        model=shelf.read(folder / "model.json", one.model, TRAINING),
        verdict=shelf.read(folder / "verdict.json", Verdict, JUDGED),
        predictions=shelf.predictions(folder / "predictions.parquet", JUDGED),
        truth=truth,
        shelf=shelf,
        folder=folder,
        clean=folders.clean,
        signals=folders.signals,
    )
    subject = Subject(name=name, title=one.title, needs=one.needs)
    content = one.page(shown) or PageContent()
    page = submodel_page(shown, subject, content)
    section = siblings_section(one, shown, content, folders.type, folders.siblings)
    if section is not None:
        page = replace(page, sections=[*page.sections, section])
    sha256 = "" if shown.model is None else model_hash(folder)
    return ModelledPart(name=name, title=one.title, shown=shown, page=page, sha256=sha256)


@dataclass(frozen=True, kw_only=True)
class Serving:
    """The champion beside the latest models."""

    path: Path
    """Path of the champion's bundle."""
    bundle: Bundle
    """Bundle that serves."""
    older: tuple[str, ...]
    """Sub-models of which the champion and the latest are not the same model."""
    history: tuple[Entry, ...] = ()
    """Who served when; empty where nobody has chosen yet, or it cannot be read."""
    broken: str = ""
    """Why the history cannot be read."""


def serving(
    folders: MachineFolders, shelf: SourceRegistry, parts: list[ModelledPart]
) -> Serving | None:
    """The champion of a machine; None where none serves."""
    if folders.champion is None:
        return None
    path = folders.champion / BUNDLE
    bundle = shelf.read(path, Bundle, "the promotion of a registered version")
    if bundle is None:
        return None
    latest = {one.name: one.sha256 for one in parts if one.sha256}
    champion = {name: one.sha256 for name, one in bundle.submodels.items()}
    names = dict.fromkeys([*(one.name for one in parts), *champion])
    older = tuple(name for name in names if latest.get(name) != champion.get(name))
    history: tuple[Entry, ...] = ()
    broken = ""
    if folders.history is not None:
        shelf.text(folders.history, CHOICES)
        try:
            history = read_history(folders.history)
        except StoreError as error:
            broken = f"The history of what serves cannot be read: {error}."
    return Serving(path=path, bundle=bundle, older=older, history=history, broken=broken)


REMOVED_A_DAY = 50
"""Wrong values of one item on a working day above which its sensor or wiring is in doubt."""
WEEK_S = 7.0 * DAY
SILENT_S = float(DAY)
"""Time by which a log that still writes may end before other records [s]: a day off."""
AT_ONCE_S = 600.0
"""Time before the end of the last known state from which on "unavailable" is of that end [s]."""


@dataclass(frozen=True, kw_only=True)
class TrueCounts:
    """Counts of a simulated log: records that cannot be read, wrong values by kind."""

    rejected: int | None = None
    glitches: Mapping[str, int] | None = None


@dataclass(frozen=True, kw_only=True)
class TrueCycle:
    """Simulated cycle: whether the log shows its start and its end."""

    start_seen: bool = True
    end_seen: bool = True


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The simulated shop floor's truth about a machine."""

    path: Path
    """Path of the file."""
    document: Mapping[str, Any]
    """The whole content; each sub-model takes its own part of it."""
    counts: TrueCounts
    """Counts of the log."""
    cycles: list[TrueCycle] | None
    """All cycles."""
    parameters: Mapping[str, Any]
    """Parameters of the simulated machine, nested."""


@dataclass(frozen=True, kw_only=True)
class MachineFacts:
    """Facts of a machine: its folders, the content of its files, and their sources."""

    folders: MachineFolders
    shelf: SourceRegistry
    records: RecordsRead
    alarms: Alarms
    work: Work
    models: list[ModelledPart]
    programs: list[Program]
    parts: PartPrograms
    golden: GoldenSets | None = None
    serving: Serving | None = None
    truth: Truth | None = None
    day_uses: Mapping[str, str] = field(default_factory=dict)
    absent: Mapping[str, list[str]] = field(default_factory=dict)
    logged: tuple[str, ...] = ()
    nights: tuple[Night, ...] = ()
    """Nights on which what serves was scored."""
    monitored: Monitored | None = None
    """What monitoring found; None where the machine has no state of a twin."""
    weeks: tuple[WeekReport, ...] = ()
    """Kept reports of the condition by week, the newest last."""
    written: Mapping[str, Program] = field(default_factory=dict)
    """Programs as written with their cut, by the label of their optimisation."""

    @property
    def pages(self) -> list[SubModelPage]:
        """Pages of the sub-models, in the order of the fleet."""
        return [one.page for one in self.models]

    @property
    def known(self) -> bool:
        """Whether there is a model of anything."""
        return any(one.model is not None or one.judged is not None for one in self.models)

    def verdict_of(self, name: str) -> PartVerdict | None:
        """Verdict on a sub-model in words; None where there is none."""
        return next((one.page.verdict for one in self.models if one.name == name), None)

    @property
    def program_files(self) -> dict[str, str]:
        """File of the page of each program that could be read, optimised ones first."""
        names = []
        for part in self.parts.programs:
            names += [part.label, *(one.name for one in [self.written.get(part.label)] if one)]
        names += [program.name for program in self.programs if not program.refused]
        return program_pages(self.folders.name, dict.fromkeys(names))

    @property
    def doubtful_items(self) -> list[Changed]:
        """Data items of which cleaning removed many values by its rules, lastly in seven days."""
        days, since = max(1, len(self.work.worked_days)), (self.work.last or 0.0) - WEEK_S
        many = [one for one in self.records.changes or [] if one.count > REMOVED_A_DAY * days]
        return [one for one in many if one.last >= since * NS]

    @property
    def off(self) -> bool:
        """Whether the last that the agent said of the machine is that it is unavailable."""
        end, since = self.work.last, self.records.unavailable_since
        return end is not None and since is not None and since >= end - AT_ONCE_S

    @property
    def silence(self) -> float | None:
        """Time by which the log ends before other live sources [s]; None where it does not.

        A machine whose agent says at the end that it is unavailable is off, not silent; so is one
        that ended before days that are usually not worked.
        """
        end, last = self.work.last, self.records.last_live
        if end is None or last is None or self.off:
            return None
        behind = last.timestamp() - end
        return behind if behind > SILENT_S and self.unusually_off else None

    @property
    def unusually_off(self) -> bool:
        """Whether a whole day that is usually worked, or a week, lies between its last record and
        the newest of other live sources.
        """
        end, last = self.work.last, self.records.last_live
        if end is None or last is None:
            return False
        zone = self.work.time_zone
        days = [day_of(int(at * NS), zone) for at in (end, last.timestamp())]
        return last.timestamp() - end > WEEK_S or bool(self.work.surprising(days_between(days)))

    def titles(self, names: Iterable[str], words: Callable[[str], str] = str) -> str:
        """Titles of sub-models, joined, each as ``words`` gives it."""
        known = {one.name: one.title for one in self.models}
        return ", ".join(words(known.get(name, name)) for name in names)


def machine_facts(folders: MachineFolders) -> MachineFacts:
    """Everything that the files of one machine hold."""
    shelf = SourceRegistry()
    if folders.settings is not None:
        shelf.document(folders.settings, "the settings in conf/")
    truth = _truth(folders, shelf)
    golden = shelf.read(folders.golden, GoldenSets, "raw files, frozen by hash")
    models = modelled_parts(folders, shelf, None if truth is None else truth.document)
    scores = [score for one in models if one.judged is not None for score in one.judged.scores]
    second = any(score.quantity.startswith("second_") for score in scores)
    programs, parts = simulated_programs(folders.programs, shelf), part_programs(folders, shelf)
    serves = serving(folders, shelf, models)
    return MachineFacts(
        folders=folders,
        shelf=shelf,
        records=records_read(folders, shelf),
        alarms=machine_alarms(folders, shelf),
        work=work(folders, shelf, "second_" if second else ""),
        models=models,
        programs=programs,
        parts=parts,
        written=written_programs(parts, programs, shelf),
        golden=golden,
        serving=serves,
        truth=truth,
        day_uses=_day_uses(models, golden),
        absent=absent_items(folders, shelf),
        logged=logged_signals(folders),
        nights=_nights(folders, shelf, serves),
        monitored=monitored(folders, shelf),
        weeks=week_reports(folders, shelf),
    )


def _nights(
    folders: MachineFolders, shelf: SourceRegistry, serves: Serving | None
) -> tuple[Night, ...]:
    if folders.ledger is None or serves is None:
        return ()
    try:
        return of_serving(read_ledger(folders.ledger), serves.bundle)
    except StoreError as error:
        shelf.broken[shown(folders.ledger)] = str(error)
        return ()


def written_programs(
    parts: PartPrograms, simulated: Iterable[Program], shelf: SourceRegistry
) -> dict[str, Program]:
    """Programs as written with their cut, by the label of their optimisation.

    One whose file no other part has, and that is simulated for the report too, has that name; each
    has the interval of its time.
    """
    labels = [part.label for part in parts.programs]
    known = {one.summary.file: one for one in simulated}
    programs, taken = dict[str, Program](), set(labels)
    for part in parts.programs:
        path = part.path.parent / AS_WRITTEN / part.path.name
        found = shelf.read(path, CutProgram, MODELS)
        if found is None:
            continue
        same = known.get(found.time.file)
        name = same.name if same and same.name not in taken else f"{part.label} as written"
        taken.add(name)
        interval = same.summary.total_time_90_s if same else None
        summary = replace(found.time, program=name, total_time_90_s=interval)
        program = replace(
            program_of(summary, path, shelf), cut=found.cut, verdicts=part.part.verdicts
        )
        programs[part.label] = program
    return programs


def _truth(folders: MachineFolders, shelf: SourceRegistry) -> Truth | None:
    if folders.truth is None:
        return None
    document = shelf.document(folders.truth, "the simulated shop floor")
    if document is None:
        return None
    log, cycles, parameters = (document.get(key) for key in ("log", "cycles", "parameters"))
    counts = log.get("counts") if isinstance(log, dict) else None
    try:
        return Truth(
            path=folders.truth,
            document=document,
            counts=picked(counts or {}, TrueCounts, "log.counts"),
            cycles=[picked(one, TrueCycle, "cycles") for one in cycles]
            if isinstance(cycles, list) else None,
            parameters=parameters if isinstance(parameters, dict) else {},
        )  # fmt: skip
    except ValueError as error:
        shelf.broken[shown(folders.truth)] = f"not JSON of a truth: {error}"
        return None


def _day_uses(models: list[ModelledPart], golden: GoldenSets | None) -> dict[str, str]:
    """Models that each day served, in words."""
    learn = {case.group for one in models if one.model is not None for case in one.model.trained_on}
    judge = set() if golden is None or golden.golden is None else set(_days(golden.golden.days))
    for one in models:
        if one.judged is not None:
            judge |= {s.group for s in one.judged.scores if s.role == one.judged.judged_role}
    uses: dict[str, str] = dict.fromkeys(sorted(learn), "to learn")
    return uses | {day: "to learn and to judge" if day in learn else "to judge" for day in judge}


def _days(days: Days | None) -> Iterator[str]:
    if days is not None:
        first, last = np.datetime64(days.first, "D"), np.datetime64(days.last, "D")
        yield from (str(d) for d in np.arange(first, last + np.timedelta64(1, "D")))


WORD = re.compile(r"[a-z]+")


def absent_items(folders: MachineFolders, shelf: SourceRegistry) -> Mapping[str, list[str]]:
    """Data items of the machine's file without a record, each with similar names, by cleaning."""
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
    """Signals in the sentence ``wanted``: it has every word of the name."""
    asked = {_singular(word) for word in WORD.findall(wanted.lower())}
    found = [name for name in signals if {_singular(w) for w in name.lower().split("_")} <= asked]
    return [name.replace("_", " ") for name in found]


def _singular(word: str) -> str:
    return word.removesuffix("s")
