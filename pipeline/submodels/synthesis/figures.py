"""Figures of generated signals: windows beside recorded ones, the judge's curve, spectra, a map."""

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, tick_words
from pipeline.schema.arrays import Floats
from pipeline.submodels.synthesis.model import WearCurve

TOP, HEIGHT, GAP = 18, 110, 30
"""Heights of the head, of a band, and between bands [px]."""
MAP = 260
"""Height of the map of features [px]."""


def windows_figure(
    rows: Sequence[tuple[str, Floats, Floats]], duration: float, label: str
) -> Markup:
    """A recorded window and a generated one after it, one pair below another.

    A row has words above a pair, recorded (L,) and generated (L,); a window lasts ``duration`` [s].
    """
    every = np.concatenate([np.concatenate([a, b]) for _, a, b in rows])
    parts: list[Markup] = []
    top = float(TOP)
    for words, real, made in rows:
        into = band(top, HEIGHT, every)
        middle, x = UNITS / 2, np.linspace(0, 0.48 * UNITS, len(real))
        parts += [
            svg.text(0, top - 6, words, "head"), *into.levels(3),
            into.content([
                svg.curve(x, into.down(real), "measured"),
                svg.curve(middle + x, into.down(made), "window"),
            ]),
        ]  # fmt: skip
        top = into.bottom + GAP
    bottom = top - GAP
    long = f"{duration:.3g} s" if duration >= 1.0 else f"{1e3 * duration:.3g} ms"
    for at, words in ((24.0, "recorded"), (74.0, "generated")):
        parts.append(svg.text(at, bottom + 16, f"{words}, {long}", "tick mid"))
    return svg.figure(parts, height=bottom + 26, label=label, kind="trace")


def curve_figure(one: WearCurve, unit: str, label: str) -> Markup:
    """Wear that the judge reads, with its 5 and 95 % quantiles, over the wear asked for."""
    asked, mean, low, high = (np.array(v) for v in (one.asked, one.mean, one.low, one.high))
    into = band(TOP, 2.0 * HEIGHT, low, high, asked)
    span = max(float(asked[-1] - asked[0]), 1e-12)
    x = UNITS * (asked - asked[0]) / span
    around = np.concatenate([into.down(high), into.down(low[::-1])])
    area = svg.path_data(np.concatenate([x, x[::-1]]), around) + "z"
    parts = [svg.text(0, TOP - 6, f"Wear read by the judge, {unit}", "head"), *into.levels(5)]
    parts += _marks(asked[0], asked[-1], into, f"Wear asked for, {unit}")
    parts.append(
        into.content([
            svg.tag("path", d=area, class_="s-band"),
            svg.curve(x, into.down(asked), "measured"),
            svg.curve(x, into.down(mean), "window"),
        ])
    )  # fmt: skip
    return svg.figure(parts, height=into.bottom + 38, label=label, kind="trace")


def spectra_figure(channels: Sequence[tuple[str, Floats, Floats, Floats]], label: str) -> Markup:
    """Power in bands of recorded and generated windows, on a logarithmic scale of frequency.

    Each channel has words; frequency [Hz], recorded and generated level [dB], (B,) each.
    """
    parts: list[Markup] = []
    top = float(TOP)
    for words, frequency, real, made in channels:
        into = band(top, HEIGHT, real, made)
        place = np.log10(frequency)
        x = UNITS * (place - place[0]) / max(place[-1] - place[0], 1e-12)
        parts += [
            svg.text(0, top - 6, words, "head"), *into.levels(3),
            into.content([
                svg.curve(x, into.down(real), "measured"), svg.curve(x, into.down(made), "window"),
            ]),
        ]  # fmt: skip
        top = into.bottom + GAP
        ends = (frequency[0], frequency[-1])
    bottom = top - GAP
    if channels:
        parts += [
            svg.text(0, bottom + 16, f"{tick_words(float(f'{ends[0]:.3g}'))} Hz", "tick"),
            svg.text(100, bottom + 16, f"{tick_words(float(f'{ends[1]:.3g}'))} Hz", "tick end"),
        ]
    return svg.figure(parts, height=bottom + 26, label=label, kind="trace")


def map_figure(recorded: Floats, generated: Floats, label: str) -> Markup:
    """Two principal components of the features of recorded and generated windows, as points."""
    both = np.vstack([recorded, generated])
    wide, tall = (band(0.0, 1.0, both[:, k]) for k in (0, 1))
    into = Band(top=TOP, height=MAP, low=tall.low, high=tall.high)
    parts = [svg.text(0, TOP - 6, "Second principal component of the features", "head")]
    parts += [*into.levels(4), *_marks(wide.low, wide.high, into, "First principal component")]
    for some, kind in ((recorded, "s-before"), (generated, "s-after")):
        for a, b in some:
            at = 100.0 * (a - wide.low) / (wide.high - wide.low)
            parts.append(
                svg.tag("circle", cx=f"{at:.2f}%", cy=into.pixel(float(b)), r=2, class_=kind)
            )
    return svg.figure(parts, height=into.bottom + 38, label=label, kind="trace")


def _marks(low: float, high: float, into: Band, words: str) -> list[Markup]:
    """Lines down and words at round values of the x axis."""
    parts = [svg.text(50, into.bottom + 31, words, "tick mid")]
    for mark in svg.ticks(float(low), float(high), most=8):
        x = 100.0 * (mark - float(low)) / max(float(high - low), 1e-12)
        parts.append(svg.down(x, into.top, into.bottom))
        parts.append(svg.text(x, into.bottom + 16, tick_words(mark), svg.anchor(x)))
    return parts
