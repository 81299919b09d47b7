"""Figures that only cutting can show: the force over one revolution, and the no-load power."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, line, tick_words
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, number, relative, rounded
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.svg import anchor
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.si import MINUTE
from pipeline.submodels.cutting.runs import (
    CutRun,
    CuttingFacts,
    CutTrace,
    best_run,
    cut_trace,
    worst_run,
)
from pipeline.submodels.cutting.tables import model_sources, verdict_sources

TOP, HEIGHT, GAP = 18, 120, 28
"""Head of a figure, height of one channel, distance of two [px]."""
POWER_HEIGHT = 220
"""Height of the no-load power [px]."""
REVOLUTION = (0.0, 360.0)
"""Angles of the spindle that are drawn [deg]."""
QUARTER = 90.0
"""Angle between two lines [deg]."""
POINTS = 120
"""Points of a curve that is drawn from its coefficients."""
POLYNOMIAL = ("p0", "p1", "p2")
"""Coefficients of the no-load power over the speed in rev/s [W], [W s], [W s^2]."""
STATUS = {"unknown": "not judged", "passed": "passed", "failed": "failed"}


# ---- one revolution


def revolutions(facts: CuttingFacts) -> Figures | None:
    """One revolution of the worst and of the best predicted recording."""
    predictions = facts.shown.predictions
    traces = {
        run.recording: trace
        for run in (*facts.runs, *facts.cross)
        if (trace := cut_trace(predictions, run.recording)) is not None
    }
    runs = [run for run in facts.telling or facts.runs if run.recording in traces]
    worst, best = worst_run(runs), best_run(runs)
    if worst is None or best is None:
        return None
    ranked = [(worst, "worst predicted"), (best, "best predicted")]
    if worst.recording == best.recording:
        ranked = [(worst, "")]
    return Figures(
        figures=[_revolution(facts, run, traces[run.recording], rank) for run, rank in ranked],
        legend=_legend([traces[run.recording] for run, _ in ranked]),
        kind="" if len(ranked) > 1 else "one",
    )


def _revolution(facts: CuttingFacts, ranked: CutRun, trace: CutTrace, rank: str) -> Figure:
    """The revolution as the model itself predicts it, which may have learnt from it."""
    run = next((r for r in facts.runs if r.recording == ranked.recording), ranked)
    words = _words(run, rank)
    if run is not ranked and (error := ranked.size("rms")) is not None:
        words += f"; fitted on other recordings it errs by {relative(error, rounded, '%')}"
    return Figure(
        svg=revolution_figure(trace, f"{words}."),
        caption=f"{words}.",
        sources=verdict_sources(facts, "predictions.parquet"),
        status=run.status,
        status_words="learnt from" if run.is_training else STATUS[run.status],
    )


def _words(run: CutRun, rank: str) -> str:
    error, guess = run.size("rms"), run.size("rms", "plain")
    words = f"One revolution of {run.recording or NOT_KNOWN}{f', {rank}' if rank else ''}: mean "
    words += "of the measured revolutions, the band of 95 % of them, and the model"
    if error is not None:
        words += f", whose RMS error is {relative(error, rounded, '%')}"
    return words if guess is None else f"{words} (plain guess {relative(guess, rounded, '%')})"


def _legend(traces: list[CutTrace]) -> list[tuple[str, str, str]]:
    legend = [("l-measured", "measured, mean", "line")]
    if any(trace.low for trace in traces):
        legend.append(("s-still", "95 % of the revolutions", "box"))
    legend.append(("l-modelled", "modelled", "line"))
    if any(trace.plain for trace in traces):
        legend.append(("l-free", "plain guess", "line"))
    return legend


def revolution_figure(trace: CutTrace, label: str, *, with_plain: bool = True) -> Markup:
    """Channels below one another over the spindle's angle, each on its own scale with 0."""
    parts: list[Markup] = []
    top = float(TOP)
    for channel in trace.channels:
        # the last is drawn on top
        curves = [
            (trace.plain.get(channel) if with_plain else None, "free"),
            (trace.modelled.get(channel), "modelled"),
            (trace.measured.get(channel), "measured"),
        ]
        known = [(values, css) for values, css in curves if values is not None]
        low, high = trace.low.get(channel), trace.high.get(channel)
        ends = () if low is None or high is None else (low, high)
        into = band(top, HEIGHT, *(values for values, _ in known), *ends, zero=True)
        drawn = [line(trace.angle, values, REVOLUTION, into, css) for values, css in known]
        cloud = _cloud(trace.scatter_angle, ends[0], ends[1], into) if ends else []
        parts += [svg.text(0, top - 7, f"F{channel}, N", "head"), *into.levels(5),
                  into.content([*cloud, *drawn])]  # fmt: skip
        top = into.bottom + GAP
    bottom = top - GAP
    return svg.figure([*_angles(bottom), *parts], height=bottom + 36, label=label, kind="trace")


def _cloud(angle: Floats, low: Floats, high: Floats, into: Band) -> list[Markup]:
    """The scatter as a filled area, one path for each stretch over which both ends are known."""
    x = UNITS * (angle - REVOLUTION[0]) / (REVOLUTION[1] - REVOLUTION[0])
    bottom, top = into.down(low), into.down(high)
    inside = (angle >= REVOLUTION[0]) & (angle <= REVOLUTION[1])
    good = np.isfinite(bottom) & np.isfinite(top) & inside
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    areas = []
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        around = np.concatenate([np.arange(start, end), np.arange(start, end)[::-1]])
        y = np.concatenate([top[start:end], bottom[start:end][::-1]])
        areas.append(svg.path_data(x[around], y) + "z")
    return [svg.tag("path", d="".join(areas), class_="s-still", fill_opacity=0.6)]


