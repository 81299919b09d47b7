"""Estimates of the champion for each row of a day of production records.

The spindle temperature is that of the champion's own predictor, which the nights ask too: a free
run, which takes the measured temperature once a day, so that no slow fault is swallowed.  The
power of a cut is what the spindle's load says above the no-load power,

    P_c = eta P_motor - P_0(n),    F_t = P_c / v_c,    v_c = pi D n,

with P_0 as it was identified on this machine and D from its tool table (Twin2026).  The 90 %
interval holds the rounding of the load, the uncertainty of P_0, its drift with the temperature of
bearings on training days, and the load's scale, which P_0 shares.  The following error at constant
feed is e = v (1 - k_ff) / K_v (Sim2023).
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from scipy.ndimage import binary_erosion

from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.cutting import NoLoadPoint
from pipeline.schema.days import day_start
from pipeline.schema.si import MINUTE, NS
from pipeline.schema.twin_state import AXES, CONTEXT, MODES
from pipeline.schema.verdict import widest
from pipeline.signals.cleaning.settings import CleanSettings
from pipeline.submodels.cases import Case
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands
from pipeline.submodels.cutting.settings import SpindleLoadRecords
from pipeline.submodels.cutting.spindle_load.levels import BEYOND, NORMAL, resolution, settled
from pipeline.submodels.spindle.days import FREE_RUN

NORMAL_90 = 1.645
"""Half of a 90 % interval of a normal distribution over its standard deviation [1]."""
TOOL_CHANGE_S = 20.0
"""Time about a change of the tool's number that a tool change may take, chip to chip [s]."""
GAP = 1.5
"""Periods from one row to the next from which on there is a gap [1]."""
STEADY = 0.02
"""Share by which a feed may differ from those beside it to count as constant [1]."""
CUT, AIR, WARM_UP = (MODES.index(one) for one in ("cut", "air", "warm_up"))
TEMPERATURE = "spindle_temperature"
POWERS = ("no_load_power", "cutting_power", "tangential_force")
SUBMODELS = {TEMPERATURE: "spindle"} | dict.fromkeys(POWERS, "cutting")
"""Sub-models that quantities are estimated by."""
Values = dict[str, Any]
Reasons = dict[str, str]
"""Columns (T,) by name; for each quantity why it is not known where it is not."""


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
    records = None if serving is None else serving.judging.cutting_records.spindle
    if records is None or model.spindle is None or len(model.spindle.curve) < 2:
        return None
    return SpindlePower(records=records, curve=model.spindle.curve)


def inside(chosen: Bools, rows: int) -> Bools:
    """Whether a row is chosen and as many ``rows`` before and after it; shape (T,)."""
    within: Bools = binary_erosion(chosen, np.ones(2 * rows + 1, dtype=np.bool_))
    return within


@dataclass(frozen=True, kw_only=True, eq=False)
class DayRows:
    """Rows of a day's clean table, T of them."""

    day: str
    frame: pd.DataFrame
    """The rows, by their time in the zone of the plant."""
    segments: pa.Table
    cleaning: CleanSettings

    @cached_property
    def seconds(self) -> Floats:
        """Time since the day's midnight [s]; shape (T,)."""
        index = pd.DatetimeIndex(self.frame.index)
        return (index.as_unit("ns").asi8 - day_start(self.day, str(index.tz))) / NS

    def number(self, name: str) -> Floats:
        """A column of numbers, NaN where it is not known or not recorded; shape (T,)."""
        if name not in self.frame:
            return np.full(len(self.frame), np.nan)
        return self.frame[name].to_numpy(np.float64, copy=True, na_value=np.nan)

    def words(self, name: str) -> tuple[list[str], Any]:
        """Different words of a column, and the place of each row's among them, -1 for none."""
        if name not in self.frame:
            return [], np.full(len(self.frame), -1)
        place, words = pd.factorize(self.frame[name])
        return [str(word) for word in words], place

    def steady_spindle(self, settle_s: float) -> Bools:
        """Whether the spindle has held its speed long enough for its load to count; shape (T,).

        A row has what each item said last, which for load and speed may be rows apart: the rows
        beside it have to be steady too.  What was before a gap is not known.
        """
        t, period = self.seconds, self.cleaning.period_s
        begins = np.diff(t, prepend=-np.inf) > GAP * period
        since = t - t[np.maximum.accumulate(np.where(begins, np.arange(len(t)), 0))]
        steady = settled(t, self.number("spindle_speed"), settle_s=settle_s) & (since >= settle_s)
        return inside(steady, max(1, round(settle_s / 2 / period)))

    def modes(self) -> Any:
        """Place in ``MODES`` of each row's mode, -1 where it is not known; shape (T,).

        That is the kind of its segment; a tool change is where the spindle stands in a running
        program about a change of the tool's number.
        """
        time = pd.DatetimeIndex(self.frame.index).as_unit("ns").asi8
        start, end = (self.segments[k].cast(pa.int64()).to_numpy() for k in ("start", "end"))
        kinds = [MODES.index(k) if k in MODES else -1 for k in self.segments["kind"].to_pylist()]
        place = np.searchsorted(start, time, side="right") - 1
        inside = (place >= 0) & (time < np.append(end, 0)[place])
        mode = np.where(inside, np.array([*kinds, -1])[place], -1)
        (_, tool), (states, state) = self.words("tool_number"), self.words("execution")
        none = "execution" not in self.frame
        active = np.array([one == "ACTIVE" for one in states] + [none])[state]
        stands = np.abs(self.number("spindle_speed")) <= self.cleaning.turning_rpm
        changed = np.flatnonzero((np.diff(tool) != 0) & (tool[1:] >= 0) & (tool[:-1] >= 0)) + 1
        at = self.seconds[changed]
        near = (np.searchsorted(at, self.seconds + TOOL_CHANGE_S, "right")
                > np.searchsorted(at, self.seconds - TOOL_CHANGE_S, "right"))  # fmt: skip
        changing = near & active & stands & (mode != CUT)
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
    idle: Mapping[str, str] = field(default_factory=dict)
    """Sub-models of the champion that do not serve, with the status of their verdict."""


