"""Page of one program's cut: verdict, key figures, load, stability, cost, basis."""

from pathlib import Path
from typing import Any

from pipeline.charts.numbers import counted, duration, number, real
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.sources import Source
from pipeline.report.cut.figures import (
    DRIVE_LEGEND,
    ENGAGEMENT_LEGEND,
    LOAD_LEGEND,
    LOBES_LEGEND,
    OVER_LEGEND,
    cut_trace,
    drive_figure,
    engagement_figure,
    load_figure,
    lobes_figure,
)
from pipeline.report.cut.tables import (
    basis_table,
    cost_table,
    entry,
    forces_table,
    rows_of,
    sentence,
    share,
    warnings_pairs,
    worst_table,
)
from pipeline.report.standalone_page import StandalonePage, rendered, source_of

NOTHING = "Nothing is cut: the tool never meets the stock. Look at the stock's place and size."


def write_cut_page(document: dict[str, Any], out: Path, source: Path | None = None) -> None:
    """Write the page of a ``document`` with a cut; ``source`` is the file that holds it.

    Raises
    ------
    ValueError
        When the document holds no cut.
    """
    if not isinstance(document.get("cut"), dict):
        raise ValueError(
            f"{out} cannot be drawn: the document holds no cut, give --stock, --tool-table and "
            "--material"
        )
    sources = [source_of(source)] if source is not None else []
    page = cut_page(document, sources)
    out.write_text(rendered(page, "cut.html.j2"), encoding="utf-8", newline="\n")


def cut_page(document: dict[str, Any], sources: list[Source]) -> StandalonePage:
    """Verdict, key figures and sections of a document, in the order in which they are read."""
    status, word, sentences = _verdict(document)
    sections = [
        _load_section(document, sources),
        _stability_section(document, sources),
        _cost_section(document, sources),
        _basis_section(document, sources),
    ]
    stock = str(entry(document, "cut", "stock", "text") or "")
    material = str(entry(document, "cut", "material", "name") or "")
    return StandalonePage(
        program=str(document.get("program") or ""),
        machine=str(document.get("machine") or ""),
        about=f"Cut of {stock} in {material} on {document.get('machine')}",
        origin="simulated" if document.get("origin") == "simulated" else "recorded",
        status=status,
        word=word,
        sentences=sentences,
        key_figures=_key_figures(document),
        sections=[s for s in sections if s is not None],
    )


def _verdict(document: dict[str, Any]) -> tuple[str, str, list[str]]:
    warnings = rows_of(document, "cut", "warnings")
    grave = [w for w in warnings if w.get("grave") is True]
    not_known = [str(row.get("what")) for row in rows_of(document, "cut", "not_known")]
    unsaid = [f"Not known: {', '.join(not_known)}."] if not_known else []
    if not rows_of(document, "cut", "by_tool"):
        return "failed", "cuts nothing", [NOTHING]
    if grave:
        return "failed", "beyond its limits", _nearest(document) + _sentences(grave) + unsaid
    if warnings:
        return "attention", "look first", _nearest(document) + _sentences(warnings) + unsaid
    if real(entry(document, "cut", "limits", "load_N")) is None:
        given = ["No limit of the load was given."]
        return "unknown", "no limit given", given + _nearest(document) + unsaid
    within = ["No block passes a limit that is known."]
    return "passed", "within its limits", within + _nearest(document) + unsaid


def _nearest(document: dict[str, Any]) -> list[str]:
    """Which block takes the largest share of what binds it; nothing where none is known."""
    known = [
        (used, row) for row in rows_of(document, "cut", "worst")
        if row.get("binds") and (used := real(row.get("used"))) is not None
    ]  # fmt: skip
    if not known:
        return []
    used, row = max(known, key=lambda pair: pair[0])
    where = "Furthest beyond its limit" if used > 1 else "Nearest to its limit"
    binds = str(row["binds"]).removesuffix(" limit")
    guessed = binds == "stability" and entry(document, "cut", "dynamics_measured") is not True
    what = binds if binds == "stability" else f"the {binds}"
    doubt = ", by dynamics that were not measured" if guessed else ""
    return [f"{where} is {what}: {share(used)} in line {row.get('line')}{doubt}."]


def _sentences(warnings: list[dict[str, Any]]) -> list[str]:
    """Each warning with how many blocks it holds for."""
    found = []
    for row in warnings:
        blocks = row.get("blocks")
        many = f" in {counted(blocks, 'block')}" if isinstance(blocks, int) else ""
        found.append(f"{sentence(str(row.get('what')))}{many}.")
    return found


