"""Page of a sub-model: one frame, made of its stored files and of its own declarations.

Verdict, key figures, what is not determined, parameters, scores by group, typical and worst case,
conditions that were not learnt, known truth and files are made here.  A sub-model declares the
meanings of its parameters, the errors that count, what to do about them, and its own figures.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from pipeline.charts import judged
from pipeline.charts.cases import Drawn, case_figures, sized
from pipeline.charts.numbers import (
    counted,
    day_words,
    joined,
    number,
    percent,
)
from pipeline.charts.parameters import (
    KnownValue,
    Meaning,
    Units,
    in_units,
    parameters_table,
    truth_table,
    truth_words,
    undetermined_words,
)
from pipeline.charts.sections import (
    Action,
    Block,
    ChangeNote,
    Compared,
    Figures,
    Heading,
    PartVerdict,
    Section,
    SubModelPage,
    absent,
    present,
    unremarkable,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Table, sources
from pipeline.charts.words import PageWords
from pipeline.schema.model import Model
from pipeline.schema.verdict import Figures as Errors
from pipeline.schema.verdict import Score, Verdict

if TYPE_CHECKING:
    import pandas as pd

MOST_DRAWN = 3
"""Quantities whose cases are drawn at most."""
LEVEL = "dB"
"""Unit of levels, which have no zero, so that shares of them say nothing."""
FEW = 5
"""Judged groups below which a pass says little [1]."""


class Files(Protocol):
    """Stored files of a sub-model, as its page reads them; None where one is not there."""

    @property
    def machine(self) -> str:
        """Name of the machine."""

    @property
    def model(self) -> Model | None:
        """The model."""

    @property
    def verdict(self) -> Verdict | None:
        """The judgement."""

    @property
    def predictions(self) -> "pd.DataFrame | None":
        """The long table of predictions."""

    @property
    def shelf(self) -> Any:
        """Registry through which files are read."""

    @property
    def folder(self) -> Path:
        """Folder of the files."""


def made_from(files: Files, *names: str) -> list[Source]:
    """Files of the sub-model that a part of the page stands on."""
    if files.shelf is None:
        return []
    return sources(files.shelf, *(files.folder / name for name in names))


@dataclass(frozen=True, kw_only=True)
class Counting:
    """Error of the assessment that counts for readers."""

    key: str
    """Key of the figure that the next report is compared with."""
    name: str
    """Error in words, such as ``Error of the axes’ force``."""
    quantity: str
    """Quantity of the verdict, or what stands before the letter of an axis."""
    error: str = "rmse"
    """Error, as a score has it."""
    regime: str = ""
    """Regime of the scores."""
    whole: bool = False
    """Whether all groups together count, not the worst one; the worst one decides where it is
    beyond its own limit."""
    instead: str = ""
    """Regime that tells where no record was left to judge by."""

    def scores(self, verdict: Verdict | None) -> list[Score]:
        """Scores of the records that decide, those over all groups among them."""
        if verdict is None:
            return []
        of = [s for s in verdict.scores if self.holds(s.quantity)]
        own = [s for s in of if s.role == verdict.judged_role and s.regime == self.regime]
        return own or [s for s in of if self.instead and s.regime == self.instead]

    def holds(self, quantity: str) -> bool:
        """Whether it is of that quantity, or of that and the letter of an axis."""
        rest = quantity.removeprefix(self.quantity)
        return quantity == self.quantity or (rest != quantity and rest[:1] == " " and len(rest) < 4)

    def tells(self, score: Score) -> bool:
        """Whether a score is of it, or of the regime that tells in its place."""
        return self.holds(score.quantity) and score.regime in (
            self.regime, self.instead or self.regime
        )  # fmt: skip

    def together(self, verdict: Verdict | None) -> bool:
        """Whether all groups together decide, not a worse one that is beyond its own limit."""
        scores = self.scores(verdict)
        total = max((self.size(s) or 0.0 for s in scores if s.group == "all"), default=0.0)
        worse = any((self.size(s) or 0.0) > max(s.limits.get(self.error, np.inf), total)
                    for s in scores if s.group != "all")  # fmt: skip
        return self.whole and not worse

    def worst(self, verdict: Verdict | None, *, alike: bool = False) -> Score | None:
        """The score that decides: over all groups, or the worst of a group.

        ``alike`` is the declared one of the two, which reports are compared by.
        """
        whole = self.whole if alike else self.together(verdict)
        known = [s for s in self.scores(verdict)
                 if (s.group == "all") == whole and self.size(s) is not None]  # fmt: skip
        return max(known, key=lambda s: self.size(s) or 0.0, default=None)

    def size(self, errors: Errors) -> float | None:
        """Size of the error."""
        value: float | None = getattr(errors, self.error)
        return None if value is None else abs(value)

    def shown(self, errors: Errors, unit: str) -> str:
        """The error with its unit."""
        return sized(self.size(errors), self.error, unit)

    def limit(self, verdict: Verdict | None) -> float | None:
        """Greatest error that passes."""
        own = self.scores(verdict)
        other = [] if verdict is None else [s for s in verdict.scores if self.holds(s.quantity)]
        return next((s.limits[self.error] for s in (*own, *other) if self.error in s.limits), None)


@dataclass(frozen=True, kw_only=True)
class PageContent:
    """Page content that only one sub-model has; whatever is empty is left to its files."""

    about: str = ""
    """Subject and use of the model, in two or three sentences."""
    rules: str = ""
    """Rules of the assessment, and the baselines."""
    case: str = "record"
    """Kind of group of records: a day, a run, a tool."""
    counts: Sequence[Counting] = ()
    """Errors that count, the first one most; those with a limit where none is named."""
    judged_count: tuple[str, str] | None = None
    """Key and name of the number of judged groups, for the comparison with the next report."""
    guess: str = ""
    """Plain baseline: it is named where it comes closer."""
    titles: Mapping[str, str] = field(default_factory=dict)
    """Baselines and methods in words."""
    todo: Mapping[str, str] = field(default_factory=dict)
    """Action by the status of the verdict."""
    cause: str = ""
    """Cause of a failure."""
    facts: Sequence[str] = ()
    """Sentences on the model: its identification, its content."""
    head: Sequence[tuple[str, str, str]] = ()
    """Further key figures: name, value, aside."""
    doubts: Sequence[str] = ()
    """Weaknesses of a model that passed."""
    notes: Sequence[str] = ()
    """Further observations."""
    actions: Sequence[Action] = ()
    lead: Section | None = None
    """Section for the machine's own page."""
    """Actions from these records."""
    meaning: Meaning = lambda group, name: "–"
    """Meanings of parameters."""
    units: Units = field(default_factory=dict)
    """Units of parameters as a shop speaks them."""
    groups: Mapping[str, str] = field(default_factory=dict)
    """Groups of parameters in words; a group that is not named is one of its own name."""
    of_group: Mapping[str, Sequence[Block]] = field(default_factory=dict)
    """Heading and figures that stand before the parameters of a group."""
    figures: Sequence[Block | None] = ()
    """Figures and tables that only it can draw of its model."""
    tried: Sequence[judged.Tried] = ()
    """Methods that were compared."""
    tried_where: str = "on training records left out in turn"
    """Records of the errors that decided the choice."""
    drawn: Sequence[Drawn] = ()
    """Drawings of typical and worst cases; the quantities that count where none is named."""
    shown_facts: Sequence[str] = ()
    """Facts of cases that stand in their table, by what their names begin with."""
    of_judgement: Sequence[Block | None] = ()
    """Figures and tables that only it can draw of its judgement."""
    first: Sequence[Section | None] = ()
    """Sections of its own, which stand first."""
    truth: Sequence[KnownValue] = ()
    """Parameters beside the truth of a simulated machine."""
    truth_note: str = ""
    """Remark on that truth."""
    truths: Sequence[Table] = ()
    """Further tables of the truth."""
    changed: ChangeNote = unremarkable
    """Meaning of a change of a parameter since the last report."""


