"""Branches and loops of the Sinumerik 840D: IF, WHILE, FOR, LOOP and REPEAT, and their ends.

A line of flow control holds nothing else.  Jumps to labels (GOTOF, GOTOB, GOTO) are refused.

Source: Sinumerik 840D sl, Programming Manual Job Planning, "Control structures".
"""

import re
from dataclasses import dataclass

from pipeline.gcode.dialects.siemens_tokens import VARIABLE, Token, TokenStream
from pipeline.gcode.program import Program
from pipeline.gcode.statements import Assignment, Control, Number, Parameter

ENDS = {"IF": "ENDIF", "WHILE": "ENDWHILE", "FOR": "ENDFOR", "LOOP": "ENDLOOP", "REPEAT": "UNTIL"}
"""Word that opens a structure -> word that closes it."""
WORDS = frozenset((*ENDS, *ENDS.values(), "ELSE"))
JUMPS = frozenset({"GOTO", "GOTOF", "GOTOB", "GOTOC", "GOTOS", "CASE"})
KIND = "siemens "
"""Before the word, in small letters, that the kind of a control is called by."""
_HEAD = re.compile(rb"[\s/\d]*?(?:[nN]\s*\d+\s*)?([a-zA-Z]+)")


@dataclass(frozen=True, slots=True)
class Structure:
    """Lines of a branch or loop: its opening, its ELSE where it has one, its end."""

    word: str
    opening: int
    end: int
    otherwise: int | None = None


def structures(program: Program) -> dict[int, Structure]:
    """Structures of a program by each of their lines; an opening without an end is left out."""
    found: dict[int, Structure] = {}
    open_: list[tuple[str, int, int | None]] = []
    for number in program.body:
        match = _HEAD.match(program.line(number).text)
        word = match[1].decode("ascii").upper() if match else ""
        if word in ENDS:
            open_.append((word, number, None))
        elif word == "ELSE" and open_ and open_[-1][0] == "IF":
            open_[-1] = (*open_[-1][:2], number)
        elif open_ and word == ENDS[open_[-1][0]]:
            begun, opening, otherwise = open_.pop()
            one = Structure(begun, opening, number, otherwise)
            found |= {line: one for line in (opening, number, otherwise) if line is not None}
    return found


def control_of(token: Token, stream: TokenStream) -> Control:
    """Flow control of a line that begins with one of ``WORDS``; the stream is behind the word.

    Raises
    ------
    GcodeError
        When the line holds anything else.
    """
    word, kind = token.head, KIND + token.head.lower()
    condition, then = None, ()
    if word in ("IF", "WHILE", "UNTIL"):
        condition = stream.condition()
        jump = stream.next
        if word == "IF" and jump is not None and jump.head in JUMPS:
            raise stream.error(jump, f"{jump.head} is not followed: write IF … ELSE … ENDIF")
    elif word == "FOR":
        name = stream.next
        if name is None or name.kind != "set":
            raise stream.error(name, "FOR needs a variable: write FOR I = 1 TO 5")
        stream.at += 1
        target = Parameter(VARIABLE + name.head.lower())
        then = (Assignment(target, stream.expression(), name.column),)
        to = stream.next
        if to is None or to.head != "TO":
            raise stream.error(to, "FOR needs TO and where it ends: write FOR I = 1 TO 5")
        stream.at += 1
        condition = stream.expression()
    if stream.next is not None:
        raise stream.error(stream.next, f"nothing may follow {word} here: put it on its own line")
    return Control(kind, Number(0.0), token.column, condition=condition, then=then)
