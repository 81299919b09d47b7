"""Page of one program's cut and its figures: verdict, load, engagement, stability, cost, basis."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import blank_words, counted, duration, number
from pipeline.charts.sections import Figure, Figures, Section, drawing, present
from pipeline.charts.sources import Source
from pipeline.charts.svg import anchor
from pipeline.report.cut import tables
from pipeline.report.programs.panels import Panel, clock, tool_spans
from pipeline.report.programs.simulated import Program, feed_classes, time_section
from pipeline.report.provenance import UNKNOWN, Made
from pipeline.report.standalone_page import (
    StandalonePage,
    doubts,
    rendered,
    source_of,
    verdicts_section,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.program_cut import (
    Curve,
    CutCost,
    CutWarning,
    DriveCurve,
    EngagementTrace,
    Lobes,
    ProgramCut,
)

TOP = 42  # px: tools and head above the first panel
LOAD_HEIGHT = 210  # px
DEPTH_HEIGHT, DEPTH_GAP = 88, 30  # px
POINT_TOP, POINT_HEIGHT = 22, 220  # px
LOAD_LEGEND = [
    ("s-cut", "peak load in a revolution, from the lowest to the highest of each column", "box"),
    ("s-band", "below the lowest", "box"),
]
OVER_LEGEND = ("s-over", "above the limit", "box")
ENGAGEMENT_LEGEND = [
    ("s-cut", "from the lowest to the highest of each column", "box"),
    ("s-rapid", "from entry to exit", "box"),
]
UNITS = 1000  # across a curve's viewport
MOST_POINTS = 400  # drawn; the nearest to their limit

LOBES_LEGEND = [
    ("s-unstable", "chatters", "box"),
    ("p-positive", "block, stable", "dot"),
    ("p-failed", "block, chatters", "dot"),
]
DRIVE_LEGEND = [
    ("l-measured", "what the drive can give", "line"),
    ("p-positive", "block", "dot"),
    ("p-failed", "block, above it", "dot"),
]


def values_of(curve: Curve) -> Floats:
    """A stored curve as an array; NaN where it has no value."""
    return np.array(curve, dtype=np.float64)


def load_figure(trace: EngagementTrace, limit: float | None, label: str) -> Markup:
    """Peak load, lowest to highest in each column; what is above ``limit`` [N] stands out."""
    high, low = values_of(trace.load_N_high), values_of(trace.load_N_low)
    known = high[np.isfinite(high)]
    top_value = max(float(known.max(initial=0.0)), limit or 0.0, 1e-6)
    panel = Panel(head="Load in the plane, N", top=TOP, height=LOAD_HEIGHT, most=1.08 * top_value)
    drawn = [
        panel.columns(np.zeros(len(low)), np.where(low > 0, low, np.nan), "s-band"),
        panel.columns(low, high, "s-cut"),
    ]
    if limit is not None:
        over = np.where(high > limit, high, np.nan)
        drawn.append(panel.columns(np.maximum(low, limit), over, "s-over"))
    parts = [
        *clock(trace.total_s, panel.top, panel.bottom),
        *panel.frame(),
        panel.band(drawn, len(high)),
        *tool_spans(trace.tools, panel.bottom),
    ]
    if limit is not None:
        parts.append(svg.across(panel.y(limit), "limit"))
        words = f"limit {number(limit)} N"
        parts.append(svg.text(100, panel.y(limit) - 5, words, "name end"))
    return svg.figure(parts, height=panel.bottom + 36, label=label, kind="golden")


def engagement_figure(trace: EngagementTrace, label: str) -> Markup:
    """Axial depth, radial depth, and the arc from entry to exit."""
    top: float = TOP
    parts: list[Markup] = []
    first = top
    for head, *ends in (
        ("Axial depth, mm", trace.axial_depth_mm_low, trace.axial_depth_mm_high),
        ("Radial depth, mm", trace.radial_depth_mm_low, trace.radial_depth_mm_high),
    ):
        low, high = (values_of(end) for end in ends)
        most = float(high[np.isfinite(high)].max(initial=0.0))
        panel = Panel(head=head, top=top, height=DEPTH_HEIGHT, most=1.08 * max(most, 1e-3))
        parts += [*panel.frame(), panel.band([panel.columns(low, high, "s-cut")], len(high))]
        top = panel.bottom + DEPTH_GAP
    entry, leave = values_of(trace.entry_deg), values_of(trace.exit_deg)
    whole = np.nanmax(leave) > 180.5
    angles = Panel(
        head="Engaged arc, °", top=top, height=DEPTH_HEIGHT, most=360.0 if whole else 180.0,
        marks=(0, 90, 180, 270, 360) if whole else (0, 45, 90, 135, 180),
    )  # fmt: skip
    arc = angles.columns(entry, leave, "s-rapid")
    parts += [*angles.frame(), angles.band([arc], len(entry))]
    behind = [*clock(trace.total_s, first, angles.bottom), *tool_spans(trace.tools, angles.bottom)]
    return svg.figure([*behind, *parts], height=angles.bottom + 36, label=label, kind="golden")


def lobes_figure(lobes: Lobes, label: str) -> Markup | None:
    """Limit of the axial depth over speed, with the blocks that have this engagement."""
    speeds, limit = values_of(lobes.speeds_rpm), values_of(lobes.depth_limit_mm)
    if len(speeds) < 2:
        return None
    points = [
        (p.speed_rpm, p.axial_depth_mm, (p.margin or 0) < 0) for p in lobes.points[:MOST_POINTS]
    ]
    deepest = max((depth for _, depth, _ in points), default=0.0)
    lowest = float(limit[np.isfinite(limit)].min(initial=np.inf))
    most = max(1.3 * deepest, 2.5 * lowest if np.isfinite(lowest) else 0.0, 1e-3)
    panel = Panel(head="Axial depth, mm", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(
        panel, speeds, np.where(np.isnan(limit), most, limit), points, label, above=True
    )


def drive_figure(drive: DriveCurve, label: str) -> Markup | None:
    """Cutting power of blocks against what the drive can give at their speed."""
    speeds, power = values_of(drive.speeds_rpm), values_of(drive.power_kW)
    if not np.isfinite(power).any():
        return None
    points = [
        (p.speed_rpm, p.power_kW, (p.drive_share or 0) > 1) for p in drive.points[:MOST_POINTS]
    ]
    found = [p for _, p, _ in points if p is not None]
    most = 1.15 * max([float(np.nanmax(power)), *found])
    panel = Panel(head="Cutting power, kW", top=POINT_TOP, height=POINT_HEIGHT, most=most)
    return _points_figure(panel, speeds, power, points, label, above=False)


def _points_figure(
    panel: Panel, speeds: np.ndarray, level: np.ndarray,
    points: Sequence[tuple[float | None, float | None, bool]], label: str, *, above: bool,
) -> Markup:  # fmt: skip
    """A curve over speed with points; what lies ``above`` it is shaded."""
    low, high = float(speeds[0]), float(speeds[-1])
    x = UNITS * (speeds - low) / (high - low)
    y = svg.FULL * (1 - np.minimum(level / panel.most, 1.0))
    drawn = []
    if above:
        line = svg.path_data(x, y)
        drawn.append(svg.tag("path", d=f"{line}V0H{round(float(x[0]))}z", class_="s-unstable"))
    drawn.append(svg.curve(x, y, "measured"))
    parts = panel.frame()
    for mark in svg.ticks(low, high, most=6):
        at = 100 * (mark - low) / (high - low)
        parts.append(svg.down(at, panel.top, panel.bottom))
        parts.append(svg.text(at, panel.bottom + 16, number(round(mark)), anchor(at)))
    parts.append(svg.text(50, panel.bottom + 31, "Speed of the spindle, rev/min", "tick mid"))
    parts.append(svg.band(panel.top, panel.height, UNITS, drawn))
    for speed, value, bad in sorted(points, key=lambda p: p[2]):
        if speed is None or value is None or not low <= speed <= high:
            continue
        place = f"{100 * (speed - low) / (high - low):.2f}%"
        kind = "point p-failed" if bad else "point p-positive"
        parts.append(svg.tag("circle", cx=place, cy=panel.y(value), r=4.5, class_=kind))
    return svg.figure(parts, height=panel.bottom + 36, label=label, kind="golden")


BLOCK = "block"
NOTHING = "Nothing is cut: the tool never meets the stock. Look at the stock's place and size."


def write_cut_page(
    program: Program, out: Path, source: Path | None = None, made: Made = UNKNOWN
) -> None:
    """Write the page of a program with its cut; ``source`` is the file that holds it."""
    sources = [source_of(source)] if source is not None else []
    rendered(cut_page(program, sources, sources), out.name, made).write(out)


def cut_page(program: Program, sources: list[Source], moves: list[Source]) -> StandalonePage:
    """Verdict, key figures and sections of a cut, in the order in which they are read.

    ``sources``: files of the cut and of the times; ``moves``: of the moves.
    """
    cut, name, machine = program.cut, program.name, program.summary.machine
    if cut is None:
        raise ValueError(f"{name} has no cut: name its blank, tools and material")
    status, word, sentences = _verdict(cut)
    if doubtful := doubts(program.verdicts):
        status, sentences = "attention" if status == "passed" else status, [*doubtful, *sentences]
    classes = feed_classes([] if program.moves is None else [program.moves])
    sections = [
        verdicts_section(program.verdicts),
        _load_section(name, cut, sources),
        _stability_section(cut, sources),
        time_section(program, classes, sources, moves),
        Section(
            key="cost",
            title="Time, tool life and cost",
            blocks=present(tables.cost_table(cut, sources)),
        ),
        _basis_section(cut, sources),
    ]
    return StandalonePage(
        program=name,
        machine=machine,
        about=f"Cut of {blank_words(cut.stock.text)} in {cut.material.name} on {machine}",
        origin=program.origin,
        status=status,
        word=word,
        sentences=sentences,
        key_figures=_key_figures(cut, program.interval),
        sections=[s for s in sections if s is not None],
        running="Kerf: cut of a part program",
        computed="Computed by Kerf from the program, the stock and the tools named above; nothing "
        "of it was measured in a cut.",
    )


def _verdict(cut: ProgramCut) -> tuple[str, str, list[str]]:
    grave = [warning for warning in cut.warnings if warning.grave]
    unsaid = [f"Not known: {', '.join(one.what for one in cut.not_known)}."] * bool(cut.not_known)
    if not cut.by_tool:
        return "failed", "cuts nothing", [NOTHING]
    if grave:
        return "failed", "beyond its limits", _nearest(cut) + _sentences(grave) + unsaid
    if cut.warnings:
        return "attention", "look first", _nearest(cut) + _sentences(cut.warnings) + unsaid
    if cut.limits.load_N is None:
        given = ["No limit of the load was given."]
        return "unknown", "no limit given", given + _nearest(cut) + unsaid
    within = ["No block passes a limit that is known."]
    return "passed", "within its limits", within + _nearest(cut) + unsaid


def _nearest(cut: ProgramCut) -> list[str]:
    """Block of the greatest utilisation of its limit; nothing where no limit applies."""
    known = [
        (row.used, row.binds, row.line) for row in cut.worst if row.binds and row.used is not None
    ]
    if not known:
        return []
    used, binds, line = max(known, key=lambda one: one[0])
    where = "Furthest beyond its limit" if used > 1 else "Nearest to its limit"
    what = binds if binds == "stability" else f"the {binds.removesuffix(' limit')}"
    guessed = binds == "stability" and not cut.dynamics_measured
    doubt = ", by dynamics that were not measured" if guessed else ""
    return [f"{where} is {what}: {tables.share(used)} in line {line}{doubt}."]


def _sentences(warnings: Iterable[CutWarning]) -> list[str]:
    """Each warning with how many blocks it holds for."""
    return [
        tables.sentence(one.what)
        + ("." if one.blocks is None else f" in {counted(one.blocks, BLOCK)}.")
        for one in warnings
    ]


def _key_figures(cut: ProgramCut, interval: str) -> list[tuple[str, str, str]]:
    total, limit = cut.summary, cut.limits.load_N
    where = [f"line {total.peak_line}"] if total.peak_line is not None else []
    where += [f"limit {number(limit)} N"] if limit is not None else []
    driven, air = total.drive_share, total.air_share
    in_air = "" if air is None else f"{tables.share(air)} of the time at feed in air"
    return [
        ("Peak load", _with_unit(total.peak_load_N, "N"), ", ".join(where)),
        ("Peak power", _with_unit(total.power_kW, "kW"),
         "drive not known" if driven is None else f"{tables.share(driven)} of the drive"),
        ("Removed", _with_unit(total.volume_cm3, "cm³"),
         f"{_with_unit(total.removal_rate_cm3_min, 'cm³/min')} while cutting"),
        ("Program", duration(total.time_s), "; ".join(filter(None, (interval, in_air)))),
        _cost_figure(total.cost or tables.NO_COST, cut.currency or ""),
    ]  # fmt: skip


def _cost_figure(cost: CutCost, currency: str) -> tuple[str, str, str]:
    if cost.sum is None and cost.time is not None:
        return "Cost of the time", _with_unit(cost.time, currency), "tool life is not known"
    return "Cost of the part", _with_unit(cost.sum, currency), ""


def _with_unit(value: float | None, unit: str) -> str:
    return "not known" if value is None else f"{number(value)} {unit}"


def _load_section(program: str, cut: ProgramCut, sources: list[Source]) -> Section | None:
    trace, limit = cut.trace, cut.limits.load_N
    if trace.total_s <= 0 or not np.isfinite(values_of(trace.entry_deg)).any():
        return None
    legend = [*LOAD_LEGEND, *([OVER_LEGEND] if limit is not None else [])]
    load = drawing(
        load_figure(trace, limit, f"Peak load over the time of {program}"),
        "Greatest force on the tool in the plane within a revolution, over the time of the "
        "program, at the highest feed that each block reaches.",
        sources, legend,
    )  # fmt: skip
    engagement = drawing(
        engagement_figure(trace, f"Axial and radial depth, entry and exit of {program}"),
        "Depth along the tool’s axis, depth across the feed, and the arc on which a tooth "
        "is in the material: 0° where up-milling enters, 180° where down-milling leaves.",
        sources, ENGAGEMENT_LEGEND,
    )  # fmt: skip
    return Section(
        key="load",
        title="Load along the path",
        text=[
            "Each column is a stretch of time; lowest and highest values of a column are drawn, so "
            "that no peak is lost.",
            *tables.edge_words(cut.edges),
        ],
        pairs=tables.warnings_pairs(cut.warnings, tables.MOST_SPANS),
        blocks=present(
            load,
            engagement,
            tables.forces_table(cut, sources),
            tables.intervals_table(cut, sources),
            tables.edges_table(cut.edges, sources),
            tables.worst_table(cut, sources),
            tables.axes_table(cut.axes, sources),
        ),
    )


def _stability_section(cut: ProgramCut, sources: list[Source]) -> Section | None:
    lobes, drive = _lobes(cut, sources), _drive(cut, sources)
    unknown = [(f"{tables.sentence(one.what)}: not known", one.why) for one in cut.not_known]
    if lobes is None and drive is None and not unknown:
        return None
    rests = lobes is not None and cut.dynamics
    return Section(
        key="stability",
        title="Stability and drive",
        text=[f"Stability rests on {cut.dynamics}."] if rests else [],
        pairs=unknown,
        blocks=present(lobes, drive),
    )


def _lobes(cut: ProgramCut, sources: list[Source]) -> Figures | None:
    found = []
    for one in cut.lobes:
        picture = lobes_figure(one, f"Stability lobes of {one.label}")
        if picture is None:
            continue
        caption = (
            f"{one.label}: limit of the axial depth over speed for the engagement of line "
            f"{one.line}, {number(one.entry_deg)}° to {number(one.exit_deg)}°, with the blocks "
            "that have it."
        )
        found.append(Figure(svg=picture, caption=caption, sources=sources))
    return Figures(figures=found, legend=LOBES_LEGEND) if found else None


def _drive(cut: ProgramCut, sources: list[Source]) -> Figures | None:
    words = "Cutting power against the drive"
    picture = None if cut.drive is None else drive_figure(cut.drive, words)
    caption = "Cutting power of the blocks against the power that the spindle’s drive has left."
    return drawing(picture, caption, sources, DRIVE_LEGEND, kind="")


def _basis_section(cut: ProgramCut, sources: list[Source]) -> Section:
    left_out = [
        (one.reason, f"{one.rows} moves, the first in {one.first}.") for one in cut.left_out
    ]
    return Section(
        key="basis",
        title="What these numbers rest on",
        text=list(cut.notes),
        pairs=left_out,
        blocks=present(tables.basis_table(cut, sources)),
        closing=True,
    )
