"""Dynamometer recordings: from the Parquet of a recording to its conditions and mean revolution."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from math import acos, isfinite, pi
from pathlib import Path
from typing import Any, get_args

import numpy as np

from pipeline.cutting.tool import Tool
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CHANNELS, CutConditions
from pipeline.schema.si import MM
from pipeline.schema.verdict import Role
from pipeline.signals import recordings
from pipeline.signals.conditions import Condition
from pipeline.signals.recordings import Channel, Recording, Samples
from pipeline.submodels.cutting.revolution import Revolution, mean_revolution, steady_part
from pipeline.submodels.cutting.settings import (
    CONDITION_UNITS,
    CuttingFitSettings,
    CuttingRecords,
    CuttingSetup,
    Immersion,
    StatedConditions,
)
from pipeline.submodels.cutting.waveform import CutHarmonics

JITTER = 0.02
"""Greatest jitter of the sampling interval, as a share of it [1]."""
CLIPPED = 4
"""Consecutive samples at a channel's extreme from which its range was exceeded."""
ENDS = 0.001
"""Share of the samples at the extreme from which its range was exceeded [1]."""
MUTE = 0.05
"""Share of a channel's fluctuation that repeats below which it shows no cut [1]."""
WEAK = 0.03
"""Fluctuation of a channel over the strongest one's below which it shows no cut [1]."""
DRIFT = 0.15
"""Greatest drift of a mean force over the recording, as a share of the RMS force [1]."""

SAME = 1e-6
"""Relative difference below which two statements agree [1]."""
FLOOR = 2e-3
"""Least standard deviation of a harmonic over the RMS force [1]: the discretisation errs by it."""


