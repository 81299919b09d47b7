"""Tests of the spindle load meter: programs of passes and of idle speeds, runs, displayed load."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.shop.control.display import display, log_lines
from pipeline.shop.control.part_programs import begin_program
from pipeline.shop.control.planner import Control, Operator
from pipeline.shop.control.postprocessor import PartProgram, Tool, word
from pipeline.shop.cutting.force import Motion, cut_length, pass_forces, wear
from pipeline.shop.cutting.parameters import Conditions, Cutting, SpindleTests
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import ControlParameters, ShopParameters, SpindleParameters
from pipeline.shop.spindle import available_power, no_load_power

NUMBER = 71
"""Number of the program, counted from the control's first."""
CLEAR = 5.0
"""Distance of the tool from the blank before and after a pass, and above it [mm]."""
LAND = 3.0
"""Width of the land between two slots [mm]."""
FLOOR = 10.0
"""Material left under the deepest pass [mm]."""
STEPS = 90
"""Steps of a revolution of the tool in a pass."""
FULL = 200.0
"""Greatest load that the meter shows [percent]."""
TREMBLE = 0.1
"""Time constant of the meter's noise [s]."""
SLICE = 0.5
"""Greatest height of a slice of the edges [mm]."""


@dataclass(frozen=True, kw_only=True)
class Pass:
    """A pass of the program: its line of the text, from and to which X, at which Y [mm]."""

    conditions: Conditions
    line: int
    start: float
    end: float
    y: float


