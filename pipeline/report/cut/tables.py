"""Tables of a cut: loads and cost by tool, blocks nearest to a limit, sources of the numbers."""

from typing import Any

from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    TOGETHER,
    counted,
    duration,
    fixed,
    number,
    real,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Head, Table, cells, names, numbers

NOTHING = 1e-6  # of the greatest of its kind: less is rounding
FORCES = ("peak_load_N", "axial_force_N")
MOST_SPANS = 8  # stretches of lines that a warning names
NONE = "–"


def entry(document: Any, *keys: str) -> Any:
    """An entry of a cut's document under nested keys; None as soon as one is absent."""
    for key in keys:
        if not isinstance(document, dict):
            return None
        document = document.get(key)
    return document


def rows_of(document: Any, *keys: str) -> list[dict[str, Any]]:
    """Rows of a cut's document under nested keys; empty when there are none."""
    rows = entry(document, *keys)
    return [row for row in rows if isinstance(row, dict)] if isinstance(rows, list) else []


def share(value: Any) -> str:
    """A share [1] in percent; a dash where there is none."""
    known = real(value)
    if known is None:
        return NONE
    if abs(known) >= 0.1:
        return f"{fixed(100 * known, 0)}{NARROW}%"
    return f"{number(100 * known, 2)}{NARROW}%"


def _figure(value: Any, digits: int = 3) -> str:
    known = real(value)
    return NONE if known is None else number(value if isinstance(value, int) else known, digits)


