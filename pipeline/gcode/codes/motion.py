"""Motion codes G0 to G3, G31, G33, G33.1, G38 and LinuxCNC's threading cycle G76."""

import math
from dataclasses import dataclass

from pipeline.gcode.geometry import (
    LINUXCNC_INCH_TOLERANCE,
    LINUXCNC_R_TOLERANCE,
    LINUXCNC_TOLERANCE,
    NO_CHORD,
    NO_RADIUS,
    OK,
    RELATIVE_RADIUS,
    TOO_FAR,
    centre_of_radius,
    distance,
    radii_agree,
    sweep,
)
from pipeline.gcode.modal import FANUC, LINUXCNC, g_code
from pipeline.gcode.moves import IN_PLANE, FeedMode, Kind
from pipeline.gcode.run import AXES, Block, Run
from pipeline.gcode.statements import WordItem


def target(run: Run, block: Block) -> list[float]:
    """Machine position that the axis words name [mm, deg]."""
    state, words = run.state, block.words
    if state.transformed or "@" in words or "^" in words:
        return run.transform.machine(programmed(run, block))
    end = state.position.copy()
    if run.pending_length:
        end[2] += run.pending_length
        run.pending_length = 0.0
    unit = state.unit
    for letter, axis in AXES.items():
        value = words.pop(letter, None)
        if value is not None:
            if axis < 3:
                value *= unit
            absolute = block.is_absolute(letter, state.absolute)
            end[axis] = value + (state.translation if absolute else end)[axis]
    return end


def programmed(run: Run, block: Block) -> list[float]:
    """Program's coordinates that the axis words name [mm, deg]."""
    state, point = run.state, run.point
    point[2] += run.pending_length
    run.pending_length = 0.0
    if run.offsets.polar or "@" in block.words or "^" in block.words:
        _polar(run, block, point)
    for letter, axis in AXES.items():
        value = block.words.pop(letter, None)
        if value is None:
            continue
        if axis < 3:
            value *= state.unit
        absolute = block.is_absolute(letter, state.absolute)
        point[axis] = value if absolute else point[axis] + value
    return point


def _polar(run: Run, block: Block, point: list[float]) -> None:
    """Radius and angle to coordinates of the plane (G16, or LinuxCNC's @ and ^)."""
    first, second, _ = IN_PLANE[run.state.plane]
    letters = "XYZ"
    names = ("@", "^") if run.state.dialect == LINUXCNC else (letters[first], letters[second])
    if run.state.dialect == LINUXCNC and not {letters[first], letters[second]}.isdisjoint(
        block.words
    ):
        raise block.error(
            block.items.get("@") or block.items.get("^"),
            "polar and Cartesian words of one plane exclude each other: use one kind in a block",
        )
    radius, angle = block.take(names[0]), block.take(names[1])
    if radius is None and angle is None:
        return
    here_radius = distance(point[first], point[second])
    here_angle = math.degrees(math.atan2(point[second], point[first]))
    if run.offsets.polar and run.polar_angle is not None:
        here_angle = run.polar_angle
    absolute = bool(run.state.absolute)
    if radius is None:
        radius = here_radius
    else:
        radius = radius * run.state.unit + (0.0 if absolute else here_radius)
    angle = here_angle if angle is None else angle + (0.0 if absolute else here_angle)
    run.polar_angle = angle
    point[first] = radius * math.cos(math.radians(angle))
    point[second] = radius * math.sin(math.radians(angle))


def seconds(run: Run, block: Block, value: float) -> float:
    """P of a dwell [s]; a Fanuc counts milliseconds unless it is written with a decimal point."""
    written = "." in block.items["P"].text or run.state.dialect != FANUC
    return value if written else value / 1000


