"""Bands of a figure: values over pixels, their curves; strips below one another over one axis."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.schema.arrays import Floats

UNITS = 2000
"""Units across a band's viewport [1]."""
STRETCHES = 420
"""Stretches of the x axis, each drawn by its lowest and highest value [1]."""
MARK_APART = 1.5
"""Distance between values beyond a scale, over which each has a mark of its own [% of width]."""
TOP, GAP = 18, 28
"""Height of a head above the first strip, and between two strips [px]."""
MOST = 1e12
"""Greatest magnitude, in any unit of the shop, that is a reading [1]."""


@dataclass(frozen=True, kw_only=True)
class Band:
    """A part of a figure with its own values."""

    top: float
    height: float
    """Place of the band [px]."""
    low: float
    high: float
    """Values at its bottom and its top."""

    @property
    def bottom(self) -> float:
        """Lower end [px]."""
        return self.top + self.height

    def pixel(self, value: float) -> float:
        """Position of a value [px]; beyond the band at its edge."""
        share = (self.high - min(max(value, self.low), self.high)) / (self.high - self.low)
        return self.top + self.height * share

    def down(self, values: Floats) -> Floats:
        """Values (T,) as heights of the viewport, from its top, within it."""
        inside = np.clip(values, self.low, self.high)
        return svg.FULL * (self.high - inside) / (self.high - self.low)

    def levels(self, most: int = 4) -> list[Markup]:
        """Lines and words at round values."""
        parts = []
        for mark in svg.ticks(self.low, self.high, most=most):
            y = self.pixel(mark)
            kind = "grid zero" if mark == 0 and self.low < 0 else "grid"
            parts += [svg.across(y, kind), svg.text(0, y + 4, tick_words(mark), "tick end", dx=-6)]
        return parts

    def content(self, parts: list[Markup]) -> Markup:
        """Curves in the viewport of this band."""
        return svg.band(self.top, self.height, UNITS, parts)


def band(top: float, height: float, *values: Floats, zero: bool = False) -> Band:
    """Band wide enough for all ``values`` but NaN, and for 0 where ``zero`` says so."""
    every = np.concatenate([*values, [0.0] if zero else []])
    every = every[np.isfinite(every)]
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    pad = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
    return Band(top=top, height=height, low=low - pad, high=high + pad)


def line(seconds: Floats, values: Floats, span: tuple[float, float], into: Band,
         kind: str) -> Markup:  # fmt: skip
    """A curve over the part ``span`` [s] of the time, thinned to what a page can show."""
    here = (seconds >= span[0]) & (seconds <= span[1])
    x = UNITS * (seconds[here] - span[0]) / max(span[1] - span[0], 1e-12)
    y = values[here]
    if len(x) > 2 * STRETCHES:
        x, y = svg.thinned(x, y, UNITS / STRETCHES)
    return svg.curve(x, into.down(y), kind)


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """Values that a band's scale does not reach."""

    marks: list[Markup]
    """Their marks."""
    ends: dict[bool, float]
    """Highest value above the scale under True, lowest below it under False, where there are."""


def beyond(across: Floats, values: Floats, into: Band, unit: str) -> Beyond:
    """Triangles at the band's edge above or below values (T,) that lie beyond its scale.

    Values that would share a triangle are one, with the farthest of them on hover; ``across`` (T,)
    are their places along the width, ascending [%].
    """
    marks: list[Markup] = []
    ends: dict[bool, float] = {}
    for up, where in ((True, values > into.high), (False, values < into.low)):
        farthest = np.argmax if up else np.argmin
        if where.any():
            ends[up] = float(values[where][farthest(values[where])])
        places = np.flatnonzero(where & np.isfinite(across))
        for near in np.split(places, np.flatnonzero(np.diff(across[places]) > MARK_APART) + 1):
            if len(near):
                worst = near[farthest(values[near])]
                marks.append(_triangle(float(across[worst]), float(values[worst]), into, unit, up))
    return Beyond(marks=marks, ends=ends)


def _triangle(x: float, value: float, into: Band, unit: str, up: bool) -> Markup:
    """A triangle that points out of the band at ``x`` [%]; ``value`` stands in its title."""
    edge, way = (into.top, -1) if up else (into.bottom, 1)
    shape = svg.tag("path", d=f"M-5 0h10l-5 {7 * way}z")
    words = f"beyond the scale: {tick_words(round(value, 2))} {unit}".rstrip()
    return svg.tag(
        "svg", svg.group([svg.tag("title", words), shape]),
        x=f"{x:.2f}%", y=edge, class_="beyond", overflow="visible",
    )  # fmt: skip


