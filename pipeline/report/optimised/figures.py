"""Figures of an optimised program: load along the path, F and S by block, time and cost, front."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import get_args

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import as_stated, number
from pipeline.charts.sections import Figures, drawing
from pipeline.charts.sources import Source
from pipeline.report.cut.tables import sentence
from pipeline.report.optimised.tables import KEPT, by_line, limit_name
from pipeline.report.programs.panels import WIDE, Panel, Spans, tool_spans
from pipeline.schema.part import (
    BlockGroup,
    FrontMember,
    LoadTrace,
    MethodResult,
    OptimisedPart,
    Totals,
)
from pipeline.schema.part_sheet import FeedUnit

TOP, HEIGHT, GAP = 42, 130, 34  # px: head, panel, between
MOST = 450  # columns; the highest load of each is drawn
FAR = 10_000.0  # mm from which a path length is given in metres

LOAD_LEGEND = [("s-before", "as programmed", "box"), ("s-after", "optimised", "box")]
OVER_LEGEND = ("s-over", "above the limit", "box")
BLOCK_TOP, BLOCK_HEIGHT, BLOCK_GAP = 24, 110, 30  # px: head, a panel, between panels
LANE, BAR = 31, 10  # px: of what binds: a lane with its name, the bar in it
UNITS = 1000  # across a viewport
STEPS = 700  # places along a panel, at most
PAIRS = 60  # pairs of columns, at most
FEED_UNITS = get_args(FeedUnit)
WORDS_LEGEND = [
    ("l-before", "as programmed", "line"),
    ("l-after", "optimised", "line"),
    ("s-after", "holds the block back", "box"),
]
FRONT_TOP, FRONT_HEIGHT = 26, 250  # px
AROUND = 0.08  # of the span, free around the points
QUANTITIES = {
    "time_s": "Time, s", "cost": "Cost", "energy_kWh": "Energy, kWh",
    "tool_life_share": "Tool life used, share",
}  # fmt: skip
FRONT_LEGEND = [
    ("p-front", "front: no other is better in all", "dot"),
    ("p-knee", "its knee", "dot"),
    ("p-after", "the answer", "dot"),
]
METHODS_LEGEND = [("p-before", "as programmed", "dot"), ("p-naive", "other methods", "dot")]


@dataclass(frozen=True, kw_only=True)
class PathLoad:
    """Highest load of N columns of equal path length [N], NaN in air; line where each begins."""

    total: float
    load: np.ndarray
    line: np.ndarray


def path_load(trace: LoadTrace) -> PathLoad | None:
    """The load along the path before or after; None where there is none to draw."""
    way, load, line = (
        np.array(values, dtype=np.float64) for values in (trace.way_mm, trace.load_N, trace.line)
    )
    total = trace.total_mm
    if not len(way) == len(load) == len(line) or np.isnan(load).all() or total <= 0:
        return None
    many = min(MOST, len(load))
    place = np.clip((way / total * many + 1e-9).astype(int), 0, many - 1)
    high = np.full(many, np.nan)
    np.fmax.at(high, place, load)
    first = np.searchsorted(np.maximum.accumulate(place), np.arange(many))
    return PathLoad(total=total, load=high, line=line[np.minimum(first, len(line) - 1)])


def load_figure(
    before: PathLoad, after: PathLoad, limit: float | None,
    tools: Spans, label: str,
) -> Markup:  # fmt: skip
    """Two panels on one scale; what lies above ``limit`` [N] stands out."""
    most = 1.1 * max(float(np.nanmax(before.load)), float(np.nanmax(after.load)), limit or 1e-6)
    upper = Panel(head="Load as programmed, N", top=TOP, height=HEIGHT, most=most)
    lower = Panel(head="Load optimised, N", top=upper.bottom + GAP, height=HEIGHT, most=most)
    parts = [*_path_axis(after, upper.top, lower.bottom), *tool_spans(tools, lower.bottom)]
    for panel, trace, kind in ((upper, before, "s-before"), (lower, after, "s-after")):
        parts += [*panel.frame(), _columns(panel, trace, limit, kind)]
        if limit is not None:
            parts.append(svg.across(panel.y(limit), "limit"))
            parts.append(svg.text(100, panel.top - 7, f"limit {as_stated(limit)} N", "name end"))
    return svg.figure(parts, height=lower.bottom + 54, label=label, kind="golden")


def load_figures(part: OptimisedPart, sources: list[Source]) -> Figures | None:
    """Load along the path before and after, with its legend; None where there is none to draw."""
    trace, limit = part.trace, part.load_limit_N
    before, after = path_load(trace.before), path_load(trace.after)
    if before is None or after is None:
        return None
    words = f"Load along the path of {part.program}, as programmed and optimised"
    caption = (
        "Highest force on the tool in the plane over the path at feed; the path is the same "
        "before and after, so that what stands below each other is the same place of the part."
    )
    legend = LOAD_LEGEND if limit is None else [*LOAD_LEGEND, OVER_LEGEND]
    return drawing(load_figure(before, after, limit, trace.tools, words), caption, sources, legend)


def _columns(panel: Panel, trace: PathLoad, limit: float | None, kind: str) -> Markup:
    low = np.zeros(len(trace.load))
    drawn = [panel.columns(low, trace.load, kind)]
    if limit is not None:
        over = np.where(trace.load > limit, trace.load, np.nan)
        drawn.append(panel.columns(np.full(len(low), limit), over, "s-over"))
    return panel.band(drawn, len(low))


def _path_axis(trace: PathLoad, top: float, bottom: float) -> list[Markup]:
    """Path length along the bottom, and below it the lines of the program."""
    far = trace.total >= FAR
    unit, name = (1e3, "m") if far else (1.0, "mm")
    parts = [
        svg.text(
            50, bottom + 48, f"Path at feed, {name}; below it the line of the program", "tick mid"
        )
    ]
    for mark in svg.ticks(0.0, trace.total / unit, most=4):
        x = 100 * mark * unit / trace.total
        line = trace.line[min(int(x / 100 * len(trace.line)), len(trace.line) - 1)]
        parts.append(svg.down(x, top, bottom))
        parts.append(svg.text(x, bottom + 16, f"{round(mark, 6) + 0.0:g}", svg.anchor(x)))
        if np.isfinite(line):
            parts.append(svg.text(x, bottom + 31, f"{line:.0f}", svg.anchor(x)))
    return parts


def words_figure(groups: Sequence[BlockGroup], label: str) -> Markup | None:
    """Panels of F and S before and after, a lane for each limit; None without F and S."""
    groups = by_line(groups)
    units = [unit for unit in FEED_UNITS if any(row.feed_unit == unit for row in groups)]
    feeds = [_pair(f"F, {unit}", groups, "feed_{}", unit) for unit in units]
    parts, bottom = _panels([*feeds, _pair("S, rev/min", groups, "speed_{}")], 1.1, _levels)
    if not parts:
        return None
    lanes, bottom = _lanes(groups, bottom + 6)
    behind = _lines(_values(groups, "first_line"), BLOCK_TOP, bottom)
    return svg.figure([*behind, *parts, *lanes], height=bottom + 36, label=label, kind="golden")


def _values(groups: Sequence[BlockGroup], key: str, unit: str = "") -> np.ndarray:
    """Values of one field, NaN where missing or where F has another unit; shape (G,)."""
    known = [getattr(row, key) if unit in ("", row.feed_unit) else None for row in groups]
    return np.array(known, dtype=np.float64)


def _pair(
    head: str, groups: Sequence[BlockGroup], key: str, unit: str = "",
    of: Callable[[np.ndarray], np.ndarray] = np.asarray,
) -> tuple[str, np.ndarray, np.ndarray]:  # fmt: skip
    """Head, values before, values after; ``key`` has {} where it says which."""
    before, after = (of(_values(groups, key.format(w), unit)) for w in ("before", "after"))
    return head, before, after


def _panels(
    pairs: Sequence[tuple[str, np.ndarray, np.ndarray]], room: float,
    drawn: Callable[[Panel, np.ndarray, np.ndarray], Markup],
) -> tuple[list[Markup], float]:  # fmt: skip
    """Panels of (head, before, after), up to ``room`` times the greatest value; their end [px]."""
    top, parts = float(BLOCK_TOP), []
    for head, before, after in pairs:
        most = np.nanmax(np.concatenate([before, after, [0.0]]))
        if most > 0:
            panel = Panel(head=head, top=top, height=BLOCK_HEIGHT, most=room * float(most))
            parts += [*panel.frame(), drawn(panel, before, after)]
            top = panel.bottom + BLOCK_GAP
    return parts, top - BLOCK_GAP


def _levels(panel: Panel, before: np.ndarray, after: np.ndarray) -> Markup:
    curves = [_steps(before, panel.most, "before"), _steps(after, panel.most, "after")]
    return svg.band(panel.top, panel.height, UNITS, curves)


def _steps(values: np.ndarray, most: float, kind: str) -> Markup:
    """A level for each group over its place; lowest and highest of places that are shared."""
    edges = np.arange(len(values) + 1) * float(UNITS) / len(values)
    y = svg.FULL * (1 - values / most)
    if len(values) <= STEPS:
        return svg.curve(np.repeat(edges, 2)[1:-1], np.repeat(y, 2), kind)
    middle = 0.5 * (edges[:-1] + edges[1:])
    return svg.curve(*svg.thinned(middle, y, UNITS / STEPS), kind)


def _lanes(groups: Sequence[BlockGroup], top: float) -> tuple[list[Markup], float]:
    """Lane for each limit, marked where it binds; the most frequent first."""
    binds = [
        KEPT if row.kept else f"{limit_name(row.binds)} binds" if row.binds else ""
        for row in groups
    ]
    names = sorted({word for word in binds if word}, key=lambda word: (-binds.count(word), word))
    parts: list[Markup] = []
    for name in names:
        here = np.array([word == name for word in binds])
        parts.append(svg.text(0, top + 12, sentence(name), "head"))
        parts.append(svg.band(top + 18, BAR, UNITS, [_marks(here)]))
        top += LANE
    return parts, top


def _marks(here: np.ndarray) -> Markup:
    """Boxes over the runs where ``here`` (G,) holds, each at least a line wide."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], here, [False]]).astype(int)))
    starts = np.floor(edges[::2] * UNITS / len(here)).astype(int)
    ends = np.maximum(np.ceil(edges[1::2] * UNITS / len(here)).astype(int), starts + 1)
    runs = zip(starts.tolist(), ends.tolist(), strict=True)
    data = "".join(f"M{a} 0h{b - a}v{svg.FULL}h{a - b}z" for a, b in runs)
    return svg.tag("path", d=data, class_="s-after")


