"""Page of the spindle temperature: heat sources of the network, forest, judged days."""

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.bands import Strip
from pipeline.charts.cases import Drawn
from pipeline.charts.numbers import counted, day_list, duration, fixed, number
from pipeline.charts.parameters import fit_words, listed
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.schema.days import day_start
from pipeline.schema.model import Band
from pipeline.submodels.contract import Shown
from pipeline.submodels.spindle.days import FREE_RUN, WINDOWS
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import TARGET, SpindleModelFile

RATES = ("cooling_rate", "coupling_rate", "body_cooling_rate")
"""Parameters whose inverse is a time constant."""
MEANINGS = {
    "bearing_friction": "heat of the bearings, grows with speed to the power 5/3",
    "load_speed": "heat that grows with load times speed",
    "copper": "copper loss, grows with load squared",
    "windage": "air and iron losses, grow with speed squared",
    "position_hold": "heat while the position loop holds the spindle",
    "cooling_rate": "heat exchange with the surroundings over heat capacity",
    "coupling_rate": "heat exchange of the measured node with the body",
    "body_cooling_rate": "heat exchange of the body with the surroundings",
    "coolant_rate": "heat exchange with the coolant over heat capacity",
    "capacity_ratio": "heat capacity of the measured node over the body’s",
    "ambient": "temperature of the surroundings",
    "ambient_offset": "surroundings of the spindle above the measured ambient",
}
"""Meaning of the thermal network's parameters, in words."""
BIN_S = 300.0
"""Step over which speed and position hold are drawn as means [s]."""

Seen = Shown[SpindleModelFile]


def content(shown: Seen) -> PageContent:
    """Page content of the spindle's temperature."""
    model, verdict = shown.model, shown.verdict
    idle = [] if verdict is None else [c.case for c in verdict.cases
                                       if c.role == "golden" and c.note]  # fmt: skip
    return PageContent(
        about="The spindle’s temperature follows from what heats it: bearings, load, windage, and "
        "the position loop while it holds. The model gives it hours ahead from speed and load.",
        rules="At the start of each window of an hour the model is given the measured temperature, "
        "then only speed, load and states. Over whole days (free run) it is given once, at the "
        "first. Persistence is the guess that the temperature stays as it was given; the day’s "
        "mean is the best constant in hindsight.",
        case="day",
        counts=(
            Counting(key="window_mae_K", name="Error over one hour (MAE)", quantity=TARGET,
                     regime=WINDOWS, error="mae", whole=True),
            Counting(key="free_mae_K", name="Error over whole days (MAE)", quantity=TARGET,
                     regime=FREE_RUN, error="mae", whole=True),
        ),
        guess="persistence",
        titles={"physics": "physics alone", "forest": "with the forest", "day_mean": "day’s mean",
                "persistence": "the temperature stays as it is"},
        todo={
            "passed": "The model may serve.",
            "failed": "Do not act on this model’s temperatures, and do not promote it.",
            "unknown": "Freeze a week that no model is fitted on: "
            f"`kerf golden --machine {shown.machine}`.",
        },
        facts=[] if model is None else list(_facts(model)),
        notes=[f"Golden days that are no working days: {day_list(idle)}."] if idle else [],
        meaning=listed(MEANINGS),
        figures=[] if model is None else [_fit(shown, model), _intervals(shown, model)],
        drawn=[Drawn(
            quantity=TARGET, regime=WINDOWS, error="mae", axis="Time of the day, h",
            factor=1 / 3600.0, other=(FREE_RUN, "model over the whole day"),
            beside=lambda day: _spinning(shown, day),
            legend=[("l-speed", "spindle speed; held in position", "line")],
        )],
        shown_facts=("windows", "compared"),
    )  # fmt: skip


def _facts(model: SpindleModelFile) -> Iterator[str]:
    nodes = model.fit.nodes
    body = _body_words(model.network)
    yield (
        f"A thermal network of {counted(nodes, 'node')}: the measured node warms by the sum of its "
        "heat sources, each a coefficient over heat capacity times a function of speed or load, "
        + ("and cools in proportion to its temperature above the surroundings." if nodes == 1
           else f"and exchanges heat with a body, which {body}")
    )  # fmt: skip
    if model.fit.in_doubt:
        yield (
            f"What was left out of the fit does not tell it from {', '.join(model.fit.in_doubt)}: "
            "the intervals of the heat sources are those over all of them."
        )
    parameters = model.parameters.get("", {})
    rates = [
        f"1/{name} {duration(1 / p.value)}" for name in RATES
        if (p := parameters.get(name)) is not None and p.determined and p.value
    ]  # fmt: skip
    if rates:
        yield f"Time constants: {', '.join(rates)}."
    forest = model.forest
    verb = "corrects what physics leaves over" if forest.used else (
        "on what physics leaves over was tried and is not used"
    )  # fmt: skip
    words = f"A random forest {verb}: {forest.why}."
    if forest.rmse_days_left_out_K is not None and forest.rmse_without_K is not None:
        words += (
            f" On days left out its RMSE is {fixed(forest.rmse_days_left_out_K, 2)} K, without it "
            f"{fixed(forest.rmse_without_K, 2)} K."
        )
    yield words
    said = f"The RMSE over the training days is {number(model.fit.rmse_K)} K"
    yield fit_words(said, model.fit.condition, model.fit.correlation)


