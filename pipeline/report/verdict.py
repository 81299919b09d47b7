"""From the facts to one word, one to three sentences and what to do now."""

import re
from dataclasses import dataclass
from typing import Any, Literal

from pipeline.charts.numbers import (
    counted,
    day_list,
    day_words,
    duration,
    fixed,
    moment,
    number,
    percent,
    real,
)
from pipeline.charts.sections import PartVerdict, combined
from pipeline.charts.sources import dig, objects_of, rows_of, words_of
from pipeline.report.control_verdict import times_verdict
from pipeline.report.cutting_verdict import cut_undetermined, cutting_verdict, plain_better_words
from pipeline.report.drive_verdict import drives_verdict, undetermined_words
from pipeline.report.facts import Facts
from pipeline.report.part_programs import loading_words, warning_words
from pipeline.report.reading import WHOLE, Gap, rule_words

Status = Literal["failed", "attention", "passed", "unknown"]
WORDS = {
    "failed": "Failed",
    "attention": "Passed, with reservations",
    "passed": "Passed",
    "unknown": "No verdict",
}

REJECTED_SHARE = 0.01  # of the records: above it a reader or the recording needs a look
ISO_DAY = re.compile(r"\b\d{4}-\d{2}-\d{2}\b")
DAY_NS = 86_400 * 10**9
NIGHT_S = 4 * 3600.0  # a shorter loss over midnight is not a night switched off
LONG_LOSS_S = 600.0  # a loss of the whole record; shorter ones are in the tables
REMOVED_A_DAY = 50  # wrong values of one item on a working day: its sensor or wiring needs a look
STOPPED_SHARE = 0.25  # of a day's working time in feed hold or interrupted
WORKED_S = 3600.0  # a day with less work than this says nothing about its stops


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What the lead reads: one word's ``status``, ``sentences``, then ``notes`` in order of weight.

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


def verdict(found: Facts) -> Verdict:
    """The headline of one machine, made from its facts alone."""
    grave, notes = _grave(found), _notes(found)
    judged, ranked = combined(_parts(found))
    status, todo, because = judged.status, judged.todo, judged.sentence
    said = [part.sentence for part in ranked]
    if status == "passed" and (doubts := grave or _mild(found)):
        status, because = "attention", doubts[0]
    sentences = [*said[:1], *grave, *said[1:]]
    if grave and status != "failed" and (repair := _repair(found)):
        todo, because = repair, grave[0]
    if status == "passed" and (loading := loading_words(found.parts)):
        todo = f"{todo} {loading}"
    return Verdict(
        status=status, sentences=sentences[:2], todo=todo, because=because,
        notes=sentences[2:] + notes,
    )  # fmt: skip


def _parts(found: Facts) -> list[PartVerdict]:
    """What was judged of the machine, in order of weight; what has no verdict of its own last."""
    status, sentence, todo = _of_model(found)
    heat = PartVerdict(status=status, sentence=sentence, todo=todo)
    others = [times_verdict(found.control), drives_verdict(found.drives),
              cutting_verdict(found.cutting)]  # fmt: skip
    parts = [part for part in others if part is not None]
    if parts and found.without_spindle:
        return parts
    return [*parts, heat] if heat.status == "unknown" else [heat, *parts]


def _of_model(found: Facts) -> tuple[Status, str, str]:
    """Status, sentence and action that the judgement on the golden week asks for."""
    v = found.model.validation
    word = dig(v, "verdict")
    if v is None or word not in ("passed", "failed"):
        return "unknown", *_without_verdict(found)
    if word == "failed":
        return (
            "failed",
            f"The spindle’s thermal model failed its golden week ({_week(v)}): {_failure(v)}.",
            "Do not act on this model’s temperatures; leave the model that serves now in service.",
        )
    error, limit = dig(v, "windows", "all", "model", "mae_K"), dig(v, "limits", "mae_K")
    free = dig(v, "free_run", "all", "model", "mae_K")
    return (
        "passed",
        f"The spindle’s thermal model passed its golden week ({_week(v)}): over one hour its "
        f"temperature is wrong by {fixed(error, 2)} K on average (limit {fixed(limit, 1)} K), "
        f"and by {fixed(free, 2)} K when it runs free.",
        "Nothing to repair: the model may serve.",
    )


