"""Lives of tools from a machine's signals: recordings cut into windows of even samples.

Windows neither overlap nor reach over a gap.  Rates are brought down behind a low-pass
(:func:`scipy.signal.resample_poly`, linear phase).  An unusable recording is a sentence beside the
lives, never an exception.
"""

import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from pipeline.schema.arrays import Bools, Floats
from pipeline.signals.conditions import (
    Condition,
    ConditionSources,
    as_words,
    conditions_in_rows,
    parts_of,
    samples_sha256,
)
from pipeline.signals.recordings import WORDS, Channel, Recording, Samples, read_recordings
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import (
    WEAR_UNIT,
    ConditionTable,
    InCut,
    LifeFile,
    Lives,
    ToolLife,
    WearRecords,
    WearWindows,
    Words,
)
from pipeline.signals.windows import UniformSegment

SLOWER = 0.05
"""Share by which a recording may be slower than the windows' rate [1]: it is interpolated."""
SAME_RATE = 1e-3
"""Relative difference of rates [1] below which nothing is resampled."""
CHANNEL, CONDITION, IN_CUT = "channel ", "condition ", "in cut"
"""Prefixes of columns read from a recording: signals, conditions, and the sign of being in cut."""


def read_lives(
    signals: Path, records: WearRecords,
    is_training: Callable[[str], bool] = lambda name: False, *, known: bool = True,
    in_use: Collection[str] = (),
    given: Callable[[str], Mapping[str, Condition]] = lambda name: {},
) -> Lives:  # fmt: skip
    """Lives of all tools in a machine's signals.

    Of raw files with the same bytes one is kept for which ``is_training``.  Where wear and
    conditions need not be ``known``, missing ones are NaN or ``""`` and nothing is interpolated.
    Of tools ``in_use`` the recordings before the first and after the last measurement are kept,
    with NaN for their wear.  Conditions ``given`` by the name of a recording precede the recorded
    ones.
    """
    left_out: dict[str, str] = {}
    by_tool: dict[str, list[_Cut]] = {}
    for part in _parts(signals, records, is_training, left_out):
        part = replace(part, conditions={**part.conditions, **given(part.file)})
        try:
            windows = _windows(part, records, known)
        except ValueError as error:
            left_out[part.name] = str(error)
            continue
        file = LifeFile(name=part.name, file=part.file, sha256=part.sha256)
        by_tool.setdefault(str(windows.tool[0]), []).append((file, windows))
    if not records.progress and any(len(cuts) > 1 for cuts in by_tool.values()):
        for cuts in by_tool.values():  # the number in the order of their names is the progress
            cuts[:] = [
                (file, replace(one, progress=np.full(len(one), float(k)), progress_unit="1"))
                for k, (file, one) in enumerate(sorted(cuts, key=lambda cut: cut[0].name), start=1)
            ]
    lives = []
    for tool, cuts in sorted(by_tool.items()):
        ordered = sorted(cuts, key=lambda one: (float(one[1].progress[0]), one[0].name))
        if known:
            ordered = _interpolated(ordered, records, left_out, open_ended=tool in in_use)
        if ordered:
            windows = WearWindows.joined([one for _, one in ordered])
            lives.append(ToolLife(tool=tool, files=tuple(f for f, _ in ordered), windows=windows))
    return Lives(lives=tuple(lives), left_out=left_out)


_Cut = tuple[LifeFile, WearWindows]


def _interpolated(
    cuts: list[_Cut], records: WearRecords, left_out: dict[str, str], *, open_ended: bool
) -> list[_Cut]:
    """Recordings whose wear was measured, or lies between two of the same tool that were."""
    points = [
        (float(one.progress.mean()), float(np.nanmean(one.wear)))
        for _, one in cuts
        if np.isfinite(one.wear).any()
    ]
    found = []
    for file, one in cuts:
        there = np.isfinite(one.wear)
        if there.any():
            found.append((file, one.of(there)))
            continue
        at = float(one.progress.mean())
        between = bool(points) and points[0][0] <= at <= points[-1][0]
        if open_ended and not between and not records.wear.is_class:
            found.append((file, one))
            continue
        if records.wear.is_class or not records.interpolate or not points:
            left_out[file.name] = "its wear was not measured: measure it, or leave it out"
            continue
        if not between:
            left_out[file.name] = (
                "its wear was not measured, and no measurement of the same tool lies on both sides "
                "of it: measure the wear of the first and the last cut"
            )
            continue
        wear = np.interp(at, [x for x, _ in points], [y for _, y in points])
        found.append((file, replace(one, wear=np.full(len(one), float(wear)))))
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """A recording or a part of one, with its samples and conditions that hold for all of it."""

    name: str
    file: str
    sha256: str
    samples: Samples
    rows: Bools
    conditions: Mapping[str, Condition]


