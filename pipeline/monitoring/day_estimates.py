"""Estimates of the champion for each row of a day of production records.

Spindle temperatures are those of the champion's own predictor, which the nights ask too.  It gives
a free run, which takes the measured temperature once a day, so that no slow fault is swallowed, and
windows of an hour.  The power of a cut is what the spindle's load says above the no-load power,

    P_c = eta P_motor - P_0(n),    F_t = P_c / v_c,    v_c = pi D n,

with P_0 as it was identified on this machine and D from its tool table (Twin2026).  The 90 %
interval holds the rounding of the load, the uncertainty of P_0, its drift with the temperature of
bearings on training days, and the load's scale, which P_0 shares.  The following error at constant
feed is e = v (1 - k_ff) / K_v (Sim2023).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.cutting import NoLoadPoint
from pipeline.schema.days import day_start
from pipeline.schema.si import MINUTE, NS
from pipeline.schema.twin_state import (
    AXES,
    CONTEXT,
    MODES,
    QUANTITIES,
    UNMEASURED,
    Coverage,
)
from pipeline.schema.verdict import widest
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands
from pipeline.submodels.cutting.spindle_load.levels import (
    BEYOND,
    LoadScale,
    resolution,
    settled,
)
from pipeline.submodels.spindle.days import FREE_RUN, WINDOWS

NORMAL_90, NORMAL_95 = 1.645, 1.960
"""Half widths of 90 % and 95 % intervals over the standard deviation of normal errors [1]."""
TOOL_CHANGE_S = 20.0
"""Time about a change of the tool's number that a tool change may take, chip to chip [s]."""
STEADY = 0.02
"""Share by which a feed may differ from those beside it to count as constant [1]."""
TEMPERATURES = {FREE_RUN: "spindle_temperature", WINDOWS: "spindle_temperature_windows"}
"""Quantity by the regime of the champion's prediction."""
Values = dict[str, Any]
"""Columns of a day by name, (T,) each."""
Reasons = dict[str, list[tuple[str, Any]]]
"""Why a quantity is not known, with the rows where it is so (all for True); the first counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpindlePower:
    """Conversion of a spindle's load into power at the tool, and its no-load power."""

    scale: LoadScale
    scale_error: float
    """Half of the 95 % interval of the scale, as a share [1]."""
    settle_s: float
    """Time of constant speed before a load counts [s]."""
    curve: tuple[NoLoadPoint, ...]
    """Identified no-load power."""
    drift: float = 0.0
    """Half of the 90 % interval of P_0 beyond its identification, as a share, on training days."""

    def no_load(self, n: Floats) -> tuple[Floats, Floats]:
        """P_0 and its standard deviation without that of the scale [W] at ``n`` (T,) [rev/s].

        NaN beyond the speeds of its identification.
        """
        points = {one.speed_rpm / MINUTE: one for one in self.curve}
        speeds = np.array(sorted(points))
        power, half = np.array(
            [(points[n].power_W, points[n].half_width_95_W) for n in speeds.tolist()]
        ).T
        inside = (n >= speeds[0] * (1 - BEYOND)) & (n <= speeds[-1] * (1 + BEYOND))
        own = np.sqrt(np.maximum(half**2 - (self.scale_error * power) ** 2, 0.0)) / NORMAL_95
        return np.where(inside, np.interp(n, speeds, power), np.nan), np.interp(n, speeds, own)


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimators:
    """What estimates a machine's quantities: sub-models that serve, and its tools."""

    serving: Mapping[str, ServingModel]
    cases: Mapping[str, Case]
    """Cases of the spindle's temperature by day."""
    power: SpindlePower | None
    diameters: Mapping[int, float]
    """Diameters of the machine's tools by their number [m]."""
    cleaning: CleanSettings
    """Rules of cleaning: when a spindle turns, and when a load is above that without a cut."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DayRows:
    """Rows of a day's clean table, T of them."""

    day: str
    table: pa.Table
    seconds: Floats
    """Time since the day's midnight [s]; shape (T,)."""
    period_s: float

    def number(self, name: str) -> Floats:
        """A column of numbers, NaN where it is not known or not recorded; shape (T,)."""
        if name not in self.table.column_names:
            return np.full(len(self.seconds), np.nan)
        return np.array(self.table[name].to_numpy(zero_copy_only=False), dtype=np.float64)

    def words(self, name: str) -> tuple[list[str], Any]:
        """Different words of a column, and the place of each row's among them, -1 for none."""
        if name not in self.table.column_names:
            return [], np.full(len(self.seconds), -1)
        coded = self.table[name].combine_chunks().dictionary_encode()
        return coded.dictionary.to_pylist(), pc.fill_null(coded.indices, -1).to_numpy()


