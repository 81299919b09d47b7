"""Where the axes of a simulated machine are commanded to be while it runs a part program."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from pipeline.shop.control import SHORTEST, Control, Operator
from pipeline.shop.control_path import Section
from pipeline.shop.drive_commands import REST, covered, smoothed
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.post import PartProgram, Step
from pipeline.shop.s_curve import Floats, Profile


@dataclass(frozen=True, kw_only=True)
class Rapid:
    """A rapid that begins at ``start`` [s]: places [mm] and the profiles of the axes that move."""

    start: float
    begin: tuple[float, ...]
    end: tuple[float, ...]
    axes: tuple[Profile, ...]

    def at(self, time: Floats) -> Floats:
        """Place (T, 3) [mm] at times since its start."""
        place = np.tile(np.array(self.begin), (time.size, 1))
        profiles = iter(self.axes)
        for k, (a, b) in enumerate(zip(self.begin, self.end, strict=True)):
            if abs(b - a) > SHORTEST:
                place[:, k] += np.sign(b - a) * covered(next(profiles), time)
        return place


@dataclass(frozen=True, kw_only=True)
class Cut:
    """A cut that begins at ``start`` [s]: its places (N + 1, 3) [mm], steps and plan."""

    start: float
    points: Floats
    steps: tuple[Step, ...]
    section: Section
    shift: Floats  # from the program's frame to the machine's, (3,)

    def at(self, time: Floats) -> Floats:
        """Place (T, 3) [mm] at times since its start."""
        way, ends = covered(self.section.motion, time), self.section.ends
        block = np.minimum(np.searchsorted(ends, way), len(ends) - 1)
        begins = np.concatenate([[0.0], ends[:-1]])
        share = np.clip((way - begins[block]) / (ends - begins)[block], 0, 1)
        a, b = self.points[block], self.points[block + 1]
        place = a + (b - a) * share[:, None]
        turn = np.array([s.turn for s in self.steps])[block]
        arc = turn != 0
        centre = np.array([s.centre for s in self.steps])[block]
        r = a[:, :2] - centre
        c, s = np.cos(turn * share), np.sin(turn * share)
        turned = centre + np.stack([c * r[:, 0] - s * r[:, 1], s * r[:, 0] + c * r[:, 1]], axis=1)
        place[arc, :2] = turned[arc]
        shifted: Floats = place + self.shift
        return shifted


@dataclass(kw_only=True)
class FollowedControl(Control):
    """A control that also remembers where each of its ways leads."""

    ways: list[Rapid | Cut] = field(default_factory=list)

    def _rapid(self, target: list[float]) -> None:
        begin, known = tuple(self.place), len(self.spans)
        super()._rapid(target)
        self.ways += [
            Rapid(start=s.start, begin=begin, end=tuple(target), axes=s.axes)
            for s in self.spans[known:]
            if s.kind == "rapid"
        ]

    def _cut(self, before: Sequence[float], steps: Sequence[Step]) -> None:
        shift = np.array(self.place) - np.array(before)
        known = len(self.spans)
        super()._cut(before, steps)
        points = np.array([before, *(s.end for s in steps)])
        self.ways += [
            Cut(start=s.start, points=points, steps=tuple(steps), section=s.section, shift=shift)
            for s in self.spans[known:]
            if s.section is not None
        ]


def commanded(
    program: PartProgram, parameters: ShopParameters, frequency: int, place: Sequence[float]
) -> Floats:
    """Commanded X Y Z in the machine's frame [mm], shape (T, 3), from ``place`` to the end."""
    control = FollowedControl(
        parameters=parameters.control, motor=parameters.spindle.motor,
        lengths={t.number: t.length for t in program.tools}, operator=Operator(),
        random=parameters.generator("servo program"), place=list(place),
        tool=program.tools[-1].number,
    )  # fmt: skip
    plan = control.run(program)
    time: Floats = np.arange(int((plan.duration + 2 * REST) * frequency)) / frequency - REST
    way: Floats = np.tile(np.array(place), (time.size, 1))
    starts = np.searchsorted(time, [w.start for w in control.ways]).tolist()
    for (first, last), one in zip(pairwise([*starts, time.size]), control.ways, strict=True):
        if first < last:
            way[first:last] = one.at(time[first:last] - one.start)
    return np.stack([smoothed(way[:, k], frequency) for k in range(3)], axis=1)
