"""Settings of an optimisation: parts of a machine, reliability, grouping of blocks, search."""

import re
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Annotated, Literal

from pipeline.cutting.economics.cost import EnergyParameters
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import TipModes
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import Objective
from pipeline.schema.ranges import Range, Ranged, Share
from pipeline.twin.cut.coefficients import WearRule

OBJECTIVES: tuple[Objective, ...] = ("time", "cost", "energy", "wear")
"""Objectives in the order of every array that has one column for each."""
MANY = 1_000_000
"""Greatest count of a search."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True, kw_only=True)
class ReliabilitySettings(Ranged, section="certainty"):
    """Probability with which the load limit is kept, and the spread of uncertain quantities."""

    epsilon: Annotated[float, Range(least=1e-4, most=0.999999)] = 0.01
    """P(load > limit) over a whole part is at most this [1]; 0.5 and above takes nominal values."""
    draws: Annotated[int, Range(least=16, most=100_000)] = 1024
    """Number of draws of the uncertain quantities."""
    seed: Annotated[int, Range(least=0, most=2**32 - 1)] = 0
    """Seed of the random numbers."""
    measured_elsewhere: Share = 0.1
    catalogue: Share = 0.25
    """Standard deviation of coefficients that come from others' measurements, or a catalogue, as a
    share of them [1]; identified ones have their own intervals."""
    runout_um: Annotated[float, Range(least=0.0, most=1000.0, unit="um")] = 3.0
    """Rayleigh scale of the runout of a tool in its holder where the tool table has none [um]."""
    depth_um: Annotated[float, Range(least=0.0, most=10_000.0, unit="um")] = 10.0
    """Standard deviation of axial depth: tool length, blank [um]."""
    model: Share = 0.02
    """Standard deviation of the model's peak loads, as a share [1]; the error on recordings outside
    of the training data counts if it is greater."""
    failed: Share = 0.1
    not_judged: Share = 0.25
    """Least standard deviation of what rests on a sub-model whose verdict failed, or that was not
    judged, as a share [1].  By default those of others' measurements and of a catalogue: what was
    not proved on the machine counts as no better than what was not measured on it."""


@dataclass(frozen=True, kw_only=True)
class Grouping(Ranged, section="grouping"):
    """Rules for blocks that share an F or an S."""

    least_block_s: Annotated[float, Range(least=0.0, most=3600.0, unit="s")] = 0.05
    """Blocks are merged until each group takes at least this [s]."""
    least_gain: Share = 1e-4
    """An F word that is added has to save this share of the time of the whole part [1]."""
    least_speed_gain: Share = 5e-3
    """Share of the time of the whole part that an added S word has to save [1]: a change of speed
    inside an operation is noticed."""
    speeds: Literal["blocks", "own"] = "blocks"
    """Whether S words may be added at any block, or only the program's own changed."""
    split: bool = False
    """Whether long straight blocks are split where their engagement changes and that gains."""
    split_gain: Annotated[float, Range(least=0.0, most=100.0)] = 0.05
    """Difference of the feeds of two parts of a block below which they stay one, as a share [1]."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings(Ranged, section="search"):
    """Sizes of the search from the blockwise optimum on, and of the baselines beside it."""

    population: Annotated[int, Range(least=4, most=MANY)] = 48
    generations: Annotated[int, Range(least=1, most=MANY)] = 40
    """Generations of the genetic search from the blockwise optimum."""
    full: Annotated[int, Range(least=1, most=MANY)] = 50
    """Evaluations of the whole twin at most."""
    paper_generations: Annotated[int, Range(least=1, most=MANY)] = 10
    """Generations of the genetic search from random individuals, as in Sim2023."""
    baseline: Annotated[int, Range(least=0, most=MANY)] = 5000
    """Evaluations of the best of many; 0 leaves it out."""
    front: Annotated[int, Range(least=4, most=MANY)] = 48
    """Members of a Pareto front."""
    seed: Annotated[int, Range(least=0, most=MANY)] = 0
    """Seed of the random numbers."""


@dataclass(frozen=True, kw_only=True)
class OptimisationSettings:
    """The section ``optimisation``: everything but the part itself."""

    certainty: ReliabilitySettings = field(default_factory=ReliabilitySettings)
    grouping: Grouping = field(default_factory=Grouping)
    search: SearchSettings = field(default_factory=SearchSettings)
    """Settings of reliability, grouping and search."""
    proof_comment: bool = False
    """Whether the proof's hash stands in a comment at the end of the program."""
    with_residual: bool = False
    """Whether following errors hold what the residual network of the machine adds to them, and
    their limits half of its 90 % interval too; ``kerf optimise`` alone loads one."""
    wear: WearRule = "criterion"
    """Wear of the tools that limits hold for: that at which they are changed, where the growth of
    forces was fitted in the part's material; what is known of them now; none."""


@dataclass(frozen=True, kw_only=True)
class Part(Ranged, section="parts"):
    """One part program with its blank, tools, objective and limits."""

    program: str
    """File below the machine's raw records."""
    stock: str
    """Blank, see :func:`pipeline.cutting.engagement.stock.stock_of` [mm]."""
    tool_table: str
    material: str
    """Names in conf/tool/ and conf/material/."""
    name: str = ""
    """Name of the files that are written for it; the program's own by default."""
    objective: Objective = "time"
    """Objective: ``time``, ``cost``, ``energy``, ``wear``, or ``pareto`` for the knee of their
    front."""
    limits: CutLimit = field(default_factory=CutLimit)
    """Limits of the cut."""
    resolution_mm: Annotated[float, Range(least=0.001, most=100.0, unit="mm")] = 0.2
    """Cell of the blank [mm]."""
    work_offset: str | None = None
    """Work offset in which the blank is measured; by default that of the first cut."""

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
        super().__post_init__()

    @property
    def label(self) -> str:
        """Name of the files that are written for it."""
        return self.name or PurePosixPath(self.program).stem


@dataclass(frozen=True, kw_only=True)
class Parts:
    """The section ``parts`` of a machine."""

    programs: tuple[Part, ...]
    """Parts in the order of the report."""
    drive: SpindleDrive | None = None
    """Spindle drive; where none is known, speeds need a limit of their own."""
    dynamics: TipModes | None = None
    """Modes of the tools' tips; without them chatter is no constraint."""
    energy: EnergyParameters | None = None
    """Power that the machine draws beside the cut."""

    def __post_init__(self) -> None:
        names = [part.label for part in self.programs]
        if not names:
            raise ValueError("parts.programs is empty: name a program, or leave the machine out of "
                             "fleet.optimised")  # fmt: skip
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"parts.programs has two programs called {name}: rename one")
