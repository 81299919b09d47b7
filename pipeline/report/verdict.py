"""State of a machine and of its twin: two lines, actions, further observations.

The twin is what its judge says of its sub-models.  The machine's own condition is another thing:
no model here assesses it, so it is "not assessed yet", whatever the twin passes.
"""

from pipeline.charts.sections import PartVerdict
from pipeline.report.actions import machine_actions
from pipeline.report.facts import MachineFacts
from pipeline.report.records import WHOLE, Gap
from pipeline.report.states import (
    ActionRow,
    MachineVerdict,
    StateLine,
    Status,
    passed_words,
)
from pipeline.report.submodel_pages import ModelledPart
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.days import day_of

NOT_PASSED = ("failed", "attention", "unknown")
"""Status of sub-models that the line of the twin names, the gravest first."""
REJECTED_SHARE = 0.01  # of the records: above it a reader or the recording needs a look
NIGHT_S = 4 * 3600.0  # a shorter loss over midnight is not a night switched off
LONG_LOSS_S = 600.0  # a loss of the whole record; shorter ones are in the tables
STOPPED_SHARE = 0.25  # of a day's working time in feed hold or interrupted
WORKED_S = 3600.0  # a day with less work than this says nothing about its stops


BESIDE = frozenset({"synthesis"})
"""Sub-models that no other figure of a machine rests on: they do not decide about the twin."""

Judged = tuple[ModelledPart, PartVerdict]


def machine_verdict(facts: MachineFacts, say: Texts = ENGLISH) -> MachineVerdict:
    """The head of one machine's page, made from its facts alone."""
    grave = _grave(facts, say)
    repaired = [(sentence, repair) for sentence, repair in grave if repair]
    counting, beside = _judged(facts)
    twin = _twin(facts, counting, beside, [sentence for sentence, _ in grave], say)
    actions = machine_actions(facts, repaired, trusted=twin.status == "passed", say=say)
    passed = sum(v.status == "passed" for _, v in [*counting, *beside])
    return MachineVerdict(
        condition=_condition(facts, actions, say),
        twin=twin,
        actions=actions,
        passed=(passed, len(counting) + len(beside)) if counting else None,
    )


def _condition(facts: MachineFacts, actions: list[ActionRow], say: Texts) -> StateLine:
    """The machine itself: what its records show, as nothing assesses its wear or its faults."""
    faults = sum(one.level == "fault" for one in facts.alarms.alarms)
    still = sum(one.ended == "open" for one in facts.alarms.alarms)
    checks = sum(row.action.who == "maintenance" for row in actions)
    said = [say("condition.unassessed")]
    if facts.alarms.watched or facts.alarms.alarms:
        reported = say("alarms.faults", count=faults)
        said.append(
            say("condition.still", count=still, faults=reported) if still
            else say("condition.still_none", faults=reported)
        )  # fmt: skip
    if checks:
        said.append(say("condition.checks", count=checks))
    if facts.silence is not None:
        said.append(say("condition.silent", duration=say.duration(facts.silence)))
    return StateLine(status="unknown", word=say("condition.word"), sentences=said)


def _judged(facts: MachineFacts) -> tuple[list[Judged], list[Judged]]:
    """Sub-models that decide about the twin, and those beside it, with their verdicts."""
    judged = [(one, one.page.verdict) for one in facts.models if one.page.verdict is not None]
    counting = [(one, v) for one, v in judged if one.name not in BESIDE]
    beside = [(one, v) for one, v in judged if one.name in BESIDE]
    return (counting, beside) if counting else (judged, [])


def _twin(
    facts: MachineFacts, counting: list[Judged], beside: list[Judged], grave: list[str], say: Texts
) -> StateLine:
    """Number of trusted sub-models, and those that may not be trusted."""
    if not counting:
        known = "no_verdict" if facts.models else "no_submodel"
        unread = "nothing_read" if facts.records.files is None else known
        return StateLine(
            status="unknown", word=say("twin.not_judged"), sentences=[*grave, say(f"twin.{unread}")]
        )
    rest = [
        say("twin.beside", title=say.title(one.title), verdict=say(f"verdict.{v.status}"))
        for one, v in beside if v.status != "passed"
    ]  # fmt: skip
    return StateLine(
        status=_twin_status([v for _, v in counting], grave),
        word=_twin_word([*counting, *beside], say),
        sentences=[*grave, *_not_passed(counting, say), *rest] or [say("twin.kept")],
    )


def _twin_word(judged: list[Judged], say: Texts) -> str:
    """Number of those in the table that passed; of one alone its verdict."""
    if len(judged) == 1:
        one, verdict = judged[0]
        words = say(f"verdict.{verdict.status}")
        return say("twin.only", title=say.given(one.title), verdict=words)
    passed = sum(v.status == "passed" for _, v in judged)
    return passed_words(passed, len(judged), say)


