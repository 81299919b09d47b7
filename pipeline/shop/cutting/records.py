"""Records of a Sunday of cutting tests, and the truth that a linear-edge model should recover.

Tests of the spindle load meter are programs of passes and of idle speeds.  The truth is made of the
shop's own edge forces, for a model with helix and offset runout.
"""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.si import RPM
from pipeline.shop.control.part_programs import begin_program, part_programs
from pipeline.shop.control.planner import Control, Operator
from pipeline.shop.control.postprocessor import PartProgram, Tool, word
from pipeline.shop.control.records import display, log_lines
from pipeline.shop.cutting.dynamometer import Recorded, write_dynamometer
from pipeline.shop.cutting.force import (
    Motion,
    cut_length,
    edge_coefficients,
    edge_force,
    pass_forces,
    wear,
)
from pipeline.shop.cutting.parameters import Conditions, Cutting, SpindleTests, engaged
from pipeline.shop.files import write_text
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import (
    ControlParameters,
    Random,
    ShopParameters,
    SpindleParameters,
    stamp,
)
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
    flank = cutting.workpiece.flank(VB)
    force = pass_forces(
        c, tool, cutting.workpiece, motion, flank=flank, length=length, slice_height=SLICE
    )
    power = force[:, 3].reshape(revolutions, STEPS).mean(axis=1) * c.speed * np.pi / 30
    position = x.reshape(revolutions, STEPS).mean(axis=1)
    whole = (position > feed) & (position < length - tool.diameter / 2 - feed)
    return PassPower(position=position, power=power, steady=float(power[whole].mean()), VB=VB)


