"""State of the twin over a machine's days and recordings, written as one folder."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.day_estimates import (
    DayRows,
    Estimators,
    day_state,
    interval_unknown,
    spindle_power,
    with_drift,
)
from pipeline.monitoring.nightly import ServingModel, serving_models
from pipeline.monitoring.recorded_state import force_check, recorded_trends
from pipeline.schema.bundle import Champion
from pipeline.schema.days import zone_of
from pipeline.schema.golden import GoldenSets
from pipeline.schema.store import write_json
from pipeline.schema.twin_state import (
    DAYS,
    MANIFEST,
    QUANTITIES,
    StateDay,
    TwinState,
    day_path,
    write_day,
)
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.signals.windows import read_state, state_days
from pipeline.submodels.cases import Records, Roles, files_of_day, role_of


def write_twin_state(
    champion: Path, records: Records, out: Path, *, roles: Roles,
    cleaning: CleanSettings, tools: Mapping[int, float], sets: GoldenSets | None,
    values: dict[str, Any], chosen: Champion | None = None,
) -> None:  # fmt: skip
    """Write the state of all days and recordings of a machine into ``out``.

    Those sub-models estimate that serve by ``chosen``, else those that passed.

    ``tools``: diameters by tool number [m]; ``values`` are the parameters, as
    :func:`pipeline.parameters.read_params` gives them.  On a sealed day no temperature is
    estimated.
    """
    clean, files = records.clean or Path(), records.files
    held = serving_models(champion, values, MonitoringSettings())
    serving = {name: one for name, one in held.items() if _serves(one, chosen)}
    idle = {name: one.verdict.status for name, one in held.items() if name not in serving}
    spindle = serving.get("spindle")
    cases = () if spindle is None else spindle.one.cases(records, spindle.judging, sets).cases
    zone, segments = zone_of(clean), pq.read_table(clean / "segments.parquet")
    role_by_day = {day: role_of(files_of_day(files, day, zone), roles, sets, day)
                   for day in state_days(clean)}  # fmt: skip

    def rows_of(day: str) -> DayRows:
        return DayRows(day=day, frame=read_state(clean, day), segments=segments, cleaning=cleaning)

    given = Estimators(
        serving=serving, power=spindle_power(held.get("cutting")), diameters=tools,
        cases={one.name: one for one in cases if one.role != "sealed"}, idle=idle,
    )  # fmt: skip
    given = with_drift(
        given, (rows_of(day) for day, role in role_by_day.items() if role == "training")
    )
    days = {}
    for day, role in role_by_day.items():
        rows = rows_of(day)
        columns, reasons = day_state(rows, given)
        write_day(rows.frame.index, columns, day_path(out, day))
        known_s = {name: float(np.isfinite(columns.get(f"{name}_estimated", np.nan)).sum())
                   * cleaning.period_s for name in QUANTITIES}  # fmt: skip
        days[day] = StateDay(
            role=role, seconds=len(rows.seconds) * cleaning.period_s, known_s=known_s,
            unknown={name: reasons[name] for name, seconds in known_s.items() if not seconds},
        )  # fmt: skip
    for path in (out / DAYS).glob("*.parquet"):
        if path.stem not in days:
            path.unlink()
    state = TwinState(
        period_s=cleaning.period_s, days=days,
        bundle=next((one.bundle for one in held.values()), ""),
        submodels={name: one.verdict.status for name, one in held.items()}, idle=tuple(idle),
        temperature_interval_unknown=interval_unknown(spindle),
        trends=recorded_trends(held.get("wear"), records, sets, out),
        force=force_check(serving.get("cutting"), records, sets),
    )  # fmt: skip
    write_json(state, out / MANIFEST)


def _serves(one: ServingModel, chosen: Champion | None) -> bool:
    """Whether a sub-model of the champion serves: as was chosen, else where it passed."""
    if chosen is not None and chosen.bundle == one.bundle:
        return chosen.serves(one.one.name)
    return one.verdict.status == "passed"
