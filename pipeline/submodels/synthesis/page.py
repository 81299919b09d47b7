"""Page of the generated signals: their wear by the readers, their use in training."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from pipeline.charts.bands import Axis, Strip, axis, band, strips_figure, tick_words
from pipeline.charts.cases import Drawn
from pipeline.charts.numbers import counted, joined, number, unit_words
from pipeline.charts.sections import Figure, Figures, drawing
from pipeline.charts.sources import Source
from pipeline.charts.submodel_page import Counting, PageContent, made_from
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

Seen = Shown[SynthesisModel]
POINTS = 250
"""Points of each kind on the map of features [1]."""
CHANNELS_SHOWN = 3
"""Channels whose windows and spectra are drawn [1]."""


def content(shown: Seen) -> PageContent:
    """Page content of generated signals."""
    model = shown.model
    judges = [""] if model is None or not model.judges else model.judges
    judge = judges[0]
    stored = None
    if shown.shelf is not None and model is not None:
        stored = shown.shelf.read(shown.folder / "generator.json", GeneratorFile)
    return PageContent(
        about="A network makes signals at a given wear and given conditions of the cut. They are "
        "synthetic, learnt from "
        f"{'windows' if model is None else counted(model.windows, 'window')} of "
        f"{'simulated ' * (shown.origin == 'simulated')}records of tools in training.",
        rules="Figures are of tools that were held out: the wear that a judge reads from generated "
        "windows against the wear that was asked for; the wear of recorded windows by learners "
        "that saw generated ones. Distance between windows of the same conditions: a collapsed "
        "generator has −100 %. Distance to the nearest training window: a copy has −100 %. The "
        "nearest training windows are those of other tools at about the same wear."
        + (f" The error of the wear read over all tools is that of the {judge}." if judge else ""),
        case="tool",
        counts=(
            Counting(key="generated_wear_mae", name="Error of the wear read from generated signals",
                     quantity=judging.GENERATED, regime=judge, error="mae", whole=True),
            *(Counting(key=f"generated_wear_rmse_{k}" if k else "generated_wear_rmse",
                       name=f"RMSE of the wear read{f' by the {name}' if name else ''}, worst tool",
                       quantity=judging.GENERATED, regime=name) for k, name in enumerate(judges)),
        ),
        guess=judging.MEAN,
        titles=judging.TITLES,
        todo={
            "passed": "Signals at a wear that was not recorded: kerf synthesise --machine "
            f"{shown.machine} --wear VALUE --out FILE.",
            "failed": "Use them for no purpose but trials; train longer, or record more tools.",
            "unknown": "Keep tools out of roles.training, to judge by.",
        },
        facts=[_augmentation(shown), *([] if model is None else _curve_words(shown, model))],
        notes=[] if model is None else list(model.faults),
        figures=[] if model is None else [
            _figures(shown, model, None if stored is None else reference_of(stored))
        ],
        drawn=[Drawn(quantity=judging.GENERATED, regime=judge, error="mae", axis="Use of the tool",
                     other=(judging.RECORDED, "read from recorded signals"))],
        shown_facts=("coverage", "density", "bias", "windows"),
        of_judgement=[] if model is None else [_spectra(shown, model)],
    )  # fmt: skip


def _amount(model: SynthesisModel, value: float) -> str:
    return f"{number(value)} {'' if model.is_class else 'µm'}".rstrip()


def _augmentation(shown: Seen) -> str:
    """Whether generated windows help to learn the wear of recorded ones."""
    skills = () if shown.verdict is None else shown.verdict.skills
    pair = judging.AUGMENTED, judging.RECORDED
    one = next((s for s in skills if (s.quantity, s.baseline) == pair and s.mae is not None), None)
    if one is None or one.mae is None:
        return ""
    ends, way = one.mae_interval_95, 1.0 if one.mae > 0 else -1.0
    if ends is None:
        interval, use = f"{counted(one.groups, 'tool')}, too few for an interval", ""
    else:
        low, high = sorted(100 * way * end for end in ends)
        interval = f"95 % interval {number(low)} to {number(high)} %"
        use = " That is harm, so none are used for learning." if ends[1] < 0 else ""
    if ends is None or ends[0] <= 0 <= ends[1]:
        use = " That is not shown to be real, so none are used for learning."
    return (
        f"Generated windows beside the recorded ones {'lower' if one.mae > 0 else 'raise'} the "
        f"mean error of wear by {number(100 * abs(one.mae))} % ({interval}).{use}"
    )


def _curve_words(shown: Seen, model: SynthesisModel) -> Iterator[str]:
    """Reading of the wear by each reader, and its course in training."""
    recorded = {}
    if shown.predictions is not None and shown.verdict is not None:
        recorded = judging.recorded_readings(shown.predictions, shown.verdict.judged_role)
    for name, one in model.curves.items():
        words = (
            f"Over {counted(len(one.asked), 'wear')} from {number(one.asked[0])} to "
            f"{_amount(model, one.asked[-1])} the {name} reads with a slope of "
            f"{number(one.slope)} and a rank correlation of {number(one.rank_correlation)} over "
            f"single windows, {number(one.rank_of_means)} over the mean of each wear."
        )
        if name in recorded:
            slope, rank = recorded[name]
            words += (
                f" From recorded windows of tools not learnt from it reads with a slope of "
                f"{number(slope)} and a rank correlation of {number(rank)}: a generator can hardly "
                "be read better."
            )
        if one.false_intervals:
            where = joined([f"{number(a)} to {number(b)}" for a, b in one.false_intervals])
            words += f" The reading falls while the wear grows from {where}: trust nothing there."
        yield words
    if len(model.looks) > 1:
        looked = joined([f"{_amount(model, one.mae)} after {one.step} steps"
                         for one in model.looks])  # fmt: skip
        yield f"In training the mean error of the {model.judges[0]} was {looked}."


# ---- figures


def _figures(shown: Seen, model: SynthesisModel, known: Reference | None) -> Figures:
    """Windows, the judges' curves and the map of features."""
    made = made_from(shown, "model.json", "generator.json")
    found = []
    if known is not None:
        many = min(CHANNELS_SHOWN, len(model.channels))
        found += [_windows(model, known, k, made) for k in range(many)]
    for name, one in model.curves.items():
        wear, mean, low, high = (np.array(v) for v in (one.asked, one.mean, one.low, one.high))
        unit = "" if model.is_class else ", µm"
        strip = Strip(
            head=f"Wear read by the {name}{unit}", height=220, areas=[("s-band", wear, low, high)],
            curves=[("measured", wear, wear), ("window", wear, mean)],
        )  # fmt: skip
        below = axis(f"Wear that was given{unit}", (float(wear[0]), float(wear[-1])))
        words = f"Wear that the {name} reads from generated windows; straight: the wear given."
        found.append(_figure([strip], below, words, made))
    if known is not None:
        found.append(_map(known, made))
    legend = [("l-measured", "recorded", "line"), ("l-window", "generated", "line"),
              ("s-band", "5 to 95 % of generated windows", "box")]  # fmt: skip
    return Figures(figures=found, legend=legend)


