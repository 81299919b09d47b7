"""Operations of a part program: the machinist's name of each move at feed, row by row.

Signs are the kind of the move and its canned cycle, comments and tool names (FINISH, REAM, PROBE),
and the cut itself.  In doubt the operation is the one whose rule allows less.

A comment holds up to the next that names an operation, up to the tool change after the moves or
calls below it, up to the end of its program, and in the subprograms called below it.  Comments
above the first tool change are a title and name no operation, but for those right above the change
with blocks before them.  Subprograms are those of a Fanuc, from O100 on below the main program, and
those of LinuxCNC, from ``o100 sub`` to ``o100 endsub``.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import Operation
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.operation_signs import (
    CODE,
    comments_of,
    fill_from_cut,
    named_operation,
    says_roughing,
    spots_only,
)
from pipeline.optimisation.text.editable_blocks import reads_feed
from pipeline.schema.arrays import Bools, Rows
from pipeline.twin.cut.blocks import CutBlocks
from pipeline.twin.cut.loads import Cut

CYCLES: dict[int, Operation] = {
    73: "deep_drilling", 83: "deep_drilling", 81: "drilling", 82: "drilling", 74: "tapping",
    84: "tapping", 76: "boring", 85: "boring", 86: "boring", 87: "boring", 88: "boring",
    89: "boring",
}  # fmt: skip
OF_ROLE: dict[str, Operation] = {
    "face_mill": "face_milling", "spot_drill": "centre_drilling", "reamer": "reaming",
    "centre_drill": "centre_drilling", "tap": "tapping", "thread_mill": "thread_milling",
    "chamfer_mill": "chamfering", "boring_bar": "boring", "engraver": "engraving",
    "probe": "probing", "countersink": "countersinking", "counterbore": "counterboring",
}  # fmt: skip
"""Operation that a tool is made for, by its role in the tool table."""
KEPT: tuple[Operation, ...] = (
    "tapping", "probing", "thread_milling", "reaming", "boring", "engraving",
)  # fmt: skip
"""Operations that keep F and S."""
MAY_BE: dict[Operation, tuple[Operation, ...]] = {
    "roughing": (
        "roughing", "slotting", "face_milling", "finishing", "ball_finishing", "lead", "ramping",
        "plunging",
    ),
    "finishing": ("finishing", "ball_finishing", "lead"),
    "face_milling": ("face_milling", "lead"),
}  # fmt: skip
"""Operations that a row may have whose operation is uncertain without its cut."""
ROUGH_SHARE = 0.5
"""Share of the length of what one tool roughs at one F up to which cuts may be thin [1]."""

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
        """Comments that name the operation of each row (M,), and those that there are."""
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
        return under[self.line] | called[self.caller]


def comments_in_force(program: Program, comments: tuple[str, ...], moves: Moves) -> CommentsInForce:
    """Comments in force in each row of a program.

    A subprogram is under its own comments and those of the lines that may have called it.
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
    """Lines that may have called each row (M,), and the groups of lines that there are."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Operations:
    """Operation of each of M rows."""

    code: NDArray[np.int8] = field(repr=False)
    """Place in :data:`OPERATIONS`; -1 for rows that do not move at feed; shape (M,)."""
    comments: CommentsInForce = field(repr=False)
    """Comments in force in each row."""
    tool_texts: dict[int, str] = field(repr=False)
    """Name of each tool and what the program's comments say of it, by its number."""

    def of(self, *names: Operation) -> Bools:
        """Rows with one of some operations; shape (M,)."""
        return np.isin(self.code, [CODE[name] for name in names])

    def of_parts(self, whole: NDArray[np.int8]) -> "Operations":
        """Operations of the parts of blocks, where ``whole`` (M,) are those of the blocks.

        A part is of its block's operation: no lead; only what of it is in air is that.
        """
        own = self.of("air") | ((whole == CODE["slotting"]) & self.of("roughing"))
        return replace(self, code=np.where(own | (self.code < 0), self.code, whole))


def operations(program: Program, moves: Moves, cut: Cut, blocks: CutBlocks) -> Operations:
    """Operation of each row of a program."""
    code = np.where(_fed(moves), CODE["air"], -1).astype(np.int8)
    slender = fill_from_cut(code, moves, cut, blocks)
    known = dict(zip(cut.numbers, cut.tools, strict=True))
    return _told(code, program, moves, known, slender)


def operations_without_cut(program: Program, moves: Moves, tools: Mapping[int, Tool]) -> Operations:
    """Operation of each row of a program as far as it is known without the cut.

    Rows without a sign are roughing, those of a drill drilling; see :data:`MAY_BE` for
    alternatives.
    """
    fed = _fed(moves)
    code = np.where(fed, CODE["roughing"], -1).astype(np.int8)
    for number, tool in tools.items():
        if tool.kind == "drill":
            name: Operation = "centre_drilling" if spots_only(tool) else "drilling"
            code[fed & (moves.tool == number)] = CODE[name]
    return _told(code, program, moves, tools, np.zeros(len(moves), dtype=np.bool_))


