"""Recordings of axes for the residual networks: following errors on an even grid.

A recording holds, for each axis, commanded and measured position, or the control's own position
error; the torque command where it was recorded.  Words in columns of a table (a tool, a cut) may
tell parts of it apart, and the end of a recording may be held out by time: each part is a case of
its own, with the hash of its own samples, so that no part is judged under another name.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.signals.conditions import PART, parts_of, samples_sha256
from pipeline.signals.recordings import Channel, Recording, Samples, read_recordings
from pipeline.signals.windows import UniformSegment
from pipeline.submodels.statistics import grid_step

MOTION = ("reference", "position", "error")
"""Channels of an axis that are lengths."""


@dataclass(frozen=True, kw_only=True)
class ErrorChannels(Ranged, section="following_residual_records.axes"):
    """Channels of one axis: both positions, or the error."""

    reference: Channel | None = None
    position: Channel | None = None
    """Commanded and measured position, of the same frame."""
    error: Channel | None = None
    """Commanded less measured position, where the control records it itself."""
    command: Channel | None = None
    """Torque command or current of the drive: a measurement, which only estimation may use."""
    lead_mm: Positive | None = None
    """Lead of the screw [mm], where errors that return with each turn are to be learnt; positions
    are then those of the machine's frame."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.error is None and (self.reference is None or self.position is None):
            raise ValueError(
                "following_residual_records: an axis names neither its error nor both its "
                "commanded and its measured position: name them"
            )

    @property
    def channels(self) -> dict[str, Channel]:
        """Named channels, lengths as such."""
        named = {name: getattr(self, name) for name in (*MOTION, "command")}
        return {
            name: replace(one, quantity="position") if name in MOTION and not one.quantity else one
            for name, one in named.items()
            if one is not None
        }


