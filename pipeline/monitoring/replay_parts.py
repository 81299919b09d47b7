"""Parts of the twin that a replay replaces in turn, each with its own parameters.

Sub-model by sub-model: the spindle's network (cooling, friction of bearings, all of it), the
cutting sub-model's no-load power and force, the drive's friction and loop gain, the control's
cycle time; beside them the sensors, since a residual may be the measured channel's.  The thermal
network runs again over each day; the champion's forest stays as it is.  A sensor that reads b too
much starts the network b too high, and reads that of the network plus b.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from pipeline.monitoring.day_estimates import TEMPERATURE
from pipeline.monitoring.replay_windows import CUT, CYCLES, FREE, MORNING, Series
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.si import DAY, HOUR
from pipeline.schema.twin_state import AXES
from pipeline.submodels.spindle.reruns import SINKS, ThermalRuns, factor

BEARINGS, LOAD = ("bearing_friction", "windage"), ("copper", "load_speed")
SENSOR = "sensor"
"""Candidate beside the sub-models: the measured channel itself is wrong."""
Estimate = Callable[[Floats], Any]
"""Estimate (W,) of a quantity's windows by the parameters of a part (P,), 0 for the champion's."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of the twin: its parameters in words, ``×`` before a factor, and its estimates."""

    submodel: str
    name: str
    words: tuple[str, ...]
    estimates: Mapping[str, Estimate]

    def parameters(self, p: Floats) -> dict[str, float]:
        """Parameters (P,) as they are read, by their words."""
        values = [float(factor(x)) if w[0] == "×" else float(x)
                  for w, x in zip(self.words, p, strict=True)]  # fmt: skip
        return {w: float(f"{x:.4g}") for w, x in zip(self.words, values, strict=True)}


def parts_of(
    series: Series, masks: Mapping[str, Bools], thermal: ThermalRuns | None, begin: float
) -> Iterator[Part]:
    """Parts that the quantities of a machine allow.

    ``masks`` (W,): windows of each quantity that count; ``begin`` [s]: when what stands begins.
    """
    friction, viscous = (_friction(series, begin, n_law=n_law) for n_law in (False, True))
    read: dict[str, Estimate] = {
        name: _times(series[name]) for name in (FREE, CUT) if name in series
    }
    if friction:
        yield Part("cutting", "no-load power", ("× no-load power", "× a day"), friction)
    if (cut := series.get(CUT)) is not None:
        here = cut[masks[CUT]] if CUT in masks else cut
        off = (here["measured"] - here["estimated"]).abs() / (here["high"] - here["estimated"])
        tool = str(off.groupby(here["tool_number"].astype(str)).sum().idxmax())
        own = (cut["tool_number"].astype(str) == tool).to_numpy()
        for name, where in ((f"force of tool {tool}", own), ("force of all tools", True)):
            yield Part("cutting", name, ("× load",), {CUT: _times(cut, where)})
    for axis in AXES:
        if (load := series.get(f"{axis}_load")) is not None:
            yield Part("drive", f"friction of {axis.upper()}", ("% of load", "% for each mm/s"),
                       {f"{axis}_load": _moving(load)})  # fmt: skip
        if (name := f"{axis}_following_error") in series:
            yield Part("drive", f"loop of {axis.upper()}", ("× lag",), {name: _times(series[name])})
    if (cycles := series.get(CYCLES)) is not None:
        yield Part("control", "cycle time", ("× time",), {CYCLES: _times(cycles)})
        slower = cycles["estimated"] / cycles["override"].fillna(1.0).clip(0.01)
        yield Part("control", "feed override", (), {CYCLES: lambda p: slower})
    if thermal is not None and thermal.runs:
        yield from _thermal(thermal, viscous, begin)
        yield from _sensor(series, thermal, begin)
        read[TEMPERATURE] = lambda p: thermal.estimate(
            lambda t: thermal.scaled(copper=-2 * p[0], load_speed=-p[0])
        )
    if read.keys() - {TEMPERATURE}:
        yield Part(SENSOR, "spindle load", ("× shown load",), read)


def _moving(load: pd.DataFrame) -> Estimate:
    return lambda p: load["estimated"] + p[0] + p[1] * load["speed"]


