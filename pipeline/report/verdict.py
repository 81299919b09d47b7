"""State of a machine and of its twin: two lines, what to do, and what else is to be known.

The twin is what its judge says of its sub-models.  The machine's own condition is another thing:
no model here assesses it, so it is "not assessed yet", whatever the twin passes.
"""

from pipeline.charts.numbers import counted, day_list, duration, moment, percent
from pipeline.charts.sections import PartVerdict
from pipeline.report.actions import machine_actions
from pipeline.report.facts import MachineFacts
from pipeline.report.records import WHOLE, Gap
from pipeline.report.states import ActionRow, MachineVerdict, StateLine, Status
from pipeline.schema.days import day_of

WORDS = {"failed": "failed", "attention": "not decided", "unknown": "not judged"}
"""Status of a sub-model in the line of the twin."""
REJECTED_SHARE = 0.01  # of the records: above it a reader or the recording needs a look
NIGHT_S = 4 * 3600.0  # a shorter loss over midnight is not a night switched off
LONG_LOSS_S = 600.0  # a loss of the whole record; shorter ones are in the tables
STOPPED_SHARE = 0.25  # of a day's working time in feed hold or interrupted
WORKED_S = 3600.0  # a day with less work than this says nothing about its stops


KEPT = "On records that it did not learn from it keeps the limits in the table below."
BESIDE = frozenset({"synthesis"})
"""Sub-models that no other figure of a machine rests on: they do not decide about the twin."""


def machine_verdict(facts: MachineFacts) -> MachineVerdict:
    """The head of one machine's page, made from its facts alone."""
    grave = _grave(facts)
    repaired = [(sentence, repair) for sentence, repair in grave if repair]
    twin = _twin(facts, [sentence for sentence, _ in grave])
    actions = machine_actions(facts, repaired, trusted=twin.status == "passed")
    return MachineVerdict(
        condition=_condition(facts, actions),
        twin=twin,
        actions=actions,
        notes=[*(words for page in facts.pages for words in page.doubts), *_notes(facts)],
    )


def _condition(facts: MachineFacts, actions: list[ActionRow]) -> StateLine:
    """The machine itself: what its records show, as nothing assesses its wear or its faults."""
    faults = sum(one.level == "fault" for one in facts.alarms.alarms)
    still = sum(one.ended == "open" for one in facts.alarms.alarms)
    checks = sum(row.action.who == "maintenance" for row in actions)
    said = ["No monitoring of its condition runs yet, so nothing is said of wear or damage."]
    if facts.alarms.watched or facts.alarms.alarms:
        said.append(f"Its control reported {counted(faults, 'fault')}, {still or 'none'} of them "
                    "or of its warnings still active.")  # fmt: skip
    if checks:
        said.append(f"{counted(checks, 'check')} for maintenance below.")
    if facts.silence is not None:
        said.append(f"Its log is silent: it ends {duration(facts.silence)} before other records.")
    return StateLine(status="unknown", word="not assessed yet", sentences=said)


def _twin(facts: MachineFacts, grave: list[str]) -> StateLine:
    """How many sub-models may be trusted, and those that may not."""
    judged = [(one, one.page.verdict) for one in facts.models if one.page.verdict is not None]
    counting = [(one, v) for one, v in judged if one.name not in BESIDE] or judged
    if not counting:
        return StateLine(
            status="unknown", word="not judged yet", sentences=[*grave, _unread(facts)]
        )
    words = []
    for status, word in WORDS.items():
        titles = [one.title for one, v in counting if v.status == status]
        if titles:
            words.append(f"{len(titles)} {word} ({', '.join(titles)})")
    passed = sum(v.status == "passed" for _, v in counting)
    beside = [
        f"{one.title[:1].upper()}{one.title[1:]} {WORDS[v.status]}; nothing else rests on it."
        for one, v in judged if v.status != "passed" and (one, v) not in counting
    ]  # fmt: skip
    everything = f"all {passed}" if passed == len(counting) else f"{passed} of {len(counting)}"
    return StateLine(
        status=_twin_status([v for _, v in counting], grave),
        word=f"{everything} sub-models passed" if len(counting) > 1 else
        f"{counting[0][0].title} {WORDS.get(counting[0][1].status, 'passed')}",
        sentences=[*grave, *_failed_words(words), *beside] or [KEPT],
    )  # fmt: skip


