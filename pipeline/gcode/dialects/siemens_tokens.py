"""Tokens of a line of a Sinumerik 840D program, and its expressions.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, "Block rules" and "Value assignments".
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

from pipeline.gcode.errors import GcodeError, strange_character
from pipeline.gcode.statements import Binary, Call, Expression, Number, Parameter, Unary

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
COMPARED = {
    "==": "ALIKE", "<>": "UNLIKE", "<": "BELOW", "<=": "ABOVE", ">": "ABOVE", ">=": "BELOW"
}  # fmt: skip
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
