"""One statement: its words evaluated, sorted into the control's order and carried out."""

from pipeline.gcode.block import AXES, Block
from pipeline.gcode.codes import HANDLERS, WORDS, m_code, motion
from pipeline.gcode.errors import ExpressionError
from pipeline.gcode.expressions import ParameterStore, evaluate
from pipeline.gcode.modal import (
    GROUP_OF,
    M_GROUPS,
    M_STEPS,
    OTHER_M_STEP,
    WORD_STEPS,
    excludes,
    g_code,
    step_of,
)
from pipeline.gcode.run import Run
from pipeline.gcode.state import FANUC, LINUXCNC
from pipeline.gcode.statements import Number, Statement, WordItem

MACRO_CALLS = (650, 660, 661)
MOTION_STEP = 220
LENGTHS = frozenset("XYZABCIJKRQ")
"""Words that a Fanuc reads in input increments where they have no decimal point."""
INCREMENT = {False: 1e-3, True: 1e-4}
"""Least input increment [mm] and, for G20, [inch] (IS-B)."""


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
    if run.setup.decimal == "increment" and run.state.dialect == FANUC:
        _scale_increments(block, run)
    return block


def carry_out(block: Block, run: Run) -> None:
    """Everything that the block says, in the dialect's order."""
    actions = block.actions
    if len(actions) > 1:
        actions.sort(key=_by_step)
    moved = False
    for step, kind, code, item in actions:
        if step > MOTION_STEP and not moved:
            moved = True
            motion(run, block)
        if kind == "G":
            HANDLERS[code](run, block, code, item)
        elif kind == "M":
            m_code(run, block, code, item)
        else:
            WORDS[kind](run, block, item)
    if not moved:
        motion(run, block)
    if block.words:
        _refuse_rest(block, run)


def _by_step(action: tuple[int, str, int, WordItem]) -> int:
    return action[0]


def _value(item: WordItem, parameters: ParameterStore, block: Block) -> float | None:
    try:
        return evaluate(item.value, parameters)
    except ExpressionError as error:
        raise block.error(item, str(error)) from None


def _g_word(block: Block, run: Run, item: WordItem, value: float) -> None:
    code = round(value * 10)
    step = step_of(code, run.dialect) if abs(code - value * 10) < 1e-3 else None
    if step is None:
        raise block.error(item, _unknown_g(value, run.dialect))
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


def _unknown_g(value: float, dialect: str) -> str:
    code = round(value * 10)
    reason = UNSUPPORTED.get((dialect, code)) or UNSUPPORTED.get(("", code))
    return reason or f"G{value:g} is not known in the dialect {dialect}: delete it or rewrite it"


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
    inch = run.state.unit != 1.0
    for _, kind, code, _ in block.actions:
        if kind == "G" and code in (200, 210):
            inch = code == 200
    for letter, item in block.items.items():
        if letter in LENGTHS and type(item.value) is Number and "." not in item.text:
            step = INCREMENT[inch] if letter not in "ABC" else INCREMENT[False]
            block.words[letter] *= step


def _refuse_rest(block: Block, run: Run) -> None:
    letter = next(iter(block.words))
    item = block.items[letter]
    if letter in AXES:
        reason = "no motion is in force that could take this axis word: write G0, G1, … before"
    elif letter in ("U", "V", "W"):
        reason = f"the machine has no axis {letter}: use X Y Z A B C"
    else:
        reason = "nothing in this block takes the word: delete it or add the code it belongs to"
    raise block.error(item, reason)


UNSUPPORTED: dict[tuple[str, int], str] = {
    ("", 50): "splines (G5) are not supported: post the program with lines and arcs",
    ("linuxcnc", 51): "splines (G5.1) are not supported: post the program with lines and arcs",
    ("linuxcnc", 52): "NURBS (G5.2) are not supported: post the program with lines and arcs",
    ("linuxcnc", 53): "NURBS (G5.3) are not supported: post the program with lines and arcs",
    ("", 62): "NURBS (G6.2) are not supported: post the program with lines and arcs",
    ("linuxcnc", 700): "the lathe cycle G70 is not supported: post it as single moves",
    ("linuxcnc", 710): "the lathe cycle G71 is not supported: post it as single moves",
    ("linuxcnc", 711): "the lathe cycle G71.1 is not supported: post it as single moves",
    ("linuxcnc", 712): "the lathe cycle G71.2 is not supported: post it as single moves",
    ("linuxcnc", 720): "the lathe cycle G72 is not supported: post it as single moves",
    ("linuxcnc", 721): "the lathe cycle G72.1 is not supported: post it as single moves",
    ("linuxcnc", 722): "the lathe cycle G72.2 is not supported: post it as single moves",
    ("fanuc", 71): "cylindrical interpolation (G7.1) is not supported: post X Y Z moves",
    ("fanuc", 121): "polar interpolation (G12.1) is not supported: post X Y Z moves",
    ("fanuc", 290): "return from the reference position (G29) is not supported: post G0 moves",
    ("fanuc", 434): "tool centre point control (G43.4) is not supported: post 3-axis moves",
    ("fanuc", 435): "tool centre point control (G43.5) is not supported: post 3-axis moves",
    ("fanuc", 682): "tilted work planes (G68.2) are not supported: post 3-axis moves",
}
"""Codes that are known and refused, with what to do."""