def _key_figures(document: dict[str, Any]) -> list[tuple[str, str, str]]:
    found = entry(document, "cut", "summary")
    total = found if isinstance(found, dict) else {}
    limit, line = real(entry(document, "cut", "limits", "load_N")), real(total.get("peak_line"))
    where = [f"line {line:.0f}"] if line is not None else []
    where += [f"limit {number(limit)} N"] if limit is not None else []
    driven, air = real(total.get("drive_share")), real(total.get("air_share"))
    return [
        ("Peak load", _with_unit(total.get("peak_load_N"), "N"), ", ".join(where)),
        ("Peak power", _with_unit(total.get("power_kW"), "kW"),
         "drive not known" if driven is None else f"{share(driven)} of the drive"),
        ("Removed", _with_unit(total.get("volume_cm3"), "cm³"),
         f"{_with_unit(total.get('removal_rate_cm3_min'), 'cm³/min')} while cutting"),
        ("Program", duration(total.get("time_s")),
         "" if air is None else f"{share(air)} of the time at feed in air"),
        _cost_figure(total, str(entry(document, "cut", "currency") or "")),
    ]  # fmt: skip


def _cost_figure(total: dict[str, Any], currency: str) -> tuple[str, str, str]:
    cost, time = real(entry(total, "cost", "sum")), real(entry(total, "cost", "time"))
    if cost is None and time is not None:
        return "Cost of the time", _with_unit(time, currency), "tool life is not known"
    return "Cost of the part", _with_unit(cost, currency), ""


def _with_unit(value: Any, unit: str) -> str:
    known = real(value)
    return "not known" if known is None else f"{number(known)} {unit}"


def _load_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    trace = cut_trace(document)
    if trace is None:
        return None
    limit = real(entry(document, "cut", "limits", "load_N"))
    program = str(document.get("program") or "")
    legend = [*LOAD_LEGEND, *([OVER_LEGEND] if limit is not None else [])]
    load = Figure(
        svg=load_figure(trace, limit, f"Peak load over the time of {program}"),
        caption="Greatest force on the tool in the plane within a revolution, over the time of the "
        "program, at the highest feed that each block reaches.",
        sources=sources,
    )
    engagement = Figure(
        svg=engagement_figure(trace, f"Axial and radial depth, entry and exit of {program}"),
        caption="Depth along the tool’s axis, depth across the feed, and the arc on which a tooth "
        "is in the material: 0° where up-milling enters, 180° where down-milling leaves.",
        sources=sources,
    )
    return Section(
        key="load",
        title="Load along the path",
        text=[
            "Each column is a stretch of time; lowest and highest values of a column are drawn, so "
            "that no peak is lost."
        ],
        pairs=warnings_pairs(document),
        blocks=[
            Figures(figures=[load], legend=legend, kind="one wide"),
            Figures(figures=[engagement], legend=ENGAGEMENT_LEGEND, kind="one wide"),
            forces_table(document, sources),
            *present(worst_table(document, sources)),
        ],
    )


def _stability_section(document: dict[str, Any], sources: list[Source]) -> Section | None:
    lobes, drive = _lobes(document, sources), _drive(document, sources)
    unknown = [
        (f"{sentence(str(row.get('what')))}: not known", str(row.get("why") or ""))
        for row in rows_of(document, "cut", "not_known")
    ]
    if lobes is None and drive is None and not unknown:
        return None
    source = entry(document, "cut", "dynamics")
    return Section(
        key="stability",
        title="Stability and drive",
        text=[f"Stability rests on {source}."] if lobes is not None and source else [],
        pairs=unknown,
        blocks=present(lobes, drive),
    )


def _lobes(document: dict[str, Any], sources: list[Source]) -> Figures | None:
    found = []
    for one in rows_of(document, "cut", "lobes"):
        label = str(one.get("label") or "")
        picture = lobes_figure(one, f"Stability lobes of {label}")
        if picture is None:
            continue
        caption = (
            f"{label}: limit of the axial depth over speed for the engagement of line "
            f"{one.get('line')}, {number(one.get('entry_deg'))}° to "
            f"{number(one.get('exit_deg'))}°, with the blocks that have it."
        )
        found.append(Figure(svg=picture, caption=caption, sources=sources))
    return Figures(figures=found, legend=LOBES_LEGEND) if found else None


def _drive(document: dict[str, Any], sources: list[Source]) -> Figures | None:
    drive = entry(document, "cut", "drive")
    if not isinstance(drive, dict):
        return None
    picture = drive_figure(drive, rows_of(drive, "points"), "Cutting power against the drive")
    if picture is None:
        return None
    caption = "Cutting power of the blocks against the power that the spindle’s drive has left."
    figure = Figure(svg=picture, caption=caption, sources=sources)
    return Figures(figures=[figure], legend=DRIVE_LEGEND)


def _cost_section(document: dict[str, Any], sources: list[Source]) -> Section:
    return Section(
        key="cost", title="Time, tool life and cost", blocks=[cost_table(document, sources)]
    )


def _basis_section(document: dict[str, Any], sources: list[Source]) -> Section:
    left_out = [
        (str(row.get("reason")), f"{row.get('rows')} moves, the first in {row.get('first')}.")
        for row in rows_of(document, "cut", "left_out")
    ]
    notes = entry(document, "cut", "notes")
    return Section(
        key="basis",
        title="What these numbers rest on",
        text=[str(note) for note in notes] if isinstance(notes, list) else [],
        pairs=left_out,
        blocks=[basis_table(document, sources)],
        closing=True,
    )
