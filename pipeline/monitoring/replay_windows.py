"""Windows of the quantities that a replay compares: measured, estimated, ends of the interval.

Temperature, no-load power and following error have the champion's estimate.  Load of a cut, load of
an axis and cycle time have what is usual on the known-good days: of the same program and tool at
the same speed and feed, of the same speed of the axis, of the same program.  So has the first
temperature of a day, above the air where that is recorded: in the morning a spindle is as cold as
ever, whatever heats it at work, and a sensor that reads too much does so then too.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from pipeline.monitoring.day_estimates import TEMPERATURE, SpindlePower
from pipeline.monitoring.day_quantities import even, number_of
from pipeline.schema.days import day_of, zone_of
from pipeline.schema.si import MINUTE, NS
from pipeline.schema.twin_state import AXES, PARTS, QUANTITIES, read_day
from pipeline.signals.windows import read_state

WINDOW_S = 30.0
"""Length of a window, over which rows are represented by their median [s]."""
COMPARED = {"speed": 0.05, "feed": 0.1}
"""Share by which speed and feed of a cut may differ from the usual ones."""
LEAST_DAYS, LEAST_WINDOWS = 2, 18
"""Known-good days, and windows on them but for cycles and mornings, that make something usual."""
MORNING_S = 1800.0
"""Time of windows that the first temperature of a day counts like [s]."""
LEAST_ROWS_S = 5.0
"""Least known time of a window [s]."""
LEAST_SHARE = 0.02
"""Least half of an interval of what is usual, as a share of it [1]."""
TWICE = 2.0
"""Interval over the usual residual of days that the model was fitted on [1]."""
QUANTILES = (0.05, 0.95)
OF_CHAMPION = tuple(name for name, (_, parts) in QUANTITIES.items() if "measured" in parts)
CUT, MORNING, CYCLES = "cut_load", "morning_temperature", "cycle_time"
USUAL: Mapping[str, tuple[str, list[str], str]] = {
    CUT: ("PERCENT", ["program", "tool_number"], "no load of a program and tool at the speed and "
          "feed of known-good days"),
    MORNING: ("CELSIUS", ["any"], "no first temperature of three known-good days"),
    CYCLES: ("SECOND", ["program"], "no complete cycle of a program with three on known-good "
                   "days"),
    **{f"{axis}_load": ("PERCENT", ["at"], "no load of the axis at a steady speed outside of cuts "
                        "as on known-good days") for axis in AXES},
}  # fmt: skip
"""Unit of each quantity with a usual value, what it is usual for, and why it may be missing."""
Series = dict[str, pd.DataFrame]
"""By quantity W windows: ``t`` [s since 1970], ``day``, ``measured``, ``estimated``, ``low``,
``high`` and what they depend on."""


def units() -> dict[str, str]:
    """Unit of each quantity."""
    return {name: QUANTITIES[name][0] for name in OF_CHAMPION} | {
        name: unit for name, (unit, _, _) in USUAL.items()
    }


def series_of(
    folder: Path, clean: Path, days: Iterable[str], known_good: Sequence[str],
    power: SpindlePower | None,
) -> Series:  # fmt: skip
    """Windows of the days of a state; a quantity without any is left out."""
    parts: dict[str, list[pd.DataFrame]] = {}
    zone, cycles = zone_of(clean), pd.read_parquet(clean / "cycles.parquet")
    began = [day_of(time, zone) for time in _nanoseconds(cycles["start"])]
    for day in sorted(days):
        state = read_day(folder, day).to_pandas().set_index("time")
        own = cycles[np.array(began, dtype=str) == day]
        for name, table in _day_series(state, read_state(clean, day), own, power):
            parts.setdefault(name, []).append(table.assign(day=day))
    found = {name: pd.concat(some, ignore_index=True) for name, some in parts.items()}
    for name in OF_CHAMPION:
        found[name] = _with_interval(found[name], known_good)
    free = found["no_load_power"]
    drift = ((free["high"] - free["estimated"]) / free["estimated"].clip(1e-9)).median()
    if CUT in found and np.isfinite(drift):
        found[CUT]["own"] = np.hypot(1.0, drift * found[CUT]["under"])
    for name, (_, keys, _) in USUAL.items():
        if name in found:
            found[name] = _with_usual(found[name], keys, known_good)
    return {name: table for name, table in found.items() if len(table)}


def no_load_percent(table: pd.DataFrame, power: SpindlePower) -> Any:
    """Load of the no-load power at the speed of each window (W,) [%]; 0 where it is not known."""
    n = np.abs(table["speed"].to_numpy(float)) / MINUTE
    with np.errstate(divide="ignore", invalid="ignore"):
        found = power.no_load(n)[0] / power.records.scale.power(np.ones(len(n)), n)
    return np.where(np.isfinite(found), found, 0.0)


def _day_series(
    state: pd.DataFrame, clean: pd.DataFrame, cycles: pd.DataFrame, power: SpindlePower | None
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Windows of each quantity of a day, without what is usual."""
    for name in OF_CHAMPION:
        columns = state[[f"{name}_{part}" for part in PARTS[:4]]].set_axis(PARTS[:4], axis=1)
        known = columns.assign(speed=state["spindle_speed"]).dropna(
            subset=["measured", "estimated", "speed"]
        )
        yield name, _windows(known)
    runs = state["execution"].eq("ACTIVE") & state["spindle_steady"].fillna(False).astype(bool)
    runs &= state["mode"].isin(["cut", "air"]) & (state["path_feedrate"].abs() > 0)
    cut = state[["program", "tool_number"]].astype(object).assign(
        measured=state["spindle_load"].abs(), speed=state["spindle_speed"].abs(),
        feed=state["path_feedrate"].abs(),
    )  # fmt: skip
    cut = _windows(cut[runs & (cut["speed"] > 0)].dropna(), USUAL[CUT][1])
    yield CUT, cut.assign(under=0.0 if power is None else no_load_percent(cut, power), own=1.0)
    known = state[f"{TEMPERATURE}_measured"].dropna()
    air = pd.Series(number_of(clean, "ambient_temperature"), index=state.index)[known.index]
    air = air if air.notna().any() else air.fillna(0.0)
    first = pd.DataFrame({"measured": known - air, "air": air}).dropna().iloc[:1]
    first = first.loc[first.index.repeat(round(MORNING_S / WINDOW_S))]
    yield MORNING, first.assign(t=_nanoseconds(first.index) / NS, own=1.0, seconds=0.0, any=0)
    uncut = (state["mode"].notna() & (state["mode"] != "cut")).to_numpy()
    for axis in AXES:
        speed, load = (number_of(clean, f"{axis}_{what}") for what in ("feedrate", "load"))
        v = np.abs(speed[here := uncut & even(speed) & np.isfinite(load)])
        at = np.array([float(f"{one:.2g}") for one in v])
        rows = {"measured": np.abs(load[here]), "speed": v, "at": at, "own": 1.0}
        yield f"{axis}_load", _windows(pd.DataFrame(rows, index=state.index[here]), ["at"])
    override, feed = (number_of(clean, name) for name in ("feed_override", "path_feedrate"))
    shown = pd.Series(np.where(feed > 0, override, np.nan), index=state.index)
    done = cycles[cycles["complete"].fillna(False).astype(bool) & (cycles["active_s"] > 0)]
    share = [shown[a:b].mean() / 100 for a, b in zip(done["start"], done["end"], strict=True)]
    yield CYCLES, pd.DataFrame({
        "t": _nanoseconds(done["start"]) / NS, "measured": done["active_s"].to_numpy(float),
        "own": 0.0, "seconds": done["active_s"].to_numpy(float),
        "program": done["program"].to_numpy(), "override": np.array(share, dtype=float),
    })  # fmt: skip


