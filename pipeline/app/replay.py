"""Command ``kerf replay``: a span of production, its models, what explains the residual."""

from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.app.fleet import DATA, check_machine, outside_fleet
from pipeline.app.output import aligned
from pipeline.champions.serving import bundle_place, champion_of, history_of, names_of
from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.day_estimates import (
    TEMPERATURE,
    DayRows,
    Estimators,
    day_state,
    spindle_power,
)
from pipeline.monitoring.nightly import serving_models
from pipeline.monitoring.replay import Replay, Standing, replacements, standing_of
from pipeline.monitoring.replay_parts import parts_of
from pipeline.monitoring.replay_windows import OF_CHAMPION, USUAL, WINDOW_S, series_of
from pipeline.parameters import read_params, section_path, structure
from pipeline.schema.bundle import MODEL, copy_bundle, stored_bundle
from pipeline.schema.days import day_end, day_start, is_day, zone_of
from pipeline.schema.golden import read_golden
from pipeline.schema.history import served
from pipeline.schema.si import NS
from pipeline.schema.store import read_json, write_json, write_table
from pipeline.schema.twin_state import CONTEXT, MANIFEST, PARTS, TwinState, day_path, read_day
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.windows import read_state
from pipeline.submodels.cases import Records
from pipeline.submodels.spindle.reruns import ThermalRuns
from pipeline.twin.spindle import SpindleModelFile

REPLAY = "replay.json"
WHY = {"cut_load": "no load of a program and tool", "morning_temperature": "no first temperature",
       "cycle_time": "no complete cycle of a program"}  # fmt: skip
"""What a quantity lacks that is usual on two known-good days; for an axis its load at a speed."""


def replayed(machine: str, first: str, last: str, other: str, out: Path) -> Replay:
    """Replay from ``first`` to ``last``, days or times of the plant; its tables go into ``out``.

    ``other``: a span to borrow parameters from, ``2026-01-05..2026-01-09``; empty for none.  Raises
    ValueError where there is nothing to replay.
    """
    check_machine(machine)
    if why := outside_fleet(machine):
        raise ValueError(why)
    folder, clean, champion = (DATA / k / machine for k in ("twin_state", "clean", "champion"))
    state = read_json(folder / MANIFEST, TwinState, f"run `dvc repro state@{machine}`")
    if not state.days:
        raise ValueError(f"{machine} has no log of its control, only recordings: a replay needs "
                         "days of production records")  # fmt: skip
    bundle, zone = stored_bundle(champion, machine), zone_of(clean)
    if bundle is None or bundle.sha256 != state.bundle:
        raise ValueError(f"{folder} is not by what serves: run `dvc repro state@{machine}`")
    spans = [_span(f"{first}..{last}", zone), *([_span(other, zone)] if other else [])]
    days, *lent = (tuple(day for day in sorted(state.days)
                         if day_start(day, zone) / NS < end and day_end(day, zone) / NS > begin)
                   for begin, end in spans)  # fmt: skip
    if lent and not lent[0]:
        raise ValueError(f"no records in --with {other}: there are days from {min(state.days)} to "
                         f"{max(state.days)}")  # fmt: skip
    if not days:
        raise ValueError(f"no records from {first} to {last}: there are days from "
                         f"{min(state.days)} to {max(state.days)}")  # fmt: skip
    good = tuple(day for day, one in state.days.items() if one.role == "training")
    records, values = Records.of_machine(DATA, machine, champion), read_params()
    run = [*days, *(day for some in lent for day in some)]
    serving = serving_models(champion, values, MonitoringSettings())
    power = spindle_power(serving.get("cutting"))
    series = series_of(folder, clean, {*run, *good}, good, power)
    standing = standing_of(series, spans[0], good)
    missing = {name: state.days[days[0]].unknown.get(name, "not measured") for name in OF_CHAMPION}
    missing |= {name: f"{WHY.get(name, 'no load at a speed outside of cuts')} as on two known-good "
                      "days" for name in USUAL}  # fmt: skip
    missing = {name: why for name, why in missing.items() if name not in standing.quantities}
    if not standing.quantities:
        why = "; ".join(f"{name}: {one}" for name, one in missing.items()).replace("_", " ")
        raise ValueError(f"{machine} has nothing to compare from {first} to {last}: {why}")
    thermal = None
    if TEMPERATURE in series:
        states = {day: read_state(clean, day) for day in run}
        model = read_json(champion / "spindle" / MODEL, SpindleModelFile)
        thermal = ThermalRuns.of(model, series[TEMPERATURE], states)
    parts = parts_of(series, standing.masks, thermal, standing.begin)
    found = replacements(standing, parts, *(standing.over(one) for one in spans[1:]))
    others = {row.key: {name: one(p) for name, one in part.estimates.items()}
              for row, part, p in found}  # fmt: skip
    with TemporaryDirectory() as kept:
        version, bundle_before = _previous(machine, Path(kept))
        before = _estimators(bundle_before, records, values, machine) if bundle_before else None
        cleaning = structure(values, section_path(values, "cleaning", machine), CleanSettings)
        for day in days:
            rows = DayRows(day=day, frame=read_state(clean, day), cleaning=cleaning,
                           segments=pq.read_table(clean / "segments.parquet"))  # fmt: skip
            own = day_state(rows, before)[0] if before else {}
            table = _table(read_day(folder, day).to_pandas(), standing, others, own)
            here = _ns(table["time"]).between(*spans[0], inclusive="left")
            _write(table[here.to_numpy()], standing, day_path(out, day))
    chosen, own = champion_of(machine), values["machine"][machine]
    replay = Replay(
        machine=machine, origin=own["identity"]["origin"],
        first=first, last=last, days=days, bundle=state.bundle, previous=version,
        version=chosen.version if chosen else 0, known_good=good, borrowed=other,
        quantities=standing.quantities, replaced=tuple(row for row, *_ in found), missing=missing,
    )  # fmt: skip
    write_json(replay, out / REPLAY)
    return replay


