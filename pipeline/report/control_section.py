"""The sections on the control: its parameters, and how well it predicts the time of programs."""

from typing import Any

from pipeline.charts.numbers import counted, fixed, number, quantity, real, signed
from pipeline.charts.sections import Figure, Figures, Section, present
from pipeline.charts.sources import dig, objects_of, rows_of
from pipeline.charts.tables import sources
from pipeline.report.control_tables import (
    control_parameters_table,
    control_runs_table,
    control_sources_table,
)
from pipeline.report.controlled import run_status
from pipeline.report.error_figure import error_figure
from pipeline.report.facts import Facts
from pipeline.report.model_tables import strongest_correlation
from pipeline.report.time_tables import left_out_table, run_types_table, runs_table, types_table

MOST_RUNS = 40  # of the figure; the table has them all
RULES = (
    "Judged are runs that nothing was learnt from and that ran to their end. What the operator "
    "stopped (feed hold, an override at 0) stands in its own column and is no part of the "
    "comparison. An error above 0 says that the prediction is too long. The plain guess is "
    "path length over programmed feed, as if the axes had no mass."
)


def control_section(found: Facts) -> Section | None:
    """What the control does with a program: parameters, runs that they were found from."""
    control = found.control.control
    if control is None:
        return None
    text = [
        "A control cuts a program’s feed wherever the axes cannot follow: at corners, in arcs, in "
        "blocks too short to get up to speed. These are the limits that it was found to keep, and "
        "the times that it takes for what does not move.",
        _found_from(control),
        _undetermined(control),
    ]
    if found.control.validation is None:
        text.append("No run has been held against it yet: there is no control_validation.json.")
    return Section(
        key="control",
        title="The control: what it does with a program",
        text=[words for words in text if words],
        blocks=present(
            control_parameters_table(found), control_runs_table(found), control_sources_table(found)
        ),
    )


def _found_from(control: dict[str, Any]) -> str:
    runs = rows_of(control, "runs", "training")
    if not runs:
        return "The runs that it was found from are not named."
    programs = {str(r.get("program")) for r in runs}
    words = f"Found from {counted(len(runs), 'run')} of {counted(len(programs), 'program')}"
    segments = dig(control, "fit", "segments")
    if isinstance(segments, int):
        words += f", cut into {counted(segments, 'stretch', 'stretches')} between polled lines"
    rmse = real(dig(control, "fit", "rmse_s"))
    if rmse is not None:
        words += f"; the time of a stretch is wrong by {quantity(rmse, 's')} (RMS)"
    condition = real(dig(control, "fit", "condition"))
    if condition is not None:
        words += f", condition of the fit {number(condition, 2)}"
    pair = strongest_correlation(dig(control, "fit"))
    if pair is not None:
        words += f". Told apart worst are {pair[0]} and {pair[1]} (correlation {fixed(pair[2], 2)})"
    return words + "."


def _undetermined(control: dict[str, Any]) -> str:
    parameters = objects_of(control, "parameters")
    lost = [name for name, p in parameters.items() if not p.get("determined")]
    if not lost:
        return ""
    names = ", ".join(lost)
    return f"These runs do not determine {names}: the table says what to record for a number."


def times_section(found: Facts) -> Section | None:
    """Each run's time, measured against predicted, with the plain guess as the baseline."""
    if found.control.validation is None:
        return None
    return Section(
        key="times",
        title="Programs: predicted against measured time",
        text=[_score(found), RULES],
        blocks=present(
            _errors(found),
            runs_table(found),
            types_table(found),
            run_types_table(found),
            left_out_table(found),
        ),
    )


def _score(found: Facts) -> str:
    judged, limit = found.control.judged, found.control.limit
    if not found.control.runs:
        return "No run has been predicted."
    if not judged:
        return (
            "No run could be judged: each was learnt from, was not run to its end, or has no "
            "known error. Record more runs of the same programs; one of each is enough."
        )
    passed = sum(run_status(run, limit) == "passed" for run in judged)
    worst = max(judged, key=lambda r: abs(r["error_percent"]))
    return (
        f"{passed} of {counted(len(judged), 'judged run')} lie within ±{fixed(limit, 0)} %; the "
        f"worst is {worst.get('run')} with {signed(worst['error_percent'])} %."
    )


def _errors(found: Facts) -> Figures | None:
    runs = [r for r in found.control.runs if real(r.get("error_percent")) is not None][:MOST_RUNS]
    if not runs:
        return None
    limit = found.control.limit
    judged = len(found.control.judged)
    label = (
        f"Error of the predicted time of {counted(len(runs), 'run')}, {judged} of them judged, "
        f"against the limit of ±{fixed(limit, 0)} % and against the plain guess"
    )
    legend = [("p-passed", "predicted, within the limit", "dot"),
              ("p-failed", "predicted, beyond it", "dot"),
              ("p-learnt", "learnt from or not judged", "dot"),
              ("p-naive", "plain guess, path length over feed", "dot"),
              ("s-limits", f"±{fixed(limit, 0)} %", "box")]  # fmt: skip
    path = found.folders.models / "control_validation.json"
    return Figures(
        kind="one",
        legend=legend if limit is not None else legend[:-1],
        figures=[Figure(svg=error_figure(runs, limit, label), sources=sources(found.shelf, path),
                        caption="Error of the predicted time, run by run, in percent.")],
    )  # fmt: skip
