"""From the Parquet of one recording to the mean revolution of its steady part."""

from collections.abc import Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.conditions import Conditions, conditions_of, said_of
from pipeline.identification.cutting.known import CHANNELS, CuttingKnown, named_channels
from pipeline.identification.cutting.records import CuttingRecording, CuttingRecords
from pipeline.identification.cutting.revolution import Revolution, mean_revolution
from pipeline.identification.cutting.settings import CuttingFitSettings
from pipeline.identification.cutting.steady import steady_part
from pipeline.signals.units import conversion

Floats = NDArray[np.float64]

JITTER = 0.02
"""Of the time from sample to sample, as a share of it."""
CLIPPED = 4
"""Samples in a row at a channel's end are no peak but the end of its range."""
ENDS = 0.001
"""Share of the samples that stand there, at least."""
MUTE = 0.05
"""Share of its fluctuation that repeats below which a channel shows no cut..."""
WEAK = 0.03
"""...or its fluctuation as a share of the strongest channel's."""
DRIFT = 0.15
"""Change of a mean force over the recording that is too much, as a share of the RMS force."""


class Unusable(ValueError):  # noqa: N818 - a state of a recording, not a fault of ours
    """A recording that the identification cannot use; the message is the reason."""


def read_file(
    signals: Path,
    name: str,
    entry: Mapping[str, Any],
    records: CuttingRecords,
    known: CuttingKnown,
    settings: CuttingFitSettings,
) -> CuttingRecording:
    """One recording; left out with the reason when it cannot be used.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote it.
    name : str
        Of the raw file.
    entry : mapping
        Of the file in the manifest.
    records, known, settings
        As in :func:`pipeline.identification.cutting.records.read_recordings`.
    """
    blank = CuttingRecording(
        name=name, sha256=str(entry.get("sha256") or ""), trained=records.is_training(name)
    )
    for pattern, reason in records.left_out.items():
        if fnmatchcase(name, pattern):
            return replace(blank, reason=reason)
    try:
        said = said_of(name, records.name, records.by_pattern, records.conditions)
        conditions = conditions_of(said, known.tool)
    except ValueError as error:
        return replace(blank, reason=str(error))
    blank = replace(blank, conditions=conditions)
    output = entry.get("output")
    if not (isinstance(output, str) and output.startswith("traces/")):
        return replace(blank, reason=entry.get("reason") or "it is no table")
    try:
        table = pq.read_table(signals / output)
    except (OSError, pa.ArrowException):
        return replace(blank, reason=f"{output} cannot be read: run `dvc repro`")
    try:
        force, rate, notes = forces(table, named_channels(records.channels))
        revolution, zero_known = cut_of(force, rate, conditions, known, settings)
    except ValueError as error:
        return replace(blank, reason=str(error))
    return replace(blank, revolution=revolution, zero_known=zero_known, notes=notes)


def cut_of(
    force: Floats, rate: float, conditions: Conditions, known: CuttingKnown,
    settings: CuttingFitSettings,
) -> tuple[Revolution, bool]:  # fmt: skip
    """Mean revolution of the steady part, forces on the tool, and whether its zero is known.

    Parameters
    ----------
    force : ndarray, shape (T, 3)
        Channels x, y, z [N].
    rate : float
        Of sampling [1/s].
    conditions : Conditions
        Of the cut, with the speed that was set.
    known : CuttingKnown
        The tool, and how the dynamometer stands.
    settings : CuttingFitSettings
        How many harmonics are used.

    Raises
    ------
    ValueError
        When the recording cannot be used.
    """
    _check_range(force)
    steady = steady_part(force, rate / conditions.speed, way_in(conditions, known.tool) * rate)
    within = slice(steady.first, steady.last)
    inside = (force - steady.zero)[within]
    _check_drift(inside)
    turned = inside @ known.dynamometer.turning.T
    found = mean_revolution(turned, rate, conditions.speed, conditions.flutes, settings.harmonics)
    _check_channels(inside, found.coherent @ np.abs(known.dynamometer.turning))
    return found, steady.zero_known


