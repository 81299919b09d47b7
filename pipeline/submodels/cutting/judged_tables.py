"""Tables of a judgement: errors of each recording and component, and the simulated truth."""

from dataclasses import replace
from math import ceil
from typing import Any

import numpy as np

from pipeline.charts.numbers import (
    NOT_KNOWN,
    TOGETHER,
    counted,
    fixed,
    number,
    real,
    relative,
    resolved,
    signed,
)
from pipeline.charts.sources import stated
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
)
from pipeline.schema.cutting import BY_LOAD, CuttingModel, NoLoadPoint
from pipeline.schema.model import Parameter
from pipeline.submodels.cutting.runs import (
    ERRORS,
    Component,
    CutRun,
    CuttingFacts,
    components,
)
from pipeline.submodels.cutting.tables import (
    CONDITIONS,
    OPEN,
    USES,
    condition_cells,
    interval_words,
    model_sources,
    unit_of,
    value_words,
    verdict_sources,
)

MOST_FOLDED = 40
"""Recordings from which their table opens on demand."""
TURN = 360.0
"""One turn of the spindle [deg]."""
SAME = 0.02
"""Share by which the speeds of two levels differ at most [1]."""
NOTE = (
    "Errors of the resultant force in the plane of the feed, over one mean revolution: RMS of "
    "modelled less measured force as a share of the measured RMS force; of the largest and of the "
    "mean force. The 90 % interval counts the law of the chip that the records leave open, the "
    "coefficients, and errors on recordings left out; it widens outside of what was learnt."
)
TRUTH_NOTE = (
    "True coefficients are those of the straight line nearest to the simulated edge force, which "
    "is no straight line. The angle of the runout is determined only up to whole pitches of the "
    "teeth (360° over their number), so no error in percent is given for it. "
    "No-load power, rev/min: at the tool."
)
VERDICTS = {
    True: Cell(text="holds the truth", status="passed"),
    False: Cell(text="misses the truth", status="failed"),
    None: Cell(text="–"),
}
PLAIN_WHAT = "coefficients of the mean forces; no helix, runout or mode of a channel"


# ---- predictions


def limits_words(facts: CuttingFacts) -> str:
    """The limits in a sentence's part; empty without any."""
    words = [
        f"{kind if kind != 'rms' else 'RMS'} {limit:g}{TOGETHER}%"
        for kind in ERRORS if (limit := facts.limit(kind)) is not None
    ]  # fmt: skip
    return f" (limits: {', '.join(words)})" if words else ""


def runs_table(facts: CuttingFacts) -> Table | None:
    """Every recording as the model's own parameters predict it, the judged first."""
    caption = f"Measured forces against predicted ones{limits_words(facts)}"
    return _runs_table(facts, facts.runs, caption)


def cross_table(facts: CuttingFacts) -> Table | None:
    """Every recording as a fit on other recordings predicts it."""
    caption = "Each recording predicted by a fit to the others"
    return _runs_table(facts, facts.cross, caption, cross=True)


def _runs_table(
    facts: CuttingFacts, runs: list[CutRun], caption: str, *, cross: bool = False
) -> Table | None:  # fmt: skip
    if not runs:
        return None
    why = any(_why(run) for run in runs)
    held = any(run.levels for run in runs)
    interval = numbers(("peak", "%"), ("mean", "%"), group="90 % interval, half") if held else []
    alone = any(run.size("rms", "mechanics") not in (None, run.size("rms")) for run in runs)
    pair = (("model", "%"), ("plain guess", "%"))
    return Table(
        caption=f"{caption}{_held_words(runs)}{left_out(len(runs), MOST_ROWS)}",
        note="" if cross else NOTE,
        heads=[
            *names("Recording", *(["fitted on"] if cross else [])),
            *numbers(*(head for head, *_ in CONDITIONS)),
            *numbers(pair[0], *([("mechanics alone", "%")] if alone else []), pair[1],
                     group="RMS error"),
            *numbers(*pair, group="Peak error"), *numbers(*pair, group="Mean error"), *interval,
            Head(name="verdict"), *names(*(["why"] if why else [])),
        ],
        rows=[_run_row(facts, run, cross, alone, why, held) for run in runs[:MOST_ROWS]],
        sources=verdict_sources(facts),
        folded=len(runs) > MOST_FOLDED,
    )  # fmt: skip


def _held_words(runs: list[CutRun]) -> str:
    """How many intervals of peak and mean hold what was measured; training ones do not count."""
    levels = [level for run in runs if not run.is_training for level in run.levels.values()]
    if not levels:
        return ""
    return (
        f"; {sum(level.held for level in levels)} of {number(len(levels))} intervals of 90"
        f"{TOGETHER}% hold the measured peak or mean"
    )


