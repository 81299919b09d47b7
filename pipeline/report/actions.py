"""Actions that a machine's records and models ask for, as rows of one table on the lead's page."""

from collections.abc import Iterator
from typing import get_args

from pipeline.charts.numbers import counted, day_list, duration, joined, moment, number
from pipeline.charts.sections import Action, Role
from pipeline.charts.sources import shown
from pipeline.report.facts import MachineFacts
from pipeline.report.logged import already
from pipeline.report.page_names import PROGRAMS, RECORDS, evidence_page, link
from pipeline.report.part_programs import PartProgram, gain_words, loadable, refused
from pipeline.report.records import rule_words
from pipeline.report.scorecard import counting_figure
from pipeline.report.states import NOW, ActionRow
from pipeline.report.submodel_pages import ModelledPart

USE = "before it is used"
STOP, REPORT, OPEN = "next stop", "next report", "no deadline"
ORDER: tuple[str, ...] = get_args(Role)
"""Readers of the table, those at the machine first."""


def machine_actions(
    facts: MachineFacts, grave: list[tuple[str, str]], trusted: bool
) -> list[ActionRow]:
    """Everything that is to be done about a machine, what is urgent first.

    Parameters
    ----------
    facts : MachineFacts
        Of the machine.
    grave : list of (str, str)
        Faults that make its judgement doubtful, each with what mends it.
    trusted : bool
        Whether the whole twin passed; no optimised program is proposed otherwise.
    """
    rows = [
        *_alarms(facts), *_sensors(facts), *_of_submodels(facts), *_records(facts, grave),
        *_models(facts), *_programs(facts, trusted),
    ]  # fmt: skip
    rows.sort(key=lambda row: (row.action.until != NOW, ORDER.index(row.action.who)))
    return [*_absent(facts), *rows]


def _absent(facts: MachineFacts) -> Iterator[ActionRow]:
    """Data items that the machine's file names and no record has."""
    for item, like in facts.absent.items():
        hint = f"called like it: {joined(like)}" if like else "nothing is called like it"
        yield ActionRow(
            action=Action(
                what="Correct the data item in the machine’s file", where=item,
                why=f"The mapped item does not exist in any record; {hint}.",
                until=NOW, who="process engineer",
            ),
            href=link(facts.folders.name, RECORDS, "records"),
        )  # fmt: skip


def _alarms(facts: MachineFacts) -> Iterator[ActionRow]:
    """Alarms that were active at the end of the records."""
    for same in facts.alarms.kinds:
        last = same[-1]
        if any(one.ended == "open" for one in same):
            text = f"{last.code} {last.message}".strip() or last.item
            yield ActionRow(
                action=Action(
                    what=f"Clear the {last.level}", where=last.where or last.item,
                    why=f"{text}: still active at the end of the records, since "
                    f"{moment(last.start)}.",
                    until=NOW, who="maintenance",
                ),
                href="#alarms",
            )  # fmt: skip


def _sensors(facts: MachineFacts) -> Iterator[ActionRow]:
    """Data items whose values cleaning had to remove so often that the sensor is in doubt."""
    for item, rule, count, a_day in facts.doubtful_items:
        yield ActionRow(
            action=Action(
                what="Check sensor, wiring and adapter", where=item,
                why=f"{number(count)} values were removed ({rule_words(rule)}), "
                f"{number(a_day)} on a working day.",
                until=STOP, who="maintenance",
            ),
            href=link(facts.folders.name, RECORDS, "records"),
        )  # fmt: skip


def _of_submodels(facts: MachineFacts) -> Iterator[ActionRow]:
    """What the sub-models ask for, and those that may not be used as they are."""
    machine = facts.folders.name
    for one in facts.models:
        keys = {section.key for section in one.page.sections}
        for action in one.page.actions:
            at = action.evidence if action.evidence in keys else ""
            yield ActionRow(action=action, href=link(machine, one.name, at))
        verdict = one.page.verdict
        if verdict is not None and verdict.status != "passed":
            action = Action(
                what=verdict.todo, where=f"Twin: {one.title}", why=_why(one), until=USE,
                who="ML engineer",
            )  # fmt: skip
            yield ActionRow(action=action, href=link(machine, one.name))


def _why(one: ModelledPart) -> str:
    """The figure that counts against its limit, where it is beyond it; else the first sentence."""
    figure, verdict = counting_figure(one), one.page.verdict
    if verdict is None or verdict.status != "failed" or not figure.passed_limit:
        first, _, rest = ("" if verdict is None else verdict.sentence).partition(". ")
        return f"{first}." if rest else first
    return f"{figure.what[:1].upper()}{figure.what[1:]}: {figure.value}, limit {figure.limit}."


