"""G65 and G66: macros with arguments."""

from pipeline.gcode.block import Block, Jump
from pipeline.gcode.run import Run
from pipeline.gcode.statements import WordItem

LOCALS = {
    "A": 1, "B": 2, "C": 3, "D": 7, "E": 8, "F": 9, "H": 11, "M": 13, "Q": 17, "R": 18, "S": 19,
    "T": 20, "U": 21, "V": 22, "W": 23, "X": 24, "Y": 25, "Z": 26,
}  # fmt: skip
"""Letter -> local variable; I, J, K are 4, 5, 6 and, the n-th time, 3 n + 1, 2, 3."""
CENTRES = "IJK"
MOST_CALLS = 100_000_000
LARGEST = 99_999_999
MOST_SETS = 10


def macro_call(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G65 P L and arguments."""
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
