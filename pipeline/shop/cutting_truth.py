"""What a linear-edge model with helix and offset runout should find of the shop's own forces."""

from dataclasses import asdict
from typing import Any

import numpy as np

from pipeline.shop.cutting_conditions import Conditions, engaged
from pipeline.shop.cutting_parameters import Cutting
from pipeline.shop.cutting_pass import edge_law
from pipeline.shop.dynamometer_records import Series
from pipeline.shop.s_curve import Floats

ANGLES = 400
"""At which the chip of each recording is taken."""
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
        "only but for whole pitches, 360 deg / flutes"
    ),
    "spindle.no_load_W": "pairs of speed [rev/min] and power [W] without a cut",
    "spindle.specific_force": "power of all passes at the tool over what they remove in that time",
}


def linear_edge(cutting: Cutting, conditions: list[Conditions], worn: float) -> dict[str, float]:
    """Coefficients of the straight line: cutting [N/mm2], edge [N/mm]; ``worn`` [m]."""
    h = np.concatenate([_chips(c, cutting) for c in conditions])
    forces = _edge_forces(cutting, h, worn)
    line = np.stack([h, np.ones(h.size)], axis=1)
    (k_c, k_e), *_ = np.linalg.lstsq(line, forces, rcond=None)
    return {f"K_{q}c": float(v) * 1e-6 for q, v in zip("tra", k_c, strict=True)} | {
        f"K_{q}e": float(v) * 1e-3 for q, v in zip("tra", k_e, strict=True)
    }


def _chips(conditions: Conditions, cutting: Cutting) -> Floats:
    """Thickness of the chip over the engagement [m]."""
    begin, end = engaged(conditions, cutting.tool.diameter)
    phi = begin + (end - begin) * (np.arange(ANGLES) + 0.5) / ANGLES
    thick: Floats = conditions.feed_per_tooth(cutting.tool.flutes) * 1e-3 * np.sin(phi)
    return thick


def _edge_forces(cutting: Cutting, h: Floats, worn: float) -> Floats:
    """Mean over the teeth for each thickness [m], shape (T, 3) [N/m]."""
    from pipeline.shop.cutting_force import edge_force

    law, sharpness = edge_law(cutting.workpiece, worn), float(np.mean(cutting.tool.sharpness))
    out: Floats = np.array([edge_force(law, thick, sharpness) for thick in h.tolist()])
    return out


def mean_force(cutting: Cutting, files: list[dict[str, Any]]) -> dict[str, float]:
    """Coefficients that meet the true mean forces of ``files`` best, as of :func:`linear_edge`."""
    rows = np.concatenate([_mean_rows(f["settings"], cutting) for f in files])
    means = np.concatenate([f["true"]["mean_on_tool_N"] for f in files])
    found, *_ = np.linalg.lstsq(rows, means, rcond=None)
    names = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
    return dict(zip(names, found.tolist(), strict=True))


def _mean_rows(conditions: Conditions, cutting: Cutting) -> Floats:
    """Mean forces along the feed, left of it and along the axis for each coefficient, (3, 6)."""
    begin, end = engaged(conditions, cutting.tool.diameter)
    phi = begin + (end - begin) * (np.arange(ANGLES) + 0.5) / ANGLES
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
    return {"runout": float(np.abs(offset)), "runout_angle": float(np.rad2deg(np.angle(offset)))}


def dynamometer_truth(cutting: Cutting, recorded: Series) -> dict[str, Any]:
    """``parameters`` and ``more`` of the truth about the recordings of the dynamometer."""
    sound = [f for f in recorded.files if not f["reject"]]
    conditions = [f["settings"] for f in sound]
    worn = float(np.mean([f["true"]["wear_um"] for f in sound]))
    depth = float(np.mean([c.depth for c in conditions]))
    parameters = {
        **linear_edge(cutting, conditions, worn * 1e-6), **runout(cutting, depth),
        "helix": cutting.tool.helix,
    }  # fmt: skip
    d = cutting.dynamometer
    more = {
        "definition": DEFINITION,
        "mean_force": mean_force(cutting, sound),
        "mean_wear_um": worn,
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
