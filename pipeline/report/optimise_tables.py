"""Tables of an optimised program: before and after, methods, what binds, blocks, limits, proof."""

import re
from typing import Any

from pipeline.charts.numbers import NARROW, asked, counted, number, real, signed
from pipeline.charts.sources import Source, dig, objects_of, rows_of
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names, numbers
from pipeline.report.cut_tables import NONE, sentence, share, tool_name
from pipeline.report.optimise_words import limit_name

ROWS = (
    ("Time", "s", "time_s", "time_percent", 4),
    ("Cost", None, "cost", "cost_percent", 4),
    ("Energy", "kWh", "energy_kWh", "energy_percent", 3),
    ("Tool life used", "%", "tool_life_share", "tool_life_percent", 3),
    ("Peak load", "N", "peak_load_N", None, 3),
    ("Blocks beyond a limit", "", "beyond", None, 3),
)
"""Name, unit (the currency where None), key, key of the change, digits."""
LONGEST = 40  # letters of a word
LIMITS = {
    "load_N": ("load across the tool’s axis", "N", "load"),
    "deflection_um": ("deflection of the tip", "µm", "deflection"),
    "roughness_um": ("feed marks", "µm", "roughness"),
    "chip_um": ("thickest chip", "µm", "chip"),
    "cutting_speed_m_min": ("cutting speed", "m/min", "cutting_speed"),
    "feed_mm_min": ("F", "mm/min", ""),
    "speed_rpm": ("S", "rev/min", ""),
    "torque_Nm": ("torque of the cut", "N m", "torque"),
    "power_share": ("share of the drive’s power", "", "power"),
    "least_speed_change_rpm": ("least change of S", "rev/min", ""),
}
"""What each limit is called, its unit, and the margin that is kept of it."""


def figure(value: Any, digits: int = 3) -> str:
    """A number as it stands in a table; a dash where there is none."""
    known = real(value)
    if known is None:
        return NONE
    return number(value if isinstance(value, int) else known, digits)


def change(value: Any) -> str:
    """A change in percent with its sign; a dash where there is none."""
    known = real(value)
    if known is None:
        return NONE
    return f"{signed(known, 1 if abs(known) < 99.95 else 0)}{NARROW}%"


def gain_table(document: dict[str, Any], sources: list[Source]) -> Table:
    """As programmed, optimised, and the change."""
    rows = []
    for name, unit, key, gain, digits in ROWS:
        factor = 100.0 if unit == "%" else 1.0
        pair = [_scaled(dig(document, which, key), factor) for which in ("before", "after")]
        told = unit if unit is not None else str(dig(document, "currency") or "")
        rows.append(cells(
            f"{name}, {told}" if told else name,
            *(figure(value, digits) for value in pair),
            change(dig(document, "gain", gain)) if gain else NONE,
        ))  # fmt: skip
    heads = [*names("Of the part"),
             *numbers(("as programmed", ""), ("optimised", ""), ("change", ""))]  # fmt: skip
    return Table(caption="Before and after", heads=heads, rows=rows, sources=sources)


def _scaled(value: Any, factor: float) -> float | int | None:
    if isinstance(value, int) and not isinstance(value, bool) and factor == 1.0:
        return value
    known = real(value)
    return None if known is None else factor * known


def methods_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """What each method finds, and how much it evaluates for it."""
    found = rows_of(document, "methods")
    if not found:
        return None
    currency = str(dig(document, "currency") or "")
    heads = [*names("Method", "inside the limits"),
             *numbers(("time", "s"), ("cost", currency), ("energy", "kWh"), ("tool life used", ""),
                      ("evaluations", ""))]  # fmt: skip
    return Table(
        caption="What other ways find", heads=heads, rows=[_method(row) for row in found],
        sources=sources, note="Inside is what keeps the limits with their margins, and that of "
        "the load as surely as asked: a program may be beyond although its predicted load is not.",
    )  # fmt: skip


def _method(row: dict[str, Any]) -> list[Cell]:
    inside = row.get("feasible") is True
    return cells(
        sentence(str(row.get("method") or "")),
        Cell(text="inside" if inside else "beyond", status="passed" if inside else "failed"),
        figure(row.get("time_s"), 4),
        figure(row.get("cost"), 4),
        figure(row.get("energy_kWh")),
        share(row.get("tool_life_share")),
        figure(row.get("evaluations")),
    )


def binding_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """Which limits hold the program back, and in how much of it."""
    found = rows_of(document, "binding")
    if not found:
        return None
    total = real(dig(document, "after", "time_s"))
    rows = []
    for row in found:
        seconds = real(row.get("time_s"))
        part = seconds / total if seconds is not None and total else None
        rows.append(cells(sentence(limit_name(row.get("limit"))), figure(row.get("blocks")),
                          figure(seconds), share(part)))  # fmt: skip
    heads = [*names("What binds"), *numbers(("blocks", ""), ("their time", "s"), ("of all", ""))]
    return Table(
        caption="What holds the program back", heads=heads, rows=rows, sources=sources,
        note="Blocks that cut; the rest of the time is air and waits. Nothing binds where the aim "
        "is best inside the limits, or where a block shares its F with others.",
    )  # fmt: skip


