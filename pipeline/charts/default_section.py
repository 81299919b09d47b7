"""The default section of a sub-model: parameters, scores, worst case, provenance, from its files.

Whatever a sub-model is, its model, verdict and predictions have one shape each; these tables and
figures are made of them.  A sub-model adds what only it can show.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from string import ascii_lowercase
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import between, number, powers, relative, resolved, unit_words
from pipeline.charts.sections import Block, Figure, Figures, present
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Head, Table, cells, left_out, names, numbers
from pipeline.schema.model import Correlation, Model, Parameter, Training
from pipeline.schema.verdict import Role, Score, Verdict

if TYPE_CHECKING:
    import pandas as pd

ROLES: Mapping[Role, str] = {
    "training": "fitted on", "held_out": "held out", "golden": "golden", "sealed": "sealed",
}  # fmt: skip
"""What a case was for, in a table."""
STEPS = 300
"""Stretches of the horizontal axis of a figure, each drawn by its lowest and highest value."""


def meaningless(name: str) -> str:
    """The meaning of a parameter whose name says all."""
    return "–"


def parameters_table(
    caption: str,
    parameters: Mapping[str, Parameter],
    made: Sequence[Source],
    meaning: Callable[[str], str] = meaningless,
) -> Table | None:
    """Parameters with value, interval and unit, and their method or what to record.

    Parameters
    ----------
    caption : str
        Of the table.
    parameters : mapping of str to Parameter
        By name.
    made : sequence of Source
        Files that they stand in.
    meaning : callable
        What the parameter of a name is, for people.
    """
    if not parameters:
        return None
    methods = Counter(p.method for p in parameters.values() if p.determined)
    often = [m for m, count in methods.items() if m and (count > 1 or len(methods) == 1)]
    marks = {
        method: "–" if len(methods) == 1 else f"({letter})"
        for method, letter in zip(often, ascii_lowercase, strict=False)
    }
    return Table(
        caption=caption,
        note=_methods_words(marks),
        heads=[
            *names("Parameter", "means"),
            *numbers(("value", ""), ("95 % interval", "")),
            *names("unit", "method, or what to record"),
        ],
        rows=[_parameter_row(name, p, meaning(name), marks) for name, p in parameters.items()],
        sources=list(made),
    )


def _methods_words(marks: Mapping[str, str]) -> str:
    """The methods, under the marks that stand in the rows."""
    if list(marks.values()) == ["–"]:
        return f"Those with a number were found by {next(iter(marks))}."
    said = "; ".join(f"{mark} {method}" for method, mark in marks.items())
    return f"Methods: {said}." if said else ""


def _parameter_row(name: str, p: Parameter, means: str, marks: Mapping[str, str]) -> list[Cell]:
    low, high = p.interval_95 or (None, None)
    known = p.determined and p.value is not None
    lacking = "; ".join(w for w in (p.method, p.remedy) if w) or "–"
    value = number(p.value, resolved(low, high)) if known else "not determined"
    return cells(
        Cell(text=name, code=True),
        means,
        value if known else Cell(text=value, status="unknown"),
        between(low, high) if known else "–",
        powers(unit_words(p.unit) if p.unit not in ("", "1") else "–"),
        (marks.get(p.method, p.method) or "–") if known else lacking,
    )


def strongest_correlation(correlation: Correlation) -> tuple[str, str, float] | None:
    """The pair of parameters that the records tell apart worst, and their correlation."""
    pairs = [
        (abs(r), correlation.names[i], correlation.names[j], r)
        for i, row in enumerate(correlation.values)
        for j, r in enumerate(row[:i])
        if r is not None
    ]
    return max(pairs)[1:] if pairs else None


def scores_table(
    verdict: Verdict, made: Sequence[Source], *, of: str = "Day, recording or run"
) -> Table | None:
    """Errors of each quantity by group, beside every baseline and limit, with the verdict."""
    scores = [s for s in verdict.scores if s.n]
    if not scores:
        return None
    others = list(dict.fromkeys(name for s in scores for name in s.others))
    heads = [
        *names("Quantity", of, "used"),
        *numbers(("MAE", ""), ("RMSE", ""), ("max", "")),
        *names("unit"),
        *numbers(("RMSE of its RMS", "%")),
    ]
    covered = any(s.coverage_90 is not None for s in scores)
    if covered:
        heads += numbers(("inside 90 % interval", "%"), ("its half width over RMSE", ""))
    heads += [h for name in others for h in numbers(("MAE", ""), ("RMSE", ""), group=name)]
    heads += [Head(name="limits"), Head(name="verdict")]
    return Table(
        caption=f"Errors beside baselines and limits{left_out(len(scores), MOST_ROWS)}",
        note=". ".join(
            dict.fromkeys(
                f"{_named(s)}: {s.unknown_interval}" for s in scores if s.unknown_interval
            )
        ),
        heads=heads,
        rows=[_score_row(s, others, covered) for s in scores[:MOST_ROWS]],
        sources=list(made),
        folded=len(scores) > 30,
    )


def _score_row(s: Score, others: Sequence[str], covered: bool) -> list[Cell]:
    limits = ", ".join(
        f"{name.replace('_percent', '').replace('_', ' ')} {limit:g}"
        f"{' %' if name.endswith('percent') else f' {unit_words(s.unit)}'}"
        for name, limit in s.limits.items()
    )
    if s.coverage_limits is not None:
        least, most = (f"{100 * end:g}" for end in s.coverage_limits)
        limits = f"inside 90 % interval {least} to {most} %"
    beside = [s.baselines.get(name) for name in others]
    errors = [w for b in beside for w in ((_error(b.mae), _error(b.rmse)) if b else ("–", "–"))]
    status = {"passed": "passed", "failed": "failed"}.get(s.status, "unknown")
    return cells(
        _named(s),
        "all of them" if s.group == "all" else s.group,
        ROLES[s.role],
        *(_error(getattr(s, name), s.spread.get(name)) for name in ("mae", "rmse", "max")),
        powers(unit_words(s.unit)),
        relative(s.relative_percent, lambda share: _error(share, s.spread.get("relative_percent"))),
        *(_interval(s) if covered else []),
        *errors,
        limits or "–",
        Cell(text=s.status, status=status) if s.status != "not judged" else "–",
    )


def _named(s: Score) -> str:
    return f"{s.quantity}, {s.regime}" if s.regime else s.quantity


def _error(value: float | None, spread: float | None = None) -> str:
    if value is None:
        return "–"
    return f"{number(value)} ± {number(spread, 2)}" if spread else number(value)


def _interval(s: Score) -> tuple[str, str]:
    shares = _percents(s.coverage_90, s.spread.get("coverage_90"))
    wide = "not known" if s.unknown_interval else _error(s.half_width_over_rmse)
    return _error(*shares), wide


def _percents(*shares: float | None) -> list[float | None]:
    return [None if share is None else 100 * share for share in shares]


def _listing(
    caption: str, heads: Sequence[str], rows: Sequence[list[Cell]], made: Sequence[Source],
    open_up_to: int = 0,
) -> Table | None:  # fmt: skip
    """A table of words, its first rows; longer ones than ``open_up_to`` rows are folded."""
    if not rows:
        return None
    return Table(
        caption=f"{caption}{left_out(len(rows), MOST_ROWS)}",
        heads=names(*heads),
        rows=list(rows[:MOST_ROWS]),
        sources=list(made),
        folded=len(rows) > open_up_to,
    )


def outside_table(verdict: Verdict, made: Sequence[Source]) -> Table | None:
    """Cases under conditions that the model was not fitted on."""
    rows = [
        cells(Cell(text=one.case, code=True), one.condition,
              one.value if isinstance(one.value, str) else number(one.value), one.learnt,
              powers(unit_words(one.unit)))
        for one in verdict.outside
    ]  # fmt: skip
    heads = ("Case", "condition", "value", "range of training", "unit")
    return _listing("Outside of the conditions of training", heads, rows, made, open_up_to=10)


def training_table(model: Model, made: Sequence[Source]) -> Table | None:
    """Cases that the model was fitted on with their files by hash, and those left out with why."""
    rows = [
        cells(Cell(text=case.case, code=True), "fitted on", Cell(text=one.file, code=True),
              Cell(text=one.sha256, code=True))
        for case in model.trained_on for one in case.files
    ]  # fmt: skip
    caption = (
        f"Files that it was fitted on ({number(len(rows))}), and records left out "
        f"({number(len(model.left_out))})"
    )
    rows += [
        cells(Cell(text=one.case, code=True), "left out", one.reason, "–") for one in model.left_out
    ]
    return _listing(caption, ("Case", "use", "file, or why not", "sha256"), rows, made)


def files_table(trained_on: Sequence[Training], what: str, made: Sequence[Source]) -> Table | None:
    """Raw files by hash that a model was fitted on; ``what`` is the model with its verb."""
    files = {one.file: one.sha256 for case in trained_on for one in case.files}
    rows = [
        cells(Cell(text=file, code=True), Cell(text=sha256, code=True))
        for file, sha256 in sorted(files.items())
    ]
    return _listing(f"Files that {what} fitted on", ("File", "sha256"), rows, made)


def left_out_table(verdict: Verdict, made: Sequence[Source]) -> Table | None:
    """Records that could not be compared, and why."""
    rows = [cells(Cell(text=one.case, code=True), one.reason) for one in verdict.left_out]
    rows += [
        cells(Cell(text=one.case, code=True), one.note)
        for one in verdict.cases
        if one.note and not any(s.group == one.group for s in verdict.scores)
    ]
    caption = f"Records that were not compared ({number(len(rows))}), and why"
    return _listing(caption, ("Record", "why"), rows, made, open_up_to=10)


def typical_and_worst(verdict: Verdict) -> tuple[Score, ...]:
    """The case of median RMSE and the worst, of the first quantity that was judged."""
    decided = [
        s for s in verdict.scores
        if s.limits and s.group != "all" and s.role == verdict.judged_role and s.rmse is not None
    ]  # fmt: skip
    if not decided:
        return ()
    target = (decided[0].quantity, decided[0].regime)
    first = [s for s in decided if (s.quantity, s.regime) == target]
    ranked = sorted(first, key=lambda s: s.rmse or 0.0)
    chosen = [ranked[len(ranked) // 2], ranked[-1]]
    return tuple(chosen[:1] if chosen[0] is chosen[1] else chosen)


def cases_figures(
    verdict: Verdict, predictions: "pd.DataFrame | None", made: Sequence[Source], axis: str = "s"
) -> Figures | None:
    """Measured and predicted over a typical and over the worst judged case."""
    if predictions is None or not len(predictions):
        return None
    chosen = typical_and_worst(verdict)
    drawn = []
    for score in chosen:
        rows = predictions[
            (predictions["group"] == score.group)
            & (predictions["quantity"] == score.quantity)
            & (predictions["regime"] == score.regime)
        ].sort_values("t")
        if len(rows) < 3:
            continue
        words = "Worst case" if score is chosen[-1] and len(chosen) > 1 else "Typical case"
        caption = (
            f"{words}, {score.group}: {score.quantity}, RMSE {_error(score.rmse)} "
            f"{unit_words(score.unit)}, over {axis}."
        )
        drawn.append(Figure(svg=_curves(rows, caption), caption=caption, sources=list(made)))
    if not drawn:
        return None
    legend = [("l-measured", "measured", "line"), ("l-window", "predicted", "line")]
    return Figures(figures=drawn, legend=legend)


def _curves(rows: "pd.DataFrame", label: str) -> Markup:
    """Measured and predicted of one case, one above the other."""
    x = rows["t"].to_numpy(float)
    curves = {
        "measured": rows["measured"].to_numpy(float), "window": rows["predicted"].to_numpy(float)
    }  # fmt: skip
    known = np.concatenate([v[np.isfinite(v)] for v in curves.values()])
    if not len(known):
        return svg.figure([], height=20, label=label)
    low, high = float(known.min()), float(known.max())
    pad = 0.05 * (high - low) or 1.0
    low, high, top, height = low - pad, high + pad, 8.0, 150.0
    first, last = float(x.min()), float(x.max())
    width = 1000
    parts = []
    for mark in svg.ticks(low, high):
        y = top + height * (high - mark) / (high - low)
        words = f"{round(mark, 9) + 0.0:g}".replace("-", "−")
        parts += [svg.across(y), svg.text(0, y + 4, words, "tick end", dx=-6)]
    for mark in svg.ticks(first, last, most=6):
        at = 100 * (mark - first) / (last - first or 1.0)
        parts += [
            svg.down(at, top, top + height),
            svg.text(at, top + height + 16, f"{mark:g}", "mid"),
        ]
    lines = []
    for kind, values in curves.items():
        across, up = svg.thinned(x - first, values, (last - first or 1.0) / STEPS)
        down = svg.FULL * (high - up) / (high - low)
        lines.append(svg.curve(across * width / (last - first or 1.0), down, kind))
    parts.append(svg.band(top, height, width, lines))
    return svg.figure(parts, height=top + height + 24, label=label, kind="golden")


def default_blocks(
    model: Model | None,
    verdict: Verdict | None,
    predictions: "pd.DataFrame | None",
    made: Sequence[Source],
    meaning: Callable[[str], str] = meaningless,
) -> list[Block]:
    """All tables and figures that the three files of a sub-model give by themselves."""
    blocks: list[Block | None] = []
    for group, parameters in ({} if model is None else model.parameters).items():
        caption = f"Parameters of {group}" if group else "Parameters"
        blocks.append(parameters_table(caption, parameters, made, meaning))
    if verdict is not None:
        blocks += [
            cases_figures(verdict, predictions, made),
            scores_table(verdict, made),
            outside_table(verdict, made),
            left_out_table(verdict, made),
        ]
    if model is not None:
        blocks.append(training_table(model, made))
    return present(*blocks)
