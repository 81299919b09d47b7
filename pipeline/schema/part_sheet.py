"""Set-up sheet of an optimised part program: tools, changes, path, set-up.

F is in the unit in which the program writes it, S in [rev/min], lengths in [mm]; None is unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from pipeline.schema.program_cut import CutWarning, ToolTotals

Feed = float | None
"""F in the unit of its row, or a feed per tooth [mm]; None where there is none."""
FeedUnit = Literal["mm/min", "mm/rev", "in/min", "in/rev", "1/min"]
"""Unit of F as the program writes it: G21 or G20 with G94, G95 or G93."""


@dataclass(frozen=True, kw_only=True)
class FeedRise:
    """Line in which the feed per tooth of a tool rose most, as commanded before and after [mm]."""

    line: int
    before_mm: float
    after_mm: float


@dataclass(frozen=True, kw_only=True)
class ToolUse:
    """One tool in one operation before and after, beside the range that is usual for it."""

    tool: int
    """Number of the tool."""
    name: str
    """Name for people."""
    operation: str = ""
    """Kind of machining; empty where operations were not distinguished."""
    before: ToolTotals
    after: ToolTotals
    """Worst values of its blocks and sums over them; the feed per tooth is that of the blocks in
    which it rose, where there are none of those in which it changed."""
    feed_per_tooth_range_mm: tuple[float, float] | None
    cutting_speed_range_m_min: tuple[float, float] | None
    """Least and greatest f_z [mm] and v_c [m/min]; None where no source gives them."""
    range_source: str
    """Source of the ranges; empty without any."""
    kept: str | None = None
    """Reason why F and S of this tool stay as programmed; None where they may change."""
    binds: str | None = None
    """Limit that holds its blocks back for the longest; None where none does."""
    no_faster: str | None = None
    """Reason why its S is nowhere above that programmed; None where it is somewhere, or all is
    kept."""
    no_more_feed: str | None = None
    """Reason why some of its blocks have no more feed than programmed, by their depth, width or
    bending; None where none is held so."""
    rise: FeedRise | None = None
    """Greatest rise of its feed per tooth, and its place; None where it did not rise."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """The tool's own limits, by the field of the part's limits in whose place they hold."""


@dataclass(frozen=True, kw_only=True)
class FeedChange:
    """Blocks in a row of one tool whose F and S were alike and are alike."""

    first_line: int
    last_line: int
    """First and last line of the program."""
    tool: int
    """Number of the tool."""
    operation: str = ""
    """Kind of machining; empty where it was not recognised."""
    feed_unit: FeedUnit = "mm/min"
    """Unit of F."""
    feed_before: float
    feed_after: float
    """F before and after."""
    speed_before: float
    speed_after: float
    """S before and after [rev/min]."""
    feed_per_tooth_before_mm: Feed
    feed_per_tooth_after_mm: Feed
    """F / (N S) of what is commanded [mm]; None in air."""
    binds: str | None = None
    """Limit that binds for the longest; None where none does."""


@dataclass(frozen=True, kw_only=True)
class ProgramLine:
    """One line of the program, and what became of it."""

    line: int
    """Line of the program as it is written, counting from 1."""
    before: str | None
    after: str | None
    """Text before and after; ``before`` None where the line was added, ``after`` None where it is
    the same."""
    feed_before: Feed = None
    feed_after: Feed = None
    """F in force in its moves at feed, as the program writes it; None without any."""
    speed_before: float | None = None
    speed_after: float | None = None
    """S in force in its moves; None without any."""


@dataclass(frozen=True, kw_only=True)
class PathTrace:
    """Path of the tool's tip at feed in the coordinates of the blank, thinned, with the blank."""

    frame: str
    """Work offset, ``"G54"``."""
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    z_mm: tuple[float, ...]
    """Coordinates of the V points of the path [mm]."""
    starts: tuple[int, ...]
    """Points that begin a new stroke, ascending."""
    column: tuple[int, ...]
    """Column of ``Traces`` of the path to each point; its load is drawn there."""
    line: tuple[int, ...]
    """Line of the program that moves to each point."""
    blank_low_mm: tuple[float, float, float]
    blank_high_mm: tuple[float, float, float]
    """Least and greatest X, Y, Z of the blank [mm]."""
    round_blank: bool = False
    """Whether the blank is a bar that stands on its end."""


@dataclass(frozen=True, kw_only=True)
class SetupTool:
    """A tool that the program calls."""

    tool: int
    """Number of the tool."""
    name: str
    kind: str
    """Kind for people; empty where the tool table does not hold it."""
    diameter_mm: float | None
    stickout_mm: float | None
    """Diameter and stick-out [mm]."""
    flutes: int | None
    """Number of teeth."""
    length_mm: float | None
    """Length in its register [mm]; None where there is none."""
    time_s: float
    in_material_s: float
    """Time with this tool in the spindle, and in the material, in the optimised program [s]."""
    life_share: float | None
    life_share_low: float | None = None
    life_share_high: float | None = None
    """Share of its life that one part uses, and at the ends of its spread [1]."""


@dataclass(frozen=True, kw_only=True)
class WorkOffset:
    """A work offset that the program uses, as it was assumed."""

    name: str
    """Name of the work offset, ``"G54"``, …"""
    position_mm: tuple[float, float, float] | None
    """X, Y, Z of its zero in the machine's frame [mm]; None where the set-up does not give it."""


@dataclass(frozen=True, kw_only=True)
class SetupSheet:
    """Set-up before the start of the optimised program."""

    tools: tuple[SetupTool, ...]
    """Tools in the order in which they are called."""
    offsets: tuple[WorkOffset, ...]
    """Work offsets in the order in which they are used."""
    blank_offset: str
    """Work offset in whose coordinates the blank lies."""
    warnings: tuple[CutWarning, ...]
    """Warnings of the optimised program's cut."""
