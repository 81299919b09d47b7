"""Statements of lines that hold nothing but letters and numbers, straight from their tokens."""

from pipeline.gcode.program import Program
from pipeline.gcode.statements import LARGEST, Number, Statement, WordItem
from pipeline.gcode.words import Kind

PLAIN = frozenset({Kind.WORD, Kind.BLANK, Kind.LINE_END})
LETTERS = frozenset("ABCDEFGHIJKLMPQRSTUVWXYZ")
"""Those of words that stand anywhere in a line and say nothing of flow."""
SIGNS = frozenset("+-")


def plain_statement(program: Program, line: int) -> Statement | None:
    """What a line says; None where it is for the parser, which would say the same of the others.

    Parameters
    ----------
    program : Program
        That holds the line.
    line : int
        Counting from 1.
    """
    tokens = program.tokens
    first, last = tokens.first[line - 1 : line + 1].tolist()
    kinds = tokens.kind[first:last].tolist()
    if not PLAIN.issuperset(kinds):
        return None
    starts, values = tokens.start[first : last + 1].tolist(), tokens.value[first:last].tolist()
    text = program.data[starts[0] : starts[-1]].decode("latin-1")
    head = starts[0]
    number, words = None, []
    for index, kind in enumerate(kinds):
        if kind != Kind.WORD:
            continue
        begin, end = starts[index] - head, starts[index + 1] - head
        letter = text[begin].upper()
        if not abs(values[index]) <= LARGEST:
            return None  # the parser says why
        if letter in LETTERS:
            item = WordItem(letter, Number(values[index]), begin + 1, text[begin:end])
            words.append(item)
        elif letter == "N" and number is None and not words and SIGNS.isdisjoint(text[begin:end]):
            number = values[index]
        else:
            return None
    return Statement(line, None, number, tuple(words), (), None, ())
