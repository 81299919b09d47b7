"""Figures of the feed drives: friction over speed, mass over time, traces against the twin.

Friction is drawn against the direction of motion, so that both directions share one scale, over the
logarithm of speed, so that the slow end shows, where the force falls.  A trace has bands below one
another: speed, following error, error of the model, command.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import (
    UNITS,
    Band,
    band,
    beyond,
    beyond_words,
    clock,
    line,
    readings,
    tick_words,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import CurvePoint, DriveAxis, FrictionPoint, RecursiveMass
from pipeline.schema.model import Parameter

TOP = 18
"""Height above the first band, for its head [px]."""
FRICTION_HEIGHT, MASS_HEIGHT = 260, 220
"""Heights of the bands [px]."""
SEEN = 0.15
"""Share of the forces' span up to which the scale includes an error bar [1]."""
MOST_POINTS = 300
"""Greatest number of points of a direction, the longest stretches first; the file has all."""
WIDEST = 7
"""Greatest number of decades of speed; slower than that is no motion."""
DIRECTIONS = ((1, "positive"), (-1, "negative"))
SETTLED = 0.2
"""Share of a recording before which the recursive estimate may leave the figure [1]."""
SPEED, ERROR, LEFT, COMMAND, GAP = 44, 140, 60, 120, 28
"""Heights of the bands of a trace, and between them [px]."""
MILLIMETRES_FROM = 3000.0
"""Following error from which it is drawn in millimetres [um]."""
CLOSE, LEAST_S = 0.08, 0.25
"""Share of a recording that the close look shows [1], and its least duration [s]."""


@dataclass(frozen=True, kw_only=True)
class Branch:
    """One direction: ``speed`` [mm/s], ``force`` against motion, ``half`` width, each (N,)."""

    speed: Floats
    force: Floats
    half: Floats


@dataclass(frozen=True, kw_only=True)
class FrictionShown:
    """Measured points and curve of the model by direction."""

    points: dict[str, Branch]
    curve: dict[str, Branch]
    unit: str

    @property
    def every(self) -> list[Branch]:
        """All that is drawn."""
        return [*self.points.values(), *self.curve.values()]

    @property
    def count(self) -> int:
        """Number of points."""
        return sum(len(b.speed) for b in self.points.values())


def friction_shown(axis: DriveAxis) -> FrictionShown | None:
    """Friction of an axis by direction; None when there is nothing to draw."""
    longest = sorted(axis.friction_points, key=lambda one: -one.seconds)
    found = FrictionShown(
        points={name: _branch(longest, sign, MOST_POINTS) for sign, name in DIRECTIONS},
        curve={name: _branch(axis.friction_curve, sign) for sign, name in DIRECTIONS},
        unit=axis.force_unit,
    )
    return found if any(len(b.speed) for b in found.every) else None


def _branch(
    points: Sequence[FrictionPoint | CurvePoint], sign: int, most: int | None = None
) -> Branch:
    rows = [
        [sign * one.velocity_mm_s, sign * one.force, getattr(one, "half_width", None) or 0.0]
        for one in points
        if sign * one.velocity_mm_s > 0
    ]
    table = readings(np.array(rows, dtype=float).reshape(-1, 3))
    known = table[np.isfinite(table[:, :2]).all(axis=1)][:most]
    speed, force, half = known[np.argsort(known[:, 0], kind="stable")].T
    return Branch(speed=speed, force=force, half=np.nan_to_num(half))


def friction_figure(shown: FrictionShown, label: str) -> Markup:
    """Points with error bars and the curve of each direction over the logarithm of speed."""
    into = band(TOP, FRICTION_HEIGHT, *_forces(shown), zero=True)
    span = _decades(shown)
    lines = [
        svg.curve(_place(b.speed, span) * UNITS / 100, into.down(b.force), f"curve-{name}")
        for name, b in shown.curve.items() if len(b.speed) > 1
    ]  # fmt: skip
    bars = [
        svg.tag("path", d=_bars(b, span, into), class_=f"curve bar-{name}")
        for name, b in shown.points.items() if len(b.speed)
    ]  # fmt: skip
    dots = [
        svg.tag("circle", cx=f"{x:.2f}%", cy=into.pixel(force), r=3.5, class_=f"point p-{name}")
        for name, b in shown.points.items()
        for x, force in zip(_place(b.speed, span), b.force, strict=True)
        if np.isfinite(x)
    ]
    outside = [
        beyond(_place(b.speed, span), b.force + sign * b.half, into, shown.unit)
        for b in shown.points.values() for sign in (-1.0, 1.0)
    ]  # fmt: skip
    head = f"Force against motion, {shown.unit}".rstrip(", ") + beyond_words(outside, shown.unit)
    marks = [mark for one in outside for mark in one.marks]
    parts = [svg.text(0, TOP - 7, head, "head"), *into.levels(5), *_speeds(span, into),
             into.content([*bars, *lines]), *dots, *marks]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 36, label=label, kind="friction")


