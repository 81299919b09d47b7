"""The page of an optimised program, from the JSON that ``kerf optimise`` writes; nothing else."""

from pathlib import Path
from typing import Any

from pipeline.charts.numbers import NARROW, asked, counted, number, real, signed
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.sources import Source, dig, objects_of, rows_of, words_of
from pipeline.report import optimise_block_figures, optimise_front_figure, optimise_load_figure
from pipeline.report.alone import LonePage, rendered, source_of
from pipeline.report.cut_tables import sentence, share
from pipeline.report.optimise_block_figures import Blocks, pairs_figure, per_pair, words_figure
from pipeline.report.optimise_front_figure import compared, front_figure, front_places
from pipeline.report.optimise_load_figure import load_figure, tool_spans, way_load
from pipeline.report.optimise_tables import (
    binding_table,
    front_table,
    gain_table,
    groups_table,
    limits_table,
    methods_table,
    proof_table,
    uncertain_table,
)
from pipeline.report.optimise_verdict import aim, changed_words, key_figures, verdict

NEEDED = ("before", "after", "groups", "proof")


def write_optimise_page(document: dict[str, Any], out: Path, source: Path | None = None) -> None:
    """Write the page of a ``document`` of ``kerf optimise``; ``source`` is the file that holds it.

    Raises
    ------
    ValueError
        When the document is of something else.
    """
    lacking = [key for key in NEEDED if key not in document]
    if lacking:
        raise ValueError(
            f"{out} cannot be drawn: the document has no {lacking[0]}, take one of kerf optimise"
        )
    sources = [source_of(source)] if source is not None else []
    text = rendered(optimise_page(document, sources), "optimise.html.j2")
    out.write_text(text, encoding="utf-8", newline="\n")


def optimise_page(document: dict[str, Any], sources: list[Source]) -> LonePage:
    """What stands on the page of a document, in the order in which its reader needs it."""
    status, word, sentences = verdict(document)
    return LonePage(
        program=str(document.get("program") or ""),
        machine=str(document.get("machine") or ""),
        about=_about(document),
        origin="simulated" if document.get("origin") == "simulated" else "recorded",
        status=status,
        word=word,
        sentences=sentences,
        key_figures=key_figures(document),
        sections=optimise_sections(document, sources),
    )


def _about(document: dict[str, Any]) -> str:
    return (
        f"For {aim(document)}: {document.get('stock') or 'a blank'} in "
        f"{document.get('material') or 'a material'} on {document.get('machine')}, tools of "
        f"{document.get('tool_table') or 'a table'}"
    )


def optimise_sections(document: dict[str, Any], sources: list[Source]) -> list[Section]:
    """Load, words, where time goes, certainty, methods, proof, basis."""
    found = [
        _load_section(document, sources), _words_section(document, sources),
        _time_section(document, sources), _certainty_section(document, sources),
        _methods_section(document, sources), _proof_section(document, sources),
        _basis_section(document, sources),
    ]  # fmt: skip
    return [section for section in found if section is not None]


def _load_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    before, after = (way_load(document, which) for which in ("before", "after"))
    if before is None or after is None:
        return None
    limit, program = real(dig(document, "limits", "load_N")), str(document.get("program") or "")
    legend = [*optimise_load_figure.LEGEND]
    if limit is not None:
        legend.append(optimise_load_figure.OVER)
    label = f"Load along the way of {program}, as programmed and optimised"
    figure = Figure(
        svg=load_figure(before, after, limit, tool_spans(document), label),
        caption="Highest force on the tool in the plane over the way at feed; the way is the same "
        "before and after, so that what stands below each other is the same place of the part.",
        sources=sources,
    )
    return Section(
        key="load", title="Load before and after", text=_verified(document),
        blocks=[Figures(figures=[figure], legend=legend, kind="one wide")],
    )  # fmt: skip


