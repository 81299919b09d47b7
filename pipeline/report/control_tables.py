"""Tables of the control: its parameters, the runs and the files that they were found from."""

from collections import Counter
from collections.abc import Callable
from string import ascii_lowercase
from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, between, number, powers, real, resolved
from pipeline.charts.sources import Source, dig, objects_of, rows_of
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names, numbers, sources
from pipeline.report.facts import Facts

MEANINGS = {
    "rapid_speed": "greatest speed in rapids",
    "cutting_speed": "greatest speed in cutting moves",
    "rapid_acceleration": "acceleration along the path in rapids",
    "cutting_acceleration": "acceleration along the path in cutting moves",
    "arc_acceleration": "acceleration towards the centre of arcs, and of curves made of chords",
    "corner_jump": "jump of an axis’ speed that a corner may ask for",
    "jerk": "change of acceleration in time",
    "tolerance": "how far the path may cut a corner",
    "rapid_filter": "smoothing time after interpolation, in rapids",
    "cutting_filter": "smoothing time after interpolation, in cutting moves",
    "settle_time": "wait until the axes are in position at an exact stop",
    "tool_change": "time of a tool change",
    "m_code": "time of an M code",
    "stop": "time of M0 and M1, without the operator’s",
    "spindle_acceleration": "how fast the spindle runs up",
    "spindle_deceleration": "how fast the spindle is stopped",
    "spindle_base_speed": "speed above which the spindle has constant power",
    "spindle_delay": "what each start and stop of the spindle takes beside its ramp",
    "spindle_orientation": "time to orient the spindle",
}
"""What the parameters of a control mean, for people."""


def meaning(name: str) -> str:
    """What a parameter means, with the axes and the machine behind its name.

    ``–`` where the name says all that is known.

    >>> meaning("rapid_speed XY@mill02"), meaning("settle_time"), meaning("other Z")
    ('X, Y: greatest speed in rapids, on mill02', \
'wait until the axes are in position at an exact stop', '–')
    """
    plain, _, unit = name.partition("@")
    key, _, axes = plain.partition(" ")
    words = MEANINGS.get(key)
    if words is None:
        return "–"
    head = f"{', '.join(axes)}: " if axes else ""
    return f"{head}{words}{f', on {unit}' if unit else ''}"


def control_parameters_table(found: Facts) -> Table | None:
    """Parameters of the control with their intervals, or what to record to have them."""
    parameters = objects_of(found.control.control, "parameters")
    made = sources(found.shelf, found.folders.models / "control.json")
    return parameters_table("Parameters of the control", parameters, meaning, made)


def parameters_table(
    caption: str, parameters: dict[str, dict[str, Any]], meaning: Callable[[str], str],
    made: list[Source],
) -> Table | None:  # fmt: skip
    """Parameters with value, interval and unit, and how they were found or what would show them.

    ``meaning`` says for people what the parameter of a name is.
    """
    if not parameters:
        return None
    ways = Counter(str(p.get("how") or "") for p in parameters.values() if _known(p))
    often = [way for way, count in ways.items() if way and (count > 1 or len(ways) == 1)]
    marks = {way: "–" if len(ways) == 1 else f"({letter})"
             for way, letter in zip(often, ascii_lowercase, strict=False)}  # fmt: skip
    return Table(
        caption=caption,
        note=_ways_words(marks),
        heads=[*names("Parameter", "means"), *numbers(("value", ""), ("95 % interval", "")),
               *names("unit", "how found, or what to record")],
        rows=[_parameter_row(name, meaning(name), p, marks) for name, p in parameters.items()],
        sources=made,
    )  # fmt: skip


def _ways_words(marks: dict[str, str]) -> str:
    """How the parameters were found, under the marks that stand in their rows."""
    if list(marks.values()) == ["–"]:
        return f"Those with a number were found by {next(iter(marks))}."
    said = "; ".join(f"{mark} {way}" for way, mark in marks.items())
    return f"How found: {said}." if said else ""


def _known(p: dict[str, Any]) -> bool:
    return bool(p.get("determined")) and real(p.get("value")) is not None


def _parameter_row(name: str, means: str, p: dict[str, Any], marks: dict[str, str]) -> list[Cell]:
    low, high = real(p.get("low")), real(p.get("high"))
    known = _known(p)
    how = str(p.get("how") or "")
    if not known:
        how = str(p.get("remedy") or how or NOT_KNOWN)
    return cells(
        Cell(text=name, code=True),
        means,
        number(real(p.get("value")), resolved(low, high)) if known else "not determined",
        between(low, high) if known else "–",
        powers(str(p.get("unit") or "–")),
        marks.get(how, how or "–") if known else how or "–",
    )


def control_runs_table(found: Facts) -> Table | None:
    """Which runs the parameters were found from, and why others were left out."""
    control = found.control.control
    learnt = [
        cells(Cell(text=str(r.get("run") or NOT_KNOWN), code=True), "learnt from",
              Cell(text=str(r.get("program") or NOT_KNOWN), code=True))
        for r in rows_of(control, "runs", "training")
    ]  # fmt: skip
    rest = [
        cells(Cell(text=str(r.get("run") or NOT_KNOWN), code=True), "left out",
              str(r.get("reason") or "no reason is said"))
        for r in rows_of(control, "runs", "left_out")
    ]  # fmt: skip
    rows = learnt + rest
    if not rows:
        return None
    return Table(
        caption=f"Runs that the control was found from ({number(len(learnt))}), and those left "
        f"out ({number(len(rest))}){left_out(len(rows), MOST_ROWS)}",
        heads=names("Run", "use", "program, or why not"),
        rows=rows[:MOST_ROWS],
        sources=sources(found.shelf, found.folders.models / "control.json"),
        folded=True,
    )


def control_sources_table(found: Facts) -> Table | None:
    """Files by hash that the control was found from."""
    where = sources(found.shelf, found.folders.models / "control.json")
    return files_table(found.control.control, "the control was", where)


def files_table(document: Any, what: str, where: list[Source]) -> Table | None:
    """Files by hash that ``document`` names as what it was found from; ``what`` with its verb."""
    files = dig(document, "found_from")
    if not isinstance(files, dict) or not files:
        return None
    rows = [
        cells(Cell(text=str(file), code=True), Cell(text=str(sha256), code=True))
        for file, sha256 in sorted(files.items())
    ]
    return Table(
        caption=f"Files that {what} found from{left_out(len(rows), MOST_ROWS)}",
        heads=names("File", "sha256"),
        rows=rows[:MOST_ROWS],
        sources=where,
        folded=True,
    )
