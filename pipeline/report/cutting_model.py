"""What the force model is made of: terms that were tried, and what mechanics leave over."""

from typing import Any

from pipeline.charts.numbers import TOGETHER, counted, number, real
from pipeline.charts.sources import dig, rows_of, words_of
from pipeline.charts.tables import Table, cells, names, numbers
from pipeline.report.cutting_tables import cutting_sources
from pipeline.report.drive_verdict import joined
from pipeline.report.facts import Facts

MOST_FEEDS = 4  # feeds of a set of conditions that are named
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
    learnt, ends = (_known(row.get(key)) for key in ("feeds_per_tooth_mm", "holds_for_mm"))
    used = f"used from {ends[0]:g} to {ends[1]:g}" if len(ends) == 2 else ""
    said = [
        f"{number(round(speed))}{TOGETHER}rev/min" if speed is not None else "",
        f"{depth:g}{TOGETHER}mm deep" if depth is not None else "",
        f"learnt at {_feeds(learnt)}{TOGETHER}mm a tooth" if learnt else "",
        used if learnt or not used else f"{used}{TOGETHER}mm a tooth",
    ]
    return ", ".join(words for words in said if words)


def _known(values: Any) -> list[float]:
    """The numbers of a list, each once, from the least on."""
    every = values if isinstance(values, list) else []
    return sorted({x for value in every if (x := real(value)) is not None})


def _feeds(feeds: list[float]) -> str:
    if len(feeds) > MOST_FEEDS:
        return f"{len(feeds)} feeds from {feeds[0]:g} to {feeds[-1]:g}"
    return joined([f"{feed:g}" for feed in feeds])
