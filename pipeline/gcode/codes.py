"""Which function carries out which code, and those that only set the modal state."""

from collections.abc import Callable

from pipeline.gcode.arcs import arc
from pipeline.gcode.block import AXES, Block
from pipeline.gcode.cycles import drill
from pipeline.gcode.data_input import data_input
from pipeline.gcode.flow_codes import macro_call, modal_macro
from pipeline.gcode.length import cutter_side, radius_word, tool_length, tool_length_word
from pipeline.gcode.m_codes import m_code, tool_word
from pipeline.gcode.modal import GROUP_OF, GROUPS, g_code
from pipeline.gcode.motion import straight
from pipeline.gcode.moves import INCH, FeedMode, Kind, PathMode
from pipeline.gcode.offset_codes import (
    local_system,
    machine_move,
    position_set,
    reference_return,
    select_system,
)
from pipeline.gcode.run import Run
from pipeline.gcode.spindle import spindle_mode, spindle_word
from pipeline.gcode.state import CANCELLED, FANUC, LINUXCNC
from pipeline.gcode.statements import WordItem
from pipeline.gcode.threads import tap_rigidly, thread, thread_cycle
from pipeline.gcode.transforms import mirror, polar, rotation, scaling

Handler = Callable[[Run, Block, int, WordItem], None]

DWELLS = {"fanuc": ("P", "X", "U"), "linuxcnc": ("P",), "siemens": ("P",)}
"""Words that say how long G4 waits."""
FEED_MODES = {930: FeedMode.INVERSE_TIME, 940: FeedMode.PER_MINUTE, 950: FeedMode.PER_REVOLUTION}


def _plane(run: Run, block: Block, code: int, item: WordItem) -> None:
    if run.contour is not None and run.state.plane != code // 10:
        raise block.error(item, "the plane cannot change while G41 or G42 is in force: G40 first")
    run.state.plane = code // 10