def _forces(shown: FrictionShown) -> list[Floats]:
    """Forces that the scale must hold; of error bars a part, so that no wide one flattens all."""
    whole = np.concatenate([b.force for b in shown.every])
    reach = float(np.ptp(whole)) or float(np.abs(whole).max(initial=0.0))
    return [
        b.force + sign * np.minimum(b.half, SEEN * reach)
        for b in shown.every
        for sign in (-1.0, 1.0)
    ]


def _decades(shown: FrictionShown) -> tuple[float, float]:
    """Logarithms of the slowest and the fastest speed of the scale, at least a decade apart.

    A curve that goes on far below the slowest point is cut there: nobody has measured it.
    """
    measured = np.concatenate([b.speed for b in shown.points.values()])
    drawn = np.concatenate([b.speed for b in shown.every])
    low = 0.5 * float(measured.min()) if len(measured) else float(drawn.min())
    first, last = np.log10(low), np.log10(1.15 * float(drawn.max()))
    return float(min(max(first, last - WIDEST), last - 1)), float(last)


def _place(speed: Floats, span: tuple[float, float]) -> Floats:
    """Speeds as percent of the width; NaN for those slower than the scale."""
    share = 100 * (np.log10(speed) - span[0]) / (span[1] - span[0])
    place: Floats = np.where(share >= 0, share, np.nan)
    return place


def _bars(branch: Branch, span: tuple[float, float], into: Band) -> str:
    place = _place(branch.speed, span)
    here = np.isfinite(place)
    x = np.rint(place[here] * UNITS / 100).astype(int)
    force, half = branch.force[here], branch.half[here]
    ends = [np.rint(into.down(force + s * half)).astype(int) for s in (1, -1)]
    return "".join(f"M{a} {b}v{c - b}" for a, b, c in zip(x, *ends, strict=True) if c > b)


def _speeds(span: tuple[float, float], into: Band) -> list[Markup]:
    parts = [svg.text(50, into.bottom + 31, "Speed, mm/s", "tick mid")]
    decades = range(int(np.floor(span[0])), int(np.ceil(span[1])) + 1)
    wide = span[1] - span[0] > 3.5
    for mark in (f * 10.0**d for d in decades for f in ((1,) if wide else (1, 2, 5))):
        x = 100 * (np.log10(mark) - span[0]) / (span[1] - span[0])
        if -0.01 <= x <= 100.01:
            parts.append(svg.down(x, into.top, into.bottom))
            parts.append(svg.text(x, into.bottom + 16, tick_words(mark), svg.anchor(x)))
    return parts


@dataclass(frozen=True, kw_only=True)
class MassShown:
    """Recursive estimate over time: ``seconds``, ``value``, ``half`` (T,); the batch parameter."""

    recording: str
    unit: str
    seconds: Floats
    value: Floats
    half: Floats
    batch: Parameter | None


def mass_shown(found: RecursiveMass | None, batch: Parameter | None) -> MassShown | None:
    """The recursive mass beside that of all training recordings; None when there is none."""
    if found is None:
        return None
    seconds, value, half = (
        readings(np.array(column, dtype=float))
        for column in (found.time_s, found.value, found.half_width)
    )
    good = np.isfinite(seconds) & np.isfinite(value)
    if good.sum() < 2:
        return None
    return MassShown(
        recording=found.recording, unit=found.unit, seconds=seconds[good], value=value[good],
        half=np.nan_to_num(half[good]),
        batch=batch if batch is not None and batch.determined else None,
    )  # fmt: skip


def mass_figure(shown: MassShown, label: str) -> Markup:
    """The estimate with its band, and the value of all training recordings with its interval."""
    order = np.argsort(shown.seconds, kind="stable")
    t, value, half = shown.seconds[order], shown.value[order], shown.half[order]
    span = (float(t[0]), float(t[-1]))
    late = t >= span[0] + SETTLED * (span[1] - span[0])
    central = None if shown.batch is None else shown.batch.value
    interval = None if shown.batch is None else shown.batch.interval_95
    batch = np.array([b for b in (central, *(interval or ())) if b is not None])
    into = band(TOP, MASS_HEIGHT, value[late], (value - half)[late], (value + half)[late], batch)
    percent = 100 * (t - span[0]) / max(span[1] - span[0], 1e-12)
    ends = (value, value - half, value + half)
    outside = [beyond(percent, drawn, into, shown.unit) for drawn in ends]
    head = f"Mass, {shown.unit}{beyond_words(outside, shown.unit)}"
    parts = [svg.text(0, TOP - 7, head, "head")]
    if interval is not None:
        top = into.pixel(interval[1])
        height = max(1.0, into.pixel(interval[0]) - top)
        parts.append(svg.bar(0, 100, top, height, "s-batch"))
    parts += into.levels(5)
    parts.append(into.content([
        svg.tag("path", d=_outline(t, value - half, value + half, span, into), class_="s-band"),
        line(t, value, span, into, "modelled"),
    ]))  # fmt: skip
    if central is not None:
        parts.append(svg.across(into.pixel(central), "batch"))
    parts += [mark for one in outside for mark in one.marks]
    return svg.figure([*clock(span, TOP, into.bottom), *parts], height=into.bottom + 36,
                      label=label, kind="inertia")  # fmt: skip


