"""Stored simulation of a part program: times by tool, block and limit, and the cut of its blocks.

Times are in [s], depths and chips in [mm], loads in [N], angles in [deg], speeds in [rev/min],
shares in [1]; None is unknown.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from pipeline.schema.drive import AxisInCut

AS_WRITTEN = "as_written"
"""Folder of programs as written with their cuts, beside their optimisation."""
Curve = tuple[float | None, ...]
"""Values along an axis; None where there is none."""


@dataclass(frozen=True, kw_only=True)
class NotKnown:
    """A quantity that is not known, and why."""

    what: str
    why: str


@dataclass(frozen=True, kw_only=True)
class Blank:
    """Blank: as it was named, its work offset, its resolution [mm], and what is odd about it."""

    text: str
    work_offset: str
    resolution_mm: float
    notice: str | None = None


@dataclass(frozen=True, kw_only=True)
class MaterialName:
    """Name of the blank's material."""

    name: str


@dataclass(frozen=True, kw_only=True)
class LoadLimit:
    """Greatest load in the plane [N]; None without a limit."""

    load_N: float | None = None


@dataclass(frozen=True, kw_only=True)
class CutCost:
    """Cost by cause [currency]: machine time, tools with their changes, energy, and their sum."""

    time: float | None
    tools: float | None
    energy: float | None
    sum: float | None
    sum_low: float | None = None
    sum_high: float | None = None
    """The sum at the ends of the tools' lives; None where they have no spread."""


@dataclass(frozen=True, kw_only=True)
class CutQuantities:
    """Quantities of one block that cuts, or the worst of many."""

    feed_per_tooth_mm: float | None
    chip_thickness_mm: float | None
    """Feed per tooth and thickest chip at the highest feed reached [mm]."""
    cutting_speed_m_min: float | None
    """v_c = pi D S at the full diameter D [m/min]."""
    axial_depth_mm: float | None
    radial_depth_mm: float | None
    """Depths of cut [mm]."""
    peak_load_N: float | None
    mean_load_N: float | None
    axial_force_N: float | None
    """Load in the plane, its peak and its mean; peak along the axis [N]."""
    torque_Nm: float | None
    peak_torque_Nm: float | None
    """Mean over the turn, and peak [N m]."""
    power_kW: float | None
    """Power of the cut [kW]."""
    drive_share: float | None
    """Power of the motor over its greatest at that speed [1]."""
    deflection_um: float | None
    """Deflection of the tip [um]."""
    stability_margin: float | None
    """Limit over depth, less 1 [1]."""
    in_material_s: float | None
    """Time in the material [s]."""
    volume_cm3: float | None
    """Volume removed [cm^3]."""
    removal_rate_cm3_min: float | None
    """While cutting [cm^3/min]."""
    tool_life_share: float | None
    """Share of the tools' lives [1]."""
    energy_kWh: float | None
    """Electricity [kWh]."""


@dataclass(frozen=True, kw_only=True)
class CutTotals(CutQuantities):
    """Worst values of blocks that cut, and sums over the rows of the program."""

    blocks: int
    """Blocks that cut."""
    time_s: float | None
    at_feed_s: float | None
    """Time in all, and in moves at feed [s]."""
    air_share: float | None
    """Share of the time at feed in air [1]."""
    highest_removal_rate_cm3_min: float | None
    """The greatest beside the mean [cm^3/min]."""
    cost: CutCost | None
    """Cost; None where prices are not known."""
    tool_life_share_low: float | None = None
    tool_life_share_high: float | None = None
    """Share of the tools' lives at the ends of their spread [1]; None where they have none."""


@dataclass(frozen=True, kw_only=True)
class ToolTotals(CutTotals):
    """Totals of one tool: its number and name."""

    tool: int
    name: str


@dataclass(frozen=True, kw_only=True)
class PartTotals(CutTotals):
    """Totals of the part: line of the greatest load, volume of the blank and what is left of it."""

    peak_line: int | None
    blank_cm3: float | None
    left_cm3: float | None


