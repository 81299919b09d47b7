"""Tables of an optimised program: before and after, methods, limits, blocks, front, proof."""

import re

from pipeline.charts.numbers import NARROW, asked, counted, number, signed
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names, numbers
from pipeline.report.cut.tables import NONE, sentence, share
from pipeline.schema.limits import limit_words
from pipeline.schema.part import BlockGroup, MethodResult, OptimisedPart

ROWS = (
    ("Time", "s", "time_s", "time_percent", 4),
    ("Cost", None, "cost", "cost_percent", 4),
    ("Energy", "kWh", "energy_kWh", "energy_percent", 3),
    ("Tool life used", "%", "tool_life_share", "tool_life_percent", 3),
    ("Peak load", "N", "peak_load_N", None, 3),
    ("Blocks beyond a limit", "", "beyond", None, 3),
)
"""Name, unit (the currency where None), key, key of the change, digits."""
LONGEST = 40  # letters of a word
NAMES = {"as programmed": "chip as it was programmed"}
"""Limits whose own name says too little beside the others."""


def limit_name(name: str | None) -> str:
    """A limit in words, small; "nothing" where none binds."""
    return NAMES.get(name, name) if name else "nothing"


def figure(value: float | None, digits: int = 3) -> str:
    """A number as it stands in a table; a dash where there is none."""
    return NONE if value is None else number(value, digits)


def change(value: float | None) -> str:
    """A change in percent with its sign; a dash where there is none."""
    if value is None:
        return NONE
    return f"{signed(value, 1 if abs(value) < 99.95 else 0)}{NARROW}%"


def gain_table(part: OptimisedPart, sources: list[Source]) -> Table:
    """As programmed, optimised, and the change."""
    rows = []
    for name, unit, key, gain, digits in ROWS:
        factor = 100.0 if unit == "%" else 1.0
        pair = [_scaled(getattr(side, key), factor) for side in (part.before, part.after)]
        printed = unit if unit is not None else part.currency or ""
        rows.append(cells(
            f"{name}, {printed}" if printed else name,
            *(figure(value, digits) for value in pair),
            change(getattr(part.gain, gain)) if gain else NONE,
        ))  # fmt: skip
    heads = [*names("Of the part"),
             *numbers(("as programmed", ""), ("optimised", ""), ("change", ""))]  # fmt: skip
    return Table(caption="Before and after", heads=heads, rows=rows, sources=sources)


def _scaled(value: float | None, factor: float) -> float | None:
    return value if value is None or factor == 1.0 else factor * value


def methods_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Objectives of each method, and the evaluations that it takes."""
    if not part.methods:
        return None
    currency = part.currency or ""
    heads = [*names("Method", "inside the limits"),
             *numbers(("time", "s"), ("cost", currency), ("energy", "kWh"), ("tool life used", ""),
                      ("evaluations", ""))]  # fmt: skip
    return Table(
        caption="What other ways find", heads=heads, rows=[_method(row) for row in part.methods],
        sources=sources, note="Inside is what keeps the limits with their margins, and that of "
        "the load as surely as asked: a program may be beyond although its predicted load is not.",
    )  # fmt: skip


def _method(row: MethodResult) -> list[Cell]:
    inside = row.feasible
    return cells(
        sentence(row.method),
        Cell(text="inside" if inside else "beyond", status="passed" if inside else "failed"),
        figure(row.time_s, 4),
        figure(row.cost, 4),
        figure(row.energy_kWh),
        share(row.tool_life_share),
        figure(row.evaluations),
    )


def binding_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Which limits hold the program back, and in how much of it."""
    if not part.binding:
        return None
    total, rows = part.after.time_s, []
    for row in part.binding:
        of_all = row.time_s / total if row.time_s is not None and total else None
        rows.append(cells(sentence(limit_name(row.limit)), figure(row.blocks),
                          figure(row.time_s), share(of_all)))  # fmt: skip
    heads = [*names("What binds"), *numbers(("blocks", ""), ("their time", "s"), ("of all", ""))]
    return Table(
        caption="What holds the program back", heads=heads, rows=rows, sources=sources,
        note="Blocks that cut; the rest of the time is air and waits. Nothing binds where the aim "
        "is best inside the limits, or where a block shares its F with others.",
    )  # fmt: skip