def run(
    program: PartProgram, passes: list[tuple[Pass, PassPower]], start: np.datetime64,
    parameters: ShopParameters, random: Random,
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
    tests: SpindleTests, random: Random,
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
    return np.round(np.round(shown / tests.step) * tests.step, 2)


ANGLES = 400
"""Angles at which the chip thickness of each recording is taken."""
SOUND = "recordings that are not to be rejected"
DEFINITION = {
    "K_tc K_rc K_ac K_te K_re K_ae": (
        "straight line K_c h + K_e with the least squares to the shop's own edge force over the "
        "chips h = f_z sin(phi) of the " + SOUND + ", each with the same weight, phi evenly over "
        "its engagement; with the mean wear of those recordings and the mean sharpness of the "
        "teeth. The axial force is positive where the edge lifts the workpiece"
    ),
    "more.mean_force": (
        "the same six with the least squares to the true mean forces of the " + SOUND + ": what a "
        "regression of mean forces finds where nothing disturbs it; wear that grows with the feeds "
        "of the series is in it"
    ),
    "runout runout_angle": (
        "offset of the tool's axis halfway down the mean depth of the " + SOUND + ", with its "
        "angle from the first tooth in the sense in which teeth move; a recording tells the angle "
        "only but for whole pitches, 360 deg / flutes; of two teeth the part along them, half the "
        "difference of their radii: what is across them no force shows"
    ),
    "spindle.no_load_W": "pairs of speed [rev/min] and power [W] without a cut",
    "spindle.specific_force": "power of all passes at the tool over what they remove in that time",
}
OPENING = 14.0 * 3600
"""Start of the spindle's tests, on the Sunday before the first week [s of the day]."""
PAUSE = 900.0
"""Time between the starts of the spindle's tests [s]."""


def linear_edge(cutting: Cutting, conditions: list[Conditions], VB: float) -> dict[str, float]:
    """Coefficients of the straight line: cutting [N/mm2], edge [N/mm]; ``VB`` [m]."""
    tool, edge = cutting.tool, edge_coefficients(cutting.workpiece, VB)
    h = np.concatenate(
        [c.feed_per_tooth(tool.flutes) * 1e-3 * np.sin(_engagement(c, cutting)) for c in conditions]
    )
    sharpness = float(np.mean(tool.sharpness))
    forces = np.array([edge_force(edge, thick, sharpness) for thick in h.tolist()])
    line = np.stack([h, np.ones(h.size)], axis=1)
    (k_c, k_e), *_ = np.linalg.lstsq(line, forces, rcond=None)
    return {f"K_{q}c": float(v) * 1e-6 for q, v in zip("tra", k_c, strict=True)} | {
        f"K_{q}e": float(v) * 1e-3 for q, v in zip("tra", k_e, strict=True)
    }


def _engagement(conditions: Conditions, cutting: Cutting) -> Floats:
    """Angles of a tooth spread evenly over its engagement, shape (ANGLES,) [rad]."""
    begin, end = engaged(conditions, cutting.tool.diameter)
    return begin + (end - begin) * (np.arange(ANGLES) + 0.5) / ANGLES


def mean_force(cutting: Cutting, files: list[dict[str, Any]]) -> dict[str, float]:
    """Coefficients that meet the true mean forces of ``files`` best, as of :func:`linear_edge`."""
    rows = np.concatenate([_mean_rows(f["settings"], cutting) for f in files])
    means = np.concatenate([f["true"]["mean_on_tool_N"] for f in files])
    solution, *_ = np.linalg.lstsq(rows, means, rcond=None)
    names = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
    return dict(zip(names, solution.tolist(), strict=True))


def _mean_rows(conditions: Conditions, cutting: Cutting) -> Floats:
    """Mean forces along the feed, left of it and along the axis for each coefficient, (3, 6)."""
    begin, end = engaged(conditions, cutting.tool.diameter)
    phi = _engagement(conditions, cutting)
    none, s, c = np.zeros(ANGLES), np.sin(phi), np.cos(phi)
    edge = np.array([[-c, -s, none], [s, -c, none], [none, none, none + 1]])
    thick = conditions.feed_per_tooth(cutting.tool.flutes) * s
    share = cutting.tool.flutes * conditions.depth * (end - begin) / (2 * np.pi)
    return share * np.concatenate([edge * thick, edge], axis=1).mean(axis=2)


def runout(cutting: Cutting, depth: float) -> dict[str, float]:
    """Offset [um] and angle [deg] of the tool's axis halfway down ``depth`` [mm]."""
    tool = cutting.tool
    to = np.exp(1j * np.deg2rad([tool.runout_angle, tool.tilt_angle]))
    offset = tool.runout * to[0] + tool.tilt * depth / 2 * to[1]
    if tool.flutes == 2:
        offset = complex(offset.real)
    return {"runout": float(np.abs(offset)), "runout_angle": float(np.rad2deg(np.angle(offset)))}


def dynamometer_truth(cutting: Cutting, recorded: Recorded) -> dict[str, Any]:
    """``parameters`` and ``more`` of the truth about the recordings of the dynamometer."""
    sound = [f for f in recorded.files if not f["reject"]]
    conditions = [f["settings"] for f in sound]
    VB_um = float(np.mean([f["true"]["wear_um"] for f in sound]))
    depth = float(np.mean([c.depth for c in conditions]))
    parameters = {
        **linear_edge(cutting, conditions, VB_um * 1e-6), **runout(cutting, depth),
        "helix": cutting.tool.helix,
    }  # fmt: skip
    d = cutting.dynamometer
    more = {
        "definition": DEFINITION,
        "mean_force": mean_force(cutting, sound),
        "mean_wear_um": VB_um,
        "mean_depth_mm": depth,
        "tool": asdict(cutting.tool),
        "workpiece": asdict(cutting.workpiece),
        "dynamometer": {
            "force_on": "workpiece",
            "channels": _channels(cutting),
            "modes": {k: asdict(getattr(d, k)) for k in "xyz"},
            "crosstalk": recorded.crosstalk.tolist(),
        },
        "files": [{k: v for k, v in f.items() if k != "settings"} for f in recorded.files],
    }
    return {"parameters": parameters, "more": more}


def _channels(cutting: Cutting) -> dict[str, str]:
    d = cutting.dynamometer
    straight = d.along == "x"
    return {
        "Fx": "along the feed" if straight else "right of the feed",
        "Fy": "left of the feed" if straight else "along the feed",
        "Fz": "up" if d.axial == "lift" else "down",
    }


def write_cutting(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``dynamometer/*.csv`` and ``cutting/*`` into ``folder``, when cuts are recorded.

    The truth: ``parameters`` that a linear-edge model should recover; ``spindle``, power without a
    cut, specific force and passes; ``more``, effects beyond such a model, definitions, and each
    file. Raises ValueError when the machine has no tool of the number in the tests.
    """
    cutting = parameters.cutting
    if not cutting.recorded:
        return {}
    tool = _tool(parameters)
    recorded = write_dynamometer(folder, parameters)
    truth = dynamometer_truth(cutting, recorded)
    spindle = _write_spindle(folder, parameters, tool, recorded.cut)
    return {**truth, "spindle": spindle}


def _write_spindle(
    folder: Path, parameters: ShopParameters, tool: Tool, cut: float
) -> dict[str, Any]:
    cutting, spindle = parameters.cutting, parameters.spindle
    milling, passes = cutting_program(cutting, tool, parameters.control)
    powers = pass_powers(passes, cutting, cut)
    idle = warm_up(cutting, tool, parameters.control)
    begin = parameters.start.astype("datetime64[ms]") - np.timedelta64(86400 - round(OPENING), "s")
    later = begin + np.timedelta64(round(PAUSE), "s")
    files = []
    for name, program, cuts, start in (
        ("no-load", idle, [], begin),
        (milling.name, milling, list(zip(passes, powers, strict=True)), later),
    ):
        random = parameters.generator(f"cutting run {name}")
        lines, load = run(program, cuts, start, parameters, random)
        text, log = f"cutting/{name}.nc", f"cutting/{name}-run1.txt"
        write_text(folder / text, program.text)
        write_text(folder / log, "\n".join(lines) + "\n")
        files.append({
            "file": log, "program": text, "start": stamp(start, 0.0), "lines": len(lines),
            "greatest_load_percent": float(load.max()),
        })  # fmt: skip
    pairs = zip(passes, powers, strict=True)
    rows = [pass_truth(one, power) for one, power in pairs]
    speeds = np.array(cutting.spindle.speeds)
    power = no_load_power(speeds, spindle, cutting.spindle.oil_temperature)
    removed = [r["removal_rate_mm3_s"] for r in rows]
    return {
        "no_load_W": np.stack([speeds, power], axis=1).tolist(),
        "specific_force": sum(r["power_W"] for r in rows) / sum(removed) * 1e3,
        "rated_power_W": spindle.motor.rated_power,
        "base_speed_rpm": spindle.motor.base_speed,
        "efficiency": cutting.spindle.efficiency,
        "passes": rows,
        "files": files,
    }


def _tool(parameters: ShopParameters) -> Tool:
    mill = parameters.cutting.tool
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    for tool in (t for p in programs for t in p.tools):
        if tool.number == mill.number and tool.diameter == mill.diameter:
            return tool
    raise ValueError(
        f"EndMill.number = {mill.number}: the control has no tool of that number with a diameter "
        f"of {mill.diameter} [mm]"
    )
