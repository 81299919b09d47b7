"""The simulated cut as it was made, against what was found of it."""

from typing import Any

import numpy as np

from pipeline.charts.numbers import number, real, resolved, signed
from pipeline.charts.sources import dig
from pipeline.charts.tables import Cell, Table, cells, names, numbers, sources
from pipeline.report.cutting_spindle import no_load
from pipeline.report.cutting_units import (
    determined,
    holds,
    interval,
    interval_words,
    off_percent,
    unit_of,
    value_words,
)
from pipeline.report.facts import Facts

Known = tuple[str, float, dict[str, Any], bool | None]
"""Name, true value, what was found, whether its interval holds the truth."""

TURN = 360.0  # [deg]
SAME = 0.02  # share by which the speeds of two levels differ at most
NOTE = (
    "True coefficients are those of the straight line nearest to the simulated edge force, which "
    "is no straight line. The angle of the runout is known but for whole pitches of the teeth, and "
    "its error is not said in percent. No-load power, rev/min: at the tool."
)
VERDICTS = {
    True: Cell(text="holds the truth", status="passed"),
    False: Cell(text="misses the truth", status="failed"),
    None: Cell(text="–"),
}


def cutting_truth_table(found: Facts) -> Table | None:
    """True value, value found, and whether its 95 % interval holds the truth."""
    truth, folders = dig(found.model.truth, "cutting"), found.folders
    every = [*_parameters(found, truth), *_powers(found, truth)]
    if not every or folders.truth is None:
        return None
    known = [inside for *_, inside in every if inside is not None]
    return Table(
        caption="The cut: what was simulated against what was found; "
        f"{sum(known)} of {number(len(known))} intervals hold the truth",
        note=NOTE,
        heads=[*names("Parameter"),
               *numbers(("true", ""), ("found", ""), ("off by", "%"), ("95 % interval", "")),
               *names("unit", "interval")],
        rows=[_row(*one) for one in every],
        sources=sources(found.shelf, folders.models / "cutting.json", folders.truth),
    )  # fmt: skip


def _parameters(found: Facts, truth: Any) -> list[Known]:
    """Coefficients, runout and specific force, of what stands in both."""
    flutes = real(dig(found.cutting.document, "tool", "flutes")) or 1.0
    periods = {"runout_angle": TURN / max(flutes, 1.0)}
    parameters = dict(found.cutting.parameters)
    specific = dig(found.cutting.document, "spindle", "specific_force")
    values = {**(truths if isinstance(truths := dig(truth, "parameters"), dict) else {})}
    if isinstance(specific, dict):
        parameters["specific_force"] = specific
        values["specific_force"] = dig(truth, "spindle", "specific_force")
    return [
        (name, true, p, holds(p, true, periods.get(name, 0.0)))
        for name, value in values.items()
        if (true := real(dig(value, "value") if isinstance(value, dict) else value)) is not None
        if (p := parameters.get(name)) is not None
    ]


def _powers(found: Facts, truth: Any) -> list[Known]:
    """No-load power at the tool at the speeds that were simulated; the truth is the motor's."""
    efficiency = real(dig(truth, "spindle", "efficiency")) or 1.0
    pairs = dig(truth, "spindle", "no_load_W")
    shown = no_load(found.cutting.document)
    if shown is None or not len(shown.band) or not isinstance(pairs, list):
        return []
    every = []
    for pair in pairs:
        speed, power = (real(x) for x in pair) if _is_pair(pair) else (None, None)
        if speed is None or power is None:
            continue
        near = shown.band[np.argmin(np.abs(shown.band[:, 0] - speed))]
        if abs(near[0] - speed) > SAME * abs(speed):
            continue
        _, value, half = near.tolist()
        p = {"value": value, "interval_95": [value - half, value + half], "determined": True,
             "unit": "WATT"}  # fmt: skip
        true = efficiency * power
        every.append((f"no-load power at {number(round(speed))}", true, p, holds(p, true)))
    return every


def _is_pair(pair: Any) -> bool:
    return isinstance(pair, list) and len(pair) == 2


def _row(name: str, true: float, p: dict[str, Any], inside: bool | None) -> list[Cell]:
    off = off_percent(p, true)
    return cells(
        Cell(text=name, code=True),
        number(true, resolved(*interval(p)) if determined(p) else 3),
        value_words(p),
        "–" if off is None else signed(off, 2),
        interval_words(p),
        unit_of(p) or "–",
        VERDICTS[inside],
    )
