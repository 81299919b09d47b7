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
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.cutting import NoLoadPoint
from pipeline.schema.si import MINUTE
from pipeline.schema.twin_state import AXES, CONTEXT, MODES
from pipeline.schema.verdict import widest
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands
from pipeline.submodels.cutting.settings import SpindleLoadRecords
from pipeline.submodels.cutting.spindle_load.levels import BEYOND, NORMAL, resolution, settled
from pipeline.submodels.spindle.days import FREE_RUN, WINDOWS

NORMAL_90 = 1.645
"""Half of a 90 % interval of a normal distribution over its standard deviation [1]."""
TOOL_CHANGE_S = 20.0
"""Time about a change of the tool's number that a tool change may take, chip to chip [s]."""
STEADY = 0.02
"""Share by which a feed may differ from those beside it to count as constant [1]."""
CUT, AIR = MODES.index("cut"), MODES.index("air")
TEMPERATURES = {FREE_RUN: "spindle_temperature", WINDOWS: "spindle_temperature_windows"}
"""Quantity by the regime of the champion's prediction."""
Reasons = dict[str, list[tuple[str, Any]]]
Estimates = tuple[dict[str, Any], Reasons]
"""Columns (T,) by name; for each quantity the reasons why it is not known with their rows, True
for all, of which the first counts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SpindlePower:
    """Power of the spindle at the tool by its load, and its identified no-load power."""

    records: SpindleLoadRecords
    curve: tuple[NoLoadPoint, ...]
    drift: float = 0.0
    """Half of the 90 % interval of P_0 beyond its identification, as a share, on training days."""

    def no_load(self, n: Floats) -> tuple[Floats, Floats]:
        """P_0, NaN beyond its speeds, and its deviation without the scale's [W]; n (T,) [rev/s]."""
        points = {one.speed_rpm / MINUTE: one for one in self.curve}
        speeds = np.array(sorted(points))
        power, half = np.array([(points[v].power_W, points[v].half_width_95_W) for v in speeds]).T
        inside = (n >= speeds[0] * (1 - BEYOND)) & (n <= speeds[-1] * (1 + BEYOND))
        own = np.sqrt(np.maximum(half**2 - (self.records.scale_error * power) ** 2, 0.0)) / NORMAL
        return np.where(inside, np.interp(n, speeds, power), np.nan), np.interp(n, speeds, own)


def spindle_power(serving: ServingModel | None) -> SpindlePower | None:
    """Power of the spindle that the champion's cutting model identified; None where it did not."""
    model: Any = None if serving is None else serving.model
    if serving is None or model.spindle is None or len(model.spindle.curve) < 2:
        return None
    return SpindlePower(records=serving.judging.cutting_records.spindle, curve=model.spindle.curve)


@dataclass(frozen=True, kw_only=True, eq=False)
class DayRows:
    """Rows of a day's clean table, T of them, with the place of each one's mode in ``MODES``."""

    day: str
    table: pa.Table
    seconds: Floats
    """Time since the day's midnight [s]; shape (T,)."""
    segments: pa.Table
    cleaning: CleanSettings

    def number(self, name: str) -> Floats:
        """A column of numbers, NaN where it is not known or not recorded; shape (T,)."""
        if name not in self.table.column_names:
            return np.full(len(self.seconds), np.nan)
        return np.array(self.table[name].to_numpy(zero_copy_only=False), dtype=np.float64)

    def words(self, name: str) -> tuple[list[str], Any]:
        """Different words of a column, and the place of each row's among them, -1 for none."""
        if name not in self.table.column_names:
            return [], np.full(len(self.seconds), -1)
        coded = self.table[name].combine_chunks().cast(pa.string()).dictionary_encode()
        return coded.dictionary.to_pylist(), pc.fill_null(coded.indices, -1).to_numpy()

    def modes(self) -> Any:
        """Place in ``MODES`` of each row's mode, -1 where it is not known; shape (T,).

        That is the kind of its segment; a tool change is where the spindle stands in a running
        program about a change of the tool's number.
        """
        time = self.table["time"].cast(pa.int64()).to_numpy()
        start, end = (self.segments[k].cast(pa.int64()).to_numpy() for k in ("start", "end"))
        kinds = [MODES.index(k) if k in MODES else -1 for k in self.segments["kind"].to_pylist()]
        place = np.searchsorted(start, time, side="right") - 1
        inside = (place >= 0) & (time < np.append(end, 0)[place])
        mode = np.where(inside, np.array([*kinds, -1])[place], -1)
        (_, tool), (states, state) = self.words("tool_number"), self.words("execution")
        active = np.array([one == "ACTIVE" for one in states] + [not states])[state]
        turns = np.abs(self.number("spindle_speed")) > self.cleaning.turning_rpm
        changed = np.flatnonzero((np.diff(tool) != 0) & (tool[1:] >= 0) & (tool[:-1] >= 0)) + 1
        near = np.zeros(len(time) + 1)
        for by in (1, -1):
            at = self.seconds[changed] - by * TOOL_CHANGE_S
            np.add.at(near, np.searchsorted(self.seconds, at), by)
        changing = (np.cumsum(near)[:-1] > 0) & active & ~turns & (mode != CUT)
        return np.where(changing, MODES.index("tool_change"), mode)


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimators:
    """What estimates a machine's quantities: sub-models that serve, and its tools."""

    serving: Mapping[str, ServingModel]
    cases: Mapping[str, Case]
    """Cases of the spindle's temperature by day, but for sealed ones."""
    power: SpindlePower | None
    diameters: Mapping[int, float]
    """Diameters of the machine's tools by their number [m]."""


