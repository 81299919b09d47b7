"""What ``kerf simulate`` says of a cut."""

from collections.abc import Iterator, Mapping
from typing import Any


def cut_lines(cut: Mapping[str, Any]) -> Iterator[str]:
    """What ``kerf simulate`` says of a cut: tools, cost, warnings, what is not known."""
    total = cut["summary"]
    yield (
        f"cut of {cut['stock']['text']} mm ({cut['stock']['work_offset']}) in "
        f"{cut['material']['name']}: {_number(total['volume_cm3'])} cm3 removed, "
        f"{_percent(total['air_share'])} of the time at feed in air"
    )
    for row in cut["basis"]:
        if row["what"].startswith("forces of"):
            yield f"  {row['what']}: {row['value']} ({row['source']})"
    yield from _table(cut)
    if total["cost"] is not None:
        parts = ", ".join(f"{name} {_number(value)}" for name, value in total["cost"].items())
        yield f"  cost of the part, {cut['currency']}: {parts}"
    for warning in cut["warnings"]:
        lines = ", ".join(map(str, warning["lines"][:SAID]))
        more = ", ..." if len(warning["lines"]) > SAID else ""
        where = f", {_many(warning['blocks'], 'block')}, line {lines}{more}" if lines else ""
        yield f"  warning: {warning['what']}{where}. {warning['do']}"
    for one in cut["left_out"]:
        moves = _many(one["rows"], "move")
        yield f"  left out: {one['reason']}, {moves}, the first in {one['first']}"
    for one in cut["not_known"]:
        yield f"  not known: {one['what']}, {one['why']}"


def _many(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


SAID = 6
"""Lines of the program that a warning names."""
COLUMNS: tuple[tuple[str, str, str, float], ...] = (
    ("f_z", "mm", "feed_per_tooth_mm", 1),
    ("a_p", "mm", "axial_depth_mm", 1),
    ("a_e", "mm", "radial_depth_mm", 1),
    ("load", "N", "peak_load_N", 1),
    ("axial", "N", "axial_force_N", 1),
    ("torque", "N m", "torque_Nm", 1),
    ("power", "kW", "power_kW", 1),
    ("drive", "%", "drive_share", 100),
    ("deflection", "um", "deflection_um", 1),
    ("stability", "%", "stability_margin", 100),
    ("rate", "cm3/min", "removal_rate_cm3_min", 1),
    ("air", "%", "air_share", 100),
    ("life", "%", "tool_life_share", 100),
    ("energy", "kWh", "energy_kWh", 1),
    ("cost", "", "cost", 1),
)
"""Head, unit, key and factor of what is said of each tool."""


def _table(cut: Mapping[str, Any]) -> Iterator[str]:
    heads = ["tool", *(head for head, *_ in COLUMNS)]
    units = ["", *(unit for _, unit, *_ in COLUMNS[:-1]), str(cut["currency"] or "")]
    rows = [
        [name, *(_number(_value(row, key), factor) for *_, key, factor in COLUMNS)]
        for name, row in (
            *((f"T{row['tool']}", row) for row in cut["by_tool"]),
            ("part", cut["summary"]),
        )
    ]
    table = [heads, units, *rows]
    widths = [max(len(line[i]) for line in table) for i in range(len(heads))]
    for line in table:
        yield "  " + "  ".join(word.rjust(width) for word, width in zip(line, widths, strict=True))


def _value(row: Mapping[str, Any], key: str) -> float | None:
    value = row[key]
    return value["sum"] if isinstance(value, dict) else value


def _number(value: float | None, factor: float = 1) -> str:
    if value is None:
        return "-"
    shown = value * factor
    return f"{shown:.0f}" if abs(shown) >= 1000 else f"{shown:.3g}"


def _percent(value: float | None) -> str:
    return "an unknown share" if value is None else f"{100 * value:.0f} %"