def day_rows(clean: Path, day: str, zone: str, period_s: float) -> DayRows:
    """Rows of a day, those columns that the state needs."""
    path = clean / "state" / f"{day}.parquet"
    positions = [f"{axis}_{kind}" for axis in AXES for kind in ("position", "commanded_position")]
    wanted = {"time", "spindle_temperature", *CONTEXT, *positions}
    table = pq.read_table(path, columns=[n for n in pq.read_schema(path).names if n in wanted])
    since = table["time"].cast(pa.int64()).to_numpy() - day_start(day, zone)
    return DayRows(day=day, table=table, seconds=since / NS, period_s=period_s)


def day_state(
    rows: DayRows, segments: pa.Table, given: Estimators, *, sealed: bool = False
) -> tuple[Values, dict[str, Coverage]]:
    """Columns of a day and the coverage of each quantity."""
    settle_s = 1.5 if given.power is None else given.power.settle_s
    steady = settled(rows.seconds, rows.number("spindle_speed"), settle_s=settle_s)
    mode = modes(rows, segments, given.cleaning)
    values: Values = {
        name: rows.number(name) if unit else rows.table[name].combine_chunks()
        for name, unit in CONTEXT.items() if name in rows.table.column_names
    }  # fmt: skip
    values["spindle_steady"] = pa.array(steady, mask=np.isnan(rows.number("spindle_speed")))
    reasons: Reasons = {}
    for found, why in (
        temperatures(rows, given, sealed=sealed),
        spindle_powers(rows, given, steady, mode),
        following_errors(rows, given),
    ):
        values |= found
        reasons |= why
    values["mode"] = pa.DictionaryArray.from_arrays(
        pa.array(mode, pa.int32(), mask=mode < 0), pa.array(MODES)
    )
    coverage = {
        one.name: _coverage(values.get(f"{one.name}_estimated"), rows, reasons[one.name])
        for one in QUANTITIES
    }
    return values, coverage


def modes(rows: DayRows, segments: pa.Table, cleaning: CleanSettings) -> Any:
    """Place in :data:`MODES` of each row's mode, -1 where it is not known, (T,).

    That is the kind of the segment that a row lies in; a tool change is the stretch about a change
    of the tool's number in which the spindle stands and a program runs.
    """
    time = rows.table["time"].cast(pa.int64()).to_numpy()
    start, end = (segments[one].cast(pa.int64()).to_numpy() for one in ("start", "end"))
    kinds = [MODES.index(one) if one in MODES else -1 for one in segments["kind"].to_pylist()]
    place = np.searchsorted(start, time, side="right") - 1
    mode = np.full(len(time), -1)
    if len(kinds):
        mode = np.where((place >= 0) & (time < end[place]), np.array(kinds)[place], -1)
    _, tool = rows.words("tool_number")
    states, state = rows.words("execution")
    active = np.array([one == "ACTIVE" for one in states] + [not states])[state]
    stands = active & ~(np.abs(rows.number("spindle_speed")) > cleaning.turning_rpm)
    changed = np.flatnonzero((np.diff(tool) != 0) & (tool[1:] >= 0) & (tool[:-1] >= 0)) + 1
    at = rows.seconds[changed]
    inside = np.zeros(len(time) + 1)
    np.add.at(inside, np.searchsorted(rows.seconds, at - TOOL_CHANGE_S), 1)
    np.add.at(inside, np.searchsorted(rows.seconds, at + TOOL_CHANGE_S, side="right"), -1)
    near = stands & (np.cumsum(inside)[:-1] > 0) & (mode != MODES.index("cut"))
    mode[near] = MODES.index("tool_change")
    return mode


