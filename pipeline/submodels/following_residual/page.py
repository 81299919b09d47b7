"""Page of the residual following error beyond the drives' model: networks, their attention."""

from collections.abc import Iterator

import numpy as np

from pipeline.charts.bands import Strip, axis, strips_figure
from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import TOGETHER, as_stated, counted, joined, number, percent
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.submodels.contract import Shown
from pipeline.submodels.following_residual.features import BEND, EVEN, REST, TURN
from pipeline.submodels.following_residual.model import (
    ATTENTIVE,
    ESTIMATION,
    NAMES,
    PERSISTENCE,
    PREDICTION,
    QUANTITIES,
    TWIN,
    ResidualModel,
    titles,
)

BASES = {PREDICTION: TWIN, ESTIMATION: PERSISTENCE}
"""Baseline of each use."""
USES = {PREDICTION: "predicted before the motion", ESTIMATION: "estimated from measurements"}
"""Uses in words."""
SETTINGS = {"learning_rate": "learning rate", "l2": "penalty of the weights"}
"""Settings of the search in words."""
REGIME_CURVES = {REST: "f0", TURN: "f1", BEND: "f3", EVEN: "f5"}
"""CSS classes of regimes."""

Seen = Shown[ResidualModel]


def content(shown: Seen) -> PageContent:
    """Page content of the residual networks."""
    model = shown.model
    with_drive = model is None or model.with_drive
    use = next((use for use in (PREDICTION, ESTIMATION) if model is not None
                and any(use in uses for uses in model.axes.values())), PREDICTION)  # fmt: skip
    words = titles(with_drive=with_drive)
    command = f"kerf simulate PROGRAM --machine {shown.machine} --corrected FILE"
    letters = [] if model is None else [axis for axis in model.axes if use in model.axes[axis]]
    return PageContent(
        about="The model of the drives does not cover the whole following error: friction at "
        "reversals, ripple of the screw and the like remain. A network learns that rest from "
        "recordings." if with_drive else
        "This machine has no model of its drives, so the following error itself is learnt, not "
        "what such a model leaves over.",
        rules="Each network was trained several times, each time without some of the training "
        "recordings, and compared on those; the one with the least RMSE serves. ARX is the linear "
        "one. Only recordings that nothing was learnt from are judged.",
        case="recording",
        counts=(
            Counting(key="following_residual_max_um", error="max", quantity=QUANTITIES[use],
                     whole=True, name=f"Largest following error not {USES[use].split()[0]}"),
            Counting(key="following_residual_rms_um", quantity=QUANTITIES[use], whole=True,
                     name=f"RMS of the following error not {USES[use].split()[0]}"),
        ),
        guess=BASES[use],
        titles=words,
        todo={
            "passed": f"To have a command that takes the error off before the motion: {command}."
            if use == PREDICTION else "Record the commanded positions too: only then can the "
            "command be corrected before the motion.",
            "failed": "Run no corrected command of this model; record further motions of the kind "
            "that is wrong.",
            "unknown": "Keep recordings of each axis out of the training set, to judge it by.",
        },
        facts=[] if model is None else list(_facts(model)),
        figures=[] if model is None else [_attention(shown, model), _history(shown, model)],
        tried=[] if model is None else list(_tried(shown, model, words)),
        drawn=[Drawn(quantity=f"{QUANTITIES[use]} {letter}", error="max",
                     other=(BASES[use], words[BASES[use]])) for letter in letters],
        shown_facts=("greatest error",),
    )  # fmt: skip


def _tried(shown: Seen, model: ResidualModel, words: dict[str, str]) -> Iterator[Tried]:
    for letter, uses in model.axes.items():
        for use, one in uses.items():
            verdict = shown.verdict
            total = None if verdict is None else verdict.total(f"{QUANTITIES[use]} {letter}")
            for kind, score in one.scores.items():
                own = kind == one.champion
                later = None if total is None else total if own else total.baselines.get(kind)
                yield Tried(task=f"{letter}, {USES[use]}", label=words.get(kind, kind),
                            error=score.rmse_um, unit="µm", spread=score.spread_um or None,
                            serves=own, later=later)  # fmt: skip


