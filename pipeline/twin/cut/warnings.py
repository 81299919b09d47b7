"""Warnings before a part is cut: its limits, the blank, chatter, tools that do not fit."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import TipDynamics, rigid_directions
from pipeline.cutting.tool import odd_sizes, tool_limits
from pipeline.gcode.moves import CutterRadius
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Rows
from pipeline.schema.program_cut import CutWarning
from pipeline.twin.cut.blocks import CutBlocks, CutLimits
from pipeline.twin.cut.loads import Cut
from pipeline.twin.preflight import contact_violations, preflight_warnings

WORN = 0.3e-3
"""Width of the flank's land of a worn tool, ISO 8688-2 [m]."""
SMALL = 10.0
"""Extent of the moves at feed over the blank's, along X or Y, from which it may be in inches."""


def cut_warnings(
    cut: Cut, blocks: CutBlocks, limits: CutLimits, limit_load: float | None, *,
    dynamics: TipDynamics | None, drive: SpindleDrive | None, stock: str,
) -> list[CutWarning]:  # fmt: skip
    """Warnings before the part is cut; chatter is grave where ``dynamics`` were measured."""
    measured = dynamics is not None and dynamics.measured
    standing = blocks.row[blocks.spindle_speed <= 0]
    warnings = [
        _warning(cut, np.flatnonzero(cut.engagement.rapid_depth), "rapids go through the material",
                 "Retract further, or move around the blank.", grave=True),
        _warning(cut, standing, "the spindle stands while the tool is fed into the material",
                 "Program S and M3 before it.", grave=True),
        _too_fast(cut, blocks, drive),
        _warning(cut, blocks.row[(limits.drive > 1) & np.isfinite(limits.drive)],
                 "the spindle’s drive cannot give the power",
                 "Lower feed or depth, or another speed.", grave=True),
        _warning(cut, blocks.row[limits.margin < 0],
                 "blocks chatter" if measured else "blocks may chatter",
                 "Less depth, or a speed between the lobes" + (
                     "." if measured else "; the tips’ dynamics were not measured: tap them."
                 ), grave=measured),
        _warning(cut, _too_deep(cut, blocks), "cuts are deeper than the tool’s flutes are long",
                 "A longer tool, or more passes."),
        _warning(cut, _below(cut), "the tool goes below the blank’s underside",
                 "Check what the blank lies on."),
    ]  # fmt: skip
    most = tool_limits(cut.tools, "load_N", limit_load)[blocks.tool]
    for value in np.unique(most[np.isfinite(most)])[::-1].tolist():
        over = blocks.row[(most == value) & (blocks.peak > value)]
        what = f"the load passes its limit of {value:g} N"
        warnings.insert(1, _warning(cut, over, what, "Lower the feed of these blocks.", grave=True))
    warnings += [
        missed_blank(cut, stock), *_rigid(cut, blocks, dynamics), _unseen(dynamics),
        _damped(cut, blocks, limits, dynamics),
    ]  # fmt: skip
    return [one for one in warnings if one is not None]


def _warning(cut: Cut, rows: Rows, what: str, do: str, *, grave: bool = False) -> CutWarning | None:
    if not len(rows):
        return None
    lines = _each_once(cut.plan.path.moves.line[np.sort(rows)])
    return CutWarning(what=what, do=do, lines=lines, blocks=len(rows), grave=grave)


def _each_once(lines: NDArray[np.integer]) -> tuple[int, ...]:
    return tuple(dict.fromkeys(lines.tolist()))


def _too_fast(cut: Cut, blocks: CutBlocks, drive: SpindleDrive | None) -> CutWarning | None:
    if drive is None:
        return None
    over = blocks.spindle_speed > drive.top_speed_rpm * (1 + 1e-9)
    fastest = float(blocks.spindle_speed[over].max(initial=0.0))
    what = f"{fastest:g} rev/min is above the top speed {drive.top_speed_rpm:g} of the drive"
    return _warning(cut, blocks.row[over], what, "Lower S.", grave=True)


