"""What moves, followed through a recording: the recursive estimate against the batch value."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import real
from pipeline.charts.sources import dig, objects_of
from pipeline.report.drive_frame import UNITS, band, clock, line
from pipeline.report.drive_traces import MOST, readings

TOP, HEIGHT = 18, 220  # px
SETTLED = 0.2  # of the recording; the band before it may leave the figure


@dataclass(frozen=True, kw_only=True)
class InertiaShown:
    """Estimate over time: ``seconds``, ``value``, ``half`` (T,), then the batch value."""

    recording: str
    quantity: str
    unit: str
    seconds: np.ndarray
    value: np.ndarray
    half: np.ndarray
    batch: tuple[float | None, float | None, float | None]


def inertia_shown(axis: dict[str, Any]) -> InertiaShown | None:
    """What an axis' document says of its recursive estimate; None when there is nothing."""
    found = dig(axis, "recursive")
    columns = [dig(found, key) for key in ("time_s", "value", "half_width")]
    if not all(isinstance(c, list) for c in columns[:2]):
        return None
    rows = min(len(columns[0]), len(columns[1]))
    half = columns[2] if isinstance(columns[2], list) else []
    seconds, value, width = (
        readings(np.array([
            x if (x := real(v)) is not None else np.nan for v in [*c, *[None] * rows][:rows]
        ]))
        for c in (columns[0], columns[1], half)
    )  # fmt: skip
    good = np.isfinite(seconds) & np.isfinite(value)
    if good.sum() < 2:
        return None
    quantity = str(found.get("quantity") or "mass")
    batch = objects_of(axis, "parameters").get(quantity, {})
    known = batch if batch.get("determined") else {}
    return InertiaShown(
        recording=str(found.get("recording") or ""), quantity=quantity,
        unit=str(found.get("unit") or ""),
        seconds=seconds[good], value=value[good], half=np.nan_to_num(width[good]),
        batch=(_level(known.get("value")), _level(known.get("low")), _level(known.get("high"))),
    )  # fmt: skip


def _level(value: Any) -> float | None:
    x = real(value)
    return x if x is not None and abs(x) <= MOST else None


def inertia_figure(shown: InertiaShown, label: str) -> Markup:
    """The estimate with its band, and the value of all training records with its interval."""
    order = np.argsort(shown.seconds, kind="stable")
    t, value, half = shown.seconds[order], shown.value[order], shown.half[order]
    span = (float(t[0]), float(t[-1]))
    late = t >= span[0] + SETTLED * (span[1] - span[0])
    batch = np.array([b for b in shown.batch if b is not None])
    into = band(TOP, HEIGHT, value[late], (value - half)[late], (value + half)[late], batch)
    parts = [svg.text(0, TOP - 7, f"{shown.quantity.capitalize()}, {shown.unit}", "head")]
    central, low, high = shown.batch
    if low is not None and high is not None:
        top = into.pixel(high)
        parts.append(svg.bar(0, 100, top, max(1.0, into.pixel(low) - top), "s-batch"))
    parts += into.levels(5)
    parts.append(into.content([
        svg.tag("path", d=_outline(t, value - half, value + half, span, into), class_="s-band"),
        line(t, value, span, into, "modelled"),
    ]))  # fmt: skip
    if central is not None:
        parts.append(svg.across(into.pixel(central), "batch"))
    return svg.figure([*clock(span, TOP, into.bottom), *parts], height=into.bottom + 36,
                      label=label, kind="inertia")  # fmt: skip


def _outline(
    t: np.ndarray, low: np.ndarray, high: np.ndarray, span: tuple[float, float], into: Any
) -> str:
    x = np.rint(UNITS * (t - span[0]) / max(span[1] - span[0], 1e-12)).astype(int)
    y = [np.rint(into.down(v)).astype(int) for v in (high, low)]
    points = [*zip(x, y[0], strict=True), *zip(x[::-1], y[1][::-1], strict=True)]
    return "M" + "L".join(f"{a} {b}" for a, b in points) + "z"
