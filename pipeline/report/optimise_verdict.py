"""What an optimisation came to, in the words of who cuts the part: verdict and key figures."""

from typing import Any

from pipeline.charts.numbers import NARROW, asked, counted, duration, number, real
from pipeline.charts.sources import dig, rows_of
from pipeline.report.cut_tables import share
from pipeline.report.optimise_tables import change
from pipeline.report.optimise_words import limit_name

LEAST = 0.05  # percent: what is less is no gain
LOAD = ("limits", "load_N")
AIMS = {
    "time": ("least time", "time_percent", "faster"),
    "cost": ("least cost", "cost_percent", "cheaper"),
    "energy": ("least energy", "energy_percent", "less energy"),
    "wear": ("least wear of tools", "tool_life_percent", "less wear"),
}
"""What each objective is called, its gain, and the word for less."""


def aim(document: dict[str, Any]) -> str:
    """What was aimed at, in words."""
    name = str(document.get("objective") or "")
    if name == "pareto":
        return "the knee of all objectives"
    return AIMS[name][0] if name in AIMS else name or "no aim that is known"


def verdict(document: dict[str, Any]) -> tuple[str, str, list[str]]:
    """Status, word, and what a reader needs to know before anything else."""
    told = [*_gain(document), *_safe(document), *_certain(document), *_binds(document),
            *_words(document), *_not_known(document)]  # fmt: skip
    if dig(document, "proof", "same") is not True:
        first = str(dig(document, "proof", "first") or "")
        where = f" First difference: {first}." if first else ""
        said = f"The program written is not proved to make the same moves: do not cut it.{where}"
        return "failed", "not proved", [said, *told]
    if (real(dig(document, "after", "beyond")) or 0) > 0:
        return "failed", "beyond its limits", told
    if document.get("interrupted") is True:
        stopped = "It was interrupted: this is the best that was found until then."
        return "attention", "interrupted", [stopped, *told]
    if word := _word(document):
        return "passed", word, told
    if (real(dig(document, "before", "beyond")) or 0) > 0:
        return "passed", "inside its limits", told
    return "unknown", "nothing gained", told


def _word(document: dict[str, Any]) -> str:
    """``17 % faster``; empty where nothing is gained."""
    name = str(document.get("objective") or "")
    for _, key, less in AIMS.values() if name == "pareto" else [AIMS.get(name, AIMS["time"])]:
        gain = real(dig(document, "gain", key))
        if gain is not None and gain <= -LEAST:
            digits = 0 if gain <= -9.95 else 1
            return f"{-gain:.{digits}f}{NARROW}% {less}"
    return ""


def _gain(document: dict[str, Any]) -> list[str]:
    before, after = (real(dig(document, which, "time_s")) for which in ("before", "after"))
    if before is None or after is None:
        return []
    said = f"The part takes {_seconds(after)} instead of {_seconds(before)}"
    gain = change(dig(document, "gain", "time_percent"))
    said += f" ({gain})"
    costs = [real(dig(document, which, "cost")) for which in ("before", "after")]
    if None in costs:
        return [f"{said}."]
    currency = str(document.get("currency") or "")
    percent = change(dig(document, "gain", "cost_percent"))
    return [f"{said} and costs {number(costs[1], 4)} {currency} instead of "
            f"{number(costs[0], 4)} ({percent})."]  # fmt: skip


def _seconds(value: float) -> str:
    return f"{number(value, 4)}{NARROW}s" if value < 600 else duration(value)


def _safe(document: dict[str, Any]) -> list[str]:
    beyond = {which: real(dig(document, which, "beyond")) for which in ("before", "after")}
    peak, limit = real(dig(document, "after", "peak_load_N")), real(dig(document, *LOAD))
    said = []
    if beyond["after"]:
        said.append(f"{counted(int(beyond['after']), 'block')} pass a limit.")
    elif beyond["after"] is not None:
        was = int(beyond["before"] or 0)
        said.append(
            f"No block passes a limit; as programmed {was} did{_which(document)}." if was
            else "No block passes a limit, as programmed or now."
        )  # fmt: skip
    if peak is not None and limit is not None:
        said.append(
            f"The highest predicted load is {number(peak)}{NARROW}N of {asked(limit)}{NARROW}N."
        )
    return said