def _figure(strips: Sequence[Strip], below: Axis, words: str, made: list[Source]) -> Figure:
    return Figure(svg=strips_figure(strips, below, words), caption=words, sources=made)


def _windows(model: SynthesisModel, known: Reference, channel: int, made: list[Source]) -> Figure:
    """Recorded windows of a channel over generated ones at the same wear."""
    unit = unit_words(model.units[channel])
    said = f"{model.channels[channel].replace('_', ' ')}{f', {unit}' if unit else ''}"
    ms = np.linspace(0.0, 1e3 * (model.length - 1) / model.rate_Hz, model.length)
    every = band(0, 1, known.shown[:, channel].ravel(), known.like[:, channel].ravel())
    strips = [
        Strip(head=f"wear {_amount(model, float(wear))}", height=110, scale=(every.low, every.high),
              curves=[("measured", ms, real[channel]), ("window", ms, fake[channel])])
        for wear, real, fake in zip(known.shown_wear, known.shown, known.like, strict=True)
    ]  # fmt: skip
    words = f"{said[:1].upper()}{said[1:]}: windows of training tools, and generated at the same."
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
    strip = Strip(head="Second principal component of the features", height=260, dots=[
        (css, one[:, 0], one[:, 1])
        for css, one in zip(("s-before", "s-after"), ranked, strict=True)
    ])  # fmt: skip
    below = axis("First principal component", (across.low, across.high))
    words = "Features of recorded windows in training (orange) and of generated ones (blue)."
    return _figure([strip], below, words, made)


def _spectra(shown: Seen, model: SynthesisModel) -> Figures | None:
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
    words = "Power in bands, mean over the windows of tools not learnt from."
    legend = [("l-measured", "recorded", "line"), ("l-window", "generated", "line")]
    figure, source = strips_figure(strips, below, words), made_from(shown, "predictions.parquet")
    return drawing(figure, words, source, legend, kind="one")
