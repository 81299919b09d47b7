"""Execution of a block: its words evaluated, sorted into the control's order and carried out."""

from collections.abc import Callable
from operator import itemgetter

from pipeline.gcode.codes import motion, tools, work_offsets
from pipeline.gcode.codes.cycles import drill
from pipeline.gcode.modal import (
    CANCELLED,
    FANUC,
    GROUP_OF,
    GROUPS,
    LINUXCNC,
    M_GROUPS,
    M_STEPS,
    OTHER_M_STEP,
    WORD_STEPS,
    excludes,
    g_code,
    step_of,
)
from pipeline.gcode.moves import INCH, INCREMENT, FeedMode, Kind, PathMode
from pipeline.gcode.run import AXES, Block, Run, begin_corner, finish_corner
from pipeline.gcode.statements import (
    ExpressionError,
    Number,
    ParameterStore,
    Statement,
    WordItem,
    evaluate,
)

MACRO_CALLS = (650, 660, 661)
MOTION_STEP = 220
LENGTHS = frozenset((*"XYZABCIJKRQ", ",R", ",C"))
"""Words that a Fanuc reads in input increments where they have no decimal point."""
THOUSANDTHS = {40: "XU", 680: "R"}
"""G code -> words of seconds or degrees beside it, which count thousandths in inches too."""


def block_of(statement: Statement, run: Run, parameters: ParameterStore, file: str) -> Block:
    """The statement's words with their values."""
    block = Block(file, statement.line)
    block.comments = statement.comments
    words, items = block.words, block.items
    linuxcnc = run.state.dialect == LINUXCNC
    calls_macro = False
    for item in statement.words:
        expression = item.value
        if type(expression) is Number:
            value = expression.value
        else:
            result = _value(item, parameters, block)
            if result is None:
                continue  # a vacant variable: the word counts as not written
            value = result
        block.ordered.append((item, value))
        letter = item.letter
        if calls_macro:
            items[letter] = item
            continue  # an argument, whatever its letter
        if letter == "G":
            _g_word(block, run, item, value)
            calls_macro = block.actions[-1][2] in MACRO_CALLS
        elif letter == "M":
            _m_word(block, run, item, value)
        else:
            if letter in words and linuxcnc:
                raise block.error(item, f"{letter} stands twice in the block: keep one of them")
            words[letter] = value
            items[letter] = item
            step = WORD_STEPS.get(letter)
            if step is not None:
                block.actions.append((step, letter, 0, item))
    if linuxcnc and "X" in words and _in_diameter(block, run):
        words["X"] /= 2
    if run.setup.decimal == "increment" and run.state.dialect == FANUC:
        _scale_increments(block, run)
    return block


def _in_diameter(block: Block, run: Run) -> bool:
    """Whether X is a diameter (G7), whatever code of the block reads it."""
    own = [code for _, kind, code, _ in block.actions if kind == "G" and code in (70, 80)]
    return own[-1] == 70 if own else run.diameter


def carry_out(block: Block, run: Run) -> None:
    """Everything that the block says, in the dialect's order."""
    actions = block.actions
    if len(actions) > 1:
        actions.sort(key=itemgetter(0))
    if run.dialect == "fanuc" and "S" in block.words:
        _drop_speed_limit(block, run)
    if "$" in block.words:
        _spindle_number(block)
    if 19 in block.m_codes:
        for letter in "RPQ":  # where the spindle is oriented: no motion of an axis
            block.take(letter)
    moved = False
    for step, kind, code, item in actions:
        if step > MOTION_STEP and not moved:
            moved = True
            move(run, block)
        if kind == "G":
            HANDLERS[code](run, block, code, item)
        elif kind == "M":
            tools.m_code(run, block, code, item)
        else:
            WORDS[kind](run, block, item)
    if not moved:
        move(run, block)
    if block.words:
        _refuse_rest(block, run)


def _spindle_number(block: Block) -> None:
    """$ of LinuxCNC beside what a spindle does; a mill has spindle 0 (-1 is every one)."""
    codes = {code for _, kind, code, _ in block.actions if kind == "G"}
    if "S" in block.words or not SPINDLE_G.isdisjoint(codes) or {3, 4, 5, 19} & {*block.m_codes}:
        block.whole("$", block.words.pop("$"), -1, 0)


