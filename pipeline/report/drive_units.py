"""Units of the drives as a shop speaks them: files are in SI, people in mm/s and µm."""

from typing import Any

from pipeline.charts.numbers import real

SHOP = {
    "m/s": ("mm/s", 1e3), "m": ("µm", 1e6), "mm": ("µm", 1e3), "um": ("µm", 1.0),
    "H": ("mH", 1e3), "s": ("ms", 1e3), "ohm": ("Ω", 1.0), "Ohm": ("Ω", 1.0), "1": ("", 1.0),
}  # fmt: skip
"""Unit in a file -> unit as shown, factor."""

FROM_SI = {"mm/s": 1e3, "mm": 1e3, "um": 1e6, "µm": 1e6, "mH": 1e3, "ms": 1e3, "N s/mm": 1e-3}
"""Unit in a file -> how many of it make one of the SI unit; 1 for SI units themselves."""


def in_shop_units(p: dict[str, Any]) -> dict[str, Any]:
    """A parameter with value, interval and unit as a shop speaks them.

    >>> p = in_shop_units({"value": 0.004, "low": 0.003, "high": None, "unit": "m/s"})
    >>> p["value"], p["low"], p["high"], p["unit"]
    (4.0, 3.0, None, 'mm/s')
    """
    unit = str(p.get("unit") or "")
    words, factor = SHOP.get(unit, (unit, 1.0))
    numbers = {
        key: None if (x := real(p.get(key))) is None else x * factor
        for key in ("value", "low", "high")
    }
    return {**p, **numbers, "unit": words}


def si_in_shop_units(value: float, unit: str) -> float:
    """An SI value as shown beside a parameter whose unit in its file is ``unit``.

    >>> si_in_shop_units(0.004, "mm/s"), si_in_shop_units(0.004, "m/s")
    (4.0, 4.0)
    """
    return value * FROM_SI.get(unit, 1.0) * SHOP.get(unit, (unit, 1.0))[1]
