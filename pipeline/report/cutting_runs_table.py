"""Recordings against the force model: errors of each, and of each component beside the guess."""

from pipeline.charts.numbers import NOT_KNOWN, TOGETHER, fixed, number, real, signed
from pipeline.charts.sources import Source, dig
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
from pipeline.report.cutting_facts import ERRORS, CutRun, Cutting
from pipeline.report.cutting_tables import USES, condition_cells, condition_heads
from pipeline.report.facts import Facts

ALL_OTHERS = 2  # recordings of a fit that are counted where they are all the others
OPEN = 12  # rows of components that need not be unfolded
NOTE = (
    "Errors of the resultant force in the plane of the feed, over one mean revolution: RMS of "
    "modelled less measured force as a share of the measured RMS force; of the largest and of the "
    "mean force."
)
Limits = dict[str, float | None]
"""Largest error that passes [%], by kind."""

OTHER = "Where no resultant is known, the component that errs most stands for it."


def prediction_sources(found: Facts) -> list[Source]:
    """The file that the judgement stands in."""
    return sources(found.shelf, found.folders.models / "cutting_validation.json")


def limits_words(cutting: Cutting) -> str:
    """The limits in a sentence's part; empty without any."""
    said = [
        f"{kind if kind != 'rms' else 'RMS'} {limit:g}{TOGETHER}%"
        for kind in ERRORS if (limit := cutting.limit(kind)) is not None
    ]  # fmt: skip
    return f" (limits: {', '.join(said)})" if said else ""


def cut_runs_table(found: Facts) -> Table | None:
    """Every recording as the model's own parameters predict it, the judged first."""
    caption = f"Measured forces against predicted ones{limits_words(found.cutting)}"
    return _runs_table(found, found.cutting.runs, caption)


def cross_table(found: Facts) -> Table | None:
    """Every recording as a fit on other recordings predicts it."""
    caption = "Each recording predicted by a fit on others"
    return _runs_table(found, found.cutting.cross, caption, cross=True)


def _runs_table(
    found: Facts, runs: list[CutRun], caption: str, *, cross: bool = False
) -> Table | None:  # fmt: skip
    if not runs:
        return None
    limits = {kind: found.cutting.limit(kind) for kind in ERRORS}
    why = any(_why(run, limits) for run in runs)
    alone = any(run.size("rms", "mechanics") not in (None, run.size("rms")) for run in runs)
    whole = all(run.whole in ("resultant", "") for run in runs)
    return Table(
        caption=f"{caption}{left_out(len(runs), MOST_ROWS)}",
        note="" if cross else NOTE if whole else f"{NOTE} {OTHER}",
        heads=[
            *names("Recording", *(["fitted on"] if cross else [])), *condition_heads(),
            *numbers(("model", "%"), *([("mechanics alone", "%")] if alone else []),
                     ("plain guess", "%"), group="RMS error"),
            *numbers(("model", "%"), ("plain guess", "%"), group="Peak error"),
            *numbers(("model", "%"), ("plain guess", "%"), group="Mean error"),
            Head(name="verdict"), *names(*(["why"] if why else [])),
        ],
        rows=[
            _run_row(run, limits, _fitted_on(run, found.cutting) if cross else None, alone, why)
            for run in runs[:MOST_ROWS]
        ],
        sources=prediction_sources(found),
        folded=len(runs) > 40,
    )  # fmt: skip


def _run_row(
    run: CutRun, limits: Limits, fitted_on: str | None, alone: bool, why: bool
) -> list[Cell]:  # fmt: skip
    return cells(
        Cell(text=run.recording or NOT_KNOWN, code=True),
        *([fitted_on] if fitted_on is not None else []),
        *condition_cells(run.conditions),
        _marked(_or_void(run.size("rms")), run, "rms", limits),
        *([_or_void(run.size("rms", "mechanics"))] if alone else []),
        _or_void(run.size("rms", "plain")),
        *(
            cell
            for kind in ("peak", "mean")
            for cell in (
                _marked(_signed(run.error(kind, run.whole)), run, kind, limits),
                _signed(run.error(kind, run.whole, "plain")),
            )
        ),
        _verdict(run),
        *([_why(run, limits) or "–"] if why else []),
    )