def groups_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Every group of blocks before and after, folded."""
    found, currency = part.groups, part.currency or ""
    if not found:
        return None
    pair = (("before", ""), ("after", ""))
    heads = [*names("Lines", "tool", "what binds")]
    for name, unit in (("F", ""), ("S", "rev/min"), ("Time", "s"), ("Cost", currency),
                       ("Peak load", "N")):  # fmt: skip
        heads += numbers(*((word, unit) for word, _ in pair), group=name)
    shown = found[:MOST_ROWS]
    return Table(
        caption=f"F and S of {counted(len(found), 'group')} of blocks"
        + left_out(len(found), len(shown)),
        heads=heads, rows=[_group(row) for row in shown], sources=sources, folded=True,
        note="F is in mm/min, or in mm/rev where that stands behind it; where a group had several "
        "F or S, their mean over its time.",
    )  # fmt: skip


def _group(row: BlockGroup) -> list[Cell]:
    unit = " mm/rev" if row.feed_unit == "mm/rev" else ""
    first, last = row.first_line, row.last_line
    return cells(
        str(first) if first == last else f"{first}–{last}",
        f"T{row.tool}",
        limit_name(row.binds) if row.binds else NONE,
        *(figure(feed, 4) + unit for feed in (row.feed_before, row.feed_after)),
        *(figure(_whole(speed)) for speed in (row.speed_before, row.speed_after)),
        figure(row.time_before_s),
        figure(row.time_after_s),
        figure(row.cost_before),
        figure(row.cost_after),
        figure(row.peak_load_before_N),
        figure(row.peak_load_after_N),
    )


def _whole(value: float | None) -> int | None:
    return None if value is None else round(value)


def front_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """The front, folded, the knee marked."""
    found, currency = part.front, part.currency or ""
    if not found:
        return None
    rows = [
        cells(
            "the knee" if row.knee else str(k),
            figure(row.time_s, 4),
            figure(row.cost, 4),
            figure(row.energy_kWh),
            share(row.tool_life_share),
        )
        for k, row in enumerate(found[:MOST_ROWS], 1)
    ]
    heads = [*names("Member"), *numbers(("time", "s"), ("cost", currency), ("energy", "kWh"),
                                        ("tool life used", ""))]  # fmt: skip
    caption = f"The front: {counted(len(found), 'program')}" + left_out(len(found), len(rows))
    return Table(caption=caption, heads=heads, rows=rows, sources=sources, folded=True)


def uncertain_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Uncertain quantities with their spread and source."""
    if part.certainty is None or not part.certainty.uncertain:
        return None
    rows = [
        cells(*(_words(words) for words in (row.what, row.value, row.spread, row.source)))
        for row in part.certainty.uncertain
    ]
    heads = names("What is uncertain", "value", "spread", "where that comes from")
    return Table(caption="What the certainty allows for", heads=heads, rows=rows, sources=sources)


def _words(words: str) -> Cell:
    """Words; a name too long for a line is broken anywhere, as code is."""
    text = _typeset(words) or NONE
    return Cell(text=text, code=max(map(len, text.split()), default=0) > LONGEST)


def _typeset(words: str) -> str:
    """As a page writes what a plain text wrote: ``um``, ``^2``, a minus, whose settings."""
    text = re.sub(r"(?<=\d) um\b", " µm", words.replace("^2", "²"))
    text = re.sub(r"^certainty\.", "conf/optimisation, certainty.", text)
    return re.sub(r"^-(?=\d)", "−", text)


def limits_table(part: OptimisedPart, sources: list[Source]) -> Table | None:
    """Limits that were given, and what is kept free of each."""
    rows, margins = [], part.limits.margins
    for key, value in part.limits.given.items():
        if key == "margins" or value == 0 or (key == "power_share" and value == 1):
            continue
        words, unit = limit_words(key)
        free = getattr(margins, words.margin) if words.margin else 0.0
        rows.append(cells(sentence(words.name), _printed(value, unit.replace("um", "µm")),
                          share(free) if free else NONE))  # fmt: skip
    if not rows:
        return None
    heads = names("Limit", "value", "kept free of it")
    return Table(caption="Limits", heads=heads, rows=rows, sources=sources)


def _printed(value: float | tuple[float, ...], unit: str) -> str:
    """A limit, or a range, with its unit."""
    known = value if isinstance(value, tuple) else (value,)
    words = " to ".join(asked(v) for v in known)
    return f"{words}{NARROW}{unit}" if unit else words


def proof_table(part: OptimisedPart, sources: list[Source]) -> Table:
    """Hashes of the program before and after, and of what both tell the machine."""
    proof = part.proof
    rows = [
        [Cell(text=name), Cell(text=sha256 or NONE, code=True)]
        for name, sha256 in (
            ("Program as it was", proof.before_sha256),
            ("Program as it is written", proof.after_sha256),
            ("What both do: every move, state, tool and code but F and S", proof.sha256),
        )
    ]
    return Table(caption="Proof", heads=names("Of what", "sha256"), rows=rows, sources=sources)
