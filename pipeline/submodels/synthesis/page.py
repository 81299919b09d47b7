"""Page of the generated signals: what a judge reads from them, what can be learnt from them."""

from typing import Any

import numpy as np

from pipeline.charts.numbers import counted, joined, number, unit_words
from pipeline.charts.sections import (
    Compared,
    Figure,
    Figures,
    PartVerdict,
    Section,
    SubModelPage,
    absent,
    present,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Table, cells, names, numbers, sources
from pipeline.nets.diversity import FeatureScaling
from pipeline.schema.verdict import Score
from pipeline.submodels.contract import Shown
from pipeline.submodels.statistics import rank_correlation
from pipeline.submodels.synthesis import figures
from pipeline.submodels.synthesis.judging import (
    AUGMENTED,
    COPY,
    GENERATED,
    LEARNT,
    MEAN,
    ORDERS,
    RECORDED,
    SPECTRUM,
    SPREAD,
)
from pipeline.submodels.synthesis.model import (
    GeneratorFile,
    Reference,
    SynthesisModel,
    reference_of,
)

Seen = Shown[SynthesisModel]
POINTS = 250
"""Points of each kind on the map of features."""
CHANNELS_SHOWN = 3
"""Channels whose windows and spectra are drawn."""
NEEDS = "It needs whole tool lives with the wear measured in between; see docs/synthesis.md."


def page(shown: Seen) -> SubModelPage:
    """Everything that a machine's page says of generated signals."""
    total = _total(shown, GENERATED)
    unit = "" if shown.model is None else _unit(shown.model)
    return SubModelPage(
        verdict=_verdict(shown),
        key_figures=_key_figures(shown),
        notes=list(shown.model.faults) if shown.model is not None else [],
        sections=[_section(shown)],
        compared={
            "generated_wear_mae": Compared(
                name="Wear read from generated signals, mean error", unit=unit,
                value=None if total is None else total.mae,
            )
        },
    )  # fmt: skip


def _unit(model: SynthesisModel) -> str:
    return "" if model.is_class else "µm"


def _total(shown: Seen, quantity: str) -> Score | None:
    """Errors over all tools that decide; of wear by the first judge."""
    found = () if shown.verdict is None else shown.verdict.of(
        quantity, group="all", role=shown.verdict.judged_role or "held_out"
    )  # fmt: skip
    return found[0] if found else None


def _with_unit(value: float | None, unit: str) -> str:
    return f"{number(value)} {unit}".rstrip()


def _headline(shown: Seen) -> str:
    """What a judge reads, in a sentence or two."""
    total, model = _total(shown, GENERATED), shown.model
    if total is None or model is None:
        return ""
    unit = _unit(model)
    said = (
        f"From generated signals of {counted(len(_tools(shown)), 'tool')} not learnt from, a judge "
        f"reads the wear that was asked for to {_with_unit(total.mae, unit)} (mean error)"
    )
    real = total.baselines.get(RECORDED)
    if real is not None:
        said += f"; from the recorded signals themselves to {_with_unit(real.mae, unit)}"
    return f"{said}."


def _tools(shown: Seen) -> list[str]:
    """Tools that decide."""
    verdict = shown.verdict
    if verdict is None:
        return []
    role = verdict.judged_role or "held_out"
    return list(dict.fromkeys(one.group for one in verdict.cases if one.role == role))


def _augmentation(shown: Seen) -> str:
    """Whether generated windows help to learn the wear of recorded ones."""
    if shown.verdict is None:
        return ""
    for skill in shown.verdict.skills:
        if skill.quantity != AUGMENTED or skill.baseline != RECORDED or skill.mae is None:
            continue
        saved, ends = skill.mae, skill.mae_interval_95
        way = 1.0 if saved > 0 else -1.0
        if ends is None:
            interval = f"{counted(skill.groups, 'tool')}, too few for an interval"
        else:
            low, high = sorted(100 * way * end for end in ends)
            interval = f"95 % interval {number(low)} to {number(high)} %"
        if ends is not None and ends[0] > 0:
            use = ""
        elif ends is not None and ends[1] < 0:
            use = " That is harm, so none are used for learning."
        else:
            use = " That is not shown to be real, so none are used for learning."
        what = "lower" if saved > 0 else "raise"
        return (
            f"Generated windows beside the recorded ones {what} the mean error of wear by "
            f"{number(100 * abs(saved))} % ({interval}).{use}"
        )
    return ""


def _verdict(shown: Seen) -> PartVerdict | None:
    model, verdict = shown.model, shown.verdict
    if model is None and verdict is None:
        return None
    command = f"kerf synthesise --machine {shown.machine} --wear VALUE --out FILE"
    if verdict is None or verdict.status == "not judged":
        why = "; ".join(verdict.reasons) if verdict is not None else "no tool was held out"
        return PartVerdict(
            status="unknown",
            sentence=f"The generated signals have not been judged: {why.rstrip('.')}.",
            todo="Keep tools out of roles.training, to judge by.",
        )
    if verdict.status == "failed":
        reason = verdict.reasons[0] if verdict.reasons else "the judge gave no reason"
        return PartVerdict(
            status="failed",
            sentence=f"The generated signals failed: {reason.rstrip('.')}. {_headline(shown)}",
            todo="Use them for no purpose but trials; train longer, or record more tool lives.",
        )
    return PartVerdict(
        status="passed",
        sentence=f"{_headline(shown)} {_augmentation(shown)}".strip(),
        todo=f"Signals at a wear that was not recorded: {command}.",
    )


def _key_figures(shown: Seen) -> list[tuple[str, str, str]]:
    total, model = _total(shown, GENERATED), shown.model
    if total is None or model is None:
        return []
    mean = total.baselines.get(MEAN)
    aside = "" if mean is None else f"mean wear alone {_with_unit(mean.mae, _unit(model))}"
    return [
        ("Wear read from generated signals: mean error", _with_unit(total.mae, _unit(model)), aside)
    ]


def _section(shown: Seen) -> Section:
    model = shown.model
    key, title = "synthesis", "Generated signals of wear"
    if model is None:
        return Section(key=key, title=title, text=[absent(shown.folder / "model.json", NEEDS)])
    origin = "simulated records" if model.origin == "simulated" else "records"
    text = [
        "A network makes signals at a given wear and given conditions of the cut. They are "
        f"synthetic, learnt from {counted(model.windows, 'window')} of {origin} of tools in "
        "training; figures are of tools that were held out.",
        _headline(shown), _augmentation(shown), *_curve_words(model, _recorded(shown)),
    ]  # fmt: skip
    if model.faults:
        text.append("Of the training: " + "; ".join(model.faults) + ".")
    if shown.verdict is None:
        text.append(absent(shown.folder / "verdict.json", "Without it nothing is judged."))
    elif shown.verdict.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(shown.verdict.reasons) + ".")
    stored = None
    if shown.shelf is not None:
        stored = shown.shelf.read(shown.folder / "generator.json", GeneratorFile)
    known = None if stored is None else reference_of(stored)
    return Section(
        key=key, title=title, text=[words for words in text if words],
        blocks=present(
            _drawn(shown, known), _tools_table(shown), _spectra_table(shown),
        ),
    )  # fmt: skip


