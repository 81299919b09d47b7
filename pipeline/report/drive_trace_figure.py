"""An axis in one recording: speed, following error and command, measured and modelled."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.report.drive_frame import band, clock, line
from pipeline.report.drive_traces import DriveTrace

TOP, SPEED, ERROR, LEFT, COMMAND, GAP = 18, 44, 140, 60, 120, 28  # px: head, bands, between them
MILLIMETRES_FROM = 3000.0  # µm; larger following errors are drawn in mm
CLOSE = 0.08  # of a recording is what the close look shows
LEAST_S = 0.25  # s of the close look


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """A band of the figure: its head, height [px], curves (T,) by CSS class, whether 0 is in it."""

    head: str
    height: float
    curves: dict[str, np.ndarray]
    zero: bool = False


def drawn_bands(trace: DriveTrace, command_unit: str) -> list[Drawn]:
    """What a trace has to show, from top to bottom; empty where it has nothing to compare."""
    measured, modelled = (_known(trace, f"following_{w}_um") for w in ("measured", "modelled"))
    largest = max((np.nanmax(np.abs(v)) for v in (measured, modelled) if v is not None), default=0)
    factor, unit = (1e-3, "mm") if largest >= MILLIMETRES_FROM else (1.0, "µm")
    both = measured is not None and modelled is not None
    left = modelled - measured if both else None  # type: ignore[operator]
    command = {w: _known(trace, f"command_{w}") for w in ("measured", "modelled")}
    speed = {"speed": _known(trace, "velocity_mm_s")}
    every = [
        _band("Speed, mm/s", SPEED, speed),
        _band(f"Following error, {unit}", ERROR, {"measured": measured, "modelled": modelled},
              factor),
        _band(f"Modelled less measured, {unit}", LEFT, {"modelled": left}, factor, zero=True),
        _band(f"Command, {command_unit}".rstrip(", "), COMMAND, command),
    ]  # fmt: skip
    shown = [one for one in every if one.curves]
    compared = any({"measured", "modelled"} <= one.curves.keys() for one in shown)
    return shown if compared else []


def _band(
    head: str, height: float, curves: dict[str, np.ndarray | None], factor: float = 1.0, *,
    zero: bool = False,
) -> Drawn:  # fmt: skip
    known = {kind: factor * v for kind, v in curves.items() if v is not None}
    return Drawn(head=head, height=height, curves=known, zero=zero)


def _known(trace: DriveTrace, name: str) -> np.ndarray | None:
    values = trace.values.get(name)
    return values if values is not None and np.isfinite(values).any() else None


def whole(trace: DriveTrace) -> tuple[float, float]:
    """First and last second."""
    return float(trace.seconds[0]), float(trace.seconds[-1])


def closest_look(trace: DriveTrace) -> tuple[float, float] | None:
    """The stretch about the greatest error of the model; None in a recording too short for one."""
    first, last = whole(trace)
    width = max(LEAST_S, CLOSE * (last - first))
    if last - first < 4 * width:
        return None
    for name, unit in (("following", "_um"), ("command", "")):
        values = [_known(trace, f"{name}_{w}{unit}") for w in ("measured", "modelled")]
        if values[0] is None or values[1] is None:
            continue
        error = np.abs(values[1] - values[0])
        if np.isfinite(error).any():
            middle = float(trace.seconds[int(np.nanargmax(error))])
            start = min(max(middle - width / 2, first), last - width)
            return start, start + width
    return None


def trace_figure(
    trace: DriveTrace, bands: list[Drawn], span: tuple[float, float], label: str
) -> Markup:
    """The ``bands`` below one another over the part ``span`` [s] of a recording."""
    here = (trace.seconds >= span[0]) & (trace.seconds <= span[1])
    parts: list[Markup] = []
    top = float(TOP)
    for one in bands:
        into = band(top, one.height, *(v[here] for v in one.curves.values()), zero=one.zero)
        most = 5 if one.height > LEFT else 4 if one.height == LEFT else 3
        curves = [line(trace.seconds, v, span, into, kind) for kind, v in one.curves.items()]
        parts += [svg.text(0, top - 7, one.head, "head"), *into.levels(most), into.content(curves)]
        top = into.bottom + GAP
    bottom = top - GAP
    return svg.figure([*clock(span, TOP, bottom), *parts], height=bottom + 36, label=label,
                      kind="trace")  # fmt: skip
