"""S, G96, G97, M3, M4, M5 and M19."""

from pipeline.gcode.block import Block
from pipeline.gcode.moves import Kind
from pipeline.gcode.run import Run
from pipeline.gcode.statements import WordItem

FOOT = 0.3048
"""Metres in a foot: S under G96 counts feet/minute where the program counts inches."""
TURNING = {3: 1, 4: -1, 13: 1, 14: -1, 5: 0, 19: 0}
"""M code -> direction of the spindle."""


def spindle_word(run: Run, block: Block, item: WordItem) -> None:
    """S: a row where the spindle turns already."""
    value = block.take("S")
    if value is None:
        return
    if value < 0:
        raise block.error(item, f"S is {value:g}: give 0 or more and M4 to turn the other way")
    state = run.state
    state.speed = value
    if state.constant_surface_speed and state.unit != 1.0:
        state.speed = value * FOOT
    if state.direction and TURNING.keys().isdisjoint(block.m_codes):
        run.stand(Kind.SPINDLE, block.line)


def spindle_mode(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G96 and G97; D, the highest speed under G96, is the control's to keep."""
    constant = int(code == 960)
    if constant:
        block.take("D")
    if run.state.constant_surface_speed != constant and "S" not in block.words:
        raise block.error(item, f"{item.text} changes what S means and the block has no S: add it")
    run.state.constant_surface_speed = constant


def turn(run: Run, block: Block, code: int, item: WordItem) -> None:
    """M3, M4, M5, M13, M14 (with coolant) and M19."""
    run.state.direction = TURNING[code]
    if code == 19:
        block.take("R")
        block.take("P")
        block.take("Q")
    run.stand(Kind.SPINDLE, block.line, code=code)
    if code in (13, 14):
        run.stand(Kind.M_CODE, block.line, code=8)
