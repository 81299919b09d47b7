"""Parts of the twin that a replay replaces in turn, each with its own parameters.

Sub-model by sub-model: the spindle's network (cooling, friction of bearings, heat of the load), the
cutting sub-model's no-load power and force, the drive's friction and loop gain, the control's
cycle time; beside them the sensors, since a residual may be the measured channel's.  The thermal
network runs again over each day; the champion's forest stays as it is.  A sensor that reads b too
much starts the network b too high, and reads that of the network plus b.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pipeline.monitoring.day_estimates import TEMPERATURE
from pipeline.monitoring.nightly import ServingModel
from pipeline.monitoring.replay_windows import CUT, MORNING, Series
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.replay import SENSOR
from pipeline.schema.si import DAY, HOUR, NS
from pipeline.schema.twin_state import AXES
from pipeline.signals.windows import StateSegment, read_state
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import TARGET, SpindleModelFile, free_run, spindle_stretches

SINKS = ("cooling_rate", "body_cooling_rate", "coolant_rate")
BEARINGS, LOAD_HEAT = ("bearing_friction", "windage"), ("copper", "load_speed")
FACTOR = (0.02, 50.0)
"""Least and greatest factor on a parameter [1]."""
Estimate = Callable[[Floats], Floats]
"""Estimate (W,) of a quantity's windows by the parameters of a part (P,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """A part of the twin: its parameters, and the estimates that it makes of some quantities."""

    submodel: str
    name: str
    parameters: tuple[str, ...]
    """Parameters in words."""
    start: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Parameters of the champion, and their least and greatest values; shape (P,)."""
    estimates: Mapping[str, Estimate]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThermalRuns:
    """Free runs of the champion's network over days, beside the windows of the temperature."""

    model: SpindleModelFile
    table: pd.DataFrame
    runs: Sequence[tuple[StateSegment, Any, Any, Floats]]
    """Stretch of each day, places of its windows in the table, their steps, the network's run."""
    begin: float
    """When what stands begins [s since 1970]."""

    @classmethod
    def of(
        cls,
        serving: ServingModel,
        table: pd.DataFrame,
        clean: Path,
        days: Sequence[str],
        begin: float,
    ) -> "ThermalRuns":
        """Runs over ``days``; a day that the network cannot run over has none."""
        model, runs = serving.model, []
        for day in sorted(set(days) & set(table["day"])):
            found = list(spindle_stretches(
                read_state(clean, day), day, model.records, step=model.fit.step_s, bridge_s=np.inf,
                shortest_s=0.0,
            ))  # fmt: skip
            for one in found[:1]:
                places = np.flatnonzero(table["day"] == day)
                time = pd.DatetimeIndex(one.frame.index).as_unit("ns").asi8 / NS
                steps = np.searchsorted(time, table["t"].to_numpy()[places], side="right") - 1
                known = free_run(one, model.records, model.network)[0]
                runs.append((one, places, np.maximum(steps, 0), known))
        return cls(model=model, table=table, runs=runs, begin=begin)

    def estimate(
        self, network: Callable[[float], SpindleThermalParameters], offset: Floats | None = None
    ) -> Floats:
        """Estimate (W,) [degC] by other networks, by the whole days since the begin.

        ``offset`` (W,): what the sensor reads too much [K].
        """
        found: Floats = self.table["estimated"].to_numpy(float, copy=True)
        for one, places, steps, known in self.runs:
            begin = 0.0 if offset is None else float(offset[places[0]])
            frame = one.frame.assign(**{TARGET: one.frame[TARGET] - begin}) if begin else one.frame
            since = float(self.table["t"].iat[places[0]]) - self.begin
            days = max(round(since / DAY), 0)
            run = free_run(replace(one, frame=frame), self.model.records, network(days))[0]
            found[places] += (run - known)[steps]
        return found if offset is None else found + offset

    def scaled(self, **factors: float) -> SpindleThermalParameters:
        """The champion's network with factors on its rates and heat sources."""
        network = self.model.network
        rates = {k: v * getattr(network, k) for k, v in factors.items() if hasattr(network, k)}
        heating = {k: v * factors.get(k, 1.0) for k, v in network.heating.items()}
        return replace(network, heating=heating, **rates)


def parts_of(
    series: Series, masks: Mapping[str, Bools], thermal: ThermalRuns | None, begin: float
) -> list[Part]:  # fmt: skip
    """Parts that the quantities of a machine allow.

    ``masks`` (W,): windows of each quantity that count; ``begin`` [s]: when what stands begins.
    """
    found = [*_cut(series, masks, thermal, begin), *_motion(series)]
    if thermal is not None and thermal.runs:
        found += _thermal(series, thermal, begin)
    return found


