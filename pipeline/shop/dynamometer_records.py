"""The recordings of the dynamometer: one test after the other with one tool, which wears."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.shop.cutting_parameters import Cutting
from pipeline.shop.cutting_pass import Motion, cut_length, pass_forces, wear
from pipeline.shop.dynamometer_file import write_recording
from pipeline.shop.dynamometer_parameters import RATE
from pipeline.shop.dynamometer_series import LOST, CuttingTest, series
from pipeline.shop.s_curve import Floats

if TYPE_CHECKING:
    from pipeline.shop.parameters import ShopParameters

SLICE = 0.125
"""Greatest height of a slice of the edges [mm]."""
LEAD = 0.05
"""Time before the first row in which the dynamometer's modes settle [s]."""
AIR = 0.12
"""Time in the air at the beginning or at the end of a recording that has it [s]."""
SLOW = 0.15
"""Time constant of the spindle's wander [s]."""
MEASURED = 20.0
"""How long each whole measurement was [s]."""
KEPT = 0.3
"""Share of a test that is left in the torn file."""
REASON = {
    "clipped": "the range of the amplifier was set too low: the peaks are cut off",
    "torn": "the file breaks off inside a row; what stands before it is sound",
    "lost": "the cable of Fy came off: the channel shows next to nothing",
}


@dataclass(frozen=True, kw_only=True)
class Series:
    """What was recorded: truth of each file, crosstalk (3, 3), cut length of a tooth [m]."""

    files: list[dict[str, Any]]
    crosstalk: Floats
    cut: float


def write_dynamometer(folder: Path, parameters: "ShopParameters") -> Series:
    """Write ``dynamometer/*.csv`` into ``folder``."""
    from pipeline.shop.dynamometer_chain import crosstalk

    cutting = parameters.cutting
    asked = cutting.dynamometer.series
    mixed = crosstalk(cutting.dynamometer, parameters.generator("dynamometer crosstalk"))
    files, cut = [], 0.0
    for test in series(cutting):
        length = cut_length(test.conditions, cutting.tool, asked.block)
        random = parameters.generator(f"dynamometer {test.name}")
        worn = wear(cutting.tool, cut + length / 2)
        files.append(_recorded(folder, test, cutting, worn, mixed, random))
        cut += length * (1 + asked.passes_between)
    return Series(files=files, crosstalk=mixed, cut=cut)


def _recorded(
    folder: Path, test: CuttingTest, cutting: Cutting, worn: float, mixed: Floats,
    random: np.random.Generator,
) -> dict[str, Any]:  # fmt: skip
    """Cut one test and write its file; what is true of it."""
    from pipeline.shop.dynamometer_chain import FINE, converted, disconnected, shown, zero

    d = cutting.dynamometer
    depth = test.conditions.depth + float(random.normal(0, d.depth_error)) * 1e-3
    motion = _motion(test, cutting, random)
    true = replace(test.conditions, depth=depth)
    force = pass_forces(true, cutting.tool, cutting.workpiece, worn, motion, d.series.block, SLICE)
    own, lead = zero(d, random), round(LEAD * RATE) * FINE
    whole = disconnected(mixed, LOST) if test.fault == "lost" else mixed
    values = shown(force, whole, own, d, lead, random)
    ends = d.low_range if test.fault == "clipped" else d.range
    written, counted = converted(values, ends, d.bits)
    rows = round(KEPT * len(written)) if test.fault == "torn" else len(written)
    file = f"dynamometer/{test.name}.csv"
    start = round(float(random.uniform(2, 5)), 1)
    write_recording(folder / file, start, written[:rows], MEASURED, d.decimal, test.fault == "torn")
    return {
        "file": file,
        **_told(test, cutting),
        "rows": rows,
        "true": {
            "depth_mm": depth, "wear_um": worn * 1e6, "offset_N": own.offset.tolist(),
            "drift_N_s": own.drift.tolist(), **counted, **_moved(motion, force, lead, cutting),
        },
    }  # fmt: skip


def _told(test: CuttingTest, cutting: Cutting) -> dict[str, Any]:
    """What was set, and what went wrong."""
    c = test.conditions
    return {
        "settings": c,
        "conditions": asdict(c) | {"feed_per_tooth": c.feed_per_tooth(cutting.tool.flutes)},
        "window": test.window,
        "fault": test.fault,
        "reject": test.fault in ("clipped", "lost"),
        "reason": REASON.get(test.fault, ""),
    }


def _moved(motion: Motion, force: Floats, lead: int, cutting: Cutting) -> dict[str, Any]:
    """Speed, first angle, mean force on the tool while it is all in the material, and when."""
    from pipeline.shop.dynamometer_chain import FINE

    angle, x, shown = motion.angle[lead:], motion.x[lead:], force[lead:, :3]
    # the front half cuts: all of it is in once the centre is, and the front leaves first
    last = cutting.dynamometer.series.block * 1e-3 - cutting.tool.radius
    inside = np.flatnonzero((x >= 0) & (x <= last))
    seconds = inside[[0, -1]] / (RATE * FINE)
    turned = (angle[-1] - angle[0]) / (angle.size - 1) * RATE * FINE
    return {
        "speed_rpm": float(turned * 30 / np.pi), "first_angle_deg": float(np.rad2deg(angle[0])),
        "inside_s": seconds.tolist(), "mean_on_tool_N": shown[inside].mean(axis=0).tolist(),
    }  # fmt: skip


def _motion(test: CuttingTest, cutting: Cutting, random: np.random.Generator) -> Motion:
    """Where the tool is at each step of a recording, its lead included."""
    from pipeline.shop.dynamometer_chain import FINE
    from pipeline.shop.filters import lagged

    dynamometer, c = cutting.dynamometer, test.conditions
    asked, radius = dynamometer.series, cutting.tool.radius
    velocity, length = c.feed / 60e3, asked.block * 1e-3
    ramp = AIR + radius / velocity if test.window != "inside" else 0.0
    rate = RATE * FINE
    steps = round((asked.seconds + ramp) * RATE) * FINE + round(LEAD * RATE) * FINE
    way = steps / rate * velocity
    first = {
        "entry": -radius - (AIR + LEAD) * velocity, "inside": (length - way) / 2,
        "exit": length + radius + AIR * velocity - way,
    }[test.window]  # fmt: skip
    share = 1 / (SLOW * rate)
    wander = lagged(random.standard_normal(steps), share, 0.0) * np.sqrt(2 / share)
    error = float(random.uniform(-1, 1)) * dynamometer.speed_error
    speed = c.speed * np.pi / 30 * (1 + error + dynamometer.speed_wander * wander)
    angle = float(random.uniform(0, 2 * np.pi)) + np.cumsum(speed) / rate
    return Motion(angle=angle, x=first + np.arange(steps) * velocity / rate)
