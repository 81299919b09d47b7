"""What the spindle's own load says of the cut: no-load power over speed, specific force."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.bands import UNITS, Band, band, plain, readings
from pipeline.charts.numbers import NARROW, NOT_KNOWN, counted, number, real
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.sources import dig, objects_of, rows_of, words_of
from pipeline.charts.svg import anchor
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names
from pipeline.report.cutting_changes import POWERS
from pipeline.report.cutting_tables import cutting_sources, small_table
from pipeline.report.cutting_units import determined
from pipeline.report.facts import Facts

TOP, HEIGHT = 18, 220  # px
POINTS = 120  # of a curve that is drawn from its coefficients
MOST_DOTS = 300
RPM = 60.0  # rev/min to rev/s
POLYNOMIAL = ("p0", "p1", "p2")  # of the speed in rev/s, in W
MEANINGS = {
    "p0": "no-load power of a spindle that hardly turns",
    "p1": "no-load power that grows with speed",
    "p2": "no-load power that grows with speed squared",
    "specific_force": "power at the tool for each volume of chips in time, edges and all",
    "K_tc": "of that what grows with the chip",
    "K_te": "of that what the edges take, for each width in the cut",
}


@dataclass(frozen=True, kw_only=True)
class NoLoad:
    """No-load power: the fitted curve, its 95 % band, what was measured.

    Parameters
    ----------
    speed, power : ndarray, shape (T,)
        Curve [rev/min], [W].
    band : ndarray, shape (N, 3)
        Speed [rev/min], power and half width of its interval [W], by speed.
    points : ndarray, shape (M, 2)
        Speed [rev/min] and power [W] of the levels that it was found from.
    """

    speed: np.ndarray
    power: np.ndarray
    band: np.ndarray
    points: np.ndarray


def spindle_table(found: Facts) -> Table | None:
    """No-load power and specific force with their intervals, or why they are not determined."""
    spindle = dig(found.cutting.document, "spindle")
    every = objects_of(spindle, "no_load", "coefficients")
    every |= {name: p for name, p in objects_of({"of": spindle}, "of").items() if name in POWERS}
    return small_table(found, "What the spindle’s load says of the cut", every, MEANINGS)


def spindle_words(found: Facts) -> str:
    """What was found from the spindle's load, and what it is good for."""
    spindle = dig(found.cutting.document, "spindle")
    if not isinstance(spindle, dict) or not spindle:
        return ""
    recordings = words_of(spindle, "recordings")
    in_table = {str(row.get("reason")) for row in rows_of(spindle, "left_out")}
    reasons = str(dig(spindle, "reason") or "").split("; ")
    reason = "; ".join(one for one in reasons if one not in in_table)
    said = [words.rstrip(".") for words in (str(dig(spindle, "assumed") or ""), reason)]
    rest = "".join(f" {words[0].upper()}{words[1:]}." for words in said if words)
    specific = dig(spindle, "specific_force")
    words = "From the load that the control shows"
    if recordings:
        many = f" and {len(recordings) - 2} more" if len(recordings) > 2 else ""
        words += f" ({', '.join(recordings[:2])}{many})"
    if not isinstance(specific, dict) or not determined(specific):
        return f"{words} no specific force could be had.{rest}"
    return (
        f"{words} each cm³ of chips a minute asks for {_watts(specific)}{NARROW}W at the tool: no "
        "dynamometer is needed to watch this one number, and it grows as the edge wears, with thin "
        f"chips most.{rest}"
    )


def spindle_logs_table(found: Facts) -> Table | None:
    """What of each log is not used, and why; None when all of them are used whole."""
    spindle = dig(found.cutting.document, "spindle")
    lost = rows_of(spindle, "left_out")
    notes = words_of(spindle, "notes")
    if not lost and not notes:
        return None
    used = words_of(spindle, "recordings")
    rows: list[tuple[str, str, str]] = []
    for name in used:
        of = [note.removeprefix(f"{name}: ") for note in notes if note.startswith(f"{name}: ")]
        rows.append((name, "used", "; ".join(of) or "–"))
    rows += [("–", "used", note) for note in notes if note.split(": ")[0] not in used]
    for row in lost:
        name, reason = (str(row.get(key) or NOT_KNOWN) for key in ("recording", "reason"))
        rows.append((name, "left out", reason.removeprefix(f"{name} ")))
    return Table(
        caption=f"Logs of the spindle’s load: {number(len(used))} used, {number(len(lost))} left "
        f"out{left_out(len(rows), MOST_ROWS)}",
        heads=names("Log", "use", "what of it is not used, or why not"),
        rows=[cells(Cell(text=name, code=True), *rest) for name, *rest in rows[:MOST_ROWS]],
        sources=cutting_sources(found),
        folded=len(rows) > 12,
    )


def _watts(specific: dict[str, Any]) -> str:
    """N/mm^2 as power for a rate of chips [W min/cm^3]."""
    return number((real(specific.get("value")) or 0.0) / 60)


