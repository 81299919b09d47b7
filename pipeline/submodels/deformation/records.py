"""Recordings of spindle growth: declared channels of a machine's file, on an even grid of time.

A recording holds the temperatures of at least three sensors, ordered from the front of the spindle
to its rear, and the reading of a displacement probe; speed and ambient temperature where they were
recorded.  A sample of the grid is the newest row at or before its time, so that nothing of a later
row enters it.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.schema.si import RPM, UM, ZERO_CELSIUS
from pipeline.schema.verdict import Fact
from pipeline.signals.recordings import Channel, LogItems, Recording, Samples, read_recordings
from pipeline.signals.units import conversion

OFFSET_UM = 10.0
"""First reading up to which a probe may have been zeroed [um], beside what it moves."""
FEWEST_SENSORS = 3
"""Fewest temperature sensors [1]: front, middle and rear of the spindle."""
FROZEN_S, FROZEN_K = 1200.0, 2.0
"""Least time [s] for which a frozen probe shows one value, and movement of the temperatures in it
[K], as of a frozen sensor."""
FEWEST_SAMPLES = 10
"""Fewest samples of growth in a recording [1]; fewer show no transient."""
GROWTH, SPEED, AMBIENT = "growth", "spindle_speed", "ambient_temperature"
"""Names of the channels beside the sensors, in tables too."""
RAD_S = 1 / RPM
"""Factor from rad/s to rev/min."""


@dataclass(frozen=True, kw_only=True)
class DeformationRecords(Ranged, section="deformation_records"):
    """Recordings of growth in the machine's file."""

    recordings: tuple[str, ...]
    """Patterns of raw files below the machine's folder."""
    temperatures: Mapping[str, Channel]
    """Channel of each sensor by its name; three or more, from front to rear of the spindle."""
    displacement: Channel
    """Reading of the probe at the spindle's nose, positive where the spindle grows."""
    speed: Channel | None = None
    """Spindle speed."""
    ambient: Channel | None = None
    """Temperature of the air beside the machine."""
    period_s: Positive = 60.0
    """Time between two samples of the grid [s]."""
    longest_gap_s: Annotated[float, Range(above=0.0)] = 180.0
    """A row older than this is no sample [s]."""
    probe_is_zeroed: bool = True
    """Whether the probe was set to zero at the start; else the first reading is subtracted."""
    places: Mapping[str, str] = field(default_factory=dict)
    """Places of sensors, in words, by their names."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.temperatures) < FEWEST_SENSORS:
            raise ValueError(
                f"deformation_records.temperatures names {len(self.temperatures)} sensors: name "
                f"{FEWEST_SENSORS} or more, from the front of the spindle to its rear"
            )
        if clash := {GROWTH, SPEED, AMBIENT} & set(self.temperatures):
            raise ValueError(
                f"deformation_records.temperatures names a sensor {clash.pop()!r}: that is the "
                "name of another channel, choose another"
            )
        if strange := sorted(set(self.places) - set(self.temperatures)):
            raise ValueError(
                f"deformation_records.places names a sensor {strange[0]!r}: use the name that it "
                "has in temperatures"
            )

    @property
    def channels(self) -> dict[str, Channel]:
        """All channels by name, each with its quantity where none is declared."""
        found = {name: _kind(one, "temperature") for name, one in self.temperatures.items()}
        found[GROWTH] = _kind(self.displacement, "displacement")
        if self.speed is not None:
            found[SPEED] = _kind(self.speed, "angular_velocity")
        if self.ambient is not None:
            found[AMBIENT] = _kind(self.ambient, "temperature")
        return found


def _kind(channel: Channel, quantity: str) -> Channel:
    return channel if channel.quantity else replace(channel, quantity=quantity)


@dataclass(frozen=True, kw_only=True, eq=False)
class State:
    """Inputs of a prediction: T samples of S sensors on an even grid."""

    period: float
    """Time between two samples [s]."""
    temperatures: Floats
    """Temperatures from front to rear [degC]; NaN where a sensor gives none; shape (T, S)."""
    speed: Floats
    """Spindle speed [rev/min]; zero where none is recorded; shape (T,)."""
    ambient: Floats
    """Temperature of the air [degC]; NaN where none is recorded; shape (T,)."""

    def __len__(self) -> int:
        return len(self.temperatures)

    @property
    def time(self) -> Floats:
        """Time since the start [s]; shape (T,)."""
        return self.period * np.arange(len(self), dtype=np.float64)

    def within(self, rows: slice) -> "State":
        """Some of its samples, one after another."""
        return State(
            period=self.period, temperatures=self.temperatures[rows], speed=self.speed[rows],
            ambient=self.ambient[rows],
        )  # fmt: skip

    @property
    def channels(self) -> Floats:
        """Sensors, then the ambient temperature where it is recorded; shape (T, S or S + 1)."""
        if np.isnan(self.ambient).all():
            return self.temperatures
        return np.column_stack((self.temperatures, self.ambient))


@dataclass(frozen=True, kw_only=True, eq=False)
class Profile:
    """Recording: its state and the measured growth."""

    name: str
    """Name of the raw file."""
    state: State
    """Inputs of a prediction."""
    growth: Floats = field(default_factory=lambda: np.zeros(0))
    """Displacement since the start [um]; NaN where there is no reading; shape (T,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthRecording:
    """Recording: its profile, or the reason for none."""

    name: str
    profile: Profile | None = None
    reason: str = ""


def read_profiles(
    signals: Path, records: DeformationRecords, preferred: Callable[[str], bool]
) -> list[GrowthRecording]:
    """Growth recordings by name; ``preferred`` names the one to keep of files of equal bytes."""
    found = read_recordings(
        signals, records.channels, patterns=records.recordings, preferred=preferred,
        section="deformation_records.recordings",
    )  # fmt: skip
    outputs = json.loads((signals / "manifest.json").read_text())["files"]
    recordings = [
        _of_log(one, signals / str(outputs[one.name]["output"]), records)
        if str(outputs[one.name].get("output")).startswith("observations/")
        else _growth_recording(one, records)
        for one in found
    ]
    return [_zeroed(one, records) for one in recordings]


def _zeroed(one: GrowthRecording, records: DeformationRecords) -> GrowthRecording:
    """A recording; left out where the probe begins farther from zero than it ever moves."""
    if one.profile is None or not records.probe_is_zeroed:
        return one
    known = one.profile.growth[np.isfinite(one.profile.growth)]
    first, moved = float(known[0]), float(np.ptp(known))
    if abs(first) <= OFFSET_UM + moved:
        return one
    reason = (
        f"its probe begins at {first:.4g} um and moves by {moved:.4g} um: set "
        "deformation_records.probe_is_zeroed: false"
    )
    return GrowthRecording(name=one.name, reason=reason)


def _growth_recording(one: Recording, records: DeformationRecords) -> GrowthRecording:
    if one.reason:
        return GrowthRecording(name=one.name, reason=one.reason)
    samples = one.load()
    declared = (*records.temperatures, GROWTH, *(n for n in (SPEED, AMBIENT) if n in one.declared))
    apart = float(np.median(np.diff(np.sort(samples.time[np.isfinite(samples.time)])))) if (
        np.isfinite(samples.time).sum() > 1
    ) else 0.0  # fmt: skip
    if apart > records.longest_gap_s:
        reason = (
            f"its rows are {apart:g} s apart, deformation_records.longest_gap_s = "
            f"{records.longest_gap_s:g}: set period_s to {apart:g} and longest_gap_s to "
            f"{3 * apart:g}"
        )
        return GrowthRecording(name=one.name, reason=reason)
    empty = [n for n in records.temperatures if "holds no value" in samples.lacking.get(n, "")]
    lacking = [n for n in declared if n in samples.lacking and n not in empty]
    if lacking:
        return GrowthRecording(name=one.name, reason=samples.lacking[lacking[0]])
    return _checked(
        _profile(one.name, samples, records, [n in empty for n in records.temperatures])
    )


def _of_log(one: Recording, path: Path, records: DeformationRecords) -> GrowthRecording:
    """Recording in a log of MTConnect: a channel's column is a data item, its value holds."""
    log = LogItems.read(path)
    if not len(log):
        return GrowthRecording(name=one.name, reason="it holds no observation: record it again")
    numbers: dict[str, Floats] = {}
    for name, channel in records.channels.items():
        if not len(log.times(channel.column)):
            reason = f"it has no data item {channel.column!r}: {channel.remedy}"
            return GrowthRecording(name=one.name, reason=reason)
        try:
            factor, offset = conversion(channel.unit, channel.si_unit)
        except ValueError as error:
            reason = f"its data item {channel.column!r} is in {channel.unit or 'no unit'}: {error}"
            return GrowthRecording(name=one.name, reason=f"{reason}: name its unit")
        # where an item was unavailable it stays so until its next value
        held = log.held(channel.column, log.time)
        numbers[name] = channel.factor * (factor * held + offset)
    samples = Samples(time=log.time, channels=numbers)
    none = [not np.isfinite(numbers[name]).any() for name in records.temperatures]
    return _checked(_profile(one.name, samples, records, none, holds=True))


def _checked(profile: Profile) -> GrowthRecording:
    """A profile, or the reason why it says too little."""
    if np.isfinite(profile.growth).sum() < FEWEST_SAMPLES:
        reason = f"it has fewer than {FEWEST_SAMPLES} samples of growth: record for longer"
        return GrowthRecording(name=profile.name, reason=reason)
    return GrowthRecording(name=profile.name, profile=profile)


def _profile(
    name: str, samples: Samples, records: DeformationRecords, empty: list[bool], *,
    holds: bool = False,
) -> Profile:  # fmt: skip
    """Channels of a recording on the grid; a sensor that is ``empty`` gives no value at all.

    The recording starts when the sensors have given their first values, a gap after the first of
    them at most.  In a log a value ``holds`` until the next, also one that is not available.
    """
    rows = np.isfinite(samples.time)
    clock = samples.time[rows]
    order = np.argsort(clock, kind="stable")
    clock = clock[order] - clock[order][0]
    sensors = [s for s, gone in zip(records.temperatures, empty, strict=True) if not gone]
    known = [np.isfinite(samples.channels[s][rows][order]) for s in sensors]
    firsts = [float(clock[np.argmax(one)]) for one in known if one.any()]
    latest = min(firsts, default=0.0) + records.longest_gap_s
    start = max((first for first in firsts if first <= latest), default=0.0)
    end = clock[-1]
    if records.speed and not holds:
        end = min(end, _planned_end(clock, samples.channels[SPEED][rows][order], records))
    grid = np.arange(start, end + 1e-9 * records.period_s, records.period_s)

    def held(channel: str, factor: float = 1.0, offset: float = 0.0) -> Floats:
        values = factor * samples.channels[channel][rows][order] + offset
        if holds:
            return values[np.searchsorted(clock, grid + 1e-6, side="right") - 1]
        return on_grid(clock, values, grid, records.longest_gap_s)

    temperatures = np.column_stack([
        np.full(len(grid), np.nan) if gone else held(sensor, offset=-ZERO_CELSIUS)
        for sensor, gone in zip(records.temperatures, empty, strict=True)
    ])  # fmt: skip
    growth = held(GROWTH, 1 / UM)
    growth[_frozen_since(growth, temperatures, records.period_s) :] = np.nan
    if (start > 0 or not records.probe_is_zeroed) and np.isfinite(growth).any():
        growth = growth - growth[np.isfinite(growth)][0]
    speed = held(SPEED, RAD_S) if records.speed else np.zeros(len(grid))
    ambient = held(AMBIENT, offset=-ZERO_CELSIUS) if records.ambient else np.full(len(grid), np.nan)
    if records.ambient:
        ambient = filled(ambient, coldest_at_start(temperatures))
    state = State(
        period=records.period_s, temperatures=temperatures, speed=filled(np.abs(speed), 0.0),
        ambient=ambient,
    )  # fmt: skip
    return Profile(name=name, state=state, growth=growth)


def _planned_end(clock: Floats, speed: Floats, records: DeformationRecords) -> float:
    """End of the planned speed [s]: the speed in the rows is taken as planned up to it.

    A spindle at rest at the end stays at rest; a speed logged at its changes holds.
    """
    known = np.flatnonzero(np.isfinite(speed))
    often = len(known) > 1 and np.median(np.diff(clock[known])) <= records.longest_gap_s
    if not often or speed[known[-1]] == 0:
        return float(clock[-1])
    return float(clock[known[-1]]) + records.longest_gap_s


def _frozen_since(growth: Floats, temperatures: Floats, period: float) -> int:
    """First sample from which the probe holds one value to the end while temperatures move."""
    known = np.flatnonzero(np.isfinite(growth))
    moved = np.flatnonzero(np.diff(growth[known]) != 0)
    if not len(known) or not len(moved):
        return len(growth)
    last = int(known[moved[-1] + 1])
    since = np.abs(temperatures[last:] - temperatures[last])
    since = since[np.isfinite(since).any(axis=1)]
    far = len(since) > 0 and float(np.nanmedian(since, axis=1).max()) > FROZEN_K
    return last if far and (len(growth) - last) * period > FROZEN_S else len(growth)


def on_grid(clock: Floats, values: Floats, grid: Floats, longest: float) -> Floats:
    """Newest value at or before each time of a grid, NaN where it is older than ``longest``.

    Rows ``clock``, ``values`` (N,) are in the order of time; those without a value are skipped.
    ``grid`` (T,) and ``longest`` [s].

    Examples
    --------
    >>> on_grid(np.array([0.0, 50.0]), np.array([1.0, 2.0]), np.array([0.0, 60.0, 300.0]), 100.0)
    array([ 1.,  2., nan])
    """
    known = np.isfinite(values)
    clock, values = clock[known], values[known]
    if not len(clock):
        return np.full(len(grid), np.nan)
    newest = np.searchsorted(clock, grid + 1e-6, side="right") - 1
    old = (newest < 0) | (grid - clock[np.maximum(newest, 0)] > longest)
    return np.where(old, np.nan, values[np.maximum(newest, 0)])


def filled(values: Floats, start: float) -> Floats:
    """Values with each gap held at the last value, and at ``start`` before the first.

    Examples
    --------
    >>> filled(np.array([np.nan, 2.0, np.nan]), 1.0)
    array([1., 2., 2.])
    """
    known = np.isfinite(values)
    last = np.maximum.accumulate(np.where(known, np.arange(len(values)), -1))
    return np.where(last >= 0, values[np.maximum(last, 0)], start)


def coldest_at_start(temperatures: Floats) -> float:
    """Lowest temperature in the first row [degC]: stands for the air until its first reading."""
    first = temperatures[0][np.isfinite(temperatures[0])] if len(temperatures) else np.zeros(0)
    return float(first.min()) if len(first) else float("nan")


def conditions_of_profile(profile: Profile, *, speed: bool) -> dict[str, Fact]:
    """Highest speed, extremes of the ambient temperature, warmth of the machine at the start.

    The warmth is the median over the sensors of their temperature above the air (above the coldest
    sensor where the air is not recorded): a single broken sensor does not move it.
    """
    state = profile.state
    found: dict[str, tuple[float, str]] = {}
    if speed:
        found["highest speed"] = (float(state.speed.max()), "rev/min")
    first = state.temperatures[np.isfinite(state.temperatures).sum(axis=1).argmax()]
    first = first[np.isfinite(first)]
    reference = float(np.quantile(first, 0.25)) if len(first) else np.nan
    if np.isfinite(state.ambient).any():
        found["lowest ambient temperature"] = (float(state.ambient.min()), "degC")
        found["highest ambient temperature"] = (float(state.ambient.max()), "degC")
        reference = float(state.ambient[0])
    if len(first):
        found["warmth at the start"] = (float(np.median(first)) - reference, "K")
    return {
        name: Fact(value=float(f"{value:.4g}"), unit=unit) for name, (value, unit) in found.items()
    }


def state_of_table(table: Any, wanted: Sequence[str], period: float) -> State:
    """State from a table of evenly spaced rows, ``period`` [s] apart, one column a channel.

    ``wanted`` are the sensors [degC], then ``ambient_temperature`` [degC] and ``spindle_speed``
    [rev/min] where they are read. ValueError when a column is missing or does not begin.
    """
    columns = {}
    for name in wanted:
        if name not in table.columns:
            raise ValueError(f"the input has no column {name}: give {', '.join(wanted)}")
        columns[name] = table[name].to_numpy(float)
    for name in (n for n in wanted if n in (AMBIENT, SPEED)):
        if not np.isfinite(columns[name][0]):
            raise ValueError(f"{name} is not known in row 1: start where it was measured")
    rows = len(table)
    sensors = [name for name in wanted if name not in (AMBIENT, SPEED)]
    temperatures = np.column_stack([columns[name] for name in sensors])
    if not np.isfinite(temperatures[0]).any():
        raise ValueError("no sensor has a temperature in row 1: start where they were measured")
    ambient = np.full(rows, np.nan)
    if AMBIENT in wanted:
        ambient = filled(columns[AMBIENT], coldest_at_start(temperatures))
    turning = filled(np.abs(columns[SPEED]), 0.0) if SPEED in wanted else np.zeros(rows)
    return State(period=period, temperatures=temperatures, speed=turning, ambient=ambient)
