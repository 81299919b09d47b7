"""Comments of a part program in force in each row: how far a comment holds.

A comment holds up to the next that names an operation, up to the tool change after the moves or
calls that it stands above, up to the end of its program, and in the subprograms that are called
below it.  What stands above the first tool change is a title, DRILL AND TAP M8, and names no
operation, but for comments right above the change with blocks before them, as CAM systems write
the first operation's.  Subprograms are those of a Fanuc, from O100 on below the main program, and
those of LinuxCNC, from ``o100 sub`` to ``o100 endsub`` wherever they stand.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.operation_words import named_operation
from pipeline.optimisation.text.modal_words import reads_feed
from pipeline.schema.arrays import Bools, Rows

_PROGRAM = re.compile(rb"\s*(N\d+\s*)?[O:]\d+\s*(\(|;|$)", re.IGNORECASE)
_SUB = re.compile(rb"\s*(?:N\d+\s*)?O\s*(\d+|<[^>]*>)\s*(END)?SUB(?![A-Z])", re.IGNORECASE)
_CALL = re.compile(rb"^[^(;]*((?<![A-Z])(M1?98|G6[56])(?!\d)|CALL)", re.IGNORECASE)
_REMARK = re.compile(rb"\s*([(;]|$)")
_NO_BLOCK = re.compile(rb"\s*(N\d+\s*)?([(;%]|$)", re.IGNORECASE)
_TOOL_WORD = re.compile(rb"\s*(N\d+\s*)?T\s*=?\s*(\d+|\"[^\"]*\")\s*([(;]|$)", re.IGNORECASE)
"""A line that is no block of the program, and one that only selects a tool."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CommentsInForce:
    """Comments in force in M rows of a program with L lines."""

    comments: tuple[str, ...] = field(repr=False)
    """Comments of each line, L + 1 of them, line 0 unused."""
    main: Bools = field(repr=False)
    """Lines of the main program; shape (L + 1,)."""
    begin: Rows = field(repr=False)
    """Line of the first comment in force in each line; above the line where there is none;
    shape (L + 1,)."""
    head: Rows = field(repr=False)
    """Line of the comment in force that names an operation, 0 where there is none;
    shape (L + 1,)."""
    line: Rows = field(repr=False)
    """Line of each row, 0 for those of other files; shape (M,)."""
    caller: Rows = field(repr=False)
    """Place in ``callers`` of each row; shape (M,)."""
    callers: tuple[tuple[int, ...], ...] = field(repr=False)
    """Lines that may have called a subprogram; the first are none, of the main program."""

    def naming(self) -> tuple[Rows, tuple[str, ...]]:
        """Which comments name the operation of each row (M,), and those that there are."""
        many = len(self.comments)
        keys, place = np.unique(self.caller * many + self.head[self.line], return_inverse=True)
        texts, said = {"": 0}, np.zeros(len(keys), dtype=np.intp)
        for key, (caller, head) in enumerate(divmod(one, many) for one in keys.tolist()):
            heads = (*(int(self.head[call]) for call in self.callers[caller]), head)
            text = "; ".join(dict.fromkeys(self.comments[line] for line in heads if line))
            said[key] = texts.setdefault(text, len(texts))
        return said[place], tuple(texts)

    def below(self, word: str) -> Bools:
        """Rows in which a comment with a word is in force; shape (M,)."""
        lines = np.arange(len(self.comments))
        there = np.array([word.casefold() in comment.casefold() for comment in self.comments])
        every = np.maximum.accumulate(np.where(there, lines, -1))
        own = np.maximum.accumulate(np.where(there & self.main, lines, -1))
        under = np.where(self.main, own, every) >= self.begin
        called = np.array([under[list(calls)].any() for calls in self.callers])
        rows: Bools = under[self.line] | called[self.caller]
        return rows


def comments_in_force(program: Program, comments: tuple[str, ...], moves: Moves) -> CommentsInForce:
    """Comments in force in each row of a program.

    A subprogram is under its own comments and those of the lines that may have called it: of the
    calls between the rows of the main program before and after it.

    ``comments``: those of its L lines, L + 1 of them.
    """
    own = moves.file == 0
    lines = program.data.splitlines()
    body = _bodies(lines, len(comments), int(moves.line[own][0]) if own.any() else 0)
    calls = [k for k, line in enumerate(lines, 1) if _CALL.search(line) and not _SUB.match(line)]
    begin, head = _scopes(lines, comments, moves, body, calls)
    from_main = [call for call in calls if body[call] == 0]
    caller, callers = _callers(moves, own & (body[moves.line * own] == 0), from_main, len(comments))
    return CommentsInForce(
        comments=comments, main=body == 0, begin=begin, head=head,
        line=np.where(own, moves.line, 0).astype(np.intp), caller=caller, callers=callers,
    )  # fmt: skip