def _facts(model: ResidualModel) -> Iterator[str]:
    by_time = [axis for axis, uses in model.axes.items()
               if any(one.by_time for one in uses.values())]  # fmt: skip
    if by_time:
        yield (
            f"Of {joined(by_time)} there are too few recordings to leave whole ones out: networks "
            "were chosen on stretches of time left out, which flatters them."
        )
    late = [axis for axis, uses in model.axes.items() if PREDICTION not in uses]
    if late:
        yield (
            f"Of {joined(late)} no command was recorded, so nothing can be predicted before the "
            "motion: the error is estimated from measurements that are "
            f"{number(1e3 * model.horizon_s)}{TOGETHER}ms old or older."
        )
    leak = model.leak
    if leak is not None:
        gain = "" if leak.rmse_um < leak.honest_um else ", and here it would gain nothing"
        yield (
            f"With the measured position among the inputs, as published, the RMS error of "
            f"{leak.axis} on recordings left out would read {number(leak.rmse_um)} µm instead of "
            f"{number(leak.honest_um)} µm ({NAMES.get(leak.kind, leak.kind)}). Nobody knows that "
            f"position before the motion{gain}: such inputs are refused."
        )
    search = model.search
    if search is None:
        return
    chosen = joined(
        [f"{_setting(n)} {as_stated(v, 3)}" for n, v in search.chosen.items()] or ["none"]
    )
    yield (
        f"Settings of {NAMES.get(search.kind, search.kind)} were searched on {search.axis} "
        f"({search.method}): {counted(search.candidates, 'candidate')} trained, "
        f"{number(search.pruned)} of them stopped early. Chosen: {chosen}."
    )
    if search.bounds_hit:
        hit = joined([f"{_setting(n)} ({end})" for n, end in search.bounds_hit.items()])
        yield f"The best value lies on a bound of {hit}: a wider search may find better."


def _setting(name: str) -> str:
    last = name.rpartition(".")[2]
    return SETTINGS.get(last, last.replace("_", " "))


def _attention(shown: Seen, model: ResidualModel) -> Figures | None:
    one = model.attention
    if one is None or not one.weights:
        return None
    caption = (
        f"Axis {one.axis}, {NAMES[ATTENTIVE]}: mean weight of its attention over the window, on a "
        "motion to and fro at half of the highest speed learnt."
    )
    ms = np.array(one.ms)
    low = float(ms[0] - (ms[-1] - ms[0]) / max(2 * (len(ms) - 1), 1))
    strip = Strip(head="Mean weight", zero=True, height=150, curves=[
        (REGIME_CURVES[name], ms, np.array(values)) for name, values in one.weights.items()
    ])  # fmt: skip
    below = axis("Time before the one that is predicted, ms", (low, 0.0))
    figure = Figure(svg=strips_figure([strip], below, caption), caption=caption,
                    sources=made_from(shown, "model.json"))  # fmt: skip
    return Figures(
        figures=[figure], kind="one", folded="Where the network with attention looks",
        legend=[(f"l-{REGIME_CURVES[name]}", name, "line") for name in one.weights],
    )  # fmt: skip


def _history(shown: Seen, model: ResidualModel) -> Figures | None:
    search = model.search
    if search is None or not search.history_um:
        return None
    history = np.array(search.history_um, float)
    gain = percent(float(history[0] - history[-1]), float(history[0]))
    caption = (
        f"Search of the settings of {NAMES.get(search.kind, search.kind)} on {search.axis}: best "
        f"RMSE after each generation, from {number(float(history[0]))} to "
        f"{number(float(history[-1]))} µm ({gain} less)."
    )
    at = np.arange(1.0, len(history) + 1)
    strip = Strip(head="Best validation RMSE, µm", height=150, curves=[("window", at, history)])
    below = axis("Generation", (1.0, max(float(at[-1]), 2.0)))
    figure = Figure(svg=strips_figure([strip], below, caption), caption=caption,
                    sources=made_from(shown, "model.json"))  # fmt: skip
    return Figures(figures=[figure], kind="one", folded="How the settings were searched")
