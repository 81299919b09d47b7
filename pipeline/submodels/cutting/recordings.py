"""Dynamometer recordings: from the Parquet of a recording to its mean revolution."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CHANNELS, CutConditions
from pipeline.schema.verdict import Role
from pipeline.signals.units import conversion
from pipeline.submodels.cutting.conditions import conditions_of, stated_conditions
from pipeline.submodels.cutting.revolution import Revolution, mean_revolution, steady_part
from pipeline.submodels.cutting.settings import (
    CuttingFitSettings,
    CuttingRecords,
    CuttingSetup,
    named_channels,
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

FLOOR = 2e-3
"""Least standard deviation of a harmonic over the RMS force [1]: the discretisation errs by it."""


class UnusableRecording(ValueError):  # noqa: N818 - a state of a recording, not a fault of ours
    """A recording that the identification cannot use; the message is the reason."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingRecording:
    """One recording of a cut.

    Parameters
    ----------
    name, sha256 : str
        Of the raw file.
    role : Role
        What it is for.
    conditions : CutConditions, optional
        Conditions of the cut, at the set speed.
    revolution : Revolution, optional
        Its mean revolution, forces on the tool along feed, normal, axis; None when it is left out.
    zero_measured : bool
        Whether the zero of its channels was measured in air.
    reason : str
        Why it is left out.
    notes : tuple of str
        Changes made to its rows.
    """

    name: str
    sha256: str
    role: Role
    conditions: CutConditions | None = None
    revolution: Revolution | None = None
    zero_measured: bool = False
    reason: str = ""
    notes: tuple[str, ...] = ()

    @property
    def is_training(self) -> bool:
        """Whether the model is fitted on it."""
        return self.role == "training" and self.revolution is not None

    @property
    def cut(self) -> tuple[CutConditions, Revolution]:
        """Its conditions and its mean revolution.

        Raises
        ------
        ValueError
            When it is left out.
        """
        if self.conditions is None or self.revolution is None:
            raise ValueError(f"{self.name} is left out: {self.reason}")
        return self.conditions, self.revolution


@dataclass(frozen=True, kw_only=True)
class RecordingReader:
    """Reader of a machine's dynamometer recordings.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote them.
    files : mapping of str to mapping
        Entries of the manifest by raw file.
    records : CuttingRecords
        Which recordings, their channels and conditions.
    setup : CuttingSetup
        Tool and setup of the dynamometer.
    settings : CuttingFitSettings
        Settings of the fit, for the highest harmonic.
    role : callable
        Role of a recording by its name.
    """

    signals: Path
    files: Mapping[str, Mapping[str, Any]]
    records: CuttingRecords
    setup: CuttingSetup
    settings: CuttingFitSettings
    role: Callable[[str], Role]

    def recordings(self) -> list[CuttingRecording]:
        """Every recording that the records name, in the order of their names.

        One that cannot be used has the reason; a sealed one is not looked into.  The list is empty
        without a dynamometer.

        Raises
        ------
        ValueError
            When none of the files fits ``cutting_records.recordings``.
        """
        pattern = self.records.recordings
        if not pattern:
            return []
        names = [name for name in sorted(self.files) if fnmatchcase(name, pattern)]
        if not names:
            raise ValueError(
                f"no recording in {self.signals} fits cutting_records.recordings = {pattern!r}: "
                "put recordings of the dynamometer there or correct the pattern"
            )
        # of copies the one that is learnt from counts
        first: dict[str, str] = {}
        for name in sorted(names, key=lambda one: (self.role(one) != "training", one)):
            first.setdefault(self._content(name), name)
        recordings = []
        for name in names:
            original = first[self._content(name)]
            blank = self._named(name)
            if name != original:
                copied = f"it is a copy of {original}: record another"
                blank = replace(blank, conditions=None, reason=copied)
            sealed = blank.role == "sealed" or blank.reason
            recordings.append(blank if sealed else self.read(blank))
        return recordings

    def _content(self, name: str) -> str:
        """What copies share: the hash of the bytes, else the name."""
        return str(self.files[name].get("sha256") or name)

    def _named(self, name: str) -> CuttingRecording:
        """A recording before its forces are read: role and conditions, or why it is left out."""
        sha256 = str(self.files[name].get("sha256") or "")
        blank = CuttingRecording(name=name, sha256=sha256, role=self.role(name))
        for pattern, reason in self.records.left_out.items():
            if fnmatchcase(name, pattern):
                return replace(blank, reason=reason)
        try:
            return replace(blank, conditions=named_conditions(name, self.records, self.setup.tool))
        except ValueError as error:
            return replace(blank, reason=str(error))

    def read(self, blank: CuttingRecording) -> CuttingRecording:
        """A recording with its mean revolution; left out with the reason when it cannot be used."""
        entry, conditions = self.files[blank.name], blank.conditions
        output = entry.get("output")
        if conditions is None:
            return blank
        if not (isinstance(output, str) and output.startswith("traces/")):
            return replace(blank, reason=entry.get("reason") or "it is no table")
        try:
            table = pq.read_table(self.signals / output)
        except (OSError, pa.ArrowException):
            return replace(blank, reason=f"{output} cannot be read: run `dvc repro`")
        try:
            force, rate, notes = forces(table, named_channels(self.records.channels))
            revolution, zero_measured = steady_revolution(
                force, rate, conditions, self.setup, self.settings
            )
        except ValueError as error:
            return replace(blank, reason=str(error))
        return replace(blank, revolution=revolution, zero_measured=zero_measured, notes=notes)


