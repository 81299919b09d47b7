"""Windows of signals at known tool wear, their scaling, lives of tools; section ``wear_records``.

A recording is one file a cut, a part of a table with many experiments, or one file an experiment.
Tool, wear and conditions stand in its columns, in its name, or in a table beside the recordings.
A life is all that was recorded of one tool.  Wear is flank wear VB [um], or a class (1 worn, 0
not).  :func:`pipeline.signals.wear_lives.read_lives` reads them by section ``wear_records`` of the
machine's file:

    lives = read_lives(signals, records)
    windows = WearWindows.joined([life.windows for life in lives.lives])
    windows.values                                    # (N, C, L) float32, in windows.units
    windows.wear, windows.tool, windows.conditions["feed"]    # (N,) each
    scaling = ChannelScaling.of(windows.of(windows.tool != "T3").values)   # training windows only
    scaling.scaled(windows.values)                    # (N, C, L) float32, about zero and one wide
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from pipeline.schema.arrays import Bools, Floats, Singles
from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged, Share
from pipeline.signals.recordings import WORDS, Channel
from pipeline.signals.units import conversion

Words = NDArray[np.str_]
_BY_WINDOW = ("values", "wear", "measured", "tool", "recording", "time", "progress")

NORMAL_IQR = 1.349
"""Interquartile range of a normal distribution of standard deviation 1."""
NORMAL_90 = 3.290
"""Range of a normal distribution of standard deviation 1 that holds 90 %."""


@dataclass(frozen=True, kw_only=True)
class ChannelScaling:
    """Shift and scale of each channel; kept with a model."""

    shift: tuple[float, ...]
    scale: tuple[float, ...]
    """C each, in the channel's unit."""

    @staticmethod
    def of(values: Singles) -> "ChannelScaling":
        """Median and normal-consistent interquartile range of windows, shape (N, C, L).

        A channel at rest for most of the time takes its 90 % range instead, or its standard
        deviation; a constant one takes 1.
        """
        flat = np.asarray(values, np.float64).transpose(1, 0, 2).reshape(values.shape[1], -1)
        least, low, shift, high, most = np.quantile(flat, [0.05, 0.25, 0.5, 0.75, 0.95], axis=1)
        spread, wide = (high - low) / NORMAL_IQR, (most - least) / NORMAL_90
        scale = np.where(spread > 0.3 * wide, spread, np.where(wide > 0, wide, flat.std(axis=1)))
        scale = np.where(scale > 1e-9 * np.maximum(np.abs(shift), 1e-300), scale, 1.0)
        return ChannelScaling(shift=tuple(shift.tolist()), scale=tuple(scale.tolist()))

    def scaled(self, values: Singles) -> Singles:
        """Windows about zero and about one wide, shape (N, C, L)."""
        shift, scale = (np.array(one)[:, None] for one in (self.shift, self.scale))
        return ((values - shift) / scale).astype(np.float32)