def _cleared(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The rows with 0 for forces that are nothing but rounding beside the greatest."""
    sizes = [abs(x) for row in rows for key in FORCES if (x := real(row.get(key))) is not None]
    least = NOTHING * max(sizes, default=0.0)
    return [
        row | {key: 0 for key in FORCES if (x := real(row.get(key))) is not None and abs(x) < least}
        for row in rows
    ]


def tool_name(number_: Any, name: Any = "") -> str:
    """``T4 12MM ENDMILL``."""
    return f"T{number_} {name}".strip()


def forces_table(document: dict[str, Any], sources: list[Source]) -> Table:
    """By tool: chip, load, torque, power, deflection, stability, at the worst of its blocks."""
    rows = _cleared(rows_of(document, "cut", "by_tool"))
    return Table(
        caption="By tool: the worst of its blocks, at the highest feed that a block reaches",
        heads=[
            *names("Tool"),
            *numbers(("blocks that cut", ""), ("in the material", ""), ("cuts air", "")),
            *numbers(("feed a tooth", "mm"), ("thickest", "mm"), group="Chip"),
            *numbers(("axial", "mm"), ("radial", "mm"), group="Depth"),
            *numbers(("in the plane", "N"), ("axial", "N"), group="Peak force"),
            *numbers(
                ("torque", f"N{TOGETHER}m"), ("power", "kW"), ("of the drive", ""), group="Spindle"
            ),
            *numbers(("deflection", "µm"), ("stability", "")),
        ],
        rows=[_force_row(row) for row in rows],
        sources=sources,
        note="Stability is how much deeper the block could cut before it chatters; negative where "
        "it does. Deflection is of the tool alone, clamped in its holder.",
    )


def _force_row(row: dict[str, Any]) -> list[Cell]:
    return cells(
        tool_name(row.get("tool"), row.get("name")),
        _figure(row.get("blocks")),
        duration(row.get("in_material_s")),
        share(row.get("air_share")),
        _figure(row.get("feed_per_tooth_mm")),
        _figure(row.get("chip_thickness_mm")),
        _figure(row.get("axial_depth_mm")),
        _figure(row.get("radial_depth_mm")),
        _figure(row.get("peak_load_N")),
        _figure(row.get("axial_force_N")),
        _figure(row.get("torque_Nm")),
        _figure(row.get("power_kW")),
        share(row.get("drive_share")),
        _figure(row.get("deflection_um")),
        share(row.get("stability_margin")),
    )


def cost_table(document: dict[str, Any], sources: list[Source]) -> Table:
    """By tool: time, volume, share of its life, cost by cause, energy."""
    rows, currency = (
        rows_of(document, "cut", "by_tool"),
        str(entry(document, "cut", "currency") or ""),
    )
    total = entry(document, "cut", "summary")
    every = [_cost_row(row, tool_name(row.get("tool"), row.get("name"))) for row in rows]
    if isinstance(total, dict):
        every.append(_cost_row(total, "the part"))
    return Table(
        caption="By tool: what the part costs",
        heads=[
            *names("Tool"),
            *numbers(("time", ""), ("removed", "cm³"), ("rate while cutting", "cm³/min")),
            *numbers(("tool life used", "")),
            *numbers(
                ("time", currency), ("tools", currency), ("energy", currency), ("sum", currency),
                group="Cost",
            ),
            *numbers(("energy", "kWh")),
        ],
        rows=every,
        sources=sources,
    )  # fmt: skip


def _cost_row(row: dict[str, Any], name: str) -> list[Cell]:
    cost = row.get("cost") if isinstance(row.get("cost"), dict) else {}
    return cells(
        name,
        duration(row.get("time_s")),
        _figure(row.get("volume_cm3")),
        _figure(row.get("removal_rate_cm3_min")),
        share(row.get("tool_life_share")),
        *(_figure(entry(cost, key)) for key in ("time", "tools", "energy", "sum")),
        _figure(row.get("energy_kWh")),
    )


def worst_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """The blocks that come nearest to a limit, or beyond it."""
    rows = rows_of(document, "cut", "worst")
    if not rows:
        return None
    measured = entry(document, "cut", "dynamics_measured") is True
    return Table(
        caption="The blocks that come nearest to what binds them: the worst of each run of blocks",
        heads=[
            *names("Line", "Tool", "what binds"),
            *numbers(("of the limit", ""), ("blocks alike", ""), ("peak load", "N"),
                     ("feed reached", "mm/min"), ("speed", "rev/min"), ("feed a tooth", "mm"),
                     ("axial depth", "mm"), ("radial depth", "mm"), ("power", "kW"),
                     ("deflection", "µm")),
        ],
        rows=[_worst_row(row, measured=measured) for row in rows],
        sources=sources,
    )  # fmt: skip


def _worst_row(row: dict[str, Any], *, measured: bool) -> list[Cell]:
    used = real(row.get("used"))
    binds = str(row.get("binds") or NOT_KNOWN)
    grave = measured or binds != "stability"
    status = "" if used is None or used <= 1 else "failed" if grave else "attention"
    return cells(
        str(row.get("line")),
        f"T{row.get('tool')}",
        Cell(text=binds, status=status),
        share(used),
        _figure(row.get("alike")),
        _figure(row.get("peak_load_N")),
        _figure(row.get("reached_feed_mm_min")),
        _figure(round(real(row.get("speed_rpm")) or 0)),
        _figure(row.get("feed_per_tooth_mm")),
        _figure(row.get("axial_depth_mm")),
        _figure(row.get("radial_depth_mm")),
        _figure(row.get("power_kW")),
        _figure(row.get("deflection_um")),
    )


def warnings_pairs(document: dict[str, Any]) -> list[tuple[str, str]]:
    """What to look at before the part is cut: what, and in which lines."""
    found = []
    for row in rows_of(document, "cut", "warnings"):
        spans = spans_of(row.get("lines"))
        words = f"Line{'s' if len(spans) > 1 or '–' in ''.join(spans) else ''} " if spans else ""
        words += ", ".join(spans[:MOST_SPANS])
        if len(spans) > MOST_SPANS:
            words += f" and {counted(len(spans) - MOST_SPANS, 'stretch', 'stretches')} more"
        blocks = row.get("blocks")
        many = f" {counted(blocks, 'block')}." if isinstance(blocks, int) else ""
        found.append((
            sentence(str(row.get("what") or "")),
            f"{row.get('do') or ''}{many} {words}{'.' if words else ''}".strip(),
        ))  # fmt: skip
    return found


def spans_of(lines: Any) -> list[str]:
    """Lines as stretches: ``33``, ``111–118``."""
    known = [n for n in lines if isinstance(n, int)] if isinstance(lines, list) else []
    spans: list[list[int]] = []
    for line in sorted(set(known)):
        if spans and line == spans[-1][1] + 1:
            spans[-1][1] = line
        else:
            spans.append([line, line])
    return [str(a) if a == b else f"{a}–{b}" for a, b in spans]


def sentence(words: str) -> str:
    """The words with a capital at their beginning."""
    return words[:1].upper() + words[1:]


def basis_table(document: dict[str, Any], sources: list[Source]) -> Table:
    """What the numbers rest on: stock, force law of each tool, limits, what is not known."""
    rows = [
        cells(
            str(row.get("what") or ""), str(row.get("value") or ""), str(row.get("source") or NONE)
        )
        for row in rows_of(document, "cut", "basis")
    ]
    heads = [Head(name="What"), Head(name="value"), Head(name="where it comes from")]
    return Table(caption="What these numbers rest on", heads=heads, rows=rows, sources=sources)