def named_conditions(name: str, records: CuttingRecords, tool: Tool) -> CutConditions:
    """Conditions of a recording by what is stated about it.

    Raises
    ------
    ValueError
        When something is missing or contradicts the rest.
    """
    stated = stated_conditions(name, records.name, records.by_pattern, records.conditions)
    return conditions_of(stated, tool)


def cut_harmonics(recording: CuttingRecording, settings: CuttingFitSettings) -> CutHarmonics:
    """Harmonics of a recording with their variance, zero included, at its measured speed.

    Raises
    ------
    ValueError
        When the recording is left out.
    """
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

    Parameters
    ----------
    force : ndarray, shape (T, 3)
        Channels x, y, z [N].
    rate : float
        Of sampling [1/s].
    conditions : CutConditions
        Of the cut, at the set speed.
    setup : CuttingSetup
        Tool and setup of the dynamometer.
    settings : CuttingFitSettings
        Settings of the fit, for the highest harmonic.

    Raises
    ------
    ValueError
        When the recording cannot be used.
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


def forces(table: pa.Table, channels: list[str]) -> tuple[Floats, float, tuple[str, ...]]:
    """Channels [N], shape (T, 3), the sampling rate [1/s], and the changes made.

    Raises
    ------
    ValueError
        When a channel or the time is missing or unusable.
    """
    values = np.stack([_channel(table, name) for name in channels], axis=1)
    time = _time(table)
    whole = np.isfinite(values).all(axis=1) & np.isfinite(time)
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


def _channel(table: pa.Table, name: str) -> Floats:
    if name not in table.column_names:
        raise UnusableRecording(f"it has no channel {name!r}: record it or correct its name")
    field = table.schema.field(name)
    if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
        raise UnusableRecording(f"its channel {name!r} holds words: name a channel of numbers")
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    try:
        factor, offset = conversion(unit, "N")
    except ValueError as error:
        raise UnusableRecording(
            f"its channel {name!r} is in {unit or 'no unit'}: {error}"
        ) from error
    values: Floats = table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
    return values * factor + offset


def _time(table: pa.Table) -> Floats:
    if "t" in table.column_names:
        return np.array(table["t"].to_numpy(zero_copy_only=False), np.float64)
    if "time" not in table.column_names:
        raise UnusableRecording(
            "it has no time: name its time column or its rate in the table's layout"
        )
    ns = table["time"].cast(pa.int64()).to_numpy()
    return np.asarray((ns - ns[0]) * 1e-9, np.float64)


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
