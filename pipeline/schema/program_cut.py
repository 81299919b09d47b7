"""The cut of a simulated part program as it is stored: loads, stability and cost of its blocks.

It stands under ``cut`` in the JSON of ``kerf simulate``.  Depths and chips are in [mm], loads in
[N], angles in [deg], speeds in [rev/min], shares in [1]; None is what is not known.
"""

from dataclasses import dataclass

from pipeline.schema.drive import AxisInCut

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
    """Material of the blank."""

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


@dataclass(frozen=True, kw_only=True)
class CutQuantities:
    """Quantities of one block that cuts, or the worst of many.

    Parameters
    ----------
    feed_per_tooth_mm, chip_thickness_mm : float or None
        At the highest feed reached; the thickest chip [mm].
    cutting_speed_m_min : float or None
        v_c = pi D S at the full diameter D [m/min].
    axial_depth_mm, radial_depth_mm : float or None
        Depths of cut [mm].
    peak_load_N, mean_load_N, axial_force_N : float or None
        Load in the plane, its peak and its mean; peak along the axis [N].
    torque_Nm, peak_torque_Nm : float or None
        Mean over the turn, and peak [N m].
    power_kW : float or None
        Of the cut [kW].
    drive_share : float or None
        Power of the motor over its greatest at that speed [1].
    deflection_um : float or None
        Of the tip [um].
    stability_margin : float or None
        Limit over depth, less 1 [1].
    in_material_s : float or None
        Time in the material [s].
    volume_cm3 : float or None
        Removed [cm^3].
    removal_rate_cm3_min : float or None
        While cutting [cm^3/min].
    tool_life_share : float or None
        Share of the tools' lives [1].
    energy_kWh : float or None
        Electricity [kWh].
    """

    feed_per_tooth_mm: float | None
    chip_thickness_mm: float | None
    cutting_speed_m_min: float | None
    axial_depth_mm: float | None
    radial_depth_mm: float | None
    peak_load_N: float | None
    mean_load_N: float | None
    axial_force_N: float | None
    torque_Nm: float | None
    peak_torque_Nm: float | None
    power_kW: float | None
    drive_share: float | None
    deflection_um: float | None
    stability_margin: float | None
    in_material_s: float | None
    volume_cm3: float | None
    removal_rate_cm3_min: float | None
    tool_life_share: float | None
    energy_kWh: float | None


@dataclass(frozen=True, kw_only=True)
class CutTotals(CutQuantities):
    """Worst values of blocks that cut, and sums over the rows of the program.

    Parameters
    ----------
    blocks : int
        Blocks that cut.
    time_s, at_feed_s : float or None
        In all, and in moves at feed [s].
    air_share : float or None
        Share of the time at feed in air [1].
    highest_removal_rate_cm3_min : float or None
        The greatest beside the mean [cm^3/min].
    cost : CutCost or None
        None where prices are not known.
    """

    blocks: int
    time_s: float | None
    at_feed_s: float | None
    air_share: float | None
    highest_removal_rate_cm3_min: float | None
    cost: CutCost | None


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
    """Greatest load and power of a tool with a sharp edge and with a worn one.

    Parameters
    ----------
    wear_um : float
        Flank wear VB of the worn edge [um].
    peak_load_sharp_N, peak_load_N : float or None
        Peak load in the plane, sharp and worn [N].
    peak_load_low_N, peak_load_high_N : float or None
        Worn, at the ends of the 95 % interval of the growth with wear [N].
    power_sharp_kW, power_kW : float or None
        Of the cut, sharp and worn [kW].
    """

    wear_um: float
    peak_load_sharp_N: float | None
    peak_load_N: float | None
    peak_load_low_N: float | None
    peak_load_high_N: float | None
    power_sharp_kW: float | None
    power_kW: float | None


@dataclass(frozen=True, kw_only=True)
class ToolEdge:
    """Wear of a tool that all figures of a cut hold for.

    Parameters
    ----------
    tool, name : int, str
        Its number and name.
    wear_um : float
        Flank wear VB [um]; 0 for a sharp edge.
    edge, caution : str
        Whether it is sharp or worn and why; what speaks against the figures of a worn edge.
    forces : EdgeForces or None
        Sharp and worn: at ``wear_um``, of a sharp tool at the criterion of the machine; None where
        neither is known.
    """

    tool: int
    name: str
    wear_um: float
    edge: str
    caution: str = ""
    forces: EdgeForces | None = None


@dataclass(frozen=True, kw_only=True)
class ForceInterval:
    """Greatest force of a tool with its 90 % interval.

    Parameters
    ----------
    tool, name : int, str
        Its number and name.
    source : str
        Of its coefficients.
    peak_load_N, peak_load_low_N, peak_load_high_N : float or None
        Load in the plane where its peak over a turn is greatest, and the ends [N].
    mean_load_N, mean_load_low_N, mean_load_high_N : float or None
        Where its mean over a turn is greatest, and the ends [N].
    outside : tuple of str
        Conditions of its cuts outside of those that identified coefficients were learnt at.
    """

    tool: int
    name: str
    source: str
    peak_load_N: float | None
    peak_load_low_N: float | None
    peak_load_high_N: float | None
    mean_load_N: float | None
    mean_load_low_N: float | None
    mean_load_high_N: float | None
    outside: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class CutBlock(CutQuantities):
    """One block that cuts.

    Parameters
    ----------
    line, row, tool : int
        Line of the program, row of its moves, number of the tool.
    binds : str or None
        The limit that is nearest; None where none is known.
    used : float or None
        Utilisation of that limit [1].
    speed_rpm, reached_feed_mm_min : float or None
        Of the spindle, and the highest feed reached.
    entry_deg, exit_deg : float or None
        Engagement angles of the greatest mean load [deg].
    cost : float or None
        Of the block [currency].
    """

    line: int
    row: int
    tool: int
    binds: str | None
    used: float | None
    speed_rpm: float | None
    reached_feed_mm_min: float | None
    entry_deg: float | None
    exit_deg: float | None
    cost: float | None