def _bodies(lines: list[bytes], many: int, begins: int) -> Rows:
    """Line of the head of the subprogram that each line belongs to, 0 in the main one; (L + 1,)."""
    body = np.zeros(many, dtype=np.intp)
    head, label = 0, b""
    for k, line in zip(range(1, many), lines, strict=False):
        sub = _SUB.match(line)
        if sub is not None and sub[2] is None and not label:
            head, label = k, _label(sub[1])
        elif not label and k > begins and _PROGRAM.match(line):
            head = k
        body[k] = head
        if sub is not None and sub[2] is not None and _label(sub[1]) == label:
            head, label = 0, b""
    return body


def _label(text: bytes) -> bytes:
    """Label of an O-word, however it is written."""
    return b"".join(text.lower().split()).lstrip(b"0") or b"0"


@dataclass
class _Scope:
    """Comments in force at a line of a program, while its lines are read."""

    begin: int
    head: int = 0
    used: bool = False
    last: int = 0


def _scopes(
    lines: list[bytes], comments: tuple[str, ...], moves: Moves, body: Rows, calls: list[int]
) -> tuple[Rows, Rows]:
    """First comment in force in each line, and the one that names an operation; (L + 1,) each."""
    own = moves.file == 0
    changes = set(moves.line[own & (moves.kind == Kind.TOOL_CHANGE)].tolist())
    first = min((change for change in changes if body[change] == 0), default=0)
    feeds = set(moves.line[own & reads_feed(moves)].tolist()) | set(calls)
    begin, head = np.ones((2, len(comments)), dtype=np.intp)
    head[0] = 0
    main = scope = _Scope(1)
    for line in range(1, len(comments)):
        if body[line] == 0:
            scope = main
        elif body[line] == line:
            scope = _entered(lines, line, main)
        if line in changes and scope.used:
            scope.begin, scope.head = scope.last + 1, 0
        if line == first and _title(lines, scope.head, line):
            scope.head = 0
        if named_operation(comments[line]) is not None:
            scope.begin = scope.head = line
            scope.used = False
        elif line in changes:
            scope.used = False
        if line in feeds:
            scope.used, scope.last = True, line
        begin[line], head[line] = scope.begin, scope.head
    return begin, head


def _title(lines: list[bytes], head: int, change: int) -> bool:
    """Whether the comment in line ``head`` above the first tool change is the program's title."""

    def blocks(some: list[bytes]) -> bool:
        return any(not (_NO_BLOCK.match(line) or _PROGRAM.match(line)) for line in some)

    between = [line for line in lines[head : change - 1] if not _TOOL_WORD.match(line)]
    return blocks(between) or not blocks(lines[:head])


def _entered(lines: list[bytes], line: int, main: _Scope) -> _Scope:
    """Comments in force where a subprogram begins: those right above ``sub`` are its title."""
    first = line
    while _SUB.match(lines[line - 1]) and first > 1 and _REMARK.match(lines[first - 2]):
        first -= 1
    begin = max(first, main.begin) if first < line else line
    return _Scope(begin, main.head if main.head >= begin else 0)


def _callers(
    moves: Moves, main: Bools, calls: list[int], end: int
) -> tuple[Rows, tuple[tuple[int, ...], ...]]:
    """Which lines may have called each row (M,), and the groups of lines that there are."""
    groups: dict[tuple[int, ...], int] = {(): 0}
    caller = np.zeros(len(moves), dtype=np.intp)
    outside = np.flatnonzero(~main)
    for run in np.split(outside, np.flatnonzero(np.diff(outside) != 1) + 1):
        if not len(run):
            continue
        before, after = int(run[0]) - 1, int(run[-1]) + 1
        first = int(moves.line[before]) if before >= 0 else 1
        last = int(moves.line[after]) if after < len(moves) else end
        lines = tuple(call for call in calls if first <= call < last) or (first,)
        caller[run] = groups.setdefault(lines, len(groups))
    return caller, tuple(groups)