def _fitted_on(run: CutRun, cutting: Cutting) -> str:
    """Recordings that the fit was made on; their number where they are all the others."""
    others = {r.recording for r in cutting.runs if r.role == "training"} - {run.recording}
    if len(others) >= ALL_OTHERS and set(run.fitted_on) == others:
        return f"the {len(others)} others learnt from"
    return ", ".join(run.fitted_on) or NOT_KNOWN


def _beyond(run: CutRun, kind: str, limits: Limits) -> bool:
    error, limit = run.size(kind), limits.get(kind)
    return not run.learnt and error is not None and limit is not None and error > limit


def _marked(words: str, run: CutRun, kind: str, limits: Limits) -> Cell:
    """An error, marked where it is beyond its limit."""
    return Cell(text=words, status="failed" if _beyond(run, kind, limits) else "")


def _why(run: CutRun, limits: Limits) -> str:
    """Why it failed or was not judged, unless the marks beside it say so already."""
    marked = any(_beyond(run, kind, limits) for kind in ERRORS)
    return "" if run.learnt or marked else run.reason


def _or_void(value: float | None) -> str:
    return "–" if value is None else fixed(value, 1)


def _signed(value: float | None) -> str:
    return "–" if value is None else signed(value)


def _verdict(run: CutRun) -> Cell:
    if run.learnt:
        return Cell(text=USES["training"], status="unknown")
    return Cell(text="not judged" if run.status == "unknown" else run.status, status=run.status)


def components_table(found: Facts) -> Table | None:
    """Each component of each recording: forces measured and modelled, errors, plain guess."""
    cutting = found.cutting
    runs = cutting.runs if cutting.judged or not cutting.cross else cutting.cross
    rows = [_component_row(run, name) for run in runs for name in run.components]
    if not rows:
        return None
    of = ", predicted by a fit on others" if runs[0].fitted_on else ""
    whats = [run.plain_what for run in runs if run.plain_what]
    return Table(
        caption=f"Forces by component{of}, the plain guess beside{left_out(len(rows), MOST_ROWS)}",
        note=f"Plain guess: {whats[0].rstrip('.')}." if whats else "",
        heads=[
            *names("Recording", "force"),
            *numbers(("measured", "N"), ("modelled", "N"), ("error", "%"), ("plain", "%"),
                     group="Peak"),
            *numbers(("measured", "N"), ("modelled", "N"), ("error", "%"), ("plain", "%"),
                     group="Mean"),
            *numbers(("measured", "N"), ("error", "%"), ("plain", "%"), group="RMS"),
            *names("closer"),
        ],
        rows=rows[:MOST_ROWS],
        sources=prediction_sources(found),
        folded=len(rows) > OPEN,
    )  # fmt: skip


def _component_row(run: CutRun, name: str) -> list[Cell]:
    one = run.components[name]
    force = {
        (side, kind): "–" if (x := real(dig(one, side, kind))) is None else number(x)
        for side in ("measured", "modelled") for kind in ERRORS
    }  # fmt: skip
    peak, mean = (
        [force["measured", kind], force["modelled", kind], _signed(run.error(kind, name)),
         _signed(run.error(kind, name, "plain"))]
        for kind in ("peak", "mean")
    )  # fmt: skip
    model, plain = run.error("rms", name), run.error("rms", name, "plain")
    closer = "–" if model is None or plain is None else "plain" if plain < model else "model"
    return cells(
        Cell(text=run.recording or NOT_KNOWN, code=True), name, *peak, *mean,
        force["measured", "rms"], _or_void(model), _or_void(plain), closer,
    )  # fmt: skip
