"""Verdict on a machine: one word, one to three sentences, what to do now, and notes."""

from dataclasses import dataclass
from typing import Literal

from pipeline.charts.numbers import counted, day_list, duration, moment, number, percent
from pipeline.charts.sections import PartVerdict, combined
from pipeline.report.facts import MachineFacts
from pipeline.report.part_programs import loading_words, warning_words
from pipeline.report.records import WHOLE, Gap, rule_words

Status = Literal["failed", "attention", "passed", "unknown"]
WORDS = {
    "failed": "Failed",
    "attention": "Passed, with reservations",
    "passed": "Passed",
    "unknown": "No verdict",
}
"""Verdict in words, by status."""
REJECTED_SHARE = 0.01  # of the records: above it a reader or the recording needs a look
DAY_NS = 86_400 * 10**9
NIGHT_S = 4 * 3600.0  # a shorter loss over midnight is not a night switched off
LONG_LOSS_S = 600.0  # a loss of the whole record; shorter ones are in the tables
REMOVED_A_DAY = 50  # wrong values of one item on a working day: its sensor or wiring needs a look
STOPPED_SHARE = 0.25  # of a day's working time in feed hold or interrupted
WORKED_S = 3600.0  # a day with less work than this says nothing about its stops


BESIDE = frozenset({"synthesis"})
"""Sub-models that no other figure of a machine rests on: they are told, and reserve nothing."""


@dataclass(frozen=True, kw_only=True)
class MachineVerdict:
    """``status``, ``sentences``, then ``notes`` in order of weight.

    ``todo`` is what to do now, a sentence; ``because`` the sentence that gives its reason.
    """

    status: Status
    sentences: list[str]
    todo: str
    because: str
    notes: list[str]

    @property
    def word(self) -> str:
        """The status in words."""
        return WORDS[self.status]


def machine_verdict(facts: MachineFacts) -> MachineVerdict:
    """The head of one machine's page, made from its facts alone."""
    grave, doubts = _grave(facts), [words for page in facts.pages for words in page.doubts]
    told = [(one.name, one.page.verdict) for one in facts.models if one.page.verdict is not None]
    parts = [verdict for name, verdict in told if name not in BESIDE]
    beside = [verdict for name, verdict in told if name in BESIDE]
    if not parts:
        parts, beside = beside, []
    # what could be judged leads; grave faults stand before all but the first sentence
    judged, ranked = combined(parts or [_without_verdict(facts)])
    status, todo, because = judged.status, judged.todo, judged.sentence
    said = [part.sentence for part in ranked]
    if status == "passed" and (reserved := grave or doubts):
        status, because = "attention", reserved[0]
    sentences = [*said[:1], *grave, *said[1:]]
    if grave and status != "failed" and (repair := _repair(facts)):
        todo, because = repair, grave[0]
    if status == "passed" and (loading := loading_words(facts.parts)):
        todo = f"{todo} {loading}"
    return MachineVerdict(
        status=status, sentences=sentences[:2], todo=todo, because=because,
        notes=[
            *sentences[2:], *(one.sentence for one in beside), *warning_words(facts.parts),
            *doubts, *_notes(facts),
        ],
    )  # fmt: skip


def _without_verdict(facts: MachineFacts) -> PartVerdict:
    """The reason why nothing of a machine was judged, and what to do about it."""
    missing, todo = facts.folders.missing, ""
    if missing:
        todo = f"For {missing[0][0]}, record {missing[0][1]}."
    if facts.records.files is None:
        sentence = "Nothing has been read of this machine yet."
        todo = todo or "Put its records under data/raw and run dvc repro."
    else:
        sentence = "No model of this machine has been judged: there is no verdict.json."
        if facts.known:
            todo = "Run dvc repro to its end, so that the model is judged before it serves."
    todo = todo or (
        "Record spindle temperature, speed and load for two working weeks: one to learn from, "
        "one to judge on."
    )
    return PartVerdict(status="unknown", sentence=sentence, todo=todo)


def _leaks(facts: MachineFacts) -> dict[str, list[str]]:
    """Records to judge by that a model was also fitted on, by the title of the sub-model."""
    leaks = {one.title: one.leaked(facts.golden) for one in facts.models}
    return {title: files for title, files in leaks.items() if files}