def _not_passed(counting: list[Judged], say: Texts) -> list[str]:
    """Sub-models that did not pass, as one sentence; none where all passed."""
    words = []
    for status in NOT_PASSED:
        titles = [say.given(one.title) for one, v in counting if v.status == status]
        if titles:
            verdict = say(f"verdict.{status}")
            words.append(say("twin.not_passed", count=len(titles), verdict=verdict,
                             titles=", ".join(titles)))  # fmt: skip
    said = "; ".join(words)
    return [f"{said[:1].upper()}{said[1:]}."] if words else []


def _twin_status(parts: list[PartVerdict], grave: list[str]) -> Status:
    found = {part.status for part in parts}
    if found == {"failed"}:
        return "failed"
    if found == {"unknown"} and not any(part.reserved for part in parts):
        return "unknown"
    return "passed" if found == {"passed"} and not grave else "attention"


def _leaks(facts: MachineFacts) -> dict[str, list[str]]:
    """Records to judge by that a model was also fitted on, by the title of the sub-model."""
    leaks = {one.title: one.leaked(facts.golden) for one in facts.models}
    return {title: files for title, files in leaks.items() if files}


def _grave(facts: MachineFacts, say: Texts) -> list[tuple[str, str]]:
    """Faults that make the verdict itself doubtful, or a whole file worthless, with the remedy."""
    said = [
        (say("grave.leak", title=say.given(title), files=say.some(files)), say("grave.leak_remedy"))
        for title, files in _leaks(facts).items()
    ]
    unreadable = facts.records.unreadable
    if unreadable:
        files = say("files.count", count=len(unreadable))
        said.append((say("grave.unreadable", files=files, names=say.some(unreadable)),
                     say("grave.unreadable_remedy", name=unreadable[0])))  # fmt: skip
    if facts.records.unbalanced:
        names = ", ".join(facts.records.unbalanced[:3])
        said.append((say("grave.unbalanced", names=names), say("grave.fault_remedy")))
    if facts.shelf.broken:
        names = "; ".join(f"{k} ({v})" for k, v in sorted(facts.shelf.broken.items())[:3])
        said.append((say("grave.broken", names=names), say("grave.fault_remedy")))
    if _rejected_much(facts):
        share = say.percent(facts.records.rejected, facts.records.records)
        reasons = facts.records.reasons
        words = say("grave.rejected", share=share)
        if reasons:
            words = say("grave.rejected_why", share=share, reason=reasons[0].reason)
        said.append((words, say("grave.rejected_remedy")))
    return said


def _rejected_much(facts: MachineFacts) -> bool:
    return facts.records.rejected > REJECTED_SHARE * max(1, facts.records.records)


def machine_notes(facts: MachineFacts, say: Texts = ENGLISH) -> list[str]:
    """Further observations, most important first; for the page of the records."""
    doubts = [words for page in facts.pages for words in page.doubts]
    said = [words for page in facts.pages for words in page.notes]
    said += _serving(facts, say)
    lost = [g for g in facts.records.losses if _in_working_time(g, facts.work.time_zone)]
    if lost:
        first, more = lost[0], len(lost) - 1
        said.append(say(
            "note.losses" if more else "note.loss", more if more else None,
            duration=say.duration(first.seconds), moment=say.moment(first.start), cause=first.cause,
        ))  # fmt: skip
    stopped = _stopped_days(facts)
    if stopped:
        share = f"{100 * STOPPED_SHARE:.0f}"
        said.append(say("note.stopped", share=share, days=say.day_list(stopped)))
    return [*doubts, *said]


def _serving(facts: MachineFacts, say: Texts) -> list[str]:
    """Sub-models of the champion that failed or were not judged."""
    if facts.serving is None:
        return []
    said = []
    for status in ("failed", "not decided", "not judged"):
        names = [n for n, one in facts.serving.bundle.submodels.items() if one.status == status]
        if names:
            key = f"note.champion_{status.replace(' ', '_')}"
            said.append(say(key, count=len(names), titles=facts.titles(names, say.given)))
    return said


def _in_working_time(gap: Gap, zone: str) -> bool:
    """Whether a loss of the whole record is more than a night or a weekend switched off."""
    if gap.data_item != WHOLE or gap.seconds < LONG_LOSS_S:
        return False
    return day_of(gap.start, zone) == day_of(gap.end, zone) or gap.seconds < NIGHT_S


def _stopped_days(facts: MachineFacts) -> list[str]:
    return [
        day.day
        for day in facts.work.worked_days
        if (work := day.stopped + day.active) > WORKED_S and day.stopped > STOPPED_SHARE * work
    ]
