"""Chatter in a recording on the command line (`kerf chatter`): columns, speed, verdict.

Files are read by the readers of records.  A column of time or the file itself (WAV, TDMS) gives the
rate, and ``--rate`` where neither does; one that contradicts them is refused.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.app.fleet import machine_parameters
from pipeline.app.machine_signals import IN_BRACKETS, SHORT, TIME, read_columns
from pipeline.app.output import rounded
from pipeline.app.tables import section
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.recorded_chatter import (
    MOST_CHANGE,
    RecordedChatter,
    recorded_chatter,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.si import MINUTE
from pipeline.signals.formats import UnreadableFile, format_of
from pipeline.signals.ingest import OBSERVING
from pipeline.signals.units import conversion
from pipeline.signals.windows import sampling_period, uniform_segments

OWN_RATE = ("wav", "tdms")
"""Formats that state the rate of their channels, TDMS not always."""
SAME = 0.01
"""Deviation from the file's own time up to which a stated rate is the same [1]."""


@dataclass(frozen=True, kw_only=True)
class JudgedFile:
    """Verdict on a file and what of the file it rests on."""

    verdict: RecordedChatter
    """Times count from the file's begin [s]."""
    channels: Sequence[str]
    begins_s: float
    """Where the stretch that was judged begins in the file [s]."""
    seconds: float
    """Length of that stretch [s]."""
    file_seconds: float
    stretches: int
    """Evenly sampled stretches of the file, between gaps, dead rows and a spindle that stops, runs
    up or turns slowly."""


def chatter_of(
    file: Path, teeth: int, speed: str, *, channels: Sequence[str] = (), rate: float | None = None,
    machine: str | None = None,
) -> JudgedFile:  # fmt: skip
    """Verdict on the longest evenly sampled stretch of a recording.

    ``speed`` is a number [rev/min] or the name of a column of it.
    """
    if teeth < 1:
        raise ValueError(f"--teeth {teeth} must be at least 1")
    table, has_rate = _table(file)
    numbers = {
        name: table[name].to_numpy(zero_copy_only=False).astype(float)
        for name in table.column_names[1:] if pa.types.is_floating(table.schema.field(name).type)
    }  # fmt: skip
    times = [name for name in numbers if TIME.match(name.removeprefix("raw_"))]
    time = _time(file, table, times, has_rate, rate)
    for name in channels:
        if name not in numbers:
            raise ValueError(f"--channel {name} is no column of numbers of {file}: it has "
                             f"{', '.join(numbers) or 'none'}")  # fmt: skip
    try:
        rpm: float | Floats = float(speed)
    except ValueError:
        if speed not in numbers:
            raise ValueError(f"--speed {speed} is neither rev/min nor a column of {file}: it has "
                             f"{', '.join(numbers) or 'none'}") from None  # fmt: skip
        rpm = np.abs(numbers[speed])
    if isinstance(rpm, float) and not 0 < rpm < np.inf:
        raise ValueError(f"--speed {speed} must be above 0 rev/min")
    used = list(channels) or [n for n in numbers if n not in times and n != speed]
    if not used:
        raise ValueError(f"{file} has no column of vibration, force or sound: name one, --channel")
    values = np.stack([numbers[name] for name in used])
    turning = np.asarray(rpm)[np.isfinite(rpm) & np.greater(rpm, 0)]
    if not turning.size:
        raise ValueError(f"--speed {speed} has no value above 0 rev/min in {file}: name another")
    change = np.asarray(rpm) / np.quantile(turning, 0.9)  # of the speed at which it works
    turns = (change >= MOST_CHANGE**-0.5) & (change <= MOST_CHANGE**0.5)
    rows = np.flatnonzero(np.isfinite(values).all(axis=0) & np.isfinite(time) & turns)
    try:
        stretches = list(uniform_segments(time[rows]))
        longest = max(stretches, key=lambda one: one.samples)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    even = np.stack([longest.on_grid(one[rows]) for one in values])
    n = rpm / MINUTE if isinstance(rpm, float) else longest.on_grid(rpm[rows]) / MINUTE
    judged = recorded_chatter(
        even, 1 / longest.period, n, teeth, speeds_rpm=_speeds(machine),
        derivatives=[_derivative(_unit(table.schema.field(name))) for name in used],
    )  # fmt: skip
    begins = max(longest.start - float(np.nanmin(time)), 0.0)
    if judged.begins_s is not None:
        judged = replace(judged, begins_s=judged.begins_s + begins)
    return JudgedFile(
        verdict=judged, channels=used, begins_s=begins, seconds=even.shape[1] * longest.period,
        file_seconds=float(np.nanmax(time) - np.nanmin(time)) + longest.period,
        stretches=len(stretches),
    )  # fmt: skip


def _unit(column: pa.Field) -> str:
    """Unit that the file states for a column, else the one in brackets in its name, or ""."""
    stated = column.metadata[b"unit"].decode()
    named = IN_BRACKETS.search(column.name)
    return stated or (named[1] if named else "")


