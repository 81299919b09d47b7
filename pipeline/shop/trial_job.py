"""What a trial cut needs beside the program: blank, tools, material, limit of the load."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from pipeline.shop.cutting_parameters import EndMill, Workpiece

Box = tuple[float, float, float, float, float, float]
"""x from and to, y from and to, z from and to [mm]."""

LENGTH = 100.0
"""Of a tool in its holder, where the set-up sheet says none [mm]."""


@dataclass(frozen=True, kw_only=True)
class TrialJob:
    """A job as the shop's set-up sheet has it.

    Parameters
    ----------
    blank : tuple of 6 floats
        Box in the coordinates of the work offset: x, y, z from and to [mm].
    limit_load_N : float
        That peaks of the load are held against [N].
    tools : mapping of int to EndMill
        Those that cut, by the number that the program calls.  Runout and tilt are those of a usual
        mounting: each seed mounts them anew.
    workpiece : Workpiece
        The material; each seed has a batch of its own.
    lengths : mapping of int to float
        Of the tools in their holders [mm].
    dialect : {"fanuc", "linuxcnc", "siemens"}
        That the program is written in.

    Raises
    ------
    ValueError
        When the blank is empty, the limit is not positive or there is no tool.
    """

    blank: Box
    limit_load_N: float
    tools: Mapping[int, EndMill]
    workpiece: Workpiece = field(default_factory=Workpiece)
    lengths: Mapping[int, float] = field(default_factory=dict)
    dialect: Literal["fanuc", "linuxcnc", "siemens"] = "fanuc"

    def __post_init__(self) -> None:
        b = self.blank
        if len(b) != 6 or not (b[0] < b[1] and b[2] < b[3] and b[4] < b[5]):
            raise ValueError(
                f"TrialJob.blank = {b} must be x, y and z from and to [mm], the lower one first"
            )
        if not (isfinite(self.limit_load_N) and self.limit_load_N > 0):
            raise ValueError(
                f"TrialJob.limit_load_N = {self.limit_load_N} [N] must be finite and positive"
            )
        if not self.tools:
            raise ValueError("TrialJob.tools = {} must have the end mill that cuts")

    def length(self, tool: int) -> float:
        """Of a tool in its holder [mm]; 0 of none."""
        return self.lengths.get(tool, LENGTH) if tool > 0 else 0.0
