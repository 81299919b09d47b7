"""Figures of judged days: measured against predicted temperature, with speed and position hold."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, beyond, beyond_words
from pipeline.charts.numbers import number
from pipeline.schema.si import DAY

BIN = 300  # s of one step of the curve of speed

KINDS = {"measured": "measured", "model_free": "free", "model_window": "window"}
"""Curves in the order of drawing, with their CSS class."""

TOP, TEMPERATURE, ERROR, SPEED, HELD = 16, 150, 76, 34, 12  # px: head, heights of the bands
GAP = 26  # px between bands, for the next one's head
STEPS = 160  # stretches of the time axis, each drawn by its lowest and highest value


@dataclass(frozen=True, kw_only=True)
class Curves:
    """One judged day: ``seconds`` of the day (T,), ``values`` [degC] (T,) by name, NaN unknown."""

    day: str
    seconds: np.ndarray
    values: dict[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Spinning:
    """Mean speed [rev/min] and share of the time under position control [1] in bins, (288,)."""

    speed: np.ndarray
    held: np.ndarray


def binned(values: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Mean of the known values in each bin of a day, NaN in a bin without one."""
    good = np.isfinite(values)
    count = np.bincount(place[good], minlength=DAY // BIN).astype(float)
    total = np.bincount(place[good], weights=values[good], minlength=DAY // BIN)
    return np.divide(total, count, out=np.full(DAY // BIN, np.nan), where=count > 0)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Axes that all golden days share, so that days compare by eye."""

    hours: tuple[int, int]
    """First and last hour of the day that is drawn."""
    span: tuple[float, float]
    """Temperatures [°C]."""
    error: float
    """Half height of the band of errors [K]."""
    limit: float | None
    """Limit of the mean error [K]."""
    top_speed: float
    """Upper end of the speed band [rev/min]."""

    @property
    def minutes(self) -> int:
        """Length of the time axis [min]."""
        return 60 * (self.hours[1] - self.hours[0])


def frame(curves: list[Curves], days: list[Spinning], limit: float | None) -> Frame:
    """Axes wide enough for all ``curves`` and for the speed of ``days``."""
    every = _known([v for c in curves for v in c.values.values()])
    low, high = (float(every.min()), float(every.max())) if len(every) else (0.0, 1.0)
    pad = max(0.5, 0.05 * (high - low))
    errors = np.abs(_known([_error(c, n) for c in curves for n in _models(c)]))
    widest = float(np.percentile(errors, 99.5)) if len(errors) else 1.0
    speed = _known([d.speed for d in days])
    return Frame(
        hours=_hours(curves),
        span=(low - pad, high + pad),
        error=1.1 * max(widest, limit or 0.0, 0.5),
        limit=limit,
        top_speed=max(1000.0, float(np.ceil(speed.max(initial=0.0) / 1000) * 1000)),
    )


def _known(parts: list[np.ndarray]) -> np.ndarray:
    every = np.concatenate([*parts, np.array([])])
    return every[np.isfinite(every)]


def _hours(curves: list[Curves]) -> tuple[int, int]:
    """The whole hours, in threes, that hold every measured value."""
    seen = _known([c.seconds[np.isfinite(c.values["measured"])] for c in curves])
    if len(seen) == 0:
        return 0, 24
    first, last = int(seen.min() // 10800) * 3, int(seen.max() // 10800 + 1) * 3
    return first, min(24 if seen.max() < DAY else 25, last)


def _models(curves: Curves) -> list[str]:
    return [name for name in KINDS if name != "measured" and name in curves.values]


def _error(curves: Curves, name: str) -> np.ndarray:
    error: np.ndarray = curves.values[name] - curves.values["measured"]
    return error


def golden_figure(curves: Curves, day: Spinning | None, axes: Frame, label: str) -> Markup:
    """One golden day: temperature, error of the model, spindle speed, position control."""
    error_top = TOP + TEMPERATURE + GAP
    speed_top = error_top + ERROR + GAP
    bottom = speed_top + SPEED + 6 + HELD
    low, high = axes.span
    temperature = Band(top=TOP, height=TEMPERATURE, low=low, high=high)
    error = Band(top=error_top, height=ERROR, low=-axes.error, high=axes.error)
    limits = [-axes.limit, axes.limit] if axes.limit else []
    percent = _across(curves.seconds, axes) * 100 / UNITS
    outside = [beyond(percent, _error(curves, name), error, "K") for name in _models(curves)]
    parts = [
        *_clock(axes, bottom),
        svg.text(0, TOP - 6, "Temperature, °C", "head"),
        *temperature.levels(5),
        temperature.content([
            _line(curves.seconds, curves.values[name], axes, temperature, kind)
            for name, kind in KINDS.items() if name in curves.values
        ]),
        svg.text(0, error_top - 9, f"Model less measured, K{beyond_words(outside, 'K')}", "head"),
        *error.levels(),
        *(svg.across(error.pixel(limit), "grid limit") for limit in limits),
        error.content([
            _line(curves.seconds, _error(curves, name), axes, error, KINDS[name])
            for name in _models(curves)
        ]),
        *(mark for one in outside for mark in one.marks),
        *_speed(day, axes, speed_top),
    ]  # fmt: skip
    return svg.figure(parts, height=bottom + 22, label=label, kind="golden")


def _clock(axes: Frame, bottom: float) -> list[Markup]:
    first, last = axes.hours
    step = 3 if last - first <= 15 else 6
    parts = []
    for hour in range(first, last + 1, step):
        x = 100 * (hour - first) / (last - first)
        parts.append(svg.down(x, TOP, bottom))
        parts.append(svg.text(x, bottom + 16, f"{hour:02d}:00", svg.anchor(x)))
    return parts


def _line(seconds: np.ndarray, values: np.ndarray, axes: Frame, into: Band, kind: str) -> Markup:
    x, y = svg.thinned(seconds, values, 60 * axes.minutes / STEPS)
    return svg.curve(_across(x, axes), into.down(y), kind)


def _across(seconds: np.ndarray, axes: Frame) -> np.ndarray:
    """Places of seconds of the day (T,) across a band's viewport."""
    across: np.ndarray = UNITS * (seconds / 60 - 60 * axes.hours[0]) / axes.minutes
    return across


def _speed(day: Spinning | None, axes: Frame, top: float) -> list[Markup]:
    words = f"Spindle speed, mean of 5 min, 0 to {number(round(axes.top_speed))} rev/min"
    strip = top + SPEED + 6
    parts = [
        svg.text(0, top - 6, words, "head"),
        svg.across(top + SPEED),
        svg.text(0, strip + 10, "held", "tick end", dx=-6),
    ]
    if day is None:
        return [*parts, svg.text(50, top + 20, "not known", "tick mid")]
    first, last = (hour * 3600 // BIN for hour in axes.hours)
    x = np.arange(last - first + 1) * BIN / 60.0
    y = svg.FULL * (1 - np.clip(day.speed[first:last] / axes.top_speed, 0, 1))
    line = svg.curve(np.repeat(x, 2)[1:-1], np.repeat(y, 2), "speed")
    return [
        *parts,
        svg.band(top, SPEED, axes.minutes, [line]),
        svg.band(strip, HELD, last - first, _held(day.held[first:last])),
    ]


def _held(share: np.ndarray) -> list[Markup]:
    """Where the position loop holds the spindle for most of the time, and where nobody knows."""
    parts = []
    for kind, where in (("s-held", share > 0.5), ("s-none", ~np.isfinite(share))):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], where, [False]]).astype(int)))
        data = [
            f"M{a} 0h{b - a}v{svg.FULL}h{a - b}z"
            for a, b in zip(edges[::2], edges[1::2], strict=True)
        ]
        if data:
            parts.append(svg.tag("path", d="".join(data), class_=kind))
    return parts
