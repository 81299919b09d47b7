"""Tables of the cut: coefficients, measuring chain, searches against each other, recordings."""

from typing import Any

from pipeline.charts.numbers import NOT_KNOWN, counted, number, real
from pipeline.charts.sources import Source, dig, objects_of, rows_of, words_of
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
from pipeline.report.cutting_facts import Cutting
from pipeline.report.cutting_units import (
    determined,
    interval_words,
    remark,
    unit_of,
    value_words,
    ways,
)
from pipeline.report.drive_methods import ALIKE, METHODS
from pipeline.report.facts import Facts

MEANINGS = {
    "K_tc": "cutting, along the cutting speed: grows with material and a blunter rake",
    "K_rc": "cutting, away from the workpiece",
    "K_ac": "cutting, along the tool’s axis",
    "K_te": "edge, along the cutting speed: rubbing, grows as the edge wears",
    "K_re": "edge, away from the workpiece: grows first as flank wear grows",
    "K_ae": "edge, along the tool’s axis",
    "runout": "how far the tool’s axis is off the spindle’s",
    "runout_angle": "where that offset is, from the first tooth on",
    "helix": "helix angle of the edges",
    "kienzle.k_c11": "Kienzle: specific force of a chip 1 mm thick and wide",
    "kienzle.m_c": "Kienzle: how fast the specific force falls with thicker chips",
    "kienzle.radial": "Kienzle: radial over tangential force",
    "kienzle.axial": "Kienzle: axial over tangential force",
}
"""What the parameters of the cut mean, for people."""

UNCONVERGED = 1.5
"""A search whose error is more than that many times the other's has not found the optimum."""

CHAIN = {"natural_frequency": "natural frequency of dynamometer and workpiece",
         "damping": "its damping ratio", "delay": "delay of the channel"}  # fmt: skip


def cutting_sources(found: Facts) -> list[Source]:
    """The file that the coefficients stand in."""
    return sources(found.shelf, found.folders.models / "cutting.json")


def coefficients_table(found: Facts) -> Table | None:
    """Each parameter of the fit with its interval, beside that of the mean forces alone."""
    parameters = found.cutting.parameters
    means = objects_of(found.cutting.document, "mean_force")
    every = [*parameters, *(name for name in means if name not in parameters)]
    if not every:
        return None
    beside = any(determined(p) for p in means.values())
    note, marks = ways(parameters)
    pair = (("value", ""), ("95 % interval", ""))
    return Table(
        caption="Coefficients of the cut",
        note=note,
        heads=[
            *names("Parameter", "means"),
            *numbers(*pair, group="Whole waveform" if beside else ""),
            *(numbers(*pair, group="Mean forces alone") if beside else []),
            *names("unit", "how found, or why not"),
        ],
        rows=[
            _coefficient_row(name, parameters.get(name, {}), means.get(name, {}), beside, marks)
            for name in every
        ],
        sources=cutting_sources(found),
    )


def _coefficient_row(
    name: str, p: dict[str, Any], mean: dict[str, Any], beside: bool, marks: dict[str, str]
) -> list[Cell]:
    other = [value_words(mean) if mean else "–", interval_words(mean)] if beside else []
    return cells(
        Cell(text=name, code=True),
        MEANINGS.get(name, "–"),
        value_words(p) if p else "–",
        interval_words(p),
        *other,
        unit_of(p or mean) or "–",
        remark(p, marks),
    )


def small_table(
    found: Facts, caption: str, parameters: dict[str, dict[str, Any]], meanings: dict[str, str],
    *, folded: bool = False,
) -> Table | None:  # fmt: skip
    """Parameters with value, interval, unit and how they were found; None without any.

    What a parameter means stands in ``meanings`` under the last word of its name.
    """
    if not parameters:
        return None
    note, marks = ways(parameters)
    return Table(
        caption=caption,
        note=note,
        heads=[*names("Parameter", "means"), *numbers(("value", ""), ("95 % interval", "")),
               *names("unit", "how found, or why not")],
        rows=[
            cells(Cell(text=name, code=True), meanings.get(name.split(" ")[-1], "–"),
                  value_words(p), interval_words(p), unit_of(p) or "–", remark(p, marks))
            for name, p in parameters.items()
        ],
        sources=cutting_sources(found),
        folded=folded,
    )  # fmt: skip


def chain_table(found: Facts) -> Table | None:
    """The measuring chain: where each channel of the dynamometer rings."""
    chain = objects_of(found.cutting.document, "measuring_chain")
    parameters = {
        f"{axis} {name.removesuffix('_Hz')}": p
        for axis, one in chain.items() for name, p in objects_of({"of": one}, "of").items()
    }  # fmt: skip
    caption = "Measuring chain: what the dynamometer adds to the forces"
    return small_table(found, caption, parameters, CHAIN, folded=True)


