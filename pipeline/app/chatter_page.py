"""Page of `kerf chatter`: verdict, stretches, and the spectrum with the lines of the teeth."""

from pathlib import Path

import numpy as np

from pipeline.app.chatter import JudgedFile, Stretch
from pipeline.app.kerf import CALLED
from pipeline.charts.bands import Block, Strip, axis, strips_figure
from pipeline.charts.numbers import number
from pipeline.charts.sections import Figures, Section, drawing, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Column, tabulated
from pipeline.report.provenance import Made
from pipeline.report.standalone_page import StandalonePage, rendered, source_of

LOOKS = {"chatter": "failed", "not decided": "attention", "stable": "passed"}
MOST_LINES = 60
"""Tooth-passing frequencies that are marked."""
STRETCHES: tuple[Column[Stretch], ...] = (
    Column("From", lambda one: number(round(one.begins_s, 3)), "s"),
    Column("to", lambda one: number(one.begins_s + one.seconds), "s"),
    Column("speed", lambda one: number(one.verdict.speed_rpm, 4), "rev/min"),
    Column("verdict", lambda one: Cell(text=one.verdict.verdict,
                                       status=LOOKS[one.verdict.verdict])),
    Column("frequency", lambda one: number(one.verdict.frequency_Hz, 4), "Hz"),
    Column("why", lambda one: one.verdict.why),
)  # fmt: skip


def write_chatter_page(found: JudgedFile, file: Path, out: Path) -> None:
    """Write the page of a judged recording."""
    made, verdict = [source_of(file)], found.verdict
    speeds = [f"{one:.0f}" for one in verdict.stable_speeds_rpm]
    sentences = [f"{verdict.why[:1].upper()}{verdict.why[1:]}."]
    if verdict.confidence is not None:
        sentences.append(f"{100 * verdict.confidence:.0f} % of the cut or more agree with it.")
    page = StandalonePage(
        program=file.name, machine="", origin="recorded", running="Chatter",
        about=f"{number(found.file_seconds)} s of {', '.join(found.channels)}",
        status=LOOKS[verdict.verdict], word=verdict.verdict, sentences=sentences,
        key_figures=[
            ("Chatter frequency", f"{number(verdict.frequency_Hz, 4)} Hz", ""),
            ("Tooth passing", f"{number(verdict.tooth_passing_Hz, 4)} Hz", ""),
            ("Speeds to try", ", ".join(speeds) or "none", "rev/min"),
        ],
        sections=[
            Section(key="spectrum", title="Spectrum in the cut",
                    blocks=present(_spectrum(found.gravest, made))),
            Section(key="stretches", title="Every steady stretch",
                    blocks=present(tabulated("Stretches", found.stretches, STRETCHES, made))),
        ],
        computed="Computed from the recording alone, without a model of the machine.",
    )  # fmt: skip
    rendered(page, out.name, Made(command=CALLED.get(), files=tuple(made))).write(out)


def _spectrum(one: Stretch, made: list[Source]) -> Figures | None:
    """Spectrum of a stretch with its lines; None without a cut."""
    verdict = one.verdict
    if not len(verdict.spectrum):
        return None
    f = np.asarray(verdict.frequency, float)
    level = 10 * np.log10(np.maximum(verdict.spectrum, 1e-3))
    passing = [k * verdict.tooth_passing_Hz for k in range(1, MOST_LINES + 1)]
    lines = [Block(kind="s-before", start=x, end=x, words=f"{k} × tooth passing")
             for k, x in enumerate(passing, start=1) if x <= f[-1]]  # fmt: skip
    if verdict.frequency_Hz is not None:
        words = f"chatter, {number(verdict.frequency_Hz, 4)} Hz"
        lines.append(Block(kind="s-over", start=verdict.frequency_Hz, end=verdict.frequency_Hz,
                           words=words))  # fmt: skip
    caption = f"Mean spectrum over its floor, {one.words}."
    strip = Strip(head="Level over the floor, dB", height=220.0, unit="dB", blocks=lines,
                  curves=[("measured", f, level)])  # fmt: skip
    figure = strips_figure([strip], axis("Frequency, Hz", (0.0, float(f[-1]))), caption)
    legend = [("l-measured", "recorded", "line"), ("s-before", "tooth passing", "box"),
              ("s-over", "chatter", "box")]  # fmt: skip
    return drawing(figure, caption, made, legend)