def missed_blank(cut: Cut, stock: str) -> CutWarning | None:
    """Said where no move at feed meets the blank, or where it is as small as one in inches."""
    blank, pieces = cut.blank, cut.path.pieces
    if not pieces.feed.any():
        return None
    ends = np.concatenate([pieces.start[pieces.feed], pieces.end[pieces.feed]])
    rows, columns = blank.heights.shape
    low = [blank.x0, blank.y0, blank.floor]
    high = [
        blank.x0 + columns * blank.cell, blank.y0 + rows * blank.cell, float(blank.heights.max()),
    ]  # fmt: skip
    small = bool((np.ptp(ends, axis=0) > SMALL * np.subtract(high, low))[:2].any())
    if not small and (cut.tool >= 0).any():
        return None
    fed, held = _spans(ends.min(axis=0), ends.max(axis=0)), _spans(low, high)
    inch = small or stock.lower().endswith(".stl")
    return CutWarning(
        what=f"the blank {stock} is not where the program cuts: feed moves span {fed} mm, the "
        f"blank {held} mm{' (is it in inches? it is read in mm)' * inch}",
        do=f"Give the blank in the coordinates of {cut.path.frame.name}, or name another work "
        "offset.",
        grave=True,
    )


def _spans(low: ArrayLike, high: ArrayLike) -> str:
    """Ranges [mm] of points [m]."""
    ends = zip("XYZ", np.asarray(low) * 1e3, np.asarray(high) * 1e3, strict=True)
    return ", ".join(f"{axis} {round(a, 2) + 0:g}..{round(b, 2) + 0:g}" for axis, a, b in ends)


def _rigid(cut: Cut, blocks: CutBlocks, dynamics: TipDynamics | None) -> list[CutWarning]:
    """Tools whose tip is known along one axis only: the other counts as rigid."""
    if dynamics is None:
        return []
    tips = dynamics.of(cut.numbers)
    stiff: dict[str, list[str]] = {}
    for tool in np.unique(blocks.tool).tolist():
        for name in rigid_directions(tip) if (tip := tips[tool]) else ():
            stiff.setdefault(name, []).append(f"T{cut.numbers[tool]}")
    return [
        CutWarning(
            what=f"the tips of {', '.join(tools)} have no modes along {name}: they count as rigid "
            "there, and the stability may be far off",
            do=f"Write the modes along {name} in the machine’s section dynamics too.",
        )
        for name, tools in stiff.items()
    ]


def _unseen(dynamics: TipDynamics | None) -> CutWarning | None:
    if dynamics is None or not dynamics.caution:
        return None
    return CutWarning(
        what=f"{dynamics.caution}: the stability may be too high there",
        do="Measure the tips to a higher frequency.",
    )


def _damped(
    cut: Cut, blocks: CutBlocks, limits: CutLimits, dynamics: TipDynamics | None
) -> CutWarning | None:
    """Blocks said to chatter where process damping may hold: land over a quarter wave v_c / f."""
    if dynamics is None:
        return None
    tips = dynamics.of(cut.numbers)
    slowest = np.array(
        [min((mode.natural_frequency_Hz for mode in tip or ()), default=0.0) for tip in tips]
    )[blocks.tool]
    radius = np.array([tool.radius for tool in cut.tools])[blocks.tool]
    speed = 2 * np.pi * radius * blocks.spindle_speed / 60
    wave = np.divide(speed, slowest, out=np.full(len(speed), np.inf), where=slowest > 0)
    short = (limits.margin < 0) & (wave < 4 * WORN)
    if not short.any():
        return None
    return _warning(
        cut, blocks.row[short],
        f"waves of the tip's vibration are as short as {wave[short].min() * 1e3:.2g} mm: process "
        "damping, which is not counted, may let these blocks cut deeper, by how much is not known",
        "Try the cut with care, or identify the process damping; do not count on it.",
    )  # fmt: skip


def _too_deep(cut: Cut, blocks: CutBlocks) -> Rows:
    long = np.array([np.inf if t.flute_length_mm is None else t.flute_length_mm for t in cut.tools])
    # depth is known to a cell's height error of a surface that another tool has left
    return blocks.row[blocks.axial_depth * 1e3 > long[blocks.tool] + 1e-6]


def _below(cut: Cut) -> Rows:
    """Rows whose tip is below the blank's floor by more than a cell, within its outline."""
    blank, pieces = cut.blank, cut.path.pieces
    rows, columns = blank.heights.shape
    radius = np.array([tool.radius for tool in cut.tools])[pieces.tool]
    below = np.minimum(pieces.start[:, 2], pieces.end[:, 2]) < blank.floor - blank.cell
    for axis, low, many in ((0, blank.x0, columns), (1, blank.y0, rows)):
        ends = pieces.start[:, axis], pieces.end[:, axis]
        below &= np.maximum(*ends) > low - radius
        below &= np.minimum(*ends) < low + many * blank.cell + radius
    return np.unique(pieces.block[below]).astype(np.intp)


