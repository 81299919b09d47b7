"""M codes: stops, tool changes, coolant, subprograms, and those the machine builder gives."""

from pipeline.gcode.block import Block, Jump
from pipeline.gcode.moves import Kind
from pipeline.gcode.run import Run, Snapshot
from pipeline.gcode.spindle import TURNING, turn
from pipeline.gcode.state import LINUXCNC
from pipeline.gcode.statements import WordItem

LARGEST = 99_999_999
MOST_CALLS = 100_000_000
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
    if code in TURNING and (code <= 5 or code == 19 or run.state.dialect != LINUXCNC):
        turn(run, block, code, item)
    elif code in (0, 1):
        run.stand(Kind.STOP, block.line, code=code)
    elif code in (2, 30) or (code == 17 and run.dialect == "siemens"):
        run.close_contour()
        if code != 17:
            run.stand(Kind.END, block.line)
        block.flow = Jump(kind="return" if code == 17 else "end", item=item)
    elif code in (6, 61) and (code == 6 or run.state.dialect == LINUXCNC):
        _tool_change(run, block, code, item)
    elif code in (98, 198):
        _subprogram(run, block, item)
    elif code == 99:
        number = block.take("P")
        where = None if number is None else block.whole("P", number, 0, LARGEST)
        block.flow = Jump(kind="return", item=item, number=where)
    elif run.state.dialect == LINUXCNC:
        _linuxcnc_m(run, block, code, item)
    else:
        run.rigid = run.rigid or code == 29
        run.stand(Kind.M_CODE, block.line, code=code, value=block.take("P") or 0.0)


def tool_word(run: Run, block: Block, item: WordItem) -> None:
    """T: the tool that the next M6 puts into the spindle."""
    value = block.take("T")
    if value is None:
        return
    number = block.whole("T", value, 0, LARGEST)
    if run.state.dialect == LINUXCNC and number != 0 and number not in run.registers:
        raise block.error(
            item,
            f"tool {number} is not in the tool table: add it to setup.tools of the machine's file",
        )
    run.state.selected = number


def _tool_change(run: Run, block: Block, code: int, item: WordItem) -> None:
    state = run.state
    if code == 61:
        number = block.whole("Q", block.need("Q", "M61", item), 0, LARGEST)
        if number and number not in run.registers:
            raise block.error(
                item,
                f"tool {number} is not in the table: add it to setup.tools of the machine's file",
            )
        state.tool = number
    elif state.selected >= 0:
        state.tool = state.selected
    elif state.dialect == LINUXCNC:
        state.tool = 0  # no T yet: the spindle is emptied
    if code == 6:
        state.direction = 0
        if run.beside is not None and state.dialect == LINUXCNC:
            state.position, run.beside = run.beside, None  # it looks where the machine stands
    run.stand(Kind.TOOL_CHANGE, block.line)


def _subprogram(run: Run, block: Block, item: WordItem) -> None:
    """M98 P L, or P with the count before the last four digits."""
    number = block.whole("P", block.need("P", "M98", item), 0, LARGEST)
    count = block.take("L")
    if count is not None:
        times = block.whole("L", count, 0, MOST_CALLS)
    elif run.state.dialect != LINUXCNC and number > 9999:
        times, number = number // 10_000, number % 10_000
    else:
        times = 1
    block.flow = Jump(kind="call", item=item, number=number, count=times)


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
        run.stand(Kind.STOP if code == 60 else Kind.M_CODE, block.line, code=code, value=value)
    else:
        raise block.error(item, f"M{code} is not known to LinuxCNC: delete it or remap it by hand")