def _factors(
    submodel: str, name: str, words: Sequence[str], estimates: Mapping[str, Estimate],
    grows: Sequence[str] = (),
) -> Part:  # fmt: skip
    """A part of factors on the champion's parameters, and then of their growth in a day."""
    n, m = len(words), len(grows)
    return Part(
        submodel=submodel, name=name, estimates=estimates,
        parameters=(*(f"{one} over the champion’s" for one in words),
                    *(f"growth of {one} a day, ln" for one in grows)),
        start=(1.0,) * n + (0.0,) * m, low=FACTOR[:1] * n + (-2.0,) * m,
        high=FACTOR[1:] * n + (2.0,) * m,
    )  # fmt: skip


def _times(table: pd.DataFrame, where: Any = True) -> Estimate:
    estimated = table["estimated"].to_numpy(float)
    return lambda p: np.where(where, p[0] * estimated, estimated)


def _thermal(series: Series, thermal: ThermalRuns, begin: float) -> Iterator[Part]:
    network, table, records = thermal.model.network, series[TEMPERATURE], thermal.model.records
    sinks = ("coupling_rate",) if network.fixed_body else SINKS

    def by(p: Floats, *names: Sequence[str]) -> Floats:
        """With factors p[k] exp(p[n + k] days) on n groups of parameters."""
        n = len(names)
        return thermal.estimate(lambda days: thermal.scaled(**{
            name: float(p[k] * np.exp(p[n + k] * days))
            for k, some in enumerate(names) for name in some
        }))  # fmt: skip

    yield _factors("spindle", "cooling", ("cooling",),
                   {TEMPERATURE: lambda p: by(p, sinks)}, ("cooling",))  # fmt: skip
    friction = _friction(series, begin, viscous=True)
    if any(network.heating.get(name) for name in BEARINGS):
        both = ("friction heat", "no-load power")[: 2 if friction else 1]
        yield _factors("spindle", "bearings", both, {
            TEMPERATURE: lambda p: by(p[:: len(both)], BEARINGS),
            **{name: lambda p, one=one: one(p[1::2]) for name, one in friction.items()},
        }, both)  # fmt: skip
    if any(network.heating.get(name) for name in LOAD_HEAT):
        yield _factors("spindle", "heat of the load", ("heat of the load",),
                       {TEMPERATURE: lambda p: by(p, LOAD_HEAT)}, ("the same",))  # fmt: skip
        every = ("cooling", "friction heat", "heat of the load")
        yield _factors("spindle", "network", (*every, "no-load power")[: 3 + bool(friction)], {
            TEMPERATURE: lambda p: by(np.append(p[:3], [0.0] * 3), sinks, BEARINGS, LOAD_HEAT),
            **{name: lambda p, one=one: one(p[3:]) for name, one in friction.items()},
        }, ("no-load power",) * bool(friction))  # fmt: skip
    if not records.ambient:
        yield Part(
            submodel="spindle", name="surround", parameters=("air or oil above the champion’s, K",),
            start=(0.0,), low=(-40.0,), high=(40.0,),
            estimates={TEMPERATURE: lambda p: thermal.estimate(
                lambda days: replace(network, ambient=network.ambient + p[0]))},
        )  # fmt: skip
    yield from _sensor(series, thermal, begin)


def _sensor(series: Series, thermal: ThermalRuns, begin: float) -> Iterator[Part]:
    """A temperature that reads too much, more and more, or the same."""

    def offset(table: pd.DataFrame, p: Floats) -> Floats:
        hours = (table["t"].to_numpy() - begin) / HOUR
        return np.where(hours >= 0, p[0] + p[-1] * hours * (len(p) > 1), 0.0)

    def part(name: str, words: tuple[str, ...], most: tuple[float, ...]) -> Part:
        low, n = tuple(-one for one in most), len(words)
        table, morning = series[TEMPERATURE], series.get(MORNING)
        found: dict[str, Estimate] = {
            TEMPERATURE: lambda p: thermal.estimate(
                lambda days: thermal.model.network, offset(table, p))
        }  # fmt: skip
        if morning is not None:
            found[MORNING] = lambda p: morning["estimated"].to_numpy(float) + offset(morning, p)
        return Part(submodel=SENSOR, name=name, parameters=words, start=(0.0,) * n, low=low,
                    high=most, estimates=found)  # fmt: skip

    yield part("temperature offset", ("reads too much, K",), (200.0,))
    yield part("temperature drift", ("reads too much at the begin, K", "more in an hour, K"),
               (200.0, 20.0))  # fmt: skip
    table, morning = series[TEMPERATURE], series.get(MORNING)
    same: dict[str, Estimate] = {TEMPERATURE: lambda p: np.full(len(table), p[0])}
    if morning is not None:  # what the sensor says, above the air of that morning
        same[MORNING] = lambda p: p[0] - morning["air"].to_numpy(float)
    yield Part(submodel=SENSOR, name="temperature stuck", parameters=("reads, °C",),
               start=(float(table["measured"].median()),), low=(-300.0,), high=(3000.0,),
               estimates=same)  # fmt: skip