def temperatures(rows: DayRows, given: Estimators, *, sealed: bool) -> tuple[Values, Reasons]:
    """Spindle temperature as the champion predicts it, each value held over the model's step."""
    measured = rows.number("spindle_temperature")
    values: Values = {"spindle_temperature_measured": measured}
    serving, case = given.serving.get("spindle"), given.cases.get(rows.day)
    everywhere = True
    if serving is None:
        why = "no model of the spindle's temperature serves"
    elif sealed or case is None:
        why = "a sealed day is not looked at"
    else:
        everywhere, why = False, ""
        try:
            found = serving.predictor(case)
            frame, why = found.frame, found.note
        except ValueError as error:
            why = str(error)
        everywhere = bool(why)
        if not why:
            factor = widest(case.conditions, serving.model.conditions)
            lacks = interval_lacks(serving)
            for regime, name in TEMPERATURES.items():
                of = frame[frame["regime"] == regime]
                own = _held(of, rows.seconds, factor)
                own = {part: own[part] for part in own if part == "estimated" or name not in lacks}
                values |= {f"{name}_{part}": one for part, one in own.items()}
                values[f"{name}_residual"] = measured - own["estimated"]
    return values, {
        name: [(why, everywhere), ("speed, load or temperature not known", True)]
        for name in TEMPERATURES.values()
    }


def interval_lacks(serving: ServingModel | None) -> dict[str, str]:
    """Why the interval of a temperature is not known, by the name of the quantity."""
    if serving is None:
        return {}
    why = serving.verdict.unknown_intervals
    lacks = {name: why[TEMPERATURES[FREE_RUN], regime] for regime, name in TEMPERATURES.items()
             if (TEMPERATURES[FREE_RUN], regime) in why}  # fmt: skip
    if serving.model.intervals is None:  # type: ignore[attr-defined]
        lacks = dict.fromkeys(TEMPERATURES.values(), "one training day calibrates no interval")
    return lacks


def _held(of: Any, seconds: Floats, factor: float) -> Values:
    """Predictions of one regime at ``seconds`` (T,), with an interval ``factor`` times as wide."""
    t, estimated = of["t"].to_numpy(float), of["predicted"].to_numpy(float)
    step = float(np.diff(t).min()) if len(t) > 1 else np.inf
    place = np.searchsorted(t, seconds + 1e-6, side="right") - 1
    here = (place >= 0) & (seconds - t[place] < step)
    found = {"estimated": np.where(here, estimated[place], np.nan)}
    for end in ("low", "high"):
        if end in of:
            wide = estimated + factor * (of[end].to_numpy(float) - estimated)
            found[end] = np.where(here, wide[place], np.nan)
    return found


def spindle_power(serving: ServingModel | None) -> SpindlePower | None:
    """Power of the spindle that the champion's cutting model identified; None where it did not."""
    records = None if serving is None else serving.judging.cutting_records.spindle
    facts = None if serving is None else serving.model.spindle  # type: ignore[attr-defined]
    if records is None or facts is None or len(facts.curve) < 2:
        return None
    return SpindlePower(scale=records.scale, scale_error=records.scale_error,
                        settle_s=records.settle_s, curve=facts.curve)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerRows:
    """Power of the spindle at the tool in the rows of a day, (T,) each [W]."""

    known: Bools
    fast: Bools
    """Rows with speed and load, and those of them at the minimum speed or above."""
    steady: Bools
    at_tool: Floats
    no_load: Floats
    """Power by the load, and the no-load power at the speed, NaN where it was not identified."""
    deviation: Floats
    """Standard deviation of their difference, but for the scale of the load."""
    speed: Floats
    """[rev/s]."""
    free: Bools
    """Rows in which the spindle turns and nothing is fed, so that nothing can be cut."""

    @property
    def defined(self) -> Bools:
        """Rows in which the power at the tool is defined."""
        return self.known & self.fast & self.steady & np.isfinite(self.no_load)


