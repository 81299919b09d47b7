"""Friction over speed: measured segments with their error bars, Stribeck's curve, each direction.

Force is drawn against the direction of motion, so that both directions share one scale, and speed
on a logarithmic scale, so that the slow end shows, where the force falls.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import real
from pipeline.charts.sources import rows_of
from pipeline.charts.svg import anchor
from pipeline.report.drive_frame import UNITS, Band, band, plain
from pipeline.report.drive_traces import readings

TOP, HEIGHT = 18, 260  # px
SEEN = 0.15  # of the forces' span: how much of an error bar the scale makes room for
MOST_POINTS = 300  # of a direction, the longest segments first; the file has them all
WIDEST = 7  # decades of speed; slower than that is no motion
DIRECTIONS = ((1, "positive"), (-1, "negative"))


@dataclass(frozen=True, kw_only=True)
class Branch:
    """One direction: ``speed`` [mm/s], ``force`` against motion, ``half`` width, each (N,)."""

    speed: np.ndarray
    force: np.ndarray
    half: np.ndarray


@dataclass(frozen=True, kw_only=True)
class FrictionShown:
    """Measured points and curve by direction."""

    points: dict[str, Branch]
    curve: dict[str, Branch]
    unit: str

    @property
    def every(self) -> list[Branch]:
        """All that is drawn."""
        return [*self.points.values(), *self.curve.values()]

    @property
    def count(self) -> int:
        """Points drawn."""
        return sum(len(b.speed) for b in self.points.values())


def friction_shown(axis: dict[str, Any]) -> FrictionShown | None:
    """What an axis' document says of its friction; None when there is nothing to draw."""
    points, curve = rows_of(axis, "friction_points"), rows_of(axis, "friction_curve")
    found = FrictionShown(
        points={name: _branch(points, sign, MOST_POINTS) for sign, name in DIRECTIONS},
        curve={name: _branch(curve, sign) for sign, name in DIRECTIONS},
        unit=str(axis.get("force_unit") or ""),
    )
    return found if any(len(b.speed) for b in found.every) else None


def _branch(rows: list[dict[str, Any]], sign: int, most: int | None = None) -> Branch:
    ranked = sorted(rows, key=lambda row: -(real(row.get("seconds")) or 0.0)) if most else rows
    whole = [
        [sign * v, sign * f, real(row.get("half_width")) or 0.0]
        for row in ranked
        if (v := real(row.get("velocity_mm_s"))) is not None and sign * v > 0
        if (f := real(row.get("force"))) is not None
    ]
    table = readings(np.array(whole, dtype=float).reshape(-1, 3))
    known = table[np.isfinite(table[:, :2]).all(axis=1)][:most]
    speed, force, half = known[np.argsort(known[:, 0], kind="stable")].T
    return Branch(speed=speed, force=force, half=np.nan_to_num(half))


def friction_figure(shown: FrictionShown, label: str) -> Markup:
    """Points with error bars and the curve of each direction over the logarithm of speed."""
    into = band(TOP, HEIGHT, *_forces(shown), zero=True)
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
    head = f"Force against motion, {shown.unit}".rstrip(", ")
    parts = [svg.text(0, TOP - 7, head, "head"), *into.levels(5), *_speeds(span, into),
             into.content([*bars, *lines]), *dots]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 36, label=label, kind="friction")


def _forces(shown: FrictionShown) -> list[np.ndarray]:
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

    A curve that goes on far below the slowest segment is cut there: nobody has measured it.
    """
    measured = np.concatenate([b.speed for b in shown.points.values()])
    drawn = np.concatenate([b.speed for b in shown.every])
    low = 0.5 * float(measured.min()) if len(measured) else float(drawn.min())
    first, last = np.log10(low), np.log10(1.15 * float(drawn.max()))
    return float(min(max(first, last - WIDEST), last - 1)), float(last)


def _place(speed: np.ndarray, span: tuple[float, float]) -> np.ndarray:
    """Speeds as percent of the width; NaN for those slower than the scale."""
    share = 100 * (np.log10(speed) - span[0]) / (span[1] - span[0])
    place: np.ndarray = np.where(share >= 0, share, np.nan)
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
            parts.append(svg.text(x, into.bottom + 16, plain(mark), anchor(x)))
    return parts
