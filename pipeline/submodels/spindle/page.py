"""Page of the spindle temperature: the network's parameters, judged days, the verdict in words."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts import default_section
from pipeline.charts.numbers import (
    counted,
    day_list,
    day_words,
    duration,
    fixed,
    hours,
    number,
    quantity,
)
from pipeline.charts.sections import (
    Compared,
    Figure,
    Figures,
    PartVerdict,
    Section,
    SubModelPage,
    absent,
    present,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import Cell, Head, Table, cells, names, numbers, sources
from pipeline.schema.days import day_start
from pipeline.schema.verdict import Figures as Errors
from pipeline.schema.verdict import Score, Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.spindle import figures
from pipeline.submodels.spindle.days import FREE_RUN, WINDOWS
from pipeline.submodels.spindle.tables import (
    JUDGES,
    coverage_words,
    intervals_table,
    parts_table,
    score_of,
    width_words,
)
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import TARGET, SpindleModelFile

SAMPLE_S = 10.0  # between two rows, where no model says it
MOST_GOLDEN = 14  # days drawn; more days stand in the table only
RATES = ("cooling_rate", "coupling_rate", "body_cooling_rate")
MEANINGS = {
    "bearing_friction": "heat of the bearings, grows with speed to the power 5/3",
    "load_speed": "heat that grows with load times speed",
    "copper": "copper loss, grows with load squared",
    "windage": "air and iron losses, grow with speed squared",
    "position_hold": "heat while the position loop holds the spindle",
    "cooling_rate": "heat exchange with the surround over heat capacity",
    "coupling_rate": "heat exchange of the measured node with the body",
    "body_cooling_rate": "heat exchange of the body with the surround",
    "coolant_rate": "heat exchange with the coolant over heat capacity",
    "capacity_ratio": "heat capacity of the measured node over the body’s",
    "ambient": "temperature of the surround",
    "ambient_offset": "surround of the spindle above the measured ambient",
}
"""Meaning of the thermal network's parameters, for people."""

Seen = Shown[SpindleModelFile]


def page(seen: Seen) -> SubModelPage:
    """Everything that a machine's page says of its spindle's temperature."""
    verdict = seen.verdict
    total, free = score_of(verdict, WINDOWS), score_of(verdict, FREE_RUN)
    limit = _limits(verdict).get("mae")
    heat = [
        ("Error over one hour", _kelvin(total), f"limit {_limit_words(limit)}"),
        ("Error over whole days", _kelvin(free), "judged days, each from its first value"),
    ]
    width = width_words(seen.model)
    if width is not None:
        said = "not known" if total is not None and total.unknown_interval else width
        heat.append(("90 % interval over one hour", said, coverage_words(total)))
    return SubModelPage(
        verdict=_verdict(seen),
        key_figures=heat,
        doubts=_doubts(verdict),
        notes=_notes(seen),
        sections=[_model_section(seen), _judged_section(seen)],
        compared={
            "window_mae_K": _compared("Error over one hour (MAE)", total),
            "free_mae_K": _compared("Error over whole days (MAE)", free),
        },
    )


def _compared(name: str, score: Score | None) -> Compared:
    return Compared(name=name, unit="K", value=None if score is None else score.mae)


def _kelvin(score: Score | None) -> str:
    return "not known" if score is None or score.mae is None else f"{fixed(score.mae, 2)} K"


def _limit_words(limit: float | None) -> str:
    return "not known" if limit is None else f"{fixed(limit, 2)} K"


def _of_days(verdict: Verdict | None, regime: str) -> list[Score]:
    """Scores of the days that decided, in the order of the days."""
    if verdict is None:
        return []
    found = verdict.of(TARGET, role=verdict.judged_role)
    return sorted((s for s in found if s.regime == regime and s.group != "all"),
                  key=lambda s: s.group)  # fmt: skip


def _limits(verdict: Verdict | None) -> dict[str, float]:
    return dict(next((s.limits for s in _of_days(verdict, WINDOWS) if s.limits), {}))


def _beaten(score: Score) -> bool:
    """Whether the guess that the temperature stays was as good, on MAE or on RMSE."""
    other = score.baselines.get("persistence", Errors())
    pairs = ((score.mae, other.mae), (score.rmse, other.rmse))
    return any(own is not None and guess is not None and own >= guess for own, guess in pairs)


