"""Parts whose programs are optimised: blank, tools, material, aim and limits of each."""

import re
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import get_args

from pipeline.cutting.economics.cost import EnergyParameters
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import TipModes
from pipeline.optimisation.settings import CutLimit, Objective

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True, kw_only=True)
class Part:
    """One part program and what a person decides about it.

    Parameters
    ----------
    program : str
        File below the machine's raw records.
    name : str
        Of the files that are written for it; the program's own without its ending by default.
    stock : str
        Blank, see :func:`pipeline.cutting.engagement.stock.stock_of` [mm].
    tool_table, material : str
        Names in conf/tool/ and conf/material/.
    objective : str
        ``time``, ``cost``, ``energy``, ``wear``, or ``pareto`` for the knee of their front.
    limits : CutLimit
        Of the cut.
    resolution_mm : float
        Cell of the blank [mm].
    work_offset : str, optional
        That the blank is measured in; by default that of the first cut.

    Raises
    ------
    ValueError
        When the program is not below the records, or a value is out of its range.
    """

    program: str
    stock: str
    tool_table: str
    material: str
    name: str = ""
    objective: Objective = "time"
    limits: CutLimit = field(default_factory=CutLimit)
    resolution_mm: float = 0.2
    work_offset: str | None = None

    def __post_init__(self) -> None:
        path = PurePosixPath(self.program)
        if path.is_absolute() or ".." in path.parts or not path.name:
            raise ValueError(
                f"parts.program = {self.program!r} must be a file below the machine's raw records"
            )
        if not NAME.fullmatch(self.label):
            raise ValueError(
                f"parts.name = {self.label!r} names files and a heading: use letters, digits, '_', "
                "'-' and '.', as in `name: PLATE-1`"
            )
        if self.objective not in get_args(Objective):
            known = ", ".join(get_args(Objective))
            raise ValueError(f"parts.objective = {self.objective!r} is none of {known}")
        if not 0.001 <= self.resolution_mm <= 100.0:
            raise ValueError(
                f"parts.resolution_mm = {self.resolution_mm:g} is out of its range, 0.001 to 100"
            )

    @property
    def label(self) -> str:
        """What files that are written for it are called."""
        return self.name or PurePosixPath(self.program).stem


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The section ``parts`` of a machine.

    Parameters
    ----------
    programs : tuple of Part
        In the order of the report.
    drive : SpindleDrive, optional
        Of the spindle; where none is known, speeds need a limit of their own.
    dynamics : TipModes, optional
        Of the tools' tips; without them nothing is said of chatter.
    energy : EnergyParameters, optional
        What the machine draws beside the cut.

    Raises
    ------
    ValueError
        When there is no program, or two have the same name.
    """

    programs: tuple[Part, ...]
    drive: SpindleDrive | None = None
    dynamics: TipModes | None = None
    energy: EnergyParameters | None = None

    def __post_init__(self) -> None:
        names = [part.label for part in self.programs]
        if not names:
            raise ValueError("parts.programs is empty: name a program, or leave the machine out of "
                             "fleet.optimised")  # fmt: skip
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"parts.programs has two programs called {name}: rename one")
