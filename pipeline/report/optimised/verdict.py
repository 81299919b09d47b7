"""Verdict and key figures of an optimised program in shop-floor words."""

from collections.abc import Sequence

from pipeline.charts.numbers import NARROW, as_stated, counted, duration, joined, number
from pipeline.report.cut.tables import between, sentence, share, spans_of
from pipeline.report.optimised.changes import increases
from pipeline.report.optimised.tables import AIMS, change, limit_name
from pipeline.report.standalone_page import doubts
from pipeline.schema.part import OptimisedPart

LEAST = 0.05  # percent: what is less is no gain
MOST_SAID = 3  # warnings in the verdict, and stretches of lines of each
IN_WORDS = {"lead": "lead-ins and lead-outs", "ramping": "ramps", "plunging": "plunges"}
"""Operations whose own name is no word of a sentence."""


def verdict(part: OptimisedPart) -> tuple[str, str, list[str]]:
    """Status, word, and the sentences that a reader needs before anything else."""
    doubtful = doubts(part.verdicts)
    sentences = [*_grave(part), *doubtful, *_first_look(part), *_gain(part), *_safe(part),
            *_certain(part), *_binds(part), *_words(part), *_not_known(part)]  # fmt: skip
    if not part.proof.same:
        first = part.proof.first or ""
        where = f" First difference: {first}." if first else ""
        said = f"The program written is not proved to make the same moves: do not cut it.{where}"
        return "failed", "not proved", [said, *sentences]
    if (part.after.beyond or 0) > 0:
        return "failed", "beyond its limits", sentences
    if any(one.grave for one in part.warnings):
        return "failed", "look at the warnings", sentences
    if part.interrupted:
        stopped = "It was interrupted: this is the best that was found until then."
        return "attention", "interrupted", [stopped, *sentences]
    looked_at = "attention" if doubtful or part.warnings else "passed"
    if word := _word(part):
        return looked_at, word, sentences
    if (part.before.beyond or 0) > 0:
        return looked_at, "inside its limits", sentences
    return "unknown", "nothing gained" if part.words.total else "nothing to change", sentences


def _grave(part: OptimisedPart) -> list[str]:
    """Warnings to be seen to before the program is run, without their remedies."""
    found = []
    for one in part.warnings[:MOST_SAID]:
        spans = spans_of(one.lines)
        where = f" ({_lines(spans[:MOST_SAID])}{', …' * (len(spans) > MOST_SAID)})"
        found.append(f"{sentence(one.what)}{where if spans else ''}.")
    return found


def _lines(spans: Sequence[str]) -> str:
    one = len(spans) == 1 and "–" not in spans[0]
    return f"line{'' if one else 's'} {', '.join(spans)}"


def _first_look(part: OptimisedPart) -> list[str]:
    """Greatest increase of the load; that there is none, where F or S changed."""
    cuts = [one for one in part.changes if one.feed_per_tooth_after_mm is not None]
    found = increases(cuts)
    if not found:
        return ["No cut has more F, S or feed per tooth than before."] if part.words.total else []
    first = found[0]
    whose = ", ".join(filter(None, (f"T{first.change.tool}", first.change.operation)))
    return [
        f"Watch {_lines(first.lines.split(', '))} first ({whose}): {first.what} rises most there, "
        f"×{NARROW}{first.factor:.2f}."
    ]


def _word(part: OptimisedPart) -> str:
    """``17 % faster``; empty where nothing is gained."""
    for _, key, less in AIMS.values() if part.objective == "pareto" else [AIMS[part.objective]]:
        gain = getattr(part.gain, key)
        if gain is not None and gain <= -LEAST:
            digits = 0 if gain <= -9.95 else 1
            return f"{-gain:.{digits}f}{NARROW}% {less}"
    return ""


def _gain(part: OptimisedPart) -> list[str]:
    before, after = part.before.time_s, part.after.time_s
    if before is None or after is None:
        return []
    said = f"The part takes {_seconds(after)} instead of {_seconds(before)}"
    said += f" ({change(part.gain.time_percent)})"
    costs = [part.before.cost, part.after.cost]
    if None in costs:
        return [f"{said}."]
    currency, percent = part.currency or "", change(part.gain.cost_percent)
    return [f"{said} and costs {number(costs[1], 4)} {currency} instead of "
            f"{number(costs[0], 4)} ({percent})."]  # fmt: skip