@dataclass(frozen=True, kw_only=True)
class EdgeForces:
    """Greatest load and power of a tool with a sharp edge and with a worn one."""

    wear_um: float
    """Flank wear VB of the worn edge [um]."""
    peak_load_sharp_N: float | None
    peak_load_N: float | None
    """Peak load in the plane, sharp and worn [N]."""
    peak_load_low_N: float | None
    peak_load_high_N: float | None
    """Worn, at the ends of the 95 % interval of the growth with wear [N]."""
    power_sharp_kW: float | None
    power_kW: float | None
    """Power of the cut, sharp and worn [kW]."""


@dataclass(frozen=True, kw_only=True)
class ToolEdge:
    """Wear of a tool that all figures of a cut hold for."""

    tool: int
    name: str
    """Number and name of the tool."""
    wear_um: float
    """Flank wear VB [um]; 0 for a sharp edge."""
    edge: str
    caution: str = ""
    """Whether it is sharp or worn and why; what speaks against the figures of a worn edge."""
    forces: EdgeForces | None = None
    """Sharp and worn: at ``wear_um``, of a sharp tool at the criterion of the machine; None where
    neither is known."""


@dataclass(frozen=True, kw_only=True)
class ForceInterval:
    """Greatest force of a tool in draws of all that is uncertain: median and 90 % interval."""

    tool: int
    name: str
    """Number and name of the tool."""
    source: str
    """Source of its coefficients."""
    peak_load_N: float | None
    peak_load_low_N: float | None
    peak_load_high_N: float | None
    """Median of the load in the plane where its peak over a turn is greatest, and the ends [N]."""
    mean_load_N: float | None
    mean_load_low_N: float | None
    mean_load_high_N: float | None
    """Median of the load in the plane where its mean over a turn is greatest, and the ends [N]."""
    runout: str = ""
    """Runout of the draws and its spread; other loads of a tool have that of the tool table."""
    outside: tuple[str, ...] = ()
    """Conditions of its cuts outside of those that identified coefficients were learnt at."""


@dataclass(frozen=True, kw_only=True)
class CutBlock(CutQuantities):
    """One block that cuts."""

    line: int
    row: int
    tool: int
    """Line of the program, row of its moves, number of the tool."""
    binds: str | None
    """The limit that is nearest; None where none is known."""
    used: float | None
    """Utilisation of that limit [1]."""
    speed_rpm: float | None
    reached_feed_mm_min: float | None
    """Speed of the spindle, and the highest feed reached."""
    entry_deg: float | None
    exit_deg: float | None
    """Engagement angles of the greatest mean load [deg]."""
    cost: float | None
    """Cost of the block [currency]."""


@dataclass(frozen=True, kw_only=True)
class WorstBlock(CutBlock):
    """The block of a run with the greatest utilisation, and the number of blocks like it."""

    alike: int


@dataclass(frozen=True, kw_only=True)
class CutWarning:
    """Warning before the part is cut."""

    what: str
    do: str
    """The finding, and the remedy."""
    lines: tuple[int, ...] = ()
    """Lines of the program."""
    blocks: int | None = None
    """Number of blocks; None where it is not of blocks."""
    grave: bool = False
    """Whether a limit is passed."""


@dataclass(frozen=True, kw_only=True)
class LeftOutMoves:
    """Moves that are not computed: why, how many, and the first of them as ``file:line``."""

    reason: str
    rows: int
    first: str


@dataclass(frozen=True, kw_only=True)
class BasisRow:
    """One premise of the cut: what it is, its value, its source."""

    what: str
    value: str
    source: str


@dataclass(frozen=True, kw_only=True)
class EngagementTrace:
    """Load and engagement in columns of equal time; None in air."""

    total_s: float
    """Time of the program [s]."""
    load_N_low: Curve
    load_N_high: Curve
    """Lowest and highest peak load [N]."""
    axial_depth_mm_low: Curve
    axial_depth_mm_high: Curve
    """Axial depth of cut [mm]."""
    radial_depth_mm_low: Curve
    radial_depth_mm_high: Curve
    """Radial depth of cut [mm]."""
    entry_deg: Curve
    exit_deg: Curve
    """Least entry and greatest exit angle [deg]."""
    tools: tuple[tuple[int, float, float], ...]
    """Number, start and end of each stretch of one tool, as shares of the time [1]."""