def power_rows(rows: DayRows, power: SpindlePower, steady: Bools, mode: Any) -> PowerRows:
    """Power of the spindle in the rows of a day."""
    load = np.abs(rows.number("spindle_load"))
    n = np.abs(rows.number("spindle_speed")) / MINUTE
    known = np.isfinite(load) & np.isfinite(n)
    no_load, own = power.no_load(n)
    step = power.scale.power(resolution(load[known]), n)
    feed = rows.number("path_feedrate")
    still = mode == MODES.index("air") if np.isnan(feed).all() else feed == 0
    return PowerRows(
        known=known, fast=n >= power.scale.drive.minimum_speed, steady=steady, no_load=no_load,
        at_tool=power.scale.power(load, n), deviation=np.hypot(step / np.sqrt(12), own), speed=n,
        free=still & (mode != MODES.index("cut")),
    )  # fmt: skip


def with_drift(
    power: SpindlePower, days: Iterable[DayRows], segments: pa.Table, cleaning: CleanSettings
) -> SpindlePower:
    """The power with the drift of its no-load power over training ``days``, two at least."""
    found = []
    for rows in days:
        steady = settled(rows.seconds, rows.number("spindle_speed"), settle_s=power.settle_s)
        one = power_rows(rows, power, steady, modes(rows, segments, cleaning))
        chosen = one.defined & one.free
        error = np.abs(one.at_tool - one.no_load) - NORMAL_90 * one.deviation
        share = np.maximum(error[chosen], 0.0) / one.no_load[chosen]
        found.append(Residuals(
            error=share, regime=np.full(len(share), ""), group=np.full(len(share), rows.day),
            t=rows.seconds[chosen],
        ))  # fmt: skip
    if sum(len(one.error) > 0 for one in found) < 2:
        return power
    return replace(power, drift=bands(Residuals.joined(found))[ALL_REGIMES].upper)


def spindle_powers(
    rows: DayRows, given: Estimators, steady: Bools, mode: Any
) -> tuple[Values, Reasons]:
    """No-load power, cutting power and tangential force where they are defined.

    Air whose power is above the no-load power for sure becomes a cut in ``mode``: the log's own
    level, a low quantile of the loads at a speed, hides it where a speed is only cut at.
    """
    names = ("no_load_power", "cutting_power", "tangential_force")
    power = given.power
    if power is None:
        why = "no model with the spindle's no-load power serves"
        return {}, {name: [(why, True)] for name in names}
    one = power_rows(rows, power, steady, mode)
    above, cutting = one.at_tool - one.no_load, MODES.index("cut")
    half_free = NORMAL_90 * one.deviation + power.drift * one.no_load
    half = np.hypot(half_free, NORMAL_90 / NORMAL_95 * power.scale_error * above)
    margin = power.scale.power(given.cleaning.load_margin, one.speed)
    fed = one.defined & ~one.free & (mode == MODES.index("air"))
    mode[fed & (above - half > margin)] = cutting
    cut, free = one.defined & (mode == cutting), one.defined & one.free
    words, place = rows.words("tool_number")
    diameter = np.array([given.diameters.get(tool_of(word), np.nan) for word in words] + [np.nan])
    speed = np.pi * diameter[place] * one.speed
    with np.errstate(divide="ignore", invalid="ignore"):
        force, width = np.where(cut, above / speed, np.nan), half / speed
    values = {
        "no_load_power_measured": np.where(free, one.at_tool, np.nan),
        **_interval("no_load_power", np.where(free, one.no_load, np.nan), half_free),
        "no_load_power_residual": np.where(free, above, np.nan),
        **_interval("cutting_power", np.where(cut, above, np.nan), half),
        **_interval("tangential_force", force, width),
    }
    common = [
        ("speed or load not known", ~one.known), ("spindle stands", ~(one.speed > 0)),
        ("spindle below its minimum speed", ~one.fast), ("spindle's speed changes", ~steady),
        ("speed beyond those of the no-load power", np.isnan(one.no_load)),
    ]  # fmt: skip
    no_cut = ("no cut", mode != cutting)
    return values, {
        "no_load_power": [*common, ("fed, so that it may cut", True)],
        "cutting_power": [no_cut, *common],
        "tangential_force": [no_cut, *common, ("tool not in the tool table", True)],
    }  # fmt: skip


