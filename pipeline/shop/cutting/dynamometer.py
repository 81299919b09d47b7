"""Recordings of the dynamometer: tests in order, measuring chain, files, a tool that wears.

The force on the workpiece passes the modes of the plate, crosstalk, the charge amplifier with its
drift and hum, and the converter.  Some recordings have faults: clipped, torn, a channel lost.
"""

from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.shop.cutting.force import AXIAL, Motion, X, Y, cut_length, pass_forces, wear
from pipeline.shop.cutting.parameters import (
    RATE,
    ChannelMode,
    Conditions,
    Cutting,
    Dynamometer,
    Immersion,
)
from pipeline.shop.files import rows_text, torn, write_text
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import Random, ShopParameters

Window = Literal["inside", "entry", "exit"]
Fault = Literal["", "clipped", "torn", "lost"]

LOST = 1
"""Channel of which the cable came off in one test: Fy."""
FINE = 4
"""Steps of the simulation for each row: modes and edges' entries are fast."""
SHARE_OF_LOST = 0.004
"""Share that a channel without its cable still shows: stray capacitance [1]."""
FOLDER = "C:\\Measurements\\"
SLICE = 0.125
"""Greatest height of a slice of the edges [mm]."""
LEAD = 0.05
"""Time before the first row in which the dynamometer's modes settle [s]."""
AIR = 0.12
"""Time in the air at the beginning or at the end of a recording that has it [s]."""
SLOW = 0.15
"""Time constant of the spindle's wander [s]."""
MEASURED = 20.0
"""Length of each whole measurement [s]."""
KEPT = 0.3
"""Share of a test that is left in the torn file."""
SERIES: tuple[tuple[Immersion, int, int, int, Window, Fault], ...] = (
    ("slot", 0, 0, 0, "inside", ""),
    ("slot", 0, 0, 1, "inside", ""),
    ("slot", 0, 0, 2, "inside", ""),
    ("slot", 0, 0, 3, "entry", ""),
    ("slot", 1, 0, 1, "inside", ""),
    ("slot", 1, 0, 3, "exit", ""),
    ("slot", 0, 1, 0, "inside", ""),
    ("slot", 0, 1, 2, "inside", ""),
    ("down", 0, 0, 1, "inside", ""),
    ("down", 0, 0, 3, "entry", ""),
    ("up", 0, 0, 1, "inside", ""),
    ("up", 0, 0, 3, "exit", ""),
    ("slot", 1, 1, 3, "inside", "clipped"),
    ("down", 1, 1, 2, "inside", "lost"),
    ("up", 1, 1, 1, "inside", "torn"),
)
"""Tests in order: immersion (half of the diameter, or a slot), places of speed, depth and feed in
the machine's series, part of the pass, fault."""
REASON = {
    "clipped": "the range of the amplifier was set too low: the peaks are cut off",
    "torn": "the file breaks off inside a row; what stands before it is sound",
    "lost": "the cable of Fy came off: the channel shows next to nothing",
}


@dataclass(frozen=True, kw_only=True)
class CuttingTest:
    """One recording: conditions, which part of the pass it holds, its fault."""

    conditions: Conditions
    window: Window = "inside"
    fault: Fault = ""

    @property
    def name(self) -> str:
        """Name of its file: the conditions."""
        c = self.conditions
        side = "" if c.immersion == "slot" else f"ae{c.width:g}"
        return f"{c.immersion}-n{c.speed:g}f{c.feed:g}ap{c.depth:g}{side}"


def series(cutting: Cutting) -> list[CuttingTest]:
    """All tests of a machine, in the order in which they are cut."""
    series, tool = cutting.dynamometer.series, cutting.tool
    tests = []
    for immersion, speed, depth, feed, window, fault in SERIES:
        rate = series.feeds[feed] * tool.flutes * series.speeds[speed]
        conditions = Conditions(
            immersion=immersion, depth=series.depths[depth], speed=series.speeds[speed],
            width=tool.diameter / (1 if immersion == "slot" else 2), feed=round(rate / 10) * 10.0,
        )  # fmt: skip
        tests.append(CuttingTest(conditions=conditions, window=window, fault=fault))
    return tests


@dataclass(frozen=True, kw_only=True)
class Baseline:
    """Additions of one recording: offset [N], drift [N/s] and phase of the hum [rad], (3,) each."""

    offset: Floats
    drift: Floats
    hum_phase: Floats


def baseline(dynamometer: Dynamometer, random: Random) -> Baseline:
    """Offset, drift and hum that are drawn for one recording."""
    return Baseline(
        offset=random.normal(0, dynamometer.offset, 3),
        drift=random.normal(0, dynamometer.drift, 3), hum_phase=random.uniform(0, 2 * np.pi, 3),
    )  # fmt: skip


def crosstalk(dynamometer: Dynamometer, random: Random) -> Floats:
    """Share of each force (column) in each channel (row), shape (3, 3) [1]."""
    mixed: Floats = random.uniform(0.4, 1.0, (3, 3)) * random.choice((-1.0, 1.0), (3, 3))
    mixed *= dynamometer.crosstalk
    np.fill_diagonal(mixed, 1.0)
    return mixed


