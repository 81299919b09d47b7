"""What each canned cycle does between R and the bottom of the hole."""

from collections.abc import Callable
from dataclasses import dataclass

from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.run import Run
from pipeline.gcode.state import FANUC, LINUXCNC

SHALLOW = 1e-9
"""What is left of a hole's depth and is none [mm]."""


@dataclass(slots=True, kw_only=True)
class Hole:
    """One hole, in program coordinates.

    Parameters
    ----------
    run : Run
        Takes the rows.
    line : int
        Of the block.
    point : list of 6 floats
        Where the tool is; its coordinate ``normal`` changes as it goes [mm, deg].
    normal : int
        Index of the axis it drills along.
    words : dict of str to float
        R, Z, Q, P, I, J, K of the cycle [mm, s].
    """

    run: Run
    line: int
    point: list[float]
    normal: int
    words: dict[str, float]

    @property
    def bottom(self) -> float:
        """Z of the cycle."""
        return self.words["Z"]

    @property
    def plane_r(self) -> float:
        """R of the cycle."""
        return self.words["R"]

    def rapid(self, level: float) -> None:
        """To a level, fast; no row where nothing moves."""
        self._to(Kind.RAPID, level)

    def feed(self, level: float) -> None:
        """To a level, cutting."""
        self._to(Kind.FEED, level)

    def _to(self, kind: Kind, level: float) -> None:
        self.point[self.normal] = level
        end = self.run.mapping.machine(self.point)
        if end != self.run.state.position:
            self.run.go(kind, self.line, end)

    def dwell(self) -> None:
        """P at the bottom."""
        seconds = self.words.get("P", 0.0)
        if seconds > 0:
            self.run.stand(Kind.DWELL, self.line, value=seconds)

    def spindle(self, direction: int) -> None:
        """Turn the spindle, or stop it with 0."""
        self.run.state.direction = direction
        self.run.stand(Kind.SPINDLE, self.line)

    def shift(self, sign: int) -> None:
        """Sideways, away from the cutting edge's side or back."""
        for axis, amount in _shift(self).items():
            self.point[axis] += sign * amount
        self.rapid(self.point[self.normal])


def _shift(hole: Hole) -> dict[int, float]:
    """By axis [mm]: I J K where they are given, else Q as the control is set."""
    run = hole.run
    given = {axis: hole.words.get(letter, 0.0) for axis, letter in enumerate("IJK")}
    if any(given[axis] for axis in given if axis != hole.normal):
        return {axis: value for axis, value in given.items() if axis != hole.normal}
    shift = run.setup.boring_shift
    sign = 1 if shift[0] == "+" else -1
    return {"XYZ".index(shift[1]): sign * hole.words.get("Q", 0.0)}


def _drilled(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.rapid(level)


def _dwelt(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.rapid(level)


def _chip_broken(hole: Hole, level: float) -> None:
    """G73: Q deeper, a little back."""
    gap = hole.run.setup.peck_clearance
    for depth in _pecks(hole):
        hole.feed(depth)
        if depth > hole.bottom:
            hole.rapid(depth + gap)
    hole.dwell()
    hole.rapid(level)


def _pecked(hole: Hole, level: float) -> None:
    """G83: Q deeper, out to R, back to just above."""
    gap = hole.run.setup.peck_clearance
    for depth in _pecks(hole):
        hole.feed(depth)
        if depth > hole.bottom:
            hole.rapid(hole.plane_r)
            hole.rapid(depth + gap)
    hole.dwell()
    hole.rapid(level)


def _pecks(hole: Hole) -> list[float]:
    """Depths reached, the bottom last."""
    step = hole.words["Q"]
    count = int((hole.plane_r - hole.bottom) / step + 2)
    depths = [hole.plane_r - step * (i + 1) for i in range(count)]
    return [depth for depth in depths if depth > hole.bottom + SHALLOW] + [hole.bottom]


def _tapped(direction: int) -> Callable[[Hole, float], None]:
    def tap(hole: Hole, level: float) -> None:
        state = hole.run.state
        mode, feed = state.feed_mode, state.feed
        kind = Kind.FEED
        if hole.run.rigid and state.speed > 0:
            kind = Kind.THREAD
            if mode != FeedMode.PER_REVOLUTION:
                state.feed_mode, state.feed = FeedMode.PER_REVOLUTION, feed / state.speed
        if state.direction != direction:
            hole.spindle(direction)
        hole._to(kind, hole.bottom)
        if state.dialect == FANUC:
            hole.dwell()
        hole.spindle(-direction)
        if state.dialect == LINUXCNC:
            hole.dwell()
        hole._to(kind, level if state.dialect == LINUXCNC else hole.plane_r)
        hole.spindle(direction)
        state.feed_mode, state.feed = mode, feed
        hole.rapid(level)

    return tap


def _fine_bored(hole: Hole, level: float) -> None:
    """G76: orient at the bottom, leave the wall, come out without a mark."""
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    hole.dwell()
    hole.spindle(0)
    hole.shift(1)
    hole.rapid(level)
    hole.shift(-1)
    hole.spindle(direction)


def _bored(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.feed(hole.plane_r)
    hole.rapid(level)


def _bored_stopped(hole: Hole, level: float) -> None:
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    if hole.run.state.dialect == LINUXCNC:
        hole.dwell()
    hole.spindle(0)
    hole.rapid(level)
    hole.spindle(direction)


def _back_bored(hole: Hole, level: float) -> None:
    """G87: through the hole beside its wall, then cut on the way up.

    A Fanuc goes down to R and cuts up to Z; LinuxCNC goes down to Z and cuts up to K.
    """
    direction = hole.run.state.direction
    linuxcnc = hole.run.state.dialect == LINUXCNC
    low, high = (hole.bottom, hole.words.get("K", 0.0)) if linuxcnc else (hole.plane_r, hole.bottom)
    if linuxcnc:
        hole.rapid(hole.plane_r)
        if not hole.run.state.absolute:
            high += low
    hole.spindle(0)
    hole.shift(1)
    hole.rapid(low)
    hole.shift(-1)
    hole.spindle(direction)
    hole.feed(high)
    hole.dwell()
    if linuxcnc:
        hole.feed(low)
    hole.spindle(0)
    hole.shift(1)
    hole.rapid(level)
    hole.shift(-1)
    hole.spindle(direction)


def _bored_by_hand(hole: Hole, level: float) -> None:
    """G88: stop at the bottom and leave the way out to the operator."""
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    hole.dwell()
    hole.spindle(0)
    hole.run.stand(Kind.STOP, hole.line)
    if hole.run.state.dialect == FANUC:
        hole.rapid(level)
    hole.spindle(direction)


def _bored_dwelt(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.feed(level if hole.run.state.dialect == LINUXCNC else hole.plane_r)
    hole.rapid(level)


AT_BOTTOM: dict[int, Callable[[Hole, float], None]] = {
    730: _chip_broken,
    740: _tapped(-1),
    760: _fine_bored,
    810: _drilled,
    820: _dwelt,
    830: _pecked,
    840: _tapped(1),
    850: _bored,
    860: _bored_stopped,
    870: _back_bored,
    880: _bored_by_hand,
    890: _bored_dwelt,
}
"""Ten times the G code -> what it does, given the hole and the level to end at [mm]."""
