"""Tables of an optimised program: before and after, methods, limits, blocks, front, proof."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace

from pipeline.charts.numbers import NARROW, as_stated, counted, signed
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, tabulated
from pipeline.report.cut.tables import NONE, between, figure, sentence, share
from pipeline.schema.limits import Limit, limit_words
from pipeline.schema.part import (
    Binding,
    BlockGroup,
    FrontMember,
    MethodLimits,
    MethodResult,
    OptimisedPart,
    Side,
    UncertainQuantity,
)

Row = tuple[str, str | None, str, str | None, int]
ROWS: tuple[Row, ...] = (
    ("Time", "s", "time_s", "time_percent", 4),
    ("Cost", None, "cost", "cost_percent", 4),
    ("Energy", "kWh", "energy_kWh", "energy_percent", 3),
    ("Tool life used", "%", "tool_life_share", "tool_life_percent", 3),
    ("Peak load", "N", "peak_load_N", None, 3),
    ("Blocks beyond a limit", "", "beyond", None, 3),
)
"""Name, unit (the currency where None), key, key of the change, digits."""
LONGEST = 40
"""Letters of a word beyond which it is broken anywhere."""
NAMES = {
    "as programmed": "no more feed per tooth than programmed",
    "change from the program": "greatest change from the program",
    "feed per tooth": "range of the feed per tooth",
    "cutting speed": "range of the cutting speed",
    "deflection": "bending of the tip",
}
"""Limits whose own name says too little beside the others."""
KEPT = "kept as programmed"
NO_FORCE = 1e-3
"""Load [N], or bending [um], below which a value is rounding."""
AIMS = {
    "time": ("least time", "time_percent", "less time"),
    "cost": ("least cost", "cost_percent", "less cost"),
    "energy": ("least energy", "energy_percent", "less energy"),
    "wear": ("least wear of tools", "tool_life_percent", "less wear"),
}
"""Each objective in words, its gain, and the word for less."""


def aim(part: OptimisedPart) -> str:
    """The objective in words."""
    if part.objective == "pareto":
        return "the knee of all objectives"
    return AIMS[part.objective][0]


def limit_name(name: str | None) -> str:
    """A limit in words, small; "nothing" where none binds."""
    return NAMES.get(name, name) if name else "nothing"


def force(value: float | None) -> str:
    """A load, or its bending, as it stands in a table: that of teeth in balance is rounding."""
    return figure(0.0 if value is not None and abs(value) < NO_FORCE else value)


def tool_name(number: int, name: str) -> Cell:
    """A tool as people name it."""
    return plain_words(f"T{number} {name}".strip())


def held_by(row: BlockGroup | Binding) -> str:
    """Binding limit of blocks in words, or why they are kept; empty where nothing does."""
    if row.kept:
        return f"{KEPT}: {row.kept}"
    return limit_name(row.limit if isinstance(row, Binding) else row.binds)


def change(value: float | None) -> str:
    """A change in percent with its sign; a dash where there is none."""
    if value is None:
        return NONE
    return f"{signed(value, 1 if abs(value) < 99.95 else 0)}{NARROW}%"


def side(part: OptimisedPart, which: Side, key: str, digits: int, factor: float = 1.0) -> str:
    """Total before or after with its interval, as it stands in a table."""
    totals = part.totals(which)
    value = getattr(totals, key)
    ends = between(totals, key, lambda end: figure(factor * end, digits))
    return figure(value if value is None or factor == 1.0 else factor * value, digits) + ends


def gain_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Table of values as programmed, optimised, and the change."""
    currency = part.currency or ""

    def head(row: Row) -> str:
        name, unit = row[0], currency if row[1] is None else row[1]
        return f"{name}, {unit}" if unit else name

    def total(which: Side) -> Callable[[Row], str]:
        return lambda row: side(part, which, row[2], row[4], 100.0 if row[1] == "%" else 1.0)

    return tabulated("Before and after", ROWS, (
        Column("Of the part", head),
        Column("as programmed", total("before"), ""),
        Column("optimised", total("after"), ""),
        Column("change", lambda row: change(getattr(part.gain, row[3])) if row[3] else NONE, ""),
    ), sources)  # fmt: skip


KINDS: dict[MethodLimits, str] = {"certain": "As sure as asked", "nominal": "At nominal values"}
"""Limits that methods are compared under, as the heads of their columns."""
OBJECTIVES: dict[str, tuple[str, str, str, Callable[[float | None], str]]] = {
    "time": ("time_s", "time", "s", lambda value: figure(value, 4)),
    "cost": ("cost", "cost", "", lambda value: figure(value, 4)),
    "energy": ("energy_kWh", "energy", "kWh", lambda value: figure(value)),
    "wear": ("tool_life_share", "tool life used", "", share),
}
"""Key, name, unit and words of each objective; the unit of cost is the currency."""
PairOfResults = dict[MethodLimits, MethodResult]