@dataclass(frozen=True, kw_only=True)
class LobePoint:
    """A block beside the lobes: line, speed [rev/min], axial depth [mm], stability margin [1]."""

    line: int
    speed_rpm: float
    axial_depth_mm: float
    margin: float | None


@dataclass(frozen=True, kw_only=True)
class Lobes:
    """Stability lobes of the least stable engagement of a tool."""

    tool: int
    """Number of the tool."""
    label: str
    """Number and name."""
    line: int
    """Line of the block with that engagement."""
    entry_deg: float
    exit_deg: float
    """Entry and exit angles [deg]."""
    speeds_rpm: tuple[float, ...]
    depth_limit_mm: Curve
    """Limit of the axial depth [mm] over the speed [rev/min]; None where there is none."""
    points: tuple[LobePoint, ...]
    """Blocks of that engagement, the least margins first."""


@dataclass(frozen=True, kw_only=True)
class DrivePoint:
    """A block beside the drive's curve: line, tool, speed [rev/min], power [kW], share [1]."""

    line: int
    tool: int
    speed_rpm: float | None
    power_kW: float | None
    drive_share: float | None


@dataclass(frozen=True, kw_only=True)
class DriveCurve:
    """Power that the spindle's drive has left for the cut [kW] over the speed [rev/min]."""

    speeds_rpm: tuple[float, ...]
    power_kW: Curve
    points: tuple[DrivePoint, ...]


@dataclass(frozen=True, kw_only=True)
class ProgramCut:
    """Cut of a part program."""

    stock: Blank
    """Blank that is cut."""
    material: MaterialName
    """Material of the blank."""
    currency: str | None
    """Currency of all costs; None where prices are not known."""
    limits: LoadLimit
    """Limit that was given."""
    dynamics: str | None
    """Source of the tips' dynamics; None without any."""
    dynamics_measured: bool
    """Whether they were measured."""
    feeds: str
    """Feeds at which the quantities are evaluated, one sentence."""
    summary: PartTotals
    """The part as a whole."""
    by_tool: tuple[ToolTotals, ...]
    """Totals by tool, in the order of the program."""
    worst: tuple[WorstBlock, ...]
    """The blocks with the greatest utilisation."""
    warnings: tuple[CutWarning, ...]
    """Warnings before the part is cut."""
    not_known: tuple[NotKnown, ...]
    """Quantities that the document lacks."""
    left_out: tuple[LeftOutMoves, ...]
    """Moves that are not computed."""
    basis: tuple[BasisRow, ...]
    """Premises with their sources."""
    notes: tuple[str, ...]
    """Notes on the figures, one sentence each."""
    trace: EngagementTrace
    """Load and engagement over the time."""
    lobes: tuple[Lobes, ...]
    """Lobes of each tool with known dynamics."""
    drive: DriveCurve | None
    """Drive of the spindle."""
    blocks: tuple[CutBlock, ...]
    """Blocks that cut."""
    axes: tuple[AxisInCut, ...] = ()
    """Following error and motor command of each axis in the cut; empty where not known."""
    edges: tuple[ToolEdge, ...] = ()
    """Wear of each tool that cuts, with its force sharp and worn."""
    forces: tuple[ForceInterval, ...] = ()
    """Peak and mean load of each tool that cuts, with 90 % intervals."""


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
class Advice:
    """One thing that a programmer can change, planned again by the same control."""

    what: str
    assumes: str
    """The change, and what it takes for granted."""
    seconds: float
    """Time that it saves by itself [s]."""
    lines: tuple[int, ...] = ()
    """Lines of the program; of holes in the order in which they are visited."""


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
    by_cause: Mapping[str, float] = field(default_factory=dict)
    """Time [s] by type of block, and by cause; each adds up to the predicted time."""
    advice: tuple[Advice, ...] = ()
    """Changes that save time, the greatest saving first; each is counted by itself."""
    blocks: int | None = None
    """Number of moves."""
    violations: tuple[str, ...] = ()
    """Lines that leave the machine's travel, speeds, feeds or tool lengths, in words."""


@dataclass(frozen=True, kw_only=True)
class CutProgram:
    """A simulated part program with the cut of its blocks."""

    time: SimulatedProgram
    """Times of the program."""
    cut: ProgramCut
    """Cut of its blocks."""
