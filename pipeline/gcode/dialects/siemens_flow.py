"""Branches, loops, jumps, repeated parts and calls of subprograms of the Sinumerik 840D.

Computed jumps (CASE, GOTOC, GOTOS) are refused.  Source: Sinumerik 840D sl, Programming Manual Job
Planning, "Control structures", "Repeat program part" and "Subprograms".
"""

import re
from dataclasses import dataclass, replace

from pipeline.gcode.dialects.siemens_tokens import Token, TokenStream, variable
from pipeline.gcode.program import Program
from pipeline.gcode.statements import Assignment, Control, Expression, Number, Parameter

ENDS = {"IF": "ENDIF", "WHILE": "ENDWHILE", "FOR": "ENDFOR", "LOOP": "ENDLOOP", "REPEAT": "UNTIL"}
"""Word that opens a structure -> word that closes it."""
WORDS = frozenset((*ENDS, *ENDS.values(), "ELSE", "REPEATB"))
JUMPS = frozenset({"GOTO", "GOTOF", "GOTOB"})
"""Jumps to a label or block number: forwards, then from the top; forwards; backwards."""
COMPUTED = frozenset({"GOTOC", "GOTOS", "CASE"})
CALLING = frozenset({"CALL", "EXTCALL", "PCALL"})
KIND = "siemens "
"""Prefix of the word, in small letters, in the kind of a control."""
_HEAD = re.compile(
    rb"[\s/\d]*?(?:[nN]\s*\d+\s*)?(?:[a-zA-Z_]{2}\w*[ \t]*:\s*)?([a-zA-Z]+)(?![\w$]|[ \t]*=(?!=))"
)
_REPEATED = re.compile(rb"(?i)[^;]*\bREPEAT[ \t]+[A-Z_]")
_JUMP = re.compile(rb"(?i)[^;]*\bGOTO[FB]?\b")
_LABEL = re.compile(rb"[\s/\d]*?(?:[nN]\s*\d+\s*)?([a-zA-Z_]{2}\w*)[ \t]*:(?!=)")


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
        text = program.line(number).text
        match = _HEAD.match(text)
        word = match[1].decode("ascii").upper() if match else ""
        if (word == "IF" and _JUMP.match(text)) or (word == "REPEAT" and _REPEATED.match(text)):
            continue
        if word in ENDS:
            open_.append((word, number, None))
        elif word == "ELSE" and open_ and open_[-1][0] == "IF":
            open_[-1] = (*open_[-1][:2], number)
        elif open_ and word == ENDS[open_[-1][0]]:
            begun, opening, otherwise = open_.pop()
            one = Structure(begun, opening, number, otherwise)
            found |= {line: one for line in (opening, number, otherwise) if line is not None}
    return found


def labels(program: Program) -> dict[str, list[int]]:
    """Lines of each label of a program, and of each block number as N with its digits."""
    found: dict[str, list[int]] = {}
    for number in program.body:
        match = _LABEL.match(program.line(number).text)
        if match:
            found.setdefault(match[1].decode("ascii").upper(), []).append(number)
    for value, number in program.heads("N"):
        found.setdefault(f"N{value:.17g}", []).append(number)
    return found


def jump_of(token: Token, stream: TokenStream, condition: Expression | None = None) -> Control:
    """A jump; the stream is behind its word.

    Raises GcodeError when it does not say where to, or the line holds more.
    """
    label = _label(token, stream)
    if stream.next is not None:
        raise stream.error(stream.next, f"nothing may follow {token.head} here: delete it")
    return Control(KIND + token.head.lower(), label, token.column, condition=condition)