def methods_by_name(part: OptimisedPart) -> dict[str, PairOfResults]:
    """Each method's result under each kind of limits, in the order of the document."""
    found: dict[str, PairOfResults] = {}
    for row in part.methods:
        found.setdefault(row.method, {})[row.limits] = row
    return found


def methods_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Objectives of each method under the same limits, and what certainty costs it."""
    rows = list(methods_by_name(part).items())
    two = any("nominal" in pair for _, pair in rows)
    shown = dict.fromkeys(("time", "cost", part.objective))
    keys = [key for key in (OBJECTIVES if part.objective == "pareto" else shown)]
    columns: list[Column[tuple[str, PairOfResults]]] = [
        Column("Method", lambda row: sentence(row[0]))
    ]
    kinds: list[MethodLimits] = ["certain", "nominal"] if two else ["certain"]
    for kind in kinds:
        head = KINDS[kind] if two else ""
        columns += [_objective(part, key, kind, head) for key in keys]
        columns.append(_limits(kind, head))
    if two:
        columns.append(Column("in time", _price, "", "Certainty costs"))
    columns.append(Column("evaluations", lambda row: figure(_evaluations(row[1])), ""))
    return tabulated(
        "What other ways find", rows, columns, sources,
        note="Inside is what keeps the limits with their margins and, in the columns as sure as "
        "asked, that of the load as surely: a program may be beyond although its predicted load is "
        "not. All have F and S as words hold them; a row that passes the same test is never better "
        "than the answer.",
    )  # fmt: skip


def _objective(
    part: OptimisedPart, key: str, kind: MethodLimits, head: str
) -> Column[tuple[str, PairOfResults]]:
    name, words, unit, shown = OBJECTIVES[key]
    unit = (part.currency or "") if key == "cost" else unit

    def cell(row: tuple[str, PairOfResults]) -> str:
        return shown(getattr(row[1][kind], name)) if kind in row[1] else NONE

    return Column(words, cell, unit, head)


def _limits(kind: MethodLimits, head: str) -> Column[tuple[str, PairOfResults]]:
    def cell(row: tuple[str, PairOfResults]) -> str | Cell:
        if kind not in row[1]:
            return NONE
        inside = row[1][kind].feasible
        return Cell(text="inside" if inside else "beyond", status="passed" if inside else "failed")

    return Column("limits", cell, None, head)


def _price(row: tuple[str, PairOfResults]) -> str:
    """Time with certainty over that at nominal values, where both keep their limits."""
    pair = row[1]
    if set(pair) != set(KINDS) or not all(one.feasible for one in pair.values()):
        return NONE
    sure, nominal = pair["certain"].time_s, pair["nominal"].time_s
    return change(None if sure is None or not nominal else 100 * (sure / nominal - 1))


def _evaluations(pair: PairOfResults) -> int:
    return max(one.evaluations for one in pair.values())


def binding_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Binding limits of the program, and their share of it."""
    total = part.after.time_s

    def of_all(row: Binding) -> str:
        return share(row.time_s / total if row.time_s is not None and total else None)

    return tabulated("What holds the program back", part.binding, (
        Column("What binds", lambda row: sentence(held_by(row))),
        Column("blocks", lambda row: figure(row.blocks), ""),
        Column("their time", lambda row: figure(row.time_s), "s"),
        Column("of all", of_all, ""),
    ), sources, note="Blocks that cut; the rest of the time is air and waits. Nothing binds where "
        "the aim is best inside the limits, or where a block shares its F with others.",
    )  # fmt: skip