@dataclass(frozen=True, kw_only=True)
class ResidualRecords(Ranged, section="following_residual_records"):
    """Recordings that show following errors."""

    recordings: tuple[str, ...]
    """Patterns of raw files below the machine's folder."""
    axes: Mapping[str, ErrorChannels]
    """Channels by axis letter."""
    parts: tuple[str, ...] = ()
    """Columns whose values tell the parts of a table apart; each part is a recording of its own,
    called ``<file>#<column>=<value>,…`` in section ``roles``."""
    group: str = ""
    """Name of the one of ``parts`` that groups recordings in splits, such as the tool."""
    last_share: Annotated[float, Range(least=0.0, below=1.0)] = 0.0
    """Share of each training recording, its end, that is held out [1]: for a machine of which one
    recording exists."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.axes:
            raise ValueError(
                "following_residual_records.axes is empty: name an axis and its channels"
            )
        if self.group and self.group not in self.parts:
            raise ValueError(
                f"following_residual_records.group = {self.group!r} is none of "
                f"following_residual_records.parts = {list(self.parts)}: name it there"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisRun:
    """Axis in a recording, T even samples in SI."""

    error: Floats
    """Measured following error, commanded less measured position [m]; shape (T,)."""
    reference: Floats | None = None
    """Commanded position [m]; shape (T,)."""
    command: Floats | None = None
    """Torque command, in the recording's unit; shape (T,)."""
    filled: Bools = field(default_factory=lambda: np.zeros(0, bool))
    """Samples that were not recorded, but put between their neighbours; shape (T,)."""

    @property
    def step(self) -> float:
        """Resolution of the scale, else of the recorded error [m]; 0 where no grid shows it."""
        position = self.error if self.reference is None else self.reference - self.error
        return grid_step(np.asarray(position)[~self.filled] if len(self.filled) else position)

    def within(self, rows: slice) -> "AxisRun":
        """Some of its samples."""
        return AxisRun(
            error=self.error[rows],
            reference=None if self.reference is None else self.reference[rows],
            command=None if self.command is None else self.command[rows],
            filled=self.filled[rows],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """Recording, or a part of one."""

    name: str
    file: str
    """Its name, and the raw file that it is of."""
    group: str
    """Group that stays together in splits."""
    sha256: str
    """Hash of the raw bytes, or of the samples where it is a part of a file."""
    period: float = float("nan")
    """Sampling period [s]."""
    axes: Mapping[str, AxisRun] = field(default_factory=dict)
    """Axes that it shows, by letter."""
    lacking: Mapping[str, str] = field(default_factory=dict)
    """Axes that it does not show, with the reason."""
    start: float = 0.0
    """Time of its first sample in the recording [s]."""
    last: bool = False
    """Whether it is the end of a training recording, held out by time."""

    @property
    def samples(self) -> int:
        """T [1]."""
        return max((len(one.error) for one in self.axes.values()), default=0)


def read_runs(
    signals: Path, records: ResidualRecords, is_training: Callable[[str, str], bool]
) -> list[Run]:
    """Recordings that ``records`` names, with their parts, in the order of their names.

    ``is_training`` says whether a recording, or a part of one, is learnt from, by its name and its
    raw file. ValueError when ``signals`` has no manifest, or none of its files fits the patterns.
    """
    declared = {
        f"{letter} {name}": channel
        for letter, one in records.axes.items()
        for name, channel in one.channels.items()
    }
    files = read_recordings(
        signals, declared, patterns=records.recordings,
        preferred=lambda name: is_training(name, name),
        section="following_residual_records.recordings",
    )  # fmt: skip
    found: list[Run] = []
    for file in files:
        for run in _of_file(file, records):
            share = records.last_share if is_training(run.name, run.file) else 0.0
            found += _split(run, share) if share and run.axes else [run]
    return found


def _of_file(file: Recording, records: ResidualRecords) -> list[Run]:
    """Parts of one file, each on an even grid, the longest stretch without a gap."""
    blank = Run(name=file.name, file=file.name, group=file.name, sha256=file.sha256)
    if file.file is None:
        return [_nothing(blank, records, file.reason)]
    samples = file.load()
    if not records.parts:
        return _stretches(samples, np.ones(len(samples.time), bool), blank, records)
    try:
        parts = parts_of(file.file, records.parts, "following_residual_records.parts")
    except ValueError as error:
        return [_nothing(blank, records, str(error))]
    found = []
    for one in parts:
        name, by = one.name(file.name), one.values.get(records.group, "")
        part = replace(blank, name=name, group=f"{records.group} {by}" if by else name)
        found += _stretches(samples, one.rows, part, records)
    return found


def _stretches(samples: Samples, rows: Any, blank: Run, records: ResidualRecords) -> list[Run]:
    """Stretches without a gap of the rows of one recording, each with the axes that it shows."""
    lacking, shown = {}, {}
    for letter, one in records.axes.items():
        needed = [f"{letter} {name}" for name in one.channels]
        absent = [samples.lacking[name] for name in needed if name in samples.lacking]
        empty = [
            name for name in needed
            if name in samples.channels and not np.isfinite(samples.channels[name][rows]).any()
        ]  # fmt: skip
        if absent:
            lacking[letter] = absent[0]
        elif empty:
            lacking[letter] = f"its channel {empty[0].partition(' ')[2]} holds no value there"
        else:
            shown[letter] = needed
    if not shown:
        return [replace(blank, lacking=lacking)]
    whole = samples.complete([name for names in shown.values() for name in names]) & rows
    try:
        pieces = samples.segments(whole)
    except ValueError as error:
        return [_nothing(blank, records, str(error))]
    found = []
    for number, piece in enumerate(pieces, start=1):
        axes = {letter: _axis(letter, records.axes[letter], samples, piece) for letter in shown}
        name = blank.name if len(pieces) == 1 else f"{blank.name} (part {number})"
        run = replace(
            blank, name=name, period=piece.period, axes=axes, lacking=lacking, start=piece.start
        )
        whole_file = len(pieces) == 1 and blank.name == blank.file
        found.append(run if whole_file else replace(run, sha256=content_hash(run)))
    return found


def _axis(letter: str, channels: ErrorChannels, samples: Samples, piece: UniformSegment) -> AxisRun:
    grid = {
        name: _on_grid(piece, samples.channels[f"{letter} {name}"]) for name in channels.channels
    }
    error = grid.get("error")
    return AxisRun(
        error=grid["reference"] - grid["position"] if error is None else error,
        reference=grid.get("reference"), command=grid.get("command"), filled=piece.filled,
    )  # fmt: skip


def _on_grid(piece: UniformSegment, values: Floats) -> Floats:
    """Values on the even grid; gaps are filled by a smooth curve to preserve the acceleration."""
    from scipy.interpolate import CubicSpline

    found, missing = piece.on_grid(values), piece.filled
    if missing.any() and (~missing).sum() >= 2:
        there = np.flatnonzero(~missing)
        found[missing] = CubicSpline(there, found[there])(np.flatnonzero(missing))
    return found


def _nothing(blank: Run, records: ResidualRecords, reason: str) -> Run:
    return replace(blank, lacking=dict.fromkeys(records.axes, reason))


def _split(run: Run, share: float) -> list[Run]:
    """A training recording without its end, and the end, each with the hash of its own samples."""
    cut = round(run.samples * (1.0 - share))
    parts = []
    for word, rows, last in (("begin", slice(0, cut), False), ("end", slice(cut, None), True)):
        axes = {letter: one.within(rows) for letter, one in run.axes.items()}
        part = replace(
            run, name=f"{run.name}{PART}{word}", group=f"{run.group}{PART}{word}", axes=axes,
            start=run.start + (cut * run.period if last else 0.0), last=last,
        )  # fmt: skip
        parts.append(replace(part, sha256=content_hash(part)))
    return parts


def content_hash(run: Run) -> str:
    """SHA-256 of the samples of a run: a copy of it has the same, whatever it is called."""
    return samples_sha256(
        (letter, values)
        for letter, one in sorted(run.axes.items())
        for values in (one.error, one.reference, one.command)
        if values is not None
    )