def _failed_words(words: list[str]) -> list[str]:
    """Those that did not pass, as one sentence; none where all passed."""
    said = "; ".join(words)
    return [f"{said[:1].upper()}{said[1:]}."] if words else []


def _twin_status(parts: list[PartVerdict], grave: list[str]) -> Status:
    found = {part.status for part in parts}
    if found == {"failed"}:
        return "failed"
    if found == {"unknown"} and not any(part.reserved for part in parts):
        return "unknown"
    return "passed" if found == {"passed"} and not grave else "attention"


def _unread(facts: MachineFacts) -> str:
    if facts.records.files is None:
        return "Nothing has been read of this machine yet."
    return "No model of this machine has been judged: there is no verdict.json."


def _leaks(facts: MachineFacts) -> dict[str, list[str]]:
    """Records to judge by that a model was also fitted on, by the title of the sub-model."""
    leaks = {one.title: one.leaked(facts.golden) for one in facts.models}
    return {title: files for title, files in leaks.items() if files}


def _grave(facts: MachineFacts) -> list[tuple[str, str]]:
    """Faults that make the verdict itself doubtful, or a whole file worthless, with the remedy."""
    said = []
    for title, files in _leaks(facts).items():
        more = f" and {len(files) - 3} more" if len(files) > 3 else ""
        said.append((
            f"The judgement is worthless: the model of the {title} was also fitted on "
            f"{', '.join(files[:3])}{more}.",
            "Take the golden records out of the training records and run dvc repro",
        ))  # fmt: skip
    unreadable = facts.records.unreadable
    if unreadable:
        count = counted(many := len(unreadable), "file")
        more = f" and {many - 3} more" if many > 3 else ""
        said.append((
            f"{count} could not be read at all: {', '.join(unreadable[:3])}{more}.",
            f"Replace or remove {unreadable[0]} under data/raw, then dvc repro",
        ))  # fmt: skip
    fault = "Run dvc repro from nothing; if this stays, it is a fault of the pipeline: report it"
    if facts.records.unbalanced:
        names = ", ".join(facts.records.unbalanced[:3])
        said.append((f"Records were lost without a reason in {names}.", fault))
    if facts.shelf.broken:
        names = "; ".join(f"{k} ({v})" for k, v in sorted(facts.shelf.broken.items())[:3])
        said.append((f"Results that cannot be read: {names}.", fault))
    if _rejected_much(facts):
        share = percent(facts.records.rejected, facts.records.records)
        reasons = facts.records.reasons
        why = f", most often because: {reasons[0].reason}" if reasons else ""
        said.append((
            f"{share} of the records were rejected{why}.",
            "Repair the recording, or say in conf/machine how to read it",
        ))  # fmt: skip
    return said


def _rejected_much(facts: MachineFacts) -> bool:
    return facts.records.rejected > REJECTED_SHARE * max(1, facts.records.records)


def _notes(facts: MachineFacts) -> list[str]:
    """What else is unusual, most important first."""
    said = [words for page in facts.pages for words in page.notes]
    said += _serving(facts)
    lost = [g for g in facts.records.losses if _in_working_time(g, facts.work.time_zone)]
    if lost:
        said.append(
            f"The machine was not heard for {duration(lost[0].seconds)} from "
            f"{moment(lost[0].start)} ({lost[0].cause})"
            + (f", and {counted(len(lost) - 1, 'more time')}." if lost[1:] else ".")
        )
    stopped = _stopped_days(facts)
    if stopped:
        said.append(
            f"More than {100 * STOPPED_SHARE:.0f} % of the working time went to feed hold or "
            f"interruption on {day_list(stopped)}."
        )
    return said


def _serving(facts: MachineFacts) -> list[str]:
    """What of the champion failed or was not judged."""
    if facts.serving is None:
        return []
    said = []
    for status, words in (
        ("failed", "failed its judgement"), ("not decided", "could not be decided"),
        ("not judged", "was not judged"),
    ):  # fmt: skip
        names = [n for n, one in facts.serving.bundle.submodels.items() if one.status == status]
        if names:
            said.append(f"Of the champion that serves, the model of {facts.titles(names)} {words}.")
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