def _derivative(unit: str) -> int:
    """Order of the derivative of displacement in a unit: acceleration 2, velocity 1, else 0."""
    for order, si in ((2, "m/s^2"), (1, "m/s")):
        try:
            if unit and conversion(unit, si):
                return order
        except ValueError:
            continue
    return 0


def _speeds(machine: str | None) -> tuple[float, float] | None:
    if machine is None:
        return None
    drive = section(machine_parameters(machine)["machine"][machine], "spindle_drive", SpindleDrive)
    return None if drive is None else (drive.minimum_speed_rpm, drive.top_speed_rpm)


def _table(file: Path) -> tuple[pa.Table, bool]:
    """Columns of a recording, the first one its time where the file states its rate, as is said."""
    if not file.is_file():
        raise ValueError(f"{file} is no file: name a recording")
    try:
        form = format_of(file)
    except UnreadableFile as error:
        raise ValueError(f"{file}: {error}") from error
    if form in OBSERVING:
        raise ValueError(f"{file} is a log, too slow for chatter: name a table, WAV or TDMS file")
    if form in OWN_RATE:
        with suppress(ValueError):
            return read_columns(file, form, None)[1], True
    return read_columns(file, form)[1], False


def _time(
    file: Path, table: pa.Table, times: Sequence[str], has_rate: bool, rate: float | None
) -> Floats:
    """Time of the rows [s]: the file's own, else by ``rate``."""
    if rate is not None and not 0 < rate < np.inf:
        raise ValueError(f"--rate {rate:g} must be above 0 Hz")
    if times:
        column = table.schema.field(times[0])
        words = [_unit(column), *column.name.rsplit("_", 1)[1:]]
        factor = conversion(next((SHORT[one] for one in words if one in SHORT), "s"), "s")[0]
        own = factor * table[times[0]].to_numpy(zero_copy_only=False).astype(float)
    elif has_rate:
        first = table.column(0)
        if pa.types.is_timestamp(first.type):
            first = first.cast(pa.int64())
            own = (first.to_numpy() - first[0].as_py()) * 1e-9
        else:
            own = np.asarray(first.to_numpy(), float)
    elif rate is None:
        raise ValueError(f"{file} has no column of time: give the sampling rate, --rate in Hz")
    else:
        return np.arange(table.num_rows) / rate
    if rate is not None and abs(rate * sampling_period(own[np.isfinite(own)]) - 1) > SAME:
        found = 1 / sampling_period(own[np.isfinite(own)])
        raise ValueError(f"--rate {rate:g} Hz, but by its own time {file} has {found:.6g} Hz: "
                         "leave --rate out, or mend the file")  # fmt: skip
    return own


def document(found: JudgedFile) -> dict[str, Any]:
    """The verdict for JSON, without the spectrum; None for a number that is not finite."""
    verdict = asdict(found.verdict)
    if found.verdict.channel is not None:
        verdict["channel"] = found.channels[found.verdict.channel]
    file = asdict(found)
    named = {f"judged_{k}": file[k] for k in ("begins_s", "seconds", "file_seconds", "stretches")}
    return {
        k: None if isinstance(v, float) and not np.isfinite(v) else v
        for k, v in (verdict | named).items() if k not in ("frequency", "spectrum")
    }  # fmt: skip


def said(file: JudgedFile) -> Iterator[str]:
    """Report of ``kerf chatter`` in lines."""
    found = file.verdict
    yield f"{found.verdict}: {found.why}"
    if found.confidence is not None:
        yield f"confidence: {100 * found.confidence:.0f} % of the cut or more agree with it"
    how = "by its lines" if found.seconds_in_cut else "as stated"
    passing = rounded(found.tooth_passing_Hz, digits=4)
    yield (
        f"speed {found.speed_rpm:.0f} rev/min {how}, tooth passing {passing} Hz, "
        f"about {found.seconds_in_cut:.1f} s in the cut"
    )
    if file.seconds < 0.99 * file.file_seconds:
        which = f"longest of {file.stretches} stretches" if file.stretches > 1 else "only stretch"
        yield (
            f"judged {file.seconds:.1f} of {file.file_seconds:.1f} s, from {file.begins_s:.2f} s "
            f"on: the {which} without a gap or another speed; the rest is not judged"
        )
    if found.verdict != "chatter" or found.frequency_Hz is None:
        return
    yield (
        f"{found.kind}: chatter frequency {found.frequency_Hz:.1f} Hz +- "
        f"{found.frequency_error_Hz or 0:.1f} (95 %)"
        + ("" if found.begins_s is None else f", from {found.begins_s:.2f} s on")
        + ("" if found.channel is None else f", loudest in {file.channels[found.channel]}")
    )
    if found.stable_speeds_rpm:
        words = ", ".join(f"{one:.0f}" for one in found.stable_speeds_rpm)
        yield f"speeds to try, n = 60 f_c / (N k): {words} rev/min; record there again"
