"""Small SVG figures that stretch with the page while their text keeps its size.

Positions along x are percent of the width, positions along y are pixels; curves live in nested
viewports that are stretched without stretching their lines.  Colours are CSS classes, so the
figures follow the page's theme.  All text is escaped.
"""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup, escape

MOST_TICKS = 8  # that are tried for so that there are two
FULL = 1000  # height of a curve's viewport, in its own units


def tag(name: str, content: str | Markup = "", **attributes: str | float | None) -> Markup:
    """SVG element; ``class_`` is written ``class`` and ``_`` in names becomes ``-``."""
    parts = [
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), _short(value))
        for key, value in attributes.items() if value is not None
    ]  # fmt: skip
    return Markup("<{0}{1}>{2}</{0}>").format(name, Markup("").join(parts), escape(content))


def _short(value: str | float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if isinstance(value, float) else str(value)


def group(parts: list[Markup]) -> Markup:
    """Elements one after the other."""
    return Markup("").join(parts)


def figure(parts: list[Markup], *, height: float, label: str, kind: str = "") -> Markup:
    """A whole figure, as wide as its place; ``label`` says in words what it shows."""
    return tag(
        "svg",
        group(parts),
        class_=f"plot {kind}".strip(),
        role="img",
        aria_label=label,
        height=height,
        width="100%",
        xmlns="http://www.w3.org/2000/svg",
    )


def map_plot(parts: list[Markup], *, wide: float, most: float, label: str) -> Markup:
    """A figure whose height follows from its width, ``wide`` times the height: x and y alike.

    ``most`` is its greatest width [rem], so that a square is not as high as a page.
    """
    return tag(
        "svg",
        group(parts),
        class_="plot map",
        role="img",
        aria_label=label,
        style=f"--wide:{wide:.4f};--most:{most:.2f}rem",
        width="100%",
        xmlns="http://www.w3.org/2000/svg",
    )


def text(x: float, y: float, words: str | Markup, kind: str = "", dx: float = 0) -> Markup:
    """Words at ``x`` percent and ``y`` pixels; ``kind`` holds their CSS classes."""
    return tag("text", words, x=f"{_short(float(x))}%", y=float(y), dx=dx or None, class_=kind)


def across(y: float, kind: str = "grid") -> Markup:
    """A line over the whole width."""
    return tag("line", x1=0, x2="100%", y1=float(y), y2=float(y), class_=kind)


def down(x: float, y1: float, y2: float, kind: str = "grid") -> Markup:
    """A vertical line at ``x`` percent."""
    at = f"{_short(float(x))}%"
    return tag("line", x1=at, x2=at, y1=float(y1), y2=float(y2), class_=kind)


def bar(x: float, width: float, y: float, height: float, kind: str) -> Markup:
    """A filled bar; ``x`` and ``width`` in percent."""
    return tag(
        "rect", x=f"{x:.2f}%", width=f"{width:.2f}%", y=float(y), height=float(height), class_=kind
    )


def band(y: float, height: float, width_units: int, content: list[Markup]) -> Markup:
    """A viewport over the whole width, ``width_units`` wide and ``FULL`` high inside."""
    return tag(
        "svg", group(content), x=0, y=float(y), width="100%", height=float(height),
        viewBox=f"0 0 {width_units} {FULL}", preserveAspectRatio="none",
    )  # fmt: skip


def curve(x: np.ndarray, y: np.ndarray, kind: str) -> Markup:
    """A polyline through integer points (T,); NaN in ``y`` lifts the pen."""
    return tag("path", d=path_data(x, y), class_=f"curve {kind}")


def path_data(x: np.ndarray, y: np.ndarray) -> str:
    """Relative path data through (x, y) rounded to integers, straight stretches merged."""
    parts: list[str] = []
    good = np.isfinite(y) & np.isfinite(x)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        points = _corners(np.rint(np.stack([x[start:end], y[start:end]], axis=1)).astype(int))
        steps = np.diff(points, axis=0)
        parts.append(f"M{points[0, 0]} {points[0, 1]}")
        if len(steps):
            parts.append("l" + " ".join(f"{a} {b}" for a, b in steps.tolist()))
        else:
            parts.append("h1")  # a single known value is a dot, not nothing
    return "".join(parts)


def _corners(points: np.ndarray) -> np.ndarray:
    """Points (T, 2) without those in the middle of a horizontal stretch."""
    if len(points) < 3:
        return points
    flat = (points[1:-1, 1] == points[:-2, 1]) & (points[1:-1, 1] == points[2:, 1])
    return points[np.concatenate([[True], ~flat, [True]])]


def thinned(x: np.ndarray, y: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest point (T',) of each stretch of ``width`` along ``x`` (T,) ascending.

    Extremes survive; a stretch without a known value becomes one NaN, so that gaps stay visible.
    """
    place = np.floor(x / width).astype(int)
    kept_x, kept_y = [], []
    edges = np.flatnonzero(np.diff(place)) + 1
    for part in np.split(np.arange(len(x)), edges):
        good = part[np.isfinite(y[part])] if len(part) else part
        if len(good) == 0:
            kept_x.append(float(x[part[0]]) if len(part) else 0.0)
            kept_y.append(np.nan)
            continue
        for i in sorted({int(good[np.argmin(y[good])]), int(good[np.argmax(y[good])])}):
            kept_x.append(float(x[i]))
            kept_y.append(float(y[i]))
    return np.array(kept_x), np.array(kept_y)


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round values from ``low`` to ``high``, at most ``most``, more where one would stand alone."""
    span = max(high - low, 1e-9)
    step = 10.0 ** np.floor(np.log10(span / most))
    for factor in (1, 2, 2.5, 5, 10):
        if span / (step * factor) <= most:
            step *= factor
            break
    first = np.ceil(low / step - 1e-9)
    found = [float(v * step) for v in np.arange(first, np.floor(high / step + 1e-9) + 1)]
    return found if len(found) > 1 or most >= MOST_TICKS else ticks(low, high, most=most + 1)


def sparkline(values: Sequence[float], words: str) -> Markup:
    """A curve of a word's size with a dot at its newest value; NaN lifts the pen."""
    y = np.array(values, float)
    known = y[np.isfinite(y)]
    low, high = (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)
    x = np.linspace(2, 70, max(len(y), 2))[: len(y)]
    down_to = 14 - 12 * (y - low) / (high - low or 1.0)
    dot = [tag("circle", cx=float(x[-1]), cy=float(down_to[-1]), r=2)] * bool(
        len(y) and np.isfinite(y[-1]))  # fmt: skip
    return tag(
        "svg", group([tag("title", words), curve(x, down_to, "measured"), *dot]), class_="spark",
        viewBox="0 0 72 16", width=72, height=16, role="img", aria_label=words,
    )  # fmt: skip


def anchor(x: float) -> str:
    """CSS classes of a tick's words at ``x`` percent: inside the figure at both ends."""
    return "tick" if x == 0 else "tick end" if x >= 100 else "tick mid"