def groups_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """Every group of blocks before and after, folded."""
    found = rows_of(document, "groups")
    if not found:
        return None
    currency = str(dig(document, "currency") or "")
    pair = (("before", ""), ("after", ""))
    heads = [*names("Lines", "tool", "what binds")]
    for name, unit in (("F", ""), ("S", "rev/min"), ("Time", "s"), ("Cost", currency),
                       ("Peak load", "N")):  # fmt: skip
        heads += numbers(*((word, unit) for word, _ in pair), group=name)
    shown = found[:MOST_ROWS]
    return Table(
        caption=f"F and S of {counted(len(found), 'group')} of blocks"
        + left_out(len(found), len(shown)),
        heads=heads, rows=[_group(row) for row in shown], sources=sources, folded=True,
        note="F is in mm/min, or in mm/rev where that stands behind it; where a group had several "
        "F or S, their mean over its time.",
    )  # fmt: skip


def _group(row: dict[str, Any]) -> list[Cell]:
    unit = " mm/rev" if row.get("feed_unit") == "mm/rev" else ""
    first, last = row.get("first_line"), row.get("last_line")
    return cells(
        str(first) if first == last else f"{first}–{last}",
        tool_name(row.get("tool")),
        limit_name(row.get("binds")) if row.get("binds") else NONE,
        *(figure(row.get(f"feed_{w}"), 4) + unit for w in ("before", "after")),
        *(figure(_whole(row.get(f"speed_{w}"))) for w in ("before", "after")),
        *(figure(row.get(key)) for key in ("time_before_s", "time_after_s")),
        *(figure(row.get(f"cost_{w}")) for w in ("before", "after")),
        *(figure(row.get(f"peak_load_{w}_N")) for w in ("before", "after")),
    )


def _whole(value: Any) -> int | None:
    known = real(value)
    return None if known is None else round(known)


def front_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """The front, folded, the knee marked."""
    found = rows_of(document, "front")
    if not found:
        return None
    currency = str(dig(document, "currency") or "")
    rows = [
        cells(
            "the knee" if row.get("knee") is True else str(k),
            figure(row.get("time_s"), 4),
            figure(row.get("cost"), 4),
            figure(row.get("energy_kWh")),
            share(row.get("tool_life_share")),
        )
        for k, row in enumerate(found[:MOST_ROWS], 1)
    ]
    heads = [*names("Member"), *numbers(("time", "s"), ("cost", currency), ("energy", "kWh"),
                                        ("tool life used", ""))]  # fmt: skip
    caption = f"The front: {counted(len(found), 'program')}" + left_out(len(found), len(rows))
    return Table(caption=caption, heads=heads, rows=rows, sources=sources, folded=True)


def uncertain_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """What is not known well, and how far it may be off."""
    found = rows_of(document, "certainty", "uncertain")
    if not found:
        return None
    keys = ("what", "value", "spread", "source")
    rows = [cells(*(_words(row.get(key)) for key in keys)) for row in found]
    heads = names("What is uncertain", "value", "spread", "where that comes from")
    return Table(caption="What the certainty allows for", heads=heads, rows=rows, sources=sources)


def _words(value: Any) -> Cell:
    """Words, or a number; a name too long for a line is broken anywhere, as code is."""
    text = _typeset(value) or NONE if isinstance(value, str) else figure(value)
    return Cell(text=text, code=max(map(len, text.split()), default=0) > LONGEST)


def _typeset(words: str) -> str:
    """As a page writes what a plain text wrote: ``um``, ``^2``, a minus, whose settings."""
    text = re.sub(r"(?<=\d) um\b", " µm", words.replace("^2", "²"))
    text = re.sub(r"^certainty\.", "conf/optimisation, certainty.", text)
    return re.sub(r"^-(?=\d)", "−", text)


def limits_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """Limits that were given, and what is kept free of each."""
    found = dig(document, "limits")
    if not isinstance(found, dict):
        return None
    margins = objects_of(document, "limits").get("margins", {})
    rows = []
    for key, (name, unit, margin) in LIMITS.items():
        if found.get(key) in (None, 0) or (key == "power_share" and found[key] == 1):
            continue
        rows.append(cells(sentence(name), limit_words(found[key], unit),
                          share(margins.get(margin)) if margins.get(margin) else NONE))  # fmt: skip
    if not rows:
        return None
    heads = names("Limit", "value", "kept free of it")
    return Table(caption="Limits", heads=heads, rows=rows, sources=sources)


def limit_words(value: Any, unit: str) -> str:
    """A limit, or a range, with its unit."""
    known = value if isinstance(value, list) else [value]
    words = " to ".join(asked(v) for v in known)
    return f"{words}{NARROW}{unit}" if unit else words


def proof_table(document: dict[str, Any], sources: list[Source]) -> Table | None:
    """Hashes of the program before and after, and of what both tell the machine."""
    proof = dig(document, "proof")
    if not isinstance(proof, dict):
        return None
    rows = [
        [Cell(text=name), Cell(text=str(proof.get(key) or NONE), code=True)]
        for name, key in (
            ("Program as it was", "before_sha256"),
            ("Program as it is written", "after_sha256"),
            ("What both do: every move, state, tool and code but F and S", "sha256"),
        )
    ]
    return Table(caption="Proof", heads=names("Of what", "sha256"), rows=rows, sources=sources)
