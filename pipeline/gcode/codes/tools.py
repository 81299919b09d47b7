"""Tool, spindle and M codes: tool length, cutter radius, spindle, tool change, subprogram calls."""

from pipeline.gcode.cutter_compensation import close_contour
from pipeline.gcode.modal import FANUC, LINUXCNC, g_code
from pipeline.gcode.moves import CutterRadius, Kind
from pipeline.gcode.run import Block, Contour, Jump, Register, Run, Snapshot
from pipeline.gcode.statements import WordItem

LARGEST = 99_999_999


def tool_length_word(run: Run, block: Block, item: WordItem) -> None:
    """H of a Fanuc, which stays in force; LinuxCNC's belongs to the G code beside it."""
    if run.state.dialect == LINUXCNC or "H" not in block.words:
        return
    run.length_number = block.whole("H", block.words.pop("H"), 0, LARGEST)
    if run.length_mode in (430, 440):
        tool_length(run, block, run.length_mode, item)


def radius_word(run: Run, block: Block, item: WordItem) -> None:
    """D of a Fanuc, which stays in force; LinuxCNC's belongs to the G code beside it."""
    if run.state.dialect != LINUXCNC and "D" in block.words:
        run.radius_number = block.whole("D", block.words.pop("D"), 0, LARGEST)