def groups_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Every group of blocks before and after, folded."""
    currency = part.currency or ""
    rows, main = by_line(part.groups), f"{'in' if part.unit == 'inch' else 'mm'}/min"
    return tabulated(f"F and S of {counted(len(rows), 'group')} of blocks", rows, (
        Column("Lines", _lines),
        Column("tool", lambda row: f"T{row.tool}"),
        Column("what binds", lambda row: held_by(row) if row.binds or row.kept else NONE),
        Column("before", lambda row: _feed(row, row.feed_before, main), main, "F"),
        Column("after", lambda row: _feed(row, row.feed_after, main), main, "F"),
        Column("before", lambda row: figure(_whole(row.speed_before)), "rev/min", "S"),
        Column("after", lambda row: figure(_whole(row.speed_after)), "rev/min", "S"),
        Column("before", lambda row: figure(row.time_before_s), "s", "Time"),
        Column("after", lambda row: figure(row.time_after_s), "s", "Time"),
        Column("before", lambda row: figure(row.cost_before), currency, "Cost"),
        Column("after", lambda row: figure(row.cost_after), currency, "Cost"),
        Column("before", lambda row: force(row.peak_load_before_N), "N", "Peak load"),
        Column("after", lambda row: force(row.peak_load_after_N), "N", "Peak load"),
    ), sources, most=MOST_ROWS, folded=True,
        note="F is as the program writes it, with its unit where that is another than in the head; "
        "where a group had several F or S, their mean over its time.",
    )  # fmt: skip


def by_line(groups: Sequence[BlockGroup]) -> list[BlockGroup]:
    """Groups of blocks in the order of their lines, which subprograms leave."""
    return sorted(groups, key=lambda row: (row.first_line, row.last_line))


def _lines(row: BlockGroup) -> str:
    first, last = row.first_line, row.last_line
    return str(first) if first == last else f"{first}–{last}"


def _feed(row: BlockGroup, feed: float | None, main: str) -> str:
    return figure(feed, 4) + ("" if row.feed_unit == main else f" {row.feed_unit}")


def _whole(value: float | None) -> int | None:
    return None if value is None else round(value)


def _front_objective(part: OptimisedPart, key: str) -> Column[FrontMember]:
    name, words, unit, shown = OBJECTIVES[key]
    unit = (part.currency or "") if key == "cost" else unit
    return Column(words, lambda row: shown(getattr(row, name)), unit)


def front_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """The front, folded, the knee marked."""
    place = {id(row): str(k) for k, row in enumerate(part.front, 1)}  # rounded, some are equal
    return tabulated(f"The front: {counted(len(part.front), 'program')}", part.front, (
        Column("Member", lambda row: "the knee" if row.knee else place[id(row)]),
        *(_front_objective(part, key) for key in OBJECTIVES),
    ), sources, most=MOST_ROWS, folded=True)  # fmt: skip


UNCERTAIN: tuple[Column[UncertainQuantity], ...] = (
    Column("What is uncertain", lambda row: plain_words(row.what)),
    Column("value", lambda row: plain_words(row.value)),
    Column("spread", lambda row: plain_words(row.spread)),
    Column("where that comes from", lambda row: plain_words(row.source)),
)


def uncertain_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Uncertain quantities with their spread and source."""
    uncertain = () if part.certainty is None else part.certainty.uncertain
    return tabulated("Uncertain quantities", uncertain, UNCERTAIN, sources)


def plain_words(words: str) -> Cell:
    """Words typeset as on a page: ``um``, ``^2``, a minus; long names are broken like code."""
    text = re.sub(r"(?<=\d) um\b", " µm", words.replace("^2", "²"))
    text = re.sub(r"^certainty\.", "conf/optimisation, certainty.", text)
    text = re.sub(r"^-(?=\d)", "−", text) or NONE
    return Cell(text=text, code=max(map(len, text.split()), default=0) > LONGEST)


def limits_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Limits that were given, and what is kept free of each."""
    given = [
        (*limit_words(key), value)
        for key, value in part.limits.given.items()
        if key not in ("margins", "practice")
        and value != 0
        and (key != "power_share" or value != 1)
    ]
    own = {use.tool: use.limits for use in part.tools}
    given += [
        (replace(words, name=f"{words.name} of T{tool}"), unit, value)
        for tool, limits in own.items() for key, value in limits.items()
        for words, unit in (limit_words(key),)
    ]  # fmt: skip

    def free(words: Limit) -> str:
        kept = getattr(part.limits.margins, words.margin) if words.margin else 0.0
        return share(kept) if kept else NONE

    return tabulated("Limits", given, (
        Column("Limit", lambda row: sentence(row[0].name)),
        Column("value", lambda row: _printed(row[2], row[1].replace("um", "µm"))),
        Column("kept free of it", lambda row: free(row[0])),
    ), sources)  # fmt: skip


def _printed(value: float | tuple[float, ...], unit: str) -> str:
    known = value if isinstance(value, tuple) else (value,)
    words = " to ".join(as_stated(v) for v in known)
    return f"{words}{NARROW}{unit}" if unit else words


def proof_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Hashes of the program before and after, and of what both tell the machine."""
    proof = part.proof
    hashes = (
        ("Program as it was", proof.before_sha256),
        ("Program as it is written", proof.after_sha256),
        ("What both do: every move, state, tool and code but F and S", proof.sha256),
    )
    return tabulated("Proof", hashes, (
        Column("Of what", lambda row: row[0]),
        Column("sha256", lambda row: code(row[1] or NONE)),
    ), sources)  # fmt: skip