def _week(verdict: Verdict) -> str:
    golden = verdict.golden
    if golden is None or not golden.first:
        days = [s.group for s in _of_days(verdict, WINDOWS)]
        return f"{day_words(min(days))} to {day_words(max(days), year=True)}" if days else "none"
    return f"{day_words(golden.first)} to {day_words(golden.last, year=True)}"


def _set_words(verdict: Verdict) -> str:
    return "its golden week" if verdict.judged_role == "golden" else "the days held out of its fit"


def _verdict(seen: Seen) -> PartVerdict | None:
    """Status, sentence and action that the judgement asks for."""
    v = seen.verdict
    if v is None or v.status == "not judged":
        if seen.model is None:
            return None
        why = "; ".join(v.reasons) if v is not None else "there is no verdict.json"
        return PartVerdict(
            status="unknown",
            sentence=f"The spindle’s thermal model has not been judged: {why.rstrip('.')}.",
            todo=f"Freeze a week that no model is fitted on: `kerf golden {seen.machine}`.",
        )
    if v.status == "failed":
        return PartVerdict(
            status="failed",
            sentence=f"The spindle’s thermal model failed {_set_words(v)} ({_week(v)}): "
            f"{_failure(v)}.",
            todo="Do not act on this model’s temperatures, and do not promote it.",
        )
    total, free = score_of(v, WINDOWS), score_of(v, FREE_RUN)
    return PartVerdict(
        status="passed",
        sentence=f"The spindle’s thermal model passed {_set_words(v)} ({_week(v)}): over one hour "
        f"its temperature is wrong by {_kelvin(total)} on average "
        f"(limit {fixed(_limits(v).get('mae'), 1)} K), and over whole days by {_kelvin(free)}.",
        todo="The model may serve.",
    )


def _failure(v: Verdict) -> str:
    """The days on which it failed and by how much; else the judge's own reasons."""
    days = _of_days(v, WINDOWS)
    failed = [s for s in days if s.status == "failed" and s.mae is not None]
    general = [r for r in v.reasons if not any(r in s.reasons for s in days)]
    if general or not failed:
        return "; ".join(general or v.reasons) or "the judge gave no reason"
    worst = max(failed, key=lambda s: s.mae or 0.0)
    return (
        f"it failed on {len(failed)} of {counted(len(days), 'day')}, worst on "
        f"{day_words(worst.group)} with a mean error over one hour of {fixed(worst.mae, 2)} K "
        f"(limit {fixed(_limits(v).get('mae'), 1)} K; {_kelvin(score_of(v, WINDOWS))} over all "
        f"days), since {'; '.join(r.removeprefix(f'{worst.group}: ') for r in worst.reasons)}"
    )


def _doubts(verdict: Verdict | None) -> list[str]:
    """Days on which a model that passed is no better than a plain guess."""
    said = []
    for regime, words in ((WINDOWS, "in one-hour windows"), (FREE_RUN, "over the whole day")):
        beaten = [s.group for s in _of_days(verdict, regime) if _beaten(s)]
        if beaten:
            said.append(
                f"On {day_list(beaten)} the model {words} was no better than the guess that the "
                "temperature stays as it is."
            )
    return said


def _notes(seen: Seen) -> list[str]:
    said = []
    if seen.verdict is not None:
        golden = [c.case for c in seen.verdict.cases if c.role == "golden" and c.note]
        if golden:
            said.append(f"Golden days that are no working days: {day_list(golden)}.")
    lost = [MEANINGS.get(name, name) for name, p in seen.parameters().items() if not p.determined]
    if lost:
        said.append(f"Of the spindle’s heat the records do not determine: {'; '.join(lost)}.")
    return said


def _made(seen: Seen, *files: str) -> list[Source]:
    return sources(seen.shelf, *(seen.folder / file for file in files))


