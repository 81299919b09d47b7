"""Which blocks of a cut pass a limit that was given, or that the spindle's drive has."""

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.tool import Tool
from pipeline.optimisation.problem.bounds import feed_for_marks
from pipeline.optimisation.settings import CutLimit
from pipeline.twin.cut import Cut
from pipeline.twin.cut_document import AssessedCut

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

ROUNDING = 1e-3
"""What is over a limit by less, as a share, is rounding."""
UM = 1e6


def passed(of: AssessedCut, limits: CutLimit) -> Flags:
    """Whether each of the K blocks that cut passes a limit; margins are not counted."""
    return np.logical_or.reduce([*passed_by_limit(of, limits).values()])


def passed_by_limit(of: AssessedCut, limits: CutLimit) -> dict[str, Flags]:
    """By the limit's name, which of the K blocks that cut pass it; margins are not counted.

    What is not known passes nothing.  A block's F is the feed that it reaches.
    """
    blocks, found, tools = of.found.blocks, of.found.limits, of.found.cut.tools
    turning = blocks.spindle_speed > 0
    height = None if limits.roughness_um is None else limits.roughness_um / UM
    checks = {
        "load": (np.where(turning, blocks.peak, np.nan), limits.load_N),
        "deflection": (found.deflection * UM, limits.deflection_um),
        "roughness": (_marks(of, height), None if height is None else 1.0),
        "chip": (blocks.thickness * UM, limits.chip_um),
        "torque": (blocks.torque, limits.torque_Nm),
        "power": (found.drive, limits.power_share),
        "cutting speed": (_cutting_speed(of, tools), limits.cutting_speed_m_min),
        "spindle speed": (np.where(turning, blocks.spindle_speed, np.nan), limits.speed_rpm),
        "feed": (blocks.feed, None if limits.feed_mm_min is None else (0.0, limits.feed_mm_min[1])),
    }
    out = {"stability": found.margin < 0}
    for name, (values, limit) in checks.items():
        if limit is not None:
            low, high = limit if isinstance(limit, tuple) else (0.0, limit)
            out[name] = (values > high * (1 + ROUNDING)) | (values < low * (1 - ROUNDING))
    return out


def check_judged(cut: Cut, limits: CutLimit, drive: SpindleDrive | None) -> None:
    """Refuse limits that nothing is known for, rather than to pass over them in silence.

    Raises
    ------
    ValueError
        When the deflection of a tool that cuts, or the spindle's drive, is not known.
    """
    if limits.deflection_um is not None:
        for index in np.unique(cut.tool[cut.tool >= 0]).tolist():
            tool = cut.tools[index]
            if tool.stickout is None and tool.kind != "drill":
                raise ValueError(
                    f"limits.deflection_um = {limits.deflection_um:g} cannot be kept: "
                    f"T{cut.numbers[index]} has no stickout_mm in the tool table: write it there, "
                    "or leave the limit out"
                )
    if limits.power_share < 1.0 and drive is None:
        raise ValueError(
            f"limits.power_share = {limits.power_share:g} cannot be kept: the machine's file has "
            "no section spindle_drive: write it there, or leave the limit out"
        )


def _cutting_speed(of: AssessedCut, tools: tuple[Tool, ...]) -> Floats:
    """[m/min]; NaN where the spindle stands."""
    blocks = of.found.blocks
    diameter = np.array([tool.diameter for tool in tools])[blocks.tool]
    return np.where(blocks.spindle_speed > 0, np.pi * diameter * blocks.spindle_speed, np.nan)


def _marks(of: AssessedCut, height: float | None) -> Floats:
    """Feed for each tooth over that whose marks have the height; NaN where none is given."""
    blocks, tools = of.found.blocks, of.found.cut.tools
    if height is None:
        return np.full(len(blocks), np.nan)
    most = np.array([feed_for_marks(tool, height) for tool in tools])[blocks.tool]
    return blocks.feed_per_tooth / most
