"""Chatter in a trial cut: a tool that gives way, tooth by tooth (numba).

The tool's tip stands off by the sum of its modes, each of which vibrates freely between two steps
and is pushed by the force of the step.  Tooth paths are those of the tip where it was: a tooth
meets the surface that the teeth of the turn before it have left, with their vibration in it, so
that regeneration, teeth that miss the material and chips that they leave to the next are all there.

In a stretch of each line the tool begins at rest and its force comes in little by little.  In a
stable cut each tooth soon vibrates as the tooth before it, with the force that the cut has; where
it chatters no tooth does as the one before.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, pi
from typing import Annotated, Literal, NamedTuple

import numpy as np

from pipeline.kernels import compiled_with
from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Range, Ranged
from pipeline.shop.cutting.force import EdgeCoefficients, edge_coefficients, edge_force, wear
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.cutting import (
    STEPS,
    STILL,
    Chance,
    Cutter,
    Layers,
    Steps,
    _chip,
    _cutter,
    _edges,
    _in_material,
    _layers,
    _pieces,
    _spindle_angle,
    _turning,
)
from pipeline.shop.trial.motion import Swept, Track

PER_WAVE = 24
"""Least number of steps in a wave of the highest mode."""
LONG, SHORT = 40.0, 12.0
"""Time of a stretch over the time constant of the least damped mode: as is taken, the least."""
OF_LINE = 3
"""Greatest number of stretches of a line."""
END = 8
"""Part of a stretch at its end that says whether the vibration repeats: one in so many."""


ENTERS = 0.4
"""Part of a stretch in which the force comes in."""
RIGID = 1e6
"""Stiffness over its own of a tip that counts as rigid: what it shows is the cut's own change."""
STEADY = 0.02
"""Greatest change from tooth to tooth with a rigid tip in a cut that counts as steady [1]."""


@dataclass(frozen=True, kw_only=True)
class TipMode(Ranged, section="TipMode"):
    """A mode of a tool's tip along an axis of the mill."""

    direction: Literal["x", "y"]
    frequency: Annotated[float, Range(above=0, unit="Hz")]
    damping: Annotated[float, Range(above=0, below=1)]
    stiffness: Annotated[float, Range(above=0, unit="N/m")]


class Tip(NamedTuple):
    """Modes: angular frequency [rad/s], damping ratio, stiffness [N/m], axis; (M,) each."""

    omega: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    axis: np.ndarray


@compiled_with(nogil=True)
def displacement(
    edge: EdgeCoefficients, cutter: Cutter, sharpness: np.ndarray, layers: Layers, steps: Steps,
    time: np.ndarray, turn: int, begin: int, tip: Tip,
) -> np.ndarray:  # fmt: skip
    """The tip's displacement along X and Y in each step from ``begin`` on [m]; (N - begin, 2).

    Parameters
    ----------
    edge, cutter, sharpness, layers, steps, turn, begin
        As of :func:`pipeline.shop.trial.cutting.forces`; before ``begin`` the tool is at rest.
    time : (N,) array
        Of the steps [s].
    tip : Tip
        Modes.
    """
    flutes, slices, modes = sharpness.size, layers.layer.size, tip.omega.size
    radii, ahead, behind = np.zeros((flutes, slices)), np.zeros(slices), np.zeros(slices)
    height = np.zeros(slices)
    x, y = steps.x.copy(), steps.y.copy()
    moved = Steps(steps.angle, x, y, steps.z, steps.path)
    q, p = np.zeros(modes), np.zeros(modes)  # displacement, its rate over omega
    out = np.zeros((steps.angle.size - begin, 2))
    level, lowest = np.inf, 0
    for k in range(begin, steps.angle.size):
        for j in range(modes):
            out[k - begin, tip.axis[j]] += q[j]
        x[k] += out[k - begin, 0] * 1e3
        y[k] += out[k - begin, 1] * 1e3
        if abs(steps.z[k] - level) > STILL:
            level = steps.z[k]
            lowest = _edges(cutter, layers, level, radii, ahead, behind, height)
        push_x, push_y = 0.0, 0.0
        for tooth in range(flutes):
            at = steps.angle[k] - 2 * np.pi * tooth / flutes
            a, b = np.sin(at), np.cos(at)
            for s in range(lowest, slices):
                sine, cosine = a * ahead[s] - b * behind[s], b * ahead[s] + a * behind[s]
                h = _chip(radii, tooth, s, sine, cosine, moved, k, turn)
                if h <= 0.0 or not _in_material(layers, s, radii[tooth, s], sine, cosine, moved, k,
                                          turn, cutter.radius):  # fmt: skip
                    continue
                t, r, _ = edge_force(edge, h * 1e-3, sharpness[tooth])
                push_x -= (t * cosine + r * sine) * height[s] * 1e-3
                push_y += (t * sine - r * cosine) * height[s] * 1e-3
        # the cut comes in little by little, as where a tool enters its material
        enters = min((k - begin + 1) / (ENTERS * (steps.angle.size - begin)), 1.0)
        step = time[min(k + 1, time.size - 1)] - time[k]
        for j in range(modes):
            rest = enters * (push_x if tip.axis[j] == 0 else push_y) / tip.stiffness[j]
            share = np.sqrt(1 - tip.damping[j] ** 2)
            decay = np.exp(-tip.damping[j] * tip.omega[j] * step)
            c = np.cos(share * tip.omega[j] * step) * decay
            s1 = np.sin(share * tip.omega[j] * step) * decay / share
            off, fast = q[j] - rest, p[j]
            q[j] = rest + (c + tip.damping[j] * s1) * off + s1 * fast
            p[j] = (c - tip.damping[j] * s1) * fast - s1 * off
    return out


