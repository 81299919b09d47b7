"""Command ``kerf replay``: a span of production, its models, and what would explain the residual."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.app.fleet import DATA, check_machine, machine_parameters
from pipeline.app.output import aligned
from pipeline.champions.serving import bundle_place, champion_of, history_of, names_of
from pipeline.monitoring.day_estimates import TEMPERATURE, DayRows, Estimators, day_state
from pipeline.monitoring.replay import Explained, Standing, begin_of, explained, standing_of
from pipeline.monitoring.replay_parts import ThermalRuns, parts_of
from pipeline.monitoring.replay_windows import USUAL, WINDOW_S, Series, series_of
from pipeline.monitoring.state import estimators_of
from pipeline.parameters import read_params, section_path, structure
from pipeline.schema.bundle import copy_bundle, stored_bundle
from pipeline.schema.days import day_end, day_start, is_day, zone_of
from pipeline.schema.golden import read_golden
from pipeline.schema.history import served
from pipeline.schema.replay import Replay
from pipeline.schema.si import NS
from pipeline.schema.store import read_json, write_json, write_table
from pipeline.schema.twin_state import (
    CONTEXT,
    MANIFEST,
    PARTS,
    QUANTITIES,
    TwinState,
    day_path,
    read_day,
)
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.windows import read_state
from pipeline.submodels.cases import Records

REPLAY = "replay.json"
Span = tuple[float, float]
Columns = dict[str, Any]


def replayed(machine: str, first: str, last: str, other: str, out: Path) -> Replay:
    """Replay from ``first`` to ``last``, days or times of the plant; its tables go into ``out``.

    ``other``: a span to borrow parameters from, ``2026-01-05..2026-01-09``; empty for none.  Raises
    ValueError where there is nothing to replay.
    """
    check_machine(machine)
    folder, clean = DATA / "twin_state" / machine, DATA / "clean" / machine
    state = read_json(folder / MANIFEST, TwinState, f"run `dvc repro state@{machine}`")
    if not state.days:
        raise ValueError(f"{machine} has no log of its control, only recordings: a replay needs "
                         "days of production records")  # fmt: skip
    bundle = stored_bundle(DATA / "champion" / machine, machine)
    if bundle is None or bundle.sha256 != state.bundle:
        raise ValueError(f"{folder} is not by what serves: run `dvc repro state@{machine}`")
    spans = [_span(first, last, zone_of(clean))]
    if other:
        begin, dots, end = other.partition("..")
        if not dots:
            raise ValueError(f"--with {other} is no span: write it as 2026-01-05..2026-01-09")
        spans.append(_span(begin, end, zone_of(clean)))
    days, *lent = (_days(state, one, zone_of(clean)) for one in spans)
    good = tuple(day for day, one in state.days.items() if one.role == "training")
    records = Records.of_machine(DATA, machine, DATA / "champion" / machine)
    values, sets = read_params(), read_golden(DATA / "golden" / f"{machine}.json")
    given = estimators_of(DATA / "champion" / machine, records, {}, sets, values)
    every = {*days, *good, *(day for some in lent for day in some)}
    series = series_of(folder, clean, every, good, given.power)
    standing, found = standing_of(series, spans[0], good)
    missing = {name: why for name, (_, _, why) in USUAL.items() if name not in found} | {
        name: state.days[days[0]].unknown.get(name, "not measured beside it") for name, (_, parts)
        in QUANTITIES.items() if "measured" in parts and name not in found
    }  # fmt: skip
    if not found:
        why = "; ".join(f"{name.replace('_', ' ')}: {one}" for name, one in missing.items())
        raise ValueError(f"{machine} has nothing to compare from {first} to {last}: {why}")
    begin = begin_of(series, found)
    thermal = None
    if TEMPERATURE in series:
        run = [day for some in (days, *lent) for day in some]
        thermal = ThermalRuns.of(given.serving["spindle"], series[TEMPERATURE], clean, run, begin)
    parts = parts_of(series, standing.masks, thermal, begin)
    told = explained(standing, parts, *(_whole(standing, one) for one in spans[1:]))
    with TemporaryDirectory() as kept:
        version, previous = _previous(machine, Path(kept))
        before = previous and estimators_of(previous, records, {}, sets, values)
        for day in days:
            own = _by(before, day, clean, values, machine) if before else {}
            write_day(day, (series, told), own, spans[0], folder, out)
    champion = champion_of(machine)
    identity = machine_parameters(machine)["machine"][machine]["identity"]
    found = Replay(
        machine=machine, origin=identity["origin"], first=first, last=last, days=days,
        bundle=state.bundle, version=champion.version if champion else 0, previous=version,
        known_good=good, borrowed=other, outcome=told.outcome, named=told.named, sure=told.sure,
        quantities=found, replaced=tuple(row for _, row, _ in told.parts), missing=missing,
    )  # fmt: skip
    write_json(found, out / REPLAY)
    return found


def _span(first: str, last: str, zone: str) -> Span:
    """Begin and end [s since 1970] of days or times of the plant."""
    ends = []
    for text, of_day in ((first, day_start), (last, day_end)):
        try:
            time = pd.Timestamp(text)
            shown = time if time.tzinfo else time.tz_localize(zone)
        except (ValueError, TypeError) as error:
            raise ValueError(f"{text!r} is neither a day nor a time of the plant: write it as "
                             "2026-03-09 or 2026-03-09T10:30") from error  # fmt: skip
        ends.append(of_day(text, zone) if is_day(text) else shown.as_unit("ns").value)
    if ends[1] <= ends[0]:
        raise ValueError(f"{last} is not after {first}")
    return ends[0] / NS, ends[1] / NS


def _days(state: TwinState, span: Span, zone: str) -> tuple[str, ...]:
    found = tuple(day for day in sorted(state.days)
                  if day_start(day, zone) / NS < span[1] and day_end(day, zone) / NS > span[0])  # fmt: skip
    if not found:
        raise ValueError(f"no records in this span: there are days from {min(state.days)} to "
                         f"{max(state.days)}")  # fmt: skip
    return found


def _whole(standing: Standing, span: Span) -> Standing:
    """The same quantities over another span."""
    masks = {name: standing.series[name]["t"].between(*span).to_numpy() for name in standing.stands}
    return Standing.of(standing.series, {name: one for name, one in masks.items() if one.any()},
                       standing.limits, standing.stands)  # fmt: skip


def _previous(machine: str, kept: Path) -> tuple[int | None, Path | None]:
    """Version that served before the champion, and a folder with its models; None without one."""
    entries = served(history_of(machine))
    if len(entries) < 2:
        return None, None
    names = names_of(machine, Path())
    source, held = bundle_place(machine, entries[-2].bundle, names, Path())
    copy_bundle(source, held, kept / machine)
    return entries[-2].version, kept / machine


def _by(
    given: Estimators, day: str, clean: Path, values: Mapping[str, Any], machine: str
) -> Columns:
    """State of a day by other models."""
    import pyarrow.parquet as pq

    cleaning = structure(
        dict(values), section_path(dict(values), "cleaning", machine), CleanSettings
    )
    rows = DayRows(day=day, frame=read_state(clean, day), cleaning=cleaning,
                   segments=pq.read_table(clean / "segments.parquet"))  # fmt: skip
    return day_state(rows, given)[0]


def write_day(
    day: str, of: tuple[Series, Explained], previous: Mapping[str, Any], span: Span, folder: Path,
    out: Path,
) -> None:  # fmt: skip
    """Write the rows of a day within the span: its state, and beside it the other estimates."""
    state = read_day(folder, day).to_pandas()
    t = pd.DatetimeIndex(state["time"]).as_unit("ns").asi8 / NS
    columns: Columns = {"time": state["time"], **{name: state[name] for name in CONTEXT}}
    units = dict(CONTEXT)
    for name, table in of[0].items():
        own = table["day"].to_numpy() == day
        begins, lasts = (table[k].to_numpy(float)[own] for k in ("t", "seconds"))
        place = np.searchsorted(begins, t, side="right") - 1
        inside = (
            (place >= 0) & (t < (begins + np.maximum(lasts, WINDOW_S))[place])
            if own.any()
            else t < 0
        )

        def rows(values: Any) -> Any:
            return (
                np.where(inside, np.asarray(values, float)[own][place], np.nan)
                if own.any()
                else np.nan * t
            )

        for part in PARTS:
            key = f"{name}_{part}"
            kept = state.get(key, None) if name not in USUAL else None
            columns[key] = (
                kept
                if kept is not None
                else rows(
                    table["measured"] - table["estimated"] if part == "residual" else table[part]
                )
            )
        estimated = np.asarray(columns[f"{name}_estimated"], float)
        columns[f"{name}_previous"] = previous.get(f"{name}_estimated", np.full(len(t), np.nan))
        for part, row, found in of[1].parts:
            if name in part.estimates:
                change = part.estimates[name](found) - table["estimated"]
                columns[f"{name}_{row.key}"] = estimated + rows(change)
        unit = QUANTITIES[name][0] if name in QUANTITIES else USUAL[name][0]
        units |= {key: unit for key in columns if key.startswith(f"{name}_")}
    here = (t >= span[0]) & (t < span[1])
    arrays = {name: pa.array(np.asarray(one)[here] if name != "time" else one[here], from_pandas=True)
              for name, one in columns.items()}  # fmt: skip
    fields = [pa.field(name, one.type if name in ("time", *CONTEXT) else pa.float32(),
                       metadata={"unit": units.get(name, "")}) for name, one in arrays.items()]  # fmt: skip
    write_table(pa.table(list(arrays.values()), names=list(arrays)).cast(pa.schema(fields)),
                day_path(out, day))  # fmt: skip


def lines(found: Replay) -> Iterator[str]:
    """What stands, what each part removes of it, and what is named."""
    yield found.sentence
    rows = [
        (row.submodel, row.part, f"{100 * row.removed:.0f} %",
         "-" if row.borrowed is None else f"{100 * row.borrowed:.0f} %",
         f"spoils {row.spoilt.replace('_', ' ')}" if row.spoilt else
         ", ".join(f"{name} {value:.3g}" for name, value in row.parameters.items()))
        for row in found.replaced
    ]  # fmt: skip
    if rows:
        yield from aligned(
            [("replaced", "part", "removes", "with --with", "parameters"), *rows], words=5
        )
    for name, why in found.missing.items():
        yield f"not compared: {name.replace('_', ' ')}: {why}"
