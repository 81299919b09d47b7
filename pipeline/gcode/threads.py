"""Threads: G33, LinuxCNC's G33.1 (rigid tapping) and G76 (threading cycle)."""

import math

from pipeline.gcode.block import Block
from pipeline.gcode.motion import target
from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.run import Run
from pipeline.gcode.state import LINUXCNC
from pipeline.gcode.statements import WordItem


def thread(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G33: a feed by K (LinuxCNC) or F (Fanuc) for each turn of the spindle."""
    _need_spindle(run, block, item)
    _synchronised(run, block, target(run, block), _lead(run, block, item))


def tap_rigidly(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G33.1: to the end, turn back, and out to where it began."""
    _need_spindle(run, block, item)
    lead = _lead(run, block, item)
    begin, end = run.state.position.copy(), target(run, block)
    _synchronised(run, block, end, lead)
    for way in (begin, None):
        run.state.direction = -run.state.direction
        run.stand(Kind.SPINDLE, block.line)
        if way is not None:
            _synchronised(run, block, way, lead)


def _lead(run: Run, block: Block, item: WordItem | None) -> float:
    """Of the thread [mm/rev]."""
    if run.state.dialect != LINUXCNC and "K" not in block.words:
        lead = run.state.feed
    else:
        lead = block.need("K", "G33", item or _first(block)) * run.state.unit
    if lead <= 0:
        raise block.error(item, f"the thread's lead is {lead:g} mm: give K (or F) above 0")
    return lead


def _first(block: Block) -> WordItem:
    return block.ordered[0][0]


def _need_spindle(run: Run, block: Block, item: WordItem | None) -> None:
    if run.state.direction == 0:
        raise block.error(item, "a thread needs a turning spindle: write M3 or M4 before")


def _synchronised(run: Run, block: Block, end: list[float], lead: float) -> None:
    state = run.state
    mode, feed = state.feed_mode, state.feed
    state.feed_mode, state.feed = FeedMode.PER_REVOLUTION, lead
    run.go(Kind.THREAD, block.line, end)
    state.feed_mode, state.feed = mode, feed


def thread_cycle(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G76 of LinuxCNC: passes along Z (plane ZX) to the full depth of a thread.

    Each pass begins where the one before did, deeper by J / passes^R and set off by the compound
    slide's angle Q; E cuts tapers at the begin (L1), the end (L2) or both (L3), where the feed goes
    with the length of the slope.  Source: LinuxCNC 2.9, "G76 Threading Cycle".
    """
    _need_spindle(run, block, item)
    word = item or _first(block)
    state = run.state
    if state.transformed:
        raise block.error(word, "G76 cannot run rotated or scaled: post the passes as G33")
    unit = state.unit
    pitch = block.need("P", "G76", word) * unit
    peak = block.need("I", "G76", word) * unit
    first = block.need("J", "G76", word) * unit
    full = block.need("K", "G76", word) * unit
    degression = block.take("R") or 1.0
    angle = block.take("Q") or 0.0
    taper = (block.take("E") or 0.0) * unit
    ends = block.whole("L", block.take("L") or 0.0, 0, 3)
    springs = block.whole("H", block.take("H") or 0.0, 0, 1000)
    if pitch <= 0 or first <= 0 or full <= first or degression < 1:
        raise block.error(
            word, "G76 needs P > 0, K > J > 0 and R of 1 or more: correct these words"
        )
    start = state.position.copy()
    end = target(run, block)
    cut = _Passes(run, block, start, end[2], (pitch, peak, full, taper, ends, angle))
    depth, number = first, 1
    while depth < full:
        cut.one(depth)
        number += 1
        depth = first * number ** (1 / degression)
    for _ in range(springs + 1):
        cut.one(full)
    run.go(Kind.RAPID, block.line, [start[0], start[1], end[2], *start[3:]])


class _Passes:
    """The passes of one G76, along Z from ``start`` to ``z_end``."""

    def __init__(
        self,
        run: Run,
        block: Block,
        start: list[float],
        z_end: float,
        shape: tuple[float, float, float, float, int, float],
    ) -> None:
        self.run, self.block = run, block
        self.start, self.z_end = start, z_end
        self.pitch, self.peak, self.full, self.taper, self.ends, self.angle = shape
        self.sign = 1.0 if self.peak > 0 else -1.0

    def one(self, depth: float) -> None:
        """Down to ``depth`` under the peak."""
        run, line, pitch = self.run, self.block.line, self.pitch
        back = 1.0 if self.z_end > self.start[2] else -1.0
        tangent, slope = back * math.tan(math.radians(self.angle)), self.taper * back
        x = self.start[0] - self.sign * (self.full - depth)
        z, z_end = self.start[2] + depth * tangent, self.z_end - (self.full - depth) * tangent
        surface = x + self.peak
        bottom = surface + self.sign * self.full
        steep = pitch * math.hypot(self.taper, self.full) / self.taper if self.taper else pitch
        run.go(Kind.RAPID, line, self._at(x, z))
        begin, finish = self.ends & 1, self.ends & 2
        if begin and self.taper:
            self._cut(surface, z, pitch)
            self._cut(bottom, z + slope, steep)
        else:
            run.go(Kind.RAPID, line, self._at(bottom, z))
        if finish and self.taper:
            self._cut(bottom, z_end - slope, pitch)
            self._cut(surface, z_end, steep)
        else:
            self._cut(bottom, z_end, pitch)
        run.go(Kind.RAPID, line, self._at(x, z_end))

    def _at(self, x: float, z: float) -> list[float]:
        return [x, self.start[1], z, *self.start[3:]]

    def _cut(self, x: float, z: float, lead: float) -> None:
        _synchronised(self.run, self.block, self._at(x, z), lead)
