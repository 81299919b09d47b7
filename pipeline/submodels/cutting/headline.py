"""Head of the page for cutting: verdict, key figures and notes, in the shop floor's words."""

from pipeline.charts.numbers import TOGETHER, counted, relative, rounded
from pipeline.charts.sections import (
    PartVerdict,
)
from pipeline.submodels.cutting.judged_tables import PLAIN_WHAT
from pipeline.submodels.cutting.runs import (
    ERRORS,
    CutRun,
    CuttingFacts,
    components,
    worst_run,
)

MOST_NAMED = 5
"""Parameters that are named in the head of the page."""
ERROR_WORDS = {"rms": "RMS force", "peak": "peak force", "mean": "mean force"}
REFRAIN = (
    "Do not plan cuts with these forces yet: see How well forces are predicted on its page, and "
)
KEEP = "Keep a recording at another feed or depth out of roles.training, to judge by."


def cutting_verdict(facts: CuttingFacts) -> PartVerdict | None:
    """Whether predicted forces may be trusted; None when no force of the cut is known."""
    if facts.verdict is None:
        return _without_judgement() if facts.has_coefficients else None
    failed = [run for run in facts.telling if run.status == "failed"]
    if facts.verdict.status == "failed" or (failed and facts.verdict.status != "not judged"):
        return _failed(facts, failed)
    if facts.verdict.status != "passed" or not facts.telling:
        return _unjudged(facts)
    return PartVerdict(
        status="passed",
        sentence=f"Cutting forces are predicted within their limits: on "
        f"{recordings_words(facts)} {errors_words(facts, facts.telling)}.",
        todo="Plan cuts with these forces, with this tool and material.",
    )


def _without_judgement() -> PartVerdict:
    return PartVerdict(
        status="unknown",
        sentence="A model of the cutting forces was found and not held against any recording: "
        "there is no verdict.json.",
        todo="Run dvc repro to its end, so that the forces are judged before anybody plans with "
        "them.",
    )


def _failed(facts: CuttingFacts, failed: list[CutRun]) -> PartVerdict:
    where = f"{len(failed)} of {recordings_words(facts)}" if failed else recordings_words(facts)
    errors = errors_words(facts, failed or facts.telling)
    why = "" if failed or facts.verdict is None else "; ".join(facts.verdict.reasons)
    return PartVerdict(
        status="failed",
        sentence="Cutting forces are not predicted within their limits: on "
        f"{where} {errors}{bracketed(why)}.{_outside_words(failed)}{fault_words(facts)}",
        todo=f"{REFRAIN}record the failed conditions again with a new edge and the tool clamped "
        "anew.",
    )


def fault_words(facts: CuttingFacts) -> str:
    """The recordings that a fault explains, the first by name; empty without one."""
    found = {run.recording: run.row.fault for run in (*facts.runs, *facts.cross) if run.row.fault}
    if not found:
        return ""
    name, words = next(iter(found.items()))
    more = f" The table names {counted(len(found) - 1, 'more')}." if len(found) > 1 else ""
    return f" In {name} {words}.{more}"


def _outside_words(failed: list[CutRun]) -> str:
    """How many of the failed recordings are extrapolations, and what to do about those."""
    count = sum(bool(run.outside) for run in failed)
    if not count:
        return ""
    which = "It lies" if len(failed) == 1 else f"{count} of these lie{'s' if count == 1 else ''}"
    return (
        f" {which} outside of what was learnt, where the model extrapolates: the table says in "
        "which condition; name such recordings in roles.training too."
    )


def _unjudged(facts: CuttingFacts) -> PartVerdict:
    reasons = () if facts.verdict is None else facts.verdict.reasons
    why = "; ".join(reasons) or "no recording was left to judge by"
    if facts.model is not None and facts.model.prediction is None and facts.model.reason:
        why = facts.model.reason
    part = ""
    if facts.telling:
        part = f" On {recordings_words(facts)} {errors_words(facts, facts.telling)}."
    beyond = any(run.beyond(kind) for run in facts.telling for kind in ERRORS)
    return PartVerdict(
        status="unknown",
        sentence=f"The cutting forces were not judged: {why.rstrip('.')}.{part}",
        todo=f"{REFRAIN}{KEEP[0].lower()}{KEEP[1:]}" if beyond else KEEP,
        reserved=beyond,
    )


