"""State of the twin over a machine's days and recordings, written as one folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.day_estimates import (
    Estimators,
    day_rows,
    day_state,
    interval_lacks,
    spindle_power,
    with_drift,
)
from pipeline.monitoring.nightly import serving_models
from pipeline.monitoring.recorded_state import TwinStateSettings, force_check, recorded_trends
from pipeline.schema.days import zone_of
from pipeline.schema.golden import GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.twin_state import DAYS, StateDay, TwinState, day_path, write_day, write_state
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.windows import state_days
from pipeline.submodels.cases import Records, Roles, files_of_day, role_of


def write_twin_state(
    champion: Path, records: Records, out: Path, *, identity: MachineIdentity, roles: Roles,
    cleaning: CleanSettings, settings: TwinStateSettings, tools: Mapping[int, float],
    sets: GoldenSets | None, values: dict[str, Any],
) -> TwinState:  # fmt: skip
    """Write the state of all days and recordings of a machine into ``out``.

    ``tools``: diameters by tool number [m]; ``values`` are the parameters, as
    :func:`pipeline.parameters.read_params` gives them.  A sealed day is measured, not estimated.
    """
    clean, files = records.clean or Path(), records.files
    serving = serving_models(champion, values, MonitoringSettings())
    spindle = serving.get("spindle")
    cases = () if spindle is None else spindle.one.cases(records, spindle.judging, sets).cases
    zone, days = zone_of(clean), {}
    every = {day: role_of(files_of_day(files, day, zone), roles, sets, day)
             for day in state_days(clean)}  # fmt: skip
    segments = pq.read_table(clean / "segments.parquet")
    power = spindle_power(serving.get("cutting"))
    if power is not None:
        training = (day_rows(clean, day, zone, cleaning.period_s)
                    for day, role in every.items() if role == "training")  # fmt: skip
        power = with_drift(power, training, segments, cleaning)
    given = Estimators(
        serving=serving, cases={one.name: one for one in cases}, diameters=tools, power=power,
        cleaning=cleaning,
    )  # fmt: skip
    for day, role in every.items():
        rows = day_rows(clean, day, zone, cleaning.period_s)
        found, coverage = day_state(rows, segments, given, sealed=role == "sealed")
        write_day(rows.table["time"].combine_chunks(), found, day_path(out, day))
        seconds = round(len(rows.seconds) * rows.period_s, 3)
        days[day] = StateDay(role=role, seconds=seconds, quantities=coverage)
    for path in (out / DAYS).glob("*.parquet"):
        if path.stem not in days:
            path.unlink()
    state = TwinState(
        machine=identity.name, origin=identity.origin, period_s=cleaning.period_s, days=days,
        bundle=next((one.bundle for one in serving.values()), ""),
        no_load_drift=None if power is None else round(power.drift, 4),
        intervals_unknown=interval_lacks(spindle),
        submodels={name: one.verdict.status for name, one in serving.items()},
        trends=recorded_trends(serving.get("wear"), records, sets, settings, out),
        force=force_check(serving.get("cutting"), records, sets, settings),
    )  # fmt: skip
    write_state(state, out)
    return state