def tool_of(word: str) -> int:
    """Number of a tool by the word of a log, ``"T04"`` or ``"4"``; -1 where it has none.

    >>> tool_of("T04"), tool_of("12.0"), tool_of("probe")
    (4, 12, -1)
    """
    found = re.search(r"\d+", word)
    return int(found.group()) if found else -1


def following_errors(rows: DayRows, given: Estimators) -> tuple[Values, Reasons]:
    """Following error of each axis that is logged as commanded and as it is."""
    values: Values = {}
    reasons: Reasons = {}
    serving = given.serving.get("drive")
    for axis in AXES:
        name = f"{axis}_following_error"
        command = rows.number(f"{axis}_commanded_position")
        error = command - rows.number(f"{axis}_position")
        known = {} if serving is None else serving.model.parameters.get(axis.upper(), {})
        gain, forward = known.get("loop_gain"), known.get("velocity_feedforward")
        reasons[name] = [("commanded and actual position not logged", bool(np.isnan(error).all()))]
        if not np.isfinite(error).any():
            continue
        values[f"{name}_measured"] = error
        if gain is None or gain.value is None:
            reasons[name].append(("no model of the axis with its loop gain serves", True))
            continue
        share = 1.0 - (forward.value or 0.0 if forward is not None else 0.0)
        v, even = _velocity(rows.seconds, command, rows.period_s)
        estimated = np.where(even, v * share / gain.value, np.nan)
        low, high = gain.interval_95 or (gain.value, gain.value)
        spread = (high - low) / (2 * NORMAL_95) / gain.value
        ends = (forward.interval_95 if forward is not None else None) or (0.0, 0.0)
        other = (ends[1] - ends[0]) / (2 * NORMAL_95)
        half = NORMAL_90 * np.abs(v) / gain.value * np.hypot(share * spread, other)
        values |= _interval(name, estimated, half)
        values[f"{name}_residual"] = error - estimated
        reasons[name].append(("axis stands or its feed changes", True))
    return values, reasons


def _velocity(seconds: Floats, command: Floats, period_s: float) -> tuple[Floats, Bools]:
    """Commanded velocity (T,) in the unit of the command by 1 s, and whether it is constant."""
    v = np.full(len(command), np.nan)
    step = np.diff(seconds)
    v[1:] = np.where(step < 1.5 * period_s, np.diff(command) / np.maximum(step, 1e-9), np.nan)
    after = np.append(v[1:], np.nan)
    even = (np.abs(v - after) <= STEADY * np.abs(v)) & (np.abs(v) > 0)
    return v, even


def _interval(name: str, estimated: Floats, half: Floats) -> Values:
    ends = (estimated, estimated - half, estimated + half)
    return {f"{name}_{part}": one for part, one in zip(UNMEASURED, ends, strict=True)}


def _coverage(
    estimated: Floats | None, rows: DayRows, reasons: Sequence[tuple[str, Any]]
) -> Coverage:
    """Time over which a quantity is estimated, and elsewhere the first reason that holds."""
    left = np.ones(len(rows.seconds), bool) if estimated is None else ~np.isfinite(estimated)
    known = len(left) - int(left.sum())
    unknown = {}
    for why, where in reasons:
        here = left & where
        if count := int(here.sum()):
            unknown[why] = round(count * rows.period_s, 3)
        left = left & ~here
    return Coverage(known_s=round(known * rows.period_s, 3), unknown_s=unknown)
