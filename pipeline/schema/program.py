"""Stored simulation of a part program: predicted times by tool, block type and limit.

Times are in [s], lengths in [mm].
"""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class ToolTime:
    """Predicted times and path length of one tool."""

    tool: int
    """Number of the tool; -1 before the first is in the spindle."""
    time_s: float
    cutting_s: float = 0.0
    rapid_s: float = 0.0
    """Time in all, in moves at a feed, in rapids [s]."""
    length_mm: float = 0.0
    """Path length [mm]."""


@dataclass(frozen=True, kw_only=True)
class SimulatedProgram:
    """The summary of a part program that was run through an identified control."""

    program: str
    """Name of the program."""
    refused: str | None = None
    """Reason why the program cannot be followed; then no time is known."""
    machine: str = ""
    origin: str = ""
    """Machine whose control it is, and whether its records are simulated or recorded."""
    file: str = ""
    sha256: str = ""
    """The program below ``data/raw/<machine>``, and the hash of its bytes."""
    total_time_s: float | None = None
    """Predicted time [s]."""
    total_time_90_s: tuple[float, float] | None = None
    """90 % interval of the predicted time [s]; None where too few programs ran."""
    path_length_mm: float | None = None
    """Path length [mm]."""
    cutting_time_s: float | None = None
    """Predicted time of moves at a feed [s]."""
    origin_mm: tuple[float, float, float] | None = None
    """X, Y, Z where the first move starts, in the machine's frame [mm]."""
    by_tool: tuple[ToolTime, ...] = ()
    """Times in the order in which the tools are used."""
    by_type: Mapping[str, float] = field(default_factory=dict)
    by_limit: Mapping[str, float] = field(default_factory=dict)
    """Time [s] by type of block, and of cutting by what limits the speed of the block."""
    blocks: int | None = None
    """Number of moves."""
    violations: tuple[str, ...] = ()
    """Lines that leave the machine's travel, speeds, feeds or tool lengths, in words."""