def _seconds(value: float) -> str:
    return f"{number(value, 4)}{NARROW}s" if value < 600 else duration(value)


def _safe(part: OptimisedPart) -> list[str]:
    beyond, was = part.after.beyond, part.before.beyond or 0
    peak, limit = part.after.peak_load_N, part.load_limit_N
    said = []
    if beyond:
        said.append(f"{counted(beyond, 'block')} pass a limit.")
    elif beyond is not None:
        limits = ", ".join(part.before.beyond_of)
        said.append(
            f"No block passes a limit; as programmed {was} did ({limits})." if was
            else "No block passes a limit, as programmed or now."
        )  # fmt: skip
    if peak is not None and limit is not None:
        said.append(
            f"The highest predicted load is {number(peak)}{NARROW}N of {as_stated(limit)}{NARROW}N."
        )
    return said


def _certain(part: OptimisedPart) -> list[str]:
    of = part.certainty
    if of is None or of.exceedance is None:
        return []
    extra = None if of.price is None else of.price.time_percent
    price = ""
    if extra and extra > 0:
        price = f"; being that sure costs {number(extra, 2)}{NARROW}% of time"
    between = f" ({' to '.join(share(end) for end in of.interval_95)})"
    return [
        f"With all that is uncertain, the load passes its limit in {share(of.exceedance)} of parts"
        f"{between}{of.of_tools}, {as_stated(100 * of.epsilon)}{NARROW}% is allowed{price}."
    ]


def _binds(part: OptimisedPart) -> list[str]:
    rows = [row for row in part.binding if row.limit]
    if not rows:
        return []
    first = max(rows, key=lambda row: row.time_s or 0.0)
    where = f"in {counted(first.blocks, 'block')}"
    if first.kept:
        return [f"The longest part of it stays as programmed, {where}: {first.kept}."]
    if first.limit == "as programmed":
        names = dict.fromkeys(use.operation for use in part.tools if use.binds == first.limit)
        said = [IN_WORDS.get(name, name) for name in names if name]
        which = f" in {joined(said)}" if said else " than programmed"
        return [f"What holds it back longest: no more feed per tooth{which}, {where}."]
    name = limit_name(first.limit)
    if name == "load limit" and part.certainty is not None:
        name += ", as surely as asked"
    return [f"What holds it back longest is the {name}, {where}."]


def _words(part: OptimisedPart) -> list[str]:
    if not part.proof.same:
        return []
    if not part.words.total:
        return ["Nothing to change: every F and S stays as it was."]
    points = part.proof.points
    lines = f", and {counted(points, 'line')} with a point of the path were put in" * bool(points)
    return [
        f"Only F and S words changed: {counted(part.words.total, 'word')}{lines}. The moves are "
        "the same to the last bit."
    ]


def _not_known(part: OptimisedPart) -> list[str]:
    found = [row.what for row in part.not_known]
    return [f"Not known: {', '.join(found)}."] if found else []


def key_figures(part: OptimisedPart) -> list[tuple[str, str, str]]:
    """Name, value after, and beside it the value before with the change."""
    currency, limit = part.currency or "", part.load_limit_N
    aside = "" if limit is None else f", limit {as_stated(limit)}{NARROW}N"
    return [
        _key(part, "Time", "time_s", "s", "time_percent"),
        _key(part, "Cost of the part", "cost", currency, "cost_percent"),
        _key(part, "Tool life used", "tool_life_share", "%", "tool_life_percent"),
        _key(part, "Energy", "energy_kWh", "kWh", "energy_percent"),
        _key(part, "Peak load", "peak_load_N", "N", None, aside),
    ]


def _key(
    part: OptimisedPart, name: str, key: str, unit: str, gain: str | None, more: str = ""
) -> tuple[str, str, str]:
    before, after = getattr(part.before, key), getattr(part.after, key)
    if after is None:
        return name, "not known", ""
    was = "" if before is None else f"was {_with(before, unit)}"
    percent = change(getattr(part.gain, gain)) if gain and was else ""
    ends = between(part.after, key, lambda end: _with(end, unit))
    return name, _with(after, unit) + ends, ", ".join(filter(None, (was, percent))) + more


def _with(value: float, unit: str) -> str:
    if unit == "%":
        return share(value)
    if unit == "s":
        return _seconds(value)
    return f"{number(value, 4 if unit not in ('kWh', 'N') else 3)}{NARROW}{unit}"
