"""Trust in the twin: a row for each sub-model, from its verdict alone.

The figure of a row is the error that takes the largest share of its limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.charts.numbers import TOGETHER, powers, unit_words
from pipeline.report.facts import ModelledPart
from pipeline.report.folders import evidence_page
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.verdict import MOST_PERCENT, Score, Verdict

JUDGED_ON = ("golden", "held_out")
"""Roles of records that a verdict can rest on."""
MINUS = "\N{MINUS SIGN}"
FEW = 5
"""Groups of records below which their number is said."""
ONE_SIDED = 0.5
"""Share of the RMSE from which on a bias is said [1]."""


@dataclass(frozen=True, kw_only=True)
class WorstError:
    """An error that has a limit."""

    score: Score
    """Score with the error."""
    name: str
    """Name of the error, as the score has it."""
    value: float
    limit: float
    """Its size and limit, in its unit."""
    say: Texts = ENGLISH
    """Language of the words."""

    @property
    def words(self) -> str:
        """Name of the error."""
        key = f"error.{self.name}"
        if self.say.has(key):
            return self.say(key)
        plain = self.name.removesuffix("_percent").replace("_", " ")
        return self.say("error.other", name=plain)

    @property
    def shown(self) -> str:
        """Its size with its unit."""
        return self._sized(self.value)

    @property
    def limit_shown(self) -> str:
        """Its limit with its unit."""
        return f"{self.say.local(f'{self.limit:g}')}{TOGETHER}{self._unit}".rstrip()

    @property
    def baseline(self) -> tuple[str, str] | None:
        """The best baseline by the same error, and that error with its unit."""
        errors: list[tuple[float, str]] = [
            (abs(value), other) for other, figures in self.score.others.items()
            if (value := getattr(figures, self.name)) is not None
        ]  # fmt: skip
        if not errors:
            return None
        value, other = min(errors)
        return baseline_words(other, self.say), self._sized(value)

    def _sized(self, value: float) -> str:
        """A size with its unit; of a share of next to nothing that it is one."""
        if self.name.endswith("percent") and value > MOST_PERCENT:
            return self.say("score.of_nothing", percent=f"{MOST_PERCENT:g}")
        return f"{self.say.number(value)}{TOGETHER}{self._unit}".rstrip()

    @property
    def _unit(self) -> str:
        unit = "" if self.score.unit == "1" else self.score.unit
        return "%" if self.name.endswith("percent") else powers(unit_words(unit))


def worst_error(verdict: Verdict, say: Texts = ENGLISH) -> WorstError | None:
    """The judged error with the largest share of its limit; None where none has a limit."""
    found = [
        WorstError(score=score, name=name, value=abs(value), limit=limit, say=say)
        for score in verdict.scores if score.role == verdict.judged_role
        for name, limit in score.limits.items()
        if limit > 0 and (value := getattr(score, name)) is not None
    ]  # fmt: skip
    return max(found, key=lambda one: one.value / one.limit, default=None)


def worse_elsewhere(verdict: Verdict, shown: WorstError) -> WorstError | None:
    """The largest error of the same kind that is larger: of other records, or without a limit."""
    found = [
        replace(shown, score=score, value=abs(value))
        for score in verdict.scores if score.quantity == shown.score.quantity
        and (value := getattr(score, shown.name)) is not None and abs(value) > shown.value
    ]  # fmt: skip
    return max(found, key=lambda one: one.value, default=None)


def baseline_words(name: str, say: Texts = ENGLISH) -> str:
    """A baseline in words; its own name, without underscores, where the texts do not list it."""
    key = f"baseline.{name}"
    return say(key) if say.has(key) else name.replace("_", " ")


@dataclass(frozen=True, kw_only=True)
class Counts:
    """The one figure of a sub-model that counts, in words; empty without one."""

    what: str
    value: str
    """Value of the figure."""
    limit: str = ""
    baseline: str = ""
    """Baseline of the comparison."""
    interval: str = ""
    """Share of samples that the 90 % prediction interval holds."""
    passed_limit: bool = False
    """Whether the value is beyond its limit."""
    worse: str = ""
    """Its bias, where that is much of it, and the largest error of the same kind on any other
    records, where that is larger."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """Row of the scorecard."""

    title: str
    status: str
    word: str
    judged_on: str
    figure: Counts
    href: str


def scorecard(machine: str, models: Sequence[ModelledPart], say: Texts) -> list[Line]:
    """Rows of the sub-models of a machine, in the order of the fleet."""
    return [_line(machine, one, say) for one in models]


def _line(machine: str, one: ModelledPart, say: Texts) -> Line:
    status = one.page.verdict.status if one.page.verdict is not None else "unknown"
    role = None if one.judged is None else one.judged.judged_role
    records = say("score.judged_on", records=say(f"score.{role}")) if role in JUDGED_ON else ""
    count = 0 if one.judged is None else _judged_groups(one.judged)
    if records and 0 < count < FEW:
        records = say("score.few", records=records, count=count)
    return Line(
        title=say.title(one.title), status=status, word=say(f"verdict.{status}"),
        judged_on=records, figure=counting_figure(one, say), href=evidence_page(machine, one.name),
    )  # fmt: skip


def _judged_groups(verdict: Verdict) -> int:
    """Number of groups of records that decide; those that were read and not judged do not."""
    scores = [s for s in verdict.scores if s.role == verdict.judged_role and s.group != "all"]
    decided = {s.group for s in scores if s.status != "not judged"}
    return len(decided or {s.group for s in scores})


def counting_figure(one: ModelledPart, say: Texts) -> Counts:
    """The error that takes the largest share of a limit; without limits the first key figure."""
    verdict = one.judged
    if verdict is not None and (worst := worst_error(verdict, say)) is not None:
        score, beside = worst.score, ""
        if worst.baseline is not None:
            method, value = worst.baseline
            beside = say("score.baseline", value=value, method=method)
        return Counts(
            what=say("score.figure_of", quantity=say.given(score.quantity.replace("_", " ")),
                     error=worst.words, place=_place(score.group, say)),
            value=worst.shown, limit=worst.limit_shown, baseline=beside,
            interval=_interval(verdict, say, score), passed_limit=worst.value > worst.limit,
            worse=_also(_bias(worst, say), _worse(worse_elsewhere(verdict, worst), score, say)),
        )  # fmt: skip
    interval = "" if verdict is None else _interval(verdict, say)
    if not one.page.key_figures or verdict is None:
        return Counts(what="", value=say("format.not_known"), interval=interval)
    what, shown, aside = one.page.key_figures[0]
    beside = aside.partition("; ")[2]  # whose error it is stands before it
    return Counts(what=say.given(what), value=shown, baseline=say.given(beside), interval=interval)


def _also(*words: str) -> str:
    return "; ".join(one for one in words if one)


def _bias(worst: WorstError, say: Texts) -> str:
    """Bias of the predictions, where it is a large part of the error; else empty."""
    bias, rmse = worst.score.bias, worst.score.rmse
    if bias is None or not rmse or abs(bias) < ONE_SIDED * rmse or worst.name == "bias":
        return ""
    as_share = worst.name == "mean_percent" and worst.score.unit in ("", "1")
    size = worst.shown if as_share else replace(worst, name="bias", value=abs(bias)).shown
    return say("score.bias", value=f"{'+' if bias > 0 else MINUS}{size}")


def _worse(found: WorstError | None, shown: Score, say: Texts) -> str:
    """An error that is larger than the one shown, with its records; empty without one."""
    if found is None:
        return ""
    one = found.score
    where = [_place(one.group, say), say(f"score.{one.role}")]
    if one.regime and one.regime != shown.regime:
        where.append(say.given(one.regime))
    return say("score.worse", value=found.shown, where=", ".join(where))


def _place(group: str, say: Texts) -> str:
    """A group of records: all, a day, or a recording by the name of its file."""
    if group == "all":
        return say("score.over_all")
    day = say.day(group)
    if day != group:
        return say("score.on_day", day=day)
    record = group.rpartition("/")[2].rpartition(".")[0] or group
    return say("score.in_record", record=record)


def _interval(verdict: Verdict, say: Texts, shown: Score | None = None) -> str:
    """Share of samples inside the 90 % interval over all judged groups of what a score is of.

    The least of all quantities without one; that it is not known where one is not stated.
    """
    found = [
        score
        for score in verdict.scores
        if score.role == verdict.judged_role and score.group == "all"
        and (score.coverage_90 is not None or score.unknown_interval)
        and (shown is None or (score.quantity, score.regime) == (shown.quantity, shown.regime))
    ]  # fmt: skip
    shares = [
        score.coverage_90 for score in found
        if score.coverage_90 is not None and not score.unknown_interval
    ]  # fmt: skip
    if found and not shares:
        return say("format.not_known")
    return say.percent(min(shares), 1.0) if shares else ""
