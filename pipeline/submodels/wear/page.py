"""Page of tool wear: tools due, wear over the life of held-out tools, methods, errors."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import NOT_KNOWN, TOGETHER, counted, fixed, number
from pipeline.charts.sections import Action, Heading, Section, present
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.schema.verdict import Fact
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear import due
from pipeline.submodels.wear.fit import balanced_accuracy
from pipeline.submodels.wear.life import LifeLaw, WornTool
from pipeline.submodels.wear.model import GUESS, MEAN, NAMES, WEAR, WearModel

SOON = 0.15
"""Share of a life below which the least time left makes a tool due soon [1]."""
TO = "\N{EN DASH}"
WHAT = {
    "failed": "Change the tool", "unknown": "Have a new tool ready",
    "passed": "Measure the tool’s wear again",
}  # fmt: skip
"""Action for a tool in use, by its status."""


@dataclass(frozen=True, kw_only=True)
class DueTool:
    """A tool in use, with what was said of it; ``by_signals`` where those may be relied on."""

    name: str
    facts: Mapping[str, Fact]
    by_signals: bool

    def number(self, name: str) -> float | None:
        """Value of a fact; None where it is not there."""
        fact = self.facts.get(name)
        return fact.value if fact is not None and isinstance(fact.value, int | float) else None

    @property
    def rests_on(self) -> str:
        """Basis of the remaining time: the more precise of reading and signals, else its use."""
        allowed = (due.READING, due.SIGNALS) if self.by_signals else (due.READING,)
        known = [one for one in allowed if self.number(due.left_names(one)[1]) is not None]
        return min(known, key=lambda one: self._left(one)[2] - self._left(one)[0], default=due.USE)

    @property
    def left(self) -> tuple[float, float, float]:
        """Time left [min]: lower end of the 90 % interval, median, upper end."""
        return self._left(self.rests_on)

    def _left(self, rests_on: str) -> tuple[float, float, float]:
        low, middle, high = (self.number(name) or 0.0 for name in due.left_names(rests_on))
        return low, middle, high

    @property
    def status(self) -> str:
        """``failed`` where it is worn, ``unknown`` where it is due soon, else ``passed``."""
        low, middle, _ = self.left
        if middle <= 0:
            return "failed"
        return "unknown" if low < SOON * (self.number(due.LIFE) or 0.0) else "passed"

    @property
    def within(self) -> float:
        """Time in the cut within which that is to be done [min]."""
        return self.left[0] / 2 if self.status == "passed" else self.left[0]

    @property
    def todo(self) -> str:
        """Action, in words."""
        within = f"within {_minutes(self.within)} of cutting"
        return {
            "failed": "Change it now.",
            "unknown": f"Have a new one ready; change it {within}.",
            "passed": f"Keep it; measure its land again {within}.",
        }[self.status]


def due_tools(shown: Shown[WearModel]) -> list[DueTool]:
    """Tools in use, the one that is due first at the head."""
    if shown.verdict is None:
        return []
    found = [
        DueTool(name=case.case, facts=case.facts, by_signals=shown.verdict.status == "passed")
        for case in shown.verdict.cases
        if due.IN_USE in case.facts
    ]
    return sorted(found, key=lambda one: (one.left[1], one.name))


def due_section(shown: Shown[WearModel]) -> Section | None:
    """Tools due, how long tools of each type last, what wear adds to forces; None without lives."""
    model = shown.model
    if model is None or (model.lasting.life is None and not model.lasting.reasons):
        return None
    law, label = model.lasting.life, " (simulated)" if shown.origin == "simulated" else ""
    named = sources(shown.shelf, shown.folder / "model.json", shown.folder / "verdict.json")
    if law is None:
        why = "; ".join(model.lasting.reasons)
        text = [f"No time left can be told: {why}."]
        return Section(key="tools-due", title=f"Tools due{label}", text=text)
    tools = due_tools(shown)
    text = [
        f"A tool counts as worn at a flank wear of {number(law.criterion_um)}{TOGETHER}µm. "
        f"Times are time in the cut; the range holds nine of ten tools. {_held_words(shown)}"
    ]
    if not tools:
        text.append("No tool in use is named, so that none can be said to be due.")
    return Section(
        key="tools-due", title=f"Tools due{label}", text=text,
        blocks=present(
            tabulated(f"Tools in use, the next to be changed first{label}", tools, DUE, named),
            Heading(heading="How long tools last", text=_life_words(law)),
            tabulated(f"Tools that were used up{label}", law.worn, WORN, named),
            Heading(heading="What wear adds to forces", text=_edge_words(model)),
        ),
    )  # fmt: skip


def due_key_figures(shown: Shown[WearModel]) -> list[tuple[str, str, str]]:
    """The tool that is due first, and in how many minutes of cutting."""
    first = next(iter(due_tools(shown)), None)
    if first is None:
        return []
    return [("Next tool due", first.name, f"in {_span(first.left)} of cutting")]


def due_notes(shown: Shown[WearModel]) -> list[str]:
    """Tools that are to be changed now or soon, for the head of the page."""
    return [f"Tool {one.name}: {one.todo}" for one in due_tools(shown) if one.status != "passed"]


def due_actions(shown: Shown[WearModel]) -> list[Action]:
    """Action for each tool in use, the one that is due first at the head."""
    return [
        Action(
            what=WHAT[one.status],
            where=f"Tool {one.name}",
            why=f"It lasts another {_span(one.left)} in the cut (90 % interval), "
            f"by {one.rests_on}.",
            until="now" if one.status == "failed" else f"within {_minutes(one.within)} of cutting",
            who="tool room",
            evidence="tools-due",
        )
        for one in due_tools(shown)
    ]  # fmt: skip


def due_truth(shown: Shown[WearModel]) -> list[Table]:
    """Predicted and true remaining time, for tools in use of a simulated machine."""
    truth = (shown.truth or {}).get("wear") or {}
    worn = {one["tool"]: one["worn_after_min"] for one in truth.get("tools", [])}
    rows = [
        (one, worn[one.name] - (one.number(due.TIME) or 0.0))
        for one in due_tools(shown)
        if worn.get(one.name) is not None
    ]
    columns: tuple[Column[tuple[DueTool, float]], ...] = (
        Column("Tool", lambda row: row[0].name),
        Column("true", lambda row: number(row[1]), "min"),
        Column("predicted, 90 %", lambda row: _span(row[0].left)),
    )
    table = tabulated("Time left of tools in use", rows, columns, [])
    return [] if table is None else [table]


def _minutes(value: float) -> str:
    return f"{number(value, 2)}{TOGETHER}min"


def _span(left: tuple[float, float, float]) -> str:
    return f"{number(left[0], 2)}{TO}{number(left[2], 2)}{TOGETHER}min"


def _now(tool: DueTool) -> str:
    now, low, high = (tool.number(name) for name in (due.NOW, due.NOW_LOW, due.NOW_HIGH))
    if now is None or low is None or high is None:
        return NOT_KNOWN
    doubt = "" if tool.by_signals else ", not relied on"
    return f"{number(now)} ({number(low, 2)}{TO}{number(high, 2)}){TOGETHER}µm{doubt}"


def _read(tool: DueTool) -> str:
    read, at = tool.number(due.READ), tool.number(due.READ_AT)
    if read is None or at is None:
        return "never"
    return f"{number(read)}{TOGETHER}µm at {_minutes(at)}"


DUE: tuple[Column[DueTool], ...] = (
    Column("Tool", lambda one: one.name),
    Column("type", lambda one: str(one.facts[due.TYPE].value)),
    Column("in the cut for", lambda one: number(one.number(due.TIME)), "min"),
    Column("wear last measured", _read),
    Column("wear now, by its signals", _now),
    Column("lasts another", lambda one: f"{_minutes(one.left[1])} ({_span(one.left)})"),
    Column("by", lambda one: one.rests_on),
    Column("what to do", lambda one: Cell(text=one.todo, status=one.status)),
)  # fmt: skip


def _held_words(shown: Shown[WearModel]) -> str:
    cases = () if shown.verdict is None else shown.verdict.cases
    told, inside = due.held({c.case: c.facts for c in cases if c.role != "training"})
    if not told:
        return "No tool that was used up is held out, so that the range could not be tried."
    return (
        f"On tools that were used up and from which nothing was learnt, {number(inside)} of "
        f"{number(told)} ranges held the time that was left."
    )


def _life_words(law: LifeLaw) -> str:
    catalogue = [one for one in law.worn if one.catalogue_minutes is not None]
    words = (
        f"Found from {counted(len(law.worn), 'tool')} whose wear was measured up to "
        f"{number(law.criterion_um)}{TOGETHER}µm. Lives of like tools scatter by about "
        f"{number(100 * law.scale, 2)}{TOGETHER}%."
    )
    if catalogue:
        mean = sum(one.minutes / (one.catalogue_minutes or 1.0) for one in catalogue)
        share = 100 * mean / len(catalogue)
        words += (
            f" They last {number(share, 2)}{TOGETHER}% of what the catalogue says at their speeds; "
            "it knows nothing of depth and width of cut."
        )
    return words


WORN: tuple[Column[WornTool], ...] = (
    Column("Tool", lambda one: one.tool),
    Column("type", lambda one: one.kind),
    Column("cutting speed", lambda one: number(one.v_c_m_min), "m/min"),
    Column("lasted", lambda one: number(one.minutes), "min"),
    Column("by the catalogue", lambda one: number(one.catalogue_minutes), "min"),
)


def _edge_words(model: WearModel) -> str:
    edges = model.lasting.edges
    if edges is None:
        return f"Not known: {'; '.join(model.lasting.reasons) or 'no forces were recorded'}."
    words = []
    for name, direction in zip(due.EDGE_NAMES, ("along the cut", "across it"), strict=True):
        one = edges.parameters[name]
        if one.value is None or one.interval_95 is None:
            words.append(f"{direction} it is not known: {one.method}")
            continue
        each = [number(v * 0.1) for v in (one.value, *one.interval_95)]
        words.append(f"{direction} by {each[0]} ({each[1]}{TO}{each[2]}){TOGETHER}N")
    return (
        f"For each 0.1{TOGETHER}mm of land and each millimetre of depth the force of an edge grows "
        f"{', '.join(words)} (95{TOGETHER}%, {counted(edges.recordings, 'cut')} of "
        f"{counted(edges.tools, 'tool')}). It is the mean over the cuts recorded: thinner chips "
        "press less on the land."
    )


THIRDS = ("slightly worn", "half worn", "worn most")
"""Ranges of the wear that was learnt."""

Seen = Shown[WearModel]


def content(shown: Seen) -> PageContent:
    """Page content of tool wear."""
    model = shown.model
    quantity = WEAR if model is None else model.quantity
    timed = model is not None and model.progress_unit in ("s", "min", "h")
    unit = "" if model is None or model.progress_unit == "1" else model.progress_unit
    words = f"Use of the tool, {'min' if timed else unit}" if unit else "Recordings of the tool, 1"
    return PageContent(
        about="" if model is None else _about(model),
        rules="Methods were compared on training tools left out as a whole; the guess without "
        "sensors knows the use of a tool alone. Only tools that nothing was learnt from are "
        "judged, where their wear was measured; between measurements it is a straight line.",
        case="tool",
        counts=(Counting(key="wear_rmse", name=f"RMSE of the {quantity}", quantity=quantity,
                         whole=True),),
        guess=GUESS,
        titles=NAMES,
        todo={
            "passed": f"To read a tool's wear: kerf wear FILE --machine {shown.machine}.",
            "failed": "Change tools by measured wear or by time in cut; record and measure more "
            "tools.",
            "unknown": "Keep whole tools out of roles.training, to judge it by.",
        },
        facts=[] if model is None else [_beaten(model)],
        head=[*_accuracy(shown), *due_key_figures(shown)],
        notes=due_notes(shown),
        actions=due_actions(shown),
        meaning=lambda group, name: "growth of the edge’s force with the land of wear",
        tried=[] if model is None else list(_tried(shown, model)),
        tried_where="on training tools left out",
        drawn=[Drawn(quantity=quantity, axis=words, factor=1 / 60.0 if timed else 1.0,
                     other=(GUESS, NAMES[GUESS]))],
        of_judgement=[] if model is None else [_where(shown, model)],
        first=[due_section(shown)],
        truths=due_truth(shown),
    )  # fmt: skip


def _about(model: WearModel) -> str:
    seconds = model.length / model.rate_Hz
    long = number(seconds) if seconds >= 1.0 else number(1e3 * seconds)
    return (
        f"Windows of {long}{TOGETHER}{'s' if seconds >= 1.0 else 'ms'} in cut of "
        f"{counted(len(model.channels), 'channel')} give the wear of the tool."
    )


def _beaten(model: WearModel) -> str:
    """Note that a baseline without sensors is better on held-out training tools, where it is."""
    simple = [model.scores[name].rmse for name in (GUESS, MEAN) if name in model.scores]
    if not simple or min(simple) > model.scores[model.champion].rmse:
        return ""
    return (
        "On the training tools left out a guess without sensors errs less than any method that "
        "looks at the signals: they say little about the wear here."
    )


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
    return [("Balanced accuracy", share, "worn or not, tools that decide; 50 % is chance")]


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
    error = (rows["predicted"] - rows["measured"]).to_numpy(float)
    parts = [(THIRDS[k], edges[k], edges[k + 1], error[place == k])
             for k in range(3) if (place == k).any()]  # fmt: skip
    return tabulated("Where it errs, tools that decide", parts, WHERE,
                     made_from(shown, "predictions.parquet"))  # fmt: skip
