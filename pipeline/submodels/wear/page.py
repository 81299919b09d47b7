"""Page of tool wear: wear over the life of tools held out, methods compared, where it errs."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from pipeline.charts.numbers import TOGETHER, counted, fixed, number
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
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.schema.predictions import BASELINE
from pipeline.schema.verdict import OutsideConditions, Score
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear import figures
from pipeline.submodels.wear.due_page import (
    due_actions,
    due_key_figures,
    due_notes,
    due_section,
    due_truth,
)
from pipeline.submodels.wear.fit import balanced_accuracy
from pipeline.submodels.wear.model import GUESS, MEAN, NAMES, MethodScore, WearModel

NEEDS = (
    "It is learnt from forces, vibration or currents in cut over the lives of three tools or more, "
    "with the flank wear measured from time to time."
)
MOST_DRAWN = 6
"""Tools that are drawn at most."""
THIRDS = ("slightly worn", "half worn", "worn most")
"""Ranges of the wear that was learnt."""

Seen = Shown[WearModel]


def page(shown: Seen) -> SubModelPage:
    """Everything that a machine's page says of its tools' wear."""
    facts = WearFacts(shown=shown)
    unit = "" if shown.model is None or shown.model.is_class else "um"
    total = facts.total
    return SubModelPage(
        verdict=_verdict(facts),
        key_figures=[*_key_figures(facts), *due_key_figures(shown)],
        actions=due_actions(shown),
        sections=[s for s in (due_section(shown), _section(facts)) if s is not None],
        truth=due_truth(shown),
        notes=due_notes(shown),
        compared={
            "wear_rmse": Compared(
                name="Wear of tools held out, RMSE", unit=unit,
                value=None if total is None else total.rmse,
            )
        },
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class WearFacts:
    """Everything that the page says, found once."""

    shown: Seen

    @property
    def is_class(self) -> bool:
        """Whether wear is worn or not."""
        return self.shown.model is not None and self.shown.model.is_class

    @property
    def label(self) -> str:
        """``" (simulated)"`` where the records are."""
        return " (simulated)" if self.shown.origin == "simulated" else ""

    @cached_property
    def total(self) -> Score | None:
        """Errors over all tools that decided."""
        shown = self.shown
        if shown.verdict is None or shown.model is None:
            return None
        return shown.verdict.total(shown.model.quantity)

    @cached_property
    def tools(self) -> list[Score]:
        """Errors of each tool that decided."""
        shown = self.shown
        if shown.verdict is None or shown.model is None:
            return []
        role = shown.verdict.judged_role
        found = shown.verdict.of(shown.model.quantity, role=role)
        return [one for one in found if one.group != "all"]

    @cached_property
    def rows(self) -> pd.DataFrame:
        """Predictions of the tools that decided; empty without any."""
        shown = self.shown
        if shown.predictions is None or shown.model is None or not len(shown.predictions):
            return pd.DataFrame()
        rows = shown.predictions
        groups = [one.group for one in self.tools]
        return rows[(rows["quantity"] == shown.model.quantity) & rows["group"].isin(groups)]

    @property
    def accuracy(self) -> float | None:
        """Balanced accuracy over the windows that decided [1]; None without both classes."""
        if not self.is_class or not len(self.rows):
            return None
        told, truth = (self.rows[n].to_numpy(float) for n in ("predicted", "measured"))
        return balanced_accuracy(told, truth)

    def amount(self, value: float | None) -> str:
        """Wear with its unit."""
        if value is None:
            return "–"
        return fixed(value, 2) if self.is_class else f"{fixed(value, 0)}{TOGETHER}µm"

    def error(self, score: Score, method: str) -> float | None:
        """RMSE of a method on a tool, or over all of them."""
        model = self.shown.model
        if model is not None and method == model.champion:
            return score.rmse
        other = score.baselines.get(method)
        return None if other is None else other.rmse

    def made_from(self, *names: str) -> list[Source]:
        """Files that a figure or table stands on."""
        return sources(self.shown.shelf, *(self.shown.folder / name for name in names))


# ---- in words


def _headline(facts: WearFacts) -> str:
    total, model = facts.total, facts.shown.model
    if total is None or model is None:
        return ""
    tools = counted(len(facts.tools), "tool")
    guess = facts.error(total, GUESS)
    against = "" if guess is None else f", {facts.amount(guess)} by a guess without sensors"
    if facts.is_class:
        found = facts.accuracy
        share = "" if found is None else f" Balanced accuracy {fixed(100 * found, 0)}{TOGETHER}%."
        return (
            f"The probability of a worn tool is off by {facts.amount(total.rmse)} (RMSE) in "
            f"{tools} not learnt from{against}.{share}"
        )
    return f"Wear of {tools} not learnt from is off by {facts.amount(total.rmse)} (RMSE){against}."


def _verdict(facts: WearFacts) -> PartVerdict | None:
    shown, verdict = facts.shown, facts.shown.verdict
    if shown.model is None and verdict is None:
        return None
    command = f"kerf wear FILE --machine {shown.machine}"
    if verdict is None or verdict.status == "not judged":
        why = (
            verdict.reasons[0]
            if verdict is not None and verdict.reasons
            else "no tool was held out"
        )
        return PartVerdict(
            status="unknown",
            sentence=f"The wear of tools from signals has not been judged: {why.rstrip('.')}.",
            todo="Keep whole tools out of roles.training, to judge it by.",
        )
    if verdict.status == "failed":
        reason = verdict.reasons[0] if verdict.reasons else "the judge gave no reason"
        return PartVerdict(
            status="failed",
            sentence=f"Wear from signals failed: {reason.rstrip('.')}. {_headline(facts)}".strip(),
            todo="Change tools by measured wear or by time in cut; record and measure more tools.",
        )
    return PartVerdict(
        status="passed", sentence=_headline(facts), todo=f"To read a tool's wear: {command}."
    )


def _key_figures(facts: WearFacts) -> list[tuple[str, str, str]]:
    total = facts.total
    if total is None:
        return []
    aside = f"RMSE, {counted(len(facts.tools), 'tool')} held out{facts.label}"
    if (guess := facts.error(total, GUESS)) is not None:
        aside += f"; guess without sensors {facts.amount(guess)}"
    found = [("Error of tool wear", facts.amount(total.rmse), aside)]
    if total.coverage_90 is not None:
        share = f"{fixed(100 * total.coverage_90, 0)}{TOGETHER}%"
        found.append(("Wear inside its 90 % interval", share, "of readings of tools held out"))
    return found


# ---- the section


def _section(facts: WearFacts) -> Section:
    key, title, shown = "wear", f"Tool wear from signals of the cut{facts.label}", facts.shown
    model = shown.model
    if model is None:
        return Section(key=key, title=title, text=[absent(shown.folder / "model.json", NEEDS)])
    long_s = model.length / model.rate_Hz
    long = (
        f"{number(long_s)}{TOGETHER}s" if long_s >= 1.0 else f"{number(1e3 * long_s)}{TOGETHER}ms"
    )
    text = [
        f"Windows of {long} in cut of "
        f"{counted(len(model.channels), 'channel')} give the wear of the tool. Methods were "
        f"compared on training tools left out as a whole; {NAMES[model.champion]} serves.",
        _headline(facts),
        _beaten_words(model),
    ]
    if shown.verdict is None:
        text.append(absent(shown.folder / "verdict.json", "Errors are of training tools left out."))
    elif shown.verdict.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(shown.verdict.reasons) + ".")
    if shown.predictions is None:
        text.append(absent(shown.folder / "predictions.parquet", "No tool can be drawn without."))
    return Section(
        key=key, title=title, text=[words for words in text if words],
        blocks=present(
            _lives(facts), _tools_table(facts), _methods_table(facts), _where_table(facts),
            _outside_table(facts),
        ),
    )  # fmt: skip


def _beaten_words(model: WearModel) -> str:
    """That a guess without sensors is better on training tools left out, where it is."""
    simple = [model.scores[name].rmse for name in (GUESS, MEAN) if name in model.scores]
    if not simple or min(simple) > model.scores[model.champion].rmse:
        return ""
    return (
        "On the training tools left out a guess without sensors errs less than any method that "
        "looks at the signals: they say little about the wear here."
    )


def _lives(facts: WearFacts) -> Figures | None:
    """Each tool that decided, those with the greatest error first."""
    model = facts.shown.model
    if model is None or not len(facts.rows) or facts.is_class:
        return None
    ranked = sorted(facts.tools, key=lambda one: -(one.rmse or 0.0))[:MOST_DRAWN]
    drawn = []
    for score in ranked:
        rows = facts.rows[facts.rows["group"] == score.group].sort_values("t")
        if len(rows) < 2:
            continue
        caption = (
            f"{score.group}{facts.label}, not learnt from: RMSE {facts.amount(score.rmse)}, "
            f"largest error {facts.amount(score.max)}."
        )
        drawn.append(Figure(
            svg=figures.life_figure(_life(rows, model), "Flank wear VB, µm", caption),
            caption=caption, sources=facts.made_from("predictions.parquet"),
        ))  # fmt: skip
    if not drawn:
        return None
    return Figures(figures=drawn, legend=[
        ("l-measured", "measured, between measurements a straight line", "line"),
        ("l-window", "estimated from signals", "line"), ("s-band", "its 90 % interval", "box"),
        ("l-speed", "guess without sensors", "line"),
    ])  # fmt: skip


def _life(rows: pd.DataFrame, model: WearModel) -> figures.Life:
    name = f"{BASELINE}{GUESS}"
    values: dict[str, Any] = {
        key: rows[key].to_numpy(float) for key in ("t", "measured", "predicted", "low", "high")
    }
    guess = rows[name].to_numpy(float) if name in rows else np.full(len(rows), np.nan)
    timed = model.progress_unit in ("s", "min", "h")
    return figures.Life(
        use=values["t"] / 60.0 if timed else values["t"],
        unit="min" if timed else "" if model.progress_unit == "1" else model.progress_unit,
        measured=values["measured"], predicted=values["predicted"], low=values["low"],
        high=values["high"], guess=guess, scored=rows["scored"].to_numpy(bool),
    )  # fmt: skip


def _tools_table(facts: WearFacts) -> Table | None:
    """Each tool that decided: error of what serves and of the guess, share inside the interval."""
    model = facts.shown.model
    if model is None:
        return None
    unit = "" if facts.is_class else "µm"
    plain = 2 if facts.is_class else 0

    def inside(one: Score) -> str:
        rows = facts.rows
        rows = rows[(rows["group"] == one.group) & rows["scored"]] if len(rows) else rows
        if not len(rows) or not np.isfinite(rows["low"]).all():
            return "–"
        within = (rows["low"] <= rows["measured"]) & (rows["measured"] <= rows["high"])
        return fixed(100 * float(within.mean()), 0)

    columns: list[Column[Score]] = [
        Column("Tool", lambda one: one.group),
        Column("readings", lambda one: number(one.n), unit=""),
        Column("RMSE", lambda one: fixed(one.rmse, plain), unit=unit),
        Column("largest error", lambda one: fixed(one.max, plain), unit=unit),
        Column(
            "RMSE of the guess", lambda one: _or_dash(facts.error(one, GUESS), plain), unit=unit
        ),
        Column("inside the 90 % interval", inside, unit="%"),
        Column("", lambda one: Cell(text=one.status, status=one.status)),
    ]
    return tabulated(f"Tools not learnt from{facts.label}", facts.tools, columns,
                     facts.made_from("verdict.json"))  # fmt: skip


def _plain(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:g}"


def _or_dash(value: float | None, decimals: int) -> str:
    return "–" if value is None else fixed(value, decimals)


def _methods_table(facts: WearFacts) -> Table | None:
    """Every method on training tools left out, and on those that decided."""
    model, total = facts.shown.model, facts.total
    if model is None:
        return None
    unit, plain = ("", 2) if facts.is_class else ("µm", 0)
    ranked = sorted(model.scores.items(), key=lambda one: one[1].rmse)
    columns: list[Column[tuple[str, MethodScore]]] = [
        Column("Method", lambda one: NAMES[one[0]] + " (serves)" * (one[0] == model.champion)),
        Column("RMSE", lambda one: fixed(one[1].rmse, plain), unit=unit,
               group="Training tools left out"),
        Column("worst tool", lambda one: fixed(one[1].worst, plain), unit=unit,
               group="Training tools left out"),
        Column("RMSE ", lambda one: _or_dash(None if total is None else facts.error(total, one[0]),
                                             plain), unit=unit, group="Tools held out"),
    ]  # fmt: skip
    if facts.is_class:
        columns.insert(3, Column(
            "balanced accuracy", lambda one: _or_dash(_times_100(one[1].balanced_accuracy), 0),
            unit="%", group="Training tools left out",
        ))  # fmt: skip
    return tabulated(f"Methods compared{facts.label}", ranked, columns,
                     facts.made_from("model.json", "verdict.json"))  # fmt: skip


def _times_100(value: float | None) -> float | None:
    return None if value is None else 100 * value


def _where_table(facts: WearFacts) -> Table | None:
    """Errors by the wear that was measured, in thirds of what was learnt."""
    model, rows = facts.shown.model, facts.rows
    if model is None or facts.is_class or not len(rows):
        return None
    rows = rows[rows["scored"]]
    low, high = model.learnt
    edges = np.linspace(low, high, 4)
    place = np.clip(np.searchsorted(edges, rows["measured"], side="right") - 1, 0, 2)
    error = (rows["predicted"] - rows["measured"]).to_numpy(float)
    parts = [
        (k, error[place == k], (edges[k], edges[k + 1])) for k in range(3) if (place == k).any()
    ]
    columns: list[Column[Any]] = [
        Column("Wear", lambda one: THIRDS[one[0]]),
        Column("from", lambda one: fixed(one[2][0], 0), unit="µm"),
        Column("to", lambda one: fixed(one[2][1], 0), unit="µm"),
        Column("readings", lambda one: number(len(one[1])), unit=""),
        Column("RMSE", lambda one: fixed(float(np.sqrt(np.mean(one[1] ** 2))), 0), unit="µm"),
        Column("estimated too high by", lambda one: fixed(float(one[1].mean()), 0), unit="µm"),
    ]
    return tabulated(f"Where it errs, tools held out{facts.label}", parts, columns,
                     facts.made_from("predictions.parquet"))  # fmt: skip


def _outside_table(facts: WearFacts) -> Table | None:
    """Tools that were held out and cut under conditions that were not learnt."""
    verdict = facts.shown.verdict
    found = () if verdict is None else verdict.outside
    columns: list[Column[OutsideConditions]] = [
        Column("Tool", lambda one: one.case),
        Column("condition", lambda one: one.condition.replace("_", " ")),
        Column("is", lambda one: _plain(one.value), unit=""),
        Column("learnt", lambda one: one.learnt),
        Column("unit", lambda one: one.unit),
    ]  # fmt: skip
    return tabulated("Conditions that were not learnt; the interval is wider there", list(found),
                     columns, facts.made_from("verdict.json"), folded=True)  # fmt: skip