def _recorded(shown: Seen) -> dict[str, tuple[float, float]]:
    """Slope and rank correlation of each judge over recorded windows of tools not learnt from."""
    frame = shown.predictions
    if frame is None or shown.verdict is None or "baseline_recorded" not in frame:
        return {}
    frame = frame[(frame["quantity"] == GENERATED) & frame["group"].isin(_tools(shown))]
    found = {}
    for name, one in frame.groupby("regime"):
        one = one.dropna(subset=["measured", "baseline_recorded"])
        asked, read = one["measured"].to_numpy(), one["baseline_recorded"].to_numpy()
        if len(one) > 2 and np.ptp(asked) > 0 and np.ptp(read) > 0:
            rank = rank_correlation(asked, read)
            found[str(name)] = float(np.polyfit(asked, read, 1)[0]), rank
    return found


def _curve_words(model: SynthesisModel, recorded: dict[str, tuple[float, float]]) -> list[str]:
    said = []
    for name, one in model.curves.items():
        words = (
            f"Over {counted(len(one.asked), 'wear')} from {number(one.asked[0])} to "
            f"{_with_unit(one.asked[-1], _unit(model))} the {name} reads with a slope of "
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
        said.append(words)
    if len(model.looks) > 1:
        looked = joined(
            [f"{_with_unit(one.mae, _unit(model))} after {one.step} steps" for one in model.looks]
        )
        said.append(f"In training the mean error of the {model.judges[0]} was {looked}.")
    return said


def _made_from(shown: Seen, *files: str) -> list[Source]:
    return sources(shown.shelf, *(shown.folder / name for name in files))


def _drawn(shown: Seen, known: Reference | None) -> Figures | None:
    """Windows, the judge's curve, spectra and the map."""
    model = shown.model
    if model is None:
        return None
    found: list[Figure] = []
    if known is not None:
        many = min(CHANNELS_SHOWN, len(model.channels))
        found += [_windows(shown, model, known, k) for k in range(many)]
    for name, one in model.curves.items():
        said = f"Wear that the {name} reads from generated windows; straight: the wear asked"
        found.append(
            Figure(
                svg=figures.curve_figure(one, _unit(model), said), caption=f"{said}.",
                sources=_made_from(shown, "model.json"),
            )
        )  # fmt: skip
    spectra = _spectra(shown)
    if spectra:
        said = "Power in bands, mean over the windows of tools not learnt from, dB"
        found.append(
            Figure(
                svg=figures.spectra_figure(spectra[:CHANNELS_SHOWN], said), caption=f"{said}.",
                sources=_made_from(shown, "predictions.parquet"),
            )
        )  # fmt: skip
    if known is not None:
        found.append(_map(shown, known))
    legend = [("l-measured", "recorded", "line"), ("l-window", "generated", "line"),
              ("s-band", "5 to 95 % of generated windows", "box")]  # fmt: skip
    return Figures(figures=found, legend=legend) if found else None


def _windows(shown: Seen, file: SynthesisModel, mine: Reference, channel: int) -> Figure:
    unit = unit_words(file.units[channel])
    rows = [
        (f"wear {_with_unit(float(wear), _unit(file))}", real[channel], made[channel])
        for wear, real, made in zip(mine.shown_wear, mine.shown, mine.like, strict=True)
    ]
    said = f"{file.channels[channel].replace('_', ' ')}{f', {unit}' if unit else ''}"
    drawn = figures.windows_figure(rows, file.length / file.rate_Hz, said)
    words = f"{said[:1].upper()}{said[1:]}: windows of training tools, and generated at the same."
    return Figure(svg=drawn, caption=words, sources=_made_from(shown, "generator.json"))


def _spectra(shown: Seen) -> list[tuple[str, Any, Any, Any]]:
    """Words, frequency, recorded and generated level of each channel."""
    model, frame = shown.model, shown.predictions
    if model is None or frame is None or not len(frame):
        return []
    tools = _tools(shown)
    rows = frame[(frame["quantity"] == SPECTRUM) & frame["group"].isin(tools)]
    found = []
    for channel in model.channels:
        mean = rows[rows["regime"] == channel].groupby("t")[["measured", "predicted"]].mean()
        if len(mean) > 1:
            words = channel.replace("_", " ")
            real, made = (mean[name].to_numpy(float) for name in ("measured", "predicted"))
            found.append((words, mean.index.to_numpy(float), real, made))
    return found


def _map(shown: Seen, known: Reference) -> Figure:
    scaling = FeatureScaling.of(known.recorded)
    real, made = scaling(known.recorded), scaling(known.generated)
    centre = real.mean(axis=0)
    _, _, axes = np.linalg.svd(real - centre, full_matrices=False)
    every = max(-(-len(real) // POINTS), 1)
    first, second = ((one[::every] - centre) @ axes[:2].T for one in (real, made))
    said = "Features of recorded windows in training (orange) and of generated ones (blue)"
    return Figure(
        svg=figures.map_figure(first, second, said), caption=f"{said}.",
        sources=_made_from(shown, "generator.json"),
    )  # fmt: skip


def _tools_table(shown: Seen) -> Table | None:
    """Tools not learnt from: wear from generated windows, from what learners saw, distances."""
    verdict, model = shown.verdict, shown.model
    if verdict is None or model is None or not _tools(shown):
        return None
    unit = _unit(model)
    rows = []
    for tool in [*_tools(shown), "all"]:
        one = {q: verdict.of(q, group=tool, role=verdict.judged_role or "held_out")
               for q in (GENERATED, LEARNT, AUGMENTED, SPREAD, COPY)}  # fmt: skip
        score = {q: some[0] if some else None for q, some in one.items()}
        case = next((c for c in verdict.cases if c.group == tool), None)
        coverage = None if case is None else case.facts.get("coverage")
        generated = score[GENERATED]
        rows.append(
            cells(
                tool if tool != "all" else "all of them",
                *(number(None if s is None else s.mae)
                  for s in (generated, _base(generated), score[LEARNT], score[AUGMENTED])),
                number(_mean_percent(score[SPREAD])),
                number(_mean_percent(score[COPY])),
                number(None if coverage is None else coverage.value),
            )
        )  # fmt: skip
    return Table(
        caption="Tools not learnt from: mean error of wear, and how generated windows lie",
        heads=[
            *names("Tool"),
            *numbers(
                ("of generated windows", unit), ("of recorded ones, the judge alone", unit),
                ("learnt from generated", unit), ("learnt from both", unit),
                group="Mean error of wear",
            ),
            *numbers(("spread beyond recorded", "%"), ("distance beyond held-out", "%"),
                     ("coverage", "")),
        ],
        rows=rows, sources=_made_from(shown, "verdict.json"),
        note="Spread: distance of windows of the same conditions; a collapsed generator has −100. "
        "Distance: to the nearest training window; a copy has −100.",
    )  # fmt: skip


def _base(score: Score | None) -> Any:
    return None if score is None else score.baselines.get(RECORDED)


def _mean_percent(score: Score | None) -> float | None:
    return None if score is None else score.mean_percent


def _spectra_table(shown: Seen) -> Table | None:
    """Mean distance of levels by channel, beside that between tools."""
    verdict, model = shown.verdict, shown.model
    if verdict is None or model is None:
        return None
    rows = []
    for channel in model.channels:
        found = [
            next((s for s in verdict.of(q, group="all", role=verdict.judged_role or "held_out")
                  if s.regime == channel), None)
            for q in (SPECTRUM, ORDERS)
        ]  # fmt: skip
        band, order = found
        if band is None:
            continue
        other = band.baselines.get("nearest")
        rows.append(
            cells(
                channel.replace("_", " "), number(band.mae),
                number(None if other is None else other.mae),
                number(None if order is None else order.mae),
            )
        )  # fmt: skip
    if not rows:
        return None
    return Table(
        caption="Spectra of generated windows against those of tools not learnt from: mean "
        "difference of levels",
        heads=[*names("Channel"),
               *numbers(("generated, bands", "dB"), ("nearest training windows, bands", "dB"),
                        ("generated, spindle orders", "dB"))],
        rows=rows, sources=_made_from(shown, "verdict.json"),
        note="The nearest training windows are those of other tools at about the same wear: what "
        "tools differ by.",
    )  # fmt: skip
