"""Tokens of a line of a Sinumerik 840D program, its expressions, and its flow control.

Branches, loops, jumps, repeated parts and calls of subprograms are followed; computed jumps (CASE,
GOTOC, GOTOS) are refused.  Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Block
rules" and "Value assignments", Job Planning, "Control structures", "Repeat program part" and
"Subprograms".
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace

from pipeline.gcode.errors import GcodeError, strange_character
from pipeline.gcode.program import Program
from pipeline.gcode.statements import (
    Assignment,
    Binary,
    Call,
    Control,
    Expression,
    Number,
    Parameter,
    Unary,
)

DEEPEST = 60
"""Brackets and signs within each other in an expression."""
VARIABLE = "def "
"""Prefix of variable names, which keeps them apart from those that other dialects predefine."""
ARGUMENT = f"{VARIABLE}argument "
"""Prefix of the number of an argument: variables whose names no program can write."""
R_PARAMETER = re.compile(r"r(\d{1,3})")
"""R0 to R999, which exist without a definition."""
LONGEST = 512
"""Characters of a block without its comment."""
COMPARED = {"==": "ALIKE", "<>": "UNLIKE", "<": "BELOW", "<=": "ABOVE", ">": "ABOVE", ">=": "BELOW"}
"""Comparison as written -> in the tree."""
NEGATED = frozenset({"<=", ">="})
"""Comparisons that are another one's contrary."""
BEFORE_BRACKETS = frozenset({"AND", "OR", "NOT", "MOD", "DIV", "IF", "WHILE", "UNTIL", "TO"})
"""Words that are no functions, though a bracket may follow them."""
PRODUCTS = {"*": "*", "/": "/", "MOD": "REM", "DIV": "/"}
FUNCTIONS = {
    **{name: name for name in ("SIN", "COS", "TAN", "ASIN", "ACOS", "SQRT", "ABS", "LN", "EXP")},
    "ROUND": "ROUND",
    "TRUNC": "FIX",
    "ATAN2": "ATAN",
}
"""Function as written -> in the tree."""
TRUTH = {"TRUE": 1.0, "FALSE": 0.0}
OMITTED = Number(0.0)
"""An argument that a call leaves out; it counts 0 where nothing else is said."""
WITH_TWO = frozenset({"ATAN2"})
# a name begins with two letters, so that G0X10 is two words
_TOKEN = re.compile(
    r"""(?P<blank>[ \t\v\f\x00\x11-\x14\x1a\x7f\r\n]+)
    |(?P<comment>;.*)
    |(?P<string>"[^"]*")
    |(?P<label>(?P<mark>[A-Z_][A-Z_][A-Z0-9_]*)[ \t]*:(?!=))
    |(?P<set>(?P<target>[A-Z]\d*|[A-Z_$][A-Z_$][A-Z0-9_]*)[ \t]*=(?!=))
    |(?P<call>(?P<function>[A-Z_$][A-Z0-9_]*)[ \t]*\()
    |(?P<address>(?P<letter>[A-Z])[ \t]*(?P<value>[-+]?(?:\d+\.?\d*|\.\d+))(?![0-9_.]))
    |(?P<name>[A-Z_$][A-Z0-9_]*)
    |(?P<number>\d+\.?\d*|\.\d+)
    |(?P<sign><=|>=|<>|==|[-+*/(),<>])""",
    re.X | re.S | re.I,
)


def variable(name: str) -> str:
    """The key by which a variable is kept; R01 is R1."""
    lower = name.lower()
    r = R_PARAMETER.fullmatch(lower)
    return VARIABLE + (f"r{int(r[1])}" if r else lower)


@dataclass(frozen=True, slots=True)
class Token:
    """A piece of a line; ``column`` counts from 1."""

    kind: str
    text: str
    column: int
    head: str
    value: float