def _body_words(network: SpindleThermalParameters) -> str:
    if network.fixed_body:
        return "stays as warm as the day began."
    bearings = "is heated by the bearings and " if network.friction_in_body else ""
    return f"{bearings}loses its own to the surroundings."


FIGURES: tuple[Column[tuple[str, str]], ...] = (
    Column("Figure", lambda row: row[0]), Column("value", lambda row: row[1]),
)  # fmt: skip


def _fit(shown: Seen, model: SpindleModelFile) -> Table | None:
    fit = model.fit
    rows = [
        *((f"RMSE on {'hours' if name.endswith(', hours') else 'days'} left out, "
           f"{name.removesuffix(', hours')}", f"{number(v)} K")
          for name, v in fit.rmse_days_left_out_K.items()),
        ("step of the simulation", f"{number(fit.step_s)} s"),
        ("training days, in all", duration(fit.seconds)),
        ("of them with inputs held over a gap", duration(fit.bridged_s)),
        ("simulations of the training days", number(fit.evaluations)),
    ]  # fmt: skip
    return tabulated("Figures of the fit", rows, FIGURES, made_from(shown, "model.json"),
                     folded=True)  # fmt: skip


BANDS: tuple[Column[tuple[str, str, Band]], ...] = (
    Column("Given the temperature", lambda row: row[0]),
    Column("regime", lambda row: row[1] or "any other"),
    Column("half width", lambda row: fixed(max(row[2].lower, row[2].upper), 2), "K"),
    Column("days", lambda row: number(row[2].groups), ""),
    Column("samples", lambda row: number(row[2].n), ""),
)


def _intervals(shown: Seen, model: SpindleModelFile) -> Table | None:
    """Half widths of the 90 % intervals by regime, calibrated on training days left out."""
    if model.intervals is None:
        return None
    kinds = (("once an hour", model.intervals.windows), ("once a day", model.intervals.free_run))
    rows = [(kind, regime, band) for kind, bands in kinds for regime, band in bands.items()]
    follow = " In windows the width follows the errors of the day that are known by then."
    return tabulated(
        "90 % interval of the temperature, by what the model expects and how long ago the "
        "temperature was measured", rows, BANDS, made_from(shown, "model.json"), folded=True,
        note="Calibrated on training days that the predicting model had not seen."
        + follow * (model.intervals.follow.step > 0),
    )  # fmt: skip


def _spinning(shown: Seen, day: str) -> list[Strip]:
    """Speed and position hold of a day, from its clean state table."""
    if shown.clean is None or shown.shelf is None:
        return []
    columns = ("time", "spindle_speed", "spindle_position_control")
    table = shown.shelf.table(shown.clean / "state" / f"{day}.parquet", columns,
                              "data/signals observations, by cleaning", all_of=False)  # fmt: skip
    if table is None or "time" not in table.column_names:
        return []
    column = table.column("time")
    times = column.cast(pa.timestamp("ns", tz="UTC")).cast(pa.int64()).to_numpy()
    place = ((times - day_start(day, column.type.tz)) / 1e9 / BIN_S).astype(int)
    strips = []
    shown_ = ((columns[1], "Spindle speed, mean of 5 min, rev/min", 44),
              (columns[2], "Held in position, share of the time", 26))  # fmt: skip
    for name, head, height in shown_:
        if name not in table.column_names:
            continue
        values = pc.fill_null(table.column(name).cast(pa.float64()), np.nan).to_numpy()
        good = np.isfinite(values)
        sums = np.bincount(place[good], weights=np.abs(values[good]), minlength=place.max() + 1)
        many = np.bincount(place[good], minlength=place.max() + 1)
        mean = np.where(many > 0, sums / np.maximum(many, 1), np.nan)
        hours = (np.arange(len(mean)) + 0.5) * BIN_S / 3600
        strips.append(Strip(head=head, height=height, zero=True,
                            curves=[("speed", hours, mean)]))  # fmt: skip
    return strips