def day_state(rows: DayRows, given: Estimators) -> Estimates:
    """Columns of a day's state, and why its quantities are not known elsewhere."""
    mode = rows.modes()
    settle_s = given.power.records.settle_s if given.power else SpindleLoadRecords.settle_s
    steady = settled(rows.seconds, rows.number("spindle_speed"), settle_s=settle_s)
    values = {name: rows.number(name) if unit else rows.table[name].combine_chunks()
              for name, unit in CONTEXT.items() if name in rows.table.column_names}  # fmt: skip
    reasons: Reasons = {}
    for found, why in (temperatures(rows, given), spindle_powers(rows, given, steady, mode),
                       following_errors(rows, given.serving.get("drive"))):  # fmt: skip
        values |= found
        reasons |= why
    values["spindle_steady"] = steady
    values["mode"] = pa.DictionaryArray.from_arrays(
        pa.array(mode, pa.int32(), mask=mode < 0), pa.array(MODES)
    )
    return values, reasons


def temperatures(rows: DayRows, given: Estimators) -> Estimates:
    """Spindle temperature as the champion predicts it, each value held over the model's step."""
    measured = rows.number("spindle_temperature")
    values = {"spindle_temperature_measured": measured}
    serving, case = given.serving.get("spindle"), given.cases.get(rows.day)
    why = "no model serves" if serving is None else "sealed: not looked at"
    if serving is not None and case is not None:
        try:
            found = serving.predictor(case)
            why = found.note
        except ValueError as error:
            why = str(error)
        lacks = intervals_unknown(serving)
        factor = widest(case.conditions, serving.model.conditions)
        for regime, name in TEMPERATURES.items() if not why else ():
            of = found.frame[found.frame["regime"] == regime]
            t, estimated = of["t"].to_numpy(float), of["predicted"].to_numpy(float)
            place = np.searchsorted(t, rows.seconds + 1e-6, side="right") - 1
            step = np.diff(t, append=np.inf).min()
            here = (place >= 0) & (rows.seconds - t[place] < step)
            for part in ("low", "high") if name not in lacks else ():
                wide = estimated + factor * (of[part].to_numpy(float) - estimated)
                values[f"{name}_{part}"] = np.where(here, wide[place], np.nan)
            values[f"{name}_estimated"] = np.where(here, estimated[place], np.nan)
            values[f"{name}_residual"] = measured - values[f"{name}_estimated"]
    reason = why or "speed, load or temperature not known"
    return values, {name: [(reason, True)] for name in TEMPERATURES.values()}


def intervals_unknown(serving: ServingModel | None) -> dict[str, str]:
    """Why the interval of a temperature is not known, by the name of the quantity."""
    model: Any = None if serving is None else serving.model
    if serving is None or model.intervals is None:
        why = "no interval: it takes two training days" if serving else ""
        return dict.fromkeys(TEMPERATURES.values(), why) if serving else {}
    known = serving.verdict.unknown_intervals
    return {name: known[TEMPERATURES[FREE_RUN], regime] for regime, name in TEMPERATURES.items()
            if (TEMPERATURES[FREE_RUN], regime) in known}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class PowerRows:
    """Power of the spindle at the tool in the rows of a day; shape (T,) each."""

    n: Floats
    """Speed [rev/s]."""
    above: Floats
    no_load: Floats
    """Power above the no-load power, and that power [W]; NaN where they are not known."""
    half: Floats
    """Half of the 90 % interval of their difference, but for the load's scale [W]."""
    defined: Bools
    free: Bools
    """Rows in which the power is defined, and those of them in which nothing is fed to cut."""


def power_rows(rows: DayRows, power: SpindlePower, steady: Bools, mode: Any) -> PowerRows:
    """Power of the spindle in the rows of a day."""
    load = np.abs(rows.number("spindle_load"))
    n, scale = np.abs(rows.number("spindle_speed")) / MINUTE, power.records.scale
    no_load, own = power.no_load(n)
    step = scale.power(resolution(load[np.isfinite(load)]), n) / np.sqrt(12)
    above = scale.power(load, n) - no_load
    feed = rows.number("path_feedrate")
    still = mode == AIR if np.isnan(feed).all() else feed == 0
    defined = steady & (n >= scale.drive.minimum_speed) & np.isfinite(above)
    half = NORMAL_90 * np.hypot(step, own) + power.drift * no_load
    return PowerRows(n=n, above=above, no_load=no_load, half=half, defined=defined,
                     free=defined & still & (mode != CUT))  # fmt: skip