def tool_length(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G43, G43.1, G43.2, G44 and G49."""
    old = run.offsets.length
    if run.state.dialect == LINUXCNC:
        new = _linuxcnc_length(run, block, code, item)
    else:
        if code in (431, 432):
            raise block.error(item, f"{g_code(code)} is not known in this dialect: use G43 H")
        new = [0.0] * 6
        if code != 490:
            entry = run.registers.get(run.length_number, Register())
            length = entry.length + entry.length_wear
            new[2] = length if code == 430 else -length
        run.length_mode = code
    if new == old:
        return
    run.offsets.length = new
    run.remap()
    if run.state.dialect == FANUC and run.setup.length_moves:
        run.pending_length += new[2] - old[2]


def _linuxcnc_length(run: Run, block: Block, code: int, item: WordItem) -> list[float]:
    offset = [0.0] * 6
    if code == 490:
        return offset
    if code == 440:
        raise block.error(item, "LinuxCNC has no G44: use G43 and a negative length")
    number = None if code == 431 else block.take("H")
    if code == 431 or (code == 432 and number is None):
        for axis, value in block.take_axes(run.state.unit).items():
            offset[axis] = value
    else:
        # H0 is the tool in the spindle too
        tool = block.whole("H", number or 0.0, 0, LARGEST) or run.state.tool
        entry = run.listed_tool(tool, block, item)
        offset[2] = entry.length
        for axis, value in entry.across.items():
            offset[axis] = value
    if code == 432:
        return [a + b for a, b in zip(run.offsets.length, offset, strict=True)]
    return offset


def cutter_side(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G40, G41, G41.1, G42 and G42.1."""
    if code == 400:
        run.straight_next = run.contour is not None
        close_contour(run)
        return
    state = run.state
    side = 41 if code in (410, 411) else 42
    radius = _radius(run, block, code, item)
    contour = run.contour
    if contour is not None:
        if state.dialect != LINUXCNC and (state.cutter_compensation, contour.radius) == (
            side,
            radius,
        ):
            return
        raise block.error(
            item,
            f"G{state.cutter_compensation} is in force already: G40 before another side or radius",
        )
    if state.dialect == LINUXCNC and state.plane == 19:
        raise block.error(item, "LinuxCNC compensates in G17 and G18 only: choose one of them")
    state.cutter_compensation = side
    if radius != 0:
        run.contour = Contour(
            side=1 if side == 41 else -1, radius=radius, plane=state.plane, first=run.rows.count,
            start=tuple(state.position), word=item.text,
        )  # fmt: skip


def _radius(run: Run, block: Block, code: int, item: WordItem) -> float:
    """Radius of the tool that G41 or G42 compensates [mm]."""
    if code in (411, 421):
        if run.state.dialect != LINUXCNC:
            raise block.error(item, f"{g_code(code)} is not known in this dialect: use G41 or G42")
        return block.need("D", g_code(code), item) * run.state.unit / 2
    number = block.take("D")
    if run.state.dialect == LINUXCNC:
        register = run.state.tool if number is None else block.whole("D", number, 0, LARGEST)
        entry = run.listed_tool(register, block, item)
        radius = entry.radius
    else:
        register = run.radius_number
        entry = run.registers.get(register, Register())
        radius = entry.radius + entry.radius_wear
    run.cutter_radii.append(CutterRadius(
        word=g_code(code), line=block.line, file=run.state.file, tool=run.state.tool,
        register=register, radius=radius,
    ))  # fmt: skip
    return radius


FOOT = 0.3048
"""Metres in a foot: S under G96 counts feet/minute where the program counts inches."""
SPINDLE_DIRECTION = {3: 1, 4: -1, 13: 1, 14: -1, 5: 0, 19: 0}
"""M code -> direction of the spindle."""


def spindle_word(run: Run, block: Block, item: WordItem) -> None:
    """S: a row where the spindle rotates already."""
    value = block.take("S")
    if value is None:
        return
    if value < 0:
        raise block.error(item, f"S is {value:g}: give 0 or more and M4 to turn the other way")
    state = run.state
    state.speed = value
    if state.constant_surface_speed and state.unit != 1.0:
        state.speed = value * FOOT
    if state.direction and SPINDLE_DIRECTION.keys().isdisjoint(block.m_codes):
        run.add_row(Kind.SPINDLE, block.line)


def spindle_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G96 and G97; D, the highest speed under G96, is the control's to keep."""
    constant = int(code == 960)
    if constant and block.take("D") is not None:
        run.note(block.line, "D of G96, the greatest speed, is the control's to keep: not followed")
    if run.state.constant_surface_speed != constant and "S" not in block.words:
        raise block.error(item, f"{item.text} changes what S means and the block has no S: add it")
    run.state.constant_surface_speed = constant


WITHOUT_MOTION = {
    **dict.fromkeys((48, 49, 60, 7, 8, 9), ""),
    **dict.fromkeys((50, 51, 52, 53, 62, 63, 64, 65), "P"),
    66: "PELQ",
    67: "EQ",
    68: "EQ",
}
"""M code of LinuxCNC -> words that belong to it."""


def m_code(run: Run, block: Block, code: int, item: WordItem) -> None:
    """Carry out one M code."""
    linuxcnc = run.state.dialect == LINUXCNC
    if code in SPINDLE_DIRECTION and (code <= 5 or code == 19 or not linuxcnc):
        run.state.direction = SPINDLE_DIRECTION[code]
        run.add_row(Kind.SPINDLE, block.line, code=code)
        if code in (13, 14):  # with coolant
            run.add_row(Kind.M_CODE, block.line, code=8)
    elif code in (0, 1):
        run.add_row(Kind.STOP, block.line, code=code)
    elif code in (2, 30) or (code == 17 and run.dialect == "siemens"):
        # in a subprogram of a Sinumerik M2 and M30 return as M17 does
        returns = code == 17 or (run.dialect == "siemens" and len(run.saved) > 1)
        if not returns:
            close_contour(run)
            run.add_row(Kind.END, block.line)
        block.flow = Jump(kind="return" if returns else "end", item=item)
    elif code == 6 or (code == 61 and linuxcnc):
        _tool_change(run, block, code, item)
    elif code in (98, 198) or (code == 97 and "P" in block.words and not linuxcnc):
        _subprogram(run, block, code, item)
    elif code == 99:
        number = block.take("P")
        where = None if number is None else block.whole("P", number, 0, LARGEST)
        block.flow = Jump(kind="return", item=item, number=where)
    elif linuxcnc:
        _linuxcnc_m(run, block, code, item)
    else:
        run.rigid = run.rigid or code == 29
        run.add_row(Kind.M_CODE, block.line, code=code, value=_plain_p(run, block, code, item))


def tool_word(run: Run, block: Block, item: WordItem) -> None:
    """T: the tool that the next M6 puts into the spindle."""
    value = block.take("T")
    if value is None:
        return
    number = block.whole("T", value, 0, LARGEST)
    if run.state.dialect == LINUXCNC:
        run.listed_tool(number, block, item)
    run.state.selected = number


def _tool_change(run: Run, block: Block, code: int, item: WordItem) -> None:
    state = run.state
    if code == 61:
        number = block.whole("Q", block.need("Q", "M61", item), 0, LARGEST)
        run.listed_tool(number, block, item)
        state.tool = number
    elif state.selected >= 0:
        state.tool = state.selected
    elif state.dialect == LINUXCNC:
        state.tool = 0  # no T yet: the spindle is emptied
    if code == 6:
        state.direction = 0
        if run.compensated_position is not None and state.dialect == LINUXCNC:
            # it looks where the machine stands
            state.position, run.compensated_position = run.compensated_position, None
    run.add_row(Kind.TOOL_CHANGE, block.line)


def _subprogram(run: Run, block: Block, code: int, item: WordItem) -> None:
    """M98 P L, or P with the count before the last four digits; M97 P L of a Haas, from N P on."""
    number = block.whole("P", block.need("P", "M98", item), 0, LARGEST)
    count, times, local = block.take("L"), 1, code == 97
    if count is not None:
        times = block.whole("L", count, 0, MOST_CALLS)
    elif run.state.dialect != LINUXCNC and number > 9999 and not local:
        times, number = number // 10_000, number % 10_000
    kind = "local call" if local else "call"
    block.flow = Jump(kind=kind, item=item, number=number, count=times)


def _plain_p(run: Run, block: Block, code: int, item: WordItem) -> float:
    """P of an M code that calls nothing; a machine may make any M code a call."""
    value = block.take("P")
    if value is not None and run.dialect == "fanuc" and code not in run.setup.plain_m_codes:
        raise block.error(
            item,
            f"M{code} P{value:g} may call a program, which would not be followed: rewrite it as "
            "M98, or name the code in setup.plain_m_codes of the machine's file where its P calls "
            "nothing",
        )
    return value or 0.0


def _linuxcnc_m(run: Run, block: Block, code: int, item: WordItem) -> None:
    if code in (70, 73):
        run.saved[-1] = Snapshot.of(run, automatic=code == 73)
    elif code == 71:
        run.saved[-1] = None
    elif code == 72:
        snapshot = run.saved[-1]
        if snapshot is None:
            raise block.error(item, "M72 restores a state that was not saved: write M70 before")
        snapshot.restore(run)
    elif code in WITHOUT_MOTION or 100 <= code <= 199:
        run.waited = run.waited or code == 66
        value = 0.0
        for letter in WITHOUT_MOTION.get(code, "PQ"):
            given = block.take(letter)
            value = given if given is not None and letter == "P" else value
        run.add_row(Kind.STOP if code == 60 else Kind.M_CODE, block.line, code=code, value=value)
    else:
        raise block.error(
            item, f"M{code} is not known to LinuxCNC: write what it does on this machine"
        )


LOCALS = {
    "A": 1, "B": 2, "C": 3, "D": 7, "E": 8, "F": 9, "H": 11, "M": 13, "Q": 17, "R": 18, "S": 19,
    "T": 20, "U": 21, "V": 22, "W": 23, "X": 24, "Y": 25, "Z": 26,
}  # fmt: skip
"""Letter -> local variable; I, J, K are 4, 5, 6 and, the n-th time, 3 n + 1, 2, 3."""
CENTRES = "IJK"
MOST_CALLS = 100_000_000
MOST_SETS = 10


def macro_call(run: Run, block: Block, code: int, item: WordItem) -> None:
    """Macro call G65 with P, L and arguments."""
    block.flow = _call(block, item)


def modal_macro(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G66: the macro after every block that moves, until G67."""
    if code == 661:
        raise block.error(item, "G66.1 is not supported: use G66, or G65 in each block")
    run.modal_call = _call(block, item) if code == 660 else None
    run.remap()


def _call(block: Block, item: WordItem) -> Jump:
    number, count, sets, last = None, 1, 0, -1
    arguments: dict[int, float] = {}
    for word, value in block.ordered:
        letter = word.letter
        if word.column <= item.column:
            continue
        if letter == "P":
            number = block.whole("P", value, 1, LARGEST)
        elif letter == "L":
            count = block.whole("L", value, 0, MOST_CALLS)
        elif letter in CENTRES:
            index = CENTRES.index(letter)
            sets += index <= last or last < 0
            last = index
            if sets > MOST_SETS:
                raise block.error(word, "I J K stand more than ten times: use fewer arguments")
            arguments[3 * sets + 1 + index] = value
        elif letter in LOCALS:
            arguments[LOCALS[letter]] = value
        else:
            raise block.error(word, f"{letter} cannot be an argument: use another letter")
    if number is None:
        raise block.error(item, f"{item.text} does not say which macro: add P")
    return Jump(kind="call", item=item, number=number, count=count, arguments=arguments)