def cutting_methods_table(found: Facts) -> Table | None:
    """Least squares against the genetic search, on the same waveforms."""
    used = str(dig(found.cutting.document, "method") or "")
    rows = [
        cells(
            METHODS.get(method := str(row.get("method") or NOT_KNOWN), method),
            number(real(row.get("rms_error_percent")), 4),
            NOT_KNOWN if (n := real(row.get("evaluations"))) is None else number(round(n)),
            "kept" if method == used else "–",
        )
        for row in rows_of(found.cutting.document, "methods")
    ]
    if not rows:
        return None
    return Table(
        caption="Least squares against genetic search, on the same revolutions",
        heads=[*names("Method"), *numbers(("RMS error", "%"), ("evaluations", "")),
               *names("kept")],
        rows=rows,
        sources=cutting_sources(found),
        folded=True,
    )  # fmt: skip


def cutting_methods_words(cutting: Cutting) -> str:
    """Which search came closer and what it cost, in one sentence; empty without two."""
    by_name = {str(row.get("method")): row for row in rows_of(cutting.document, "methods")}
    pair = [by_name.get(name, {}) for name in METHODS]
    errors = [e for row in pair if (e := real(row.get("rms_error_percent"))) is not None]
    spent = [real(row.get("evaluations")) for row in pair]
    if len(errors) < len(pair):
        return ""
    if errors[1] > UNCONVERGED * errors[0]:
        after = f" after {counted(round(spent[1]), 'evaluation')}" if spent[1] else ""
        return (
            f"Least squares errs by {number(errors[0], 3)} % of the RMS force; the genetic search "
            f"had not converged{after} ({number(errors[1], 3)} %)."
        )
    if abs(errors[0] - errors[1]) <= ALIKE * max(errors):
        text = f"Least squares and the genetic search are alike within {100 * ALIKE:g} %"
    else:
        first = "Least squares" if errors[0] < errors[1] else "The genetic search"
        text = (
            f"{first} comes closer: {number(min(errors), 3)} against {number(max(errors), 3)} % "
            "of the RMS force"
        )
    if not spent[0] or not spent[1]:
        return text + "."
    return (
        f"{text}; for each evaluation of least squares the genetic search needed "
        f"{number(spent[1] / spent[0], 2)}."
    )


CONDITIONS = (
    (("speed", "rev/min"), "speed_rpm", 4),
    (("feed a tooth", "mm"), "feed_per_tooth_mm", 3),
    (("depth", "mm"), "axial_depth_mm", 3),
)
"""Conditions of a cut as a table shows them: head, key, digits."""


def condition_heads() -> list[Head]:
    """Heads of the columns of :func:`condition_cells`."""
    return numbers(*(head for head, *_ in CONDITIONS))


def condition_cells(row: dict[str, Any]) -> list[str]:
    """Speed, feed a tooth and depth of a recording in words; dashes where nobody said them."""
    return ["–" if (x := real(row.get(key))) is None else _plain(x, digits)
            for _, key, digits in CONDITIONS]  # fmt: skip


def _plain(value: float, digits: int) -> str:
    return number(int(value)) if value == int(value) else number(value, digits)


USES = {"training": "learnt from", "judged": "judged", "left out": "left out"}


def cutting_recordings_table(found: Facts) -> Table | None:
    """Conditions of every recording, what it was used for, and why not."""
    rows = rows_of(found.cutting.document, "recordings")
    if not rows:
        return None
    roles = [str(row.get("role")) for row in rows]
    counts = ", ".join(f"{roles.count(role)} {use}" for role, use in USES.items() if role in roles)
    return Table(
        caption=f"Recordings of the cut: {counts or NOT_KNOWN}{left_out(len(rows), MOST_ROWS)}",
        heads=[*names("Recording", "use"), *condition_heads(),
               *numbers(("in the material", "°"), ("revolutions", "")),
               *names("what was done to it, or why not")],
        rows=[_recording_row(row) for row in rows[:MOST_ROWS]],
        sources=cutting_sources(found),
        folded=len(rows) > 12,
    )  # fmt: skip


def _recording_row(row: dict[str, Any]) -> list[Cell]:
    entry, exit_ = real(row.get("entry_deg")), real(row.get("exit_deg"))
    role, turns = str(row.get("role") or NOT_KNOWN), real(row.get("revolutions"))
    return cells(
        Cell(text=str(row.get("recording") or NOT_KNOWN), code=True),
        USES.get(role, role),
        *condition_cells(row),
        "–"
        if entry is None or exit_ is None
        else f"{number(round(entry))} to {number(round(exit_))}",
        "–" if turns is None else number(round(turns)),
        str(row.get("reason") or "; ".join(words_of(row, "notes")) or "–"),
    )
