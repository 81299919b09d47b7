"""Uses of the twin: a row for each sub-model by what it is used for, from its verdict alone.

The typical error is the mean over all judged records of the quantity whose error takes the largest
share of its limit; the best baseline on the same records is the one that it stands beside.
"""

from dataclasses import dataclass, replace
from typing import Literal

from pipeline.charts.numbers import TOGETHER, powers, unit_words
from pipeline.report.facts import MachineFacts, ModelledPart
from pipeline.report.folders import evidence_page
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.history import served
from pipeline.schema.verdict import MOST_PERCENT, Score, Verdict

JUDGED_ON = ("golden", "held_out")
"""Roles of records that a verdict can rest on."""
MINUS = "\N{MINUS SIGN}"
FEW = 5
"""Groups of records below which their number is said."""
NARROW_BELOW, WIDE_ABOVE = 0.85, 0.95
"""Shares of samples beyond which a 90 % interval is too narrow, or wider than it need be [1]."""
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
    place: str = ""
    """Records that it is of."""
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
    """Row of a use: whether the twin may be used for it, the figures behind it, what serves."""

    use: str
    status: str
    word: str
    judged_on: str
    figure: Counts
    typical: str
    """Mean error over all judged records, with their number and the bias."""
    href: str
    serves: str = ""


def scorecard(facts: MachineFacts, say: Texts) -> list[Line]:
    """Rows of the sub-models of a machine, in the order of the fleet."""
    return [_line(facts, one, say) for one in facts.models]


def use_of(name: str, title: str, say: Texts) -> str:
    """What a sub-model is used for, as a verb and its object."""
    return (
        say(f"use.{name}") if say.has(f"use.{name}") else say("use.other", title=say.given(title))
    )


def _line(facts: MachineFacts, one: ModelledPart, say: Texts) -> Line:
    role = None if one.judged is None else one.judged.judged_role
    records = say("score.judged_on", records=say(f"score.{role}")) if role in JUDGED_ON else ""
    count = 0 if one.judged is None else _judged_groups(one.judged)
    if records and 0 < count < FEW:
        records = say("score.few", records=records, count=count)
    answer = answer_of(one)
    words, beside = _typical(one, say)
    figure = counting_figure(one, say)
    return Line(
        use=use_of(one.name, one.title, say), status=LOOKS[answer], word=say(f"use.is_{answer}"),
        judged_on=records, figure=replace(figure, baseline=beside or figure.baseline),
        typical=words, serves=_serves(facts, one.name, say),
        href=evidence_page(facts.folders.name, one.name),
    )  # fmt: skip


Answer = Literal["yes", "care", "no", "unknown"]
LOOKS: dict[Answer, str] = {"yes": "passed", "care": "attention", "no": "failed",
                            "unknown": "unknown"}  # fmt: skip
ANSWERS: dict[str, Answer] = {"passed": "yes", "attention": "care", "failed": "no"}


def answer_of(one: ModelledPart) -> Answer:
    """Whether a sub-model may be used: with care where a plain guess errs as little as it does."""
    status = "unknown" if one.page.verdict is None else one.page.verdict.status
    answer = ANSWERS.get(status, "unknown")
    typical = None if one.judged is None else typical_error(one.judged)
    best = None if typical is None else _plain(typical)
    beaten = typical is not None and best is not None and best[0] <= typical.value
    return "care" if answer == "yes" and beaten else answer


def uses_words(facts: MachineFacts, say: Texts) -> str:
    """What the twin may be used for, in a sentence."""
    by: dict[str, list[str]] = {answer: [] for answer in LOOKS}
    for one in facts.models:
        by[answer_of(one)].append(use_of(one.name, one.title, say))
    if not by["yes"] and not by["care"]:
        return say("use.none")
    said = say("use.may", uses=say.joined(by["yes"])) if by["yes"] else say("use.may_none")
    for answer in ("care", "no"):
        if by[answer]:
            said += say(f"use.{answer}", uses=say.joined(by[answer]))
    return f"{said}."


def typical_error(verdict: Verdict) -> WorstError | None:
    """Mean error over all judged records of the quantity that decides; relative without one."""
    worst = worst_error(verdict)
    if worst is None:
        return None
    for score in verdict.scores:
        same = (score.quantity, score.regime) == (worst.score.quantity, worst.score.regime)
        if same and score.role == verdict.judged_role and score.group == "all":
            for name in ("mae", "rmse", worst.name):
                value = getattr(score, name)
                if value is not None:
                    return WorstError(score=score, name=name, value=abs(value), limit=worst.limit)
    return replace(worst, value=abs(worst.value))


def _plain(error: WorstError) -> tuple[float, str] | None:
    """Error of the best baseline on the same records, and its name."""
    found = [(abs(value), name) for name, other in error.score.others.items()
             if (value := getattr(other, error.name)) is not None]  # fmt: skip
    return min(found, default=None)


def _typical(one: ModelledPart, say: Texts) -> tuple[str, str]:
    """Mean error with number of samples and bias; how it compares with the best plain way."""
    error = None if one.judged is None else typical_error(one.judged)
    if error is None:
        return "", ""
    error = replace(error, say=say)
    bias = error.score.bias
    sign = "" if bias is None else "+" if bias > 0 else MINUS if bias < 0 else ""
    size = "" if bias is None else replace(error, name="bias", value=abs(bias)).shown
    words = say("score.typical", value=error.shown, count=error.score.n)
    if size:
        words = say("score.typical_bias", value=error.shown, count=error.score.n,
                    bias=f"{sign}{size}")  # fmt: skip
    best = _plain(error)
    if best is None:
        return words, ""
    value = replace(error, value=best[0]).shown
    method = baseline_words(best[1], say)
    if best[0] <= error.value:
        return words, say("score.no_better", value=value, method=method)
    less = say.number(100 * (1 - error.value / best[0]), 2)
    return words, say("score.better", percent=less, value=value, method=method)


def _serves(facts: MachineFacts, name: str, say: Texts) -> str:
    """Version that serves and since when; that it is another model than the one judged here."""
    serving = facts.serving
    if serving is None:
        return ""
    entries = served(serving.history)
    if name not in serving.bundle.submodels:
        return say("score.serves_none")
    if not entries:
        return say("score.serves_another" if name in serving.older else "score.serves_first")
    key = "score.serves_older" if name in serving.older else "score.serves_version"
    return say(key, version=entries[-1].version, since=say.day(entries[-1].at[:10]))


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
            place=_place(score.group, say),
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
    """An error that is larger than the one shown, on other records; empty without one."""
    if found is None:
        return ""
    regime = found.score.regime if found.score.regime != shown.regime else ""
    return say("score.worse", value=f"{found.shown} {say.given(regime)}".rstrip())


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
    if not shares:
        return ""
    share = say.percent(min(shares), 1.0)
    if min(shares) < NARROW_BELOW:
        return say("score.narrow", share=share)
    return say("score.wide", share=share) if min(shares) > WIDE_ABOVE else share
