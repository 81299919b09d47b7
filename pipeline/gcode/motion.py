"""G0, G1, G31, G38: from a block's axis words to a straight row."""

import math

from pipeline.gcode.block import AXES, Block
from pipeline.gcode.geometry import distance
from pipeline.gcode.modal import g_code
from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.run import Run
from pipeline.gcode.state import LINUXCNC
from pipeline.gcode.statements import WordItem


def target(run: Run, block: Block) -> list[float]:
    """Machine position that the axis words name [mm, deg]."""
    state, words = run.state, block.words
    if state.transformed or "@" in words or "^" in words:
        return run.mapping.machine(programmed(run, block))
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
            end[axis] = value + (state.translation if state.absolute else end)[axis]
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
            if axis == 0 and run.diameter:
                value /= 2
        point[axis] = value if state.absolute else point[axis] + value
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


def straight(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G0, G1, G31 and G38: one row."""
    rotary_only = AXES.keys().isdisjoint("XYZ") or block.words.keys().isdisjoint("XYZ@^")
    check_feed(run, block, code, item)
    end = target(run, block)
    kind = Kind.RAPID if code == 0 else Kind.FEED if code == 10 else Kind.PROBE
    state = run.state
    run.probed = run.probed or kind == Kind.PROBE
    if rotary_only and state.unit != 1.0 and state.feed_mode == FeedMode.PER_MINUTE:
        # F is degree/minute here and knows no inch
        linear, state.feed = state.feed, state.feed / state.unit
        run.go(kind, block.line, end)
        state.feed = linear
    else:
        run.go(kind, block.line, end)


def check_feed(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """A feed needs F, of its own block under G93, and a turning spindle under G95."""
    state = run.state
    if code == 0:
        return
    if state.feed_mode == FeedMode.INVERSE_TIME and not block.feed_given and code != 310:
        raise block.error(
            item or block.any_item(), "G93 is in force and the block has no F: add one"
        )
    if state.feed_mode == FeedMode.PER_REVOLUTION and not (state.direction and state.speed):
        raise block.error(
            item or block.any_item(),
            "G95 is in force and the spindle stands: start it with M3 S before",
        )
    if state.feed <= 0:
        raise block.error(
            item or block.any_item(),
            f"{g_code(code)} has no feed (F is {state.feed:g}): give F above 0",
        )
