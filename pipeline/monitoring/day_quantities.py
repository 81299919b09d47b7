"""Quantities of a day that say in which condition a machine is.

Loads, and following errors, are those at the speed at which the axis or the spindle usually moves
steadily outside of cuts, since they depend on it; powers and the rise of temperature are taken over
what the champion expects under the speed and load of the day, so that work does not look like wear.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.twin_state import AXES
from pipeline.submodels.cutting.spindle_load.levels import resolution

LEAST_S = 30.0
"""Least time of a day at a speed from which a load counts [s]."""
LEAST_CYCLES = 2
"""Least complete cycles of a program on a day."""
LEAST_RISE_K = 2.0
"""Rise of the spindle temperature, estimated, from which it tells anything [K]."""
STEADY = 0.02
"""Share by which a speed may differ from those beside it [1]."""
Key = tuple[str, str, str, str]
"""Component, kind, quantity in words, unit."""
RECORDED: Key = ("machine", "hours", "time with records", "h")
ALARMS: Key = ("machine", "alarms", "alarms in 10 h with records", "1")
Reading = tuple[float, float]
"""Value of a day, and half of its 90 % interval that days have in common: rounding of a display."""


@dataclass(frozen=True, kw_only=True)
class DayValues:
    """Quantities of one day."""

    day: str
    values: Mapping[Key, Reading] = field(default_factory=dict)
    sums: Mapping[Key, float] = field(default_factory=dict)
    """Those that add up over a week."""
    at_speed: Mapping[tuple[Key, float], tuple[Reading, float]] = field(default_factory=dict)
    """Median and its time [s] by quantity and speed."""


def day_values(
    day: str, state: pd.DataFrame, clean: pd.DataFrame, cycles: pd.DataFrame,
    alarms: pd.DataFrame, *, period_s: float, turning_rpm: float,
) -> DayValues:  # fmt: skip
    """Quantities of a day by the rows (T,) of its state and its clean table, by time.

    ``cycles`` and ``alarms`` are those that began on the day.
    """
    uncut = state["mode"].notna() & (state["mode"] != "cut")
    at_speed: dict[tuple[Key, float], tuple[Reading, float]] = {}
    sums = {RECORDED: len(state) * period_s / 3600, ALARMS: float(len(alarms))}
    for axis in AXES:
        name, feed = f"axis {axis.upper()}", number_of(clean, f"{axis}_feedrate")
        free = uncut.to_numpy() & even(feed)
        load, error = number_of(clean, f"{axis}_load"), state[f"{axis}_following_error_measured"]
        for kind, unit, sizes in (("axis_load", "%", load),
                                   ("following_error", "mm", error.to_numpy(float))):  # fmt: skip
            words = f"{'load' if kind == 'axis_load' else 'following error'} at {{}} mm/s"
            key = (name, kind, words, unit)
            at_speed |= {(key, v): one for v, one in _medians(feed, sizes, free, period_s)}
        if np.isfinite(feed).any():
            moving = float((np.abs(feed) > 0).sum()) * period_s / 3600
            sums[name, "hours", "time moving", "h"] = moving
    speed = state["spindle_speed"].to_numpy(float)
    turns, feed = np.abs(speed) > turning_rpm, state["path_feedrate"].to_numpy(float)
    free = uncut.to_numpy() & turns & state["spindle_steady"].to_numpy(bool) & ~(feed > 0)
    key = ("spindle", "no_load_power", "load turning free at {} rev/min", "%")
    load = state["spindle_load"].to_numpy(float)
    at_speed |= {(key, v): one for v, one in _medians(speed, load, free, period_s)}
    if np.isfinite(speed).any():
        sums["spindle", "hours", "time turning", "h"] = float(turns.sum()) * period_s / 3600
    cut = state[state["mode"] == "cut"]
    for tool, rows in cut.groupby(cut["tool_number"].astype(object)):
        sums[f"tool {tool}", "hours", "time in cut", "h"] = len(rows) * period_s / 3600
    values = dict(_over_expected(state, period_s))
    complete = cycles[cycles["complete"].fillna(False).astype(bool) & (cycles["active_s"] > 0)]
    for program, own in complete.groupby("program"):
        if len(own) >= LEAST_CYCLES:
            key = (f"program {program}", "cycle_time", "active time of a complete cycle", "s")
            values[key] = float(own["active_s"].median()), 0.0
    return DayValues(day=day, values=values, sums=sums, at_speed=at_speed)


def _over_expected(state: pd.DataFrame, period_s: float) -> Iterator[tuple[Key, Reading]]:
    """No-load power and rise of temperature over what the champion expects [%]."""
    columns = [f"no_load_power_{part}" for part in ("measured", "estimated", "high")]
    known = state[columns].dropna()
    if len(known) * period_s >= LEAST_S:
        measured, estimated, high = (known[name].to_numpy(float) for name in columns)
        ratio, half = (float(np.median(x / estimated)) for x in (measured, high - estimated))
        key = ("spindle", "no_load_power", "power without load over the model’s", "%")
        yield key, (100 * ratio, 100 * half)
    columns = [f"spindle_temperature_{part}" for part in ("measured", "estimated")]
    known = state[columns].dropna()
    rise = known - known.iloc[0] if len(known) else known
    if len(rise) and float(rise[columns[1]].max()) >= LEAST_RISE_K:
        measured, estimated = (rise[name].to_numpy(float) for name in columns)
        key = ("spindle", "temperature_rise", "rise of temperature over the model’s", "%")
        yield key, (100 * float(measured @ estimated / (estimated @ estimated)), 0.0)


def number_of(table: pd.DataFrame, name: str) -> Floats:
    """A column of numbers (T,), NaN where it is not known or not recorded."""
    if name not in table:
        return np.full(len(table), np.nan)
    return table[name].to_numpy(np.float64, na_value=np.nan)


def even(speed: Floats) -> Bools:
    """Rows (T,) that move as fast as those before and after them."""
    v = np.abs(speed)
    even = np.abs(np.diff(v, prepend=np.nan)) <= STEADY * v
    steady: Bools = even & np.append(even[1:], False) & (v > 0)
    return steady


def _medians(
    speed: Floats, values: Floats, chosen: Any, period_s: float
) -> Iterator[tuple[float, tuple[Reading, float]]]:
    """Median size of the chosen values at each speed in two digits, with its time [s]."""
    here = chosen & np.isfinite(values) & np.isfinite(speed)
    half = 0.45 * resolution(values[here]) if here.any() else 0.0  # 90 % of a rounding error
    v = np.abs(speed[here])
    digits = 10.0 ** (np.floor(np.log10(v)) - 1)
    rounded = np.round(v / digits) * digits
    for one, own in pd.Series(np.abs(values[here])).groupby(np.round(rounded, 6)):
        if len(own) * period_s >= LEAST_S:
            yield float(str(one)), ((float(own.median()), half), len(own) * period_s)
