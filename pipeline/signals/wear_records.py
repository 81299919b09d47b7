"""Section ``wear_records`` of a machine's file: the recordings that show the wear of tools.

A recording is one file a cut, a part of a table with many experiments, or one file an experiment.
Tool, wear and conditions stand in its columns, in its name, or in a table beside the recordings.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged, Share
from pipeline.signals.recordings import WORDS, Channel
from pipeline.signals.units import conversion

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
    def window_s(self) -> float:
        """Length of a window [s]."""
        return self.length / self.rate_Hz