def unrepeated(
    track: Track, blank: Swept, part: Chance, parameters: ShopParameters,
    tips: Mapping[int, Sequence[TipMode]], random: np.random.Generator,
) -> dict[int, float]:  # fmt: skip
    """Share of the vibration in each line that differs from tooth to tooth [1]: chatter.

    The difference of a tooth period's displacement to that of the tooth before, over the
    displacement less its mean, root mean squares: near 0 in a stable cut of a tool without runout,
    about 1 in chatter.  The greatest of the stretches of a line; stretches in which the cut itself
    changes (the tool enters, or leaves) and those below ``SHORT`` time constants are left out.

    Parameters
    ----------
    track, blank
        Motion and swept part of the blank.
    part : Chance
        Batch and mounting.
    parameters : ShopParameters
        The machine.
    tips : mapping of int to sequence of TipMode
        Of each tool that cuts.
    random : Generator
        Of the spindle's wander.
    """
    turned = _spindle_angle(track, part, parameters, random)
    shares: dict[int, float] = {}
    for begin, end in _stretches(track, blank, tips):
        line = int(track.line[begin])
        share = _share(track, blank, turned, part, tips=tips, stretch=(begin, end))
        if share is not None:
            shares[line] = max(shares.get(line, 0.0), share)
    return shares


def _stretches(
    track: Track, blank: Swept, tips: Mapping[int, Sequence[TipMode]]
) -> Iterator[tuple[int, int]]:
    """First and last cycles of the stretches, each within one line and one cut."""
    for begin, end in _pieces(track, blank):
        change = np.flatnonzero(np.diff(track.line[begin:end])) + begin + 1
        for first, last in zip([begin, *change], [*change, end], strict=True):
            modes = tips[int(track.tool[first])]
            constant = 1 / min(2 * pi * mode.frequency * mode.damping for mode in modes)
            there = last - first
            if not track.speed[first] > 0 or there * track.cycle < SHORT * constant:
                continue
            many = min(ceil(LONG * constant / track.cycle), there)
            for at in np.unique(np.linspace(first, last - many, OF_LINE).astype(int)).tolist():
                yield at, at + many


def _share(
    track: Track, blank: Swept, turned: Floats, part: Chance, *,
    tips: Mapping[int, Sequence[TipMode]], stretch: tuple[int, int],
) -> float | None:  # fmt: skip
    """What does not repeat at the end of a stretch [1]; None where the cut itself changes there."""
    begin, end = stretch
    number = int(track.tool[begin])
    tool, modes = part.tools[number], tips[number]
    highest = max(mode.frequency for mode in modes)
    turns = max(STEPS, PER_WAVE * highest * 60 / float(track.speed[begin]))
    period = ceil(turns / tool.flutes)
    steps, time, first = _turning(track, blank, turned, period * tool.flutes, begin, end)
    if steps is None:
        return None
    tip = Tip(
        omega=np.array([2 * pi * mode.frequency for mode in modes]),
        damping=np.array([mode.damping for mode in modes]),
        stiffness=np.array([mode.stiffness for mode in modes]),
        axis=np.array(["xy".index(mode.direction) for mode in modes]),
    )
    stiff = tip._replace(stiffness=tip.stiffness * RIGID)
    own, rigid = (
        _late(
            displacement(
                edge_coefficients(part.workpiece, wear(tool, part.used[number])), _cutter(tool),
                np.array(tool.sharpness), _layers(blank, part.deeper[number]), steps, time,
                period * tool.flutes, first, one,
            ),
            period,
        )
        for one in (tip, stiff)
    )  # fmt: skip
    return own if rigid is not None and rigid < STEADY else None


def _late(u: Floats, period: int) -> float | None:
    """What does not repeat at the end of displacements (N, 2), tooth by tooth [1]; None of none."""
    late = max(len(u) // END, 2 * period)
    if len(u) < late + period:
        return None
    end_of, before = u[-late:], u[-late - period : -period]
    size = float(np.sqrt(np.sum((end_of - end_of.mean(axis=0)) ** 2)))
    return float(np.sqrt(np.sum((end_of - before) ** 2))) / size if size > 0 else None