@dataclass(frozen=True, kw_only=True, eq=False)
class WearWindows:
    """N windows of C channels and L samples, with the wear that they were recorded at."""

    values: Singles
    """Values in ``units``; shape (N, C, L)."""
    channels: tuple[str, ...]
    units: tuple[str, ...]
    """Names and units of the C channels."""
    rate_Hz: float
    """Rate of the samples [Hz]."""
    wear: Floats
    """Flank wear [um], or 1 worn and 0 not; in ``wear_unit``.  NaN where it is not known, which
    only recordings whose wear is to be estimated have; shape (N,)."""
    wear_unit: str
    """``"um"``, or ``"1"`` for a class."""
    measured: Bools
    """Whether the wear was measured, or interpolated between measurements of the same tool; shape
    (N,)."""
    conditions: Mapping[str, Any]
    """Numbers in ``condition_units``, or words; those of the settings; shape (N,)."""
    condition_units: Mapping[str, str]
    """Unit of each condition that is a number; words have none."""
    tool: Words
    recording: Words
    """Tool, and recording or part of one; shape (N,)."""
    time: Floats
    """Beginning of the window in its recording [s]; shape (N,)."""
    progress: Floats
    """Use of the tool, as the settings name it; it orders the windows of a life; shape (N,)."""
    progress_unit: str
    """``"s"`` of the recording's time, ``"1"`` of the recording's number."""

    def __len__(self) -> int:
        return len(self.wear)

    @property
    def is_class(self) -> bool:
        """Whether wear is worn or not, no number."""
        return self.wear_unit == "1"

    def of(self, rows: Any) -> "WearWindows":
        """Some of the windows, by a mask, by numbers or as a slice."""
        return replace(
            self, **{name: getattr(self, name)[rows] for name in _BY_WINDOW},
            conditions={name: values[rows] for name, values in self.conditions.items()},
        )  # fmt: skip

    @staticmethod
    def joined(parts: Sequence["WearWindows"]) -> "WearWindows":
        """Windows of several parts of one machine, of one set of channels, rate and length."""
        if not parts:
            raise ValueError("there are no windows to join: give one part at least")
        first = parts[0]
        for other in parts[1:]:
            mine, theirs = (
                (one.channels, one.units, one.rate_Hz, one.values.shape[1:], one.wear_unit)
                for one in (first, other)
            )
            if mine != theirs:
                raise ValueError(f"windows of {mine} and of {theirs} do not go together")
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in parts]) for name in _BY_WINDOW
        }
        return replace(
            first, **arrays,
            conditions={
                name: np.concatenate([one.conditions[name] for one in parts])
                for name in first.conditions
            },
        )  # fmt: skip

    def sha256s(self) -> list[str]:
        """SHA-256 of the samples of each window: a copy has the same, wherever it stands."""
        return [sha256(np.ascontiguousarray(one).tobytes()).hexdigest() for one in self.values]


@dataclass(frozen=True, kw_only=True)
class LifeFile:
    """Recording of a life: its name, its raw file, and the hash of its bytes or samples."""

    name: str
    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolLife:
    """All that was recorded of one tool."""

    tool: str
    """Name of the tool."""
    files: tuple[LifeFile, ...]
    """Recordings, in the order of progress."""
    windows: WearWindows
    """Windows in the order of progress."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Lives:
    """Lives of tools in the order of their names, and recordings of no use with the reason."""

    lives: tuple[ToolLife, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)


WEAR_UNIT = "um"
"""Unit of flank wear VB (ISO 8688-2) in windows and models."""
CLASS_UNIT = "1"
"""Unit of wear that is a class: 1 worn, 0 not."""


@dataclass(frozen=True, kw_only=True)
class WearSource(Ranged, section="wear_records.wear"):
    """Source of the tool's wear: a number, or words for worn and not worn."""

    name: str
    """Name of the column or condition."""
    unit: str = WEAR_UNIT
    """Unit of the number where it is recorded without one."""
    worn: tuple[str, ...] = ()
    unworn: tuple[str, ...] = ()
    """Words of a tool that is worn and of one that is not; empty where wear is a number."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.worn) != bool(self.unworn):
            raise ValueError(
                f"wear_records.wear of {self.name!r} has words of one class only: name those of "
                "both worn and unworn, or none for a number"
            )
        try:
            conversion(self.unit, WEAR_UNIT)
        except ValueError as error:
            raise ValueError(f"wear_records.wear.unit = {self.unit!r}: {error}") from error

    @property
    def is_class(self) -> bool:
        """Whether wear is worn or not, no number."""
        return bool(self.worn)

    @property
    def target_unit(self) -> str:
        """Unit of wear in windows."""
        return CLASS_UNIT if self.is_class else WEAR_UNIT


@dataclass(frozen=True, kw_only=True)
class ConditionTable:
    r"""A table beside the recordings with one row for each."""

    file: str
    """Raw file of the table below the machine's folder, among the tables of section ``records``."""
    key: str
    """Column by which a recording's row is found."""
    name: str = ""
    """Regular expression on the recording's name whose first group is the key's value
    (``"experiment_(\\d+)"``); empty where the key holds names of files, below the machine's folder
    or beside the table."""


