"""Figures of the generated signals: windows, readers' curves, map of features, spectra."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.charts.bands import Axis, Strip, axis, band, strips_figure, tick_words
from pipeline.charts.numbers import number, unit_words
from pipeline.charts.sections import Figure, Figures, drawing
from pipeline.charts.sources import Source
from pipeline.charts.submodel_page import made_from
from pipeline.charts.words import page_words
from pipeline.nets.diversity import FeatureScaling
from pipeline.schema.arrays import Floats
from pipeline.submodels.contract import Shown
from pipeline.submodels.synthesis import judging
from pipeline.submodels.synthesis.model import (
    GeneratorFile,
    Reference,
    SynthesisModel,
    reference_of,
)

WORDS = page_words(__file__)
POINTS = 250
"""Points of each kind on the map of features [1]."""
CHANNELS_SHOWN = 3
"""Channels whose windows and spectra are drawn [1]."""
LEGEND = [("l-measured", "recorded", "line"), ("l-window", "generated", "line")]

Seen = Shown[SynthesisModel]


def amount(model: SynthesisModel, value: float) -> str:
    """A wear with its unit."""
    return f"{number(value)} {'' if model.is_class else 'µm'}".rstrip()


def model_figures(shown: Seen, model: SynthesisModel) -> Figures:
    """Windows, the judges' curves and the map of features."""
    path = shown.folder / "generator.json"
    stored = None if shown.shelf is None else shown.shelf.read(path, GeneratorFile)
    known = None if stored is None else reference_of(stored)
    made = made_from(shown, "model.json", "generator.json")
    found = []
    if known is not None:
        many = min(CHANNELS_SHOWN, len(model.channels))
        found += [_windows(model, known, k, made) for k in range(many)]
    for name, one in model.curves.items():
        wear, mean, low, high = (np.array(v) for v in (one.asked, one.mean, one.low, one.high))
        unit = "" if model.is_class else ", µm"
        strip = Strip(
            head=WORDS("read", judge=name, unit=unit), height=220,
            areas=[("s-band", wear, low, high)],
            curves=[("measured", wear, wear), ("window", wear, mean)],
        )  # fmt: skip
        below = axis(WORDS("given", unit=unit), (float(wear[0]), float(wear[-1])))
        found.append(_figure([strip], below, WORDS("curve", judge=name), made))
    if known is not None:
        found.append(_map(known, made))
    return Figures(figures=found, legend=[*LEGEND, ("s-band", WORDS("band"), "box")])


def _figure(strips: Sequence[Strip], below: Axis, words: str, made: list[Source]) -> Figure:
    return Figure(svg=strips_figure(strips, below, words), caption=words, sources=made)


def _windows(model: SynthesisModel, known: Reference, channel: int, made: list[Source]) -> Figure:
    """Recorded windows of a channel over generated ones at the same wear."""
    unit = unit_words(model.units[channel])
    said = f"{model.channels[channel].replace('_', ' ')}{f', {unit}' if unit else ''}"
    ms = np.linspace(0.0, 1e3 * (model.length - 1) / model.rate_Hz, model.length)
    every = band(0, 1, known.shown[:, channel].ravel(), known.like[:, channel].ravel())
    strips = [
        Strip(head=f"wear {amount(model, float(wear))}", height=110, scale=(every.low, every.high),
              curves=[("measured", ms, real[channel]), ("window", ms, fake[channel])])
        for wear, real, fake in zip(known.shown_wear, known.shown, known.like, strict=True)
    ]  # fmt: skip
    words = WORDS("windows", channel=f"{said[:1].upper()}{said[1:]}")
    return _figure(strips, axis("Time, ms", (0.0, float(ms[-1]))), words, made)


def _map(known: Reference, made: list[Source]) -> Figure:
    """Two principal components of the features of recorded and generated windows, as points."""
    scaling = FeatureScaling.of(known.recorded)
    real, fake = scaling(known.recorded), scaling(known.generated)
    centre = real.mean(axis=0)
    _, _, axes = np.linalg.svd(real - centre, full_matrices=False)
    every = max(-(-len(real) // POINTS), 1)
    points: list[Floats] = [(one[::every] - centre) @ axes[:2].T for one in (real, fake)]
    across = band(0, 1, *(one[:, 0] for one in points))
    ranked: list[Floats] = [one[np.argsort(one[:, 0])] for one in points]
    strip = Strip(head=WORDS("second"), height=260, dots=[
        (css, one[:, 0], one[:, 1])
        for css, one in zip(("s-before", "s-after"), ranked, strict=True)
    ])  # fmt: skip
    below = axis(WORDS("first"), (across.low, across.high))
    return _figure([strip], below, WORDS("map"), made)


def spectra(shown: Seen, model: SynthesisModel) -> Figures | None:
    """Power in bands of recorded and generated windows of tools that decide, over frequency."""
    frame, verdict = shown.predictions, shown.verdict
    if frame is None or verdict is None or not len(frame):
        return None
    rows: Any = frame[
        (frame["quantity"] == judging.SPECTRUM) & (frame["role"] == verdict.judged_role)
    ]
    strips, frequency = [], np.zeros(0)
    for channel in model.channels[:CHANNELS_SHOWN]:
        mean = rows[rows["regime"] == channel].groupby("t")[["measured", "predicted"]].mean()
        if len(mean) > 1:
            frequency = mean.index.to_numpy(float)
            place: Floats = np.log10(frequency)
            real: Floats = mean["measured"].to_numpy(float)
            made: Floats = mean["predicted"].to_numpy(float)
            curves = [("measured", place, real), ("window", place, made)]
            head = f"{channel.replace('_', ' ')}, dB"
            strips.append(Strip(head=head, height=110, curves=curves))
    if not strips:
        return None
    marks = [(float(np.log10(f)), tick_words(float(f"{f:.3g}")))
             for f in (frequency[0], frequency[len(frequency) // 2], frequency[-1])]  # fmt: skip
    below = Axis(words="Frequency, Hz", span=(marks[0][0], marks[-1][0]), marks=marks)
    words = WORDS("spectra")
    figure, source = strips_figure(strips, below, words), made_from(shown, "predictions.parquet")
    return drawing(figure, words, source, LEGEND, kind="one")
