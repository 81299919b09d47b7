"""The section that holds the twin's drives against records: table, and curves of each axis."""

from pipeline.charts.numbers import NOT_KNOWN, number
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.sources import dig
from pipeline.charts.tables import sources
from pipeline.report.drive_runs_table import drive_runs_table
from pipeline.report.drive_trace_figure import closest_look, drawn_bands, trace_figure, whole
from pipeline.report.drive_traces import DriveTrace
from pipeline.report.drive_verdict import drives_verdict
from pipeline.report.driven import DriveRun
from pipeline.report.facts import Facts


def following_section(found: Facts) -> Section | None:
    """Recordings against the twin: tables, then each axis in its most telling recording."""
    if found.drives.validation is None:
        return None
    verdict = drives_verdict(found.drives)
    text = [
        verdict.sentence if verdict is not None else "",
        "Judged are recordings that nothing was learnt from. The force is rebuilt from the "
        "recorded motion; the following error comes from the twin’s own closed loop, which is told "
        "the reference alone, and the load where one was recorded.",
    ]
    if not found.drives.runs:
        text.append("No axis was held against a recording.")
    axes = sorted({t.axis for t in found.drives.traces})
    drawn = [figures for axis in axes if (figures := _trace_figures(found, axis)) is not None]
    return Section(
        key="following",
        title="The feed drives: records against the twin",
        text=[words for words in text if words],
        blocks=[*present(drive_runs_table(found)), *drawn],
    )


def _trace_figures(found: Facts, axis: str) -> Figures | None:
    trace = found.drives.telling(axis)
    unit = str(dig(found.drives.axes.get(axis), "command_unit") or "")
    bands = drawn_bands(trace, unit) if trace is not None else []
    if trace is None or not bands:
        return None
    run = next(
        (r for r in found.drives.runs if (r.axis, r.recording) == (axis, trace.recording)), None
    )
    status, said = _status(run)
    shown = [(whole(trace), _words(trace, run))]
    close = closest_look(trace)
    if close is not None:
        shown.append((close, f"Axis {axis} in {trace.recording} from {number(close[0])} to "
                             f"{number(close[1])} s, where the twin is farthest off."))  # fmt: skip
    made = sources(found.shelf, found.folders.models / "drive_traces.parquet")
    return Figures(
        figures=[
            Figure(svg=trace_figure(trace, bands, span, words), caption=words, sources=made,
                   status=status, status_words=said)
            for span, words in shown
        ],
        legend=[("l-measured", "measured", "line"), ("l-modelled", "twin", "line")],
    )  # fmt: skip


def _status(run: DriveRun | None) -> tuple[str, str]:
    """Status of a drawn recording and that in words."""
    if run is None:
        return "unknown", "not judged"
    if run.role == "training":
        return "unknown", "learnt from"
    return run.status, "not judged" if run.status == "unknown" else run.status


def _words(trace: DriveTrace, run: DriveRun | None) -> str:
    """Caption of a recording: what it is, and how far the twin is off."""
    words = f"Axis {trace.axis} in {trace.recording or NOT_KNOWN}"
    if run is None:
        return f"{words}."
    errors = [
        f"{name} wrong by {number(error, 2)} %"
        for name, error in (("following error", run.following_error), ("force", run.force_error))
        if error is not None
    ]
    return f"{words}: {', '.join(errors)}." if errors else f"{words}."