def _units(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.state.unit = INCH if code in (200, 700) else 1.0


def _distance(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.state.absolute = int(code == 900)


def _arc_distance(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.state.arc_absolute = int(code == 901)


def _feed_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    mode = FEED_MODES[code]
    if mode != run.state.feed_mode:
        run.state.feed_mode = mode
        # LinuxCNC forgets F when its meaning changes, and so must everyone who reads it
        run.state.feed = 0.0


def _retract(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.retract_to_r = code == 990


def _path_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.state.path_mode = PathMode.EXACT_STOP if code in (610, 611) else PathMode.CONTINUOUS
    run.state.tolerance = 0.0
    if code == 640:
        run.state.tolerance = (block.take("P") or 0.0) * run.state.unit
        if run.state.dialect == LINUXCNC:
            block.take("Q")  # how far the planner may join collinear moves: no motion


def _g8(run: Run, block: Block, code: int, item: WordItem) -> None:
    """LinuxCNC: radius or diameter programming; Fanuc: look-ahead on and off, no motion."""
    if run.state.dialect == FANUC:
        block.need("P", "G8", item)
        return
    run.diameter = code == 70
    run.remap()


def _look_ahead(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G5 P…, G5.1 Q…: how the control computes, not where it goes."""
    letter = "P" if code == 50 else "Q"
    block.need(letter, g_code(code), item)
    block.take("R")


def _feed_word(run: Run, block: Block, item: WordItem) -> None:
    value = block.take("F")
    if value is None:
        return
    if value < 0:
        raise block.error(item, f"F is {value:g}: give 0 or more")
    block.feed_given = True
    inverse = run.state.feed_mode == FeedMode.INVERSE_TIME
    run.state.feed = value if inverse else value * run.state.unit


def _modifier(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G9, G31 and G53 say how the block's motion is done."""
    block.modifiers.add(code)


def _dwell(run: Run, block: Block, code: int, item: WordItem) -> None:
    letters = DWELLS[run.dialect]
    given = [letter for letter in letters if letter in block.words]
    if not given:
        raise block.error(item, f"{item.text} does not say how long: add {letters[0]}")
    value = block.words.pop(given[0])
    if given[0] == "P" and run.state.dialect == FANUC:
        value = seconds(block, value)
    if value < 0:
        raise block.error(item, f"a dwell of {value:g} s is not possible: give 0 or more")
    run.stand(Kind.DWELL, block.line, value=value)


def seconds(block: Block, value: float) -> float:
    """P of a Fanuc: milliseconds, unless it is written with a decimal point."""
    item = block.items.get("P")
    return value if item is not None and "." in item.text else value / 1000


def _motion_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    if code != run.cycle.code:
        run.cycle.code = CANCELLED if GROUP_OF[code] == "motion" or code == 800 else run.cycle.code
    if run.state.dialect != FANUC:
        run.state.motion = CANCELLED if code == 800 else code
        return
    if code == 800:
        run.state.motion = run.group_1
        run.rigid = False
        return
    if GROUP_OF[code] == "motion" and code in (0, 10, 20, 30, 330):
        run.group_1 = code
    run.state.motion = code


def motion(run: Run, block: Block) -> None:
    """What the axis words do under the motion in force."""
    code = run.state.motion
    words = block.words
    item = next((i for _, kind, c, i in block.actions if kind == "G" and c == code), None)
    if 530 in block.modifiers:
        machine_move(run, block, code, item)
    elif 310 in block.modifiers:
        straight(run, block, 310, item)
    elif words and not _MOVING.isdisjoint(words):
        if code == CANCELLED:
            return
        if code == 760 and run.state.dialect == LINUXCNC:
            thread_cycle(run, block, code, item)
        else:
            _MOTIONS.get(code, drill)(run, block, code, item)
    elif run.pending_length:
        straight(run, block, 0 if code not in (0, 10) else code, item)
    elif item is not None and run.state.dialect == LINUXCNC and code not in (0, 10, CANCELLED):
        raise block.error(item, f"{g_code(code)} has no axis words: add them")
    if 90 in block.modifiers and run.rows.count:
        run.exact_stop()


_MOVING = frozenset(AXES) | frozenset("RIJK@^")
_MOTIONS: dict[int, Callable[[Run, Block, int, WordItem | None], None]] = {
    0: straight, 10: straight, 20: arc, 30: arc, 310: straight, 382: straight, 383: straight,
    384: straight, 385: straight, 330: thread, 331: tap_rigidly,
}  # fmt: skip
HANDLERS: dict[int, Handler] = {
    **dict.fromkeys((200, 210, 700, 710), _units),
    **dict.fromkeys(FEED_MODES, _feed_mode),
    **dict.fromkeys((960, 970), spindle_mode),
    **dict.fromkeys((170, 180, 190), _plane),
    **dict.fromkeys((70, 80), _g8),
    **dict.fromkeys((50, 51), _look_ahead),
    **dict.fromkeys((90, 530, 310), _modifier),
    **dict.fromkeys((900, 910), _distance),
    **dict.fromkeys((901, 911), _arc_distance),
    **dict.fromkeys((980, 990), _retract),
    **dict.fromkeys((600, 610, 611, 620, 630, 640), _path_mode),
    **dict.fromkeys(GROUPS["compensation"].codes, cutter_side),
    **dict.fromkeys(GROUPS["length"].codes, tool_length),
    **dict.fromkeys(GROUPS["wcs"].codes, select_system),
    **dict.fromkeys((150, 160), polar),
    **dict.fromkeys((500, 510), scaling),
    **dict.fromkeys((501, 511), mirror),
    **dict.fromkeys((680, 690), rotation),
    **dict.fromkeys((660, 661, 670), modal_macro),
    **dict.fromkeys(GROUPS["cycle"].codes + GROUPS["motion"].codes, _motion_mode),
    **dict.fromkeys((270, 280, 281, 300, 301), reference_return),
    **dict.fromkeys((920, 921, 922, 923), position_set),
    40: _dwell,
    100: data_input,
    110: lambda run, block, code, item: None,
    520: local_system,
    650: macro_call,
}
"""Ten times the G code -> what carries it out."""
WORDS: dict[str, Callable[[Run, Block, WordItem], None]] = {
    "F": _feed_word,
    "S": spindle_word,
    "T": tool_word,
    "D": radius_word,
    "H": tool_length_word,
}
"""Word with a meaning of its own -> what carries it out."""

__all__ = ["m_code", "motion"]