def _records(facts: MachineFacts, grave: list[tuple[str, str]]) -> Iterator[ActionRow]:
    """What is wrong with the records themselves."""
    records = link(facts.folders.name, RECORDS, "records")
    for why, what in grave:
        yield _data(what, "Records", why, NOW, records)
    silent = facts.silence
    if silent is not None:
        yield _data(
            "Find out whether the machine is off or its log is lost", "Machine’s log",
            f"Silent: it ends {duration(silent)} before the newest live source.", REPORT,
            "#last-records",
        )  # fmt: skip
    if facts.work.surprising_days:
        days = day_list(facts.work.surprising_days)
        yield _data("Check the logger", "Machine’s log", f"No record on {days}.", STOP, records)


def _data(what: str, where: str, why: str, until: str, href: str) -> ActionRow:
    action = Action(what=what, where=where, why=why, until=until, who="data engineer")
    return ActionRow(action=action, href=href)


def _models(facts: MachineFacts) -> Iterator[ActionRow]:
    """A champion that is not the latest; nothing that was judged at all."""
    name = facts.folders.name
    if facts.serving is not None and facts.serving.older:
        yield ActionRow(
            action=Action(
                what="Promote the latest models, or leave those that serve", where="Twin: champion",
                why=f"What serves has another model of {facts.titles(facts.serving.older)}.",
                until=OPEN, who="ML engineer",
            ),
            href=link(name, RECORDS, "provenance"),
        )  # fmt: skip
    if any(one.page.verdict is not None for one in facts.models):
        return
    if facts.records.files is None:
        yield _data("Put its records under data/raw and run dvc repro", "Records",
                    "Nothing has been read of this machine yet.", NOW,
                    evidence_page(name, RECORDS))  # fmt: skip
    elif facts.known:
        yield _data("Run dvc repro to its end", "Twin", "No model has been judged.", USE, "")
    for what, record in facts.folders.missing[:1]:
        held = already(record, facts.logged)
        ask = "Record what is not logged yet of" if held else "Record"
        why = f"There is no model of it.{f' Logged: {joined(held)}.' if held else ''}"
        yield _data(f"{ask} {record.rstrip('.')}", f"Twin: {what}", why, OPEN,
                    link(name, RECORDS, "missing"))  # fmt: skip


def _programs(facts: MachineFacts, trusted: bool) -> Iterator[ActionRow]:
    """Optimised programs that gain something, and those that must not be loaded."""
    href = link(facts.folders.name, PROGRAMS, "part-programs")
    for one, why in refused(facts.parts):
        yield ActionRow(
            action=Action(what=f"Do not load {shown(one.program)}", where=f"Program {one.label}",
                          why=f"{why[:1].upper()}{why[1:]}.", until=NOW, who="process engineer"),
            href=href,
        )  # fmt: skip
    for one in loadable(facts.parts) if trusted else []:
        yield ActionRow(
            action=Action(what=f"Review {shown(one.program)} before it is cut",
                          where=f"Program {one.label}", why=_gain(one), until=OPEN,
                          who="process engineer"),
            href=href,
        )  # fmt: skip


def _gain(one: PartProgram) -> str:
    """What an optimised program saves, and what it asks for beside it."""
    life = _times(one.part.before.tool_life_share, one.part.after.tool_life_share)
    speeds = [(b.speed_before, b.speed_after) for b in one.part.groups]
    beside = [f"use of tool life {life}"] if life else []
    raised = [(a, b) for a, b in speeds if a is not None and b is not None and b != a]
    if raised:
        a, b = max(raised, key=lambda pair: abs(pair[1] / pair[0] - 1))
        beside.append(f"spindle speed up to {number(round(a))} → {number(round(b))} rev/min")
    doubtful = [used.submodel for used in one.part.verdicts if used.doubtful]
    rests = f" It rests on {counted(len(doubtful), 'model')} that did not pass." if doubtful else ""
    also = f", {joined(beside)}" if beside else ""
    return f"Predicted {gain_words(one)}, inside its limits{also}.{rests}"


def _times(before: float | None, after: float | None) -> str:
    """The factor between two shares: ``× 3.6``; empty where one is not known."""
    return f"× {number(after / before, 2)}" if before and after is not None else ""