def _run_row(
    facts: CuttingFacts, run: CutRun, cross: bool, alone: bool, why: bool, held: bool
) -> list[Cell]:
    def marked(words: str, kind: str) -> Cell:
        return Cell(text=words, status="failed" if run.beyond(kind) else "")

    status = Cell(text="not judged" if run.status == "unknown" else run.status, status=run.status)
    if run.is_training:
        status = Cell(text=USES["training"], status="unknown")
    return cells(
        Cell(text=run.recording, code=True),
        *([_fitted_on(facts, run)] if cross else []),
        *condition_cells(run.row),
        marked(relative(run.size("rms")), "rms"),
        *([relative(run.size("rms", "mechanics"))] if alone else []),
        relative(run.size("rms", "plain")),
        *(
            cell
            for kind in ("peak", "mean")
            for cell in (marked(_signed(run.error(kind)), kind), _signed(run.error(kind, "plain")))
        ),
        *((_level_cell(run, "peak"), _level_cell(run, "mean")) if held else ()),
        status,
        *([_why(run) or "–"] if why else []),
    )


def _level_cell(run: CutRun, kind: str) -> Cell:
    """Half of an interval; marked where it misses what was measured."""
    level = run.levels.get(kind)
    if level is None:
        return Cell(text="–")
    missed = not level.held and not run.is_training
    width = relative(level.half_percent, lambda share: f"± {fixed(share, 1)}")
    return Cell(text=width, status="failed" if missed else "")


def _fitted_on(facts: CuttingFacts, run: CutRun) -> str:
    """Recordings that the fit was made on; their number where they are all the others."""
    others = {r.recording for r in facts.runs if r.row.role == "training"} - {run.recording}
    if len(others) > 1 and set(run.fitted_on) == others:
        return f"the {len(others)} others learnt from"
    return ", ".join(run.fitted_on) or NOT_KNOWN


def _why(run: CutRun) -> str:
    """What explains it; conditions that were not learnt; else why it was not judged."""
    if run.row.fault:
        return run.row.fault
    if run.outside:
        return f"outside of what was learnt: {run.outside}"
    return "" if run.is_training or any(run.beyond(kind) for kind in ERRORS) else run.reason


def _signed(value: float | None) -> str:
    return relative(value, signed)


def load_table(facts: CuttingFacts) -> Table | None:
    """Tangential force by the spindle's load beside the dynamometer's, with the MAPE."""
    frame = facts.shown.predictions
    if frame is None or not len(frame):
        return None
    rows = frame[(frame["quantity"] == BY_LOAD) & np.isfinite(frame["measured"])]
    if not len(rows):
        return None
    columns = ["measured", "predicted", "low", "high"]
    names_, values = rows["case"].tolist(), rows[columns].to_numpy(float)
    errors = 100 * (values[:, 1] / values[:, 0] - 1)
    inside = (values[:, 2] <= values[:, 0]) & (values[:, 0] <= values[:, 3])
    return Table(
        caption="Mean tangential force by the spindle’s load against the dynamometer: MAPE "
        f"{fixed(float(np.abs(errors).mean()), 1)}{TOGETHER}% over "
        f"{counted(len(names_), 'recording')}; {int(inside.sum())} of the 90{TOGETHER}% intervals "
        f"hold the dynamometer’s{left_out(len(names_), MOST_ROWS)}",
        note="The load was logged in other cuts: no recording of the dynamometer is in its "
        "coefficients. Wear between the two counts as error.",
        heads=[*names("Recording"), *numbers(("dynamometer", "N"), ("by the load", "N"),
               ("90 % interval, half", "N"), ("error", "%"))],
        rows=[
            cells(Cell(text=name, code=True), number(one[0]), number(one[1]),
                  f"± {number((one[3] - one[2]) / 2, 2)}", relative(error, signed))
            for name, one, error in list(zip(names_, values, errors, strict=True))[:MOST_ROWS]
        ],
        sources=verdict_sources(facts, "predictions.parquet"),
        folded=len(names_) > OPEN,
    )  # fmt: skip


def components_table(facts: CuttingFacts) -> Table | None:
    """Each component of each recording: forces measured and modelled, errors, plain guess."""
    runs = facts.runs if facts.judged or not facts.cross else facts.cross
    rows = [
        _component_row(run, name, one)
        for run in runs
        for name, one in components(
            facts.shown.predictions, run.recording, run.waveform.regime
        ).items()
    ]
    if not rows:
        return None
    of = ", predicted by a fit to the others" if runs[0].fitted_on else ""
    both = (("measured", "N"), ("modelled", "N"), ("error", "%"), ("plain", "%"))
    return Table(
        caption=f"Forces by component{of}, the plain guess beside{left_out(len(rows), MOST_ROWS)}",
        note=f"Plain guess: {PLAIN_WHAT}.",
        heads=[
            *names("Recording", "force"),
            *numbers(*both, group="Peak"), *numbers(*both, group="Mean"),
            *numbers(("measured", "N"), ("error", "%"), ("plain", "%"), group="RMS"),
            *names("closer"),
        ],
        rows=rows[:MOST_ROWS],
        sources=verdict_sources(facts, "predictions.parquet"),
        folded=len(rows) > OPEN,
    )  # fmt: skip


