"""H, G43, G44, G49 (tool length) and D, G40 to G42 (where a contour begins and ends)."""

from pipeline.gcode.block import AXES, Block
from pipeline.gcode.contour import Contour
from pipeline.gcode.modal import g_code
from pipeline.gcode.run import Register, Run
from pipeline.gcode.state import FANUC, LINUXCNC
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
    number = block.take("H")
    if code == 431 or (code == 432 and number is None):
        for letter, axis in AXES.items():
            value = block.take(letter)
            if value is not None:
                offset[axis] = value * (run.state.unit if axis < 3 else 1.0)
    else:
        # H0 is the tool in the spindle too
        tool = block.whole("H", number or 0.0, 0, LARGEST) or run.state.tool
        offset[2] = _listed(run, block, item, tool).length
    if code == 432:
        return [a + b for a, b in zip(run.offsets.length, offset, strict=True)]
    return offset


def _listed(run: Run, block: Block, item: WordItem, tool: int) -> Register:
    """Entry of LinuxCNC's tool table, where tool 0 is none."""
    if tool <= 0:
        return Register()
    if tool not in run.registers:
        raise block.error(
            item,
            f"tool {tool} is not in the tool table: add it to setup.tools of the machine's file",
        )
    return run.registers[tool]


def cutter_side(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G40, G41, G41.1, G42 and G42.1."""
    if code == 400:
        run.close_contour()
        return
    state = run.state
    side = 41 if code in (410, 411) else 42
    radius = _radius(run, block, code, item)
    contour = run.contour
    if contour is not None:
        if state.dialect != LINUXCNC and (state.compensation, contour.radius) == (side, radius):
            return
        raise block.error(
            item, f"G{state.compensation} is in force already: G40 before another side or radius"
        )
    if state.dialect == LINUXCNC and state.plane == 19:
        raise block.error(item, "LinuxCNC compensates in G17 and G18 only: choose one of them")
    state.compensation = side
    if radius != 0:
        run.contour = Contour(
            side=1 if side == 41 else -1,
            radius=radius,
            plane=state.plane,
            first=run.rows.count,
            start=tuple(state.position),
            word=item.text,
        )


def _radius(run: Run, block: Block, code: int, item: WordItem) -> float:
    """Of the tool that G41 or G42 compensates [mm]."""
    if code in (411, 421):
        if run.state.dialect != LINUXCNC:
            raise block.error(item, f"{g_code(code)} is not known in this dialect: use G41 or G42")
        return block.need("D", g_code(code), item) * run.state.unit / 2
    number = block.take("D")
    if run.state.dialect == LINUXCNC:
        tool = run.state.tool if number is None else block.whole("D", number, 0, LARGEST)
        return _listed(run, block, item, tool).radius
    entry = run.registers.get(run.radius_number, Register())
    return entry.radius + entry.radius_wear