def _after(one: Estimate, first: int) -> Estimate:
    """An estimate by the parameters from ``first`` on."""
    return lambda p: one(p[first:])


def _times(table: pd.DataFrame, where: Any = True) -> Estimate:
    estimated = table["estimated"].to_numpy(float)
    return lambda p: np.where(where, factor(p[0]) * estimated, estimated)


def _friction(series: Series, begin: float, *, n_law: bool) -> dict[str, Estimate]:
    """No-load power, and load of cuts, by ln of a factor on the no-load power and its rise a day.

    ``n_law``: what is more goes with n^(5/3), as the friction of bearings does.
    """
    found: dict[str, Estimate] = {}
    for name in (FREE, CUT) if FREE in series and CUT in series else (FREE,) * (FREE in series):
        estimated, n, t = (series[name][k].to_numpy(float) for k in ("estimated", "speed", "t"))
        under = estimated if name == FREE else series[name]["under"].to_numpy(float)
        if n_law:
            under = under[np.argmax(n)] * (n / n.max()) ** (5 / 3)
        found[name] = _risen(estimated, under, _days(t, begin))
    return found


def _risen(estimated: Floats, under: Floats, days: Any) -> Estimate:
    return lambda p: estimated + under * (factor(p[0] + p[1] * days) - 1)


def _days(t: Any, begin: float) -> Any:
    """Whole days since what stands began, for times [s since 1970]."""
    return np.maximum(np.round((t - begin) / DAY), 0.0)


def _thermal(
    thermal: ThermalRuns, friction: Mapping[str, Estimate], begin: float
) -> Iterator[Part]:
    """Parts of the spindle: its cooling, its bearings, its whole network."""
    records = thermal.model.records
    sinks = ("coupling_rate",) if thermal.model.network.fixed_body else SINKS

    def grown(p: Floats, names: Sequence[str]) -> Floats:
        return thermal.estimate(
            lambda t: thermal.scaled(**dict.fromkeys(names, p[0] + p[1] * _days(t, begin)))
        )

    def every(p: Floats) -> Floats:
        ln = {name: p[k] for k, some in enumerate((sinks, BEARINGS, LOAD)) for name in some}
        return thermal.estimate(lambda t: thermal.scaled(0.0 if records.ambient else p[3], **ln))

    words = ("× no-load power", "× a day of that") if friction else ()
    yield Part("spindle", "cooling", ("× cooling", "× a day"),
               {TEMPERATURE: lambda p: grown(p, sinks)})  # fmt: skip
    yield Part("spindle", "bearings", ("× friction heat", "× a day", *words), {
        TEMPERATURE: lambda p: grown(p, BEARINGS),
        **{name: _after(one, 2) for name, one in friction.items()},
    })  # fmt: skip
    own = ("× cooling", "× friction heat", "× heat of the load") + ("K of air",) * (
        not records.ambient
    )
    yield Part("spindle", "network", (*own, *words), {
        TEMPERATURE: every,
        **{name: _after(one, len(own)) for name, one in friction.items()},
    })  # fmt: skip


def _sensor(series: Series, thermal: ThermalRuns, begin: float) -> Iterator[Part]:
    """A temperature that reads too much and more each hour, or always the same."""
    table, morning = series[TEMPERATURE], series.get(MORNING)
    middle = float(table["measured"].median())

    def more(of: pd.DataFrame, p: Floats) -> Any:
        hours = (of["t"].to_numpy() - begin) / HOUR
        return np.where(hours >= 0, p[0] + p[1] * hours, 0.0)

    drift: dict[str, Estimate] = {
        TEMPERATURE: lambda p: thermal.estimate(lambda t: thermal.scaled(), more(table, p))
    }
    same: dict[str, Estimate] = {TEMPERATURE: lambda p: np.full(len(table), middle + p[0])}
    if morning is not None:
        drift[MORNING] = lambda p: morning["estimated"] + more(morning, p)
        same[MORNING] = lambda p: middle + p[0] - morning["air"]
    yield Part(SENSOR, "temperature drift", ("K too much", "K more an hour"), drift)
    yield Part(SENSOR, "temperature stuck", (f"K above {middle:g} °C",), same)