def _component_row(run: CutRun, name: str, one: Component) -> list[Cell]:
    peak, mean = (
        [number(one.measured[kind]), number(one.modelled[kind]), _signed(one.errors[kind]),
         _signed(one.plain[kind])]
        for kind in ("peak", "mean")
    )  # fmt: skip
    model, plain = one.errors["rms"], one.plain["rms"]
    closer = "–" if model is None or plain is None else "plain" if plain < model else "model"
    return cells(
        Cell(text=run.recording, code=True), name, *peak, *mean, number(one.measured["rms"]),
        relative(model), relative(plain), closer,
    )  # fmt: skip


# ---- truth of a simulated machine

Known = tuple[str, float, Parameter, bool | None]
"""Name, true value, what was found, whether its interval holds the truth."""


def truth_table(facts: CuttingFacts) -> Table | None:
    """True value, value found, and whether its 95 % interval holds the truth."""
    truth = stated(facts.shown.truth, "cutting")
    every = [*_true_parameters(facts, truth), *_true_powers(facts, truth)]
    if not every:
        return None
    known = [inside for *_, inside in every if inside is not None]
    periods = {} if facts.model is None else _periods(facts.model)
    return Table(
        caption="The cut: simulated against identified; "
        f"{sum(known)} of {number(len(known))} intervals hold the truth",
        note=TRUTH_NOTE,
        heads=[*names("Parameter"),
               *numbers(("true", ""), ("identified", ""), ("off by", "%"), ("95 % interval", "")),
               *names("unit", "interval")],
        rows=[_truth_row(*one, period=periods.get(one[0], 0.0)) for one in every],
        sources=model_sources(facts),
    )  # fmt: skip


def _periods(model: CuttingModel) -> dict[str, float]:
    """Periods [deg] of the parameters that are determined only up to whole ones, by name."""
    flutes = real(model.tool.get("flutes")) or 1.0
    return {"runout_angle": TURN / max(flutes, 1.0)}


def _true_parameters(facts: CuttingFacts, truth: Any) -> list[Known]:
    """Coefficients, runout and specific force, of what stands in both."""
    if facts.model is None:
        return []
    periods = _periods(facts.model)
    parameters = dict(facts.model.coefficients)
    parts = stated(truth, "parameters")
    values = dict(parts) if isinstance(parts, dict) else {}
    if "specific_force" in facts.model.spindle_parameters:
        parameters["specific_force"] = facts.model.spindle_parameters["specific_force"]
        values["specific_force"] = stated(truth, "spindle", "specific_force")
    return [
        (name, true, p, holds(p, true, periods.get(name, 0.0)))
        for name, value in values.items()
        if (true := real(value.get("value") if isinstance(value, dict) else value)) is not None
        if (p := parameters.get(name)) is not None
    ]


def _true_powers(facts: CuttingFacts, truth: Any) -> list[Known]:
    """No-load power at the tool at the speeds that were simulated; the truth is the motor's."""
    spindle = None if facts.model is None else facts.model.spindle
    efficiency = real(stated(truth, "spindle", "efficiency")) or 1.0
    pairs = stated(truth, "spindle", "no_load_W")
    if spindle is None or not spindle.curve or not isinstance(pairs, list):
        return []
    every = []
    for speed, power in pairs:
        near: NoLoadPoint = min(spindle.curve, key=lambda one: abs(one.speed_rpm - speed))
        if abs(near.speed_rpm - speed) > SAME * abs(speed):
            continue
        half = near.half_width_95_W
        p = Parameter(
            value=near.power_W, unit="WATT", determined=True, method="",
            interval_95=(near.power_W - half, near.power_W + half),
        )  # fmt: skip
        true = efficiency * power
        every.append((f"no-load power at {number(round(speed))}", true, p, holds(p, true)))
    return every


def _held_cell(inside: bool | None, period: float) -> Cell:
    """Whether the interval holds the truth, and by which period [deg] the truth may be moved."""
    said = VERDICTS[inside]
    if inside is None or not period:
        return said
    return replace(said, text=f"{said.text}, modulo {period:g}°")


def _truth_row(
    name: str, true: float, p: Parameter, inside: bool | None, period: float
) -> list[Cell]:
    off = off_percent(p, true)
    digits = resolved(*(p.interval_95 or (None, None))) if p.determined else 3
    return cells(
        Cell(text=name, code=True),
        number(float(np.float64(true)), digits),
        value_words(p),
        relative(off, lambda share: signed(share, 2)),
        interval_words(p),
        unit_of(p) or "–",
        _held_cell(inside, period),
    )


def holds(p: Parameter, true: float, period: float = 0.0) -> bool | None:
    """Whether the interval holds ``true``, or that and whole periods; None without an interval.

    >>> angle = Parameter(value=358.0, unit="deg", interval_95=(350.0, 366.0), determined=True,
    ...                   method="")
    >>> holds(angle, 3.0, 360.0), holds(angle, 3.0)
    (True, False)
    """
    if not p.determined or p.interval_95 is None:
        return None
    low, high = p.interval_95
    return low <= true + (period * ceil((low - true) / period) if period else 0.0) <= high


def off_percent(p: Parameter, true: float) -> float | None:
    """Difference of the value from the true one [%]; None for angles and a truth of 0."""
    if not p.determined or p.value is None or not true or p.unit == "deg":
        return None
    return 100 * (p.value / true - 1)