def way_in(conditions: Conditions, tool: Tool) -> float:
    """Time from the first contact of the tool to its full engagement, at most [s]."""
    return tool.radius / conditions.feed


def forces(table: pa.Table, channels: list[str]) -> tuple[Floats, float, tuple[str, ...]]:
    """Channels in newton, shape (T, 3), the rate of sampling [1/s], and what was done.

    Raises
    ------
    ValueError
        When a channel or the time is missing or of no use.
    """
    values = np.stack([_channel(table, name) for name in channels], axis=1)
    time = _time(table)
    whole = np.isfinite(values).all(axis=1) & np.isfinite(time)
    if whole.sum() < 2:
        raise Unusable("it holds no row with all three forces")
    first, last = np.flatnonzero(whole)[[0, -1]]
    within = slice(int(first), int(last) + 1)
    if not whole[within].all():
        raise Unusable(
            f"{(~whole[within]).sum()} of its rows lack a force or the time: export it again"
        )
    steps = np.diff(time[within])
    period = float(np.median(steps))
    if period <= 0 or np.abs(steps / period - 1).max() > 1 + JITTER:
        raise Unusable("its time does not run evenly: export it again")
    period = float((time[last] - time[first]) / (last - first))
    if np.abs(steps / period - 1).max() > 0.5:
        raise Unusable("its time has gaps: export it again")
    lost = len(whole) - int(whole.sum())
    notes = (f"{lost} rows without a value at its ends left out",) if lost else ()
    return values[within], 1 / period, notes


def _channel(table: pa.Table, name: str) -> Floats:
    if name not in table.column_names:
        raise Unusable(f"it has no channel {name!r}: record it or correct its name")
    field = table.schema.field(name)
    if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
        raise Unusable(f"its channel {name!r} holds words: name a channel of numbers")
    unit = (field.metadata or {}).get(b"unit", b"").decode()
    try:
        factor, offset = conversion(unit, "N")
    except ValueError as error:
        raise Unusable(f"its channel {name!r} is in {unit or 'no unit'}: {error}") from error
    values: Floats = table[name].cast(pa.float64()).to_numpy(zero_copy_only=False)
    return values * factor + offset


def _time(table: pa.Table) -> Floats:
    if "t" in table.column_names:
        return np.array(table["t"].to_numpy(zero_copy_only=False), np.float64)
    if "time" not in table.column_names:
        raise Unusable("it has no time: name its time column or its rate in the table's layout")
    ns = table["time"].cast(pa.int64()).to_numpy()
    return np.asarray((ns - ns[0]) * 1e-9, np.float64)


def _check_range(force: Floats) -> None:
    """Raise when a channel stands at the end of its range."""
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
                raise Unusable(
                    f"its channel {name} stands at {end:g} N for {runs.max()} samples: the range "
                    "of its amplifier was too low, record it again"
                )


def _check_drift(force: Floats) -> None:
    """Raise when mean forces run away over the recording."""
    half = len(force) // 2
    change = np.abs(force[:half].mean(axis=0) - force[half:].mean(axis=0)) * 2
    strength = float(np.sqrt((force**2).sum(axis=1).mean()))
    worst = int(np.argmax(change))
    if change[worst] > DRIFT * strength:
        raise Unusable(
            f"its channel {CHANNELS[worst]} drifts by {change[worst]:.3g} N over the cut, of "
            f"{strength:.3g} N RMS: record it again after a reset of the amplifier"
        )


def _check_channels(force: Floats, coherent: Floats) -> None:
    """Raise when one of the channels x and y shows no cut beside the others."""
    spread = force.std(axis=0)
    for k, name in enumerate(CHANNELS[:2]):
        if coherent[k] < MUTE or spread[k] < WEAK * spread.max():
            raise Unusable(
                f"its channel {name} shows next to nothing of the cut, {spread[k]:.2g} N beside "
                f"{spread.max():.3g} N: check its cable and record it again"
            )