def _declared(records: WearRecords) -> dict[str, Channel]:
    """Channels, and columns that may hold conditions, as ``read_recordings`` takes them."""
    found = {f"{CHANNEL}{name}": channel for name, channel in records.channels.items()}
    found |= {f"{CONDITION}{n}": Channel(column=n, quantity=WORDS) for n in records.words}
    found |= {f"{CONDITION}{n}": Channel(column=n) for n in sorted(records.numbers)}
    if records.in_cut is not None:
        found[IN_CUT] = records.in_cut.channel
    return found


def _parts(
    signals: Path, records: WearRecords, is_training: Callable[[str], bool],
    left_out: dict[str, str],
) -> Iterator[_Part]:  # fmt: skip
    """Recordings and parts of tables; those of no use go to ``left_out``."""
    files = read_recordings(
        signals, _declared(records), patterns=records.recordings,
        conditions=ConditionSources(
            name=records.name, section="wear_records",
            units={**records.numbers, **dict.fromkeys(records.words)} if records.name else {},
        ),
        preferred=is_training, section="wear_records.recordings",
    )  # fmt: skip
    table = None if records.table is None else ConditionRows.read(signals, records.table)
    for file in files:
        if records.table is not None and file.name == records.table.file:
            continue
        if file.reason or file.file is None:
            left_out[file.name] = file.reason or "it is no table"
            continue
        try:
            conditions = {**file.conditions, **(table.row(file.name) if table else {})}
            yield from _parts_of(file, conditions, records)
        except ValueError as error:
            left_out[file.name] = str(error)