def _outline(t: Floats, low: Floats, high: Floats, span: tuple[float, float], into: Band) -> str:
    x = np.rint(UNITS * (t - span[0]) / max(span[1] - span[0], 1e-12)).astype(int)
    y = [np.rint(into.down(v)).astype(int) for v in (high, low)]
    points = [*zip(x, y[0], strict=True), *zip(x[::-1], y[1][::-1], strict=True)]
    return "M" + "L".join(f"{a} {b}" for a, b in points) + "z"


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A quantity of a trace: ``seconds``, ``measured``, ``modelled`` (T,), NaN where unknown."""

    seconds: Floats
    measured: Floats
    modelled: Floats


@dataclass(frozen=True, kw_only=True)
class DriveTrace:
    """One axis in one recording: following error [um], command and speed [mm/s] where known."""

    axis: str
    recording: str
    following: Curve
    command: Curve | None = None
    speed: Curve | None = None

    @property
    def span(self) -> tuple[float, float]:
        """First and last second."""
        return float(self.following.seconds[0]), float(self.following.seconds[-1])


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A band of a trace: head, height [px], curves (seconds, values) by CSS class, with 0."""

    head: str
    height: float
    curves: dict[str, tuple[Floats, Floats]]
    zero: bool = False


def drawn_bands(trace: DriveTrace, command_unit: str) -> list[Drawn]:
    """The bands of a trace from top to bottom; empty where nothing can be compared."""
    error, command, speed = trace.following, trace.command, trace.speed
    both = [v for v in (error.measured, error.modelled) if np.isfinite(v).any()]
    largest = max((float(np.nanmax(np.abs(v))) for v in both), default=0.0)
    factor, unit = (1e-3, "mm") if largest >= MILLIMETRES_FROM else (1.0, "µm")
    left = factor * (error.modelled - error.measured)
    t = error.seconds
    every = [
        Drawn(head="Speed, mm/s", height=SPEED,
              curves={} if speed is None else _known(speed.seconds, speed=speed.measured)),
        Drawn(head=f"Following error, {unit}", height=ERROR,
              curves=_known(t, measured=factor * error.measured, modelled=factor * error.modelled)),
        Drawn(head=f"Modelled less measured, {unit}", height=LEFT, zero=True,
              curves=_known(t, modelled=left)),
        Drawn(head=f"Command, {command_unit}".rstrip(", "), height=COMMAND,
              curves={} if command is None else
              _known(command.seconds, measured=command.measured, modelled=command.modelled)),
    ]  # fmt: skip
    shown = [one for one in every if one.curves]
    compared = any({"measured", "modelled"} <= one.curves.keys() for one in shown)
    return shown if compared else []


def _known(seconds: Floats, **curves: Floats) -> dict[str, tuple[Floats, Floats]]:
    return {kind: (seconds, v) for kind, v in curves.items() if np.isfinite(v).any()}


def closest_look(trace: DriveTrace) -> tuple[float, float] | None:
    """The stretch about the greatest error of the model; None in a recording too short for one."""
    first, last = trace.span
    width = max(LEAST_S, CLOSE * (last - first))
    if last - first < 4 * width:
        return None
    for one in (trace.following, trace.command):
        if one is None:
            continue
        error = np.abs(one.modelled - one.measured)
        if np.isfinite(error).any():
            middle = float(one.seconds[int(np.nanargmax(error))])
            start = min(max(middle - width / 2, first), last - width)
            return start, start + width
    return None


def trace_figure(bands: list[Drawn], span: tuple[float, float], label: str) -> Markup:
    """The ``bands`` below one another over the part ``span`` [s] of a recording."""
    parts: list[Markup] = []
    top = float(TOP)
    for one in bands:
        inside = [v[(t >= span[0]) & (t <= span[1])] for t, v in one.curves.values()]
        into = band(top, one.height, *inside, zero=one.zero)
        most = 5 if one.height > LEFT else 4 if one.height == LEFT else 3
        curves = [line(t, v, span, into, kind) for kind, (t, v) in one.curves.items()]
        parts += [svg.text(0, top - 7, one.head, "head"), *into.levels(most), into.content(curves)]
        top = into.bottom + GAP
    bottom = top - GAP
    return svg.figure([*clock(span, TOP, bottom), *parts], height=bottom + 36, label=label,
                      kind="trace")  # fmt: skip
