"""Part of the page of tool wear on the tools due: time left, lives of tools, growth of forces."""

from pipeline.charts import svg
from pipeline.charts.numbers import NOT_KNOWN, TOGETHER, counted, number
from pipeline.charts.sections import Action, Heading, Section, drawing, present
from pipeline.charts.submodel_page import made_from
from pipeline.charts.tables import Cell, Column, Table, tabulated
from pipeline.charts.words import page_words
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear import due
from pipeline.submodels.wear.life import LifeLaw, WornTool
from pipeline.submodels.wear.model import WearModel

WORDS = page_words(__file__)
TO = "\N{EN DASH}"


def due_tools(shown: Shown[WearModel]) -> list[due.DueTool]:
    """Tools in use, the one that is due first at the head."""
    if shown.verdict is None:
        return []
    found = [
        due.DueTool(name=case.case, facts=case.facts, by_signals=shown.verdict.status == "passed")
        for case in shown.verdict.cases
        if due.IN_USE in case.facts
    ]
    return sorted(found, key=lambda one: (one.left[1], one.name))


def due_section(shown: Shown[WearModel]) -> Section | None:
    """Tools due, how long tools of each type last, what wear adds to forces; None without lives."""
    model = shown.model
    if model is None or (model.lasting.life is None and not model.lasting.reasons):
        return None
    law, label = model.lasting.life, WORDS("simulated") if shown.origin == "simulated" else ""
    title = WORDS("title", label=label)
    if law is None:
        text = [WORDS("unknown", why="; ".join(model.lasting.reasons))]
        return Section(key="tools-due", title=title, text=text)
    tools, made = due_tools(shown), made_from(shown, "model.json", "verdict.json")
    text = [WORDS("worn", criterion=number(law.criterion_um), held=_held_words(shown))]
    if not tools:
        text.append(WORDS("none"))
    blocks = present(
        tabulated(WORDS("in_use", label=label), tools, DUE, made),
        Heading(heading=WORDS("life.head"), text=_life_words(law)),
        tabulated(WORDS("used_up", label=label), law.worn, WORN, made),
        Heading(heading=WORDS("edge.head"), text=_edge_words(model)),
    )
    return Section(key="tools-due", title=title, text=text, blocks=blocks)


def due_key_figures(shown: Shown[WearModel]) -> list[tuple[str, str, str]]:
    """The tool that is due first, and in how many minutes of cutting."""
    first = next(iter(due_tools(shown)), None)
    if first is None:
        return []
    return [(WORDS("next"), first.name, WORDS("next_in", span=_span(first.left)))]


def due_notes(shown: Shown[WearModel]) -> list[str]:
    """Tools that are to be changed now or soon, for the head of the page."""
    return [WORDS("action.note", tool=one.name, todo=todo_words(one))
            for one in due_tools(shown) if one.status != "passed"]  # fmt: skip


def due_lead(shown: Shown[WearModel]) -> Section | None:
    """Tools in use as bars for the machine's own page: used, and left with its 90 % interval."""
    tools = due_tools(shown)
    if not tools:
        return None
    most = max((one.number(due.TIME) or 0.0) + one.left[2] for one in tools)
    parts, across = [], 100 / max(most, 1e-9)
    for row, one in enumerate(tools):
        used, top = one.number(due.TIME) or 0.0, row * ROW
        low, middle, high = (across * (used + left) for left in one.left)
        words = WORDS("lead.bar", used=_minutes(used), span=_span(one.left), todo=todo_words(one))
        bars = [
            svg.bar(0, across * used, top + 4, 12, "s-stopped"),
            svg.bar(across * used, max(middle - across * used, 0), top + 4, 12, "s-active"),
            svg.tag("line", x1=f"{low:.2f}%", x2=f"{high:.2f}%", y1=top + 10, y2=top + 10,
                    class_="whisker"),
        ]  # fmt: skip
        parts += [svg.tag("g", svg.group([svg.tag("title", f"{one.name}: {words}"), *bars])),
                  svg.text(0, top + 14, one.name, "name end", dx=-8),
                  svg.text(100, top + 14, _span(one.left), "tick", dx=8)]  # fmt: skip
    label = WORDS("lead.label", tools=counted(len(tools), "tool"))
    drawn = svg.figure(parts, height=len(tools) * ROW + 4, label=label, kind="tools-left")
    made = made_from(shown, "model.json", "verdict.json")
    block = drawing(drawn, WORDS("lead.caption"), made, LEGEND, kind="one")
    return Section(key="tools", title=WORDS("lead.title"), blocks=present(block))