def _verified(document: dict[str, Any]) -> list[str]:
    peak = real(dig(document, "verified", "peak_load_N"))
    if peak is None:
        return []
    line, tightened = (real(dig(document, "verified", k)) for k in ("peak_line", "tightened"))
    where = "" if line is None else f" in line {line:.0f}"
    behind = dig(document, "verified", "following_um")
    servo = "the servo, " if isinstance(behind, dict) else ""
    said = (
        f"The answer was put through the whole twin, with {servo}the feeds that the control "
        f"reaches and the waveform of the load: its highest load is {number(peak)}{NARROW}N{where}."
    )
    if tightened:
        said += f" Feeds were lowered for that in {counted(int(tightened), 'round')}."
    axes = behind.items() if isinstance(behind, dict) else ()
    told = [f"{axis} {number(um)}" for axis, um in axes if real(um) is not None]
    return [f"{said} The axes lag by at most {', '.join(told)}{NARROW}µm." if told else said]


def _words_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    blocks = Blocks(rows=rows_of(document, "groups"))
    if not len(blocks):
        return None
    program = str(document.get("program") or "")
    found: list[Any] = []
    if (picture := words_figure(blocks, f"F and S of the blocks of {program}")) is not None:
        figure = Figure(
            svg=picture,
            caption="F and S of each group of blocks, in the order of the program, and the limit "
            "that holds it back; groups are drawn equally wide.",
            sources=sources,
        )
        legend = optimise_block_figures.WORDS_LEGEND
        found.append(Figures(figures=[figure], legend=legend, kind="one wide"))
    found += present(binding_table(document, sources), groups_table(document, sources))
    return Section(key="words", title="F and S, and what binds them", blocks=found)


def _time_section(document: dict[str, Any], sources: list[Source]) -> Section:
    blocks = Blocks(rows=rows_of(document, "groups"))
    currency = str(document.get("currency") or "")
    heads = [("Time, s", "time_{}_s"), (f"Cost, {currency}".removesuffix(", "), "cost_{}")]
    picture = None
    if len(blocks):
        picture = pairs_figure(blocks, heads, "Time and cost of the blocks before and after")
    found: list[Any] = [gain_table(document, sources)]
    if picture is not None:
        many = per_pair(len(blocks))
        one = "one group of blocks" if many == 1 else f"{many} groups of blocks"
        figure = Figure(svg=picture, caption=f"Time and cost, each pair of columns {one}.",
                        sources=sources)  # fmt: skip
        legend = optimise_block_figures.PAIR_LEGEND
        found.append(Figures(figures=[figure], legend=legend, kind="one wide"))
    return Section(key="time", title="Time and cost", blocks=found)


def _certainty_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    if not objects_of(document).get("certainty"):
        return None
    table = uncertain_table(document, sources)
    return Section(key="certainty", title="How sure it is", text=_certainty_text(document),
                   blocks=present(table))  # fmt: skip


def _certainty_text(document: dict[str, Any]) -> list[str]:
    of = objects_of(document)["certainty"]
    chance, allowed, draws = (real(of.get(key)) for key in ("exceedance", "epsilon", "draws"))
    said = []
    if chance is not None:
        ends = of.get("interval_95")
        known = [real(v) for v in ends] if isinstance(ends, list) else []
        interval = f" ({share(known[0])} to {share(known[1])})" if len(known) == 2 else ""
        drawn = f" of {counted(int(draws), 'draw')}" if draws else ""
        most = (
            f"; asked for was at most {asked(100 * allowed)}{NARROW}%"
            if allowed is not None
            else ""
        )
        said.append(
            f"The load passes its limit somewhere in the part in {share(chance)}{interval}{drawn} "
            f"that the answer was not made with{most}."
        )
    return said + _peaks(of) + _price(document, of)


def _peaks(of: dict[str, Any]) -> list[str]:
    told = [
        f"below {number(load)}{NARROW}N in {asked(100 * part)}{NARROW}%"
        for row in rows_of(of, "peaks")
        if (load := real(row.get("load_N"))) is not None
        and (part := real(row.get("share"))) is not None
    ]
    return [f"The highest load of a part is {', '.join(told)} of parts."] if told else []