def _friction(series: Series, begin: float, *, viscous: bool) -> dict[str, Estimate]:
    """No-load power, and load of cuts, by a factor on the no-load power and its growth in a day.

    ``viscous``: what is more goes with n^(5/3), as the friction of bearings does.
    """
    found: dict[str, Estimate] = {}
    for name in ("no_load_power", CUT):
        if (table := series.get(name)) is None or "no_load_power" not in series:
            continue
        estimated, n, t = (table[k].to_numpy(float) for k in ("estimated", "speed", "t"))
        under = estimated if name != CUT else table["under"].to_numpy(float)
        if viscous and len(table):
            fastest = int(np.argmax(n))
            under = under[fastest] * (np.abs(n) / np.abs(n[fastest])) ** (5 / 3)
        days = np.maximum(t - begin, 0.0) // DAY

        def more(
            p: Floats, e: Floats = estimated, under: Floats = under, days: Floats = days
        ) -> Floats:
            return e + under * (p[0] * np.exp(p[1] * days) - 1)

        found[name] = more
    return found


def _cut(
    series: Series, masks: Mapping[str, Bools], thermal: ThermalRuns | None, begin: float
) -> Iterator[Part]:  # fmt: skip
    free, cut = series.get("no_load_power"), series.get(CUT)
    if friction := _friction(series, begin, viscous=False):
        yield _factors("cutting", "no-load power", ("no-load power",), friction, ("the same",))
    read: dict[str, Estimate] = {} if free is None else {"no_load_power": _times(free)}
    if cut is not None:
        here = cut[masks[CUT]] if CUT in masks else cut
        off = (here["measured"] - here["estimated"]).abs() / (here["high"] - here["estimated"])
        worst = off.groupby(here["tool_number"].astype(str)).sum()
        tool = str(worst.idxmax())
        for name, where in ((f"force of tool {tool}", cut["tool_number"].astype(str) == tool),
                            ("force of all tools", np.ones(len(cut), dtype=bool))):  # fmt: skip
            yield _factors("cutting", name, ("load",), {CUT: _times(cut, np.asarray(where))})
        read[CUT] = _times(cut)
    if thermal is not None and thermal.runs:
        read[TEMPERATURE] = lambda p: thermal.estimate(
            lambda days: thermal.scaled(copper=p[0] ** -2.0, load_speed=1.0 / p[0])
        )
    if read.keys() - {TEMPERATURE}:
        yield _factors(SENSOR, "spindle load", ("shown load",), read)


def _motion(series: Series) -> Iterator[Part]:
    for axis in AXES:
        if (load := series.get(f"{axis}_load")) is not None:
            estimated, v = (load[name].to_numpy(float) for name in ("estimated", "speed"))
            yield Part(
                submodel="drive", name=f"friction of {axis.upper()}", start=(0.0, 0.0),
                parameters=("more load while it moves, %", "more load for each mm/s, %"),
                low=(-200.0, -10.0), high=(200.0, 10.0),
                estimates={f"{axis}_load": lambda p, e=estimated, v=v: e + p[0] + p[1] * v},
            )  # fmt: skip
        name = f"{axis}_following_error"
        if name in series:
            yield _factors("drive", f"loop of {axis.upper()}", ("lag",),
                          {name: _times(series[name])})  # fmt: skip
    if (cycles := series.get("cycle_time")) is not None:
        yield _factors("control", "cycle time", ("time",),
                      {"cycle_time": _times(cycles)})  # fmt: skip
        share = cycles["override"].fillna(1.0).clip(0.01).to_numpy(float)
        slower = cycles["estimated"].to_numpy(float) / share
        yield Part(submodel="control", name="feed override", parameters=(), start=(), low=(),
                   high=(), estimates={"cycle_time": lambda p: slower})  # fmt: skip