def day_state(rows: DayRows, given: Estimators) -> tuple[Values, Reasons]:
    """Columns of a day's state, and why its quantities are not known elsewhere.

    A run-up, tapping, a spindle that stands and a cut are told by ``mode`` and ``spindle_steady``.
    """
    mode = rows.modes()
    records = given.power.records if given.power else SpindleLoadRecords
    steady = rows.steady_spindle(records.settle_s)
    values: Values = {name: rows.number(name) if unit else rows.frame[name]
                      for name, unit in CONTEXT.items() if name in rows.frame}  # fmt: skip
    powers = spindle_powers(rows, given, steady, mode)
    if "cutting" in given.idle:  # its measured no-load power tells cuts from air all the same
        powers = {}, powers[1]
    reasons: Reasons = {}
    for columns, why in (
        temperatures(rows, given), powers, following_errors(rows, given.serving.get("drive"))
    ):  # fmt: skip
        values |= columns
        reasons |= why
    for name in reasons:
        if (one := SUBMODELS.get(name, "")) in given.idle:
            reasons[name] = f"the champion’s {one} does not serve: {given.idle[one]}"
    values["spindle_steady"] = steady
    values["mode"] = pd.Categorical.from_codes(mode, pd.Index(MODES))
    return values, reasons


def temperatures(rows: DayRows, given: Estimators) -> tuple[Values, Reasons]:
    """Spindle temperature as the champion predicts it, each value held over the model's step."""
    values = {f"{TEMPERATURE}_measured": (measured := rows.number(TEMPERATURE))}
    serving, case = given.serving.get("spindle"), given.cases.get(rows.day)
    why = "no model serves" if serving is None else "sealed: not looked at"
    if serving is not None and case is not None:
        run: Any = ()
        try:
            predicted = serving.predictor(case)
            why = predicted.note or "speed, load or temperature not known"
            run = () if predicted.note else predicted.frame.query("regime == @FREE_RUN")
        except ValueError as error:
            why = str(error)
        if len(run):
            t, estimated = run["t"].to_numpy(float), run["predicted"].to_numpy(float)
            place = np.searchsorted(t, rows.seconds + 1e-6, side="right") - 1
            here = (place >= 0) & (rows.seconds - t[place] < np.diff(t, append=np.inf).min())
            columns = {"estimated": estimated}
            if not interval_unknown(serving):
                factor = widest(case.conditions, serving.model.conditions)
                columns |= {part: estimated + factor * (run[part].to_numpy(float) - estimated)
                            for part in ("low", "high")}  # fmt: skip
            for part, column in columns.items():
                values[f"{TEMPERATURE}_{part}"] = np.where(here, column[place], np.nan)
            values[f"{TEMPERATURE}_residual"] = measured - values[f"{TEMPERATURE}_estimated"]
    return values, {TEMPERATURE: why}


def interval_unknown(serving: ServingModel | None) -> str:
    """Why the interval of the spindle temperature is not known; empty where it is."""
    model: Any = None if serving is None else serving.model
    if serving is None:
        return ""
    if model.intervals is None:
        return "no interval: it takes two training days"
    return serving.verdict.unknown_intervals.get((TEMPERATURE, FREE_RUN), "")