def _price(document: dict[str, Any], of: dict[str, Any]) -> list[str]:
    nominal, extra = real(dig(of, "nominal", "time_s")), real(dig(of, "price", "time_s"))
    if nominal is None or extra is None:
        return []
    percent = real(dig(of, "price", "time_percent"))
    told = f"{number(extra)}{NARROW}s"
    told += "" if percent is None else f" ({signed(percent)}{NARROW}%)"
    cost, share_ = (real(dig(of, "price", key)) for key in ("cost", "cost_percent"))
    if cost is not None:
        told += f" and {number(cost)} {document.get('currency') or ''}".rstrip()
        told += "" if share_ is None else f" ({signed(share_)}{NARROW}%)"
    return [
        f"Were every value exactly as stated, the best program would take {number(nominal, 4)}"
        f"{NARROW}s: the price of certainty is {told}."
    ]


def _methods_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    table, keys = methods_table(document, sources), compared(document)
    figures = None if keys is None else _front(document, keys, sources)
    blocks = present(table, figures, front_table(document, sources))
    if not blocks:
        return None
    title = "Methods side by side" if figures is None else "Methods, and what else is possible"
    return Section(key="methods", title=title, blocks=blocks)


def _front(document: dict[str, Any], keys: tuple[str, str], sources: list[Source]) -> Figures:
    currency = str(document.get("currency") or "")
    names = optimise_front_figure.QUANTITIES
    heads = tuple(f"{names[k]}, {currency}" if k == "cost" else names[k] for k in keys)
    front = front_places(document, keys)
    others = optimise_front_figure.method_places(document, keys)
    better = any(row.get("no_worse") is True for row in rows_of(document, "front"))
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
    legend = [*optimise_front_figure.LEGEND, *optimise_front_figure.METHODS_LEGEND]
    return Figures(figures=[first, second], legend=legend)


def _proof_section(document: dict[str, Any], sources: list[Source]) -> Section:
    pairs = [
        (sentence(str(row.get("reason") or "")),
         f"{_moves(row.get('rows'))}, the first in {row.get('first')}: as programmed.")
        for row in rows_of(document, "held")
    ]  # fmt: skip
    return Section(
        key="proof", title="What was changed", text=_proof_text(document), pairs=pairs,
        blocks=present(proof_table(document, sources)),
    )  # fmt: skip


def _moves(rows: Any) -> str:
    return counted(rows, "move") if isinstance(rows, int) else "some moves"


def _proof_text(document: dict[str, Any]) -> list[str]:
    many, moves = changed_words(document), real(dig(document, "proof", "moves"))
    if dig(document, "proof", "same") is not True:
        first = str(dig(document, "proof", "first") or "not told")
        return [f"The two programs do not make the same moves. First difference: {first}."]
    counts = dig(document, "words")
    of = counts if isinstance(counts, dict) else {}
    parts = [f"{number(int(n))} {key[0]} {key[2:]}" for key, n in of.items() if real(n)]
    told = "" if many is None else f": {counted(many, 'word')} ({', '.join(parts)})"
    told = told.replace(" ()", "")
    machine = str(document.get("machine") or "")
    command = "kerf check BEFORE AFTER" + (f" --machine {machine}" if machine else "")
    move = "The moves" if moves is None else f"All {number(int(moves))} moves"
    return [
        f"Only F and S words changed{told}; every other byte of the program is as it was. {move}, "
        "modal states, tools, offsets and codes are the same to the last bit, compared by a "
        f"check that shares nothing with what wrote the program: {command}."
    ]


def _basis_section(document: dict[str, Any], sources: list[Source]) -> Section:
    unknown = [
        (f"{sentence(str(row.get('what')))}: not known", sentence(str(row.get("why") or "")) + ".")
        for row in rows_of(document, "not_known")
    ]
    control = {"identified": "The machine’s control is the one that was identified.",
               "conf/machine": "The machine’s control is as in conf/machine, not identified: times "
               "are unproven."}.get(str(document.get("control")), "")  # fmt: skip
    return Section(
        key="basis", title="What these numbers rest on",
        text=[*filter(None, [control]), *words_of(document, "notes")], pairs=unknown,
        blocks=present(limits_table(document, sources)), closing=True,
    )  # fmt: skip