def _without_verdict(found: Facts) -> tuple[str, str]:
    missing = found.folders.missing
    sentence = "No model of this machine has been judged: there is no validation.json."
    if found.model.validation is not None:
        sentence = "No model of this machine has been judged: validation.json holds no verdict."
    if found.reading.files is None:
        return "Nothing has been read of this machine yet.", _first(missing) or (
            "Put its records under data/raw and run dvc repro."
        )
    if found.model.thermal is not None:
        return sentence, "Run dvc repro to its end, so that the model is judged before it serves."
    return sentence, _first(missing) or (
        "Record spindle temperature, speed and load for two working weeks: one to learn from, "
        "one to judge on."
    )


def _first(missing: tuple[tuple[str, str], ...]) -> str:
    return f"For {missing[0][0]}, record {missing[0][1]}." if missing else ""


def _week(validation: dict[str, Any]) -> str:
    first, last = (str(dig(validation, "golden", k) or "") for k in ("from", "to"))
    return f"{day_words(first[:10])} to {day_words(last[:10], year=True)}" if first else "not named"


def _failure(validation: dict[str, Any]) -> str:
    """On which days it failed and by how much; else the judge's own reasons."""
    rows = [
        (error, str(row.get("day")), row.get("passed"))
        for row in rows_of(validation, "windows", "days")
        if (error := real(dig(row, "model", "mae_K"))) is not None
    ]
    failed = [row for row in rows if row[2] is False]
    if not failed:
        return "; ".join(reasons(validation)) or "the judge gave no reason"
    error, day, _ = max(failed)
    limit = fixed(dig(validation, "limits", "mae_K"), 1)
    whole = fixed(dig(validation, "windows", "all", "model", "mae_K"), 2)
    return (
        f"it failed on {len(failed)} of {counted(len(rows), 'day')}, worst on {day_words(day)} "
        f"with a mean error over one hour of {fixed(error, 2)} K (limit {limit} K; {whole} K over "
        "all days)"
    )


def reasons(validation: dict[str, Any] | None) -> list[str]:
    """The judge's reasons, with days as people write them."""
    words = words_of(validation, "reasons")
    return [ISO_DAY.sub(lambda found: day_words(found.group()), w) for w in words]


def _grave(found: Facts) -> list[str]:
    """What makes the verdict itself doubtful, or a whole file worthless."""
    said = []
    if found.model.leaked_days:
        days = day_list(found.model.leaked_days)
        said.append(f"The judgement is worthless: the model also learnt from {days}.")
    if found.reading.unreadable:
        names = ", ".join(f.file for f in found.reading.unreadable[:3])
        files = counted(many := len(found.reading.unreadable), "file")
        more = f" and {many - 3} more" if many > 3 else ""
        said.append(f"{files} could not be read at all: {names}{more}.")
    if found.reading.unbalanced:
        names = ", ".join(f.file for f in found.reading.unbalanced[:3])
        said.append(f"Records were lost without a reason in {names}.")
    if found.shelf.broken:
        names = "; ".join(f"{k} ({v})" for k, v in sorted(found.shelf.broken.items())[:3])
        said.append(f"Results that cannot be read: {names}.")
    if _rejected_much(found):
        share = percent(found.reading.rejected, found.reading.records)
        said.append(f"{share} of the records were rejected{_main_reason(found)}.")
    return said


def _repair(found: Facts) -> str:
    """What to do about the gravest of :func:`_grave`."""
    if found.model.leaked_days:
        return "Take the golden days out of the training days and run dvc repro."
    if found.reading.unreadable:
        return (
            f"Replace or remove {found.reading.unreadable[0].file} under data/raw, then dvc repro."
        )
    if found.reading.unbalanced or found.shelf.broken:
        return (
            "Run dvc repro from nothing; if this stays, it is a fault of the pipeline: report it."
        )
    if _rejected_much(found):
        return "Look at the rejected records below: repair the recording, or say how to read them."
    return ""


