"""What of the cut goes into ``report.json``, and what a change of it means."""

from typing import Any

from pipeline.charts.numbers import real
from pipeline.charts.sources import dig, objects_of
from pipeline.report.cutting_facts import Cutting, worst_run
from pipeline.report.cutting_units import determined, interval, unit_of

PREFIX = "cut "  # of the cut's parameters among those of a machine
POWERS = ("specific_force", "K_tc", "K_te")  # what the spindle's load shows
WORN = ("K_te", "K_re", "K_ae", "spindle specific_force", "spindle K_te")
REMEDIES = {
    **dict.fromkeys(WORN, "an edge that has worn since, or a harder batch of material: measure "
                          "the flank, and change the edge"),
    "runout": "a tool that no longer runs true: clean the taper, clamp it anew, check it with a "
              "dial gauge",
}  # fmt: skip
"""What growth beyond both intervals means, by parameter."""


def cutting_figures(cutting: Cutting) -> dict[str, float | int | None]:
    """Worst errors and how many cuts were judged; nothing for a machine without any."""
    if cutting.document is None and cutting.validation is None:
        return {}
    worst, peak = worst_run(cutting.telling), worst_run(cutting.telling, "peak")
    return {
        "cut_rms_percent": worst.size("rms") if worst else None,
        "cut_peak_percent": peak.size("peak") if peak else None,
        "cuts_judged": len(cutting.judged) if cutting.validation else None,
    }


def cutting_parameters(cutting: Cutting) -> dict[str, dict[str, Any]]:
    """Value, unit and interval of each parameter, by name."""
    spindle = dig(cutting.document, "spindle")
    powers = objects_of({"spindle": spindle}, "spindle")
    every = cutting.parameters | {
        f"spindle {name}": p for name, p in powers.items() if name in POWERS
    }
    return {f"{PREFIX}{name}": _kept(p) for name, p in every.items()}


def _kept(p: dict[str, Any]) -> dict[str, Any]:
    known = determined(p)
    low, high = interval(p) if known else (None, None)
    return {"value": real(p.get("value")) if known else None, "unit": unit_of(p),
            "low": low, "high": high}  # fmt: skip


def wear_note(name: str, before: dict[str, Any], now: dict[str, Any]) -> str:
    """What to do about a parameter of the cut that grew beyond both intervals; else empty.

    >>> old, new = {"high": 12.0}, {"low": 15.0}
    >>> wear_note("cut runout", old, new)[:49]
    'runout grew by more than both intervals allow: lo'
    >>> wear_note("cut runout", new, old), wear_note("drive X mass", old, new)
    ('', '')
    """
    remedy = REMEDIES.get(name.removeprefix(PREFIX), "")
    end, start = real(before.get("high")), real(now.get("low"))
    if not name.startswith(PREFIX) or not remedy or end is None or start is None or start <= end:
        return ""
    return (
        f"{name.removeprefix(PREFIX)} grew by more than both intervals allow: look for {remedy}. "
        "That holds if tool, material and clamping are the same as then."
    )