def _model_section(seen: Seen) -> Section:
    """Parameters with intervals, or why there are none."""
    title = "The spindle’s heat: the model"
    if seen.model is None:
        remedy = (
            "It is identified from spindle temperature, speed and load over at least one working "
            "week, best with the ambient temperature."
        )
        text = [absent(seen.folder / "model.json", remedy)]
        return Section(key="thermal", title=title, text=text)
    made = _made(seen, "model.json")
    caption = "Parameters of the spindle’s thermal network"
    return Section(
        key="thermal",
        title=title,
        text=[_found_from(seen), _model_words(seen.model), _forest_words(seen.model)],
        blocks=present(
            default_section.parameters_table(
                caption, seen.parameters(), made, lambda n: MEANINGS.get(n, "–")
            ),
            _fit_table(seen.model, made),
            intervals_table(seen.model, made),
            default_section.training_table(seen.model, made),
        ),
    )


def _found_from(seen: Seen) -> str:
    days = [] if seen.model is None else list(seen.model.training_days)
    if not days:
        return "The days that the parameters were identified from are not named."
    golden = {s.group for s in _of_days(seen.verdict, WINDOWS)}
    both = sorted(set(days) & golden)
    apart = (
        f"These days overlap those that it is judged on: {day_list(both)}."
        if both
        else "It is judged on none of them."
    )
    span = f"{day_words(min(days))} to {day_words(max(days), year=True)}"
    return f"Identified from {counted(len(days), 'training day')}, {span}. {apart}"


def _model_words(model: SpindleModelFile) -> str:
    nodes = model.fit.nodes
    text = (
        f"A thermal network of {counted(nodes, 'node')}: the measured node warms by the sum of its "
        "heat sources, each a coefficient over heat capacity times a function of speed or load, "
    )
    text += (
        "and cools in proportion to its temperature above the surroundings."
        if nodes == 1
        else "and exchanges heat with a body, which " + _body_words(model.network)
    )
    if model.fit.in_doubt:
        text += (
            f" What was left out of the fit does not tell it from {', '.join(model.fit.in_doubt)}: "
            "the intervals of the heat sources are those over all of them."
        )
    parameters = model.parameters.get("", {})
    rates = [
        f"1/{name} {duration(1 / p.value)}"
        for name in RATES
        if (p := parameters.get(name)) is not None and p.determined and p.value
    ]
    if rates:
        text += f" Time constants: {', '.join(rates)}."
    lost = [name for name, p in parameters.items() if not p.determined]
    if lost:
        text += (
            f" {len(lost)} of {counted(len(parameters), 'parameter')} cannot be determined from "
            f"these records and have no value: {'; '.join(MEANINGS.get(n, n) for n in lost)}."
        )
    return text


def _body_words(network: SpindleThermalParameters) -> str:
    if network.fixed_body:
        return "stays as warm as the day began."
    bearings = "is heated by the bearings and " if network.friction_in_body else ""
    return f"{bearings}loses its own to the surround."


def _forest_words(model: SpindleModelFile) -> str:
    forest = model.forest
    if not forest.used:
        return (
            f"A random forest on what physics leaves over was tried and is not used: {forest.why}."
        )
    text = f"A random forest corrects what physics leaves over: {forest.why}."
    if forest.rmse_days_left_out_K is not None and forest.rmse_without_K is not None:
        text += (
            f" On days left out its RMSE is {fixed(forest.rmse_days_left_out_K, 2)} K, without it "
            f"{fixed(forest.rmse_without_K, 2)} K."
        )
    return text


def _left_out_words(name: str) -> str:
    """Network and what was left out of its fit, as the choice among networks stores it."""
    hours = name.endswith(", hours")
    return f"{'hours' if hours else 'days'} left out, {name.removesuffix(', hours')}"


def _fit_table(model: SpindleModelFile, made: Sequence[Source]) -> Table:
    """Figures of the fit itself."""
    fit = model.fit
    lines = [
        ("condition of the scaled Jacobian", quantity(fit.condition, "")),
        ("RMSE over the training days", quantity(fit.rmse_K, "K")),
        *(
            (f"RMSE on {_left_out_words(n)}", quantity(v, "K"))
            for n, v in fit.rmse_days_left_out_K.items()
        ),
        ("step of the simulation", quantity(fit.step_s, "s")),
        ("training days, in all", duration(fit.seconds)),
        ("of them with inputs held over a gap", duration(fit.bridged_s)),
        ("simulations of the training days", number(fit.evaluations)),
    ]
    pair = default_section.strongest_correlation(fit.correlation)
    if pair is not None:
        words = f"{fixed(pair[2], 2)} between {pair[0]} and {pair[1]}"
        lines.append(("strongest correlation", words))
    return Table(
        caption="Figures of the fit",
        heads=names("Figure", "value"),
        rows=[cells(what, value) for what, value in lines],
        sources=list(made),
        folded=True,
    )


