"""Parameters of the cut as a shop reads them: units, intervals, what is determined."""

from collections import Counter
from math import ceil
from string import ascii_lowercase
from typing import Any

from pipeline.charts.numbers import TOGETHER, between, number, real, resolved

SHOP = {"N/mm2": "N/mm²", "N/mm^2": "N/mm²", "um": "µm", "deg": "°", "1": "", "N/um": "N/µm",
        "WATT": "W", "W s2": "W s²", "W s^2": "W s²"}  # fmt: skip
"""Unit in a file -> unit as shown."""

UNDETERMINED = "not determined"


def unit_of(p: dict[str, Any]) -> str:
    """The unit of a parameter as it is printed.

    >>> unit_of({"unit": "N/mm2"}), unit_of({"unit": "1"}), unit_of({"unit": "Hz"})
    ('N/mm²', '', 'Hz')
    """
    unit = str(p.get("unit") or "")
    return SHOP.get(unit, unit).replace(" ", TOGETHER)


def interval(p: dict[str, Any]) -> tuple[float | None, float | None]:
    """Ends of the 95 % interval of a parameter; None where there is none."""
    ends = p.get("interval_95")
    if not isinstance(ends, list) or len(ends) != 2:
        return None, None
    low, high = real(ends[0]), real(ends[1])
    return (None, None) if low is None or high is None or low > high else (low, high)


def determined(p: dict[str, Any]) -> bool:
    """Whether the records determine a parameter, and say its value."""
    return p.get("determined") is True and real(p.get("value")) is not None


def value_words(p: dict[str, Any]) -> str:
    """The value with the digits that its interval resolves, or that it is not determined."""
    if not determined(p):
        return UNDETERMINED
    return number(real(p.get("value")), resolved(*interval(p)))


def interval_words(p: dict[str, Any]) -> str:
    """The interval; a dash where there is none."""
    low, high = interval(p)
    return between(low, high) if determined(p) and low is not None else "–"


def holds(p: dict[str, Any], true: float, period: float = 0.0) -> bool | None:
    """Whether the interval holds ``true``, or that and whole periods; None without an interval.

    >>> angle = {"value": 358.0, "interval_95": [350, 366], "determined": True}
    >>> holds(angle, 3.0, 360.0), holds(angle, 3.0), holds({}, 3.0)
    (True, False, None)
    """
    low, high = interval(p)
    if not determined(p) or low is None or high is None:
        return None
    return low <= true + (period * ceil((low - true) / period) if period else 0.0) <= high


def off_percent(p: dict[str, Any], true: float) -> float | None:
    """How far the value found is off [%] of the true one; None for angles and a truth of 0."""
    value = real(p.get("value"))
    if not determined(p) or value is None or not true or p.get("unit") == "deg":
        return None
    return 100 * (value / true - 1)


def ways(parameters: dict[str, dict[str, Any]]) -> tuple[str, dict[str, str]]:
    """How parameters were found, as a note, and the mark in a row for each way that several share.

    >>> p = {"value": 1.0, "determined": True, "how": "motion"}
    >>> ways({"a": p, "b": p})
    ('Those with a number were found by motion.', {'motion': '–'})
    """
    counts = Counter(str(p.get("how") or "") for p in parameters.values() if determined(p))
    often = [way for way, count in counts.items() if way and (count > 1 or len(counts) == 1)]
    if len(counts) == 1 and often:
        return f"Those with a number were found by {often[0].rstrip('.')}.", {often[0]: "–"}
    marks = {way: f"({letter})" for way, letter in zip(often, ascii_lowercase, strict=False)}
    said = "; ".join(f"{mark} {way.rstrip('.')}" for way, mark in marks.items())
    return (f"How found: {said}." if said else ""), marks


def remark(p: dict[str, Any], marks: dict[str, str]) -> str:
    """Why a parameter is not determined and what to record, or how it was found."""
    reason, how = (str(p.get(key) or "") for key in ("reason", "how"))
    if not p or not determined(p):
        return reason or how or "–"
    return reason or marks.get(how, how) or "–"