def _lines(first: np.ndarray, top: float, bottom: float) -> list[Markup]:
    """Lines of the program along the bottom: ``first`` of each place, all as wide as each other."""
    parts = [svg.text(50, bottom + 31, "Line of the program", "tick mid")]
    many = len(first)
    for k in dict.fromkeys(int(k) for k in np.linspace(0, many - 1, min(many, 7))):
        if np.isfinite(first[k]):
            x = 100 * k / many
            parts.append(svg.down(x, top, bottom))
            parts.append(svg.text(x, bottom + 16, f"{first[k]:.0f}", svg.anchor(x)))
    return parts


def pairs_figure(
    groups: Sequence[BlockGroup], heads: list[tuple[str, str]], label: str
) -> Markup | None:
    """Panels of columns, before beside after; ``heads`` are (head, key with {})."""
    groups = by_line(groups)
    pairs = [_pair(head, groups, key, of=_sums) for head, key in heads]
    parts, bottom = _panels(pairs, 1.08, _pairs)
    if not parts:
        return None
    first = _values(groups, "first_line")[:: per_pair(len(groups))]
    behind = _lines(first, BLOCK_TOP, bottom)
    return svg.figure([*behind, *parts], height=bottom + 36, label=label, kind="golden")


def per_pair(groups: int) -> int:
    """Groups that one pair of columns sums up."""
    return -(-groups // PAIRS)


def _sums(values: np.ndarray) -> np.ndarray:
    """Sums over as many stretches as are drawn; NaN where a stretch has no value."""
    starts = np.arange(0, len(values), per_pair(len(values)))
    known = np.add.reduceat(np.isfinite(values).astype(int), starts)
    return np.where(known > 0, np.add.reduceat(np.nan_to_num(values), starts), np.nan)


def _pairs(panel: Panel, before: np.ndarray, after: np.ndarray) -> Markup:
    """Three places to a pair: before, after, free; the first and last are not cut off."""
    spread = np.full((2, 3 * len(before)), np.nan)
    spread[0, 0::3], spread[1, 1::3] = before, after
    low = np.zeros(spread.shape[1])
    drawn = [panel.columns(low, values, kind)
             for values, kind in zip(spread, ("s-before", "s-after"), strict=True)]  # fmt: skip
    return svg.band(panel.top, panel.height, WIDE * spread.shape[1], drawn)


@dataclass(frozen=True, kw_only=True)
class Place:
    """A point of the figure and its CSS class; ``radius`` in px."""

    x: float
    y: float
    kind: str
    radius: float = 4.5


def compared(part: OptimisedPart) -> tuple[str, str] | None:
    """The two quantities that the front is drawn in: of those that differ, the most contrary two.

    Contrary are two of which one falls where the other rises, by the correlation of their ranks;
    among equals the first of :data:`QUANTITIES` count.
    """
    ranks: dict[str, np.ndarray] = {}
    for key in QUANTITIES:
        values = [getattr(row, key) for row in part.front]
        known = [v for v in values if v is not None]
        if len(known) == len(part.front) > 0 and max(known) > min(known):
            ranks[key] = np.unique(known, return_inverse=True)[1].astype(np.float64)
    pairs = [(a, b) for k, a in enumerate(ranks) for b in list(ranks)[k + 1 :]]
    if not pairs:
        return None
    return min(pairs, key=lambda pair: round(_correlation(ranks[pair[0]], ranks[pair[1]]), 6))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Correlation of two rows of numbers that are not all the same [1]."""
    a, b = a - a.mean(), b - b.mean()
    return float(a @ b / np.sqrt((a @ a) * (b @ b)))


def front_places(part: OptimisedPart, keys: tuple[str, str]) -> list[Place]:
    """The front with its knee, and the answer."""
    places = []
    for row in part.front:
        places += _places(row, keys, "p-front")
        if row.knee:
            places += _places(row, keys, "p-knee", 8.0)
    return places + _places(part.after, keys, "p-after")


def method_places(part: OptimisedPart, keys: tuple[str, str]) -> list[Place]:
    """The program as it was, and the results of other methods inside the limits."""
    places = []
    for row in part.methods:
        if row.feasible and row.limits == "certain":
            places += _places(row, keys, "p-naive")
    return places + _places(part.before, keys, "p-before")


def _places(
    row: FrontMember | MethodResult | Totals, keys: tuple[str, str], kind: str, radius: float = 4.5
) -> list[Place]:
    x, y = (getattr(row, key) for key in keys)
    return [] if x is None or y is None else [Place(x=x, y=y, kind=kind, radius=radius)]


def front_figure(places: list[Place], heads: tuple[str, str], label: str) -> Markup:
    """The places to two scales of their own; those that are best in these two are joined."""
    across, up = _scale([p.x for p in places]), _scale([p.y for p in places])
    bottom = FRONT_TOP + FRONT_HEIGHT
    parts = [
        svg.text(0, FRONT_TOP - 9, heads[1], "head"),
        svg.text(50, bottom + 33, heads[0], "tick mid"),
    ]
    for mark in svg.ticks(*across, most=5):
        x = 100 * _share(mark, across)
        parts += [
            svg.down(x, FRONT_TOP, bottom),
            svg.text(x, bottom + 16, _tick(mark), svg.anchor(x)),
        ]
    for mark in svg.ticks(*up, most=5):
        y = FRONT_TOP + FRONT_HEIGHT * (1 - _share(mark, up))
        parts += [svg.across(y), svg.text(0, y + 4, _tick(mark), "tick end", dx=-6)]
    front = _edge([p for p in places if p.kind == "p-front"])
    if front:
        along = np.array([1000 * _share(p.x, across) for p in front])
        height = np.array([svg.FULL * (1 - _share(p.y, up)) for p in front])
        parts.append(svg.band(FRONT_TOP, FRONT_HEIGHT, 1000, [svg.curve(along, height, "front")]))
    for p in places:
        parts.append(svg.tag(
            "circle", cx=f"{100 * _share(p.x, across):.2f}%",
            cy=FRONT_TOP + FRONT_HEIGHT * (1 - _share(p.y, up)), r=p.radius,
            class_=f"point {p.kind}",
        ))  # fmt: skip
    return svg.figure(parts, height=bottom + 38, label=label, kind="golden")


def _edge(places: list[Place]) -> list[Place]:
    """Places that none of the others beats in both, from the least x on."""
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


def _tick(mark: float) -> str:
    return number(round(mark)) if abs(mark) >= 1e4 else f"{round(mark, 9) + 0.0:.6g}"