SPINDLE_G = frozenset((330, 331, 760, 960, 970))
"""G codes of LinuxCNC that a spindle is named for."""


def _drop_speed_limit(block: Block, run: Run) -> None:
    """G92 S and G50 S without an axis: the greatest speed under G96, for the control to keep."""
    limits = any(kind == "G" and code in SPEED_LIMITS for _, kind, code, _ in block.actions)
    if limits and AXES.keys().isdisjoint(block.words):
        block.take("S")
        run.note(
            block.line,
            "S beside G50 or G92 is the greatest speed under G96, which is the control's to keep: "
            "not followed",
        )
        block.actions[:] = [one for one in block.actions if one[1:3] != ("G", 920)]


SPEED_LIMITS = (500, 920)


def _value(item: WordItem, parameters: ParameterStore, block: Block) -> float | None:
    try:
        return evaluate(item.value, parameters)
    except ExpressionError as error:
        raise block.error(item, str(error)) from None


def _g_word(block: Block, run: Run, item: WordItem, value: float) -> None:
    code = round(value * 10)
    whole = abs(code - value * 10) < 1e-3
    code = HAAS.get(code, code) if run.dialect == "fanuc" else code
    step = step_of(code, run.dialect) if whole else None
    if step is None:
        reason = UNSUPPORTED.get((run.dialect, code)) or UNSUPPORTED.get(("", code))
        unknown = (
            f"G{value:g} is not known in the dialect {run.dialect}, and what it moves is not "
            "followed: post it as single moves, or name the control's dialect"
        )
        raise block.error(item, reason or unknown)
    for index, (_, kind, other, _) in enumerate(block.actions):
        if kind != "G" or not excludes(code, other):
            continue
        if run.state.dialect == LINUXCNC:
            raise block.error(
                item, f"{g_code(other)} and {g_code(code)} exclude each other: keep one a block"
            )
        if GROUP_OF.get(code) == GROUP_OF.get(other) and code in GROUP_OF:
            del block.actions[index]  # of one group the last one counts on a Fanuc
            break
    block.actions.append((step, "G", code, item))


def _m_word(block: Block, run: Run, item: WordItem, value: float) -> None:
    code = round(value)
    if abs(code - value) > 1e-4 or not 0 <= code <= 99_999_999:
        raise block.error(item, f"M{value:g} is no M code: use a whole number")
    if run.state.dialect == LINUXCNC:
        group = M_GROUPS.get(code)
        clash = next((m for m in block.m_codes if group and M_GROUPS.get(m) == group), None)
        if clash is not None:
            raise block.error(
                item, f"M{clash} and M{code} exclude each other: put them into two blocks"
            )
    block.m_codes.append(code)
    step = M_STEPS[run.dialect].get(code, OTHER_M_STEP[run.dialect])
    block.actions.append((step, "M", code, item))


def _scale_increments(block: Block, run: Run) -> None:
    """Numbers without a decimal point count least input increments."""
    codes = [code for _, kind, code, _ in block.actions if kind == "G"]
    units = [code for code in codes if code in (200, 210)]
    inch = units[-1] == 200 if units else run.state.unit != 1.0
    thousandths = {letter for code in codes for letter in THOUSANDTHS.get(code, "")}
    cycle = next((code for code in codes if GROUP_OF.get(code) == "cycle"), run.cycle.code)
    moves = any(GROUP_OF.get(code) == "motion" for code in codes)
    # K repeats a cycle, and G51 reads the point of its factors by itself
    counts = {"K"} if cycle not in (CANCELLED, 870) and not moves else set()
    factors = set("IJK") if 510 in codes else set()
    for letter in ((LENGTHS | thousandths) - counts - factors) & block.words.keys():
        item = block.items[letter]
        if type(item.value) is Number and "." not in item.text:
            metric = letter in "ABC" or letter in thousandths
            block.words[letter] *= INCREMENT[inch and not metric]


def _refuse_rest(block: Block, run: Run) -> None:
    letter = next(iter(block.words))
    item = block.items[letter]
    if letter in AXES:
        reason = "no motion is in force that could take this axis word: write G0, G1, … before"
    elif letter in ("U", "V", "W"):
        reason = f"the machine has no axis {letter}: use X Y Z A B C"
    else:
        reason = "nothing in this block takes the word: add the code that it belongs to"
    raise block.error(item, reason)


