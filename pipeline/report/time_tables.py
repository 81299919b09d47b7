"""Tables of predicted against measured times: run by run, and by type of block."""

from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, duration, fixed, number, percent, real, signed
from pipeline.charts.sources import objects_of, rows_of
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.report.controlled import run_status
from pipeline.report.facts import Facts

TYPES = ("rapid", "feed", "arc", "tool change", "spindle and M codes", "dwell")
"""Types of block in the order shown; others follow by name."""


def runs_table(found: Facts) -> Table | None:
    """Each run: measured, stopped, predicted, guessed, and the verdict on it."""
    runs = found.control.runs
    if not runs:
        return None
    said = any(real(r.get("recorded_override_only_error_percent")) is not None for r in runs)
    heads = [
        *names("Run", "program"),
        *numbers(("lasted", ""), ("stopped", ""), group="Measured"),
        *numbers(("time", ""), ("error", "%"), group="Predicted"),
        *numbers(("time", ""), ("error", "%"), group="Plain guess"),
        *(numbers(("error", "%"), group="Recorded override") if said else []),
        *numbers(("feed read", "")),
        Head(name="verdict"),
    ]
    return Table(
        caption=f"Predicted against measured time, run by run{left_out(len(runs), MOST_ROWS)}",
        note="Feed read: share of the cutting lines whose feed was read from the log’s speeds, as "
        "the override that the log says may not be the one in force."
        + (" Recorded override: the error with what the log says alone." if said else ""),
        heads=heads,
        rows=[_run_row(run, found.control.limit, said) for run in runs[:MOST_ROWS]],
        sources=sources(found.shelf, found.folders.models / "control_validation.json"),
        folded=len(runs) > 30,
    )


def _run_row(run: dict[str, Any], limit: float | None, said: bool) -> list[Cell]:
    status = run_status(run, limit)
    words = {"unknown": _why_not(run)}.get(status, status)
    return cells(
        Cell(text=str(run.get("run") or NOT_KNOWN), code=True),
        Cell(text=str(run.get("program") or NOT_KNOWN), code=True),
        duration(run.get("measured_s")),
        duration(run.get("stops_s")),
        duration(run.get("predicted_s")),
        signed(run.get("error_percent")),
        duration(run.get("naive_s")),
        signed(run.get("naive_error_percent")),
        *([signed(run.get("recorded_override_only_error_percent"))] if said else []),
        percent(real(run.get("feed_read_share")), 1.0),
        Cell(text=words, status=status),
    )


def _why_not(run: dict[str, Any]) -> str:
    if run.get("role") == "training":
        return "learnt from"
    return "not judged" if run.get("completed") is True else "not completed"


def _types(runs: list[dict[str, Any]]) -> list[str]:
    """Types of block that a run spends or is predicted to spend time in."""
    seen = {
        name for run in runs for name, entry in objects_of(run, "by_type").items()
        if real(entry.get("measured_s")) or real(entry.get("predicted_s"))
    }  # fmt: skip
    return [t for t in TYPES if t in seen] + sorted(seen - set(TYPES))


def types_table(found: Facts) -> Table | None:
    """Measured and predicted time of each type of block, over all judged runs."""
    judged = found.control.judged
    runs = judged or found.control.runs
    types = _types(runs)
    if not types:
        return None
    sums = {t: [_sum(runs, t, key) for key in ("measured_s", "predicted_s")] for t in types}
    whole = sum(abs(predicted - measured) for measured, predicted in sums.values())
    over = "the judged runs" if judged else "all runs, none of which is judged"
    return Table(
        caption=f"By type of block, over {over}",
        heads=[
            Head(name="Type of block"),
            *numbers(("measured", ""), ("predicted", ""), ("difference", "s"), ("error", "%")),
            *numbers(("share of all differences", "")),
        ],
        rows=[
            cells(
                name, duration(measured), duration(predicted), signed(predicted - measured),
                signed(100 * (predicted / measured - 1)) if measured > 0 else "–",
                percent(abs(predicted - measured), whole),
            )
            for name, (measured, predicted) in sums.items()
        ],
        sources=sources(found.shelf, found.folders.models / "control_validation.json"),
    )  # fmt: skip


def _sum(runs: list[dict[str, Any]], name: str, key: str) -> float:
    entries = [objects_of(run, "by_type").get(name, {}) for run in runs]
    return sum(real(entry.get(key)) or 0.0 for entry in entries)


def run_types_table(found: Facts) -> Table | None:
    """Measured time and error of each type of block in each run."""
    runs = found.control.runs[:MOST_ROWS]
    types = _types(runs)
    if not types:
        return None
    heads = [Head(name="Run")]
    for name in types:
        heads += numbers(("measured", "s"), ("error", "%"), group=name)
    rows = []
    for run in runs:
        entries = [objects_of(run, "by_type").get(name, {}) for name in types]
        pairs = [(_or_void(e.get("measured_s")), _or_void(e.get("error_percent"), True))
                 for e in entries]  # fmt: skip
        rows.append(cells(str(run.get("run") or NOT_KNOWN), *(w for pair in pairs for w in pair)))
    return Table(
        caption="By type of block, run by run",
        heads=heads,
        rows=rows,
        sources=sources(found.shelf, found.folders.models / "control_validation.json"),
        folded=True,
    )


def _or_void(value: Any, sign: bool = False) -> str:
    if real(value) is None:
        return "–"
    return signed(value) if sign else fixed(value, 1)


def left_out_table(found: Facts) -> Table | None:
    """Runs that could not be judged, and why."""
    rows = [
        cells(Cell(text=str(r.get("run") or NOT_KNOWN), code=True),
              str(r.get("reason") or "no reason is said"))
        for r in rows_of(found.control.validation, "left_out")
    ]  # fmt: skip
    if not rows:
        return None
    return Table(
        caption=f"Runs left out ({number(len(rows))}), and why{left_out(len(rows), MOST_ROWS)}",
        heads=names("Run", "why"),
        rows=rows[:MOST_ROWS],
        sources=sources(found.shelf, found.folders.models / "control_validation.json"),
        folded=len(rows) > 10,
    )
