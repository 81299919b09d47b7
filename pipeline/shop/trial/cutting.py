"""Forces of an end mill along a whole program through a swept blank, for one part (numba).

Seen from above the spindle turns clockwise (M3); a tooth stands at the angle φ from +Y in the sense
of its motion, its edge point at c + R (sin φ, cos φ) about the tool's centre c.  The chip thickness
is the distance from the edge point back along its radius to where the teeth before it, about the
centres of their own moments and on their own radii, left the material; there is one where the
material of that place was not swept before.

Parts differ.  Sources of the orders of magnitude:

- Specific cutting force from batch to batch of one material: tensile strength and hardness of a
  wrought alloy of one temper scatter by 3 to 5 % from lot to lot (MMPDS-01, design mechanical
  properties, and the spread that EN 485-2 leaves for one temper); the force goes with them.
- Offset of a tool from the spindle's axis: ISO 15488 (table 4) allows collets of up to 10 mm bore
  15 um of total indicated runout (class 2, the usual one) or 10 um (class 1), wider ones 5 um more;
  the offset is half of it.  Its two components are normal, so that the offset is Rayleigh's.
- Sharpness of teeth: Kline, DeVor (1983) and grinders' tolerances: edge radii of one tool differ by
  5 to 10 %.
- Length of a tool on a presetter, and the touched top of a blank: repeatability of 5 to 10 um.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, pi, sqrt, tan
from typing import NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.shop.cutting.dynamometer import SLOW
from pipeline.shop.cutting.force import EdgeCoefficients, edge_coefficients, edge_force, wear
from pipeline.shop.cutting.parameters import EndMill, Workpiece
from pipeline.shop.motion import lagged
from pipeline.shop.parameters import Random, ShopParameters
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.motion import SLICE, Swept, Track

RECENT = 0.6
"""Path length within which swept material is looked up turn by turn, not in the cells [mm]."""
CLEAR = 0.02
"""Distance inside an earlier circle from which a place counts as swept by it [mm]."""
STILL = 1e-7
"""Changes of height that count as none [mm]."""
BATCH = 0.04
"""Standard deviation of a batch's specific force [1]."""
SPECIFIC = ("tangential", "radial", "axial", "edge_tangential", "edge_radial", "edge_axial")
"""Fields of ``Workpiece`` that go with the batch."""
SHARPNESS = 0.08
"""Standard deviation of a tooth's own edge force [1]."""
USED = 15.0
"""Greatest length of cut of a tooth before the part [m]."""
LENGTH, TOP = 8e-3, 8e-3
"""Standard deviations of a tool's length and of the blank's top [mm]."""
RAYLEIGH = sqrt(pi / 2)
"""Mean of Rayleigh's distribution over its scale."""
STEPS = 120
"""Least number of steps in a revolution: 3 degrees each."""
PIECE = 1.0
"""Time over which wear counts as constant [s]."""
BEFORE = 1.0
"""Longest time before a piece in which earlier teeth are followed [s]."""
AFTER = 0.02
"""Time for which a tooth may still cut after the tool has swept its last cell [s]."""


class Cutter(NamedTuple):
    """The mounted tool: lengths in mm, angles in rad; runout and tilt as of ``EndMill``."""

    radius: float
    lag: float  # of the edge for each mm up [rad/mm]
    runout: float
    runout_angle: float
    tilt: float  # [1]
    tilt_angle: float


class Layers(NamedTuple):
    """The blank: box [mm], first path lengths by cell, slices by their layer and heights."""

    low_x: float
    high_x: float
    low_y: float
    high_y: float
    first: np.ndarray  # (L, rows, columns) [mm]
    corner_x: float
    corner_y: float
    cell: float
    layer: np.ndarray  # (S,)
    low: np.ndarray  # (S,) [mm]
    high: np.ndarray


class Steps(NamedTuple):
    """Motion of the tool, (N,) each: angle of the first tooth [rad]; tip, its path length [mm]."""

    angle: np.ndarray
    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    path: np.ndarray