def _grave(facts: MachineFacts) -> list[str]:
    """Faults that make the verdict itself doubtful, or a whole file worthless."""
    said = []
    for title, files in _leaks(facts).items():
        more = f" and {len(files) - 3} more" if len(files) > 3 else ""
        said.append(
            f"The judgement is worthless: the model of the {title} was also fitted on "
            f"{', '.join(files[:3])}{more}."
        )
    unreadable = facts.records.unreadable
    if unreadable:
        count = counted(many := len(unreadable), "file")
        more = f" and {many - 3} more" if many > 3 else ""
        said.append(f"{count} could not be read at all: {', '.join(unreadable[:3])}{more}.")
    if facts.records.unbalanced:
        names = ", ".join(facts.records.unbalanced[:3])
        said.append(f"Records were lost without a reason in {names}.")
    if facts.shelf.broken:
        names = "; ".join(f"{k} ({v})" for k, v in sorted(facts.shelf.broken.items())[:3])
        said.append(f"Results that cannot be read: {names}.")
    if _rejected_much(facts):
        share = percent(facts.records.rejected, facts.records.records)
        reasons = facts.records.reasons
        why = f", most often because: {reasons[0].reason}" if reasons else ""
        said.append(f"{share} of the records were rejected{why}.")
    return said


def _repair(facts: MachineFacts) -> str:
    """What to do about the gravest of :func:`_grave`."""
    if _leaks(facts):
        return "Take the golden records out of the training records and run dvc repro."
    if facts.records.unreadable:
        return f"Replace or remove {facts.records.unreadable[0]} under data/raw, then dvc repro."
    if facts.records.unbalanced or facts.shelf.broken:
        return (
            "Run dvc repro from nothing; if this stays, it is a fault of the pipeline: report it."
        )
    if _rejected_much(facts):
        return "Look at the rejected records below: repair the recording, or say how to read them."
    return ""


def _rejected_much(facts: MachineFacts) -> bool:
    return facts.records.rejected > REJECTED_SHARE * max(1, facts.records.records)


def _notes(facts: MachineFacts) -> list[str]:
    """What else is unusual, most important first."""
    said = [words for page in facts.pages for words in page.notes]
    said += _serving(facts)
    if facts.work.surprising_days:
        said.append(f"No record on {day_list(facts.work.surprising_days)}.")
    lost = [g for g in facts.records.losses if _in_working_time(g)]
    if lost:
        said.append(
            f"The machine was not heard for {duration(lost[0].seconds)} from "
            f"{moment(lost[0].start)} ({lost[0].cause})"
            + (f", and {counted(len(lost) - 1, 'more time')}." if lost[1:] else ".")
        )
    said += _sensors(facts)
    stopped = _stopped_days(facts)
    if stopped:
        said.append(
            f"More than {100 * STOPPED_SHARE:.0f} % of the working time went to feed hold or "
            f"interruption on {day_list(stopped)}."
        )
    return said


def _serving(facts: MachineFacts) -> list[str]:
    """Where the champion is not the latest, and what of it failed or was not judged."""
    if facts.serving is None:
        return []
    said = []
    if facts.serving.older:
        titles = facts.titles(facts.serving.older)
        said.append(f"The champion that serves has another model of {titles} than this page.")
    for status, words in (
        ("failed", "failed its judgement"), ("not decided", "could not be decided"),
        ("not judged", "was not judged"),
    ):  # fmt: skip
        names = [n for n, one in facts.serving.bundle.submodels.items() if one.status == status]
        if names:
            said.append(f"Of the champion that serves, the model of {facts.titles(names)} {words}.")
    return said


def _in_working_time(gap: Gap) -> bool:
    """Whether a loss of the whole record is more than a night or a weekend switched off."""
    if gap.data_item != WHOLE or gap.seconds < LONG_LOSS_S:
        return False
    return gap.start // DAY_NS == gap.end // DAY_NS or gap.seconds < NIGHT_S


def _sensors(facts: MachineFacts) -> list[str]:
    """Data items whose values cleaning had to remove so often that the sensor is in doubt."""
    days = max(1, len(facts.work.worked_days))
    return [
        f"{number(count)} values of {item} were removed ({rule_words(rule)}), "
        f"{number(round(count / days))} on a working day: check sensor, wiring and adapter."
        for rule, item, count in facts.records.changes or []
        if count > REMOVED_A_DAY * days
    ][:2]


def _stopped_days(facts: MachineFacts) -> list[str]:
    return [
        day.day
        for day in facts.work.worked_days
        if (work := day.stopped + day.active) > WORKED_S and day.stopped > STOPPED_SHARE * work
    ]
