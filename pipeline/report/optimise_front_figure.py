"""Two objectives against each other: the front, its knee, the answer and the other methods."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number, real
from pipeline.charts.sources import dig, rows_of
from pipeline.charts.svg import anchor

TOP, HEIGHT = 26, 250  # px
AROUND = 0.08  # of the span, free around the points
QUANTITIES = {
    "time_s": "Time, s", "cost": "Cost", "energy_kWh": "Energy, kWh",
    "tool_life_share": "Tool life used, share",
}  # fmt: skip

LEGEND = [
    ("p-front", "front: no other is better in all", "dot"),
    ("p-knee", "its knee", "dot"),
    ("p-after", "the answer", "dot"),
]
METHODS_LEGEND = [("p-before", "as programmed", "dot"), ("p-naive", "other methods", "dot")]


@dataclass(frozen=True, kw_only=True)
class Place:
    """A point of the figure and its CSS class; ``radius`` in px."""

    x: float
    y: float
    kind: str
    radius: float = 4.5


def compared(document: dict[str, Any]) -> tuple[str, str] | None:
    """The two quantities that the front is drawn in: of those that differ, the most contrary two.

    Contrary are two of which one falls where the other rises, by the correlation of their ranks;
    among equals the first of :data:`QUANTITIES` count.
    """
    rows = rows_of(document, "front")
    ranks: dict[str, np.ndarray] = {}
    for key in QUANTITIES:
        values = [real(row.get(key)) for row in rows]
        known = [v for v in values if v is not None]
        if len(known) == len(rows) > 0 and max(known) > min(known):
            ranks[key] = np.unique(known, return_inverse=True)[1].astype(np.float64)
    pairs = [(a, b) for k, a in enumerate(ranks) for b in list(ranks)[k + 1 :]]
    if not pairs:
        return None
    return min(pairs, key=lambda pair: round(_correlation(ranks[pair[0]], ranks[pair[1]]), 6))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Of two rows of numbers that are not all the same [1]."""
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def front_places(document: dict[str, Any], keys: tuple[str, str]) -> list[Place]:
    """The front with its knee, and the answer."""
    places = []
    for row in rows_of(document, "front"):
        places += _places(row, keys, "p-front")
        if row.get("knee") is True:
            places += _places(row, keys, "p-knee", 8.0)
    answer = dig(document, "after")
    return places + _places(answer, keys, "p-after")


def method_places(document: dict[str, Any], keys: tuple[str, str]) -> list[Place]:
    """The program as it was, and what other methods found inside the limits."""
    places = []
    for row in rows_of(document, "methods"):
        if row.get("feasible") is True:
            places += _places(row, keys, "p-naive")
    return places + _places(dig(document, "before"), keys, "p-before")


def _places(row: Any, keys: tuple[str, str], kind: str, radius: float = 4.5) -> list[Place]:
    x, y = (real(dig(row, key)) for key in keys)
    return [] if x is None or y is None else [Place(x=x, y=y, kind=kind, radius=radius)]


def front_figure(places: list[Place], heads: tuple[str, str], label: str) -> Markup:
    """The places to two scales of their own; those that are best in these two are joined."""
    across, up = _scale([p.x for p in places]), _scale([p.y for p in places])
    bottom = TOP + HEIGHT
    parts = [
        svg.text(0, TOP - 9, heads[1], "head"),
        svg.text(50, bottom + 33, heads[0], "tick mid"),
    ]
    for mark in svg.ticks(*across, most=5):
        x = 100 * _share(mark, across)
        parts += [svg.down(x, TOP, bottom), svg.text(x, bottom + 16, _words(mark), anchor(x))]
    for mark in svg.ticks(*up, most=5):
        y = TOP + HEIGHT * (1 - _share(mark, up))
        parts += [svg.across(y), svg.text(0, y + 4, _words(mark), "tick end", dx=-6)]
    front = _edge([p for p in places if p.kind == "p-front"])
    if front:
        along = np.array([1000 * _share(p.x, across) for p in front])
        height = np.array([svg.FULL * (1 - _share(p.y, up)) for p in front])
        parts.append(svg.band(TOP, HEIGHT, 1000, [svg.curve(along, height, "front")]))
    for p in places:
        parts.append(svg.tag(
            "circle", cx=f"{100 * _share(p.x, across):.2f}%",
            cy=TOP + HEIGHT * (1 - _share(p.y, up)), r=p.radius, class_=f"point {p.kind}",
        ))  # fmt: skip
    return svg.figure(parts, height=bottom + 38, label=label, kind="golden")


def _edge(places: list[Place]) -> list[Place]:
    """Those that none of the others beats in both, from the least x on."""
    kept: list[Place] = []
    for place in sorted(places, key=lambda p: (p.x, p.y)):
        if not kept or place.y < kept[-1].y:
            kept.append(place)
    return kept


def _scale(values: list[float]) -> tuple[float, float]:
    low, high = min(values), max(values)
    free = AROUND * (high - low) or 0.05 * abs(high) or 1.0
    return low - free, high + free


def _share(value: float, scale: tuple[float, float]) -> float:
    return (value - scale[0]) / (scale[1] - scale[0])


def _words(mark: float) -> str:
    return number(round(mark)) if abs(mark) >= 1e4 else f"{round(mark, 9) + 0.0:.6g}"
