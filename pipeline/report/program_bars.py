"""Where a program's time goes: by tool, by type of block, by what bounds the speed."""

from dataclasses import dataclass
from typing import Any

from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import counted, duration, percent, real
from pipeline.charts.sources import dig, rows_of

ROW, HEAD, GAP = 21, 24, 14  # px: a bar, the head above a group, between groups
FILL = 66.0  # percent of the width that the longest bar takes; its time stands beside it
MOST = 10  # bars in a group; the rest are one

LIMITS = {
    "feed": "programmed feed",
    "axis speed": "axis speed",
    "acceleration": "acceleration",
    "corner": "corners",
    "arc": "arcs",
    "tolerance": "path tolerance",
    "exact stop": "exact stops",
    "curve": "curves made of chords",
    "rapid": "rapid speed",
    "jerk": "jerk",
    "spindle": "spindle",
    "nothing": "nothing: it stands",
}
"""What binds the speed of a block, for people."""

TYPE_KIND = {"rapid": "s-rapid", "feed": "s-cut", "arc": "s-cut"}
LIMIT_KIND = {"feed": "s-cut", "rapid": "s-rapid", "spindle": "s-still", "nothing": "s-still"}


@dataclass(frozen=True, kw_only=True)
class Bar:
    """One bar: its name, and parts of (seconds, CSS class)."""

    name: str
    parts: list[tuple[float, str]]

    @property
    def seconds(self) -> float:
        """Length of the whole bar [s]."""
        return sum(seconds for seconds, _ in self.parts)


Group = tuple[str, list[Bar]]
"""A head and the bars below it."""


def limit_seconds(document: dict[str, Any]) -> dict[str, float]:
    """Time [s] by what bounds the speed of a block, only what takes any."""
    return _seconds(dig(document, "by_limit"))


def _seconds(times: Any) -> dict[str, float]:
    if not isinstance(times, dict):
        return {}
    known = ((str(name).replace("_", " ").lower(), real(value)) for name, value in times.items())
    return {name: value for name, value in known if value is not None and value > 0}


def limit_bars(document: dict[str, Any]) -> list[Group]:
    """Time by what bounds the speed of a block, the longest bar first."""
    bars = [
        Bar(name=limit_words(name), parts=[(seconds, LIMIT_KIND.get(name, "s-lost"))])
        for name, seconds in limit_seconds(document).items()
    ]
    return _present([("What bounds the speed", bars)])


def tool_and_type_bars(document: dict[str, Any]) -> list[Group]:
    """Time by tool and by type of block, the longest bar first."""
    tools = [_tool_bar(row) for row in rows_of(document, "by_tool")]
    types = [
        Bar(name=name, parts=[(seconds, TYPE_KIND.get(name, "s-still"))])
        for name, seconds in _seconds(dig(document, "by_type")).items()
    ]
    return _present([("By tool", tools), ("By type of block", types)])


def _present(groups: list[Group]) -> list[Group]:
    return [(head, _shortened(bars)) for head, bars in groups if any(b.seconds > 0 for b in bars)]


def limit_words(name: str) -> str:
    """What bounds the speed, in words; its own name when it is not known here."""
    return LIMITS.get(name, name)


def _tool_bar(row: dict[str, Any]) -> Bar:
    whole, cut, rapid = (
        max(0.0, real(row.get(k)) or 0.0) for k in ("time_s", "cutting_s", "rapid_s")
    )
    number = row.get("tool")
    known = isinstance(number, int) and number >= 0
    return Bar(
        name=f"T{number}" if known else "before a tool",
        parts=[(cut, "s-cut"), (rapid, "s-rapid"), (max(0.0, whole - cut - rapid), "s-still")],
    )


def _shortened(bars: list[Bar]) -> list[Bar]:
    found = sorted((b for b in bars if b.seconds > 0), key=lambda b: (-b.seconds, b.name))
    rest = found[MOST - 1 :]
    if len(rest) < 2:
        return found
    kinds = list(dict.fromkeys(kind for b in rest for _, kind in b.parts))
    sums = [(sum(s for b in rest for s, k in b.parts if k == kind), kind) for kind in kinds]
    return [*found[: MOST - 1], Bar(name=counted(len(rest), "other"), parts=sums)]


def bars_figure(groups: list[Group], total: float, label: str) -> Markup:
    """Groups of bars below one another, all to one scale; shares are of ``total`` [s]."""
    longest = max(bar.seconds for _, bars in groups for bar in bars)
    parts: list[Markup] = []
    y = 0.0
    for head, bars in groups:
        parts.append(svg.text(0, y + 14, head, "head"))
        y += HEAD
        for bar in bars:
            parts += _bar(bar, y, FILL / longest, total)
            y += ROW
        y += GAP
    return svg.figure(parts, height=y - GAP, label=label, kind="bars")


def _bar(bar: Bar, y: float, scale: float, total: float) -> list[Markup]:
    parts = [svg.text(0, y + 14, bar.name, "name end", dx=-8)]
    x = 0.0
    for seconds, kind in bar.parts:
        if seconds > 0:
            parts.append(svg.bar(x, seconds * scale, y + 3, ROW - 7, kind))
            x += seconds * scale
    words = f"{duration(bar.seconds)} · {percent(bar.seconds, total)}"
    return [*parts, svg.text(x, y + 14, words, "tick", dx=7)]
