"""One part on the shop's machine: forces of every tooth along the whole program."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import ceil, pi, tan

import numpy as np

from pipeline.shop.cutting_parameters import EndMill
from pipeline.shop.cutting_pass import edge_law, wear
from pipeline.shop.dynamometer_records import SLOW
from pipeline.shop.filters import lagged
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.s_curve import Floats
from pipeline.shop.trial_blank import SLICE, Swept
from pipeline.shop.trial_chance import Chance
from pipeline.shop.trial_force import RECENT, Cutter, Layers, Steps, forces
from pipeline.shop.trial_job import TrialJob
from pipeline.shop.trial_motion import Track

STEPS = 120
"""Of a turn, at least: of 3 degrees."""
PIECE = 1.0
"""Time over which wear counts as constant [s]."""
BEFORE = 1.0
"""Longest time before a piece that is looked back on [s]."""
AFTER = 0.02
"""Time for which a tooth may still cut after the tool has swept its last cell [s]."""


@dataclass(frozen=True, kw_only=True)
class Loads:
    """Peaks by line [N]; time in the cut, of it in pitches with a peak above the limit [s]."""

    peaks: dict[int, float]
    cutting: float
    above: float


def cut(
    way: Track, blank: Swept, part: Chance, job: TrialJob, parameters: ShopParameters,
    random: np.random.Generator,
) -> Loads:  # fmt: skip
    """Loads of one part."""
    turned = _turned(way, part, parameters, random)
    peaks: dict[int, float] = {}
    cutting = above = 0.0
    used = dict(part.used)
    for begin, end in _pieces(way, blank):
        number = int(way.tool[begin])
        tool = part.tools[number]
        load, moment, gone = _piece(way, blank, turned, begin, end, part, used[number])
        used[number] += gone
        lines = way.line[np.minimum((moment / way.cycle).astype(np.int64), way.line.size - 1)]
        for line in np.unique(lines).tolist():
            peaks[line] = max(peaks.get(line, 0.0), float(load[lines == line].max()))
        pitch = _steps(tool) // tool.flutes
        whole = load[: load.size // pitch * pitch].reshape(-1, pitch).max(axis=1)
        each = (moment[-1] - moment[0]) / max(load.size - 1, 1) * pitch if load.size else 0.0
        cutting += each * float((whole > 0).sum())
        above += each * float((whole > job.limit_load_N).sum())
    return Loads(peaks=peaks, cutting=cutting, above=above)


def _turned(
    way: Track, part: Chance, parameters: ShopParameters, random: np.random.Generator
) -> Floats:
    """Angle of the spindle in each cycle [rad], with its error and its wander."""
    share = way.cycle / SLOW
    noise = lagged(random.standard_normal(way.speed.size), share, 0.0) * np.sqrt(2 / share)
    wander = parameters.cutting.dynamometer.speed_wander * noise
    speed = way.speed * pi / 30 * (1 + part.speed_error + wander)
    angle: Floats = part.angle + np.concatenate([[0.0], np.cumsum(speed[:-1])]) * way.cycle
    return angle


def _pieces(way: Track, blank: Swept) -> Iterator[tuple[int, int]]:
    """First and last cycles of stretches in the cut, none longer than ``PIECE``, of one tool."""
    size = way.line.size
    some = np.zeros(size + 1, dtype=np.int64)
    slow = np.searchsorted(blank.way, blank.way[blank.cuts] - blank.cell)
    fast = np.searchsorted(blank.way, blank.way[blank.cuts] + blank.cell)
    after = ceil(AFTER / way.cycle)
    np.add.at(some, slow, 1)
    np.add.at(some, np.minimum(fast + after, size), -1)
    inside = np.concatenate([[False], np.cumsum(some[:-1]) > 0, [False]])
    change = np.flatnonzero(np.diff(inside.astype(np.int8)))
    longest = max(round(PIECE / way.cycle), 1)
    for begin, end in zip(change[::2].tolist(), change[1::2].tolist(), strict=True):
        for first in range(begin, end, longest):
            last = min(first + longest, end, size - 1)
            if last > first:
                yield first, last


def _steps(tool: EndMill) -> int:
    return ceil(STEPS / tool.flutes) * tool.flutes


def _piece(
    way: Track, blank: Swept, turned: Floats, begin: int, end: int, part: Chance, used: float
) -> tuple[Floats, Floats, float]:
    """Load (N,) [N], its times (N,) [s] from ``begin`` to ``end``, what a tooth cut [m]."""
    number = int(way.tool[begin])
    tool = part.tools[number]
    turn = _steps(tool)
    part_of = 2 * pi / turn
    since = int(np.searchsorted(blank.way, blank.way[begin] - RECENT))
    since = max(since, begin - ceil(BEFORE / way.cycle), 0)
    while since > 0 and turned[begin] - turned[since] < 2.5 * 2 * pi:
        since -= 1
    angle = np.arange(ceil(turned[since] / part_of), ceil(turned[end] / part_of)) * part_of
    first = ceil(turned[begin] / part_of) - ceil(turned[since] / part_of)
    if first < turn or angle.size <= first:
        return np.zeros(0), np.zeros(0), 0.0
    at = np.interp(angle, turned[since : end + 1], np.arange(since, end + 1, dtype=np.float64))
    rows = np.arange(since, end + 1)
    x, y, z = (np.interp(at, rows, way.tip[since : end + 1, axis]) for axis in range(3))
    steps = Steps(angle=angle, x=x, y=y, z=z, way=np.interp(at, rows, blank.way[since : end + 1]))
    force, count = forces(
        edge_law(part.workpiece, wear(tool, used)), _cutter(tool), np.array(tool.sharpness),
        _layers(blank, part.deeper[number]), steps, turn, first,
    )  # fmt: skip
    gone = count / tool.flutes * part_of * tool.radius
    return np.hypot(force[:, 0], force[:, 1]), at[first:] * way.cycle, gone


def _cutter(tool: EndMill) -> Cutter:
    return Cutter(
        radius=tool.diameter / 2, lag=tan(tool.helix_angle) / (tool.diameter / 2),
        runout=tool.runout * 1e-3, runout_angle=float(np.deg2rad(tool.runout_angle)),
        tilt=tool.tilt * 1e-3, tilt_angle=float(np.deg2rad(tool.tilt_angle)),
    )  # fmt: skip


def _layers(blank: Swept, deeper: float) -> Layers:
    """The blank for a tool that cuts by ``deeper`` [mm] more at its top than is programmed."""
    low, high, layer = [], [], []
    for k, (a, b) in enumerate(pairwise(blank.heights.tolist())):
        count = ceil((b - a) / SLICE - 1e-9)
        edges = a + (b - a) * np.arange(count + 1) / count
        low.append(edges[:-1])
        high.append(edges[1:])
        layer += [k] * count
    tops = np.concatenate(high)
    tops[-1] += deeper
    b = blank.blank
    return Layers(
        low_x=b[0], high_x=b[1], low_y=b[2], high_y=b[3], first=blank.first,
        corner_x=blank.corner[0], corner_y=blank.corner[1], cell=blank.cell,
        layer=np.array(layer, dtype=np.int64), low=np.concatenate(low), high=tops,
    )  # fmt: skip
