"""Page of the residual following error beyond the drives' model: networks, their attention."""

from collections.abc import Iterator

import numpy as np

from pipeline.charts.bands import Strip, axis, strips_figure
from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import as_stated, counted, joined, number, percent
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.submodel_page import Counting, PageContent, declared, made_from
from pipeline.charts.words import page_words
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

WORDS = page_words(__file__)
BASES = {PREDICTION: TWIN, ESTIMATION: PERSISTENCE}
"""Baseline of each use."""
USES, SETTINGS = WORDS.table("uses"), WORDS.table("settings")
"""Uses, and settings of the search, in words."""
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
    letters = [] if model is None else [axis for axis in model.axes if use in model.axes[axis]]
    todo = WORDS.table("todo", machine=shown.machine)
    if use == ESTIMATION:
        todo["passed"] = WORDS("no_command")
    return declared(
        WORDS,
        about=WORDS("about.drive" if with_drive else "about.no_drive"),
        counts=[
            Counting(key="following_residual_max_um", error="max", quantity=QUANTITIES[use],
                     whole=True, name=WORDS(f"largest.{use}")),
            Counting(key="following_residual_rms_um", quantity=QUANTITIES[use], whole=True,
                     name=WORDS(f"rms.{use}")),
        ],
        guess=BASES[use],
        titles=words,
        todo=todo,
        facts=[] if model is None else list(_facts(model)),
        figures=[] if model is None else [_attention(shown, model), _history(shown, model)],
        tried=[] if model is None else list(_tried(shown, model, words)),
        drawn=[Drawn(quantity=f"{QUANTITIES[use]} {letter}", error="max",
                     other=(BASES[use], words[BASES[use]])) for letter in letters],
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
        yield WORDS("by_time", axes=joined(by_time))
    late = [axis for axis, uses in model.axes.items() if PREDICTION not in uses]
    if late:
        yield WORDS("late", axes=joined(late), horizon=number(1e3 * model.horizon_s))
    leak = model.leak
    if leak is not None:
        gain = "" if leak.rmse_um < leak.honest_um else WORDS("leak.no_gain")
        yield WORDS(
            "leak.text", axis=leak.axis, rmse=number(leak.rmse_um), honest=number(leak.honest_um),
            kind=NAMES.get(leak.kind, leak.kind), gain=gain,
        )  # fmt: skip
    search = model.search
    if search is None:
        return
    chosen = joined(
        [f"{_setting(n)} {as_stated(v, 3)}" for n, v in search.chosen.items()] or ["none"]
    )
    yield WORDS(
        "search.text", kind=NAMES.get(search.kind, search.kind), axis=search.axis,
        method=search.method, candidates=counted(search.candidates, "candidate"),
        pruned=number(search.pruned), chosen=chosen,
    )  # fmt: skip
    if search.bounds_hit:
        hit = joined([f"{_setting(n)} ({end})" for n, end in search.bounds_hit.items()])
        yield WORDS("search.bound", hit=hit)


def _setting(name: str) -> str:
    last = name.rpartition(".")[2]
    return SETTINGS.get(last, last.replace("_", " "))


def _attention(shown: Seen, model: ResidualModel) -> Figures | None:
    one = model.attention
    if one is None or not one.weights:
        return None
    caption = WORDS("attention.caption", axis=one.axis, kind=NAMES[ATTENTIVE])
    ms = np.array(one.ms)
    low = float(ms[0] - (ms[-1] - ms[0]) / max(2 * (len(ms) - 1), 1))
    strip = Strip(head=WORDS("attention.weight"), zero=True, height=150, curves=[
        (REGIME_CURVES[name], ms, np.array(values)) for name, values in one.weights.items()
    ])  # fmt: skip
    below = axis(WORDS("attention.time"), (low, 0.0))
    figure = Figure(svg=strips_figure([strip], below, caption), caption=caption,
                    sources=made_from(shown, "model.json"))  # fmt: skip
    return Figures(
        figures=[figure], kind="one", folded=WORDS("attention.head"),
        legend=[(f"l-{REGIME_CURVES[name]}", name, "line") for name in one.weights],
    )  # fmt: skip


def _history(shown: Seen, model: ResidualModel) -> Figures | None:
    search = model.search
    if search is None or not search.history_um:
        return None
    history = np.array(search.history_um, float)
    gain = percent(float(history[0] - history[-1]), float(history[0]))
    caption = WORDS(
        "history.caption", kind=NAMES.get(search.kind, search.kind), axis=search.axis, gain=gain,
        first=number(float(history[0])), last=number(float(history[-1])),
    )  # fmt: skip
    at = np.arange(1.0, len(history) + 1)
    strip = Strip(head=WORDS("history.rmse"), height=150, curves=[("window", at, history)])
    below = axis("Generation", (1.0, max(float(at[-1]), 2.0)))
    figure = Figure(svg=strips_figure([strip], below, caption), caption=caption,
                    sources=made_from(shown, "model.json"))  # fmt: skip
    return Figures(figures=[figure], kind="one", folded=WORDS("history.head"))