HAAS = {1000: 501, 1010: 511, 1540: 541}
"""G code of a Haas, times ten -> the one of a Fanuc that does the same: G154 P is G54.1 P."""
UNSUPPORTED: dict[tuple[str, int], str] = {
    ("", 50): "splines (G5) are not supported: post the program with lines and arcs",
    ("linuxcnc", 51): "splines (G5.1) are not supported: post the program with lines and arcs",
    **{
        (dialect, code): f"NURBS ({g_code(code)}) are not supported: post the program with lines "
        "and arcs"
        for dialect, code in (("linuxcnc", 52), ("linuxcnc", 53), ("", 62))
    },
    **{
        ("linuxcnc", code): f"the lathe cycle {g_code(code)} is not supported: post it as single "
        "moves"
        for code in (700, 710, 711, 712, 720, 721, 722)
    },
    ("fanuc", 71): "cylindrical interpolation (G7.1) is not supported: post X Y Z moves",
    ("fanuc", 121): "polar interpolation (G12.1) is not supported: post X Y Z moves",
    ("fanuc", 290): "return from the reference position (G29) is not supported: post G0 moves",
    ("fanuc", 434): "tool centre point control (G43.4) is not supported: post 3-axis moves",
    ("fanuc", 435): "tool centre point control (G43.5) is not supported: post 3-axis moves",
    ("fanuc", 120): "circular pockets (G12 of a Haas) are not followed: post single moves",
    ("fanuc", 130): "circular pockets (G13 of a Haas) are not followed: post single moves",
    ("fanuc", 1500): "pocket milling (G150 of a Haas) is not followed: post single moves",
    ("fanuc", 682): "tilted work planes (G68.2) are not supported: post 3-axis moves",
}
"""Codes that are refused, with the remedy."""

Handler = Callable[[Run, Block, int, WordItem], None]

DWELLS = {"fanuc": ("P", "X", "U"), "linuxcnc": ("P",), "siemens": ("P",)}
"""Words that say how long G4 waits."""
FEED_MODES = {930: FeedMode.INVERSE_TIME, 940: FeedMode.PER_MINUTE, 950: FeedMode.PER_REVOLUTION}


def _plane(run: Run, block: Block, code: int, item: WordItem) -> None:
    if run.contour is not None and run.state.plane != code // 10:
        raise block.error(item, "the plane cannot change while G41 or G42 is in force: G40 first")
    run.state.plane = code // 10