def _windows(rows: pd.DataFrame, keys: Sequence[str] = ()) -> pd.DataFrame:
    """Medians of rows by window, and by what they are to be alike in."""
    time = pd.DatetimeIndex(rows.index).as_unit("ns").asi8
    t = pd.Series(time // round(WINDOW_S * NS) * WINDOW_S, index=rows.index, name="t")
    grouped = rows.groupby([t, *keys], observed=True)
    period = float(np.diff(time[:2000]).min(initial=round(WINDOW_S * NS))) / NS
    found = grouped.median().assign(seconds=grouped.size() * period)
    return found[found["seconds"] >= LEAST_ROWS_S].reset_index()


def _with_interval(table: pd.DataFrame, known_good: Sequence[str]) -> pd.DataFrame:
    """Windows with an interval: twice the usual residual of known-good days where none is known."""
    lacks = table["low"].isna() | table["high"].isna()
    off = (table["measured"] - table["estimated"])[table["day"].isin(known_good)].abs()
    half = TWICE * off.quantile(0.9) if lacks.any() else np.nan
    for name, sign in (("low", -1), ("high", 1)):
        table[name] = table[name].mask(lacks, table["estimated"] + sign * half)
    return table.dropna(subset=["low", "high"]).reset_index(drop=True)


def _with_usual(table: pd.DataFrame, keys: list[str], known_good: Sequence[str]) -> pd.DataFrame:
    """Windows that can be compared with what is usual, with it and its interval."""
    good = table[table["day"].isin(known_good)]
    grouped = good.groupby(keys)
    low, middle, high = (grouped["measured"].quantile(q) for q in (QUANTILES[0], 0.5, QUANTILES[1]))
    by_day = good.groupby([*keys, "day"])["measured"].median().groupby(keys)
    n, sd = by_day.size(), by_day.std()
    between = sd * stats.t.ppf(0.95, n - 1) * np.sqrt(1 + 1 / n)  # of a day to come
    spread = between.clip((high - low) / 2)
    usual = pd.DataFrame({"estimated": middle, "spread": spread})
    known = n >= LEAST_DAYS
    if table["seconds"].max() <= WINDOW_S:
        known &= grouped.size() >= LEAST_WINDOWS
    for name in COMPARED.keys() & set(table):
        usual[f"usual_{name}"] = grouped[name].median()
    table = table.join(usual[known], on=keys).dropna(subset="estimated")
    for name, share in COMPARED.items():
        if f"usual_{name}" in table:
            off = (table[name] - table[f"usual_{name}"]).abs()
            table = table[off <= share * table[f"usual_{name}"]]
    half = table[["own", "spread"]].max(axis=1).clip(LEAST_SHARE * table["estimated"].abs())
    ends = {"low": table["estimated"] - half, "high": table["estimated"] + half}
    return table.assign(**ends).sort_values("t", ignore_index=True)


def _nanoseconds(times: "pd.Series[Any]") -> Any:
    return pd.DatetimeIndex(times).as_unit("ns").asi8
