"""Production rows of a mill whose forces and axes are known, and what estimates them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.monitoring.day_estimates import DayRows, Estimators, SpindlePower
from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import NoLoadPoint
from pipeline.schema.twin_state import StateDay
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.submodels.cutting.settings import LoadItems, SpindleLoadRecords

DRIVE = SpindleDrive(
    rated_power_kW=15.0, base_speed_rpm=2500.0, top_speed_rpm=12000.0, efficiency=0.9,
    minimum_speed_rpm=300.0,
)  # fmt: skip
RECORDS = SpindleLoadRecords(
    items=LoadItems(line="l", speed="n", load="p", feed="f"), drive=DRIVE, no_load=("*",)
)
DIAMETER = 0.012


def no_load(rpm: Floats) -> Floats:
    """No-load power of the mill [W] at a speed [rev/min]."""
    return 0.05 * np.abs(rpm)


POWER = SpindlePower(
    records=RECORDS,
    curve=tuple(
        NoLoadPoint(speed_rpm=n, power_W=0.05 * n, half_width_95_W=0.005 * n, measured_W=0.05 * n)
        for n in (1000.0, 6000.0, 12000.0)
    ),
)


def load_of(rpm: Floats, cutting: Floats) -> Floats:
    """Load in whole percent of what the motor has at its speed, for a cutting power [W]."""
    full = DRIVE.rated_power * np.minimum(1.0, rpm / DRIVE.base_speed_rpm)
    needed = (cutting + no_load(rpm)) / DRIVE.efficiency
    return np.round(100 * np.divide(needed, full, out=np.zeros(len(rpm)), where=full > 0))


def day_rows(columns: Mapping[str, Any], kind: str, period_s: float = 1.0) -> DayRows:
    """Rows of a day from midnight on, all in one segment."""
    n = len(next(iter(columns.values())))
    time = pd.date_range("2026-01-05", periods=n, freq=pd.Timedelta(seconds=period_s), tz="UTC")
    frame = pd.DataFrame(dict(columns), index=time.as_unit("ns"))
    ends = {"start": time[:1], "end": time[-1:] + pd.Timedelta(seconds=period_s)}
    segments = pa.table({name: pa.array(one.as_unit("ns")) for name, one in ends.items()})
    return DayRows(
        day="2026-01-05", frame=frame,
        segments=segments.append_column("kind", pa.array([kind])),
        cleaning=CleanSettings(period_s=period_s),
    )  # fmt: skip


def unknown_day(seconds: float) -> StateDay:
    """A day of which no quantity is estimated."""
    return StateDay(role="held_out", seconds=seconds, known_s={}, unknown={})


def estimators(
    serving: Mapping[str, ServingModel] | None = None, power: SpindlePower | None = POWER
) -> Estimators:
    return Estimators(serving=serving or {}, power=power, diameters={4: DIAMETER}, cases={})