def _fed(moves: Moves) -> Bools:
    """Rows that move at feed, probe or cut a thread; shape (M,)."""
    fed: Bools = reads_feed(moves) & (moves.length > 0)
    return fed | np.isin(moves.kind, (Kind.PROBE, Kind.THREAD))


def _told(
    code: NDArray[np.int8], program: Program, moves: Moves, known: Mapping[int, Tool],
    slender: Bools,
) -> Operations:  # fmt: skip
    fed = _fed(moves)
    comments, by_tool = comments_of(program)
    in_force = comments_in_force(program, comments, moves)
    said, texts = in_force.naming()
    used = {
        number: _about(known.get(number), by_tool.get(number, ""))
        for number in np.unique(moves.tool).tolist()
    }
    rough = np.zeros(len(moves), dtype=np.bool_)
    for number, about in used.items():
        says = np.array([says_roughing(f"{text}; {about}") for text in texts])
        rough |= (moves.tool == number) & says[said]
    _fill_rough(code, moves, slender & rough, rough)
    by_depth = np.isin(code, (CODE["centre_drilling"], CODE["deep_drilling"]))
    for cycle, name in CYCLES.items():
        code[fed & (moves.code == cycle) & ~(by_depth & (name == "drilling"))] = CODE[name]
    for number, tag in enumerate(map(named_operation, texts)):
        _fill_tag(code, fed & (said == number), tag)
    for number, about in used.items():
        _fill_tag(code, fed & (moves.tool == number), _of_tool(known.get(number), about))
    code[fed & (moves.kind == Kind.PROBE)] = CODE["probing"]
    code[fed & (moves.kind == Kind.THREAD)] = CODE["tapping"]
    return Operations(code=code, comments=in_force, tool_texts=used)


def _fill_rough(code: NDArray[np.int8], moves: Moves, slender: Bools, rough: Bools) -> None:
    """Thin cuts that comments call roughing, where the tool cuts more than that at the same F."""
    cuts = rough & (code >= 0) & (code != CODE["air"])
    there = zip(moves.tool[slender].tolist(), moves.feed[slender].tolist(), strict=True)
    for tool, feed in set(there):
        mine = cuts & (moves.tool == tool) & (moves.feed == feed)
        if moves.length[mine & slender].sum() <= ROUGH_SHARE * moves.length[mine].sum():
            code[mine & slender] = CODE["roughing"]


def _fill_tag(code: NDArray[np.int8], rows: Bools, tag: Operation | None) -> None:
    if tag is not None:
        code[rows & np.isin(code, _given_way(tag))] = CODE[tag]


def _given_way(tag: Operation) -> list[int]:
    """Operations that give way to a tool's or comment's; what keeps F and S only to its like."""
    milling = [CODE["roughing"], CODE["slotting"], CODE["face_milling"]]
    if tag == "roughing":
        return []
    if tag in ("finishing", "face_milling"):
        return milling
    if tag == "drilling":
        return [*milling, CODE["plunging"]]
    kept: tuple[Operation, ...] = ("tapping", "probing")
    if tag not in KEPT:
        kept = KEPT
    if tag in ("centre_drilling", "countersinking", "counterboring", "deep_drilling"):
        kept += ("chamfering",)
    if tag in ("centre_drilling", "deep_drilling"):
        kept += ("air",)
    return [code for name, code in CODE.items() if name not in kept]


def _about(tool: Tool | None, comment: str) -> str:
    return f"{'' if tool is None else tool.name}; {comment}"


def _of_tool(tool: Tool | None, about: str) -> Operation | None:
    """Operation that a tool is for, by its role and what :func:`_about` it is said."""
    named = named_operation(about)
    if tool is None or not tool.role or (tool.role == "face_mill" and named == "finishing"):
        return named
    return OF_ROLE[tool.role]


def passes(operations: Operations, moves: Moves, rows: Bools) -> Rows:
    """Pass of each row among ``rows``, -1 for others: one tool at one programmed F; shape (M,)."""
    code = np.where(rows, operations.code, -1)
    keys = np.stack([code.astype(np.float64), moves.tool.astype(np.float64), moves.feed])
    fed = operations.code >= 0
    moving = np.flatnonzero(fed | (moves.kind == Kind.RAPID))
    new = np.ones(len(moving), dtype=np.bool_)
    new[1:] = (np.diff(keys[:, moving], axis=1) != 0).any(axis=0) | ~fed[moving][1:]
    out = np.full(len(moves), -1, dtype=np.intp)
    out[moving] = np.cumsum(new) - 1
    return np.where(rows, out, -1)