def recordings_words(facts: CuttingFacts) -> str:
    """How many recordings tell, and how they were predicted."""
    if facts.judged:
        return counted(len(facts.judged), "judged recording")
    count = len(facts.telling)
    return f"{counted(count, 'recording')} predicted from the other{'s' if count > 2 else ''}"


def errors_words(facts: CuttingFacts, runs: list[CutRun]) -> str:
    """The worst errors of ``runs`` against their limits; where some are beyond, only those."""
    known = [
        (kind, error, facts.limit(kind))
        for kind in ERRORS
        if (run := worst_run(runs, kind)) is not None
        if (error := run.size(kind)) is not None
    ]
    beyond = [one for one in known if one[2] is not None and one[1] > one[2]]
    words = [
        f"the {ERROR_WORDS[kind]} {'' if place else 'is wrong '}by up to "
        f"{relative(error, rounded, '%')}"
        + (f" (limit {limit:g}{TOGETHER}%)" if limit is not None else "")
        for place, (kind, error, limit) in enumerate(beyond or known)
    ]
    return " and ".join([", ".join(words[:-1]), words[-1]] if words[1:] else words) or (
        "no error is known"
    )


def bracketed(words: str) -> str:
    """Words behind a space and in brackets, without their full stop; nothing for none."""
    return f" ({words.rstrip('.')})" if words else ""


def plain_better_words(facts: CuttingFacts) -> str:
    """On which judged recordings the plain guess comes closer; empty without one."""
    beaten = [run for run in facts.telling if run.plain_better()]
    if not beaten:
        return ""
    return (
        f"On {len(beaten)} of {recordings_words(facts)} the plain guess ({PLAIN_WHAT}) comes "
        "closer to the forces than the model."
    )


def beyond_words(facts: CuttingFacts) -> str:
    """What the judgement above does not count: failed fits to the others, single components."""
    words = [
        f"{len(failed)} of {counted(len(facts.cross), 'recording')} fail when predicted by a fit "
        f"to the others: {errors_words(facts, failed)}"
        if len(failed) > 1 else
        f"{failed[0].recording} fails when predicted by a fit to the other recordings: "
        f"{errors_words(facts, failed)}"
        for failed in [[run for run in facts.cross if run.status == "failed"]]
        if failed and facts.judged
    ]  # fmt: skip
    limit, worst = facts.limit("peak"), _worst_component(facts)
    if worst is not None and limit is not None and worst[0] > limit:
        words.append(
            f"limits hold for the force in the plane of the feed: the peak of single components "
            f"is wrong by up to {relative(worst[0], rounded, '%')} (F{worst[1]} in {worst[2]})"
        )
    return " ".join(f"{one[0].upper()}{one[1:]}." for one in words)


def _worst_component(facts: CuttingFacts) -> tuple[float, str, str] | None:
    """Greatest error of a component's peak [%], its axis, its recording; None without one."""
    return max(
        (
            (abs(error), name, run.recording)
            for run in facts.judged
            for name, one in components(
                facts.shown.predictions, run.recording, run.waveform.regime
            ).items()
            if name != "resultant" and (error := one.errors["peak"]) is not None
        ),
        default=None,
    )


def undetermined_words(facts: CuttingFacts) -> str:
    """Parameters of the cut that the records do not determine, the first of them by name."""
    lost = facts.undetermined
    more = f" and {len(lost) - MOST_NAMED} more" if len(lost) > MOST_NAMED else ""
    return (
        f"Of the cut the records do not determine {', '.join(lost[:MOST_NAMED])}{more}; the table "
        "of coefficients says why, and what to record."
    )


def key_figures(facts: CuttingFacts) -> list[tuple[str, str, str]]:
    """The worst errors of predicted forces, and of how many recordings."""
    runs = facts.telling
    worst, peak = worst_run(runs), worst_run(runs, "peak")
    every = [
        ("Forces of the cut", worst.size("rms") if worst else None, "rms"),
        ("Peak forces", peak.size("peak") if peak else None, "peak"),
    ]
    which = "judged recording" if facts.judged else "cross prediction"
    return [
        (words, relative(error, unit="%"), f"worst of {counted(len(runs), which)}"
         + (f", limit{TOGETHER}{limit:g}{TOGETHER}%"
            if (limit := facts.limit(kind)) is not None else ""))
        for words, error, kind in every if error is not None
    ]  # fmt: skip
