"""Assessment on a page: scores by group with n and interval, methods, conditions, provenance."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import tick_words
from pipeline.charts.numbers import (
    between,
    day_words,
    joined,
    number,
    powers,
    range_words,
    relative,
    signed,
)
from pipeline.charts.numbers import unit_words as unit_of
from pipeline.charts.sections import Figures, drawing
from pipeline.charts.sources import Source
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Column,
    Table,
    code,
    lettered,
    marks_note,
    tabulated,
)
from pipeline.schema.model import LeftOut, Model
from pipeline.schema.verdict import (
    Canary,
    Fact,
    JudgedCase,
    NextRecording,
    OutsideConditions,
    Role,
    Score,
    Verdict,
)
from pipeline.schema.verdict import Figures as Errors

if TYPE_CHECKING:
    import pandas as pd

ROLES: Mapping[Role, str] = {
    "training": "fitted on", "held_out": "held out", "golden": "golden", "sealed": "sealed",
}  # fmt: skip
"""Role of a case, in a table."""
HEADS = {
    "mae": "MAE", "rmse": "RMSE", "max": "largest error", "bias": "bias",
    "relative_percent": "relative RMSE", "max_percent": "relative largest error",
    "peak_percent": "error of the peak", "mean_percent": "error of the mean",
}  # fmt: skip
"""Errors in the heads of tables."""
SIGNED = ("bias", "peak_percent", "mean_percent")
"""Errors with a sign."""
MANY = 40
"""Rows above which a table of scores is folded [1]."""
MOST_BASELINES = 3
"""Baselines of a table above which the plain baseline alone is shown [1]."""
MOST_COLUMNS = 12
"""Conditions and facts above which they share two columns of words [1]."""
MOST_TASKS = 3
"""Tasks above which what serves is counted instead of named [1]."""
ROW, LONGEST, REACH = 22, 24, 2.5
"""Height of a row [px], letters of a name beside it, limits that the scale reaches at most."""


def case_words(group: str) -> str:
    """A group of records as people name it: a day, or a file without folder and ending.

    >>> case_words("growth/profile-18.csv"), case_words("T1"), case_words("all")
    ('profile-18', 'T1', 'all of them')
    """
    if group == "all":
        return "all of them"
    day = day_words(group, year=True)
    if day != group:
        return day
    name = group.rpartition("/")[2]
    stem, dot, ending = name.rpartition(".")
    return stem if dot and ending.isalnum() else name


def error_words(score: Score, name: str) -> str:
    """An error of a score with half of its interval over trainings, as a table shows it."""
    return _spread(getattr(score, name), score.spread.get(name), name)


def _spread(value: float | None, spread: float | None = None, name: str = "") -> str:
    if value is None:
        return "–"
    if name.endswith("percent"):
        return relative(value, signed if name in SIGNED else number)
    return f"{number(value)} ± {number(spread, 2)}" if spread else number(value)


def quantity_words(score: Score) -> str:
    """Quantity and regime of a score as people read them."""
    name = score.quantity.replace("_", " ")
    return f"{name}, {score.regime.replace('_', ' ')}" if score.regime else name


def unit_words(unit: str) -> str:
    """Unit of a quantity as it is printed; empty for none."""
    return "" if unit == "1" else powers(unit_of(unit))


def scores_table(
    caption: str, scores: Sequence[Score], made: Sequence[Source], *,
    case: str = "day, recording or run", titles: Mapping[str, str] | None = None,
    guess: str = "", folded: bool = False,
) -> Table | None:  # fmt: skip
    """Errors of each quantity by group, beside every baseline and limit, with the verdict.

    ``titles`` are names of the baselines; of many only the plain ``guess`` is shown.
    """
    shown = [s for s in scores if s.n]
    shown.sort(key=lambda s: (s.role == "training", s.group != "all", s.status != "failed"))
    if not shown:
        return None
    limited = list(dict.fromkeys(name for s in shown for name in s.limits))
    errors = [name for name in HEADS if name in ("mae", "rmse", "max") or name in limited]
    unit = list({unit_words(s.unit) for s in shown})
    marks = lettered(s.unknown_interval for s in shown)
    columns: list[Column[Score]] = [
        Column(case[:1].upper() + case[1:], lambda s: case_words(s.group)),
        Column("used", lambda s: ROLES[s.role]),
        Column("n", lambda s: number(s.n), ""),
        *(_error_column(name, unit[0] if len(unit) == 1 else "") for name in errors),
    ]
    if len({(s.quantity, s.regime) for s in shown}) > 1:
        columns.insert(0, Column("Quantity", quantity_words))
    if len(unit) > 1:
        columns.append(Column("unit", lambda s: unit_words(s.unit) or "–"))
    if any(s.coverage_90 is not None for s in shown):
        width = partial(_width, marks=marks)
        columns += [Column("inside 90 % interval", _inside, "%"),
                    Column("its half width over RMSE", width, "")]  # fmt: skip
    columns += _baseline_columns(shown, limited or ["rmse"], titles or {}, guess)
    each = {(s.quantity, s.regime) for s in shown if s.limits and s.group != "all"}
    if any(s.status != "not judged" for s in shown):
        columns.append(Column("verdict", partial(_verdict, each=each)))
    if any(s.reasons for s in shown):
        columns.append(Column("why", _why))
    note = f"{_limits(shown, case)} {marks_note(marks)}".strip()
    return tabulated(caption, shown, columns, made, most=MOST_ROWS, note=note,
                     folded=folded or len(shown) > MANY)  # fmt: skip


def _verdict(s: Score, each: Collection[tuple[str, str]]) -> str | Cell:
    """Verdict; with what all together were held against where limits hold for each."""
    status = {"passed": "passed", "failed": "failed"}.get(s.status, "unknown")
    beside = s.group == "all" and not s.limits and (s.quantity, s.regime) in each
    held = "baselines" if s.coverage_limits is None else "baselines, interval"
    text = f"{s.status} ({held})" if beside and s.status == "passed" else s.status
    return "–" if s.status == "not judged" else Cell(text=text, status=status)


def _why(s: Score) -> str:
    return "; ".join(one.removeprefix(f"{s.group}: ") for one in s.reasons) or "–"


def _baseline_columns(
    scores: Sequence[Score], errors: Sequence[str], titles: Mapping[str, str], guess: str
) -> list[Column[Score]]:
    """Errors of every baseline; in one group of columns where each quantity has but one."""
    others = list(dict.fromkeys(name for s in scores for name in s.others))
    if len(others) > MOST_BASELINES:
        others = [guess] if guess in others else others[:MOST_BASELINES]
    groups = {titles.get(name, name.replace("_", " ")): [name] for name in others}
    if len(others) > 1 and all(len(s.others) < 2 for s in scores):
        groups = {", or ".join(groups): others}

    def shown(s: Score, names: list[str], error: str) -> str:
        found = next((s.others[name] for name in names if name in s.others), Errors())
        return _spread(getattr(found, error), name=error)

    return [
        Column(HEADS[error], partial(shown, names=names, error=error),
               "%" if error.endswith("percent") else "", group=title)
        for title, names in groups.items() for error in errors
    ]  # fmt: skip


def _error_column(name: str, unit: str) -> Column[Score]:
    unit = "%" if name.endswith("percent") else unit
    return Column(HEADS[name], lambda s: error_words(s, name), unit)


def _limits(scores: Sequence[Score], case: str) -> str:
    """Limits of each quantity, those that are alike together, and of each ``case`` or of all."""
    found: dict[str, list[str]] = {}
    for s in scores:
        said = [
            f"{HEADS[name]} {limit:g} "
            f"{'%' if name.endswith('percent') else unit_words(s.unit)}".rstrip()
            for name, limit in s.limits.items()
        ]
        if said and s.group != "all":
            said = [f"{', '.join(said)} of each {case}"]
        if s.coverage_limits is not None:
            low, high = (f"{100 * end:g}" for end in s.coverage_limits)
            said.append(f"{low} to {high} % inside the 90 % interval")
        if said:
            found.setdefault(", ".join(said), []).append(quantity_words(s))
    words = [f"{', '.join(dict.fromkeys(of))}: {limits}" for limits, of in found.items()]
    return f"Limits of {'; '.join(words)}." if words else ""


def _inside(s: Score) -> str:
    if s.unknown_interval:
        return "–"
    shares = [None if share is None else 100 * share
              for share in (s.coverage_90, s.spread.get("coverage_90"))]  # fmt: skip
    return _spread(shares[0], shares[1])


def _width(s: Score, marks: Mapping[str, str]) -> str:
    if s.unknown_interval:
        return f"not known {marks.get(s.unknown_interval, s.unknown_interval)}"
    return _spread(s.half_width_over_rmse)


# ---- errors at a glance


def errors_figure(
    scores: Sequence[Score], error: str, titles: Mapping[str, str], made: Sequence[Source]
) -> Figures | None:
    """A point for the error of each group and one for its best baseline; the limit as an area."""
    shown = [s for s in scores if s.group != "all" and getattr(s, error) is not None]
    if len(shown) < 2:
        return None
    unit = "%" if error.endswith("percent") else unit_words(shown[0].unit)
    limit = next((s.limits[error] for s in shown if error in s.limits), None)
    error_of = f"{HEADS[error][:1].upper()}{HEADS[error][1:]}"
    caption = f"{error_of} of {quantity_words(shown[0])} by group, and of the best baseline"
    legend = [("p-passed", "model", "dot"), ("p-failed", "beyond its limit", "dot"),
              ("p-learnt", "fitted on or not judged", "dot"),
              ("p-naive", "best baseline", "dot")]  # fmt: skip
    if limit is not None:
        legend.append(("s-limits", f"up to the limit, {limit:g} {unit}".rstrip(), "box"))
    drawn = _errors(shown[:40], error, limit, f"{caption}.", unit, titles)
    return drawing(drawn, f"{caption}.", made, legend, kind="one")


def _errors(
    scores: Sequence[Score], error: str, limit: float | None, label: str, unit: str,
    titles: Mapping[str, str],
) -> Markup:  # fmt: skip
    size = [abs(getattr(s, error)) for s in scores]
    most = 1.1 * max([*size, limit or 0.0]) or 1.0
    if limit:
        most = min(most, max(REACH * limit, 1.1 * sorted(size)[len(size) // 2]))
    bottom = 6 + ROW * len(scores)
    parts = [svg.bar(0, 100 * min(limit / most, 1.0), 6, bottom - 6, "s-limits")] if limit else []
    for mark in svg.ticks(0.0, most, most=6):
        x, words = 100 * mark / most, f"{tick_words(mark)} {unit}".rstrip()
        parts += [svg.down(x, 6, bottom), svg.text(x, bottom + 16, words, svg.anchor(x))]
    for row, s in enumerate(scores):
        y = 6 + ROW * (row + 0.5)
        words = case_words(s.group)
        words = words if len(words) <= LONGEST else f"…{words[1 - LONGEST :]}"
        parts.append(svg.text(0, y + 4, words, "name end", dx=-8))
        best = min(((abs(value), titles.get(name, name.replace("_", " ")))
                    for name, other in s.others.items()
                    if (value := getattr(other, error)) is not None), default=None)  # fmt: skip
        kind = {"passed": "p-passed", "failed": "p-failed"}.get(s.status, "p-learnt")
        for value, css, said in (*([(best[0], "p-naive", best[1])] if best else []),
                                 (size[row], kind, "model")):  # fmt: skip
            if value > most:
                parts.append(svg.text(100, y + 4, "▸", "tick end"))
                continue
            parts.append(svg.tag(
                "circle", svg.tag("title", f"{said}: {number(value)} {unit}".rstrip()),
                cx=f"{100 * value / most:.2f}%", cy=y, r=3.5 if css == "p-naive" else 5.0,
                class_=f"point {css}",
            ))  # fmt: skip
        parts.append(svg.text(100, y + 4, relative(size[row], number, unit) if unit == "%" else
                              f"{number(size[row])} {unit}".rstrip(), "tick", dx=8))  # fmt: skip
    return svg.figure(parts, height=bottom + 24, label=label, kind="runs")


# ---- methods


@dataclass(frozen=True, kw_only=True)
class Tried:
    """A method, or a form of the model, that was tried: its error where it was chosen."""

    task: str = ""
    """Axis, use or task; empty where there is one only."""
    label: str
    """Method in words."""
    error: float | None
    """Error by which it was chosen."""
    unit: str = ""
    """Unit of the error."""
    spread: float | None = None
    """Standard deviation of it over trainings; None where nothing was trained again."""
    evaluations: int | None = None
    """Evaluations that it took [1]."""
    serves: bool = False
    """Whether it was chosen."""
    later: Errors | None = None
    """Its errors on the records that decide."""


def tried_table(
    caption: str, tried: Sequence[Tried], made: Sequence[Source], where: str
) -> Table | None:
    """Table of all that was tried, least error first by task; ``where``: records of the error."""
    order = list(dict.fromkeys(one.task for one in tried))
    rows = sorted(tried, key=lambda one: (order.index(one.task), one.error is None, one.error or 0))
    later = any(one.later is not None for one in rows)
    columns: list[Column[Tried]] = [
        Column("Method", lambda one: one.label + " (serves)" * one.serves),
        Column("error", lambda one: _spread(one.error, one.spread), "", group=where),
        Column("unit", lambda one: one.unit or "–"),
    ]
    if order != [""]:
        columns.insert(0, Column("Of", lambda one: one.task))
    if later:
        columns[-1:-1] = [
            Column(head, partial(_later, name=name), "", group="records that decide")
            for name, head in (("rmse", "RMSE"), ("max", "largest"))
        ]
    if any(one.evaluations for one in rows):
        columns.append(Column(
            "evaluations", lambda one: number(one.evaluations) if one.evaluations else "–", ""
        ))  # fmt: skip
    return tabulated(caption, rows, columns, made)


def _later(one: Tried, name: str) -> str:
    return _spread(getattr(one.later or Errors(), name))


def chosen_words(tried: Sequence[Tried], where: str) -> str:
    """Champion of each task, and a better method on the test records, if there is one."""
    tasks = list(dict.fromkeys(one.task for one in tried))
    if len(tasks) > MOST_TASKS:
        kept = Counter(one.label for one in tried if one.serves)
        said = [f"{label} serves in {number(count)}" for label, count in kept.most_common()]
        return f"Of {len(tasks)} tasks {joined(said)}." if said else ""
    said = []
    for task in tasks:
        some = [one for one in tried if one.task == task]
        own = next((one for one in some if one.serves), None)
        if own is None or len(some) < 2:
            continue
        least = min(some, key=lambda one: np.inf if one.error is None else one.error)
        words = f"{f'{task[:1].upper()}{task[1:]}: ' if task else ''}{own.label} serves"
        words += f", of {len(some)} " + (
            f"it errs least {where}" if least is own else f"{least.label} errs least {where}"
        )
        known = [(one.later.rmse, one) for one in some
                 if one.later is not None and one.later.rmse is not None]  # fmt: skip
        best = min(known, key=lambda pair: pair[0], default=None)
        if best is not None and best[1] is not own and own.later is not None:
            words += (
                f"; on the records that decide {best[1].label} does better, RMSE {number(best[0])} "
                f"against {number(own.later.rmse)} {own.unit}"
            )
        said.append(f"{words[:1].upper()}{words[1:].rstrip()}.")
    return " ".join(said)


# ---- cases, and where everything comes from


def cases_table(verdict: Verdict, made: Sequence[Source], facts: Sequence[str]) -> Table | None:
    """Cases with their conditions and those facts, given by name or by what their name begins with.

    Many of them share a column of words each.
    """
    cases = [c for c in verdict.cases if c.conditions or c.facts]
    conditions = list(dict.fromkeys(name for c in cases for name in c.conditions))
    known = [n for n in dict.fromkeys(name for c in cases for name in c.facts)
             if n.startswith(tuple(facts))]  # fmt: skip
    columns: list[Column[JudgedCase]] = [
        Column("Record", lambda c: code(c.case)), Column("used", lambda c: ROLES[c.role]),
    ]  # fmt: skip
    if not cases or not (conditions or known):
        return None
    parts = [(of, names) for of, names in (("conditions", conditions), ("facts", known)) if names]
    if len(conditions) + len(known) <= MOST_COLUMNS:
        columns += [_fact_column(name, cases, of) for of, names in parts for name in names]
    else:
        columns += [Column(of, partial(_facts, of=of, names=names)) for of, names in parts]
    marks = lettered(c.note for c in cases[:MOST_ROWS])
    if marks:
        columns.append(Column("note", lambda c: marks.get(c.note, c.note) or "–"))
    return tabulated(f"Records, their conditions and facts ({len(cases)})", cases, columns, made,
                     most=MOST_ROWS, folded=len(cases) > 12, note=marks_note(marks))  # fmt: skip


def _fact_column(name: str, cases: Sequence[JudgedCase], of: str) -> Column[JudgedCase]:
    every = [getattr(c, of)[name] for c in cases if name in getattr(c, of)]
    words = any(isinstance(one.value, str) for one in every)
    unit = "" if words else unit_words(next((one.unit for one in every), ""))

    def shown(case: JudgedCase) -> str:
        one = getattr(case, of).get(name)
        return "–" if one is None else _value(one)

    return Column(name.replace("_", " "), shown, None if words else unit)


def _value(one: Fact) -> str:
    if one.value is None:
        return "–"
    if isinstance(one.value, str):
        return one.value
    return relative(one.value, number) if one.unit == "%" else number(one.value)


def _facts(case: JudgedCase, of: str, names: Sequence[str]) -> str:
    some: Mapping[str, Fact] = getattr(case, of)
    return "; ".join(
        f"{name.replace('_', ' ')} {_value(some[name])} {unit_words(some[name].unit)}".rstrip()
        for name in names if name in some
    ) or "–"  # fmt: skip


Single = tuple[str, str, str, float, float, float, float]
"""Quantity, record, unit; measured, predicted, low and high end of the interval."""
SINGLES: tuple[Column[Single], ...] = (
    Column("Quantity", lambda row: row[0]), Column("record", lambda row: code(row[1])),
    Column("measured", lambda row: number(row[3]), ""),
    Column("predicted", lambda row: number(row[4]), ""),
    Column("90 % interval", lambda row: between(row[5], row[6]) if row[5] == row[5] else "–", ""),
    Column("unit", lambda row: row[2] or "–"),
    Column("error", lambda row: relative(100 * (row[4] / row[3] - 1) if row[3] else None, signed),
           "%"),
    Column("measured is", lambda row: "–" if row[5] != row[5] else
           Cell(text="inside", status="passed") if row[5] <= row[3] <= row[6] else
           Cell(text="outside", status="failed")),
)  # fmt: skip


def singles_table(predictions: "pd.DataFrame | None", made: Sequence[Source]) -> Table | None:
    """Quantities of which a record has a single value: measured, predicted, with the interval."""
    if predictions is None or not len(predictions):
        return None
    known = predictions[predictions["measured"].notna() & predictions["predicted"].notna()]
    many = known.groupby(["case", "quantity", "regime"])["t"].transform("size")
    names = ["quantity", "regime", "case", "unit", "measured", "predicted", "low", "high"]
    alone = known[many == 1].sort_values(["quantity", "regime", "case"]).reindex(columns=names)
    rows: list[Single] = [
        (f"{quantity}, {regime}" if regime else quantity, case, unit_words(unit), *values)
        for quantity, regime, case, unit, *values in zip(
            *(alone[name].tolist() for name in names), strict=True
        )
    ]
    inside = [row[5] <= row[3] <= row[6] for row in rows if row[5] == row[5]]
    held = f"; {sum(inside)} of {len(inside)} intervals hold the measured one" if inside else ""
    return tabulated(f"Single values ({len(rows)}){held}", rows, SINGLES, made, most=MOST_ROWS,
                     folded=len(rows) > 12)  # fmt: skip


OUTSIDE: tuple[Column[OutsideConditions], ...] = (
    Column("Case", lambda one: code(one.case)),
    Column("condition", lambda one: one.condition.replace("_", " ")),
    Column("value", lambda one: one.value if isinstance(one.value, str) else number(one.value)),
    Column("range of training", lambda one: range_words(one.learnt)),
    Column("unit", lambda one: unit_words(one.unit)),
)


def outside_table(verdict: Verdict, made: Sequence[Source]) -> Table | None:
    """Cases under conditions that the model was not fitted on."""
    return tabulated("Outside of the conditions of training", verdict.outside, OUTSIDE, made,
                     most=MOST_ROWS, folded=len(verdict.outside) > 10)  # fmt: skip


LEFT: tuple[Column[LeftOut], ...] = (
    Column("Record", lambda one: code(one.case)),
    Column("why", lambda one: one.reason),
)


def left_out_table(verdict: Verdict, made: Sequence[Source]) -> Table | None:
    """Records that could not be compared, and why."""
    scored = {s.group for s in verdict.scores}
    rows = [*verdict.left_out, *(
        LeftOut(case=one.case, reason=one.note) for one in verdict.cases
        if one.note and one.group not in scored
    )]  # fmt: skip
    return tabulated(f"Records that were not compared ({number(len(rows))}), and why", rows, LEFT,
                     made, most=MOST_ROWS, folded=len(rows) > 10)  # fmt: skip


CANARIES: tuple[Column[Canary], ...] = (
    Column("Check", lambda c: c.name), Column("result", lambda c: c.status),
    Column("figures", lambda c: c.words),
)  # fmt: skip


def canaries_table(verdict: Verdict, made: Sequence[Source]) -> Table | None:
    """Checks of whether the model has seen what it predicts."""
    caption = "Checks of whether the model has seen what it predicts"
    return tabulated(caption, verdict.canaries, CANARIES, made, most=MOST_ROWS, folded=True)


def training_table(model: Model, made: Sequence[Source]) -> Table | None:
    """Files by hash that the model was fitted on, and records left out with the reason."""
    rows = [(case.case, "fitted on", code(one.file), one.sha256)
            for case in model.trained_on for one in case.files]  # fmt: skip
    caption = (
        f"Files that it was fitted on ({number(len(rows))}), and records left out "
        f"({number(len(model.left_out))})"
    )
    every: list[tuple[str, str, str | Cell, str]] = [
        *rows, *((one.case, "left out", one.reason, "–") for one in model.left_out)
    ]  # fmt: skip
    columns: tuple[Column[tuple[str, str, str | Cell, str]], ...] = (
        Column("Case", lambda row: code(row[0])), Column("use", lambda row: row[1]),
        Column("file, or why not", lambda row: row[2]), Column("sha256", lambda row: code(row[3])),
    )  # fmt: skip
    return tabulated(caption, every, columns, made, most=MOST_ROWS, folded=True)


def gain_words(one: NextRecording) -> str:
    """Interval that a recording narrows, half of it now and after, and how that was computed."""
    unit = "" if one.unit == "1" else f" {unit_of(one.unit)}"
    now = "not determined now" if one.now is None else f"± {number(one.now)}{unit} now"
    after = "" if one.expected is None else f", ± {number(one.expected)}{unit} after it"
    gain = "" if one.gain_percent is None else f" ({one.gain_percent:g} % narrower)"
    if not one.noticed:
        gain = f" ({one.gain_percent:g} %, it varies by chance by {one.uncertain_percent:g} %)"
    return f"{one.interval}: {now}{after}{gain}, by {one.method}"


def next_table(some: Sequence[NextRecording], made: list[Source]) -> Table | None:
    """What to record next: the recordings of the greatest gain."""
    columns: tuple[Column[NextRecording], ...] = (
        Column("Record", lambda one: one.proposal),
        Column("time", lambda one: "–" if one.minutes is None else f"{one.minutes:g}", "min"),
        Column("it narrows", gain_words),
    )
    return tabulated("What to record next", some, columns, made)
