"""Page of the spindle temperature: heat sources of the network, forest, judged days."""

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.charts.bands import Strip
from pipeline.charts.cases import Drawn
from pipeline.charts.numbers import counted, day_list, duration, fixed, number
from pipeline.charts.parameters import fit_words
from pipeline.charts.submodel_page import PageContent, declared, made_from
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.days import day_start
from pipeline.schema.model import Band
from pipeline.submodels.contract import Shown
from pipeline.submodels.spindle.days import BASELINE_TITLES, FREE_RUN, WINDOWS
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import TARGET, SpindleModelFile

WORDS = page_words(__file__)
RATES = ("cooling_rate", "coupling_rate", "body_cooling_rate")
"""Parameters whose inverse is a time constant."""
BIN_S = 300.0
"""Step over which speed and position hold are drawn as means [s]."""

Seen = Shown[SpindleModelFile]


def content(shown: Seen) -> PageContent:
    """Page content of the spindle's temperature."""
    model, verdict = shown.model, shown.verdict
    idle = [] if verdict is None else [c.case for c in verdict.cases
                                       if c.role == "golden" and c.note]  # fmt: skip
    return declared(
        WORDS,
        titles=BASELINE_TITLES,
        todo=WORDS.table("todo", machine=shown.machine),
        facts=[] if model is None else list(_facts(model)),
        notes=[WORDS("days.idle", days=day_list(idle))] if idle else [],
        figures=[] if model is None else [_fit(shown, model), _intervals(shown, model)],
        drawn=[Drawn(
            quantity=TARGET, regime=WINDOWS, error="mae", axis="Time of the day, h",
            factor=1 / 3600.0, other=(FREE_RUN, "model over the whole day"),
            beside=lambda day: _spinning(shown, day),
            legend=[("l-speed", "spindle speed; held in position", "line")],
        )],
    )  # fmt: skip


def _facts(model: SpindleModelFile) -> Iterator[str]:
    """Network and its time constants, forest, fit."""
    fit, forest, parameters = model.fit, model.forest, model.parameters.get("", {})
    yield WORDS("network.nodes", nodes=counted(fit.nodes, "node"),
                cooling=WORDS(f"network.{_cooling(fit.nodes, model.network)}"))  # fmt: skip
    if fit.in_doubt:
        yield WORDS("network.in_doubt", others=", ".join(fit.in_doubt))
    rates = [
        f"1/{name} {duration(1 / p.value)}" for name in RATES
        if (p := parameters.get(name)) is not None and p.determined and p.value
    ]  # fmt: skip
    if rates:
        yield WORDS("network.times", rates=", ".join(rates))
    words = WORDS("forest.used" if forest.used else "forest.unused", why=forest.why)
    if forest.rmse_days_left_out_K is not None and forest.rmse_without_K is not None:
        words += WORDS("forest.errors", own=fixed(forest.rmse_days_left_out_K, 2),
                       without=fixed(forest.rmse_without_K, 2))  # fmt: skip
    yield words
    said = WORDS("network.fit", rmse=number(fit.rmse_K))
    yield fit_words(said, fit.condition, fit.correlation)


def _cooling(nodes: int, network: SpindleThermalParameters) -> str:
    """Key of the words on where the measured node's heat goes."""
    if nodes == 1:
        return "single"
    if network.fixed_body:
        return "fixed_body"
    return "heated_body" if network.friction_in_body else "body"


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
    follow = WORDS("intervals.follow") if model.intervals.follow.step > 0 else ""
    return tabulated(
        WORDS("intervals.table"), rows, BANDS, made_from(shown, "model.json"), folded=True,
        note=WORDS("intervals.note") + follow,
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
        strips.append(Strip(head=head, height=height, zero=True, curves=[("speed", hours, mean)]))
    return strips