ROW = 20  # px of a tool
LEGEND = [("s-stopped", WORDS("lead.used"), "box"), ("s-active", WORDS("lead.left"), "box")]


def due_actions(shown: Shown[WearModel]) -> list[Action]:
    """Action for each tool that is worn or due soon, the one that is due first at the head."""
    return [
        Action(
            what=WORDS(f"what.{one.status}"),
            where=WORDS("action.where", tool=one.name),
            why=WORDS("action.why", span=_span(one.left), rests_on=one.rests_on),
            until="now" if one.status == "failed"
            else WORDS("action.until", within=_minutes(one.within)),
            who="tool room",
            evidence="tools-due",
        )
        for one in due_tools(shown) if one.status != "passed"
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
    columns: tuple[Column[tuple[due.DueTool, float]], ...] = (
        Column("Tool", lambda row: row[0].name),
        Column("true", lambda row: number(row[1]), "min"),
        Column("predicted, 90 %", lambda row: _span(row[0].left)),
    )
    table = tabulated(WORDS("truth"), rows, columns, [])
    return [] if table is None else [table]


def todo_words(tool: due.DueTool) -> str:
    """What to do about a tool in use."""
    return WORDS(f"todo.{tool.status}", within=_minutes(tool.within))


def _minutes(value: float) -> str:
    return f"{number(value, 2)}{TOGETHER}min"


def _span(left: tuple[float, float, float]) -> str:
    return f"{number(left[0], 2)}{TO}{number(left[2], 2)}{TOGETHER}min"


def _now(tool: due.DueTool) -> str:
    now, low, high = (tool.number(name) for name in (due.NOW, due.NOW_LOW, due.NOW_HIGH))
    if now is None or low is None or high is None:
        return NOT_KNOWN
    doubt = "" if tool.by_signals else ", not relied on"
    return f"{number(now)} ({number(low, 2)}{TO}{number(high, 2)}){TOGETHER}µm{doubt}"


def _read(tool: due.DueTool) -> str:
    read, at = tool.number(due.READ), tool.number(due.READ_AT)
    if read is None or at is None:
        return "never"
    return f"{number(read)}{TOGETHER}µm at {_minutes(at)}"


DUE: tuple[Column[due.DueTool], ...] = (
    Column("Tool", lambda one: one.name),
    Column("type", lambda one: str(one.facts[due.TYPE].value)),
    Column("in the cut for", lambda one: number(one.number(due.TIME)), "min"),
    Column("wear last measured", _read),
    Column("wear now, by its signals", _now),
    Column("lasts another", lambda one: f"{_minutes(one.left[1])} ({_span(one.left)})"),
    Column("by", lambda one: one.rests_on),
    Column("what to do", lambda one: Cell(text=todo_words(one), status=one.status)),
)


def _held_words(shown: Shown[WearModel]) -> str:
    cases = () if shown.verdict is None else shown.verdict.cases
    told, inside = due.held({c.case: c.facts for c in cases if c.role != "training"})
    if not told:
        return WORDS("held.none")
    return WORDS("held.some", inside=number(inside), ranges=number(told))


def _life_words(law: LifeLaw) -> str:
    catalogue = [one for one in law.worn if one.catalogue_minutes is not None]
    words = WORDS(
        "life.text", tools=counted(len(law.worn), "tool"), criterion=number(law.criterion_um),
        scatter=number(100 * law.scale, 2),
    )  # fmt: skip
    if catalogue:
        mean = sum(one.minutes / (one.catalogue_minutes or 1.0) for one in catalogue)
        share = 100 * mean / len(catalogue)
        words += WORDS("life.catalogue", share=number(share, 2))
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
        why = "; ".join(model.lasting.reasons) or WORDS("edge.no_forces")
        return WORDS("edge.unknown", why=why)
    words = []
    for name, direction in WORDS.table("direction").items():
        one = edges.parameters[name]
        if one.value is None or one.interval_95 is None:
            words.append(WORDS("edge.no_growth", direction=direction, why=one.method))
            continue
        value, low, high = (number(v * 0.1) for v in (one.value, *one.interval_95))
        words.append(WORDS("edge.growth", direction=direction, value=value, low=low, high=high))
    return WORDS("edge.text", growth=", ".join(words), cuts=counted(edges.recordings, "cut"),
                 tools=counted(edges.tools, "tool"))  # fmt: skip