def _units(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G20, G21; G70 and G71 of a Siemens leave F in the control's unit, G700 and G710 do not."""
    run.state.unit = INCH if code in (200, 700, 7000) else 1.0
    if code in (700, 710):
        run.feed_unit = INCH if run.setup.inch else 1.0
    else:
        run.feed_unit = run.state.unit


def _feed_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    mode = FEED_MODES[code]
    if mode != run.state.feed_mode:
        run.state.feed_mode = mode
        # LinuxCNC discards F when its meaning changes
        run.state.feed = 0.0


def _mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G90 and G91, of centres G90.1 and G91.1; G98 and G99."""
    if code in (980, 990):
        run.retract_to_r = code == 990
    else:
        setattr(run.state, "absolute" if code in (900, 910) else "arc_absolute", int(code < 910))


def _path_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    run.state.path_mode = PathMode.EXACT_STOP if code in (610, 611) else PathMode.CONTINUOUS
    if code == 610 and run.state.dialect == LINUXCNC:
        run.state.path_mode = PathMode.EXACT_PATH
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


def _quality(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G103 and G187 of a Haas: blocks looked ahead and smoothness; the path is as written."""
    for letter in "PE":
        block.take(letter)


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
    unit = run.feed_unit if run.dialect == "siemens" else run.state.unit
    run.state.feed = value if inverse else value * unit


def _modifier(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G9, G31 and G53 say how the block's motion is done."""
    block.modifiers.add(code)


def _dwell(run: Run, block: Block, code: int, item: WordItem) -> None:
    letters = DWELLS[run.dialect]
    given = [letter for letter in letters if letter in block.words]
    if not given:
        raise block.error(item, f"{item.text} does not say how long: add {letters[0]}")
    if len(given) > 1:
        raise block.error(item, f"{item.text} takes one of {', '.join(given)}: keep one of them")
    value = block.words.pop(given[0])
    if given[0] == "P":
        value = motion.seconds(run, block, value)
    if value < 0:
        raise block.error(item, f"a dwell of {value:g} s is not possible: give 0 or more")
    run.add_row(Kind.DWELL, block.line, value=value)


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


def move(run: Run, block: Block) -> None:
    """Carry out the axis words under the motion in force, and the corners that it makes."""
    before = run.rows.count
    _move(run, block)
    moved = run.rows.count > before
    if run.corner is not None and moved:
        finish_corner(run, run.corner)
    if moved and run.state.motion == 10 and run.dialect == "fanuc":
        begin_corner(run, block)


def _move(run: Run, block: Block) -> None:
    code = run.state.motion
    words = block.words
    item = next((i for _, kind, c, i in block.actions if kind == "G" and c == code), None)
    if 530 in block.modifiers:
        work_offsets.machine_move(run, block, code, item)
    elif 310 in block.modifiers:
        motion.straight(run, block, 310, item)
    elif words and not _MOVING.isdisjoint(words):
        if code == CANCELLED:
            return
        if code == 760 and run.state.dialect == LINUXCNC:
            motion.thread_cycle(run, block, code, item)
        else:
            _MOTIONS.get(code, drill)(run, block, code, item)
    elif run.pending_length:
        motion.straight(run, block, 0 if code not in (0, 10) else code, item)
    elif item is not None and run.state.dialect == LINUXCNC and code not in (0, 10, CANCELLED):
        raise block.error(item, f"{g_code(code)} has no axis words: add them")
    if 90 in block.modifiers and run.rows.count:  # G9: the last row ends standing still
        run.rows.arrays["path_mode"][run.rows.count - 1] = PathMode.EXACT_STOP


_MOVING = frozenset(AXES) | frozenset("RIJK@^")
_MOTIONS: dict[int, Callable[[Run, Block, int, WordItem | None], None]] = {
    **dict.fromkeys((0, 10, 310, 382, 383, 384, 385), motion.straight),
    **dict.fromkeys((20, 30), motion.arc),
    330: motion.thread,
    331: motion.tap_rigidly,
}
HANDLERS: dict[int, Handler] = {
    **dict.fromkeys((200, 210, 700, 710, 7000, 7100), _units),
    **dict.fromkeys(FEED_MODES, _feed_mode),
    **dict.fromkeys((960, 970), tools.spindle_mode),
    **dict.fromkeys((170, 180, 190), _plane),
    **dict.fromkeys((70, 80), _g8),
    **dict.fromkeys((50, 51), _look_ahead),
    **dict.fromkeys((1030, 1870), _quality),
    **dict.fromkeys((90, 530, 310), _modifier),
    **dict.fromkeys((900, 910, 901, 911, 980, 990), _mode),
    **dict.fromkeys((600, 610, 611, 620, 630, 640), _path_mode),
    **dict.fromkeys(GROUPS["cutter_compensation"].codes, tools.cutter_side),
    **dict.fromkeys(GROUPS["length"].codes, tools.tool_length),
    **dict.fromkeys(GROUPS["wcs"].codes, work_offsets.select_system),
    **dict.fromkeys((150, 160), work_offsets.polar),
    **dict.fromkeys((500, 510), work_offsets.scaling),
    **dict.fromkeys((501, 511), work_offsets.mirror),
    **dict.fromkeys((680, 690), work_offsets.rotation),
    **dict.fromkeys((660, 661, 670), tools.modal_macro),
    **dict.fromkeys(GROUPS["cycle"].codes + GROUPS["motion"].codes, _motion_mode),
    **dict.fromkeys((270, 280, 281, 300, 301), work_offsets.reference_return),
    **dict.fromkeys((920, 921, 922, 923), work_offsets.position_set),
    40: _dwell,
    100: work_offsets.data_input,
    110: lambda run, block, code, item: None,
    520: work_offsets.local_system,
    650: tools.macro_call,
}
"""Ten times the G code -> what carries it out."""
WORDS: dict[str, Callable[[Run, Block, WordItem], None]] = {
    "F": _feed_word,
    "S": tools.spindle_word,
    "T": tools.tool_word,
    "D": tools.radius_word,
    "H": tools.tool_length_word,
}
"""Word with a meaning of its own -> what carries it out."""