def setup_warnings(cut: Cut, table: str) -> tuple[CutWarning, ...]:
    """Misfits of tools and registers with the program; ``table``: the tool table as named."""
    moves, tools = cut.plan.path.moves, dict(zip(cut.numbers, cut.tools, strict=True))
    return (
        *_odd_sizes(cut, table),
        *_backwards(cut),
        *_without_radius(cut),
        *_cutting_nothing(cut),
        *_not_listed(cut),
        *preflight_warnings(contact_violations(moves, cut.path, tools, cut.blank)),
    )


def _odd_sizes(cut: Cut, table: str) -> Iterator[CutWarning]:
    """Sizes of tools that another unit would explain."""
    for number, tool in zip(cut.numbers, cut.tools, strict=True):
        for odd in odd_sizes(tool):
            yield CutWarning(
                what=f"T{number} in the tool table {table}: {odd.field} = {odd.value:g} is "
                f"{odd.reason}",
                do=odd.remedy,
            )


def _backwards(cut: Cut) -> Iterator[CutWarning]:
    """Right-hand tools that cut while M4 turns them; a tap backs out with M4."""
    moves, back = cut.plan.path.moves, cut.plan.path.moves.direction < 0
    for index, (number, tool) in enumerate(zip(cut.numbers, cut.tools, strict=True)):
        lines = moves.line[back & (cut.tool == index)]
        if len(lines) and tool.helix_deg >= 0 and tool.role != "tap":
            yield CutWarning(
                what=f"T{number} cuts while M4 turns it, and is a right-hand tool in the tool "
                "table: its edges run backwards",
                do="Write M3, or a negative helix_deg for a left-hand tool.",
                lines=_each_once(lines),
            )


def _without_radius(cut: Cut) -> Iterator[CutWarning]:
    """G41 and G42 whose register holds no radius, of tools that have a diameter in the table."""
    tools = dict(zip(cut.numbers, cut.tools, strict=True))
    alike: dict[tuple[int, int], list[CutterRadius]] = {}
    for one in cut.plan.path.moves.cutter_radii:
        if one.radius == 0 and one.tool in tools:
            alike.setdefault((one.register, one.tool), []).append(one)
    for (register, number), found in alike.items():
        words = " and ".join(dict.fromkeys(one.word for one in found))
        size = f"{tools[number].diameter_mm:g}"
        yield CutWarning(
            what=f"{words} of T{number} takes D{register}, which is 0 or not given: the path is "
            f"followed as if the tool had no radius, and the tool table says {size} mm",
            do=f"Enter {size} mm as the diameter of D{register} in the machine’s file (setup); "
            "leave it where the program holds the path of the tool’s centre.",
            lines=tuple(dict.fromkeys(one.line for one in found)),
        )


def _cutting_nothing(cut: Cut) -> Iterator[CutWarning]:
    """Tools that turn and are fed through the blank's surroundings and never meet it."""
    moves, pieces = cut.plan.path.moves, cut.path.pieces
    if not (cut.tool >= 0).any():
        return  # the blank as a whole is missed, which is said of it
    rows = np.unique(pieces.block[pieces.feed & (pieces.length > 0)])
    rows = rows[cut.plan.spindle_speed[rows] > 0]
    cutting = set(moves.tool[cut.tool >= 0].tolist())
    for number in dict.fromkeys(moves.tool[rows].tolist()):
        if number in cutting:
            continue
        lines = moves.line[rows[moves.tool[rows] == number]]
        yield CutWarning(
            what=f"T{number} is fed and cuts nothing",
            do="Check the blank, the work offset, the tool’s length and the cutter radius.",
            lines=_each_once(lines),
        )


def _not_listed(cut: Cut) -> Iterator[CutWarning]:
    """Tools that work and are not in the tool table; those that mill without it are refused."""
    moves = cut.plan.path.moves
    working = np.isin(moves.kind, CUTTING) & (moves.length > 0) & (moves.tool >= 0)
    working &= ~np.isin(moves.tool, cut.numbers)
    for number in dict.fromkeys(moves.tool[working].tolist()):
        lines = moves.line[working & (moves.tool == number)]
        yield CutWarning(
            what=f"T{number} is not in the tool table: nothing of it is judged",
            do="Add it to the tool table.",
            lines=_each_once(lines),
        )