def with_drift(power: SpindlePower, days: Iterable[DayRows]) -> SpindlePower:
    """The power with the drift of its no-load power over training ``days``, two at least."""
    found = []
    for rows in days:
        steady = settled(
            rows.seconds, rows.number("spindle_speed"), settle_s=power.records.settle_s
        )
        one = power_rows(rows, power, steady, rows.modes())
        over = np.maximum(np.abs(one.above) - one.half, 0.0)[one.free] / one.no_load[one.free]
        words = np.full(len(over), ""), np.full(len(over), rows.day)
        found.append(Residuals(error=over, regime=words[0], group=words[1],
                               t=rows.seconds[one.free]))  # fmt: skip
    if sum(len(one.error) > 0 for one in found) < 2:
        return power
    return replace(power, drift=bands(Residuals.joined(found))[ALL_REGIMES].upper)


def spindle_powers(rows: DayRows, given: Estimators, steady: Bools, mode: Any) -> Estimates:
    """No-load power, cutting power and tangential force where they are defined.

    Air whose power is surely above the no-load power becomes a cut in ``mode``: the log's own
    level, a low quantile of the loads at a speed, hides it where a speed is only cut at.
    """
    power, names = given.power, ("no_load_power", "cutting_power", "tangential_force")
    if power is None:
        return {}, {name: [("no model with a no-load power serves", True)] for name in names}
    one = power_rows(rows, power, steady, mode)
    half = np.hypot(one.half, NORMAL_90 / NORMAL * power.records.scale_error * one.above)
    margin = power.records.scale.power(rows.cleaning.load_margin, one.n)
    mode[one.defined & ~one.free & (mode == AIR) & (one.above - half > margin)] = CUT
    cut = one.defined & (mode == CUT)
    words, place = rows.words("tool_number")
    diameter = np.array([given.diameters.get(tool_of(word), np.nan) for word in words] + [np.nan])
    speed = np.where(one.n > 0, np.pi * diameter[place] * one.n, np.nan)
    free, above = (np.where(w, v, np.nan) for w, v in ((one.free, one.no_load), (cut, one.above)))
    values = {
        "no_load_power_measured": free + one.above, **_ends("no_load_power", free, one.half),
        "no_load_power_residual": np.where(one.free, one.above, np.nan),
        **_ends("cutting_power", above, half),
        **_ends("tangential_force", above / speed, half / speed),
    }  # fmt: skip
    common = [
        ("spindle stands", one.n == 0), ("speed or load not known", ~(one.n > 0)),
        ("spindle below its minimum speed", one.n < power.records.drive.minimum_speed),
        ("spindle's speed changes", ~steady),
        ("speed beyond those of the no-load power", np.isnan(one.no_load)),
        ("speed or load not known", ~one.defined),
    ]  # fmt: skip
    return values, {
        "no_load_power": [*common, ("fed, so that it may cut", True)],
        "cutting_power": [("no cut", mode != CUT), *common],
        "tangential_force": [("no cut", mode != CUT), *common, ("tool not in a tool table", True)],
    }


def tool_of(word: str) -> int:
    """Number of a tool by the word of a log; -1 where it has none.

    >>> tool_of("T04"), tool_of("12.0"), tool_of("probe")
    (4, 12, -1)
    """
    found = re.search(r"\d+", word)
    return int(found.group()) if found else -1


def following_errors(rows: DayRows, serving: ServingModel | None) -> Estimates:
    """Following error of each axis that is logged as commanded and as it is."""
    values: dict[str, Any] = {}
    reasons: Reasons = {}
    for axis in AXES:
        name, command = f"{axis}_following_error", rows.number(f"{axis}_commanded_position")
        error = command - rows.number(f"{axis}_position")
        reasons[name] = [("commanded and actual position not logged", np.isnan(error))]
        known = {} if serving is None else serving.model.parameters.get(axis.upper(), {})
        gain, forward = known.get("loop_gain"), known.get("velocity_feedforward")
        values[f"{name}_measured"] = error
        if gain is None or gain.value is None or gain.interval_95 is None:
            reasons[name].append(("no model with the axis' loop gain serves", True))
            continue
        before = np.diff(command, prepend=np.nan) / np.diff(rows.seconds, prepend=np.nan)
        after = np.append(before[1:], np.nan)
        even = (np.abs(before - after) <= STEADY * np.abs(before)) & (before != 0)
        lag = np.where(even, before, np.nan) / gain.value
        share, ends = 1.0, (0.0, 0.0)
        if forward is not None and forward.value is not None:
            share, ends = 1.0 - forward.value, forward.interval_95 or ends
        spread = np.hypot(share * np.ptp(gain.interval_95) / gain.value, np.ptp(ends))
        half = NORMAL_90 / NORMAL / 2 * spread * np.abs(lag)
        values |= {**_ends(name, share * lag, half), f"{name}_residual": error - share * lag}
        reasons[name].append(("axis stands or its feed changes", True))
    return values, reasons


def _ends(name: str, estimated: Floats, half: Floats) -> dict[str, Floats]:
    return {f"{name}_estimated": estimated, f"{name}_low": estimated - half,
            f"{name}_high": estimated + half}  # fmt: skip
