"""Part of the cut's page on the spindle's load: specific force, no-load power, logs."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.charts.bands import Strip, axis, strips_figure
from pipeline.charts.numbers import counted, number, real
from pipeline.charts.parameters import KnownValue
from pipeline.charts.sections import Block, Figure, Figures, Heading
from pipeline.charts.sources import stated
from pipeline.charts.submodel_page import made_from
from pipeline.charts.tables import Column, code, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.cutting import CuttingModel, NoLoadPoint, SpindleLoad
from pipeline.schema.model import Parameter
from pipeline.submodels.contract import Shown

WORDS = page_words(__file__)
POINTS = 120
"""Points of a curve from coefficients [1]."""
SAME = 0.02
"""Share by which the speeds of two levels differ at most [1]."""
POLYNOMIAL = ("p0", "p1", "p2")
"""Coefficients of the no-load power over the speed in rev/s [W], [W s], [W s^2]."""

LOGS: tuple[Column[tuple[str, str, str]], ...] = (
    Column("Log", lambda row: code(row[0])), Column("use", lambda row: row[1]),
    Column("what of it is not used, or why not", lambda row: row[2]),
)  # fmt: skip


def spindle_load(shown: Shown[CuttingModel], model: CuttingModel) -> list[Block | None]:
    """Heading, no-load power and logs of the spindle's load."""
    spindle = model.spindle
    if spindle is None:
        return []
    notes = [note.partition(": ") for note in spindle.notes]
    rows = [(name, "used", "; ".join(words for log, _, words in notes if log == name) or "–")
            for name in spindle.recordings]  # fmt: skip
    rows += [(lost.case, "left out", lost.reason.removeprefix(f"{lost.case} "))
             for lost in spindle.left_out]  # fmt: skip
    logs = tabulated(WORDS("logs", count=len(rows)), rows, LOGS,
                     made_from(shown, "model.json"), folded=True)  # fmt: skip
    head = Heading(heading=WORDS("head"), text=_spindle_words(model, spindle))
    return [head, _no_load(shown, model, spindle), logs]


def _spindle_words(model: CuttingModel, spindle: SpindleLoad) -> str:
    """Results from the spindle load, and their use."""
    in_table = {lost.reason for lost in spindle.left_out}
    reason = "; ".join(one for one in spindle.reason.split("; ") if one not in in_table)
    ends = [words.rstrip(".") for words in (spindle.assumed, reason)]
    rest = "".join(f" {words[0].upper()}{words[1:]}." for words in ends if words)
    specific = model.spindle_parameters.get("specific_force")
    if specific is None or not specific.determined:
        return WORDS("unknown", rest=rest)
    watts = number((specific.value or 0.0) / 60)  # N/mm^2 as power for a rate [W min/cm^3]
    return WORDS("specific_force", watts=watts, rest=rest)


def _no_load(
    shown: Shown[CuttingModel], model: CuttingModel, spindle: SpindleLoad
) -> Figures | None:
    """No-load power over speed: measured levels, fitted curve and its band."""
    points = sorted(spindle.curve, key=lambda one: one.speed_rpm)
    at, fitted, half, measured = np.array([
        (one.speed_rpm, one.power_W, one.half_width_95_W, one.measured_W) for one in points
    ], dtype=np.float64).reshape(-1, 4).T  # fmt: skip
    powers = [model.spindle_parameters[name].value for name in POLYNOMIAL
              if name in model.spindle_parameters]  # fmt: skip
    known = [value for value in powers if value is not None]
    curves, ends = [], spindle.range_rpm
    if ends is not None and ends[0] < ends[1] and known and len(known) == len(powers):
        speed = np.linspace(*ends, POINTS)
        power = np.polynomial.polynomial.polyval(speed / 60.0, known)
        curves = [("modelled", speed, np.asarray(power, np.float64))]
    if not curves and not len(at):
        return None
    strip = Strip(
        head="No-load power, W", height=220, zero=True, curves=curves,
        areas=[("s-band", at, fitted - half, fitted + half)] if len(at) > 1 else [],
        dots=[("p-positive", at, measured)] if len(at) else [],
    )  # fmt: skip
    top = float(max([1.0, *at.tolist(), *([ends[1]] if ends else [])]))
    words = WORDS("no_load", levels=counted(len(points), "level"))
    svg = strips_figure([strip], axis("Speed, rev/min", (0.0, top)), words)
    figure = Figure(svg=svg, caption=words, sources=made_from(shown, "model.json"))
    legend = [("p-positive", "measured", "dot"), ("l-modelled", "fitted curve", "line"),
              ("s-band", "its 95 % band", "box")]  # fmt: skip
    return Figures(figures=[figure], legend=legend, kind="one")


def true_powers(model: CuttingModel, truth: Any) -> Iterator[KnownValue]:
    """True no-load power at the tool at the simulated speeds; the truth is the motor's."""
    spindle, pairs = model.spindle, stated(truth, "spindle", "no_load_W")
    if spindle is None or not spindle.curve or not isinstance(pairs, list):
        return
    efficiency = real(stated(truth, "spindle", "efficiency")) or 1.0
    for speed, power in pairs:
        near: NoLoadPoint = min(spindle.curve, key=lambda one: abs(one.speed_rpm - speed))
        if abs(near.speed_rpm - speed) <= SAME * abs(speed):
            half = near.half_width_95_W
            p = Parameter(value=near.power_W, unit="WATT", determined=True, method="",
                          interval_95=(near.power_W - half, near.power_W + half))  # fmt: skip
            yield KnownValue(name=f"no-load power at {number(round(speed))}",
                             true=efficiency * power, parameter=p)  # fmt: skip
