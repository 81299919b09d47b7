"""The section that holds predicted forces against records: tables, and single revolutions."""

from pipeline.charts.numbers import NOT_KNOWN, TOGETHER, number
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.tables import sources
from pipeline.report.cutting_facts import ERRORS, CutRun, Cutting, best_run, worst_run
from pipeline.report.cutting_runs_table import components_table, cross_table, cut_runs_table
from pipeline.report.cutting_trace_figure import revolution_figure, spread
from pipeline.report.cutting_traces import CutTrace
from pipeline.report.cutting_verdict import (
    ERROR_WORDS,
    bracketed,
    cutting_verdict,
    recordings_words,
)
from pipeline.report.drive_verdict import joined
from pipeline.report.facts import Facts

STATUS = {"unknown": "not judged", "passed": "passed", "failed": "failed"}
JUDGED = "Judged are recordings that nothing was learnt from."
CROSS = (
    "Every recording was learnt from, so each is also predicted by a fit on the others: a weaker "
    "proof than a recording of another day or another clamping would be."
)


def prediction_section(found: Facts) -> Section | None:
    """Every recording against the model, then the worst and the best predicted revolution."""
    cutting = found.cutting
    if cutting.validation is None:
        return None
    verdict = cutting_verdict(cutting)
    text = [
        verdict.sentence if verdict is not None else "",
        f"{JUDGED if cutting.judged or not cutting.cross else CROSS} The model is told speed, "
        "feed, depth and the tool alone, and what it predicts is laid over the mean revolution "
        "that was measured.",
        _plain_words(cutting),
    ]
    if not cutting.runs and not cutting.cross:
        text.append("No recording was held against the model.")
    return Section(
        key="forces",
        title="How well forces are predicted",
        text=[words for words in text if words],
        blocks=present(cut_runs_table(found), cross_table(found), _revolutions(found),
                       components_table(found)),
    )  # fmt: skip


def _plain_words(cutting: Cutting) -> str:
    """In what the plain guess is closer than the model, or that it is nowhere."""
    compared = [r for r in cutting.telling if r.size("rms", "plain") is not None]
    if not compared:
        return ""
    better = {kind: sum(run.plain_better(kind) for run in compared) for kind in ERRORS}
    closer = [f"in the {ERROR_WORDS[kind]} on {many}" for kind, many in better.items() if many]
    where = f"closer than the model {joined(closer)}" if closer else "nowhere closer than the model"
    return (
        f"Held against {recordings_words(cutting)}, the plain guess"
        f"{bracketed(compared[0].plain_what)} is {where}."
    )


def _revolutions(found: Facts) -> Figures | None:
    """One revolution of the worst and of the best predicted recording."""
    traces = {t.recording: t for t in found.cutting.traces if t.axes}
    runs = [r for r in found.cutting.telling or found.cutting.runs if r.recording in traces]
    worst, best = worst_run(runs), best_run(runs)
    if worst is None or best is None:
        return None
    shown = {worst.recording: (worst, ""), best.recording: (best, "")}
    if len(shown) > 1:
        shown = {
            worst.recording: (worst, "worst predicted"),
            best.recording: (best, "best predicted"),
        }
    return Figures(
        figures=[_figure(found, run, traces[name], rank) for name, (run, rank) in shown.items()],
        legend=_legend([traces[name] for name in shown]),
        kind="" if len(shown) > 1 else "one",
    )


def _figure(found: Facts, told: CutRun, trace: CutTrace, rank: str) -> Figure:
    """The revolution as the model itself has it, which may have learnt from it."""
    run = next((r for r in found.cutting.runs if r.recording == told.recording), told)
    words = _words(run, rank)
    if run is not told and (error := told.size("rms")) is not None:
        words += f"; fitted on other recordings it errs by {number(error, 2)}{TOGETHER}%"
    return Figure(
        svg=revolution_figure(trace, f"{words}."),
        caption=f"{words}.",
        sources=sources(found.shelf, found.folders.models / "cutting_traces.parquet"),
        status=run.status,
        status_words="learnt from" if run.learnt else STATUS[run.status],
    )


def _words(run: CutRun, rank: str) -> str:
    error, plain = run.size("rms"), run.size("rms", "plain")
    words = f"One revolution of {run.recording or NOT_KNOWN}{f', {rank}' if rank else ''}: mean "
    words += "of the measured revolutions, the band of 95 % of them, and the model"
    if error is not None:
        words += f", whose RMS error is {number(error, 2)}{TOGETHER}%"
    return words if plain is None else f"{words} (plain guess {number(plain, 2)}{TOGETHER}%)"


def _legend(traces: list[CutTrace]) -> list[tuple[str, str, str]]:
    def any_of(kind: str) -> bool:
        return any(t.known(kind, axis) is not None for t in traces for axis in t.axes)

    legend = [("l-measured", "measured, mean", "line")]
    if any(spread(t, axis) for t in traces for axis in t.axes):
        legend.append(("s-still", "95 % of the revolutions", "box"))
    legend.append(("l-modelled", "modelled", "line"))
    return [*legend, ("l-free", "plain guess", "line")] if any_of("plain") else legend
