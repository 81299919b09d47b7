"""Windows of the quantities that a replay compares: measured, estimated, ends of the interval.

Temperature, no-load power and following error have the champion's estimate.  Load of a cut, load of
an axis and cycle time have what is usual on the known-good days: of the same program and tool at
a like speed and feed, of the same speed of the axis, of the same program.  So has the first
temperature of a day, above the air where that is recorded: in the morning a spindle is as cold as
ever, whatever heats it at work, and a sensor that reads too much does so then too.  The interval of
what is usual is that of a day to come, by Student's t between days, or of windows where that is
wider.
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

WINDOW_S, LEAST_S = 30.0, 5.0
"""Length of a window, whose rows their median stands for, and their least time [s]."""
COMPARED, NEAR = {"speed", "feed"}, (0.6, 1.6)
"""Influences on the load of a cut, and their range over the usual one: the load goes with a power
of each between 0 and 1, which its interval holds."""
LEAST_DAYS, LEAST_WINDOWS = 2, 18
"""Known-good days, and windows on them but for cycles and mornings, that make something usual."""
LEAST_SHARE, TWICE = 0.02, 2.0
"""Least half of a usual interval as a share of the value; interval of an estimate without one, over
the 90 % quantile of its residual on the days that the model was fitted on [1]."""
FREE, CUT, MORNING, CYCLES = "no_load_power", "cut_load", "morning_temperature", "cycle_time"
OF_CHAMPION = {name: unit for name, (unit, parts) in QUANTITIES.items() if "measured" in parts}
USUAL: Mapping[str, tuple[str, list[str]]] = {
    CUT: ("PERCENT", ["program", "tool_number"]), MORNING: ("CELSIUS", ["any"]),
    CYCLES: ("SECOND", ["program"]), **{f"{axis}_load": ("PERCENT", ["at"]) for axis in AXES},
}  # fmt: skip
"""Unit of each quantity with a usual value, and what it is usual for."""
Series = dict[str, pd.DataFrame]
"""By quantity W windows: ``t`` [s since 1970], ``day``, ``seconds``, ``measured``, ``estimated``,
``low``, ``high`` and what they depend on."""


def series_of(
    folder: Path, clean: Path, days: Iterable[str], known_good: Sequence[str],
    power: SpindlePower | None,
) -> Series:  # fmt: skip
    """Windows of the days of a state; a quantity without any is left out."""
    parts: dict[str, list[pd.DataFrame]] = {}
    zone, cycles = zone_of(clean), pd.read_parquet(clean / "cycles.parquet")
    began = np.array([day_of(time, zone) for time in _ns(cycles["start"])], dtype=str)
    for day in sorted(days):
        state = read_day(folder, day).to_pandas().set_index("time")
        for name, table in _of_day(state, read_state(clean, day), cycles[began == day], power):
            parts.setdefault(name, []).append(table.assign(day=day))
    found = {name: pd.concat(some, ignore_index=True) for name, some in parts.items()}
    for name in OF_CHAMPION:
        found[name] = _with_interval(found[name], known_good)
    drift = (found[FREE]["high"] / found[FREE]["estimated"].clip(1e-9)).median() - 1
    found[CUT]["own"] = np.hypot(1.0, np.nan_to_num(drift) * found[CUT]["under"])
    for name, (_, keys) in USUAL.items():
        found[name] = _with_usual(found[name], keys, known_good)
    return {name: table for name, table in found.items() if len(table)}


def _of_day(
    state: pd.DataFrame, clean: pd.DataFrame, cycles: pd.DataFrame, power: SpindlePower | None
) -> Iterator[tuple[str, pd.DataFrame]]:
    """Windows of each quantity of a day, without what is usual."""
    speed, load = state["spindle_speed"].abs(), state["spindle_load"].abs()
    for name in OF_CHAMPION:
        rows = state[[f"{name}_{part}" for part in PARTS[:4]]].set_axis(PARTS[:4], axis=1)
        known = rows["measured"].notna() & rows["estimated"].notna()
        yield name, _windows(rows.assign(speed=speed)[known])
    feed, mode = state["path_feedrate"].abs(), state["mode"]
    runs = state["execution"].eq("ACTIVE") & state["spindle_steady"].fillna(False).astype(bool)
    runs &= mode.isin(["cut", "air"]) & (feed > 0) & (speed > 0)
    cut = state[USUAL[CUT][1]].astype(object).assign(measured=load, speed=speed, feed=feed)
    cut = _windows(cut[runs].dropna(), USUAL[CUT][1])
    yield CUT, cut.assign(under=_no_load_percent(cut, power))
    warm = state[f"{TEMPERATURE}_measured"].dropna()
    air = pd.Series(number_of(clean, "ambient_temperature"), index=state.index)[warm.index]
    air = air if air.notna().any() else air.fillna(0.0)
    first = pd.DataFrame({"measured": warm - air, "air": air}).dropna().iloc[:1]
    first = pd.concat([first] * 60)  # it counts like half an hour of windows
    yield MORNING, first.assign(t=_ns(first.index) / NS, own=1.0, seconds=0.0, any=0)
    for axis in AXES:
        v, percent = (number_of(clean, f"{axis}_{what}") for what in ("feedrate", "load"))
        here = (mode.notna() & (mode != "cut")).to_numpy() & even(v) & np.isfinite(percent)
        at = [float(f"{one:.2g}") for one in np.abs(v[here])]
        motion = {"measured": np.abs(percent[here]), "speed": np.abs(v[here]), "at": at, "own": 1.0}
        yield f"{axis}_load", _windows(pd.DataFrame(motion, index=state.index[here]), ["at"])
    shown = pd.Series(number_of(clean, "feed_override"), index=state.index)[(feed > 0).to_numpy()]
    done = cycles[cycles["complete"].fillna(False).astype(bool) & (cycles["active_s"] > 0)]
    share = [shown[a:b].mean() / 100 for a, b in zip(done["start"], done["end"], strict=True)]
    yield CYCLES, done[["program"]].assign(
        t=_ns(done["start"]) / NS, measured=done["active_s"], own=0.0, seconds=done["active_s"],
        override=np.array(share, dtype=float),
    )  # fmt: skip


def _windows(rows: pd.DataFrame, keys: Sequence[str] = ()) -> pd.DataFrame:
    """Medians of rows by window, and by what they are to be alike in."""
    time = _ns(rows.index)
    t = pd.Series(time // round(WINDOW_S * NS) * WINDOW_S, index=rows.index, name="t")
    grouped = rows.groupby([t, *keys], observed=True)
    period = float(np.diff(time[:2000]).min(initial=round(WINDOW_S * NS))) / NS
    found = grouped.median().assign(seconds=grouped.size() * period)
    return found[found["seconds"] >= LEAST_S].reset_index()


def _with_interval(table: pd.DataFrame, known_good: Sequence[str]) -> pd.DataFrame:
    """Windows of the champion with an interval, that of known-good days where it has none."""
    off = (table["measured"] - table["estimated"])[table["day"].isin(known_good)].abs()
    half = TWICE * off.quantile(0.9) if len(off) else np.nan
    for name, sign in (("low", -1), ("high", 1)):
        table[name] = table[name].fillna(table["estimated"] + sign * half)
    return table.dropna(subset=["low", "high"]).reset_index(drop=True)


def _with_usual(table: pd.DataFrame, keys: list[str], known_good: Sequence[str]) -> pd.DataFrame:
    """Windows that can be compared with what is usual, with it and its interval."""
    good = table[table["day"].isin(known_good)]
    grouped, by_day = (good.groupby(some)["measured"] for some in (keys, [*keys, "day"]))
    low, middle, high = (grouped.quantile(q) for q in (0.05, 0.5, 0.95))
    between = by_day.median().groupby(keys)
    n = between.size()
    spread: Any = between.std() * stats.t.ppf(0.95, n - 1) * np.sqrt(1 + 1 / n)
    usual = pd.DataFrame({"estimated": middle, "spread": spread.clip((high - low) / 2)})
    for name in COMPARED & set(table):
        usual[f"usual_{name}"] = good.groupby(keys)[name].median()
    few = LEAST_WINDOWS if "at" in keys or "tool_number" in keys else 1
    usual = usual[(n >= LEAST_DAYS) & (grouped.size() >= few)]
    table = table.join(usual, on=keys).dropna(subset="estimated")
    middle, half = table["estimated"], table[["own", "spread"]].max(axis=1)
    half = half.clip(LEAST_SHARE * middle.abs())
    for name in COMPARED & set(table):
        ratio = (table[name] / table[f"usual_{name}"]).where(lambda one: one.between(*NEAR))
        half = half + middle * (ratio**0.5 - ratio**-0.5).abs() / 2
        middle = middle * ratio**0.5
    table = table.assign(estimated=middle).dropna(subset="estimated")
    half = half[table.index]
    ends = {"low": table["estimated"] - half, "high": table["estimated"] + half}
    return table.assign(**ends).sort_values("t", ignore_index=True)


def _no_load_percent(table: pd.DataFrame, power: SpindlePower | None) -> Any:
    """Load of the no-load power at the speed of each window (W,) [%], held beyond its speeds."""
    if power is None:
        return 0.0
    speeds = [one.speed_rpm for one in power.curve]
    n = table["speed"].clip(min(speeds), max(speeds)).to_numpy(float) / MINUTE
    return power.no_load(n)[0] / power.records.scale.power(np.ones(len(n)), n)


def _ns(times: Any) -> Any:
    return pd.DatetimeIndex(times).as_unit("ns").asi8