def _angles(bottom: float) -> list[Markup]:
    parts = [svg.text(50, bottom + 31, "Angle of the spindle, °", "tick mid")]
    for mark in np.arange(REVOLUTION[0], REVOLUTION[1] + 1, QUARTER):
        x = 100 * float(mark - REVOLUTION[0]) / (REVOLUTION[1] - REVOLUTION[0])
        parts += [svg.down(x, TOP, bottom), svg.text(x, bottom + 16, tick_words(float(mark)),
                                                     anchor(x))]  # fmt: skip
    return parts


# ---- power of the spindle


@dataclass(frozen=True, kw_only=True, eq=False)
class NoLoadCurve:
    """No-load power as it is drawn."""

    speed: Floats
    power: Floats
    """Fitted curve [rev/min], [W]; empty unless every coefficient is determined; shape (T,)."""
    levels: Floats
    """Speed [rev/min], fitted power, half width of its interval and measured power [W], by speed;
    shape (N, 4)."""


def no_load_curve(model: CuttingModel | None) -> NoLoadCurve | None:
    """The curve and levels of the no-load power; None when there is nothing to draw."""
    spindle = None if model is None else model.spindle
    if model is None or spindle is None:
        return None
    rows = [
        (one.speed_rpm, one.power_W, one.half_width_95_W, one.measured_W)
        for one in sorted(spindle.curve, key=lambda one: one.speed_rpm)
    ]
    levels = np.array(rows, dtype=np.float64).reshape(-1, 4)
    speed = power = np.zeros(0)
    values = {
        k: model.spindle_parameters[name].value
        for k, name in enumerate(POLYNOMIAL) if name in model.spindle_parameters
    }  # fmt: skip
    known = {k: value for k, value in values.items() if value is not None}
    ends = spindle.range_rpm
    if ends is not None and ends[0] < ends[1] and known and len(known) == len(values):
        speed = np.linspace(*ends, POINTS)
        power = np.sum([value * (speed / MINUTE) ** k for k, value in known.items()], axis=0)
    if not len(levels) and not len(speed):
        return None
    return NoLoadCurve(speed=speed, power=power, levels=levels)


def no_load_figures(facts: CuttingFacts) -> Figures | None:
    """No-load power over speed, with the levels that it was found from."""
    shown = no_load_curve(facts.model)
    if shown is None:
        return None
    words = "Power of the spindle without a cut over its speed"
    legend = []
    if len(shown.levels):
        words += f": {counted(len(shown.levels), 'level')} of constant speed"
        legend.append(("p-positive", "measured", "dot"))
    if len(shown.power):
        words += (
            f"; at {number(round(float(shown.speed[-1])))}{NARROW}rev/min it takes "
            f"{number(float(shown.power[-1]))}{NARROW}W"
        )
        legend.append(("l-modelled", "fitted curve", "line"))
    if len(shown.levels) > 1:
        legend.append(("s-band", "its 95 % band", "box"))
    figure = Figure(svg=no_load_figure(shown, f"{words}."), caption=f"{words}.",
                    sources=model_sources(facts))  # fmt: skip
    return Figures(figures=[figure], legend=legend, kind="one")


def no_load_figure(shown: NoLoadCurve, label: str) -> Markup:
    """Curve with its band and the levels, over speed from 0."""
    speed, fitted, half, measured = shown.levels.T
    ends = [fitted + sign * half for sign in (-1, 1)]
    into = band(TOP, POWER_HEIGHT, shown.power, measured, *ends, zero=True)
    top_speed = float(np.concatenate([shown.speed, speed, np.ones(1)]).max())
    content = []
    if len(speed) > 1:
        there = UNITS * speed / top_speed
        x = np.concatenate([there, there[::-1]])
        y = np.concatenate([into.down(ends[1]), into.down(ends[0])[::-1]])
        content.append(svg.tag("path", d=svg.path_data(x, y) + "z", class_="s-band"))
    if len(shown.power):
        x = UNITS * shown.speed / top_speed
        content.append(svg.curve(x, into.down(shown.power), "modelled"))
    dots = [
        svg.tag("circle", cx=f"{100 * n / top_speed:.2f}%", cy=into.pixel(float(power)), r=3.5,
                class_="point p-positive")
        for n, power in zip(speed, measured, strict=True)
    ]  # fmt: skip
    parts = [svg.text(0, TOP - 7, "No-load power, W", "head"), *into.levels(5),
             *_speeds(top_speed, into), into.content(content), *dots]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 36, label=label, kind="trace")


def _speeds(top_speed: float, into: Band) -> list[Markup]:
    parts = [svg.text(50, into.bottom + 31, "Speed, rev/min", "tick mid")]
    for mark in svg.ticks(0.0, top_speed, most=4):
        x = 100 * mark / top_speed
        parts.append(svg.down(x, into.top, into.bottom))
        parts.append(svg.text(x, into.bottom + 16, tick_words(mark), anchor(x)))
    return parts