def _which(document: dict[str, Any]) -> str:
    """Which limits the program as it was passed."""
    found = dig(document, "before", "beyond_of")
    return f" ({', '.join(str(name) for name in found)})" if isinstance(found, dict) else ""


def _certain(document: dict[str, Any]) -> list[str]:
    chance, allowed = (real(dig(document, "certainty", k)) for k in ("exceedance", "epsilon"))
    if chance is None or allowed is None:
        return []
    extra = real(dig(document, "certainty", "price", "time_percent"))
    price = (
        f"; being that sure costs {number(extra, 2)}{NARROW}% of time"
        if extra and extra > 0
        else ""
    )
    ends = dig(document, "certainty", "interval_95")
    between = f" ({' to '.join(share(end) for end in ends)})" if isinstance(ends, list) else ""
    return [
        f"With all that is uncertain, the load passes its limit in {share(chance)} of parts"
        f"{between}, {asked(100 * allowed)}{NARROW}% is allowed{price}."
    ]


def _binds(document: dict[str, Any]) -> list[str]:
    rows = [r for r in rows_of(document, "binding") if r.get("limit")]
    if not rows:
        return []
    first = max(rows, key=lambda row: real(row.get("time_s")) or 0.0)
    blocks = first.get("blocks")
    where = f", in {counted(blocks, 'block')}" if isinstance(blocks, int) else ""
    name = limit_name(first["limit"])
    sure = real(dig(document, "certainty", "epsilon"))
    if name == "load limit" and sure is not None:
        name += ", as surely as asked"
    return [f"What holds it back longest is the {name}{where}."]


def changed_words(document: dict[str, Any]) -> int | None:
    """F and S words that differ; None where that is not told."""
    counts = dig(document, "words")
    known = [real(v) for v in counts.values()] if isinstance(counts, dict) else []
    return (
        int(sum(v for v in known if v is not None)) if any(v is not None for v in known) else None
    )


def _words(document: dict[str, Any]) -> list[str]:
    many = changed_words(document)
    if many is None or dig(document, "proof", "same") is not True:
        return []
    return [f"Only F and S words changed: {counted(many, 'word')}. The moves are the same to the "
            "last bit."]  # fmt: skip


def _not_known(document: dict[str, Any]) -> list[str]:
    found = [str(row.get("what")) for row in rows_of(document, "not_known")]
    return [f"Not known: {', '.join(found)}."] if found else []


def key_figures(document: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Name, value after, and beside it the value before with the change."""
    currency = str(document.get("currency") or "")
    limit = real(dig(document, *LOAD))
    aside = "" if limit is None else f", limit {asked(limit)}{NARROW}N"
    return [
        _key(document, "Time", "time_s", "s", "time_percent"),
        _key(document, "Cost of the part", "cost", currency, "cost_percent"),
        _key(document, "Tool life used", "tool_life_share", "%", "tool_life_percent"),
        _key(document, "Energy", "energy_kWh", "kWh", "energy_percent"),
        _key(document, "Peak load", "peak_load_N", "N", None, aside),
    ]


def _key(
    document: dict[str, Any], name: str, key: str, unit: str, gain: str | None, more: str = ""
) -> tuple[str, str, str]:
    before, after = (real(dig(document, which, key)) for which in ("before", "after"))
    if after is None:
        return name, "not known", ""
    was = "" if before is None else f"was {_with(before, unit)}"
    percent = change(dig(document, "gain", gain)) if gain and was else ""
    return name, _with(after, unit), ", ".join(filter(None, (was, percent))) + more


def _with(value: float, unit: str) -> str:
    if unit == "%":
        return share(value)
    if unit == "s":
        return _seconds(value)
    return f"{number(value, 4 if unit not in ('kWh', 'N') else 3)}{NARROW}{unit}"
