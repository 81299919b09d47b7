"""Page of an optimised program, from its stored document; nothing else."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.charts.numbers import (
    NARROW,
    as_stated,
    blank_words,
    counted,
    duration,
    number,
    signed,
)
from pipeline.charts.sections import Figure, Figures, Section, drawing, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import Column, tabulated
from pipeline.report.cut.tables import (
    NONE,
    axes_table,
    between,
    edge_words,
    edges_table,
    sentence,
    share,
    warnings_pairs,
)
from pipeline.report.optimised import tables
from pipeline.report.optimised.changes import changes_section
from pipeline.report.optimised.figures import (
    FRONT_LEGEND,
    LOAD_LEGEND,
    METHODS_LEGEND,
    QUANTITIES,
    WORDS_LEGEND,
    compared,
    front_figure,
    front_places,
    load_figures,
    method_places,
    pairs_figure,
    per_pair,
    words_figure,
)
from pipeline.report.optimised.path import SCRIPT, path_section
from pipeline.report.optimised.verdict import key_figures, verdict
from pipeline.report.provenance import UNKNOWN, Made
from pipeline.report.standalone_page import StandalonePage, rendered, source_of, verdicts_section
from pipeline.schema.part import OptimisedPart, Reliability
from pipeline.schema.part_sheet import SetupTool, WorkOffset
from pipeline.schema.program_cut import CutWarning

MOST_WARNINGS = 8
MOST_SPANS = 6
"""Stretches of lines that a warning names."""


def write_optimised_page(
    part: OptimisedPart, out: Path, source: Path | None = None, made: Made = UNKNOWN
) -> None:
    """Write the page of a part; ``source`` is the file that holds it."""
    sources = [source_of(source)] if source is not None else []
    rendered(optimised_page(part, sources), out.name, made).write(out)


def optimised_page(part: OptimisedPart, sources: list[Source]) -> StandalonePage:
    """Changes, path, load, words, time, certainty, methods, proof, set-up, basis, in this order."""
    status, word, sentences = verdict(part)
    path, inch = path_section(part, sources), part.unit != "mm"
    sections = [
        _warnings_section(part.warnings), verdicts_section(part.verdicts),
        changes_section(part, sources), path, _load_section(part, sources),
        _words_section(part, sources), _time_section(part, sources),
        _certainty_section(part, sources), _methods_section(part, sources),
        _proof_section(part, sources), _setup_section(part, sources), _basis_section(part, sources),
    ]  # fmt: skip
    return StandalonePage(
        program=part.program,
        machine=part.machine,
        about=f"For {tables.aim(part)}: {blank_words(part.stock)} in {part.material} on "
        f"{part.machine}, tools of {part.tool_table}"
        + (". F is in inch, as the program writes it (G20); all else is in mm" if inch else ""),
        origin="simulated" if part.origin == "simulated" else "recorded",
        status=status,
        word=word,
        sentences=sentences,
        key_figures=key_figures(part),
        sections=[section for section in sections if section is not None],
        running="Kerf: a part program made better inside its limits",
        computed="Computed by Kerf from the program, the stock and the tools named above; nothing "
        "of it was measured in a cut.",
        script=None if path is None else SCRIPT,
    )


def _load_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    figures = load_figures(part, sources)
    if figures is None:
        return None
    return Section(
        key="load", title="Load before and after",
        text=[*_verified(part), *edge_words(part.edges)],
        blocks=[figures, *present(
            edges_table(part.edges, sources, "optimised: "),
            axes_table(part.verified.axes, sources),
        )],
    )  # fmt: skip


def _verified(part: OptimisedPart) -> list[str]:
    check = part.verified
    if check.peak_load_N is None:
        return []
    where = "" if check.peak_line is None else f" in line {check.peak_line}"
    servo = "" if check.following_um is None else "the servo, "
    said = (
        f"The answer was put through the whole twin, with {servo}the feeds that the control "
        f"reaches and the waveform of the load: its highest load is "
        f"{number(check.peak_load_N)}{NARROW}N{where}."
    )
    if check.tightened:
        said += f" Feeds were lowered for that in {counted(check.tightened, 'round')}."
    lags = [
        f"{axis} {number(um)}" for axis, um in (check.following_um or {}).items() if um is not None
    ]
    return [
        f"{said} In the cut the axes lag by at most {', '.join(lags)}{NARROW}µm." if lags else said
    ]


def _words_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    if not part.groups:
        return None
    picture = words_figure(part.groups, f"F and S of the blocks of {part.program}")
    caption = (
        "F and S of each group of blocks, in the order of their lines, and the limit that holds "
        "it back; groups are drawn equally wide."
    )
    return Section(
        key="words", title="F and S, and what binds them",
        blocks=present(drawing(picture, caption, sources, WORDS_LEGEND),
                       tables.binding_table(part, sources), tables.groups_table(part, sources)),
    )  # fmt: skip


def _time_section(part: OptimisedPart, sources: list[Source]) -> Section:
    cost = f"Cost, {part.currency}" if part.currency else "Cost"
    heads = [("Time, s", "time_{}_s"), (cost, "cost_{}")]
    picture = None
    if part.groups:
        picture = pairs_figure(part.groups, heads, "Time and cost of the blocks before and after")
    many = per_pair(len(part.groups))
    one = "one group of blocks" if many == 1 else f"{many} groups of blocks"
    caption = f"Time and cost, each pair of columns {one}."
    figures = drawing(picture, caption, sources, LOAD_LEGEND)
    return Section(key="time", title="Time and cost",
                   blocks=present(tables.gain_table(part, sources), figures))  # fmt: skip


def _certainty_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    if part.certainty is None:
        return None
    return Section(
        key="certainty", title="How sure it is", text=_certainty_text(part, part.certainty),
        blocks=present(tables.uncertain_table(part, sources)),
    )  # fmt: skip


def _certainty_text(part: OptimisedPart, of: Reliability) -> list[str]:
    said = []
    if of.exceedance is not None:
        interval = f" ({' to '.join(share(end) for end in of.interval_95)})"
        said.append(
            f"The load passes its limit somewhere in the part in {share(of.exceedance)}{interval} "
            f"of {counted(of.draws, 'draw')} that the answer was not made with; allowed was at "
            f"most {as_stated(100 * of.epsilon)}{NARROW}%{of.of_tools}."
        )
    return said + _peaks(of) + _price(part, of)


def _peaks(of: Reliability) -> list[str]:
    words = [
        f"below {number(row.load_N)}{NARROW}N in {as_stated(100 * row.share)}{NARROW}%"
        for row in of.peaks
        if row.load_N is not None
    ]
    return [f"The highest load of a part is {', '.join(words)} of parts."] if words else []


def _price(part: OptimisedPart, of: Reliability) -> list[str]:
    nominal, price = of.nominal, of.price
    if nominal is None or price is None or None in (nominal.time_s, price.time_s):
        return []
    extra = f"{number(price.time_s)}{NARROW}s"
    if price.time_percent is not None:
        extra += f" ({signed(price.time_percent)}{NARROW}%)"
    if price.cost is not None:
        extra += f" and {number(price.cost)} {part.currency or ''}".rstrip()
        if price.cost_percent is not None:
            extra += f" ({signed(price.cost_percent)}{NARROW}%)"
    return [
        f"Were every value exactly as stated, the best program would take "
        f"{number(nominal.time_s, 4)}{NARROW}s: the price of certainty is {extra}."
    ]


def _methods_section(part: OptimisedPart, sources: list[Source]) -> Section | None:
    table, keys = tables.methods_table(part, sources), compared(part)
    figures = None if keys is None else _front(part, keys, sources)
    blocks = present(table, figures, tables.front_table(part, sources))
    if not blocks:
        return None
    title = "Methods side by side" if figures is None else "Methods, and what else is possible"
    return Section(key="methods", title=title, blocks=blocks)


def _front(part: OptimisedPart, keys: tuple[str, str], sources: list[Source]) -> Figures:
    currency, names = part.currency or "", QUANTITIES
    heads = tuple(f"{names[k]}, {currency}" if k == "cost" else names[k] for k in keys)
    front, others = front_places(part, keys), method_places(part, keys)
    better = any(row.no_worse for row in part.front)
    among = " It is that of the programs that are in nothing worse than the one before."
    first = Figure(
        svg=front_figure(front, (heads[0], heads[1]), "The front in two objectives"),
        caption="The front: programs than which no other is better in all objectives, drawn in the "
        "two that pull apart most. At the knee, one begins to cost much of the other."
        + (among if better else ""),
        sources=sources,
    )
    second = Figure(
        svg=front_figure([*others, *front], (heads[0], heads[1]), "The front and other methods"),
        caption="The same beside the program as it was, and what other methods find inside the "
        "limits.",
        sources=sources,
    )
    legend = [*FRONT_LEGEND, *METHODS_LEGEND]
    return Figures(figures=[first, second], legend=legend)


def _proof_section(part: OptimisedPart, sources: list[Source]) -> Section:
    pairs = [
        (sentence(row.reason), f"{counted(row.rows, 'move')}, the first in {row.first}.")
        for row in part.held
    ]
    return Section(
        key="proof", title="What was changed", text=_proof_text(part), pairs=pairs,
        blocks=present(tables.proof_table(part, sources)),
    )  # fmt: skip


def _proof_text(part: OptimisedPart) -> list[str]:
    proof, words = part.proof, part.words
    if not proof.same:
        first = proof.first or "not told"
        return [f"The two programs do not make the same moves. First difference: {first}."]
    counts = {
        "F changed": words.F_changed, "F added": words.F_added,
        "S changed": words.S_changed, "S added": words.S_added,
    }  # fmt: skip
    listed = ", ".join(f"{number(many)} {what}" for what, many in counts.items() if many)
    which = f": {counted(words.total, 'word')} ({listed})".replace(" ()", "")
    points = ""
    if proof.points:
        points = f", and {counted(proof.points, 'line')} with a point of the path were put in"
    command = "kerf check BEFORE AFTER" + (f" --machine {part.machine}" if part.machine else "")
    return [
        f"Only F and S words changed{which}{points}; every other byte of the program is as it was. "
        f"All {number(proof.moves)} moves, "
        "modal states, tools, offsets and codes are the same to the last bit, compared by a "
        f"check that shares nothing with what wrote the program: {command}."
    ]


def _basis_section(part: OptimisedPart, sources: list[Source]) -> Section:
    unknown = [
        (f"{sentence(row.what)}: not known", sentence(row.why) + ".") for row in part.not_known
    ]
    control = {"identified": "The machine’s control is the one that was identified.",
               "conf/machine": "The machine’s control is as in conf/machine, not identified: times "
               "are unproven."}.get(part.control, "")  # fmt: skip
    return Section(
        key="basis", title="What these numbers rest on",
        text=[*filter(None, [control, part.split]), *part.notes], pairs=unknown,
        blocks=present(tables.limits_table(part, sources)), closing=True,
    )  # fmt: skip


def _warnings_section(warnings: Sequence[CutWarning]) -> Section | None:
    """Warnings, which stand before all other sections."""
    if not warnings:
        return None
    return Section(key="warnings", title="Look at this first", pairs=_warnings(warnings))


def _setup_section(part: OptimisedPart, sources: list[Source]) -> Section:
    """Sheet for the machine: tools, offsets, blank, warnings; one page when printed."""
    sheet = part.setup
    time = NONE if part.after.time_s is None else duration(part.after.time_s)
    return Section(
        key="setup", title="Set-up sheet",
        text=[f"{part.program} optimised, on {part.machine}: {time}."],
        pairs=[
            ("Blank", f"{_blank(part)} {part.material}; zero is that of {sheet.blank_offset}."),
            *(_warnings(sheet.warnings) or [("Warnings", "None.")]),
        ],
        blocks=present(
            tabulated("Tools, in the order in which they are called", sheet.tools, TOOLS, sources),
            tabulated("Work offsets, as the program was followed", sheet.offsets, OFFSETS, sources),
        ),
    )  # fmt: skip


TOOLS: tuple[Column[SetupTool], ...] = (
    Column("Tool", lambda row: tables.tool_name(row.tool, row.name)),
    Column("kind", lambda row: row.kind.replace("_", "-") or NONE),
    Column("diameter", lambda row: _length(row.diameter_mm), "mm"),
    Column("teeth", lambda row: NONE if row.flutes is None else str(row.flutes), ""),
    Column("stickout", lambda row: _length(row.stickout_mm), "mm"),
    Column("length H", lambda row: _length(row.length_mm), "mm"),
    Column("time", lambda row: duration(row.time_s), ""),
    Column("in the cut", lambda row: duration(row.in_material_s), ""),
    Column("life of one part",
           lambda row: share(row.life_share) + between(row, "life_share", share), ""),
)  # fmt: skip
OFFSETS: tuple[Column[WorkOffset], ...] = (
    Column("Offset", lambda row: row.name),
    *(
        Column(axis, lambda row, k=k: NONE if row.position_mm is None else  # type: ignore[misc]
               _length(row.position_mm[k]), "mm")
        for k, axis in enumerate("XYZ")
    ),
)  # fmt: skip


def _blank(part: OptimisedPart) -> str:
    """Size and place of the blank, as measured; as it was named without a path."""
    path = part.path
    if path is None:
        return f"{part.stock} [mm] of"
    ends = list(zip(path.blank_low_mm, path.blank_high_mm, strict=True))
    sizes = [_length(high - low) for low, high in ends]
    size = f"Ø {sizes[0]} × {sizes[2]}" if path.round_blank else " × ".join(sizes)
    spans = [f"{axis} {_length(low)} to {_length(high)}"
             for axis, (low, high) in zip("XYZ", ends, strict=True)]  # fmt: skip
    return f"{size}{NARROW}mm ({', '.join(spans)}) of"


def _length(value: float | None) -> str:
    return NONE if value is None else as_stated(round(value, 3)).replace("-", "−")


def _warnings(warnings: Sequence[CutWarning]) -> list[tuple[str, str]]:
    left = len(warnings) - MOST_WARNINGS
    more = [("More warnings", f"{left}, in the JSON.")] if left > 0 else []
    return warnings_pairs(warnings[:MOST_WARNINGS], MOST_SPANS) + more
