"""Tables of the spindle's thermal model: parameters, fit, errors on the golden week."""

from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, day_words, fixed, hours, number, quantity, real
from pipeline.charts.sources import dig, objects_of, rows_of
from pipeline.charts.tables import Cell, Head, Table, cells, names, numbers, sources
from pipeline.report.facts import Facts

MEANINGS = {
    "bearing_friction": "heat of the bearings, grows with speed to the power 5/3",
    "load_speed": "heat that grows with load times speed",
    "copper": "copper loss, grows with load squared",
    "windage": "air and iron losses, grow with speed squared",
    "position_hold": "heat while the position loop holds the spindle",
    "cooling_rate": "heat exchange with the surround over heat capacity",
    "coupling_rate": "heat exchange of the measured node with the body",
    "body_cooling_rate": "heat exchange of the body with the surround",
    "capacity_ratio": "heat capacity of the measured node over the body’s",
    "ambient": "temperature of the surround",
    "ambient_offset": "surround of the spindle above the measured ambient",
}
"""What the thermal network's parameters mean, for people."""


def parameters_table(found: Facts) -> Table | None:
    """Parameters of the thermal network with their intervals, or why they are not determined."""
    parameters = objects_of(found.model.thermal, "parameters")
    if not parameters:
        return None
    ways = {str(p.get("how") or "") for p in parameters.values() if p.get("determined")}
    shared = ways.pop() if len(ways) == 1 else ""
    return Table(
        caption="Parameters of the spindle’s thermal network",
        note=f"Those with a number were found by {shared}." if shared else "",
        heads=[*names("Parameter", "means"), *numbers(("value", ""), ("95 % interval", "")),
               *names("unit", "how found, or why not")],
        rows=[_parameter_row(name, p, shared) for name, p in parameters.items()],
        sources=sources(found.shelf, found.folders.models / "spindle_thermal.json"),
    )  # fmt: skip


def _parameter_row(name: str, p: dict[str, Any], shared: str) -> list[Cell]:
    interval = p.get("interval_95")
    known = bool(p.get("determined")) and real(p.get("value")) is not None
    between = "–"
    if known:
        between = NOT_KNOWN
        if isinstance(interval, list) and len(interval) == 2:
            between = f"{number(interval[0])} to {number(interval[1])}"
    return cells(
        Cell(text=name, code=True),
        MEANINGS.get(name.split(".")[-1], "–"),
        number(p.get("value")) if known else Cell(text="not determined", status="unknown"),
        between,
        _unit(str(p.get("unit") or "")),
        "–" if known and p.get("how") == shared else str(p.get("how") or "–"),
    )


def _unit(unit: str) -> str:
    return {"": "–", "degC": "°C", "CELSIUS": "°C"}.get(unit, unit)


ERRORS = (("MAE", "K", "mae_K"), ("RMSE", "K", "rmse_K"), ("max", "K", "max_K"))
JUDGES = (
    ("model", "Model"),
    ("physics", "Physics alone"),
    ("persistence", "Persistence"),
    ("day_mean", "Day’s mean"),
)


def errors_table(found: Facts, part: str, words: str) -> Table | None:
    """Errors by golden day of model, physics alone, persistence and the day's mean."""
    v = found.model.validation
    rows = rows_of(v, part, "days")
    if not rows:
        return None
    judges = [(k, w) for k, w in JUDGES if any(isinstance(r.get(k), dict) for r in rows)]
    if all(r.get("physics") == r.get("model") for r in rows):  # no forest: twice the same numbers
        judges = [j for j in judges if j[0] != "physics"]
    heads = [Head(name="Day"), Head(name="judged", unit="h", numeric=True)]
    for _, word in judges:
        heads += numbers(*((name, unit) for name, unit, _ in ERRORS), group=word)
    judged = any(isinstance(r.get("passed"), bool) for r in rows)
    every = [(day_words(str(r.get("day"))), r) for r in rows]
    whole = dig(v, part, "all")
    if isinstance(whole, dict):
        passed = {"passed": True, "failed": False}.get(str(dig(v, "verdict")))
        every.append(("All days", {"passed": passed, **whole}))
    return Table(
        caption=f"Errors {words}, by day",
        heads=[*heads, *names("beats persistence", *(["verdict"] if judged else []))],
        rows=[_errors_row(word, row, judges, judged) for word, row in every],
        sources=sources(found.shelf, found.folders.models / "validation.json"),
    )


def _errors_row(
    word: str, row: dict[str, Any], judges: list[tuple[str, str]], judged: bool
) -> list[Cell]:
    errors = [fixed(dig(row, j, key), 2) for j, _ in judges for *_, key in ERRORS]
    beats = {True: "yes", False: "no"}.get(row.get("better_than_persistence"), NOT_KNOWN)  # type: ignore[arg-type]
    status = {True: "passed", False: "failed"}.get(row.get("passed"), "unknown")  # type: ignore[arg-type]
    words = NOT_KNOWN if status == "unknown" else status
    verdict = [Cell(text=words, status=status)] if judged else []
    return cells(word, hours(row.get("n_seconds")), *errors, beats, *verdict)


def fit_table(found: Facts) -> Table | None:
    """What the fit says about itself."""
    fit = dig(found.model.thermal, "fit")
    if not isinstance(fit, dict) or not fit:
        return None
    flat = {k: v for k, v in fit.items() if not isinstance(v, dict)}
    for key in ("rmse_days_left_out_K",):
        flat |= {f"{key}, {n} nodes": v for n, v in (dig(fit, key) or {}).items()}
    rows = [cells(Cell(text=key, code=True), _plain(value)) for key, value in sorted(flat.items())]
    rows += _correlation_row(fit)
    return Table(
        caption="What the fit says about itself",
        heads=names("Figure", "value"),
        rows=rows,
        sources=sources(found.shelf, found.folders.models / "spindle_thermal.json"),
        folded=True,
    )


def strongest_correlation(fit: Any) -> tuple[str, str, float] | None:
    """The pair of parameters that the records tell apart worst, and their correlation."""
    labels, values = dig(fit, "correlation", "names"), dig(fit, "correlation", "values")
    if not isinstance(labels, list) or not isinstance(values, list):
        return None
    pairs = [
        (abs(r), str(labels[i]), str(labels[j]), r)
        for i, row in enumerate(values[: len(labels)]) if isinstance(row, list)
        for j, x in enumerate(row[:i])
        if (r := real(x)) is not None
    ]  # fmt: skip
    return max(pairs)[1:] if pairs else None


def _correlation_row(fit: dict[str, Any]) -> list[list[Cell]]:
    pair = strongest_correlation(fit)
    if pair is None:
        return []
    a, b, r = pair
    return [cells("strongest correlation", f"{fixed(r, 2)} between {a} and {b}")]


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(_plain(v) for v in value[:12]) + (" …" if len(value) > 12 else "")
    return value if isinstance(value, str) else quantity(value, "")
