"""Part of the page of the feed drives on PI against fuzzy PI: verdict, table, step of the speed."""

from functools import partial

import numpy as np

from pipeline.charts.bands import Strip, axis, strips_figure
from pipeline.charts.numbers import number
from pipeline.charts.sections import Block, Figure, Figures, Heading, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Column, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.drive import SpeedLoops
from pipeline.submodels.drive.speed_loops import PAPER, verdict_words

WORDS = page_words(__file__)
LINES = (("PI", "measured"), ("fuzzy PI", "modelled"))
"""Kinds of speed loops, and their lines."""
TUNED = "tuned alike"
"""Gains of the loops in the figure."""

Row = tuple[str, str, list[float | None]]
"""Gains, kind and figures of a speed loop."""


def _loop_words(row: Row, k: int) -> str:
    value = row[2][k]
    return "–" if value is None else number(value, 3)


LOOPS: tuple[Column[Row], ...] = (
    Column("Gains", lambda row: row[0]), Column("speed loop", lambda row: row[1]),
    *(Column(head, partial(_loop_words, k=k), unit)
      for k, (head, unit) in enumerate((("within 2 %", "ms"), ("within 0.1 %", "ms"),
      ("overshoot", "%"), ("ripple of speed", "%"), ("following error", "µm")))),
)  # fmt: skip


def speed_loops(found: SpeedLoops | None, made: list[Source]) -> list[Block]:
    """Heading with the verdict, table and figure of the speed loops; nothing where none were."""
    if found is None:
        return []
    head = Heading(heading=WORDS("head", axis=found.axis), text=verdict_words(found))
    if not found.loops:
        return [head]
    rows: list[Row] = [
        (one.gains, one.kind, [one.reaching_ms, one.settling_ms, one.overshoot_percent,
                               one.ripple_percent, one.following_um]) for one in found.loops
    ]  # fmt: skip
    rows += [(WORDS("published"), kind, [None, reached, None, error, None])
             for kind, error, reached in PAPER]  # fmt: skip
    table = tabulated(WORDS("table", axis=found.axis), rows, LOOPS, made, note=WORDS("note"))
    return present(head, table, loops_figure(found, made))


def loops_figure(loops: SpeedLoops, made: list[Source]) -> Figures:
    """Speed over time of both kinds of speed loop, tuned alike."""
    shown = {one.kind: one for one in loops.loops if one.gains == TUNED}
    curves = [(kind, np.array(shown[name].time_ms), np.array(shown[name].speed_percent))
              for name, kind in LINES if name in shown]  # fmt: skip
    words = WORDS("figure", axis=loops.axis, gains=TUNED)
    below = axis("Time, ms", (0.0, max((float(t[-1]) for _, t, _ in curves), default=1.0)))
    strip = Strip(head="Speed, % of the step", height=220, curves=curves, zero=True)
    figure = Figure(svg=strips_figure([strip], below, words), caption=words, sources=made)
    legend = [(f"l-{kind}", name, "line") for name, kind in LINES]
    return Figures(figures=[figure], legend=legend, kind="one")