def _rejected_much(found: Facts) -> bool:
    return found.reading.rejected > REJECTED_SHARE * max(1, found.reading.records)


def _main_reason(found: Facts) -> str:
    reasons = found.reading.reasons
    return f", most often because: {reasons[0].reason}" if reasons else ""


def _mild(found: Facts) -> list[str]:
    """What a passed model is no good at: days and cuts on which a plain guess does as well."""
    said = []
    v = found.model.validation
    for part, words in (("windows", "in one-hour windows"), ("free_run", "running free")):
        rows = rows_of(v, part, "days")
        beaten = [str(r.get("day")) for r in rows if r.get("better_than_persistence") is False]
        if beaten:
            said.append(
                f"On {day_list(beaten)} the model {words} was no better than the guess that the "
                "temperature stays as it is."
            )
    worse = plain_better_words(found.cutting)
    return [*said, worse] if worse else said


def _unjudged(found: Facts) -> list[str]:
    """Golden days with records that the judgement leaves out."""
    v = found.model.validation
    judged = {str(r.get("day")) for r in rows_of(v, "windows", "days")}
    recorded = {d.day for d in found.worked_days}
    lost = [d for d in found.model.golden_days if d not in judged and d in recorded]
    if v is None or not lost:
        return []
    return [f"Golden days with records that were not judged: {day_list(lost)}."]


def _notes(found: Facts) -> list[str]:
    """What else is unusual, most important first."""
    said = warning_words(found.parts) + _mild(found) + _unjudged(found)
    parameters = objects_of(found.model.thermal, "parameters")
    undetermined = [name for name, p in parameters.items() if not p.get("determined")]
    if undetermined:
        said.append(f"The records do not determine {', '.join(undetermined)}.")
    if found.drives.undetermined:
        said.append(undetermined_words(found.drives))
    if found.cutting.undetermined:
        said.append(cut_undetermined(found.cutting))
    if found.surprising_days:
        said.append(f"No record on {day_list(found.surprising_days)}.")
    lost = [g for g in found.reading.losses if _in_working_time(g)]
    if lost:
        said.append(
            f"The machine was not heard for {duration(lost[0].seconds)} from "
            f"{moment(lost[0].start)} ({lost[0].cause})"
            + (f", and {counted(len(lost) - 1, 'more time')}." if lost[1:] else ".")
        )
    said += _sensors(found)
    stopped = _stopped_days(found)
    if stopped:
        said.append(
            f"More than {100 * STOPPED_SHARE:.0f} % of the working time went to feed hold or "
            f"interruption on {day_list(stopped)}."
        )
    return said


def _in_working_time(gap: Gap) -> bool:
    """Whether a loss of the whole record is more than a night or a weekend switched off."""
    if gap.data_item != WHOLE or gap.seconds < LONG_LOSS_S:
        return False
    return gap.start // DAY_NS == gap.end // DAY_NS or gap.seconds < NIGHT_S


def _sensors(found: Facts) -> list[str]:
    """Data items whose values cleaning had to remove so often that the sensor is in doubt."""
    days = max(1, len(found.worked_days))
    return [
        f"{number(count)} values of {item} were removed ({rule_words(rule)}), "
        f"{number(round(count / days))} on a working day: check sensor, wiring and adapter."
        for rule, item, count in found.reading.changes or []
        if count > REMOVED_A_DAY * days
    ][:2]


def _stopped_days(found: Facts) -> list[str]:
    days = []
    for day in found.worked_days:
        stopped = day.seconds.get("FEED_HOLD", 0.0) + day.seconds.get("INTERRUPTED", 0.0)
        work = stopped + day.seconds.get("ACTIVE", 0.0)
        if work > WORKED_S and stopped > STOPPED_SHARE * work:
            days.append(day.day)
    return days