def no_load(document: Any) -> NoLoad | None:
    """The curve and points of the no-load power; None when there is nothing to draw."""
    found = dig(document, "spindle", "no_load")
    rows = rows_of(found, "curve")[:MOST_DOTS]
    speeds, powers = _curve(found)
    shown = NoLoad(
        speed=speeds,
        power=powers,
        band=_columns(rows, "speed_rpm", "power_W", "half_width_95_W"),
        points=_columns(rows, "speed_rpm", "measured_W"),
    )
    return shown if len(shown.points) or len(speeds) else None


def _columns(rows: list[dict[str, Any]], *keys: str) -> np.ndarray:
    """Rows of numbers (N, K) by the first key; those without one of them are left out."""
    values = [[x for key in keys if (x := real(row.get(key))) is not None] for row in rows]
    whole = [v for v in values if len(v) == len(keys)]
    table = readings(np.array(whole, dtype=float).reshape(-1, len(keys)))
    known = table[np.isfinite(table).all(axis=1) & (table[:, 0] >= 0)]
    ordered: np.ndarray = known[np.argsort(known[:, 0], kind="stable")]
    return ordered


def _curve(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """P_0(n) over the range that was recorded; empty unless every coefficient is known."""
    nothing = np.zeros(0), np.zeros(0)
    ends = dig(found, "range_rpm")
    if not isinstance(ends, list) or len(ends) != 2:
        return nothing
    low, high = real(ends[0]), real(ends[1])
    coefficients = {
        int(name[1]): real(p.get("value"))
        for name, p in objects_of(found, "coefficients").items() if name in POLYNOMIAL
    }  # fmt: skip
    known = {power: value for power, value in coefficients.items() if value is not None}
    if low is None or high is None or not low < high or not known or known != coefficients:
        return nothing
    speed = np.linspace(low, high, POINTS)
    with np.errstate(over="ignore", invalid="ignore"):
        terms = [value * (speed / RPM) ** power for power, value in known.items()]
        power = readings(np.sum(terms, axis=0))
    return (speed, power) if np.isfinite(power).all() else nothing


def no_load_figures(found: Facts) -> Figures | None:
    """P_0(n), with the points that it was found from where they are given."""
    shown = no_load(found.cutting.document)
    if shown is None:
        return None
    words = "Power of the spindle without a cut over its speed"
    legend = []
    if len(shown.points):
        words += f": {counted(len(shown.points), 'level')} of constant speed"
        legend.append(("p-positive", "measured", "dot"))
    if len(shown.power):
        words += (
            f"; at {number(round(float(shown.speed[-1])))}{NARROW}rev/min it takes "
            f"{number(float(shown.power[-1]))}{NARROW}W"
        )
        legend.append(("l-modelled", "fitted curve", "line"))
    if len(shown.band) > 1:
        legend.append(("s-band", "its 95 % band", "box"))
    figure = Figure(svg=no_load_figure(shown, f"{words}."), caption=f"{words}.",
                    sources=cutting_sources(found))  # fmt: skip
    return Figures(figures=[figure], legend=legend, kind="one")


def no_load_figure(shown: NoLoad, label: str) -> Markup:
    """Curve with its band and the points, over speed from 0."""
    ends = [shown.band[:, 1] + s * shown.band[:, 2] for s in (-1, 1)]
    into = band(TOP, HEIGHT, shown.power, shown.points[:, 1], *ends, zero=True)
    speeds = [shown.speed, shown.points[:, 0], shown.band[:, 0], np.ones(1)]
    top_speed = float(np.concatenate(speeds).max())
    content = []
    if len(shown.band) > 1:
        there = UNITS * shown.band[:, 0] / top_speed
        x = np.concatenate([there, there[::-1]])
        y = np.concatenate([into.down(ends[1]), into.down(ends[0])[::-1]])
        content.append(svg.tag("path", d=svg.path_data(x, y) + "z", class_="s-band"))
    if len(shown.power):
        x = UNITS * shown.speed / top_speed
        content.append(svg.curve(x, into.down(shown.power), "modelled"))
    dots = [
        svg.tag("circle", cx=f"{100 * speed / top_speed:.2f}%", cy=into.pixel(float(power)), r=3.5,
                class_="point p-positive")
        for speed, power in shown.points
    ]  # fmt: skip
    parts = [svg.text(0, TOP - 7, "No-load power, W", "head"), *into.levels(5),
             *_speeds(top_speed, into), into.content(content), *dots]  # fmt: skip
    return svg.figure(parts, height=into.bottom + 36, label=label, kind="trace")


def _speeds(top_speed: float, into: Band) -> list[Markup]:
    parts = [svg.text(50, into.bottom + 31, "Speed, rev/min", "tick mid")]
    for mark in svg.ticks(0.0, top_speed, most=4):
        x = 100 * mark / top_speed
        parts += [svg.down(x, into.top, into.bottom), svg.text(x, into.bottom + 16, plain(mark),
                                                               anchor(x))]  # fmt: skip
    return parts
