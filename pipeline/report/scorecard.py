"""What the twin may be trusted for: one row for each sub-model, from its verdict alone."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.charts.numbers import day_words, percent
from pipeline.report.page_names import evidence_page
from pipeline.report.submodel_pages import ModelledPart
from pipeline.report.worst_error import worst_error
from pipeline.schema.verdict import Score, Verdict

VERDICTS = {
    "passed": ("passed", "passed"), "failed": ("failed", "failed"),
    "attention": ("attention", "not decided"), "unknown": ("unknown", "not judged"),
}  # fmt: skip
JUDGED_ON = {"golden": "golden records", "held_out": "records held out of its fit"}


@dataclass(frozen=True, kw_only=True)
class Counts:
    """The one figure of a sub-model that counts, in words; empty where it is not known.

    Parameters
    ----------
    what, value : str
        Of the figure.
    limit, baseline : str
        What it is held against.
    interval : str
        Share of samples that the 90 % prediction interval holds.
    passed_limit : bool
        Whether the value is beyond its limit.
    """

    what: str
    value: str
    limit: str = ""
    baseline: str = ""
    interval: str = ""
    passed_limit: bool = False


@dataclass(frozen=True, kw_only=True)
class Line:
    """One row of the scorecard."""

    title: str
    status: str
    word: str
    judged_on: str
    figure: Counts
    href: str


def scorecard(machine: str, models: Sequence[ModelledPart]) -> list[Line]:
    """Rows of the sub-models of a machine, in the order of the fleet."""
    return [_line(machine, one) for one in models]


def _line(machine: str, one: ModelledPart) -> Line:
    verdict = one.page.verdict
    status, word = VERDICTS[verdict.status if verdict is not None else "unknown"]
    return Line(
        title=f"{one.title[:1].upper()}{one.title[1:]}", status=status, word=word,
        judged_on="" if one.judged is None else JUDGED_ON.get(one.judged.judged_role or "", ""),
        figure=counting_figure(one), href=evidence_page(machine, one.name),
    )  # fmt: skip


def counting_figure(one: ModelledPart) -> Counts:
    """The error that takes the largest share of a limit; without limits the first key figure."""
    verdict = one.judged
    if verdict is not None and (worst := worst_error(verdict)) is not None:
        score = worst.score
        where = "over all" if score.group == "all" else _place(score.group)
        return Counts(
            what=f"{score.quantity.replace('_', ' ')}, {worst.words}, {where}",
            value=worst.shown, limit=worst.limit_shown,
            baseline=f"{worst.baseline[1]} by {worst.baseline[0]}" if worst.baseline else "",
            interval=_interval(verdict, score), passed_limit=worst.value > worst.limit,
        )  # fmt: skip
    interval = "" if verdict is None else _interval(verdict)
    if not one.page.key_figures or verdict is None:
        return Counts(what="", value="not known", interval=interval)
    what, shown, aside = one.page.key_figures[0]
    return Counts(what=what, value=shown, baseline=aside, interval=interval)


def _place(group: str) -> str:
    """A group of records: a day, or a recording by the name of its file."""
    day = day_words(group)
    return (
        f"on {day}"
        if day != group
        else f"in {group.rpartition('/')[2].rpartition('.')[0] or group}"
    )


def _interval(verdict: Verdict, shown: Score | None = None) -> str:
    """Share of samples inside the 90 % interval over all judged groups of what a score is of.

    The least of all quantities without one.
    """
    shares = [
        score.coverage_90
        for score in verdict.scores
        if score.role == verdict.judged_role and score.group == "all"
        and score.coverage_90 is not None
        and (shown is None or (score.quantity, score.regime) == (shown.quantity, shown.regime))
    ]  # fmt: skip
    return percent(min(shares), 1.0) if shares else ""