def _span(text: str, zone: str) -> tuple[float, float]:
    """Begin and end [s since 1970] of ``DAY..DAY``, or times of the plant."""
    ends = []
    text = text if ".." in text else f"{text}..{text}"
    for one, of_day in zip(text.split("..", 1), (day_start, day_end), strict=False):
        try:
            time = pd.Timestamp(datetime.fromisoformat(one))
            time = time if time.tzinfo else time.tz_localize(zone)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{one!r} is neither a day nor a time of the plant: write it as "
                             "2026-03-09 or 2026-03-09T10:30") from error  # fmt: skip
        ends.append((of_day(one, zone) if is_day(one) else time.as_unit("ns").value) / NS)
    if ends[1] <= ends[0]:
        raise ValueError(f"{text} names no end after its begin: write it as "
                         "2026-01-05..2026-01-09")  # fmt: skip
    return ends[0], ends[1]


def _previous(machine: str, kept: Path) -> tuple[int | None, Path | None]:
    """Version that served before the champion, and a folder with its models; None without one."""
    entries = served(history_of(machine))
    if len(entries) < 2:
        return None, None
    place, bundle = bundle_place(machine, entries[-2].bundle, names_of(machine, Path()), Path())
    copy_bundle(place, bundle, kept / machine)
    return entries[-2].version, kept / machine


def _estimators(bundle: Path, records: Records, values: dict[str, Any], machine: str) -> Estimators:
    """What estimates a day by the models in a folder; sealed days are not looked at."""
    serving = serving_models(bundle, values, MonitoringSettings())
    spindle, sets = serving.get("spindle"), read_golden(DATA / "golden" / f"{machine}.json")
    cases = () if spindle is None else spindle.one.cases(records, spindle.judging, sets).cases
    return Estimators(serving=serving, power=spindle_power(serving.get("cutting")), diameters={},
                      cases={one.name: one for one in cases if one.role != "sealed"})  # fmt: skip


def _table(
    state: pd.DataFrame, standing: Standing, others: Mapping[str, Mapping[str, Any]],
    previous: Mapping[str, Any],
) -> pd.DataFrame:  # fmt: skip
    """Rows of a day's state with the windows of each quantity, and the estimates beside them."""
    found = state[["time", *CONTEXT]].assign(t=_ns(state["time"]))
    for name, table in standing.series.items():
        own = table[["t", *PARTS[:4]]].assign(
            **{key: one[name] for key, one in others.items() if name in one}
        )
        length = max(float(table["seconds"].max()), WINDOW_S)
        own = own.set_axis(["t", *(f"{name}_{key}" for key in own.columns[1:])], axis=1)
        own = own.drop_duplicates("t").sort_values("t")
        found = pd.merge_asof(found, own, on="t", tolerance=length)  # type: ignore[arg-type]
        if (before := previous.get(f"{name}_estimated")) is not None:
            found[f"{name}_previous"] = before
    return found.drop(columns="t")


def _write(table: pd.DataFrame, standing: Standing, path: Path) -> None:
    columns = pa.Table.from_pandas(table, preserve_index=False)
    unit = {f"{name}_": one.unit for name, one in standing.quantities.items()}
    fields = [
        one.with_metadata({"unit": CONTEXT.get(one.name, "") or next(
            (u for start, u in unit.items() if one.name.startswith(start)), "")})
        for one in columns.schema
    ]  # fmt: skip
    write_table(columns.cast(pa.schema(fields)), path)


def _ns(time: "pd.Series[Any]") -> "pd.Series[float]":
    return pd.Series(pd.DatetimeIndex(time).as_unit("ns").asi8 / NS, index=time.index)


def lines(found: Replay) -> Iterator[str]:
    """What is named, what each part removes of the residual, and what is not compared."""
    yield found.sentence
    rows = [
        (row.submodel, row.part, f"{100 * row.removed:.0f} %",
         "-" if row.borrowed is None else f"{100 * row.borrowed:.0f} %",
         f"ruled out by {row.spoilt.replace('_', ' ')}" if row.spoilt else
         ", ".join(f"{name} {value:.3g}" for name, value in row.parameters.items()))
        for row in found.replaced
    ]  # fmt: skip
    head = ("replaced", "part", "removes", "with --with", "parameters")
    yield from aligned([head, *rows], words=5) if rows else ()
    yield from (f"not compared: {k.replace('_', ' ')}: {why}" for k, why in found.missing.items())