@compiled_with(nogil=True, error_model="numpy")
def forces(
    edge: EdgeCoefficients, cutter: Cutter, sharpness: np.ndarray, layers: Layers, steps: Steps,
    turn: int, begin: int,
) -> tuple[np.ndarray, int]:  # fmt: skip
    """Forces on the tool along X, Y and Z [N] from the step ``begin`` on, (N - begin, 3).

    ``sharpness`` (F,): factor of each tooth's own edge force; ``turn``: steps of a revolution, a
    multiple of F.  Also the steps for which a tooth cuts in its lowest slice, of all teeth
    together.
    """
    flutes, slices = sharpness.size, layers.layer.size
    radii, ahead, behind = np.zeros((flutes, slices)), np.zeros(slices), np.zeros(slices)
    height = np.zeros(slices)
    out = np.zeros((steps.angle.size - begin, 3))
    level, lowest, count = np.inf, 0, 0
    for k in range(begin, steps.angle.size):
        if abs(steps.z[k] - level) > STILL:
            level = steps.z[k]
            lowest = _edges(cutter, layers, level, radii, ahead, behind, height)
        for tooth in range(flutes):
            tip = steps.angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(tip), np.cos(tip)
            for s in range(lowest, slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = _chip(radii, tooth, s, sine, cosine, steps, k, turn)
                if h <= 0.0 or not _in_material(layers, s, radii[tooth, s], sine, cosine, steps, k,
                                          turn, cutter.radius):  # fmt: skip
                    continue
                t, r, axial = edge_force(edge, h * 1e-3, sharpness[tooth])
                out[k - begin, 0] -= (t * cosine + r * sine) * height[s] * 1e-3
                out[k - begin, 1] += (t * sine - r * cosine) * height[s] * 1e-3
                out[k - begin, 2] -= axial * height[s] * 1e-3
                count += s == lowest
    return out, count


@compiled_with(nogil=True, error_model="numpy")
def _edges(
    cutter: Cutter, layers: Layers, level: float, radii: np.ndarray, ahead: np.ndarray,
    behind: np.ndarray, height: np.ndarray,
) -> int:  # fmt: skip
    """Radii, lags and heights of the slices above the tip at ``level``; the lowest of them."""
    flutes, slices = radii.shape
    lowest = slices
    for s in range(slices - 1, -1, -1):
        if s < slices - 1 and layers.high[s] - level <= STILL:
            break
        low = max(layers.low[s], level)
        height[s] = max(layers.high[s] - low, 0.0)
        lowest = s
        up = (layers.high[s] + low) / 2 - level
        lag = up * cutter.lag
        ahead[s], behind[s] = np.cos(lag), np.sin(lag)
        for tooth in range(flutes):
            place = -2 * np.pi * tooth / flutes - lag
            radii[tooth, s] = (
                cutter.radius + cutter.runout * np.cos(cutter.runout_angle - place)
                + cutter.tilt * up * np.cos(cutter.tilt_angle - place)
            )  # fmt: skip
    return lowest


@compiled_with(nogil=True, error_model="numpy")
def _chip(
    radii: np.ndarray, tooth: int, s: int, sine: float, cosine: float, steps: Steps, k: int,
    turn: int,
) -> float:  # fmt: skip
    """Chip thickness between the paths of a tooth and of the teeth before it [mm]."""
    flutes, own = radii.shape[0], radii[tooth, s]
    part = turn // flutes
    left = 0.0
    for back in range(flutes, 0, -1):  # its own path first: behind the tool it ends the search
        then, before = k - back * part, radii[(tooth - back) % flutes, s]
        dx, dy = steps.x[then] - steps.x[k], steps.y[then] - steps.y[k]
        # that tooth crossed this radius a little off the full pitches: its centre had moved on
        bend = -(dx * cosine - dy * sine) / before
        share = 1.0 - bend / (2 * np.pi * back / flutes)
        bend *= share
        left = max(left, before * (1 - bend * bend / 2) + (dx * sine + dy * cosine) * share)
        if left >= own:
            return 0.0
    return own - left


@compiled_with(nogil=True, error_model="numpy")
def _in_material(
    layers: Layers, s: int, own: float, sine: float, cosine: float, steps: Steps, k: int,
    turn: int, radius: float,
) -> bool:  # fmt: skip
    """Whether an edge point is in material: in the blank, and not swept in an earlier turn."""
    x, y = steps.x[k] + own * sine, steps.y[k] + own * cosine
    if x < layers.low_x or x > layers.high_x or y < layers.low_y or y > layers.high_y:
        return False
    first = layers.first[layers.layer[s]]
    row = min(int((y - layers.corner_y) / layers.cell), first.shape[0] - 1)
    column = min(int((x - layers.corner_x) / layers.cell), first.shape[1] - 1)
    since = steps.path[k] - first[max(row, 0), max(column, 0)]
    if since > RECENT:
        return False
    then = k - turn
    if since <= steps.path[k] - steps.path[then]:
        return True
    clear = (radius - CLEAR) ** 2
    while then >= 0 and steps.path[k] - steps.path[then] <= RECENT:
        if (x - steps.x[then]) ** 2 + (y - steps.y[then]) ** 2 < clear:
            return False
        then -= turn
    return True


@dataclass(frozen=True, kw_only=True)
class Chance:
    """One part: its batch, the tools as mounted this time."""

    workpiece: Workpiece
    """Workpiece of this batch."""
    tools: dict[int, EndMill]
    """Tools with this mounting's runout, tilt and teeth."""
    used: dict[int, float]
    """Length of cut of a tooth of each before [m]."""
    deeper: dict[int, float]
    """Extra depth of each at the blank's top over the programmed one [mm]."""
    speed_error: float
    """Speed error of the spindle [1]."""
    angle: float
    """Angle of the spindle when the run begins [rad]."""


def chance(job: TrialJob, parameters: ShopParameters, random: Random) -> Chance:
    """Draw one part; ``EndMill.runout`` and ``tilt`` are the means of all mountings."""
    batch = float(np.clip(random.normal(1.0, BATCH), 0.8, 1.2))
    work = {name: getattr(job.workpiece, name) * batch for name in SPECIFIC}
    top = float(random.normal(0.0, TOP))
    tools, used, deeper = {}, {}, {}
    for number, tool in sorted(job.tools.items()):
        teeth = np.clip(random.normal(1.0, SHARPNESS, tool.flutes), 0.7, 1.3)
        tools[number] = replace(
            tool,
            runout=min(float(random.rayleigh(tool.runout / RAYLEIGH)), 200.0),
            runout_angle=float(random.uniform(-180, 180)),
            tilt=min(float(random.rayleigh(tool.tilt / RAYLEIGH)), 20.0),
            tilt_angle=float(random.uniform(-180, 180)),
            sharpness=tuple(teeth.tolist()),
        )
        used[number] = float(random.uniform(0.0, USED))
        deeper[number] = top + float(random.normal(0.0, LENGTH))
    error = parameters.cutting.dynamometer.speed_error
    return Chance(
        workpiece=replace(job.workpiece, **work), tools=tools, used=used, deeper=deeper,
        speed_error=float(random.uniform(-error, error)), angle=float(random.uniform(0, 2 * pi)),
    )  # fmt: skip


def check_cut(name: str, track: Track, blank: Swept, job: TrialJob) -> None:
    """Refuse a cut with a tool that the job does not have, or with a spindle that stands.

    Raises ValueError with the program's ``name`` and the line.
    """
    low, high = np.array(job.blank).reshape(3, 2).T
    inside = np.all((track.tip > low) & (track.tip < high), axis=1)
    other = inside & ~np.isin(track.tool, list(job.tools))
    if other.any():
        k = int(np.argmax(other))
        raise ValueError(
            f"{name}:{track.line[k]} goes into the blank with tool {track.tool[k]}, which the job "
            f"does not have: it has {', '.join(f'T{n}' for n in sorted(job.tools))}"
        )
    stands = blank.cuts & (track.speed < 1)
    if stands.any():
        k = int(np.argmax(stands))
        raise ValueError(
            f"{name}:{track.line[k]} cuts while the spindle stands: program S and M3 before it"
        )


def cut(
    track: Track, blank: Swept, part: Chance, parameters: ShopParameters, random: Random
) -> dict[int, float]:
    """Peak load in each line of the program while one part is cut [N]."""
    peaks: dict[int, float] = {}
    for force, moment in _cuts(track, blank, part, parameters, random):
        load = np.hypot(force[:, 0], force[:, 1])
        lines = track.line[np.minimum((moment / track.cycle).astype(np.int64), track.line.size - 1)]
        for line in np.unique(lines).tolist():
            peaks[line] = max(peaks.get(line, 0.0), float(load[lines == line].max()))
    return peaks


def _cuts(
    track: Track, blank: Swept, part: Chance, parameters: ShopParameters, random: Random
) -> Iterator[tuple[Floats, Floats]]:
    """Forces on the tool (N, 3) [N] and their times (N,) [s], stretch by stretch in the cut."""
    turned = _spindle_angle(track, part, parameters, random)
    used = dict(part.used)
    for begin, end in _pieces(track, blank):
        number = int(track.tool[begin])
        force, moment, length = _piece(
            track, blank, turned, part, begin=begin, end=end, used=used[number]
        )
        used[number] += length
        yield force, moment


def _spindle_angle(
    track: Track, part: Chance, parameters: ShopParameters, random: Random
) -> Floats:
    """Angle of the spindle in each cycle [rad], with its error and its wander."""
    share = track.cycle / SLOW
    noise = lagged(random.standard_normal(track.speed.size), share, 0.0) * np.sqrt(2 / share)
    wander = parameters.cutting.dynamometer.speed_wander * noise
    speed = track.speed * pi / 30 * (1 + part.speed_error + wander)
    return part.angle + np.concatenate([[0.0], np.cumsum(speed[:-1])]) * track.cycle


def _pieces(track: Track, blank: Swept) -> Iterator[tuple[int, int]]:
    """First and last cycles of stretches in the cut, none longer than ``PIECE``, of one tool."""
    size = track.line.size
    some = np.zeros(size + 1, dtype=np.int64)
    slow = np.searchsorted(blank.path, blank.path[blank.cuts] - blank.cell)
    fast = np.searchsorted(blank.path, blank.path[blank.cuts] + blank.cell)
    after = ceil(AFTER / track.cycle)
    np.add.at(some, slow, 1)
    np.add.at(some, np.minimum(fast + after, size), -1)
    inside = np.concatenate([[False], np.cumsum(some[:-1]) > 0, [False]])
    change = np.flatnonzero(np.diff(inside.astype(np.int8)))
    longest = max(round(PIECE / track.cycle), 1)
    for begin, end in zip(change[::2].tolist(), change[1::2].tolist(), strict=True):
        for first in range(begin, end, longest):
            last = min(first + longest, end, size - 1)
            if last > first:
                yield first, last


def _steps(tool: EndMill) -> int:
    return ceil(STEPS / tool.flutes) * tool.flutes


def _piece(
    track: Track, blank: Swept, turned: Floats, part: Chance, *, begin: int, end: int, used: float
) -> tuple[Floats, Floats, float]:
    """Forces (N, 3) [N], their times (N,) [s] from ``begin`` to ``end``, a tooth's cut [m]."""
    number = int(track.tool[begin])
    tool = part.tools[number]
    turn = _steps(tool)
    steps, time, first = _turning(track, blank, turned, turn, begin, end)
    if steps is None:
        return np.zeros((0, 3)), np.zeros(0), 0.0
    force, count = forces(
        edge_coefficients(part.workpiece, wear(tool, used)), _cutter(tool),
        np.array(tool.sharpness), _layers(blank, part.deeper[number]), steps, turn, first,
    )  # fmt: skip
    length = count / tool.flutes * (2 * pi / turn) * tool.radius
    return force, time[first:], length


def _turning(
    track: Track, blank: Swept, turned: Floats, turn: int, begin: int, end: int
) -> tuple[Steps | None, Floats, int]:
    """Steps of ``turn`` a revolution, their times [s] and the first that counts."""
    part_of = 2 * pi / turn
    since = int(np.searchsorted(blank.path, blank.path[begin] - RECENT))
    since = max(since, begin - ceil(BEFORE / track.cycle), 0)
    while since > 0 and turned[begin] - turned[since] < 2.5 * 2 * pi:
        since -= 1
    angle = np.arange(ceil(turned[since] / part_of), ceil(turned[end] / part_of)) * part_of
    first = ceil(turned[begin] / part_of) - ceil(turned[since] / part_of)
    if first < turn or angle.size <= first:
        return None, np.zeros(0), 0
    at = np.interp(angle, turned[since : end + 1], np.arange(since, end + 1, dtype=np.float64))
    rows = np.arange(since, end + 1)
    x, y, z = (np.interp(at, rows, track.tip[since : end + 1, axis]) for axis in range(3))
    steps = Steps(angle=angle, x=x, y=y, z=z, path=np.interp(at, rows, blank.path[since : end + 1]))
    return steps, at * track.cycle, first


def _cutter(tool: EndMill) -> Cutter:
    return Cutter(
        radius=tool.diameter / 2, lag=tan(tool.helix_angle) / (tool.diameter / 2),
        runout=tool.runout * 1e-3, runout_angle=float(np.deg2rad(tool.runout_angle)),
        tilt=tool.tilt * 1e-3, tilt_angle=float(np.deg2rad(tool.tilt_angle)),
    )  # fmt: skip


def _layers(blank: Swept, deeper: float) -> Layers:
    """The blank for a tool that cuts by ``deeper`` [mm] more at its top than is programmed."""
    slices = []
    for a, b in pairwise(blank.heights.tolist()):
        count = ceil((b - a) / SLICE - 1e-9)
        slices.append(a + (b - a) * np.arange(count + 1) / count)
    low, high = (np.concatenate([s[cut] for s in slices]) for cut in (np.s_[:-1], np.s_[1:]))
    high[-1] += deeper
    layer = np.repeat(np.arange(len(slices)), [s.size - 1 for s in slices])
    return Layers(*blank.blank[:4], blank.first, *blank.corner, blank.cell, layer, low, high)