class TokenStream:
    """The tokens of a line, to be taken from left to right.

    Raises
    ------
    GcodeError
        At a character that begins nothing.
    """

    __slots__ = ("at", "comments", "file", "line", "tokens")

    def __init__(self, text: str, line: int, file: str, start: int = 0) -> None:
        self.file, self.line, self.at = file, line, 0
        self.tokens: list[Token] = []
        self.comments: list[str] = []
        if len(text.split(";", 1)[0]) > start + LONGEST:
            raise self.error(
                None, f"a block of more than {LONGEST} characters is not read: write several"
            )
        while start < len(text):
            match = _TOKEN.match(text, start)
            if match is None:
                reason = "this character has no meaning here: correct it"
                if text[start] == "[":
                    reason = "fields and texts are not followed: use a variable for each value"
                reason = strange_character(text, start) or reason
                raise self.error(Token("", text[start], start + 1, "", 0.0), reason)
            kind = next(kind for kind in _KINDS if match[kind] is not None)
            if kind == "comment":
                self.comments.append(match[0][1:])
            elif kind != "blank":
                heads = ("mark", "target", "function", "letter", "name")
                head = next((match[part] for part in heads if match[part]), "")
                value = float(match["value"] or match["number"] or 0.0)
                text_read, head = match[0].rstrip(), head.upper()
                if kind == "call" and head in BEFORE_BRACKETS:  # no function: AND (R1 == 2)
                    self.tokens.append(Token("name", text_read[:-1].rstrip(), start + 1, head, 0.0))
                    kind, text_read, head = "sign", "(", ""
                self.tokens.append(Token(kind, text_read, start + 1, head, value))
            start = match.end()

    @property
    def next(self) -> Token | None:
        """The token that comes next; None at the end."""
        return self.tokens[self.at] if self.at < len(self.tokens) else None

    def take(self) -> Token:
        """The next token, which is then behind; there must be one."""
        token = self.tokens[self.at]
        self.at += 1
        return token

    def skips(self, sign: str) -> bool:
        """Whether a sign comes next; then it is behind."""
        comes = self.next is not None and self.next.text == sign
        self.at += comes
        return comes

    def error(self, token: Token | None, reason: str) -> GcodeError:
        """The error about a token, or about the end of the line."""
        column, word = (token.column, token.text) if token else (1, "end of line")
        return GcodeError(self.file, self.line, column, word, reason)

    def arguments(self, *, texts: bool = False) -> tuple[Expression, ...]:
        """Arguments up to the closing bracket of a call; left out ones, and ``texts``, count 0."""
        given: list[Expression] = []
        if self.skips(")"):
            return ()
        while True:
            self.at += texts and self.next is not None and self.next.kind == "string"
            empty = self.next is not None and self.next.text in (",", ")")
            given.append(OMITTED if empty else self.expression())
            if self.skips(")"):
                return tuple(given)
            if not self.skips(","):
                raise self.error(self.next, "a comma or ) is expected here: correct the call")

    def condition(self, depth: int = 0) -> Expression:
        """Comparisons joined by AND, and these by OR.

        Beside AND, OR and NOT the control binds comparisons last, so that they need brackets.
        """
        return self._joined("OR", depth, lambda: self._joined("AND", depth, self._compared(depth)))

    def _joined(self, word: str, depth: int, part: Callable[[], Expression]) -> Expression:
        first = self.at
        left = part()
        while self.next is not None and self.next.kind == "name" and self.next.head == word:
            joint = self.take()
            second = self.at
            right = part()
            if self._compares(first, second - 1) or self._compares(second, self.at):
                raise self.error(
                    joint,
                    f"{word} binds before == and < on the control: write each comparison in ( )",
                )
            left = Binary(word, left, right)
        return left

    def _compares(self, start: int, stop: int) -> bool:
        """Whether tokens hold a comparison outside of brackets."""
        depth = 0
        for token in self.tokens[start:stop]:
            depth += (token.text == "(" or token.kind == "call") - (token.text == ")")
            if depth == 0 and token.text in COMPARED:
                return True
        return False

    def _compared(self, depth: int) -> Callable[[], Expression]:
        def one() -> Expression:
            if self.next is not None and self.next.head == "NOT":
                negation, first = self.take(), self.at
                if self.next is not None and self.next.head == "NOT":
                    raise self.error(self.next, "NOT stands behind NOT: delete both")
                operand = one()
                if self._compares(first, self.at):
                    raise self.error(
                        negation, "NOT binds before == and < on the control: write NOT ( )"
                    )
                return Binary("EQ", operand, Number(0.0))
            if self.next is not None and self.next.text == "(" and self._holds_condition():
                self.at += 1
                inner = self.condition(self._deeper(depth))
                self._close()
                return inner
            left = self.expression(depth)
            sign = self.next
            if sign is None or sign.text not in COMPARED:
                return left
            self.at += 1
            compared = Binary(COMPARED[sign.text], left, self.expression(depth))
            negated = sign.text in NEGATED
            return Binary("EQ", compared, Number(0.0)) if negated else compared

        return one

    def _holds_condition(self) -> bool:
        """Whether the bracket that comes next holds a comparison, AND, OR or NOT."""
        depth = 0
        for token in self.tokens[self.at :]:
            depth += (token.text == "(" or token.kind == "call") - (token.text == ")")
            if depth == 0:
                return False
            if token.text in COMPARED or token.head in ("AND", "OR", "NOT"):
                return True
        return False

    def _deeper(self, depth: int) -> int:
        if depth >= DEEPEST:
            raise self.error(
                self.next, f"more than {DEEPEST} brackets lie in each other: shorten it"
            )
        return depth + 1

    def expression(self, depth: int = 0) -> Expression:
        """A sum of products."""
        left = self._product(depth)
        while self.next is not None and self.next.text in ("+", "-") and not self._apart():
            operator = self.take().text
            left = Binary(operator, left, self._product(depth))
        return left

    def _apart(self) -> bool:
        """Whether a sign opens nothing, as at the end of the line."""
        return self.at + 1 >= len(self.tokens)

    def _product(self, depth: int) -> Expression:
        left = self._factor(depth)
        while self.next is not None and self.next.text.upper() in PRODUCTS:
            word = self.take().text.upper()
            left = Binary(PRODUCTS[word], left, self._factor(depth))
            left = Call("FIX", (left,)) if word == "DIV" else left
        return left

    def _factor(self, depth: int) -> Expression:
        token = self.next
        if depth > DEEPEST:
            raise self.error(token, f"more than {DEEPEST} brackets lie in each other: shorten it")
        if token is None:
            raise self.error(None, "a value is missing at the end: add it")
        self.at += 1
        if token.text in ("+", "-"):
            return Unary(token.text, self._factor(depth + 1))
        if token.text == "(":
            inner = self.expression(depth + 1)
            self._close()
            return inner
        if token.kind == "number":
            return Number(token.value)
        if token.kind == "call" and token.head in FUNCTIONS:
            inner = self.expression(depth + 1)
            second = token.head in WITH_TWO
            if second and not self.skips(","):
                raise self.error(self.next, f"{token.head} takes two values: add a comma and one")
            other = (self.expression(depth + 1),) if second else ()
            self._close()
            return Call(FUNCTIONS[token.head], (inner, *other))
        if token.kind == "call" and token.head == "POT":
            inner = self.expression(depth + 1)
            self._close()
            return Binary("**", inner, Number(2.0))
        if token.kind == "name" and token.head in TRUTH:
            return Number(TRUTH[token.head])
        if token.kind == "name" or (token.kind == "address" and token.text[1:].isdigit()):
            return Parameter(variable(token.text))
        raise self.error(token, "this is no value: use numbers, variables, + - * / and ( )")

    def _close(self) -> None:
        if not self.skips(")"):
            raise self.error(self.next, "a ) is missing: add it")


_KINDS = ("blank", "comment", "string", "label", "set", "call", "address", "name", "number", "sign")


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
