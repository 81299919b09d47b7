"""Page of tool wear: tools due, wear over the life of held-out tools, methods, errors."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import TOGETHER, counted, fixed, number
from pipeline.charts.submodel_page import Counting, PageContent, declared, made_from
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.charts.words import page_words
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear.due_page import (
    due_actions,
    due_key_figures,
    due_lead,
    due_notes,
    due_section,
    due_truth,
)
from pipeline.submodels.wear.fit import balanced_accuracy
from pipeline.submodels.wear.model import GUESS, MEAN, NAMES, WEAR, WearModel

WORDS = page_words(__file__)
LIFE = "life_length"
"""Beginning of the names of the parameters that the type of a tool ends."""
Seen = Shown[WearModel]


def content(shown: Seen) -> PageContent:
    """Page content of tool wear."""
    model = shown.model
    quantity = WEAR if model is None else model.quantity
    timed = model is not None and model.progress_unit in ("s", "min", "h")
    unit = "" if model is None or model.progress_unit == "1" else model.progress_unit
    use = WORDS("axis.use", unit="min" if timed else unit) if unit else WORDS("axis.recordings")
    return declared(
        WORDS,
        about="" if model is None else _about(model),
        counts=[Counting(key="wear_rmse", name=WORDS("count", quantity=quantity),
                         quantity=quantity, whole=True)],
        guess=GUESS,
        titles=NAMES,
        todo=WORDS.table("todo", machine=shown.machine),
        facts=[] if model is None else [_beaten(model)],
        head=[*_accuracy(shown), *due_key_figures(shown)],
        notes=due_notes(shown),
        actions=due_actions(shown),
        lead=due_lead(shown),
        meaning=lambda group, name: WORDS.meaning(group, LIFE if name.startswith(LIFE) else name),
        tried=[] if model is None else list(_tried(shown, model)),
        drawn=[Drawn(quantity=quantity, axis=use, factor=1 / 60.0 if timed else 1.0,
                     other=(GUESS, NAMES[GUESS]))],
        of_judgement=[] if model is None else [_where(shown, model)],
        first=[due_section(shown)],
        truths=due_truth(shown),
    )  # fmt: skip


def _about(model: WearModel) -> str:
    seconds = model.length / model.rate_Hz
    long = number(seconds) if seconds >= 1.0 else number(1e3 * seconds)
    length = f"{long}{TOGETHER}{'s' if seconds >= 1.0 else 'ms'}"
    return WORDS("about", length=length, channels=counted(len(model.channels), "channel"))


def _beaten(model: WearModel) -> str:
    """Note that a baseline without sensors is better on held-out training tools, where it is."""
    simple = [model.scores[name].rmse for name in (GUESS, MEAN) if name in model.scores]
    if not simple or min(simple) > model.scores[model.champion].rmse:
        return ""
    return WORDS("beaten")


def _tried(shown: Seen, model: WearModel) -> Iterator[Tried]:
    verdict = shown.verdict
    total = None if verdict is None else verdict.total(model.quantity)
    for name, score in model.scores.items():
        own = name == model.champion
        later = None if total is None else total if own else total.baselines.get(name)
        yield Tried(label=NAMES[name], error=score.rmse, unit="" if model.is_class else "µm",
                    serves=own, later=later)  # fmt: skip


def _rows(shown: Seen) -> Any:
    """Predictions of the tools that decided; None without any."""
    rows, verdict, model = shown.predictions, shown.verdict, shown.model
    if rows is None or verdict is None or model is None:
        return None
    rows = rows[(rows["quantity"] == model.quantity) & (rows["role"] == verdict.judged_role)]
    return rows if len(rows) else None


def _accuracy(shown: Seen) -> list[tuple[str, str, str]]:
    """Balanced accuracy over the windows that decided, of a class."""
    rows = _rows(shown)
    if rows is None or shown.model is None or not shown.model.is_class:
        return []
    found = balanced_accuracy(*(rows[name].to_numpy(float) for name in ("predicted", "measured")))
    if found is None:
        return []
    share = f"{fixed(100 * found, 0)}{TOGETHER}%"
    return [(WORDS("accuracy.name"), share, WORDS("accuracy.aside"))]


WHERE: tuple[Column[tuple[str, float, float, Any]], ...] = (
    Column("Wear", lambda row: row[0]),
    Column("from", lambda row: fixed(row[1], 0), "µm"),
    Column("to", lambda row: fixed(row[2], 0), "µm"),
    Column("readings", lambda row: number(len(row[3])), ""),
    Column("RMSE", lambda row: fixed(float(np.sqrt(np.mean(row[3] ** 2))), 0), "µm"),
    Column("estimated too high by", lambda row: fixed(float(row[3].mean()), 0), "µm"),
)


def _where(shown: Seen, model: WearModel) -> Table | None:
    """Errors by measured wear, in thirds of the training range."""
    rows = _rows(shown)
    if rows is None or model.is_class:
        return None
    rows = rows[rows["scored"]]
    edges = np.linspace(*model.learnt, 4)
    place = np.clip(np.searchsorted(edges, rows["measured"], side="right") - 1, 0, 2)
    thirds = list(WORDS.table("thirds").values())
    error = (rows["predicted"] - rows["measured"]).to_numpy(float)
    parts = [(thirds[k], edges[k], edges[k + 1], error[place == k])
             for k in range(3) if (place == k).any()]  # fmt: skip
    return tabulated(WORDS("where"), parts, WHERE, made_from(shown, "predictions.parquet"))
