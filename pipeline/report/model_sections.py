"""The sections on the spindle's thermal model and on its golden week."""

from typing import Any

import numpy as np

from pipeline.charts.numbers import NOT_KNOWN, counted, day_list, day_words, duration, fixed, real
from pipeline.charts.sections import Figure, Figures, Section, absent, present
from pipeline.charts.sources import dig, objects_of, rows_of
from pipeline.charts.tables import sources
from pipeline.report.facts import Facts
from pipeline.report.golden_figures import frame, golden_figure
from pipeline.report.model_tables import errors_table, fit_table, parameters_table
from pipeline.report.modelled import Curves
from pipeline.report.verdict import reasons

MOST_GOLDEN = 14  # days drawn; more days stand in the table only
RATES = ("cooling_rate", "coupling_rate", "body_cooling_rate")


def thermal_section(found: Facts) -> Section:
    """Parameters with intervals, or why there are none."""
    title = "The spindle’s heat: the model"
    thermal = found.model.thermal
    if thermal is None:
        remedy = (
            "It is found from spindle temperature, speed and load over at least one working week, "
            "best with the ambient temperature."
        )
        path = found.folders.models / "spindle_thermal.json"
        return Section(key="thermal", title=title, text=[absent(path, remedy)])
    return Section(
        key="thermal",
        title=title,
        text=[t for t in (_found_from(found), _model_words(thermal), _residual(found)) if t],
        blocks=present(parameters_table(found), fit_table(found)),
    )


def _model_words(thermal: dict[str, Any]) -> str:
    parameters = objects_of(thermal, "parameters")
    text = _structure(thermal)
    rates = [
        f"1/{name} {duration(1 / rate)}"
        for name in RATES
        if (rate := real(dig(parameters, name, "value"))) and dig(parameters, name, "determined")
    ]
    if rates:
        text += f" Time constants: {', '.join(rates)}."
    lost = [name for name, p in parameters.items() if not p.get("determined")]
    if lost:
        text += (
            f" {len(lost)} of {counted(len(parameters), 'parameter')} cannot be had from these "
            f"records ({', '.join(lost)}) and carry no number."
        )
    return text.strip()


def _structure(thermal: dict[str, Any]) -> str:
    nodes = dig(thermal, "fit", "nodes")
    if thermal.get("model") != "spindle_thermal_network" or nodes not in (1, 2):
        return f"Model: {thermal['model']}." if isinstance(thermal.get("model"), str) else ""
    text = (
        f"A thermal network of {counted(nodes, 'node')}: the measured node warms by the sum of its "
        "heat sources, each a coefficient over heat capacity times a function of speed or load, "
    )
    return text + (
        "and cools in proportion to its temperature above the surround."
        if nodes == 1
        else "and exchanges heat with a body, which loses its own to the surround."
    )


def _found_from(found: Facts) -> str:
    days = found.model.training_days
    if not days:
        return "The days that the parameters were found from are not named."
    apart = (
        f"These days overlap the golden week: {day_list(found.model.leaked_days)}."
        if found.model.leaked_days
        else "None of them stands in the golden week."
        if found.model.golden_days
        else "The golden week is not known, so nobody can say whether they overlap it."
    )
    span = f"{day_words(min(days))} to {day_words(max(days), year=True)}"
    return f"Found from {counted(len(days), 'training day')}, {span}. {apart}"


def _residual(found: Facts) -> str:
    residual = found.model.residual
    if residual is None:
        return "No forest corrects what physics leaves over, or its features.json is not there."
    why = str(residual.get("why") or "")
    if residual.get("used") is False:
        return "A random forest on what physics leaves over was tried and is not used" + (
            f": {why}." if why else "."
        )
    text = "A random forest corrects what physics leaves over" + (f": {why}." if why else ".")
    a, b = (real(residual.get(k)) for k in ("rmse_days_left_out_K", "rmse_without_K"))
    if a is not None and b is not None:
        text += f" On days left out its RMSE is {fixed(a, 2)} K, without it {fixed(b, 2)} K."
    return text