def plate_force(on_tool: Floats, dynamometer: Dynamometer) -> Floats:
    """Forces (T, 4) on the tool as the plate feels them along its axes x, y, z, (T, 3) [N]."""
    ahead, left = -on_tool[:, X], -on_tool[:, Y]
    up = on_tool[:, AXIAL] if dynamometer.axial == "lift" else -on_tool[:, AXIAL]
    along_x = dynamometer.along == "x"
    return np.stack([ahead, left, up] if along_x else [-left, ahead, up], axis=1)


def amplified(
    on_tool: Floats, mixed: Floats, own: Baseline, dynamometer: Dynamometer, lead: int,
    random: Random,
) -> Floats:  # fmt: skip
    """Output of the amplifier at each row, before the converter, shape (T, 3) [N].

    ``on_tool`` (FINE T + lead, 4): forces, FINE steps a row; ``mixed`` (3, 3): :func:`crosstalk`;
    in the first ``lead`` steps the modes settle.
    """
    force = plate_force(on_tool, dynamometer)
    modes = (dynamometer.x, dynamometer.y, dynamometer.z)
    channels = zip((force @ mixed.T).T, modes, strict=True)
    rows = np.stack([_response(values, mode) for values, mode in channels], axis=1)[lead::FINE]
    time = np.arange(len(rows))[:, None] / RATE
    hum = dynamometer.hum * np.sin(2 * np.pi * dynamometer.mains * time + own.hum_phase)
    noise = random.normal(0, dynamometer.noise, rows.shape)
    return rows + own.offset + own.drift * time + hum + noise


def _response(force: Floats, mode: ChannelMode) -> Floats:
    """Response of a mode to a force that is linear from step to step."""
    from scipy.signal import lfilter

    return lfilter(*_sampled(mode), force)


@cache
def _sampled(mode: ChannelMode) -> tuple[Floats, Floats]:
    """Transfer function of a mode in powers of the delay: designed once, not for each test."""
    from scipy.signal import cont2discrete

    w = 2 * np.pi * mode.frequency
    ratio = np.array([w * w]), np.array([1.0, 2 * mode.damping * w, w * w])
    above, below, _ = cont2discrete(ratio, 1 / (RATE * FINE), method="foh")
    return above.ravel(), below


def converted(values: Floats, ends: Any, bits: int) -> tuple[Floats, Ints]:
    """Values (T, C) in steps of a converter that reaches to ``ends``, and how many stand there."""
    last = 2 ** (bits - 1)
    step = ends / last
    counts = np.clip(np.round(values / step), -last, last - 1)
    return counts * step, (np.abs(counts) >= last - 1).sum(axis=0)


def write_recording(
    path: Path, forces: Floats, *, start: float, measured: float, decimal: str, breaks: bool
) -> None:
    """Write Fx, Fy, Fz (T, 3) [N] of a recording.

    The first row is at ``start`` of a measurement of ``measured`` [s].  With a decimal comma the
    separator is a semicolon; with ``breaks`` the file breaks off inside its last row.
    """
    separator, name = ";" if decimal == "," else ",", path.stem
    time = start + np.arange(len(forces)) / RATE
    form = separator.join(["%.7g", "%.6g", "%.6g", "%.6g"]) + "\n"
    body = rows_text(np.column_stack([np.round(time, 4), forces]), form)
    body = torn(body) if breaks else body
    head = {
        "DynoWare": "Version 2.6.5 (simulated)", "Path:": FOLDER, "Filename:": f"{name}.dwd",
        "Config ID:": f"{name}.cfg", "Setup ID:": 0, "Manipulated:": 0, "Filename 1:": " ",
        "Filename 2:": " ", "Date:": " ", "Time:": " ", "Sampling rate [Hz]:": RATE,
        "Measuring time [s]:": f"{measured:g}", "Delay time [s]:": 0, "Cycle time [s]:": 0,
        "Cycles:": 1, "Samples per channel:": round(measured * RATE) + 1, "Cycle interval:": 0,
        "Cycle No:": 1,
    }  # fmt: skip
    lines = [f"{key}{separator}{value}" for key, value in head.items()]
    lines += [separator.join(("Time", "Fx", "Fy", "Fz")), separator.join("sNNN")]
    text = "\n".join(lines) + "\n" + (body.replace(".", ",") if decimal == "," else body)
    write_text(path, text)


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """Truth of each recording, crosstalk (3, 3) [1], length of cut of a tooth [m]."""

    files: list[dict[str, Any]]
    crosstalk: Floats
    cut: float