def sites(cutting: Cutting) -> tuple[list[tuple[Conditions, float]], float]:
    """Passes with Y of the tool's centre, and the width of the blank [mm].

    Shoulders eat into the blank from Y 0, the deepest first; slots lie side by side behind them.
    Material left of the path is milled up, right of it down (clockwise spindle).
    """
    r, y, placed = cutting.tool.diameter / 2, 0.0, []
    shoulders = [c for c in cutting.spindle.passes if c.immersion != "slot"]
    for c in sorted(shoulders, key=lambda c: -c.depth):
        y += c.width
        placed.append((c, round(y - r, 3)))
    for c in (c for c in cutting.spindle.passes if c.immersion == "slot"):
        placed.append((c, round(y + LAND + r, 3)))
        y += LAND + 2 * r
    return placed, 5.0 * (int((y + LAND) // 5) + 1)


def cutting_program(
    cutting: Cutting, tool: Tool, control: ControlParameters
) -> tuple[PartProgram, list[Pass]]:
    """The program of the passes, and where each of them stands in it."""
    placed, width = sites(cutting)
    name = f"O{control.first_program + NUMBER}"
    post = begin_program(control, name, "CUTTING TEST", [tool])
    deep = max(c.depth for c in cutting.spindle.passes)
    post.blank((0.0, cutting.spindle.block, 0.0, width, -deep - FLOOR, 0.0), cutting.workpiece.name)
    mill = cutting.tool
    post.comment(
        f"TOOL {word('D', mill.diameter)} FLUTES {mill.flutes} {word('HELIX ', mill.helix)}"
    )
    post.take(tool)
    out, reach = [], cutting.tool.diameter / 2 + CLEAR
    ends = (-reach, cutting.spindle.block + reach)
    speed = 0.0
    for number, (c, y) in enumerate(placed, 1):
        start, end = ends[::-1] if c.immersion == "down" else ends
        size = f"{word('AP', c.depth)} {word('AE', c.width)}"
        post.comment(f"PASS {number} {c.immersion.upper()} {size}")
        if speed == 0:
            post.tools[-1] = replace(tool, speed=round(c.speed), feed=c.feed)
            post.approach(start, y, 25.0)
        elif c.speed != speed:
            post.turn(round(c.speed))
        speed = c.speed
        post.rapid(start, y)
        post.rapid(z=CLEAR)
        post.line(z=-c.depth, feed=tool.plunge)
        post.line(x=end, feed=c.feed)
        out.append(Pass(conditions=c, line=len(post.lines), start=start, end=end, y=y))
        post.rapid(z=25.0)
    post.retract()
    return post.end(name), out


def warm_up(cutting: Cutting, tool: Tool, control: ControlParameters) -> PartProgram:
    """Program that turns the spindle at each of its speeds for a while, without a cut."""
    name = "O9071"
    post = begin_program(control, name, "NO LOAD", [tool])
    for speed in cutting.spindle.speeds:
        post.turn(round(speed))
        post.dwell(round(cutting.spindle.hold * 1e3))
    post.turn(0)
    return post.end(name)


@dataclass(frozen=True, kw_only=True)
class PassPower:
    """Power of a pass at the tool [W] over the position of its centre from the first face [mm]."""

    position: Floats
    power: Floats
    steady: float  # while the whole tool is in the blank
    VB: float  # [m]


def pass_powers(passes: list[Pass], cutting: Cutting, cut: float) -> list[PassPower]:
    """Power of each pass, cut one after the other by teeth that cut ``cut`` [m] before."""
    out = []
    for one in passes:
        length = cut_length(one.conditions, cutting.tool, cutting.spindle.block)
        out.append(_power(one, cutting, wear(cutting.tool, cut + length / 2)))
        cut += length
    return out


def _power(one: Pass, cutting: Cutting, VB: float) -> PassPower:
    c, tool, length = one.conditions, cutting.tool, cutting.spindle.block
    feed = c.feed / c.speed  # mm a turn
    revolutions = int((length + tool.diameter) / feed) + 2
    angle = np.arange(revolutions * STEPS) * 2 * np.pi / STEPS
    x = -tool.diameter / 2 + angle / (2 * np.pi) * feed
    motion = Motion(angle=angle, x=x * 1e-3)
    force = pass_forces(
        c, tool, cutting.workpiece, motion, VB=VB, length=length, slice_height=SLICE
    )
    power = force[:, 3].reshape(revolutions, STEPS).mean(axis=1) * c.speed * np.pi / 30
    position = x.reshape(revolutions, STEPS).mean(axis=1)
    whole = (position > feed) & (position < length - tool.diameter / 2 - feed)
    return PassPower(position=position, power=power, steady=float(power[whole].mean()), VB=VB)


def run(
    program: PartProgram, passes: list[tuple[Pass, PassPower]], start: np.datetime64,
    parameters: ShopParameters, random: np.random.Generator,
) -> tuple[list[str], Floats]:  # fmt: skip
    """Log lines of a run of ``program`` from ``start`` (UTC), and load (T,) [percent]."""
    control, spindle = parameters.control, parameters.spindle
    plan = Control(
        parameters=control, motor=spindle.motor, lengths=program.lengths, random=random,
        tool=parameters.cutting.tool.number,
    ).run(program)  # fmt: skip
    shown = display(plan, Operator(), control)
    cut = np.zeros(shown.line.size)
    for one, power in passes:
        here = shown.line == one.line
        travel = np.cumsum(shown.feedrate[here]) * control.cycle
        edge = abs(one.end - one.start) / 2 - parameters.cutting.spindle.block / 2
        cut[here] = np.interp(travel - edge, power.position, power.power, left=0.0, right=0.0)
    load = shown_load(shown.speed, cut, control.cycle, spindle, parameters.cutting.spindle, random)
    return log_lines(shown, start, control, random, load=load), load


def pass_truth(one: Pass, power: PassPower) -> dict[str, Any]:
    """Truth about a pass."""
    c = one.conditions
    return {
        "line": one.line, "immersion": c.immersion, "depth_mm": c.depth, "width_mm": c.width,
        "speed_rpm": c.speed, "feed_mm_min": c.feed, "from_x_mm": one.start, "to_x_mm": one.end,
        "y_mm": one.y, "wear_um": power.VB * 1e6, "power_W": power.steady,
        "removal_rate_mm3_s": c.removal_rate,
        "specific_force_N_mm2": power.steady * 1e3 / c.removal_rate,
    }  # fmt: skip


def shown_load(
    speed: Floats, cutting: Floats, cycle: float, spindle: SpindleParameters,
    tests: SpindleTests, random: np.random.Generator,
) -> Floats:  # fmt: skip
    """Load that the meter shows in each cycle [s], shape (T,) [percent].

    ``speed`` (T,): of the spindle [rev/min]; ``cutting`` (T,): power of the cut at the tool [W].
    """
    acceleration = np.gradient(speed * RPM, cycle) * speed * RPM * spindle.motor.inertia
    steady = no_load_power(speed, spindle, tests.oil_temperature)
    power = np.abs(steady + cutting / tests.efficiency + acceleration)
    load = 100 * power / available_power(speed, spindle.motor)
    smooth = lagged(load, -np.expm1(-cycle / tests.lag), 0.0)
    share = -np.expm1(-cycle / TREMBLE)
    noise = lagged(random.standard_normal(speed.size), share, 0.0) * np.sqrt((2 - share) / share)
    shown = np.clip(smooth + tests.noise * noise * (speed >= 1), 0.0, FULL)
    out: Floats = np.round(np.round(shown / tests.step) * tests.step, 2)
    return out