@dataclass(frozen=True, kw_only=True)
class InCut(Ranged, section="wear_records.in_cut"):
    """Rows of a recording in cut."""

    channel: Channel
    """Channel of words (a phase of the process), or of numbers whose level counts."""
    values: tuple[str, ...] = ()
    """Patterns of the words of a cut."""
    least: NotNegative | None = None
    """Level from which on the tool is in cut, in SI; the level is the RMS over ``over_s``."""
    share: Share = 0.2
    """Level as a share of the recording's 95 % quantile where ``least`` is not given [1]."""
    over_s: Positive = 0.1
    """Time over which the RMS is taken [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.channel.quantity == WORDS) != bool(self.values):
            raise ValueError(
                f"wear_records.in_cut.values = {list(self.values)} do not fit channel "
                f"{self.channel.column!r}: name the words of a cut for a channel of quantity words,"
                " and none for one of numbers"
            )


@dataclass(frozen=True, kw_only=True)
class WearRecords(Ranged, section="wear_records"):
    """Recordings that show the wear of tools, and the windows that are made of them."""

    recordings: tuple[str, ...]
    """Patterns of raw files below the machine's folder."""
    channels: Mapping[str, Channel]
    """Signals of a window, in its order; any number of them."""
    wear: WearSource
    """Source of the wear."""
    tool: str = ""
    """Condition that names the tool, whose recordings belong together in every split; empty where
    each recording, or part of one, is a tool of its own."""
    progress: str = ""
    """Continuous condition that grows with the use of the tool (time in cut, length, number of the
    cut); empty for the time since the recording began [s], or where a tool has several recordings
    without such a condition, for their number in the order of their names."""
    continuous: Mapping[str, str] = field(default_factory=dict)
    """Conditions that are numbers -> the unit in which they are given and, where they are recorded
    without one, are taken to be."""
    discrete: tuple[str, ...] = ()
    """Conditions that are words: material, type of cut."""
    parts: tuple[str, ...] = ()
    """Columns whose values separate the parts of a table; they are conditions too."""
    table: ConditionTable | None = None
    """Table of conditions beside the recordings."""
    name: str | None = None
    """Regular expression on a recording's name whose named groups are conditions."""
    in_cut: InCut | None = None
    """Rows in cut; None for all."""
    rate_Hz: Positive
    """Rate of the windows [Hz]; what was recorded faster is low-passed and decimated."""
    length: Annotated[int, Range(least=8)] = 500
    """Samples L of a window [1]."""
    most: Count | None = None
    """Windows of one recording at most, evenly spread [1]; None for all."""
    interpolate: bool = True
    """Whether wear of a recording that was not measured is interpolated between those of the same
    tool before and after it; else the recording is left out."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.channels:
            raise ValueError("wear_records.channels is empty: name a channel")
        if self.progress and self.progress not in self.continuous:
            raise ValueError(
                f"wear_records.progress = {self.progress!r} is none of wear_records.continuous = "
                f"{list(self.continuous)}: name it there with its unit"
            )
        if both := sorted(set(self.continuous) & set(self.discrete)):
            raise ValueError(
                f"wear_records: condition {both[0]!r} is both continuous and discrete: name it in "
                "one of them"
            )
        for name, channel in self.channels.items():
            if channel.quantity == WORDS:
                raise ValueError(
                    f"wear_records.channels.{name} is a channel of words: name one of numbers"
                )

    @property
    def numbers(self) -> dict[str, str]:
        """Conditions that are numbers, and the wear where it is one -> their units."""
        wear = {} if self.wear.is_class else {self.wear.name: self.wear.unit}
        return {**self.continuous, **wear}

    @property
    def words(self) -> list[str]:
        """Conditions that are words, the tool, and the wear where it is a class; sorted."""
        wear = [self.wear.name] if self.wear.is_class else []
        return sorted({*self.discrete, self.tool, *wear} - {""})

    @property
    def window_s(self) -> float:
        """Length of a window [s]."""
        return self.length / self.rate_Hz