def beyond_words(outside: Sequence[Beyond], unit: str) -> str:
    """Words of a head on the marks of :func:`beyond`; empty where nothing lies beyond."""
    words = ""
    for up, mark, farthest in ((True, "▲ above, up to", max), (False, "▼ below, down to", min)):
        if ends := [one.ends[up] for one in outside if up in one.ends]:
            words += f"; {mark} {tick_words(float(f'{farthest(ends):.4g}'))} {unit}".rstrip()
    return words


def tick_words(mark: float) -> str:
    """A tick's words, with a real minus and without one before 0."""
    return f"{mark + 0.0:.6g}".replace("-", "−")


def readings(values: Floats) -> Floats:
    """Values (T,) with NaN where they are infinite or beyond :data:`MOST`."""
    with np.errstate(invalid="ignore"):
        known: Floats = np.where(np.abs(values) <= MOST, values, np.nan)
    return known


def area(x: Floats, low: Floats, high: Floats, span: tuple[float, float], into: Band,
         kind: str) -> Markup:  # fmt: skip
    """The area between two curves (T,), thinned to what a page can show; broken where unknown."""
    known = np.isfinite(low) & np.isfinite(high) & (x >= span[0]) & (x <= span[1])
    parts = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        across = UNITS * (x[start:end] - span[0]) / max(span[1] - span[0], 1e-12)
        first = np.flatnonzero(np.diff(np.floor(across).astype(int) // 4, prepend=-1))
        if len(across) <= 2 * STRETCHES:
            first = np.arange(len(across))
        top = into.down(np.maximum.reduceat(high[start:end], first))
        bottom = into.down(np.minimum.reduceat(low[start:end], first))
        there = np.concatenate([across[first], across[first][::-1]])
        parts.append(svg.path_data(there, np.concatenate([top, bottom[::-1]])) + "z")
    return svg.tag("path", d="".join(parts), class_=kind)


@dataclass(frozen=True, kw_only=True)
class Block:
    """Filled part of a strip from ``start`` to ``end`` of its axis, ``words`` on hover.

    ``lane`` is the row of the strip that it lies in, counted from the top; None for all of them.
    """

    kind: str
    start: float
    end: float
    words: str
    lane: int | None = None


@dataclass(frozen=True, kw_only=True)
class Strip:
    """A band of a figure as it is declared: its head, and what is drawn in it over the axis."""

    head: str
    curves: Sequence[tuple[str, Floats, Floats]] = ()
    """CSS class, places and values (T,) of each curve; NaN lifts the pen."""
    areas: Sequence[tuple[str, Floats, Floats, Floats]] = ()
    """CSS class, places, lower and upper ends (T,) of each area."""
    dots: Sequence[tuple[str, Floats, Floats]] = ()
    """CSS class, places and values (N,) of each kind of dot."""
    levels: Sequence[float] = ()
    """Values that a line marks, such as limits."""
    height: float = 140.0
    """Height [px]."""
    scale: tuple[float, float] | None = None
    """Least and greatest value of the scale; None where it holds all that is drawn."""
    zero: bool = False
    """Whether the scale holds 0."""
    unit: str = ""
    """Unit of values beyond the scale."""
    blocks: Sequence[Block] = ()
    lanes: Sequence[str] = ()
    """Filled parts, and the names of the rows that they lie in."""

    def band(self, top: float, span: tuple[float, float]) -> Band:
        """Band at ``top`` [px] that holds what lies within ``span`` of the axis."""
        if self.scale is not None:
            return Band(top=top, height=self.height, low=self.scale[0], high=self.scale[1])
        every = [(x, y) for _, x, y in (*self.curves, *self.dots)]
        every += [(x, y) for _, x, low, high in self.areas for y in (low, high)]
        inside = [y[(x >= span[0]) & (x <= span[1])] for x, y in every]
        return band(top, self.height, *inside, np.array(self.levels), zero=self.zero)


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Axis below the strips of a figure: its words, its ends, its marks in words."""

    words: str
    span: tuple[float, float]
    marks: Sequence[tuple[float, str]]
    shaded: Sequence[tuple[float, float]] = ()
    """Stretches that stand apart, such as weekends."""

    def percent(self, x: Floats) -> Floats:
        """Places (T,) along the width [%]."""
        return 100 * (x - self.span[0]) / max(self.span[1] - self.span[0], 1e-12)


def axis(words: str, span: tuple[float, float], most: int = 6) -> Axis:
    """An axis with marks at round values."""
    marks = [(mark, tick_words(mark)) for mark in svg.ticks(*span, most=most)]
    return Axis(words=words, span=span, marks=marks)


def decades(words: str, span: tuple[float, float]) -> Axis:
    """An axis of logarithms to the base of 10 between two of them."""
    steps = (1,) if span[1] - span[0] > 3.5 else (1, 2, 5)
    every = [f * 10.0**d for d in range(int(np.floor(span[0])), int(np.ceil(span[1])) + 1)
             for f in steps]  # fmt: skip
    inside = [one for one in every if span[0] - 1e-4 <= np.log10(one) <= span[1] + 1e-4]
    marks = [(float(np.log10(one)), tick_words(one)) for one in inside]
    return Axis(words=words, span=span, marks=marks)


def strips_figure(strips: Sequence[Strip], below: Axis, label: str, kind: str = "trace") -> Markup:
    """Strips below one another over one axis; ``label`` says in words what they show."""
    parts: list[Markup] = []
    top = float(TOP)
    for one in strips:
        into = one.band(top, below.span)
        parts += _strip(one, into, below)
        top = into.bottom + GAP
    bottom = top - GAP
    across = [
        svg.bar(*_span(below, first, last), TOP, bottom - TOP, "s-apart")
        for first, last in below.shaded
    ]
    across.append(svg.text(50, bottom + 31, below.words, "tick mid"))
    for mark, words in below.marks:
        x = float(below.percent(np.array(mark)))
        across += [svg.down(x, TOP, bottom), svg.text(x, bottom + 16, words, svg.anchor(x))]
    return svg.figure([*across, *parts], height=bottom + 36, label=label, kind=kind)


def _span(below: Axis, first: float, last: float) -> tuple[float, float]:
    """Place and width of a stretch of the axis [% of width]."""
    left, right = np.clip(below.percent(np.array([first, last])), 0, 100)
    return float(left), max(float(right - left), 0.15)


def _blocks(one: Strip, into: Band, below: Axis) -> list[Markup]:
    """Filled parts with their words on hover, and the names of the rows."""
    rows = max(len(one.lanes), 1)
    high = one.height / rows
    drawn = []
    for block in one.blocks:
        top, height = into.top, one.height
        if block.lane is not None:
            top, height = into.top + block.lane * high + 1, high - 2
        bar = svg.bar(*_span(below, block.start, block.end), top, height, block.kind)
        drawn.append(svg.tag("g", svg.group([svg.tag("title", block.words), bar])))
    names = [svg.text(0, into.top + (k + 0.5) * high + 4, name, "tick end", dx=-8)
             for k, name in enumerate(one.lanes)]  # fmt: skip
    return [*drawn, *names]


def _strip(one: Strip, into: Band, below: Axis) -> list[Markup]:
    seen = [(x, y, (x >= below.span[0]) & (x <= below.span[1]))
            for _, x, y in (*one.curves, *one.dots)]  # fmt: skip
    outside = [beyond(below.percent(x[here]), y[here], into, one.unit) for x, y, here in seen]
    dots = [
        svg.tag("circle", cx=f"{at:.2f}%", cy=into.pixel(float(value)), r=3.5,
                class_=f"point {kind}")
        for kind, x, y in one.dots
        for at, value in zip(below.percent(x), y, strict=True)
        if 0 <= at <= 100 and np.isfinite(value)
    ]  # fmt: skip
    most = 5 if into.height >= 100 else 4 if into.height >= 60 else 3
    return [
        svg.text(0, into.top - 7, f"{one.head}{beyond_words(outside, one.unit)}", "head"),
        *(into.levels(most) if one.curves or one.areas or one.dots else ()),
        *(svg.across(into.pixel(level), "grid limit") for level in one.levels),
        into.content([
            *(area(x, low, high, below.span, into, kind) for kind, x, low, high in one.areas),
            *(line(x, y, below.span, into, kind) for kind, x, y in one.curves),
        ]),
        *dots,
        *(mark for found in outside for mark in found.marks),
        *_blocks(one, into, below),
    ]  # fmt: skip
