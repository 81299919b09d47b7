"""F and S by block, what binds them, and the time and cost of blocks, before and after."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import real
from pipeline.charts.svg import anchor
from pipeline.report.cut_panel import WIDE, Panel
from pipeline.report.optimise_words import limit_name

TOP, HEIGHT, GAP = 24, 110, 30  # px: head, a panel, between panels
LANE, BAR = 31, 10  # px: of what binds: a lane with its name, the bar in it
UNITS = 1000  # across a viewport
STEPS = 700  # places along a panel, at most
PAIRS = 60  # pairs of columns, at most
FEED_UNITS = ("mm/min", "mm/rev")

WORDS_LEGEND = [
    ("l-before", "as programmed", "line"),
    ("l-after", "optimised", "line"),
    ("s-after", "holds the block back", "box"),
]
PAIR_LEGEND = [("s-before", "as programmed", "box"), ("s-after", "optimised", "box")]


@dataclass(frozen=True, kw_only=True)
class Blocks:
    """G groups of blocks, in the order of the program."""

    rows: list[dict[str, Any]]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, key: str) -> np.ndarray:
        """Values of one key, NaN where not known; shape (G,)."""
        found = [real(row.get(key)) for row in self.rows]
        return np.array([np.nan if v is None else v for v in found], dtype=np.float64)

    def only(self, key: str, keep: Callable[[dict[str, Any]], bool]) -> np.ndarray:
        """The same with NaN in rows that are not kept."""
        kept = np.array([keep(row) for row in self.rows], dtype=bool)
        return np.where(kept, self.column(key), np.nan)


def words_figure(blocks: Blocks, label: str) -> Markup | None:
    """Panels of F and S before and after, and a lane for each limit that binds.

    None where neither F nor S is known of any group.
    """
    shown = [
        (f"F, {unit}", f"feed_{{}}@{unit}") for unit in FEED_UNITS
        if any(row.get("feed_unit") == unit for row in blocks.rows)
    ]  # fmt: skip
    top, parts = float(TOP), []
    for head, key in [*shown, ("S, rev/min", "speed_{}")]:
        pair = [_values(blocks, key.format(which)) for which in ("before", "after")]
        known = np.concatenate(pair)[np.isfinite(np.concatenate(pair))]
        if not len(known) or known.max() <= 0:
            continue
        panel = Panel(head=head, top=top, height=HEIGHT, most=1.1 * float(known.max()))
        curves = [_steps(values, panel.most, kind)
                  for values, kind in zip(pair, ("before", "after"), strict=True)]  # fmt: skip
        parts += [*panel.frame(), svg.band(panel.top, panel.height, UNITS, curves)]
        top = panel.bottom + GAP
    if not parts:
        return None
    lanes, bottom = _lanes(blocks, top - GAP + 6)
    behind = _lines(blocks.column("first_line"), TOP, bottom)
    return svg.figure([*behind, *parts, *lanes], height=bottom + 36, label=label, kind="golden")


def _values(blocks: Blocks, key: str) -> np.ndarray:
    name, _, unit = key.partition("@")
    return blocks.only(name, lambda row: not unit or row.get("feed_unit") == unit)


def _steps(values: np.ndarray, most: float, kind: str) -> Markup:
    """A level for each group over its place; lowest and highest of places that are shared."""
    edges = np.arange(len(values) + 1) * float(UNITS) / len(values)
    y = svg.FULL * (1 - values / most)
    if len(values) <= STEPS:
        return svg.curve(np.repeat(edges, 2)[1:-1], np.repeat(y, 2), kind)
    middle = 0.5 * (edges[:-1] + edges[1:])
    return svg.curve(*svg.thinned(middle, y, UNITS / STEPS), kind)


def _lanes(blocks: Blocks, top: float) -> tuple[list[Markup], float]:
    """One lane for each limit: where it binds, the most frequent first."""
    binds = [limit_name(row["binds"]) if row.get("binds") else "" for row in blocks.rows]
    names = sorted({word for word in binds if word}, key=lambda word: (-binds.count(word), word))
    parts: list[Markup] = []
    for name in names:
        here = np.array([word == name for word in binds])
        parts.append(svg.text(0, top + 12, f"{_capital(name)} binds", "head"))
        parts.append(svg.band(top + 18, BAR, UNITS, [_marks(here)]))
        top += LANE
    return parts, top


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _marks(here: np.ndarray) -> Markup:
    """Boxes over the runs where ``here`` (G,) holds, each at least a line wide."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], here, [False]]).astype(int)))
    starts = np.floor(edges[::2] * UNITS / len(here)).astype(int)
    ends = np.maximum(np.ceil(edges[1::2] * UNITS / len(here)).astype(int), starts + 1)
    data = "".join(
        f"M{a} 0h{b - a}v{svg.FULL}h{a - b}z"
        for a, b in zip(starts.tolist(), ends.tolist(), strict=True)
    )
    return svg.tag("path", d=data, class_="s-after")


def _lines(first: np.ndarray, top: float, bottom: float) -> list[Markup]:
    """Lines of the program along the bottom: ``first`` of each place, all as wide as each other."""
    parts = [svg.text(50, bottom + 31, "Line of the program", "tick mid")]
    many = len(first)
    for k in dict.fromkeys(int(k) for k in np.linspace(0, many - 1, min(many, 7))):
        if np.isfinite(first[k]):
            x = 100 * k / many
            parts.append(svg.down(x, top, bottom))
            parts.append(svg.text(x, bottom + 16, f"{first[k]:.0f}", anchor(x)))
    return parts


def pairs_figure(blocks: Blocks, heads: list[tuple[str, str]], label: str) -> Markup | None:
    """Panels of columns, before beside after; ``heads`` are (head, key with {})."""
    top, parts = float(TOP), []
    for head, key in heads:
        before, after = (_sums(blocks.column(key.format(w))) for w in ("before", "after"))
        known = np.concatenate([before, after])
        known = known[np.isfinite(known)]
        if not len(known) or known.max() <= 0:
            continue
        panel = Panel(head=head, top=top, height=HEIGHT, most=1.08 * float(known.max()))
        parts += [*panel.frame(), _pairs(panel, before, after)]
        top = panel.bottom + GAP
    if not parts:
        return None
    bottom = top - GAP
    first = blocks.column("first_line")[:: per_pair(len(blocks))]
    behind = _lines(first, TOP, bottom)
    return svg.figure([*behind, *parts], height=bottom + 36, label=label, kind="golden")


def per_pair(groups: int) -> int:
    """Groups that one pair of columns sums up."""
    return -(-groups // PAIRS)


def _sums(values: np.ndarray) -> np.ndarray:
    """Sums over as many stretches as are drawn; NaN where nothing of a stretch is known."""
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
