"""What the force model is made of: terms that were tried, and what mechanics leave over."""

from typing import Any

from pipeline.report.cutting_tables import cutting_sources
from pipeline.report.facts import Facts
from pipeline.report.numbers import TOGETHER, counted, number, real
from pipeline.report.sources import dig, rows_of, words_of
from pipeline.report.tables import Table, cells, names, numbers

TERMS = {
    "runout": "runout",
    "helix": "helix angle",
    "modes": "ringing of the dynamometer’s channels",
    "teeth": "an edge of its own for each tooth",
}
"""Terms of the model, for people."""


def terms_table(found: Facts) -> Table | None:
    """Terms that were tried, by how recordings left out are predicted with them."""
    tried = rows_of(found.cutting.document, "terms")
    if not tried:
        return None
    learnt = [r.get("role") for r in rows_of(found.cutting.document, "recordings")]
    several = learnt.count("training") != 1
    what = "error on recordings left out" if several else "information criterion"
    return Table(
        caption=f"What the model may hold, by the {what}",
        note="Kept is the one with the fewest unknowns of those that are next to the least.",
        heads=[*names("Terms beside the coefficients"),
               *numbers((what, "%" if several else "")), *names("kept")],
        rows=[
            cells(
                ", ".join(TERMS.get(t, t) for t in words_of(row, "terms")) or "none",
                number(None if (v := real(row.get("value"))) is None else 100 * v if several else v,
                       4),
                "kept" if row.get("kept") is True else "–",
            )
            for row in tried
        ],
        sources=cutting_sources(found),
        folded=True,
    )  # fmt: skip


def remainder_words(document: dict[str, Any]) -> str:
    """What is learnt beside mechanics, and for which conditions; empty where nothing is."""
    rows = rows_of(document, "remainder", "conditions")
    if not rows:
        return ""
    what = str(dig(document, "remainder", "what") or "what mechanics leave over").rstrip(".")
    holds = "; ".join(words for row in rows[:3] if (words := _conditions(row)))
    more = f" and {counted(len(rows) - 3, 'more set')} of conditions" if len(rows) > 3 else ""
    where = f": {holds}{more}" if holds else ""
    return (
        f"Beside mechanics the model holds {what}. That part was learnt, not understood, and is "
        f"used only where it was learnt{where}. Under any other conditions mechanics alone predict."
    )


def _conditions(row: dict[str, Any]) -> str:
    speed, depth = (real(row.get(key)) for key in ("speed_rpm", "axial_depth_mm"))
    feeds = row.get("holds_for_mm")
    ends = [real(x) for x in feeds] if isinstance(feeds, list) and len(feeds) == 2 else []
    said = [
        f"{number(round(speed))}{TOGETHER}rev/min" if speed is not None else "",
        f"{depth:g}{TOGETHER}mm deep" if depth is not None else "",
        f"{number(ends[0])} to {number(ends[1])}{TOGETHER}mm a tooth"
        if ends and None not in ends else "",
    ]  # fmt: skip
    return ", ".join(words for words in said if words)
