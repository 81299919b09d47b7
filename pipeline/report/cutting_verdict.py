"""The verdict on predicted cutting forces, in words for the head of the page."""

from pipeline.charts.numbers import TOGETHER, counted, fixed, number
from pipeline.charts.sections import PartVerdict
from pipeline.charts.sources import dig
from pipeline.report.cutting_facts import ERRORS, CutRun, Cutting, worst_run

MOST_NAMED = 5  # parameters that are named in the head of the page
ERROR_WORDS = {"rms": "RMS force", "peak": "peak force", "mean": "mean force"}
REFRAIN = (
    "Do not plan cuts with these forces yet: see How well forces are predicted on the machine’s "
    "page, and "
)
KEEP = "Keep a recording at another feed or depth out of cutting_records.training, to judge by."


def cutting_verdict(cutting: Cutting) -> PartVerdict | None:
    """Whether predicted forces may be trusted; None when no force of the cut is known."""
    if cutting.validation is None:
        return _without_judgement() if cutting.parameters else None
    failed = [run for run in cutting.telling if run.status == "failed"]
    passed = cutting.validation.get("passed")
    if passed is False or (failed and passed is not None):
        return _failed(cutting, failed)
    if passed is not True or not cutting.telling:
        return _unjudged(cutting)
    return PartVerdict(
        status="passed",
        sentence=f"Cutting forces are predicted within their limits: on "
        f"{recordings_words(cutting)} {errors_words(cutting, cutting.telling)}.",
        todo="Nothing to repair: plan cuts with these forces, with this tool and material.",
    )


def _without_judgement() -> PartVerdict:
    return PartVerdict(
        status="unknown",
        sentence="A model of the cutting forces was found and not held against any recording: "
        "there is no cutting_validation.json.",
        todo="Run dvc repro to its end, so that the forces are judged before anybody plans with "
        "them.",
    )


def _failed(cutting: Cutting, failed: list[CutRun]) -> PartVerdict:
    where = f"{len(failed)} of {recordings_words(cutting)}" if failed else recordings_words(cutting)
    errors = errors_words(cutting, failed or cutting.telling)
    why = "" if failed else str(dig(cutting.validation, "reason") or "")
    return PartVerdict(
        status="failed",
        sentence="Cutting forces are not predicted within their limits: on "
        f"{where} {errors}{bracketed(why)}.",
        todo=f"{REFRAIN}record the failed conditions again with a new edge and the tool clamped "
        "anew.",
    )


def _unjudged(cutting: Cutting) -> PartVerdict:
    why = str(dig(cutting.validation, "reason") or "no recording was left to judge by")
    part = ""
    if cutting.telling:
        part = f" On {recordings_words(cutting)} {errors_words(cutting, cutting.telling)}."
    beyond = any(
        (error := run.size(kind)) is not None
        and (limit := cutting.limit(kind)) is not None
        and error > limit
        for run in cutting.telling for kind in ERRORS
    )  # fmt: skip
    return PartVerdict(
        status="unknown",
        sentence=f"The cutting forces were not judged: {why.rstrip('.')}.{part}",
        todo=f"{REFRAIN}{KEEP[0].lower()}{KEEP[1:]}" if beyond else KEEP,
        reserved=beyond,
    )


def recordings_words(cutting: Cutting) -> str:
    """How many recordings tell, and how they were predicted."""
    if cutting.judged:
        return counted(len(cutting.judged), "judged recording")
    many = len(cutting.telling)
    return f"{counted(many, 'recording')} predicted from the other{'s' if many > 2 else ''}"


def errors_words(cutting: Cutting, runs: list[CutRun]) -> str:
    """The worst errors of ``runs`` against their limits; where some are beyond, only those."""
    known = [
        (kind, error, cutting.limit(kind))
        for kind in ERRORS
        if (run := worst_run(runs, kind)) is not None
        if (error := run.size(kind)) is not None
    ]
    beyond = [one for one in known if one[2] is not None and one[1] > one[2]]
    said = [
        f"the {ERROR_WORDS[kind]} {'' if place else 'is wrong '}by up to "
        f"{number(error, 2)}{TOGETHER}%"
        + (f" (limit {limit:g}{TOGETHER}%)" if limit is not None else "")
        for place, (kind, error, limit) in enumerate(beyond or known)
    ]
    return " and ".join([", ".join(said[:-1]), said[-1]] if said[1:] else said) or (
        "no error is known"
    )


def bracketed(words: str) -> str:
    """Words behind a space and in brackets, without their full stop; nothing for none."""
    return f" ({words.rstrip('.')})" if words else ""


def plain_better_words(cutting: Cutting) -> str:
    """On which judged recordings the plain guess comes closer; empty without one."""
    beaten = [run for run in cutting.telling if run.plain_better()]
    if not beaten:
        return ""
    return (
        f"On {len(beaten)} of {recordings_words(cutting)} the plain guess"
        f"{bracketed(beaten[0].plain_what)} comes closer to the forces than the model."
    )


def cut_undetermined(cutting: Cutting) -> str:
    """Parameters of the cut that the records do not determine, the first of them by name."""
    lost = cutting.undetermined
    more = f" and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
    return (
        f"Of the cut the records do not determine {', '.join(lost[:MOST_NAMED])}{more}; the table "
        "of coefficients says why, and what to record."
    )


def cutting_key_figures(cutting: Cutting) -> list[tuple[str, str, str]]:
    """The worst errors of predicted forces, and of how many recordings."""
    runs = cutting.telling
    worst, peak = worst_run(runs), worst_run(runs, "peak")
    every = [
        ("Forces of the cut", worst.size("rms") if worst else None, "rms"),
        ("Peak forces", peak.size("peak") if peak else None, "peak"),
    ]
    which = "judged recording" if cutting.judged else "cross prediction"
    return [
        (words, f"{fixed(error, 1)} %", f"worst of {counted(len(runs), which)}"
         + (f", limit{TOGETHER}{limit:g}{TOGETHER}%"
            if (limit := cutting.limit(kind)) is not None else ""))
        for words, error, kind in every if error is not None
    ]  # fmt: skip