def straight(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """Straight motion of G0, G1, G31 and G38: one row."""
    run.straight_next = False
    rotary_only = AXES.keys().isdisjoint("XYZ") or block.words.keys().isdisjoint("XYZ@^")
    check_feed(run, block, code, item)
    end = target(run, block)
    kind = Kind.RAPID if code == 0 else Kind.FEED if code == 10 else Kind.PROBE
    state = run.state
    run.probed = run.probed or kind == Kind.PROBE
    unit = run.feed_unit if run.dialect == "siemens" else state.unit
    if rotary_only and unit != 1.0 and state.feed_mode == FeedMode.PER_MINUTE:
        # F is degree/minute here and does not depend on the unit of length
        linear, state.feed = state.feed, state.feed / unit
        run.line_to(kind, block.line, end)
        state.feed = linear
    else:
        run.line_to(kind, block.line, end)


TAPPING = (740, 840)
"""Cycles that start the spindle of a Fanuc themselves."""


def check_feed(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """A feed needs F, of its own block under G93, and a turning spindle under G95."""
    state, word = run.state, item or block.any_item()
    if code == 0:
        return
    if state.feed_mode == FeedMode.INVERSE_TIME and not block.feed_given and code != 310:
        raise block.error(word, "G93 is in force and the block has no F: add one")
    standing = not state.direction and not (code in TAPPING and state.dialect == FANUC)
    if state.feed_mode == FeedMode.PER_REVOLUTION and (standing or not state.speed):
        raise block.error(word, "G95 is in force and the spindle stands: start it with M3 S before")
    if state.feed <= 0:
        raise block.error(word, f"{g_code(code)} has no feed (F is {state.feed:g}): give F above 0")


CENTRE_WORDS = "IJK"


def arc(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G2 and G3: arc, helix, full circles or spiral."""
    if run.straight_next:
        raise block.error(
            item or block.any_item(),
            "no arc may come right after G40: go straight first",
        )
    check_feed(run, block, code, item)
    state = run.state
    turn = -1 if code == 20 else 1
    first, second, _ = IN_PLANE[state.plane]
    start = run.point if state.transformed else state.position.copy()
    centre = _centre_words(run, block, start)
    radius = block.take("R")
    turns = 1
    if state.dialect != FANUC and "P" in block.words:
        turns = block.whole("P", block.words.pop("P"), 1, 1_000_000)
    end = programmed(run, block) if state.transformed else target(run, block)
    word = item or block.any_item()
    if centre is not None and (radius is None or state.dialect == LINUXCNC):
        if radius is not None:
            raise block.error(word, "R and I J K exclude each other: keep one of them")
        _check_radii(run, block, word, start, end, centre)
    elif radius is not None:
        if centre is not None:
            run.note(block.line, f"{g_code(code)} goes by R and does not read I, J and K")
        if end == start and state.dialect == FANUC:
            run.note(block.line, f"{g_code(code)} R ends where it starts: 0 degree, no motion")
            return
        centre = _centre_of_r(run, block, word, (start, end, radius * state.unit, turn))
    else:
        raise block.error(word, "the arc has neither I J K nor R: add the centre or the radius")
    u_c, v_c = centre
    angle = sweep(start[first], start[second], end[first], end[second], u_c, v_c, turn, turns)
    middle = start.copy()
    middle[first], middle[second] = u_c, v_c
    if state.transformed:
        angle *= _handedness(run, block, word)
        middle, end = run.transform.machine(middle), run.transform.machine(end)
    run.arc_to(block.line, end, (middle[0], middle[1], middle[2]), angle)


def _centre_words(run: Run, block: Block, start: list[float]) -> tuple[float, float] | None:
    """Centre in the plane, where I, J or K says so [mm]."""
    state = run.state
    axes = IN_PLANE[state.plane][:2]
    given = [block.take(CENTRE_WORDS[axis]) for axis in axes]
    if given[0] is None and given[1] is None:
        return None
    centre = []
    for axis, value in zip(axes, given, strict=True):
        if state.arc_absolute:
            if value is None:
                letter = CENTRE_WORDS[axis]
                raise block.error(
                    block.any_item(), f"G90.1 is in force and {letter} is missing: add it"
                )
            shift = 0.0 if state.transformed else state.translation[axis]
            centre.append(value * state.unit + shift)
        else:
            centre.append(start[axis] + (value or 0.0) * state.unit)
    return centre[0], centre[1]


def _check_radii(
    run: Run, block: Block, word: WordItem | None, start: list[float], end: list[float],
    centre: tuple[float, float],
) -> None:  # fmt: skip
    first, second, _ = IN_PLANE[run.state.plane]
    u_c, v_c = centre
    tolerance, relative = run.setup.arc_tolerance, 0.0
    if run.state.dialect == LINUXCNC:
        inch = run.state.unit != 1.0
        tolerance = LINUXCNC_INCH_TOLERANCE if inch else LINUXCNC_TOLERANCE
        relative = RELATIVE_RADIUS
    verdict = radii_agree(
        start[first], start[second], end[first], end[second], u_c, v_c, tolerance, relative
    )
    if verdict == OK:
        return
    r_0 = distance(start[first] - u_c, start[second] - v_c)
    r_1 = distance(end[first] - u_c, end[second] - v_c)
    if verdict == NO_RADIUS:
        raise block.error(word, "the arc has radius 0: correct I, J, K or the end point")
    raise block.error(
        word,
        f"the arc starts {r_0:.6g} mm from its centre and ends {r_1:.6g} mm from it, more than "
        f"{tolerance:g} mm apart: correct the end point or I, J, K",
    )


def _centre_of_r(
    run: Run, block: Block, word: WordItem | None, arc: tuple[list[float], list[float], float, int]
) -> tuple[float, float]:
    start, end, radius, turn = arc
    first, second, _ = IN_PLANE[run.state.plane]
    tolerance = LINUXCNC_R_TOLERANCE
    if run.state.dialect == FANUC:
        tolerance = run.setup.arc_tolerance
    verdict, u_c, v_c = centre_of_radius(
        start[first], start[second], end[first], end[second], radius, turn, tolerance
    )
    if verdict == NO_CHORD:
        raise block.error(
            word, "an arc given by R starts and ends in one point: give I J K for a full circle"
        )
    if verdict == TOO_FAR:
        half = distance(end[first] - start[first], end[second] - start[second]) / 2
        raise block.error(
            word,
            f"R is {abs(radius):.6g} mm and half the chord {half:.6g} mm: R must not be shorter",
        )
    return u_c, v_c


def _handedness(run: Run, block: Block, word: WordItem | None) -> int:
    """-1 where the arc's plane is mirrored; an error where the arc is no arc any more."""
    matrix = run.transform.matrix
    if matrix is None:
        return 1
    first, second, normal = IN_PLANE[run.state.plane]
    tilt = max(abs(matrix[normal][i]) + abs(matrix[i][normal]) for i in (first, second))
    if tilt > 1e-12:
        raise block.error(word, "an arc would leave its plane by rotation: rotate about its axis")
    a, b = matrix[first][first], matrix[first][second]
    c, d = matrix[second][first], matrix[second][second]
    if abs(a * a + c * c - b * b - d * d) > 1e-9 or abs(a * b + c * d) > 1e-9:
        raise block.error(word, "an arc would become an ellipse by scaling: scale both axes alike")
    return 1 if a * d - b * c > 0 else -1


def thread(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G33: a feed by K (LinuxCNC) or F (Fanuc) for each turn of the spindle."""
    _need_spindle(run, block, item)
    _synchronised(run, block.line, target(run, block), _lead(run, block, item))


def tap_rigidly(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G33.1: to the end, turn back, and out to where it began."""
    _need_spindle(run, block, item)
    lead = _lead(run, block, item)
    begin, end = run.state.position.copy(), target(run, block)
    _synchronised(run, block.line, end, lead)
    run.state.direction = -run.state.direction
    run.add_row(Kind.SPINDLE, block.line)
    _synchronised(run, block.line, begin, lead)
    run.state.direction = -run.state.direction
    run.add_row(Kind.SPINDLE, block.line)


def _lead(run: Run, block: Block, item: WordItem | None) -> float:
    """Lead of the thread [mm/rev]."""
    if run.state.dialect != LINUXCNC and "K" not in block.words:
        lead = run.state.feed
    else:
        lead = block.need("K", "G33", item or block.any_item()) * run.state.unit
    if lead <= 0:
        raise block.error(item, f"the thread's lead is {lead:g} mm: give K (or F) above 0")
    return lead


def _need_spindle(run: Run, block: Block, item: WordItem | None) -> None:
    if run.state.direction == 0:
        raise block.error(item, "a thread needs a turning spindle: write M3 or M4 before")


def _synchronised(run: Run, line: int, end: list[float], lead: float) -> None:
    state = run.state
    mode, feed = state.feed_mode, state.feed
    state.feed_mode, state.feed = FeedMode.PER_REVOLUTION, lead
    run.line_to(Kind.THREAD, line, end)
    state.feed_mode, state.feed = mode, feed


def thread_cycle(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G76 of LinuxCNC: passes along Z (plane ZX) to the full depth of a thread.

    Each pass is deeper by J / passes^R and set off by the compound slide's angle Q; E cuts tapers
    at the begin (L1), the end (L2) or both (L3), where the feed goes with the length of the slope.
    Source: LinuxCNC 2.9, "G76 Threading Cycle".
    """
    _need_spindle(run, block, item)
    word = item or block.any_item()
    state = run.state
    if state.transformed:
        raise block.error(word, "G76 cannot run rotated or scaled: post the passes as G33")
    rotary = next((letter for letter in "ABC" if letter in block.words), None)
    if rotary is not None:
        raise block.error(
            block.items[rotary], f"LinuxCNC turns no {rotary} in G76: turn it in a block before"
        )
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
    thread = _Thread(
        run=run, line=block.line, start=start, z_end=end[2], pitch=pitch, peak=peak, full=full,
        taper=taper, angle=angle, tapers_begin=bool(ends & 1), tapers_end=bool(ends & 2),
    )  # fmt: skip
    depth, number = first, 1
    while depth < full:
        thread.cut_to(depth)
        number += 1
        depth = first * number ** (1 / degression)
    for _ in range(springs + 1):
        thread.cut_to(full)
    run.line_to(Kind.RAPID, block.line, end)


@dataclass(frozen=True, kw_only=True)
class _Thread:
    """The thread of one G76, along Z from ``start`` to ``z_end``; lengths in mm."""

    run: Run
    line: int
    start: list[float]
    z_end: float
    pitch: float
    peak: float
    full: float
    taper: float
    angle: float
    tapers_begin: bool
    tapers_end: bool

    def cut_to(self, depth: float) -> None:
        run, line, pitch = self.run, self.line, self.pitch
        sign = 1.0 if self.peak > 0 else -1.0
        back = 1.0 if self.z_end > self.start[2] else -1.0
        tangent, slope = back * math.tan(math.radians(self.angle)), self.taper * back
        x = self.start[0] - sign * (self.full - depth)
        z, z_end = self.start[2] + depth * tangent, self.z_end - (self.full - depth) * tangent
        surface = x + self.peak
        bottom = surface + sign * self.full
        steep = pitch * math.hypot(self.taper, self.full) / self.taper if self.taper else pitch
        run.line_to(Kind.RAPID, line, self._at(x, z))
        if self.tapers_begin and self.taper:
            self._cut(surface, z, pitch)
            self._cut(bottom, z + slope, steep)
        else:
            run.line_to(Kind.RAPID, line, self._at(bottom, z))
        if self.tapers_end and self.taper:
            self._cut(bottom, z_end - slope, pitch)
            self._cut(surface, z_end, steep)
        else:
            self._cut(bottom, z_end, pitch)
        run.line_to(Kind.RAPID, line, self._at(x, z_end))

    def _at(self, x: float, z: float) -> list[float]:
        return [x, self.start[1], z, *self.start[3:]]

    def _cut(self, x: float, z: float, lead: float) -> None:
        _synchronised(self.run, self.line, self._at(x, z), lead)