def declared(words: PageWords, **own: Any) -> PageContent:
    """Page content of a sub-model: the words of its file, and what is of these records."""
    counts = [Counting(**row) for row in words.content.get("counts", ())]
    return PageContent(**{"meaning": words.meaning, **words.content, "counts": counts, **own})


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A sub-model as its page names it."""

    name: str
    """Name of its folder."""
    title: str
    """Subject of the model in the words of the shop floor."""
    needs: str
    """Record that it needs."""


def submodel_page(files: Files, subject: Subject, content: PageContent) -> SubModelPage:
    """Verdict, key figures and sections of a sub-model."""
    frame = _Frame(files=files, subject=subject, content=content)
    known = list(content.truth)
    truth = truth_table(subject.title, known, made_from(files, "model.json"), content.truth_note)
    lost = "" if files.model is None else undetermined_words(
        files.model.parameters, content.meaning, subject.title
    )  # fmt: skip
    return SubModelPage(
        verdict=frame.verdict(),
        key_figures=[*frame.key_figures(), *content.head],
        doubts=[*frame.doubts(), *content.doubts],
        notes=[one for one in (*content.notes, lost, truth_words(known, subject.title)) if one],
        actions=list(content.actions),
        lead=content.lead,
        sections=[
            one for one in (*content.first, frame.model_section(), frame.judged_section(),
                            frame.next_section(), frame.files_section()) if one is not None
        ],
        truth=[*([truth] if truth is not None else []), *content.truths],
        compared=frame.compared(),
        changed=content.changed,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class _Frame:
    """Input of a page."""

    files: Files
    subject: Subject
    content: PageContent

    @property
    def name(self) -> str:
        return f"{self.subject.title[:1].upper()}{self.subject.title[1:]}"

    @property
    def counts(self) -> Sequence[Counting]:
        """Errors that count: those declared, else those with a limit."""
        verdict = self.files.verdict
        if self.content.counts or verdict is None:
            return self.content.counts
        found = {
            (s.quantity, s.regime, error): Counting(
                key="", name=f"{judged.HEADS[error]} of {judged.quantity_words(s)}",
                quantity=s.quantity, error=error, regime=s.regime,
            )
            for s in verdict.scores for error in s.limits
        }  # fmt: skip
        return list(found.values())

    def made(self, *names: str) -> list[Source]:
        return made_from(self.files, *names)

    @property
    def groups(self) -> list[str]:
        """Groups of records that decide."""
        scores = [s for one in self.counts for s in one.scores(self.files.verdict)]
        decided = [s.group for s in scores if s.group != "all"]
        return list(dict.fromkeys(decided))

    # ---- the head

    def verdict(self) -> PartVerdict | None:
        """Status, the errors that count against their limits, what to do."""
        v = self.files.verdict
        if v is None and self.files.model is None:
            return None
        if v is None or v.status == "not judged":
            return self._not_judged(v)
        if v.status == "not decided":
            return self._undecided(v)
        status: Literal["passed", "failed"] = "failed" if v.status == "failed" else "passed"
        why = self._errors()
        if status == "failed":
            why = self._failure(v)
        some = ""
        many = len(self.groups)
        if status == "passed" and 0 < many < FEW:
            verb = "says" if many == 1 else "say"
            some = f" {counted(many, self.content.case)} {verb} little: record more."
        default = {
            "passed": "The model may serve.",
            "failed": f"Do not use this model; to mend it, record {self.subject.needs}",
        }[status]
        return PartVerdict(
            status=status,
            sentence=f"The model of the {self.subject.title} {status} on {self._records(v)}"
            f"{f': {why}' if why else ''}.{self.content.cause if status == 'failed' else ''}",
            todo=f"{self.content.todo.get(status, default).rstrip('.')}.{some}",
        )

    def _failure(self, v: Verdict) -> str:
        """The errors that count and pass their limits, and the number of other reasons."""
        said = self._errors(beyond=True)
        if not said:
            return _reasons(v)
        own = {reason for one in self.counts for s in one.scores(v) for reason in s.reasons}
        others = sum(reason not in own for reason in v.missed)
        return said + (f"; and {counted(others, 'more reason')}" if others else "")

    def _undecided(self, v: Verdict) -> PartVerdict:
        """Figures too near to their limits, and how many records there are too few of."""
        reasons = [one.rstrip(".").removesuffix(", not decided") for one in v.reasons]
        why, *others = reasons or ["the judge gave no reason"]
        more = f"; and {counted(len(others), 'more figure')}" if others else ""
        verb = "leaves" if len(v.cases) == 1 else "leave"
        there = f"{counted(len(v.cases), self.content.case)} {verb} it open"
        return PartVerdict(
            status="attention",
            sentence=f"The model of the {self.subject.title} is not decided: {why}{more}.",
            todo=f"Record more of the same kind: {there}.",
        )

    def _not_judged(self, v: Verdict | None) -> PartVerdict:
        why = "there is no verdict.json" if v is None else "; ".join(v.reasons)
        beyond = bool(self._errors(beyond=True))
        errors = self._errors()
        said = f" Predicted from the others: {errors}." if errors else ""
        return PartVerdict(
            status="unknown",
            sentence=f"The model of the {self.subject.title} has not been judged: "
            f"{why.rstrip('.') or 'no record to judge it by'}.{said}",
            todo=self.content.todo.get("unknown", f"Record {self.subject.needs.rstrip('.')}."),
            reserved=beyond,
        )

    def _records(self, v: Verdict) -> str:
        many = counted(len(self.groups), self.content.case)
        golden = v.golden
        if v.judged_role != "golden":
            return f"{many} held out of its fit"
        by_day = all(day_words(group) != group for group in self.groups)
        aside = [f"beside {number(v.sealed)} sealed"] if v.sealed else []
        if golden is None or not golden.first or not by_day:
            return f"{many} of its golden set{''.join(f' ({one})' for one in aside)}"
        span = f"{day_words(golden.first)} to {day_words(golden.last, year=True)}"
        return f"{many} of its golden set ({', '.join([span, *aside])})"

    def _errors(self, *, beyond: bool = False) -> str:
        """The errors that count with their limits; ``beyond`` only those that pass them."""
        said = []
        for one in self.counts:
            worst, limit = one.worst(self.files.verdict), one.limit(self.files.verdict)
            if worst is None or (beyond and not (limit and (one.size(worst) or 0.0) > limit)):
                continue
            whole = one.together(self.files.verdict)
            where = "" if whole else "up to "
            place = f" in {judged.case_words(worst.group)}" if beyond and not whole else ""
            held = f" (limit {sized(limit, one.error, worst.unit)})" if limit else ""
            name = one.name if one.name[1:2].isupper() else f"{one.name[:1].lower()}{one.name[1:]}"
            said.append(f"{name} {where}{one.shown(worst, worst.unit)}{place}{held}")
        return joined(list(dict.fromkeys(said))) if said else ""

    def key_figures(self) -> list[tuple[str, str, str]]:
        """The errors that count, and the 90 % interval."""
        found = []
        for one in self.counts:
            worst, limit = one.worst(self.files.verdict), one.limit(self.files.verdict)
            if worst is None:
                continue
            axis_of = worst.quantity.removeprefix(one.quantity).strip()
            aside = ["over all judged records" if one.together(self.files.verdict) else
                     f"worst of {counted(len(self.groups), self.content.case)}"
                     + (f", {axis_of}" if axis_of else "")]  # fmt: skip
            if limit:
                aside.append(f"limit {sized(limit, one.error, worst.unit)}")
            if (best := self._best(one, worst)) is not None:
                aside.append(f"{best[1]} {sized(best[0], one.error, worst.unit)}")
            found.append((one.name, one.shown(worst, worst.unit), "; ".join(aside)))
        return [*found, *self._interval()]

    def _best(self, one: Counting, score: Score) -> tuple[float, str] | None:
        """Plain baseline, else the best one, by the same error."""
        others = {name: size for name, other in score.others.items()
                  if (size := one.size(other)) is not None}  # fmt: skip
        if self.content.guess in others:
            name = self.content.guess
        elif others and not self.content.guess:
            name = min(others, key=lambda other: others[other])
        else:
            return None
        return others[name], self.title(name)

    def title(self, name: str) -> str:
        return self.content.titles.get(name, name.replace("_", " "))

    def _interval(self) -> list[tuple[str, str, str]]:
        """Half width of the 90 % interval, and the share of the judged samples that it held."""
        scores = [s for one in self.counts for s in one.scores(self.files.verdict)]
        known = [(s.coverage_90, s) for s in {id(s): s for s in scores}.values()
                 if s.group == "all" and s.coverage_90 is not None]  # fmt: skip
        if not known:
            return []
        total = min(known, key=lambda one: one[0])[1]
        if total.unknown_interval:
            return [("90 % interval", "not known", total.unknown_interval)]
        of = f" of {judged.quantity_words(total)}" if len(known) > 1 else ""
        aside = f"holds {percent(total.coverage_90, 1.0)} of the judged samples{of}"
        if total.coverage_limits is not None:
            aside += f", limits {' to '.join(f'{100 * x:g}' for x in total.coverage_limits)} %"
        half = f"± {sized(total.half_width, '', total.unit)}" if total.half_width else "–"
        return [("90 % interval", half, aside)]

    def doubts(self) -> list[str]:
        """Baselines that come closer than the model."""
        found = []
        for one in self.counts:
            pairs = [
                (one.size(s), one.size(s.others[self.content.guess]))
                for s in one.scores(self.files.verdict)
                if s.group != "all" and self.content.guess in s.others
            ]
            known = [(a, b) for a, b in pairs if a is not None and b is not None]
            worse = sum(b < a for a, b in known)
            if worse:
                found.append(
                    f"{one.name}: on {worse} of {counted(len(known), self.content.case)} the guess "
                    f"({self.title(self.content.guess)}) comes closer than the model."
                )
        return found

    def compared(self) -> dict[str, Compared]:
        """Key figures that the next report is compared with."""
        if self.files.model is None and self.files.verdict is None:
            return {}
        found = {}
        for one in self.content.counts:
            worst = one.worst(self.files.verdict, alike=True)
            unit = "%" if one.error.endswith("percent") else worst.unit if worst else ""
            value = None if worst is None else one.size(worst)
            found[one.key] = Compared(name=one.name, unit="" if unit == "1" else unit, value=value)
        if self.content.judged_count is not None:
            key, name = self.content.judged_count
            v = self.files.verdict
            scores = [] if v is None else self.content.counts[0].scores(v)
            many = [s for s in scores if s.group != "all" and v and s.role == v.judged_role]
            value = None if v is None else len(many)
            found[key] = Compared(name=name, unit="", value=value)
        return found

    # ---- sections

    def model_section(self) -> Section:
        """Section on the model: own figures, parameters, methods."""
        key, title, model = self.subject.name, f"{self.name}: the model", self.files.model
        if model is None:
            words = absent(self.files.folder / "model.json", f"It needs {self.subject.needs}.")
            return Section(key=key, title=title, text=[words])
        many = counted(len(model.trained_on), self.content.case)
        out = f", {number(len(model.left_out))} left out" if model.left_out else ""
        made = self.made("model.json")
        blocks: list[Block] = []
        for group, parameters in model.parameters.items():
            words = self.content.groups.get(group, group)
            blocks += self.content.of_group.get(group, ())
            blocks += present(parameters_table(
                f"Parameters of {words}" if words else "Parameters",
                {name: in_units(p, self.content.units) for name, p in parameters.items()}, made,
                partial(self.content.meaning, group),
            ))  # fmt: skip
        blocks += present(*self.content.figures)
        if self.content.tried:
            text = judged.chosen_words(self.content.tried, self.content.tried_where)
            blocks.append(Heading(heading="Methods compared", text=text))
            blocks += present(judged.tried_table(
                "Methods compared", self.content.tried, self.made("model.json", "verdict.json"),
                self.content.tried_where,
            ))  # fmt: skip
        text_ = [self.content.about, f"Identified from {many}{out}.", *self.content.facts]
        return Section(key=key, title=title, text=[w for w in text_ if w], blocks=blocks)

    def judged_section(self) -> Section | None:
        """Predicted against measured: cases, scores, what was not learnt."""
        v, key = self.files.verdict, f"{self.subject.name}-judged"
        title = f"{self.name}: predicted against measured"
        if v is None:
            if self.files.model is None:
                return None
            words = absent(self.files.folder / "verdict.json", "Without it nothing is judged.")
            return Section(key=key, title=title, text=[words])
        text = [self.content.rules]
        if v.reasons:
            text.append("Reasons as the judge gave them: " + "; ".join(v.reasons) + ".")
        if self.files.predictions is None:
            path = self.files.folder / "predictions.parquet"
            text.append(absent(path, "Without it no record can be drawn."))
        made = self.made("verdict.json")
        first = [s for s in v.scores if any(one.tells(s) for one in self.counts)]
        levels = [s for s in v.scores if s.unit == LEVEL and s not in first]
        rest = [s for s in v.scores if s not in first and s not in levels]

        def scores(caption: str, some: Sequence[Score], *, folded: bool = False) -> Table | None:
            return judged.scores_table(
                caption, some, made, case=self.content.case, titles=self.content.titles,
                guess=self.content.guess, folded=folded,
            )  # fmt: skip

        kinds = list(dict.fromkeys((s.quantity, s.regime) for s in first))
        of_each = [[s for s in first if (s.quantity, s.regime) == kind] for kind in kinds]
        blocks = present(
            *self._error_figures(v, made), *self._cases(v), *self.content.of_judgement,
            *(scores(f"Errors of {judged.quantity_words(some[0])}", some) for some in of_each),
            scores("Further errors", rest, folded=bool(first) and not any(s.limits for s in rest)),
            scores("Errors of levels", levels, folded=bool(first)),
            judged.singles_table(self.files.predictions, self.made("predictions.parquet")),
            judged.cases_table(v, made, self.content.shown_facts),
            judged.outside_table(v, made), judged.left_out_table(v, made),
            judged.canaries_table(v, made),
        )  # fmt: skip
        return Section(key=key, title=title, text=[w for w in text if w], blocks=blocks)

    def next_section(self) -> Section | None:
        """What would help most: the recordings that narrow the deciding interval most."""
        some = () if self.files.verdict is None else self.files.verdict.next_recordings
        if not some:
            return None
        table = judged.next_table(some, self.made("model.json", "verdict.json"))
        return Section(
            key=f"{self.subject.name}-next", title=f"{self.name}: what to record next",
            text=[
                "The recordings that narrow most the interval that decides, the best first, with "
                "its half widths now and as expected with the recording among the training "
                "records. A time stands where a recording was designed; one without is as long as "
                "those so far."
            ],
            blocks=present(table),
        )  # fmt: skip

    def files_section(self) -> Section | None:
        """Files by hash that it was fitted on."""
        if self.files.model is None:
            return None
        table = judged.training_table(self.files.model, self.made("model.json"))
        title = f"{self.name}: what it was fitted on"
        return Section(key=f"{self.subject.name}-files", title=title, blocks=present(table))

    def _error_figures(self, v: Verdict, made: list[Source]) -> list[Figures | None]:
        """Errors by group of the first error that counts, of each axis."""
        if not self.counts:
            return []
        one = self.counts[0]
        regimes = {s.regime for s in one.scores(v)} or {one.regime}
        some = [s for s in v.scores if one.holds(s.quantity) and s.regime in regimes]
        return [
            judged.errors_figure([s for s in some if s.quantity == quantity], one.error,
                                 self.content.titles, made)
            for quantity in list(dict.fromkeys(s.quantity for s in some))[:MOST_DRAWN]
        ]  # fmt: skip

    # ---- typical and worst case

    def _cases(self, v: Verdict) -> list[Figures | None]:
        drawn = self.content.drawn or [
            Drawn(quantity=quantity, regime=one.regime, error=one.error)
            for one in self.counts[:1]
            for quantity in dict.fromkeys(s.quantity for s in one.scores(v))
        ]
        rows, made = self.files.predictions, self.made("predictions.parquet")
        return [
            case_figures(rows, v, one, self.content.case, made, alone=len(drawn) == 1)
            for one in drawn[:MOST_DRAWN]
        ]


def _reasons(v: Verdict) -> str:
    """The gravest reasons, as the judge gave them."""
    missed = v.missed or v.reasons or ("the judge gave no reason",)
    more = f"; and {counted(len(missed) - 2, 'more reason')}" if len(missed) > 2 else ""
    return "; ".join(one.rstrip(".") for one in missed[:2]) + more
