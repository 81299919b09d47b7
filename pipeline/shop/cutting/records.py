"""Records of a Sunday of cutting tests, and the truth that a linear-edge model should recover.

The truth is made of the shop's own edge forces, for a model with helix and offset runout.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.postprocessor import Tool
from pipeline.shop.cutting import spindle_test
from pipeline.shop.cutting.dynamometer import Recorded, write_dynamometer
from pipeline.shop.cutting.force import edge_coefficients, edge_force
from pipeline.shop.cutting.parameters import Conditions, Cutting, engaged
from pipeline.shop.files import write_text
from pipeline.shop.parameters import ShopParameters, stamp
from pipeline.shop.spindle import no_load_power

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
    h = np.concatenate([
        c.feed_per_tooth(tool.flutes) * 1e-3 * np.sin(_engagement(c, cutting)) for c in conditions
    ])  # fmt: skip
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
    phi: Floats = begin + (end - begin) * (np.arange(ANGLES) + 0.5) / ANGLES
    return phi


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
    rows: Floats = share * np.concatenate([edge * thick, edge], axis=1).mean(axis=2)
    return rows


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
    milling, passes = spindle_test.cutting_program(cutting, tool, parameters.control)
    powers = spindle_test.pass_powers(passes, cutting, cut)
    idle = spindle_test.warm_up(cutting, tool, parameters.control)
    begin = parameters.start.astype("datetime64[ms]") - np.timedelta64(86400 - round(OPENING), "s")
    later = begin + np.timedelta64(round(PAUSE), "s")
    files = []
    for name, program, cuts, start in (
        ("no-load", idle, [], begin),
        (milling.name, milling, list(zip(passes, powers, strict=True)), later),
    ):
        random = parameters.generator(f"cutting run {name}")
        lines, load = spindle_test.run(program, cuts, start, parameters, random)
        text, log = f"cutting/{name}.nc", f"cutting/{name}-run1.txt"
        write_text(folder / text, program.text)
        write_text(folder / log, "\n".join(lines) + "\n")
        files.append({
            "file": log, "program": text, "start": stamp(start, 0.0), "lines": len(lines),
            "greatest_load_percent": float(load.max()),
        })  # fmt: skip
    pairs = zip(passes, powers, strict=True)
    rows = [spindle_test.pass_truth(one, power) for one, power in pairs]
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