@dataclass(frozen=True, kw_only=True)
class WorstBlock(CutBlock):
    """The block of a run with the greatest utilisation, and the number of blocks like it."""

    alike: int


@dataclass(frozen=True, kw_only=True)
class CutWarning:
    """Warning before the part is cut.

    Parameters
    ----------
    what, do : str
        The finding, and the remedy.
    lines : tuple of int
        Of the program.
    blocks : int or None
        How many blocks; None where it is not of blocks.
    grave : bool
        Whether a limit is passed.
    """

    what: str
    do: str
    lines: tuple[int, ...] = ()
    blocks: int | None = None
    grave: bool = False


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
    """Load and engagement in columns of equal time; None in air.

    Parameters
    ----------
    total_s : float
        Time of the program [s].
    load_N_low, load_N_high : tuple of float or None
        Lowest and highest peak load [N].
    axial_depth_mm_low, axial_depth_mm_high : tuple of float or None
        Axial depth of cut [mm].
    radial_depth_mm_low, radial_depth_mm_high : tuple of float or None
        Radial depth of cut [mm].
    entry_deg, exit_deg : tuple of float or None
        Least entry and greatest exit angle [deg].
    tools : tuple of (int, float, float)
        Number, start and end of each stretch of one tool, as shares of the time [1].
    """

    total_s: float
    load_N_low: Curve
    load_N_high: Curve
    axial_depth_mm_low: Curve
    axial_depth_mm_high: Curve
    radial_depth_mm_low: Curve
    radial_depth_mm_high: Curve
    entry_deg: Curve
    exit_deg: Curve
    tools: tuple[tuple[int, float, float], ...]


@dataclass(frozen=True, kw_only=True)
class LobePoint:
    """A block beside the lobes: line, speed [rev/min], axial depth [mm], stability margin [1]."""

    line: int
    speed_rpm: float
    axial_depth_mm: float
    margin: float | None


@dataclass(frozen=True, kw_only=True)
class Lobes:
    """Stability lobes of the least stable engagement of a tool.

    Parameters
    ----------
    tool : int
        Its number.
    label : str
        Number and name.
    line : int
        Of the block with that engagement.
    entry_deg, exit_deg : float
        Its angles [deg].
    speeds_rpm, depth_limit_mm : tuple of float
        Limit of the axial depth [mm] over the speed [rev/min]; None where there is none.
    points : tuple of LobePoint
        Blocks of that engagement, the least margins first.
    """

    tool: int
    label: str
    line: int
    entry_deg: float
    exit_deg: float
    speeds_rpm: tuple[float, ...]
    depth_limit_mm: Curve
    points: tuple[LobePoint, ...]


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
    """The cut of a part program.

    Parameters
    ----------
    stock : Blank
        That is cut.
    material : MaterialName
        Of the blank.
    currency : str or None
        Of all costs; None where prices are not known.
    limits : LoadLimit
        That was given.
    dynamics : str or None
        Source of the tips' dynamics; None without any.
    dynamics_measured : bool
        Whether they were measured.
    feeds : str
        At which feeds the quantities are evaluated, one sentence.
    summary : PartTotals
        The part as a whole.
    by_tool : tuple of ToolTotals
        In the order of the program.
    worst : tuple of WorstBlock
        The blocks with the greatest utilisation.
    warnings : tuple of CutWarning
        Before the part is cut.
    not_known : tuple of NotKnown
        Quantities that the document lacks.
    left_out : tuple of LeftOutMoves
        Moves that are not computed.
    basis : tuple of BasisRow
        Premises with their sources.
    notes : tuple of str
        On the figures, one sentence each.
    trace : EngagementTrace
        Load and engagement over the time.
    lobes : tuple of Lobes
        Of each tool with known dynamics.
    drive : DriveCurve or None
        Of the spindle.
    blocks : tuple of CutBlock
        Every block that cuts.
    axes : tuple of AxisInCut
        Following error and motor command of each axis in the cut; empty where not known.
    edges : tuple of ToolEdge
        Wear of each tool that cuts, with its force sharp and worn.
    forces : tuple of ForceInterval
        Peak and mean load of each tool that cuts, with 90 % intervals.
    """

    stock: Blank
    material: MaterialName
    currency: str | None
    limits: LoadLimit
    dynamics: str | None
    dynamics_measured: bool
    feeds: str
    summary: PartTotals
    by_tool: tuple[ToolTotals, ...]
    worst: tuple[WorstBlock, ...]
    warnings: tuple[CutWarning, ...]
    not_known: tuple[NotKnown, ...]
    left_out: tuple[LeftOutMoves, ...]
    basis: tuple[BasisRow, ...]
    notes: tuple[str, ...]
    trace: EngagementTrace
    lobes: tuple[Lobes, ...]
    drive: DriveCurve | None
    blocks: tuple[CutBlock, ...]
    axes: tuple[AxisInCut, ...] = ()
    edges: tuple[ToolEdge, ...] = ()
    forces: tuple[ForceInterval, ...] = ()