def spindle_powers(
    rows: DayRows, given: Estimators, steady: Any, mode: Any
) -> tuple[Values, Reasons]:
    """No-load power, cutting power and tangential force where they are defined.

    Air or warm-up that is fed, with a power surely above the no-load power, becomes a cut in
    ``mode``: the log's own level, a low quantile of the loads at a speed, hides it where a speed is
    only cut at.  Without a feed, air is not told from a cut.
    """
    power = given.power
    if power is None:
        return {}, dict.fromkeys(POWERS, "no model with a no-load power serves")
    load, feed = np.abs(rows.number("spindle_load")), np.abs(rows.number("path_feedrate"))
    if np.isnan(feed).all():
        feed = np.max([np.abs(rows.number(f"{axis}_feedrate")) for axis in AXES], axis=0)
    n, scale = np.abs(rows.number("spindle_speed")) / MINUTE, power.records.scale
    no_load, own = power.no_load(n)
    above = scale.power(load, n) - no_load
    step = scale.power(resolution(load[np.isfinite(load)]), n) / np.sqrt(12)
    near = NORMAL_90 * np.hypot(step, own) + power.drift * no_load
    half = np.hypot(near, NORMAL_90 / NORMAL * power.records.scale_error * above)
    defined = steady & (n >= scale.drive.minimum_speed) & np.isfinite(above)
    free = inside(defined & (feed == 0) & (mode != CUT), 1)
    surely = above - half > scale.power(rows.cleaning.load_margin, n)
    mode[defined & (feed > 0) & ((mode == AIR) | (mode == WARM_UP)) & surely] = CUT
    words, place = rows.words("tool_number")
    diameter = np.array([given.diameters.get(tool_of(word), np.nan) for word in words] + [np.nan])
    v_c = np.where(n > 0, np.pi * diameter[place] * n, np.nan)
    free_no_load = np.where(free, no_load, np.nan)
    cutting = np.where(defined & (mode == CUT), above, np.nan)
    values = {
        "no_load_power_measured": free_no_load + above,
        "no_load_power_residual": np.where(free, above, np.nan),
        **_ends("no_load_power", free_no_load, near), **_ends("cutting_power", cutting, half),
        **_ends("tangential_force", cutting / v_c, half / v_c),
    }  # fmt: skip
    why = "no steady spindle of known load, at a speed of its no-load power, that "
    no_tool = "no cut by a tool of a tool table" if np.isfinite(cutting).any() else f"{why}cuts"
    no_feed = "no feed is logged, without which turning free is not told from a cut"
    turns = no_feed if np.isnan(feed).all() else f"{why}turns free"
    return values, dict(zip(POWERS, (turns, f"{why}cuts", no_tool), strict=True))


def with_drift(given: Estimators, days: Iterable[DayRows]) -> Estimators:
    """The estimators with the drift of the no-load power over training ``days``, two at least."""
    parts = []
    for rows in days if given.power else ():
        values, _ = day_state(rows, replace(given, serving={}, idle={}))
        # a load that shows 0 % gives a no-load power that is no measure of its drift
        known = np.flatnonzero(np.isfinite(values["no_load_power_residual"])
                               & (values["no_load_power_estimated"] > 0.0))  # fmt: skip
        estimated, high, off = (
            values[f"no_load_power_{part}"][known] for part in ("estimated", "high", "residual")
        )
        beyond = np.maximum(np.abs(off) - (high - estimated), 0.0) / estimated
        regime, group = (np.full(len(known), word) for word in (ALL_REGIMES, rows.day))
        parts.append(Residuals(error=beyond, regime=regime, group=group, t=rows.seconds[known]))
    if given.power is None or sum(len(one.error) > 0 for one in parts) < 2:
        return given
    drift = bands(Residuals.joined(parts))[ALL_REGIMES].upper
    return replace(given, power=replace(given.power, drift=drift))


def tool_of(word: str) -> int:
    """Number of a tool by the word of a log; -1 where it has none.

    >>> tool_of("T04"), tool_of("12.0"), tool_of("probe")
    (4, 12, -1)
    """
    number = re.search(r"\d+", word)
    return int(number.group()) if number else -1


def following_errors(rows: DayRows, serving: ServingModel | None) -> tuple[Values, Reasons]:
    """Following error of each axis that is logged as commanded and as it is."""
    values: Values = {}
    reasons: Reasons = {}
    for axis in AXES:
        name, command = f"{axis}_following_error", rows.number(f"{axis}_commanded_position")
        error = command - rows.number(f"{axis}_position")
        values[f"{name}_measured"] = error
        known = {} if serving is None else serving.model.parameters.get(axis.upper(), {})
        gain, forward = known.get("loop_gain"), known.get("velocity_feedforward")
        logged = bool(np.isfinite(command).any())
        if gain is None or gain.value is None or gain.interval_95 is None:
            lacking = "" if logged else "commanded position not logged, and "
            reasons[name] = f"{lacking}no model with its loop gain"
            continue
        reasons[name] = (
            "no constant feed of the axis" if logged else "commanded position not logged"
        )
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
    return values, reasons


def _ends(name: str, estimated: Floats, half: Floats) -> Values:
    return {f"{name}_estimated": estimated, f"{name}_low": estimated - half,
            f"{name}_high": estimated + half}  # fmt: skip