def _judged_section(seen: Seen) -> Section:
    """Figures by judged day, tables of errors, the rules of the judgement."""
    title = "The golden week: measured against model"
    v = seen.verdict
    if v is None:
        remedy = "It needs a model and a week of records that it was not fitted on, frozen by hash."
        text = [absent(seen.folder / "verdict.json", remedy)]
        return Section(key="golden", title=title, text=text)
    if v.judged_role != "golden":
        title = "Days held out of the fit: measured against model"
    text = [_rules(v)]
    if v.reasons:
        text.append("Reasons as the judge gave them: " + "; ".join(v.reasons) + ".")
    if seen.predictions is None:
        path = seen.folder / "predictions.parquet"
        text.append(absent(path, "Without it no day can be drawn; the errors stand below."))
    made = _made(seen, "verdict.json")
    step_s = SAMPLE_S if seen.model is None else seen.model.fit.step_s
    blocks = present(
        _figures(seen),
        _errors_table(v, made, WINDOWS, "in windows, each started from its first value", step_s),
        _errors_table(v, made, FREE_RUN, "over whole days, each from its first value", step_s),
        parts_table(v, made, step_s),
        default_section.outside_table(v, made),
        default_section.left_out_table(v, made),
    )
    return Section(key="golden", title=title, text=text, blocks=blocks)


def _rules(v: Verdict) -> str:
    limits = _limits(v)
    return (
        "At the start of each window the model is given the measured temperature, then only speed, "
        "load and states. Over whole days it is given once, at the first. It passes with MAE "
        f"below {fixed(limits.get('mae'), 1)} K and RMSE below {fixed(limits.get('rmse'), 1)} K. "
        "Persistence is the guess that the temperature stays as it was given, the day’s mean is "
        "the best constant in hindsight."
    )


def _errors_table(
    v: Verdict, made: Sequence[Source], regime: str, words: str, step_s: float
) -> Table | None:
    """Errors by judged day of model, physics alone, persistence and the day's mean."""
    scores = _of_days(v, regime)
    if not scores:
        return None
    judges = [(k, w) for k, w in JUDGES if any(k in s.others for s in scores)]
    heads = [Head(name="Day"), Head(name="judged", unit="h", numeric=True)]
    for word in ("Model", *(w for _, w in judges)):
        heads += numbers(("MAE", "K"), ("RMSE", "K"), ("max", "K"), group=word)
    total = score_of(v, regime)
    judged = any(s.limits for s in scores)
    every = [(day_words(s.group), s, s.status) for s in scores]
    if total is not None:
        every.append(("All days", total, v.status))
    return Table(
        caption=f"Errors {words}, by day",
        heads=[*heads, *names("beats persistence", *(["verdict"] if judged else []))],
        rows=[_errors_row(word, s, judges, status, judged, step_s) for word, s, status in every],
        sources=list(made),
    )


def _errors_row(
    word: str, score: Score, judges: Sequence[tuple[str, str]], status: str, judged: bool,
    step_s: float,
) -> list[Cell]:  # fmt: skip
    found: list[Errors] = [score, *(score.baselines.get(k, Errors()) for k, _ in judges)]
    errors = [fixed(value, 2) for one in found for value in (one.mae, one.rmse, one.max)]
    shown = {"passed": "passed", "failed": "failed"}.get(status, "unknown")
    words = "not known" if shown == "unknown" else shown
    verdict = [Cell(text=words, status=shown)] if judged else []
    beats = "no" if _beaten(score) else "yes"
    return cells(word, hours(step_s * score.n), *errors, beats, *verdict)