def golden_section(found: Facts) -> Section:
    """Figures by golden day, tables of errors, what they were judged by."""
    title = "The golden week: measured against model"
    if found.model.validation is None:
        remedy = (
            "It needs a model and a week of records that it has not learnt from, frozen by hash."
        )
        path = found.folders.models / "validation.json"
        return Section(key="golden", title=title, text=[absent(path, remedy)])
    text = [_rules(found)]
    why = reasons(found.model.validation)
    if why:
        text.append("Reasons as the judge gave them: " + "; ".join(why) + ".")
    if not found.model.curves:
        path = found.folders.models / "predictions.parquet"
        text.append(absent(path, "Without it the week cannot be drawn; the errors stand below."))
    blocks = present(
        _figures(found),
        errors_table(found, "windows", "in one-hour windows, each started from its first value"),
        errors_table(found, "free_run", "running free, each day from its first value"),
    )
    return Section(key="golden", title=title, text=text, blocks=blocks)


def _rules(found: Facts) -> str:
    v = found.model.validation
    length = real(dig(v, "windows", "length_s"))
    window = f"{fixed(length / 60, 0)} min" if length else NOT_KNOWN
    return (
        f"Windows of {window}: at the start of each the model is told the measured temperature, "
        "then only speed, load and states. Running free it is told once a day. It passes with MAE "
        f"below {fixed(dig(v, 'limits', 'mae_K'), 1)} K and RMSE below "
        f"{fixed(dig(v, 'limits', 'rmse_K'), 1)} K. Persistence is the guess that the "
        "temperature stays as it was told, the day’s mean is the best constant in hindsight."
    )


def _figures(found: Facts) -> Figures | None:
    curves = found.model.curves[:MOST_GOLDEN]
    if not curves:
        return None
    limit = real(dig(found.model.validation, "limits", "mae_K"))
    days = {d.day: d for d in found.working.days}
    axes = frame(curves, [days[c.day] for c in curves if c.day in days], limit)
    drawn = []
    for day in curves:
        words, status, status_words = _day_words(found, day)
        state = found.folders.clean / "state" / f"{day.day}.parquet"
        drawn.append(Figure(
            svg=golden_figure(day, days.get(day.day), axes, f"{words} {status_words}."),
            caption=words, status=status, status_words=status_words,
            sources=sources(found.shelf, found.folders.models / "predictions.parquet", state),
        ))  # fmt: skip
    return Figures(figures=drawn, legend=[
        ("l-measured", "measured", "line"),
        ("l-window", "model, told the temperature once an hour", "line"),
        ("l-free", "model running free", "dash"),
        ("l-limit", f"limit of the mean error, ±{fixed(limit, 1)} K", "dots"),
        ("s-held", "held in position", "box"),
        ("s-none", "not known", "hatch"),
    ])  # fmt: skip


def _day_words(found: Facts, day: Curves) -> tuple[str, str, str]:
    """Caption of one golden day, its status and that in words."""
    v = found.model.validation
    measured = day.values["measured"]
    known = measured[np.isfinite(measured)]
    span = f" Measured {known.min():.1f} to {known.max():.1f} °C." if len(known) else ""
    row = next((r for r in rows_of(v, "windows", "days") if r.get("day") == day.day), None)
    free = next((r for r in rows_of(v, "free_run", "days") if r.get("day") == day.day), None)
    name = day_words(day.day, year=True)
    if row is None:
        return f"{name}.{span}", "unknown", "not judged"
    text = (
        f"{name}.{span} MAE {fixed(dig(row, 'model', 'mae_K'), 2)} K over one hour"
        f" (persistence {fixed(dig(row, 'persistence', 'mae_K'), 2)} K), "
        f"{fixed(dig(free, 'model', 'mae_K'), 2)} K running free."
    )
    passed = row.get("passed")
    status = {True: "passed", False: "failed"}.get(passed, "unknown")  # type: ignore[arg-type]
    return text, status, {"unknown": "not known"}.get(status, status)