def _parts_of(
    file: Recording, conditions: Mapping[str, Condition], records: WearRecords
) -> Iterator[_Part]:
    samples = file.load()
    if file.file is None or not records.parts:
        yield _Part(
            name=file.name, file=file.name, sha256=file.sha256, samples=samples,
            rows=np.ones(len(samples.time), bool), conditions=conditions,
        )  # fmt: skip
        return
    for part in parts_of(file.file, records.parts, "wear_records.parts"):
        channels = sorted(n for n in samples.channels if n.startswith(CHANNEL))
        own = {
            name: Condition(value=word, source="the table") for name, word in part.values.items()
        }
        yield _Part(
            name=part.name(file.name), file=file.name, samples=samples, rows=part.rows,
            sha256=samples_sha256((n, samples.channels[n][part.rows]) for n in channels),
            conditions={**conditions, **own},
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class ConditionRows:
    """The table of conditions beside the recordings: its rows by the key."""

    source: ConditionTable
    rows: Mapping[str, list[dict[str, Condition]]]

    @staticmethod
    def read(signals: Path, source: ConditionTable) -> "ConditionRows":
        """The table as the ingest wrote it."""
        where = f"wear_records.table.file = {source.file!r}"
        entry = json.loads((signals / "manifest.json").read_text())["files"].get(source.file)
        if entry is None:
            raise ValueError(f"{where} is not among the records: put it there or correct its name")
        if not entry.get("output"):
            raise ValueError(
                f"{where} could not be read: {entry.get('reason') or 'it is no table'}"
            )
        table = pq.read_table(signals / str(entry["output"]))
        if source.key not in table.column_names:
            raise ValueError(
                f"{where} has no column {source.key!r}, which wear_records.table.key names: it has "
                f"{', '.join(table.column_names)}"
            )
        rows: dict[str, list[dict[str, Condition]]] = {}
        found = conditions_in_rows(table, source.file)
        for key, one in zip(as_words(table[source.key]), found, strict=True):
            rows.setdefault(_plain(key), []).append(one)
        return ConditionRows(source=source, rows=rows)

    def row(self, recording: str) -> dict[str, Condition]:
        """Conditions of a recording, of which the table has one row."""
        if self.source.name:
            match = re.search(self.source.name, recording)
            keys = [_plain(match.group(1))] if match else []
        else:
            folder = self.source.file.rpartition("/")[0]
            keys = [recording, recording.removeprefix(f"{folder}/")]
        found = next((self.rows[key] for key in keys if key in self.rows), [])
        if len(found) != 1:
            many = f"{len(found)} rows" if found else "no row"
            raise ValueError(f"{self.source.file} has {many} of it: give it one")
        return found[0]


def _plain(key: str) -> str:
    """A key as a word; whole numbers without zeros before them."""
    return str(int(key)) if key.isdecimal() else key


def _windows(part: _Part, records: WearRecords, known: bool) -> WearWindows:
    """Windows of a recording, with what was recorded of each."""
    samples, names = part.samples, [f"{CHANNEL}{name}" for name in records.channels]
    for name in names:
        if name in samples.lacking:
            raise ValueError(samples.lacking[name])
    in_cut = samples.complete(names) & part.rows & _in_cut(part, records.in_cut)
    at = np.flatnonzero(in_cut)
    if not len(at):
        raise ValueError("no row of it is in cut with a value in each channel")
    pieces, starts = [], []
    for piece in samples.segments(in_cut):
        values = np.stack([piece.on_grid(samples.channels[name]) for name in names])
        values = _at_rate(values, piece, records.rate_Hz)
        for first in range(0, values.shape[1] - records.length + 1, records.length):
            pieces.append(values[:, first : first + records.length])
            starts.append(piece.start + first / records.rate_Hz)
    if not pieces:
        raise ValueError(
            f"no stretch in cut lasts {records.window_s:.3g} s without a gap: record longer cuts, "
            "or shorten wear_records.length"
        )
    chosen = np.arange(len(pieces))
    if records.most is not None and len(pieces) > records.most:
        chosen = np.unique(np.linspace(0, len(pieces) - 1, records.most).round().astype(int))
    time = np.array(starts)[chosen]
    of = _Recorded(part=part, at=at, time=time + 0.5 * records.window_s, known=known)
    wear = of.wear(records)
    first_row = float(samples.time[np.flatnonzero(part.rows & np.isfinite(samples.time))[0]])
    conditions: dict[str, Any] = {n: of.numbers(n, unit) for n, unit in records.continuous.items()}
    progress = conditions[records.progress] if records.progress else time - first_row
    conditions |= {name: of.words(name) for name in records.discrete}
    tool = of.words(records.tool) if records.tool else np.full(len(time), part.name)
    if len(set(tool.tolist())) > 1:
        raise ValueError(
            f"it shows {len(set(tool.tolist()))} tools: name {records.tool!r} in wear_records.parts"
        )
    return WearWindows(
        values=np.stack([pieces[k] for k in chosen]).astype(np.float32),
        channels=tuple(records.channels), units=tuple(samples.units[name] for name in names),
        rate_Hz=records.rate_Hz, wear=wear, wear_unit=records.wear.target_unit,
        measured=np.isfinite(wear), conditions=conditions, condition_units=records.continuous,
        tool=np.where(tool == "", part.name, tool), recording=np.full(len(time), part.name),
        time=time, progress=progress,
        progress_unit=records.continuous[records.progress] if records.progress else "s",
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Recorded:
    """Records beside the channels at the middle of each window, at ``time`` [s]."""

    part: _Part
    at: Any
    time: Floats
    known: bool

    def numbers(self, name: str, unit: str, *, needed: bool = True) -> Floats:
        """A condition in ``unit`` at each window, shape (N,); NaN where it is not recorded."""
        samples, key, one = self.part.samples, f"{CONDITION}{name}", self.part.conditions.get(name)
        if one is not None:
            try:
                value = float(one.value)
                factor, offset = conversion(one.unit or unit, unit)
            except ValueError as error:
                raise ValueError(f"its {name} = {one.value} {one.unit}: {error}") from error
            return np.full(len(self.time), float(f"{value * factor + offset:.12g}"))
        if key not in samples.channels:
            if needed and self.known:
                raise ValueError(f"its {name} is not recorded: record it, or leave it out")
            return np.full(len(self.time), np.nan)
        values = samples.channels[key][self.at]
        there = np.isfinite(values)
        factor, offset = conversion(samples.units[key] or unit, unit)
        if not there.any():
            return np.full(len(self.time), np.nan)
        found = np.interp(self.time, samples.time[self.at][there], values[there])
        return np.asarray(found * factor + offset)

    def words(self, name: str) -> Words:
        """A condition in words at each window, shape (N,); ``""`` where it is not recorded."""
        samples, key, one = self.part.samples, f"{CONDITION}{name}", self.part.conditions.get(name)
        if one is not None:
            value = f"{one.value:g}" if isinstance(one.value, float) else str(one.value)
            return np.full(len(self.time), value)
        if key not in samples.words:
            if self.known:
                raise ValueError(f"its {name} is not recorded: record it, or leave it out")
            return np.full(len(self.time), "")
        near = np.searchsorted(samples.time[self.at], self.time).clip(max=len(self.at) - 1)
        return np.asarray(samples.words[key][self.at][near], str)

    def wear(self, records: WearRecords) -> Floats:
        """Wear at each window, NaN where it was not measured; shape (N,)."""
        source = records.wear
        if not source.is_class:
            return self.numbers(source.name, WEAR_UNIT, needed=False)
        found = self.words(source.name)
        strange = sorted(set(found.tolist()) - {*source.worn, *source.unworn, ""})
        if strange:
            raise ValueError(
                f"its {source.name} is {strange[0]!r}, neither {' or '.join(source.worn)} nor "
                f"{' or '.join(source.unworn)}: correct wear_records.wear"
            )
        worn = np.isin(found, source.worn).astype(float)
        return np.where(found == "", np.nan, worn)


def _in_cut(part: _Part, settings: InCut | None) -> Bools:
    """Rows in cut, shape (T,)."""
    samples = part.samples
    everywhere = np.ones(len(samples.time), bool)
    if settings is None:
        return everywhere
    if IN_CUT in samples.lacking:
        raise ValueError(samples.lacking[IN_CUT])
    if settings.values:
        words = samples.words[IN_CUT]
        cut = {
            word for word in set(words.tolist())
            if any(fnmatchcase(word, pattern) for pattern in settings.values)
        }  # fmt: skip
        return np.isin(words, sorted(cut))
    from scipy.ndimage import uniform_filter1d

    values = np.nan_to_num(np.where(part.rows, samples.channels[IN_CUT], 0.0))
    rows = np.flatnonzero(part.rows & np.isfinite(samples.time))
    steps = np.diff(samples.time[rows])
    period = float(np.median(steps[steps > 0])) if (steps > 0).any() else settings.over_s
    over = max(round(settings.over_s / period), 1)
    level = np.sqrt(np.maximum(uniform_filter1d(values**2, over, mode="nearest"), 0.0))
    least = settings.least
    if least is None:
        least = settings.share * float(np.quantile(level[part.rows], 0.95))
    return np.asarray(level >= least)


def _at_rate(values: Floats, piece: UniformSegment, rate: float) -> Floats:
    """Channels (C, T) of an even stretch at ``rate`` [Hz], behind a low-pass where it is lower."""
    recorded = 1.0 / piece.period
    if recorded < (1.0 - SLOWER) * rate:
        raise ValueError(
            f"it is sampled at {recorded:.4g} Hz, wear_records.rate_Hz = {rate:g} Hz: lower that, "
            "or record faster"
        )
    if abs(recorded / rate - 1.0) < SAME_RATE:
        return values
    from scipy.signal import resample_poly

    ratio = Fraction(rate / recorded).limit_denominator(1000)
    return resample_poly(values, ratio.numerator, ratio.denominator, axis=1, padtype="line")