def control_of(token: Token, stream: TokenStream) -> Control:
    """Flow control of a line by one of ``WORDS`` or ``JUMPS``; the stream is behind the word.

    Raises GcodeError when the line holds anything else.
    """
    word, kind = token.head, KIND + token.head.lower()
    if word in JUMPS:
        return jump_of(token, stream)
    if word == "REPEATB" or (word == "REPEAT" and stream.next is not None):
        return _repeat(token, stream)
    condition: Expression | None = None
    then: tuple[Assignment, ...] = ()
    if word in ("IF", "WHILE", "UNTIL"):
        condition = stream.condition()
        jump = stream.next
        if word == "IF" and jump is not None and jump.head in JUMPS:
            stream.at += 1
            return jump_of(jump, stream, condition)
    elif word == "FOR":
        name = stream.next
        if name is None or name.kind != "set":
            raise stream.error(name, "FOR needs a variable: write FOR I = 1 TO 5")
        stream.at += 1
        target = Parameter(variable(name.head))
        then = (Assignment(target, stream.expression(), name.column),)
        to = stream.next
        if to is None or to.head != "TO":
            raise stream.error(to, "FOR needs TO and where it ends: write FOR I = 1 TO 5")
        stream.at += 1
        condition = stream.expression()
    if stream.next is not None:
        raise stream.error(stream.next, f"nothing may follow {word} here: put it on its own line")
    return Control(kind, Number(0.0), token.column, condition=condition, then=then)


def _repeat(token: Token, stream: TokenStream) -> Control:
    """``REPEATB LABEL``, ``REPEAT LABEL`` or ``REPEAT LABEL LABEL``, each with ``P=`` times."""
    first = _label(token, stream)
    last = first if token.head == "REPEATB" else ""
    if not last and stream.next is not None and stream.next.kind == "name":
        last = _label(token, stream)
    return Control(KIND + "part", "", token.column, _times(token, stream), part=(first, last))


def _label(token: Token, stream: TokenStream) -> str:
    mark = stream.next
    numbered = mark is not None and mark.kind == "address" and mark.head == "N"
    if mark is None or not (mark.kind == "name" or numbered):
        raise stream.error(mark, f"{token.head} needs a label or N and a number: add it")
    stream.at += 1
    return f"N{mark.value:.17g}" if numbered else mark.head


def _times(token: Token, stream: TokenStream, *, alone: bool = True) -> Expression:
    """``P3`` or ``P=R1`` behind a call, which ends its line."""
    count: Expression = Number(1.0)
    times = stream.next
    if times is not None and times.head == "P" and times.kind in ("address", "set"):
        stream.at += 1
        count = stream.expression() if times.kind == "set" else Number(times.value)
    if stream.next is not None or not alone:
        raise stream.error(
            token, f"{token.text.rstrip('(')} is no word that is known here: rewrite it, or, if it "
            "calls a subprogram, write the call in a block of its own"
        )  # fmt: skip
    return count


def call_of(token: Token, stream: TokenStream, *, alone: bool = True) -> Control:
    """Call of a subprogram; the stream is behind its word and, where it has one, the bracket.

    ``NAME``, ``NAME(1, 2)``, ``L10``, ``CALL "NAME"``, ``EXTCALL("NAME.SPF")``, PCALL with a path
    and ``CALL "NAME" BLOCK FIRST TO LAST``, each with ``P`` times.  Raises GcodeError when it names
    no program, or the line holds more.
    """
    last, part = token, ("", "")
    if token.head in CALLING:
        last = _named(token, stream)
        if stream.next is not None and stream.next.head == "BLOCK":
            stream.at += 1
            first = _label(token, stream)
            stream.at += stream.next is not None and stream.next.head == "TO"
            part = first, _label(token, stream)
    arguments = stream.arguments() if last.kind == "call" else ()
    name = re.split(r"[/\\:]", last.text.strip('"( \t'))[-1].upper().replace(" ", "")
    label = re.sub(r"[._](SPF|MPF)$", r".\1", name.removeprefix("_N_"))
    count = _times(token, stream, alone=alone)
    return Control(KIND + "call", label, token.column, count, arguments, part=part)


def _named(token: Token, stream: TokenStream) -> Token:
    """The token that names the program of CALL, EXTCALL or PCALL; empty before BLOCK."""
    name = stream.next
    while token.head == "PCALL" and name is not None and name.head != "P":
        stream.at += 1
        if name.kind == "call" or stream.next is None or stream.next.head == "P":
            return name
        name = stream.next
    if token.head == "CALL" and name is not None and name.head == "BLOCK":
        return replace(token, text="")
    if name is None or name.kind != "string" or token.head == "PCALL":
        raise stream.error(
            token, f'{token.head} needs the name of a program: write {token.head} "A"'
        )
    stream.at += 1
    if token.kind == "call" and not stream.skips(")"):
        raise stream.error(stream.next, "a ) is missing: add it")
    return name