def write_dynamometer(folder: Path, parameters: ShopParameters) -> Recorded:
    """Write ``dynamometer/*.csv`` into ``folder``."""
    cutting = parameters.cutting
    planned = cutting.dynamometer.series
    mixed = crosstalk(cutting.dynamometer, parameters.generator("dynamometer crosstalk"))
    files, cut = [], 0.0
    for test in series(cutting):
        length = cut_length(test.conditions, cutting.tool, planned.block)
        random = parameters.generator(f"dynamometer {test.name}")
        VB = wear(cutting.tool, cut + length / 2)
        files.append(_recorded(folder, test, cutting, VB, mixed, random))
        cut += length * (1 + planned.passes_between)
    return Recorded(files=files, crosstalk=mixed, cut=cut)


def _recorded(
    folder: Path, test: CuttingTest, cutting: Cutting, VB: float, mixed: Floats, random: Random
) -> dict[str, Any]:
    d = cutting.dynamometer
    depth = test.conditions.depth + float(random.normal(0, d.depth_error)) * 1e-3
    motion = _motion(test, cutting, random)
    true = replace(test.conditions, depth=depth)
    force = pass_forces(
        true, cutting.tool, cutting.workpiece, motion, flank=cutting.workpiece.flank(VB),
        length=d.series.block, slice_height=SLICE,
    )  # fmt: skip
    own, lead = baseline(d, random), round(LEAD * RATE) * FINE
    if test.fault == "lost":
        mixed = mixed.copy()
        mixed[LOST] *= SHARE_OF_LOST
    values = amplified(force, mixed, own, d, lead, random)
    ends = d.low_range if test.fault == "clipped" else d.range
    written, clipped = converted(values, ends, d.bits)
    rows = round(KEPT * len(written)) if test.fault == "torn" else len(written)
    file = f"dynamometer/{test.name}.csv"
    start = round(float(random.uniform(2, 5)), 1)
    write_recording(
        folder / file, written[:rows], start=start, measured=MEASURED, decimal=d.decimal,
        breaks=test.fault == "torn",
    )  # fmt: skip
    c = test.conditions
    return {
        "file": file,
        "settings": c,
        "conditions": asdict(c) | {"feed_per_tooth": c.feed_per_tooth(cutting.tool.flutes)},
        "window": test.window,
        "fault": test.fault,
        "reject": test.fault in ("clipped", "lost"),
        "reason": REASON.get(test.fault, ""),
        "rows": rows,
        "true": {
            "depth_mm": depth, "wear_um": VB * 1e6, "offset_N": own.offset.tolist(),
            "drift_N_s": own.drift.tolist(), "range_N": ends, "step_N": ends / 2 ** (d.bits - 1),
            "clipped": clipped.tolist(),
            **_motion_truth(motion, force, lead, cutting),
        },
    }  # fmt: skip


def _motion_truth(motion: Motion, force: Floats, lead: int, cutting: Cutting) -> dict[str, Any]:
    """Speed, first angle, mean force on the tool while it is all in the material, and when."""
    angle, x, shown = motion.angle[lead:], motion.x[lead:], force[lead:, :3]
    # the front half cuts: all of it is in once the centre is, and the front leaves first
    last = cutting.dynamometer.series.block * 1e-3 - cutting.tool.radius
    inside = np.flatnonzero((x >= 0) & (x <= last))
    if not inside.size:
        raise ValueError(
            f"Series.seconds = {cutting.dynamometer.series.seconds} s is too short: at no time of "
            f"a recording is the whole tool of {cutting.tool.diameter} mm in the material"
        )
    seconds = inside[[0, -1]] / (RATE * FINE)
    turned = (angle[-1] - angle[0]) / (angle.size - 1) * RATE * FINE
    return {
        "speed_rpm": float(turned * 30 / np.pi), "first_angle_deg": float(np.rad2deg(angle[0])),
        "inside_s": seconds.tolist(), "mean_on_tool_N": shown[inside].mean(axis=0).tolist(),
    }  # fmt: skip


def _motion(test: CuttingTest, cutting: Cutting, random: Random) -> Motion:
    dynamometer, c = cutting.dynamometer, test.conditions
    planned, radius = dynamometer.series, cutting.tool.radius
    velocity, length = c.feed / 60e3, planned.block * 1e-3
    ramp = AIR + radius / velocity if test.window != "inside" else 0.0
    rate = RATE * FINE
    steps = round((planned.seconds + ramp) * RATE) * FINE + round(LEAD * RATE) * FINE
    travel = steps / rate * velocity
    first = {
        "entry": -radius - (AIR + LEAD) * velocity, "inside": (length - travel) / 2,
        "exit": length + radius + AIR * velocity - travel,
    }[test.window]  # fmt: skip
    share = 1 / (SLOW * rate)
    wander = lagged(random.standard_normal(steps), share, 0.0) * np.sqrt(2 / share)
    error = float(random.uniform(-1, 1)) * dynamometer.speed_error
    speed = c.speed * np.pi / 30 * (1 + error + dynamometer.speed_wander * wander)
    angle = float(random.uniform(0, 2 * np.pi)) + np.cumsum(speed) / rate
    return Motion(angle=angle, x=first + np.arange(steps) * velocity / rate)