def _figures(seen: Seen) -> Figures | None:
    curves = _curves(seen)[:MOST_GOLDEN]
    if not curves:
        return None
    limit = _limits(seen.verdict).get("mae")
    days = {c.day: spinning for c in curves if (spinning := _spinning(seen, c.day)) is not None}
    axes = figures.frame(curves, list(days.values()), limit)
    drawn = []
    for day in curves:
        words, status, status_words = _day_words(seen, day)
        drawn.append(Figure(
            svg=figures.golden_figure(day, days.get(day.day), axes, f"{words} {status_words}."),
            caption=words, status=status, status_words=status_words,
            sources=sources(seen.shelf, seen.folder / "predictions.parquet",
                            *([_state(seen, day.day)] if seen.clean else [])),
        ))  # fmt: skip
    return Figures(figures=drawn, legend=[
        ("l-measured", "measured", "line"),
        ("l-window", "model, given the temperature once an hour", "line"),
        ("l-free", "model over the whole day", "dash"),
        ("l-limit", f"limit of the mean error, ±{fixed(limit, 1)} K", "dots"),
        ("s-held", "held in position", "box"),
        ("s-none", "not known", "hatch"),
    ])  # fmt: skip


def _curves(seen: Seen) -> list[figures.Curves]:
    """Measured and predicted temperatures of the days that decided."""
    if seen.predictions is None or seen.verdict is None or not len(seen.predictions):
        return []
    rows = seen.predictions[seen.predictions["role"] == seen.verdict.judged_role]
    found = []
    for day, of_day in rows.groupby("group"):
        free = of_day[of_day["regime"] == FREE_RUN]
        windows = of_day[of_day["regime"] == WINDOWS]
        values = {
            "measured": free["measured"].to_numpy(float),
            "model_window": windows["predicted"].to_numpy(float),
            "model_free": free["predicted"].to_numpy(float),
        }
        if len(free) and len(free) == len(windows):
            seconds = free["t"].to_numpy(float)
            found.append(figures.Curves(day=str(day), seconds=seconds, values=values))
    return found


def _state(seen: Seen, day: str) -> Path:
    return (seen.clean or Path()) / "state" / f"{day}.parquet"


def _spinning(seen: Seen, day: str) -> figures.Spinning | None:
    """Speed and position hold of a day, from its clean state table."""
    if seen.clean is None:
        return None
    columns = ("time", "spindle_speed", "spindle_position_control")
    made = "data/signals observations, by cleaning"
    table = seen.shelf.table(_state(seen, day), columns, made, all_of=False)
    if table is None or "time" not in table.column_names:
        return None
    column = table.column("time")
    times = column.cast(pa.timestamp("ns", tz="UTC")).cast(pa.int64()).to_numpy()
    place = (times - day_start(day, column.type.tz)) // 1_000_000_000 // figures.BIN

    def values(name: str) -> np.ndarray:
        if name not in table.column_names:
            return np.full(table.num_rows, np.nan)
        found: np.ndarray = pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy()
        return found

    return figures.Spinning(
        speed=figures.binned(np.abs(values(columns[1])), place),
        held=figures.binned(values(columns[2]), place),
    )


def _day_words(seen: Seen, day: figures.Curves) -> tuple[str, str, str]:
    """Caption of one judged day, its status and that in words."""
    measured = day.values["measured"]
    known = measured[np.isfinite(measured)]
    span = f" Measured {known.min():.1f} to {known.max():.1f} °C." if len(known) else ""
    one = next((s for s in _of_days(seen.verdict, WINDOWS) if s.group == day.day), None)
    free = next((s for s in _of_days(seen.verdict, FREE_RUN) if s.group == day.day), None)
    name = day_words(day.day, year=True)
    if one is None:
        return f"{name}.{span}", "unknown", "not judged"
    text = (
        f"{name}.{span} MAE {fixed(one.mae, 2)} K over one hour (persistence "
        f"{fixed(one.baselines.get('persistence', Errors()).mae, 2)} K), "
        f"{_kelvin(free)} over whole days."
    )
    status = {"passed": "passed", "failed": "failed"}.get(one.status, "unknown")
    return text, status, {"unknown": "not known"}.get(status, status)
