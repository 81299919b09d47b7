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
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.si import MINUTE
from pipeline.signals.formats import UnreadableFile, format_of
from pipeline.signals.ingest import OBSERVING
from pipeline.signals.units import conversion
from pipeline.signals.windows import sampling_period, uniform_segments

OWN_RATE = ("wav", "tdms")
"""Formats that state the rate of their channels, TDMS not always."""
STATUSES = {"chatter": 3, "not decided": 1, "stable": 0}
"""Exit status of each verdict, the gravest first."""
STEADY, LEAST_TURNS = 0.1, 96.0
"""Share by which the speed of a stretch may change, and its revolutions, where most of the file
has another speed [1]."""
SAME = 0.01
"""Deviation from the file's own time up to which a stated rate is the same [1]."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """An evenly sampled stretch of one speed, between gaps, dead rows and a spindle that stops."""

    verdict: RecordedChatter
    """Times count from the file's begin [s]."""
    begins_s: float
    seconds: float

    @property
    def words(self) -> str:
        """Begin, end and speed."""
        return (f"{self.begins_s:.2f} to {self.begins_s + self.seconds:.2f} s, "
                f"{self.verdict.speed_rpm:.0f} rev/min")  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class JudgedFile:
    """Verdicts on the stretches of a file; the gravest one is the file's."""

    stretches: Sequence[Stretch]
    channels: Sequence[str]
    file_seconds: float

    @property
    def gravest(self) -> Stretch:
        """Of the gravest verdict the longest; one without a cut where there is no other."""
        judged = [one for one in self.stretches if len(one.verdict.spectrum)] or self.stretches
        order = list(STATUSES)
        return min(judged, key=lambda one: (order.index(one.verdict.verdict), -one.seconds))

    @property
    def verdict(self) -> RecordedChatter:
        """Verdict on the file."""
        return self.gravest.verdict


def chatter_of(
    file: Path, teeth: int, speed: str, *, channels: Sequence[str] = (), rate: float | None = None,
    machine: str | None = None,
) -> JudgedFile:  # fmt: skip
    """Verdicts on the evenly sampled stretches of a recording.

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
    rpm = _speed(speed, numbers, file)
    used = list(channels) or [n for n in numbers if n not in times and n != speed]
    if not used:
        raise ValueError(f"{file} has no column of vibration, force or sound: name one, --channel")
    if not table.num_rows or not np.isfinite(time).any():
        raise ValueError(f"{file} has no row of numbers with a time: name another recording")
    values = np.stack([numbers[name] for name in used])
    speeds = np.broadcast_to(rpm, time.shape)
    good, origin = np.isfinite(values).all(axis=0) & np.isfinite(time), float(np.nanmin(time))
    try:
        parts = list(_stretches(time, speeds, good))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error
    if not parts:
        raise ValueError(f"{file}: no stretch without a gap is long enough to be judged")
    limits, orders = _speeds(machine), [_derivative(_unit(table.schema.field(n))) for n in used]
    found = []
    for rows, part in parts:
        begins = max(part.start - origin, 0.0)
        even = np.stack([part.on_grid(one[rows]) for one in values])
        judged = recorded_chatter(
            even, 1 / part.period, part.on_grid(speeds[rows]) / MINUTE, teeth, speeds_rpm=limits,
            derivatives=orders,
        )  # fmt: skip
        if judged.begins_s is not None:
            judged = replace(judged, begins_s=judged.begins_s + begins)
        found.append(Stretch(verdict=judged, begins_s=begins, seconds=even.shape[1] * part.period))
    return JudgedFile(
        stretches=sorted(found, key=lambda one: one.begins_s), channels=used,
        file_seconds=float(np.nanmax(time)) - origin + parts[0][1].period,
    )  # fmt: skip


def _speed(speed: str, numbers: dict[str, Floats], file: Path) -> Floats:
    """Speed [rev/min], one or of each row."""
    try:
        rpm = np.array(float(speed))
    except ValueError:
        if speed not in numbers:
            raise ValueError(f"--speed {speed} is neither rev/min nor a column of {file}: it has "
                             f"{', '.join(numbers) or 'none'}") from None  # fmt: skip
        rpm = np.abs(numbers[speed])
    if not rpm.ndim and not 0 < rpm < np.inf:
        raise ValueError(f"--speed {speed} must be above 0 rev/min")
    if not (np.isfinite(rpm) & (rpm > 0)).any():
        raise ValueError(f"--speed {speed} has no value above 0 rev/min in {file}: name another")
    return rpm


def _stretches(time: Floats, rpm: Floats, good: Bools) -> Iterator[tuple[Ints, Any]]:
    """Rows and segment of each stretch: at the speed at which most of it works, then at others.

    Raises ValueError where there is none.
    """
    left, first = good & np.isfinite(rpm) & (rpm > 0), True
    while left.any():
        change = rpm / np.quantile(rpm[left], 0.9)
        here = left & (change >= MOST_CHANGE**-0.5) & (change <= MOST_CHANGE**0.5)
        rows = np.flatnonzero(here)
        left &= ~here & (change < 1)  # a speed above is no speed of this spindle
        try:
            parts = list(uniform_segments(time[rows]))
        except ValueError:
            if first:
                raise
            continue
        for part in parts:
            own = part.on_grid(rpm[rows])
            turns = part.period * float(own.sum()) / MINUTE
            if first or (own.max() <= (1 + STEADY) * own.min() and turns >= LEAST_TURNS):
                yield rows, part
        first = False


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
    one = found.gravest
    named = {
        "judged_begins_s": one.begins_s, "judged_seconds": one.seconds,
        "file_seconds": found.file_seconds,
        "stretches": [
            {"begins_s": part.begins_s, "ends_s": part.begins_s + part.seconds,
             "speed_rpm": part.verdict.speed_rpm, "verdict": part.verdict.verdict,
             "why": part.verdict.why, "frequency_Hz": part.verdict.frequency_Hz}
            for part in found.stretches
        ],
    }  # fmt: skip
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
    judged = sum(one.seconds for one in file.stretches)
    if len(file.stretches) > 1:
        yield f"of {len(file.stretches)} stretches that of {file.gravest.words}:"
        for one in file.stretches:
            yield f"  {one.words}: {one.verdict.verdict}, {one.verdict.why}"
    if judged < 0.99 * file.file_seconds:
        yield (
            f"judged {judged:.1f} of {file.file_seconds:.1f} s: the rest has gaps, or a spindle "
            "that stands or changes its speed"
        )
    if found.verdict != "chatter" or found.frequency_Hz is None:
        return
    yield (
        f"chatter frequency {found.frequency_Hz:.1f} Hz +- "
        f"{found.frequency_error_Hz or 0:.1f} (95 %)"
        + (f", {found.kind}" if found.kind else "")
        + ("" if found.begins_s is None else f", from {found.begins_s:.2f} s on")
        + ("" if found.channel is None else f", loudest in {file.channels[found.channel]}")
    )
    if found.stable_speeds_rpm:
        words = ", ".join(f"{one:.0f}" for one in found.stable_speeds_rpm)
        yield f"speeds to try, n = 60 f_c / (N k): {words} rev/min; record there again"
