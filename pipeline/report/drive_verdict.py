"""The verdict on the feed drives, in words for the head of the page."""

from pipeline.charts.numbers import TOGETHER, counted, number
from pipeline.charts.sections import PartVerdict
from pipeline.charts.sources import dig
from pipeline.report.driven import Driven, DriveRun, worst_following, worst_force

MOST_NAMED = 4  # parameters that are named in the head of the page


def drives_verdict(drives: Driven) -> PartVerdict | None:
    """Whether the twin's axes move as the machine's do; None when they were never compared."""
    if drives.validation is None:
        return None
    failed = [run for run in drives.judged if run.status == "failed"]
    if failed:
        return _failed(drives, failed)
    if not drives.judged or drives.validation.get("passed") is not True:
        return _unjudged(drives)
    axes = _axes_of(drives.judged)
    follow = "axis follows its" if len(axes) == 1 else "axes follow their"
    return PartVerdict(
        status="passed",
        sentence=f"The twin’s {joined(axes)} {follow} records: on "
        f"{counted(_recordings(drives.judged), 'judged recording')} "
        f"{errors_words(drives, drives.judged)}.",
        todo="Nothing to repair: the twin’s axes move as the machine’s do.",
    )


def _failed(drives: Driven, failed: list[DriveRun]) -> PartVerdict:
    axes = _axes_of(failed)
    good = [axis for axis in _axes_of(drives.judged) if axis not in axes]
    follow = "axis does not follow its" if len(axes) == 1 else "axes do not follow their"
    judged = [run for run in drives.judged if run.axis in axes]
    rest = f"; {joined(good)} {'does' if len(good) == 1 else 'do'}" if good else ""
    return PartVerdict(
        status="failed",
        sentence=f"The twin’s {joined(axes)} {follow} records: on {_recordings(failed)} of "
        f"{counted(_recordings(judged), 'judged recording')} "
        f"{errors_words(drives, failed)}{rest}.",
        todo=f"Do not plan with the twin’s {joined(axes)} yet. Where an axis was serviced after "
        "its training records, record its reciprocation again; else the table of recordings "
        "says which motion the twin gets wrong.",
    )


def _unjudged(drives: Driven) -> PartVerdict:
    why = str(dig(drives.validation, "reason") or "no recording of an axis was left to judge by")
    part = ""
    if drives.judged:
        part = f" On the judged recordings {errors_words(drives, drives.judged)}."
    return PartVerdict(
        status="unknown",
        sentence=f"The twin’s drives were not judged: {why.rstrip('.')}.{part}",
        todo="Keep one recording of each axis out of drive_records.training, to judge the drives "
        "by.",
    )


def errors_words(drives: Driven, runs: list[DriveRun]) -> str:
    """The worst errors of ``runs`` against their limits; where runs failed only what is beyond."""
    force, following = worst_force(runs), worst_following(runs)
    every = [
        ("the force", force.force_error if force else None, drives.force_limit),
        ("the following error", following.following_error if following else None,
         drives.following_limit),
    ]  # fmt: skip
    known = [(words, error, limit) for words, error, limit in every if error is not None]
    beyond = [one for one in known if one[2] is not None and one[1] > one[2]]
    said = [
        f"{words} {'' if place else 'is wrong '}by up to {number(error, 2)}{TOGETHER}%"
        + (f" (limit {limit:g}{TOGETHER}%)" if limit is not None else "")
        for place, (words, error, limit) in enumerate(beyond or known)
    ]
    return " and ".join(said) or "no error is known"


def undetermined_words(drives: Driven) -> str:
    """How many parameters the records do not determine, the first of them by name."""
    lost = drives.undetermined
    more = f" and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
    named = ", ".join(lost[:MOST_NAMED]) + more if more else joined(lost)
    return (
        f"Of the drives the records do not determine {named}; the tables below say what to record "
        "for a number."
    )


def joined(words: list[str]) -> str:
    """Words as a list that is read aloud: ``X, Y and Z``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _axes_of(runs: list[DriveRun]) -> list[str]:
    return sorted({run.axis for run in runs})


def _recordings(runs: list[DriveRun]) -> int:
    return len({run.recording for run in runs})