class UnusableRecording(ValueError):  # noqa: N818 - a state of a recording, not a fault of ours
    """A recording that the identification cannot use; the message is the reason."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingRecording:
    """Recording of a cut."""

    name: str
    sha256: str
    """SHA-256 of the raw file."""
    role: Role
    """Role of the recording."""
    conditions: CutConditions | None = None
    """Conditions of the cut, at the set speed."""
    revolution: Revolution | None = None
    """Mean revolution, forces on the tool along feed, normal, axis; None if left out."""
    zero_measured: bool = False
    """Whether the zero of its channels was measured in air."""
    reason: str = ""
    """Why it is left out."""
    notes: tuple[str, ...] = ()
    """Changes made to its rows."""
    file: Recording | None = None
    """Recording as written by the ingest."""

    @property
    def is_training(self) -> bool:
        """Whether the model is fitted on it."""
        return self.role == "training" and self.revolution is not None

    @property
    def cut(self) -> tuple[CutConditions, Revolution]:
        """Its conditions and its mean revolution; ValueError when it is left out."""
        if self.conditions is None or self.revolution is None:
            raise ValueError(f"{self.name} is left out: {self.reason}")
        return self.conditions, self.revolution


def read_recordings(
    signals: Path, records: CuttingRecords, setup: CuttingSetup, settings: CuttingFitSettings,
    role: Callable[[str], Role],
) -> list[CuttingRecording]:  # fmt: skip
    """Every dynamometer recording that the records name, in the order of their names.

    One that cannot be used has the reason; a sealed one is not looked into. The list is empty
    without a dynamometer. ValueError when none of the files fits ``cutting_records.recordings``.
    """
    if not records.recordings:
        return []
    files = recordings.read_recordings(
        signals,
        {name: Channel(column=column, quantity="force")
         for name, column in records.channels.items()},
        patterns=[records.recordings],
        conditions=records.sources,
        preferred=lambda name: role(name) == "training",
        section="cutting_records.recordings",
    )  # fmt: skip
    blanks = [_unread(file, records, setup.tool, role(file.name)) for file in files]

    def whole(one: CuttingRecording) -> CuttingRecording:
        left = one.role == "sealed" or one.reason
        return one if left else with_revolution(one, setup, settings)

    return mapped(whole, blanks, compute="threads")


def _unread(file: Recording, records: CuttingRecords, tool: Tool, role: Role) -> CuttingRecording:
    """A recording before its forces are read: role and conditions, or why it is left out."""
    left_out = (why for of, why in records.left_out.items() if fnmatchcase(file.name, of))
    reason = next(left_out, "" if file.conditions else file.reason)
    one = CuttingRecording(
        name=file.name, sha256=file.sha256, role=role, reason=reason or file.reason, file=file
    )
    if reason:
        return one
    try:
        return replace(one, conditions=conditions_of(file.conditions, tool))
    except ValueError as error:
        return replace(one, reason=str(error))


def with_revolution(
    one: CuttingRecording, setup: CuttingSetup, settings: CuttingFitSettings
) -> CuttingRecording:
    """A recording with its mean revolution; left out with the reason when it cannot be used."""
    if one.conditions is None or one.file is None:
        return one
    try:
        return measured_at(one, one.conditions, setup, settings)
    except ValueError as error:
        return replace(one, reason=f"{error}{_other_speed(one, one.conditions, setup, settings)}")


def measured_at(
    one: CuttingRecording, conditions: CutConditions, setup: CuttingSetup,
    settings: CuttingFitSettings,
) -> CuttingRecording:  # fmt: skip
    """A recording with its mean revolution under conditions; ValueError when there is none."""
    if one.file is None:
        raise ValueError(f"{one.name} has no file")
    force, rate, notes = forces(one.file.load())
    revolution, zero_measured = steady_revolution(force, rate, conditions, setup, settings)
    return replace(
        one, conditions=conditions, revolution=revolution, zero_measured=zero_measured, notes=notes
    )


def _other_speed(
    one: CuttingRecording, stated: CutConditions, setup: CuttingSetup,
    settings: CuttingFitSettings,
) -> str:  # fmt: skip
    """Twice or half of the stated speed, where the forces repeat with that; empty otherwise."""
    for factor, words in ((0.5, "half of"), (2.0, "twice")):
        speed = factor * stated.speed
        try:
            _, revolution = measured_at(one, replace(stated, speed=speed), setup, settings).cut
        except ValueError:
            continue
        share = 100 * float(revolution.coherent[:2].max())
        return f"; {share:.0f} % repeat with {60 * speed:.4g} rev/min, {words} what is stated"
    return ""


def cut_harmonics(recording: CuttingRecording, settings: CuttingFitSettings) -> CutHarmonics:
    """Harmonics of a recording with their variance; ValueError when it is left out."""
    conditions, revolution = recording.cut
    variance = revolution.scatter.copy()
    if not recording.zero_measured:
        variance[0] += settings.zero_N**2
    floor = FLOOR**2 * (np.abs(revolution.lines) ** 2).sum(axis=0)
    return CutHarmonics(
        conditions=replace(conditions, speed=revolution.speed), lines=revolution.lines,
        variance=np.maximum(variance, np.maximum(floor, 1e-12)),
    )  # fmt: skip


def steady_revolution(
    force: Floats, rate: float, conditions: CutConditions, setup: CuttingSetup,
    settings: CuttingFitSettings,
) -> tuple[Revolution, bool]:  # fmt: skip
    """Mean revolution of the steady part, forces on the tool, and whether its zero was measured.

    ``force`` are the channels x, y, z, shape (T, 3) [N], sampled at ``rate`` [1/s]; conditions at
    the set speed. ValueError when the recording cannot be used.
    """
    _check_range(force)
    steady = steady_part(force, rate / conditions.speed, entry_time(conditions, setup.tool) * rate)
    within = slice(steady.first, steady.last)
    inside = (force - steady.zero)[within]
    _check_drift(inside)
    force_on_tool = inside @ setup.dynamometer.rotation.T
    revolution = mean_revolution(
        force_on_tool, rate, conditions.speed, conditions.flutes, settings.harmonics
    )
    _check_channels(inside, revolution.coherent @ np.abs(setup.dynamometer.rotation))
    return revolution, steady.zero_measured


def entry_time(conditions: CutConditions, tool: Tool) -> float:
    """Time from the first contact of the tool to its full engagement, at most [s]."""
    return tool.radius / conditions.feed


def forces(samples: Samples) -> tuple[Floats, float, tuple[str, ...]]:
    """Channels (T, 3) [N], sampling rate [1/s], changes; ValueError for an unusable channel."""
    if samples.lacking:
        raise UnusableRecording(next(iter(samples.lacking.values())))
    values = np.stack([samples.channels[name] for name in CHANNELS], axis=1)
    time, whole = samples.time, samples.complete()
    if whole.sum() < 2:
        raise UnusableRecording("it holds no row with all three forces")
    first, last = np.flatnonzero(whole)[[0, -1]]
    within = slice(int(first), int(last) + 1)
    if not whole[within].all():
        raise UnusableRecording(
            f"{(~whole[within]).sum()} of its rows lack a force or the time: export it again"
        )
    steps = np.diff(time[within])
    period = float(np.median(steps))
    if period <= 0 or np.abs(steps / period - 1).max() > 1 + JITTER:
        raise UnusableRecording("its time does not run evenly: export it again")
    period = float((time[last] - time[first]) / (last - first))
    if np.abs(steps / period - 1).max() > 0.5:
        raise UnusableRecording("its time has gaps: export it again")
    lost = len(whole) - int(whole.sum())
    notes = (f"{lost} rows without a value at its ends left out",) if lost else ()
    return values[within], 1 / period, notes


def _check_range(force: Floats) -> None:
    """Raise when a channel was clipped at the end of its range."""
    for name, values in zip(CHANNELS, force.T, strict=True):
        for end in (values.max(), values.min()):
            if end == 0.0:
                continue
            at_end = values == end
            if at_end.sum() < max(ENDS * len(values), CLIPPED) or end == values[::-1].mean():
                continue
            edges = np.diff(at_end.astype(np.int8), prepend=0, append=0)
            runs = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
            if runs.max() >= CLIPPED and np.ptp(values) > 0:
                raise UnusableRecording(
                    f"its channel {name} stands at {end:g} N for {runs.max()} samples: the range "
                    "of its amplifier was too low, record it again"
                )


def _check_drift(force: Floats) -> None:
    """Raise when mean forces drift over the recording."""
    half = len(force) // 2
    change = np.abs(force[:half].mean(axis=0) - force[half:].mean(axis=0)) * 2
    strength = float(np.sqrt((force**2).sum(axis=1).mean()))
    worst = int(np.argmax(change))
    if change[worst] > DRIFT * strength:
        raise UnusableRecording(
            f"its channel {CHANNELS[worst]} drifts by {change[worst]:.3g} N over the cut, of "
            f"{strength:.3g} N RMS: record it again after a reset of the amplifier"
        )


def _check_channels(force: Floats, coherent: Floats) -> None:
    """Raise when channel x or y shows no cut while the others do."""
    deviation = force.std(axis=0)
    for k, name in enumerate(CHANNELS[:2]):
        if coherent[k] < MUTE or deviation[k] < WEAK * deviation.max():
            raise UnusableRecording(
                f"its channel {name} shows next to nothing of the cut, {deviation[k]:.2g} N beside "
                f"{deviation.max():.3g} N: check its cable and record it again"
            )


def _stated(conditions: Mapping[str, Condition]) -> StatedConditions:
    """Stated conditions, others left out; ValueError when a value is none of the condition."""
    stated: dict[str, Any] = {}
    for name, unit in CONDITION_UNITS.items():
        one = conditions.get(name)
        if one is None:
            continue
        if unit is None and one.value not in get_args(Immersion):
            raise ValueError(f"its {name} by {one.source} is {one.value!r}: slot, up or down")
        stated[name] = one.value if unit is None or one.unit == unit else one.to(unit)
    return StatedConditions(**stated)


def conditions_of(conditions: Mapping[str, Condition], tool: Tool) -> CutConditions:
    """Conditions of a cut in SI; ValueError when they are incomplete, invalid or contradictory."""
    stated = _stated(conditions)
    speed = _positive("speed_rpm", stated.speed_rpm) / 60
    a_p = _positive("axial_depth_mm", stated.axial_depth_mm) * MM
    phi_st, phi_ex = _arc(stated, tool)
    if stated.feed_mm_min is None and stated.feed_per_tooth_mm is None:
        raise ValueError("its feed is not known: say feed_mm_min or feed_per_tooth_mm")
    feeds = []
    if stated.feed_mm_min is not None:
        feeds.append(_positive("feed_mm_min", stated.feed_mm_min) * MM / (60 * tool.flutes * speed))
    if stated.feed_per_tooth_mm is not None:
        feeds.append(_positive("feed_per_tooth_mm", stated.feed_per_tooth_mm) * MM)
    if abs(feeds[0] - feeds[-1]) > 0.01 * feeds[0]:
        raise ValueError(
            f"its feed_mm_min = {stated.feed_mm_min:g} is {feeds[0] / MM:.4g} mm for each tooth, "
            f"its feed_per_tooth_mm {feeds[1] / MM:.4g}: correct one of them"
        )
    return CutConditions(
        speed=speed, f_z=feeds[0], a_p=a_p, phi_st=phi_st, phi_ex=phi_ex, flutes=tool.flutes
    )


def _positive(name: str, value: float | None) -> float:
    if value is None:
        raise ValueError(f"its {name} is not known: say it in cutting_records")
    if not (isfinite(value) and value > 0):
        raise ValueError(f"its {name} = {value:g} must be finite and positive")
    return value


def _arc(stated: StatedConditions, tool: Tool) -> tuple[float, float]:
    """Entry and exit angle of the teeth [rad]."""
    if stated.entry_deg is not None and stated.exit_deg is not None:
        if not 0 <= stated.entry_deg < stated.exit_deg <= 180:
            raise ValueError(
                f"its entry_deg = {stated.entry_deg:g} and exit_deg = {stated.exit_deg:g} must be "
                "from 0 to 180, the entry first"
            )
        return stated.entry_deg * pi / 180, stated.exit_deg * pi / 180
    if stated.immersion is None:
        raise ValueError("its immersion is not known: say slot, up or down, or entry and exit")
    width = stated.radial_depth_mm
    if stated.immersion == "slot":
        if width is not None and abs(width / tool.diameter_mm - 1) > 0.01:
            raise ValueError(
                f"its radial_depth_mm = {width:g} is not the diameter of the tool, "
                f"{tool.diameter_mm:g}, as in a slot: correct one of them"
            )
        return 0.0, pi
    width = _positive("radial_depth_mm", width)
    if width > tool.diameter_mm * (1 + SAME):
        raise ValueError(
            f"its radial_depth_mm = {width:g} is more than the diameter of the tool, "
            f"{tool.diameter_mm:g}: correct one of them"
        )
    swept = acos(max(1 - 2 * width / tool.diameter_mm, -1.0))
    return (0.0, swept) if stated.immersion == "up" else (pi - swept, pi)
