"""Shaft, and PI against fuzzy PI, on the page of the feed drives."""

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import band, line, tick_words
from pipeline.charts.numbers import number
from pipeline.charts.sections import Block, Figure, Figures, Heading
from pipeline.charts.tables import Cell, Table, cells, names, numbers
from pipeline.schema.drive import DriveModel, SpeedLoop, SpeedLoops
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.page_parameters import made_from
from pipeline.submodels.drive.speed_loops import PAPER, verdict_words

TOP, HEIGHT = 18, 220
"""Top and height of the figure's band [px]."""
DRAWN = (("PI", "measured"), ("fuzzy PI", "modelled"))
"""Kinds in the figure, and their lines."""
TUNED = "tuned alike"
"""Gains of the loops in the figure."""


def shaft_words(shown: Shown[DriveModel], axis: str) -> str:
    """What both ends of an axis show, or what to record for it."""
    if shown.model is None:
        return ""
    shaft = shown.model.shafts.get(axis)
    if shaft is None:
        return (
            "Stiffness and play of its shaft are not known: record motor position, a scale at the "
            "carriage and the current together, at 1 kHz or more."
        )
    return (
        f"Motor and carriage differ by {number(shaft.twist_um, 2)} µm (RMS), of which the shaft’s "
        f"equation leaves {number(shaft.left_um, 2)} µm."
    )


def speed_loop_blocks(shown: Shown[DriveModel]) -> list[Block]:
    """Heading with the verdict, table and figure of the speed loops; nothing where none were."""
    found = None if shown.model is None else shown.model.speed_loops
    if found is None:
        return []
    blocks: list[Block] = [
        Heading(heading=f"PI against fuzzy PI on axis {found.axis}", text=verdict_words(found))
    ]
    if found.loops:
        blocks += [_table(shown, found), _figure(shown, found)]
    return blocks


def _table(shown: Shown[DriveModel], found: SpeedLoops) -> Table:
    rows = [_row(one) for one in found.loops]
    rows += [
        cells("published, on another axis", kind, "–", f"{reached:g}", "–", f"{error:g}", "–")
        for kind, error, reached in PAPER
    ]
    return Table(
        caption=f"Speed loops on axis {found.axis} as identified: a step of 1000 rev/min with the "
        "switched inverter, a ramp of 100 mm at 1500 mm/min (simulated)",
        note="Feed2025 says that its error of speed is reached after that time. Loops of the "
        "currents, dead time, cogging and play between screw and carriage are not of this axis: "
        "the ripple is the inverter’s and the loops’ alone.",
        heads=[*names("Gains", "speed loop"),
               *numbers(("within 2 %", "ms"), ("within 0.1 %", "ms"), ("overshoot", "%"),
                        ("ripple of speed", "%"), ("following error", "µm"))],
        rows=rows, sources=made_from(shown, "model.json"),
    )  # fmt: skip


def _row(one: SpeedLoop) -> list[Cell]:
    values = (one.reaching_ms, one.settling_ms, one.overshoot_percent, one.ripple_percent,
              one.following_um)  # fmt: skip
    return cells(one.gains, one.kind, *("–" if v is None else number(v, 3) for v in values))


def _figure(shown: Shown[DriveModel], found: SpeedLoops) -> Figures:
    words = f"Speed of axis {found.axis} after a step of 1000 rev/min, both kinds {TUNED}."
    figure = Figure(svg=loops_figure(found, words), caption=words,
                    sources=made_from(shown, "model.json"))  # fmt: skip
    legend = [(f"l-{kind}", name, "line") for name, kind in DRAWN]
    return Figures(figures=[figure], legend=legend, kind="one")


def loops_figure(found: SpeedLoops, label: str) -> Markup:
    """Speed over time of both kinds, tuned alike."""
    shown = {one.kind: one for one in found.loops if one.gains == TUNED}
    curves = {name: (np.array(shown[name].time_ms), np.array(shown[name].speed_percent))
              for name, _ in DRAWN if name in shown}  # fmt: skip
    span = (0.0, max(float(time[-1]) for time, _ in curves.values()))
    into = band(TOP, HEIGHT, *(speed for _, speed in curves.values()), zero=True)
    lines = [line(*curves[name], span, into, kind) for name, kind in DRAWN
             if name in curves]  # fmt: skip
    ticks = [svg.text(50, into.bottom + 31, "Time, ms", "tick mid")]
    for mark in svg.ticks(*span, most=6):
        x = 100 * mark / span[1]
        ticks += [svg.down(x, into.top, into.bottom),
                  svg.text(x, into.bottom + 16, tick_words(mark), svg.anchor(x))]  # fmt: skip
    parts = [svg.text(0, TOP - 7, "Speed, % of the step", "head"), *into.levels(5), *ticks,
             into.content(lines)]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 36, label=label, kind="trace")
