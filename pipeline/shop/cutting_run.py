"""Runs of the spindle's test programs by the machine's own control, and what their logs show."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.shop.control import Control, Operator
from pipeline.shop.control_log import written
from pipeline.shop.control_run import Display, display
from pipeline.shop.cutting_parameters import Cutting
from pipeline.shop.cutting_pass import Motion, cut_length, pass_forces, wear
from pipeline.shop.cutting_program import Pass
from pipeline.shop.post import PartProgram
from pipeline.shop.s_curve import Floats
from pipeline.shop.spindle_load import shown_load

if TYPE_CHECKING:
    from pipeline.shop.parameters import ShopParameters

HOME = (-400.0, 0.0, 0.0)
"""Where the machine stands before a run [mm]."""
STEPS = 90
"""Of a turn of the tool in a pass."""
SLICE = 0.5
"""Greatest height of a slice of the edges [mm]."""


@dataclass(frozen=True, kw_only=True)
class PassPower:
    """Power of a pass at the tool [W] over the way of its centre from the first face [mm]."""

    way: Floats
    power: Floats
    steady: float  # while the whole tool is in the blank
    worn: float  # [m]


def pass_powers(passes: list[Pass], cutting: Cutting, cut: float) -> list[PassPower]:
    """Power of each pass, cut one after the other by teeth that cut ``cut`` [m] before."""
    out = []
    for one in passes:
        length = cut_length(one.conditions, cutting.tool, cutting.spindle.block)
        out.append(_power(one, cutting, wear(cutting.tool, cut + length / 2)))
        cut += length
    return out


def _power(one: Pass, cutting: Cutting, worn: float) -> PassPower:
    c, tool, length = one.conditions, cutting.tool, cutting.spindle.block
    feed = c.feed / c.speed  # mm a turn
    turns = int((length + tool.diameter) / feed) + 2
    angle = np.arange(turns * STEPS) * 2 * np.pi / STEPS
    x = -tool.diameter / 2 + angle / (2 * np.pi) * feed
    force = pass_forces(
        c, tool, cutting.workpiece, worn, Motion(angle=angle, x=x * 1e-3), length, SLICE
    )
    power = force[:, 3].reshape(turns, STEPS).mean(axis=1) * c.speed * np.pi / 30
    way = x.reshape(turns, STEPS).mean(axis=1)
    whole = (way > feed) & (way < length - tool.diameter / 2 - feed)
    return PassPower(way=way, power=power, steady=float(power[whole].mean()), worn=worn)


@dataclass(frozen=True, kw_only=True)
class Run:
    """A run: what the control showed, the load (T,) [percent] and cut (T,) [W], its log."""

    shown: Display
    load: Floats
    cut: Floats
    lines: list[str]


def run(
    program: PartProgram, passes: list[tuple[Pass, PassPower]], start: np.datetime64,
    parameters: "ShopParameters", random: np.random.Generator,
) -> Run:  # fmt: skip
    """Let the control run ``program`` from ``start`` (UTC) on and an adapter listen."""
    control, spindle = parameters.control, parameters.spindle
    lengths = {t.number: t.length for t in program.tools}
    number = parameters.cutting.tool.number
    operator = Operator()
    plan = Control(
        parameters=control, motor=spindle.motor, lengths=lengths, operator=operator, random=random,
        place=list(HOME), tool=number,
    ).run(program)  # fmt: skip
    shown = display(plan, operator, control)
    cut = np.zeros(shown.line.size)
    for one, power in passes:
        here = shown.line == one.line
        gone = np.cumsum(shown.feedrate[here]) * control.cycle
        edge = abs(one.end - one.start) / 2 - parameters.cutting.spindle.block / 2
        cut[here] = np.interp(gone - edge, power.way, power.power, left=0.0, right=0.0)
    load = shown_load(shown.speed, cut, control.cycle, spindle, parameters.cutting.spindle, random)
    lines = written(shown, start, control, random, load=load)
    return Run(shown=shown, load=load, cut=cut, lines=lines)


def pass_truth(one: Pass, power: PassPower) -> dict[str, Any]:
    """What is true of a pass."""
    c = one.conditions
    return {
        "line": one.line, "immersion": c.immersion, "depth_mm": c.depth, "width_mm": c.width,
        "speed_rpm": c.speed, "feed_mm_min": c.feed, "from_x_mm": one.start, "to_x_mm": one.end,
        "y_mm": one.y, "wear_um": power.worn * 1e6, "power_W": power.steady,
        "removal_rate_mm3_s": c.removal_rate,
        "specific_force_N_mm2": power.steady * 1e3 / c.removal_rate,
    }  # fmt: skip
