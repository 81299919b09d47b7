"""Operations of a part program: what a machinist calls the moves at feed, row by row.

They are told from the kind of the move and its canned cycle, from comments and the names of tools
(FINISH, REAM, PROBE ...), and from the cut itself: what goes down, what is thin, what is full
width, what cuts nothing.  In doubt the operation is the one whose rule allows less.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS, SLOTTING_IMMERSION, Operation
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program, TokenKind
from pipeline.optimisation.problem.arrays import Rows
from pipeline.optimisation.text.modal_words import reads_feed
from pipeline.schema.arrays import Bools, Floats
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks

CODE = {name: code for code, name in enumerate(OPERATIONS)}
"""Operation -> its number in arrays of rows; -1 is none."""

WORDS: tuple[tuple[Operation, str], ...] = (
    ("probing", r"PROB(E|ES|ING)\b"),
    ("thread_milling", r"THREAD[ -]?MILL|\bTHREADING\b|GEWINDEFR"),
    ("tapping", r"\bTAP(S|PING)?\b|GEWINDEBOHR"),
    ("reaming", r"\bREAM|\bREIB"),
    ("boring", r"\bBOR(E|ING)\b|AUSDREH"),
    ("centre_drilling", r"\bSPOT|\bCENT(ER|RE)[ -]?DRILL|ZENTRIER"),
    ("deep_drilling", r"\bDEEP[ -]?(HOLE|DRILL)|\bGUN[ -]?DRILL|TIEFBOHR|TIEFLOCH"),
    ("chamfering", r"\bCHAMFER|\bDEBURR|\bFASEN?\b|ENTGRAT"),
    ("engraving", r"\bENGRAV|GRAVIER"),
    ("drilling", r"DRILL(S|ING)?\b"),
    ("face_milling", r"\bFACE ?MILL|\bFACING\b|PLANFR"),
    ("finishing", r"\bFINISH|\bSCHLICHT"),
)
"""Operations with the words that name them in comments and names of tools, the first that fits."""
_WORDS = tuple((name, re.compile(words, re.IGNORECASE)) for name, words in WORDS)
_TOOL = re.compile(r"\bT(?:OOL)?\s*0*(\d+)\b", re.IGNORECASE)

CYCLES: dict[int, Operation] = {
    73: "deep_drilling", 83: "deep_drilling", 81: "drilling", 82: "drilling", 74: "tapping",
    84: "tapping", 76: "boring", 85: "boring", 86: "boring", 87: "boring", 88: "boring",
    89: "boring",
}  # fmt: skip
OF_ROLE: dict[str, Operation] = {
    "face_mill": "face_milling", "spot_drill": "centre_drilling", "reamer": "reaming",
    "centre_drill": "centre_drilling", "tap": "tapping", "thread_mill": "thread_milling",
    "chamfer_mill": "chamfering", "boring_bar": "boring", "engraver": "engraving",
    "probe": "probing",
}  # fmt: skip
"""Operation that a tool is made for, by its role in the tool table."""
MAY_BE: dict[Operation, tuple[Operation, ...]] = {
    "roughing": (
        "roughing", "slotting", "face_milling", "finishing", "ball_finishing", "lead", "ramping",
        "plunging",
    ),
    "finishing": ("finishing", "ball_finishing", "lead"),
    "face_milling": ("face_milling", "lead"),
}  # fmt: skip
"""Operations that a row may be of that is told as one without its cut; others are what is told."""
STEEP = float(np.sqrt(0.5))
"""|dz / ds| from which a motion in the material is a plunge."""
DESCENDS = float(np.sin(np.radians(0.25)))
"""|dz / ds| from which one that goes down is a ramp."""
THIN, THIN_SHARE = 0.5e-3, 0.1
"""Depth of cut up to which a cut is a finishing one: [m], and as a share of the diameter."""
LEAD = 2.0
"""Length over the diameter up to which a row that is partly in air leads in or out [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Operations:
    """Operation of each of M rows.

    Parameters
    ----------
    code : ndarray of int8, shape (M,)
        Place in :data:`OPERATIONS`; -1 for rows that do not move at feed.
    tag : tuple of str
        Words of the comments above each line of the program, L + 1 of them, line 0 unused.
    """

    code: NDArray[np.int8] = field(repr=False)
    tag: tuple[str, ...] = field(repr=False)

    def of(self, *names: Operation) -> Bools:
        """Rows with one of some operations; shape (M,)."""
        there: Bools = np.isin(self.code, [CODE[name] for name in names])
        return there


def named_operation(text: str) -> Operation | None:
    """Operation that a comment or the name of a tool speaks of.

    Examples
    --------
    >>> [named_operation(name) for name in ("10H7 REAMER", "8.5 DRILL", "16MM ENDMILL")]
    ['reaming', 'drilling', None]
    """
    return next((name for name, words in _WORDS if words.search(text)), None)


def operations(program: Program, moves: Moves, cut: Cut, blocks: CutBlocks) -> Operations:
    """Operation of each row of a program.

    Parameters
    ----------
    program : Program
        Text, for its comments.
    moves : Moves
        The program as interpreted, M rows.
    cut : Cut
        Of those rows.
    blocks : CutBlocks
        Its blocks that cut.
    """
    code = np.where(_fed(moves), CODE["air"], -1).astype(np.int8)
    _fill_milling(code, moves, cut, blocks)
    return _told(code, program, moves, dict(zip(cut.numbers, cut.tools, strict=True)))


def told_operations(program: Program, moves: Moves, tools: Mapping[int, Tool]) -> Operations:
    """Operation of each row of a program as far as it is known without the cut.

    What neither a cycle nor a comment nor the tool tells is roughing, that of a drill drilling; see
    :data:`MAY_BE` for what such a row may be.

    Parameters
    ----------
    program, moves : Program, Moves
        As in :func:`operations`.
    tools : mapping of int to Tool
        By their number, those of the program that are known.
    """
    fed = _fed(moves)
    code = np.where(fed, CODE["roughing"], -1).astype(np.int8)
    drills = [number for number, tool in tools.items() if tool.kind == "drill"]
    code[fed & np.isin(moves.tool, drills)] = CODE["drilling"]
    return _told(code, program, moves, tools)


def _fed(moves: Moves) -> Bools:
    """Rows that move at feed, probe or cut a thread; shape (M,)."""
    fed: Bools = reads_feed(moves) & (moves.length > 0)
    return fed | np.isin(moves.kind, (Kind.PROBE, Kind.THREAD))


def _told(
    code: NDArray[np.int8], program: Program, moves: Moves, known: Mapping[int, Tool]
) -> Operations:
    """Operations with what cycles, comments and tools say of them; ``code`` is filled in."""
    fed = _fed(moves)
    comments, by_tool = _comments(program)
    for cycle, name in CYCLES.items():
        code[fed & (moves.code == cycle)] = CODE[name]
    _fill_named(code, fed & (moves.file == 0), _tags(comments, moves), moves.line)
    for number in np.unique(moves.tool).tolist():
        mine = fed & (moves.tool == number)
        tag = _of_tool(known.get(number), by_tool.get(number, ""))
        if tag is None:
            continue
        code[mine & np.isin(code, _given_way(tag))] = CODE[tag]
    code[fed & (moves.kind == Kind.PROBE)] = CODE["probing"]
    code[fed & (moves.kind == Kind.THREAD)] = CODE["tapping"]
    return Operations(code=code, tag=comments)


def _given_way(tag: Operation) -> list[int]:
    """Numbers of the operations that give way to what a tool or a comment is called."""
    milling = [CODE["roughing"], CODE["slotting"], CODE["face_milling"]]
    if tag in ("finishing", "face_milling"):
        return milling
    if tag == "drilling":
        return [*milling, CODE["plunging"], CODE["finishing"]]
    kept = [CODE["tapping"], CODE["probing"]]
    if tag in ("centre_drilling", "deep_drilling"):
        kept += [CODE["boring"], CODE["air"]]
    return [code for code in CODE.values() if code not in kept]


def _fill_milling(code: NDArray[np.int8], moves: Moves, cut: Cut, blocks: CutBlocks) -> None:
    """Fill in what the cut says of rows in the material."""
    row = blocks.row
    if not len(row):
        return
    diameter = np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    kind = np.array([tool.kind for tool in cut.tools])[blocks.tool]
    thin = np.minimum(THIN, THIN_SHARE * diameter)
    fine = np.minimum(blocks.axial_depth, blocks.radial_depth) <= thin
    length = moves.length[row] * 1e-3
    time = blocks.air + blocks.seconds
    in_air = np.divide(blocks.air, time, out=np.zeros(len(row)), where=time > 0) * length
    fall = (moves.start[row, 2] - moves.end[row, 2]) / np.maximum(moves.length[row], 1e-9)
    found = np.full(len(row), CODE["roughing"], dtype=np.int8)
    found[blocks.radial_depth >= SLOTTING_IMMERSION * diameter] = CODE["slotting"]
    found[fine] = CODE["finishing"]
    found[fine & (kind == "ball")] = CODE["ball_finishing"]
    lead = (in_air > cut.engagement.resolution) & (length <= LEAD * diameter)
    found[lead & (found != CODE["ball_finishing"])] = CODE["lead"]
    found[(fall > DESCENDS) & (found != CODE["ball_finishing"])] = CODE["ramping"]
    found[fall >= STEEP] = CODE["plunging"]
    found[kind == "drill"] = CODE["drilling"]
    code[row] = found


def _fill_named(
    code: NDArray[np.int8], rows: Bools, tags: tuple[Operation | None, ...], line: NDArray[np.int32]
) -> None:
    """Fill in what comments say of rows of the program's own lines."""
    numbers = np.array([-1 if tag is None else CODE[tag] for tag in tags], dtype=np.int8)
    named = np.where(rows, numbers[np.where(rows, line, 0)], -1)
    for tag in {tag for tag in tags if tag is not None}:
        code[(named == CODE[tag]) & np.isin(code, _given_way(tag))] = CODE[tag]


def _comments(program: Program) -> tuple[tuple[str, ...], dict[int, str]]:
    """Comments of each line (L + 1), and of tools by their number."""
    tokens, lines = program.tokens, [""] * (len(program) + 1)
    by_tool: dict[int, str] = {}
    line_of = np.repeat(np.arange(1, len(program) + 1), np.diff(tokens.first))
    there = np.flatnonzero(np.isin(tokens.kind, (TokenKind.COMMENT, TokenKind.REMARK)))
    for at in there.tolist():
        text = program.data[tokens.start[at] : tokens.start[at + 1]].decode("latin-1").strip("(); ")
        number = _TOOL.search(text)
        if number is None:
            lines[line_of[at]] = f"{lines[line_of[at]]} {text}".strip()
        else:
            by_tool[int(number[1])] = f"{by_tool.get(int(number[1]), '')} {text}".strip()
    return tuple(lines), by_tool


def _tags(comments: tuple[str, ...], moves: Moves) -> tuple[Operation | None, ...]:
    """Operation that the last comment before each line names (L + 1).

    A comment holds up to the next that names an operation, and up to the tool change after the
    moves that it stands above.
    """
    many = len(comments)
    own = moves.file == 0
    changes, feeds = np.zeros((2, many), dtype=np.bool_)
    changes[moves.line[own & (moves.kind == Kind.TOOL_CHANGE)]] = True
    feeds[moves.line[own & reads_feed(moves)]] = True
    tags: list[Operation | None] = [None] * many
    tag: Operation | None = None
    used = False
    for line in range(1, many):
        if changes[line] and used:
            tag = None
        named = named_operation(comments[line]) if comments[line] else None
        if named is not None:
            tag, used = named, False
        elif changes[line]:
            used = False
        used = used or bool(feeds[line])
        tags[line] = tag
    return tuple(tags)


def _of_tool(tool: Tool | None, comment: str) -> Operation | None:
    """Operation that a tool is for, by its role, its name and what the program's head says."""
    if tool is not None and tool.role:
        return OF_ROLE[tool.role]
    return named_operation(f"{'' if tool is None else tool.name} {comment}")


def passes(operations: Operations, moves: Moves, rows: Bools) -> Rows:
    """Number of the pass of each row among ``rows``, -1 for others; shape (M,).

    A pass is what one tool cuts at one programmed F between two rows that are not of it: the walls
    of one contour.
    """
    code = np.where(rows, operations.code, -1)
    keys = np.stack([code.astype(np.float64), moves.tool.astype(np.float64), moves.feed])
    fed = operations.code >= 0
    moving = np.flatnonzero(fed | (moves.kind == Kind.RAPID))
    new = np.ones(len(moving), dtype=np.bool_)
    new[1:] = (np.diff(keys[:, moving], axis=1) != 0).any(axis=0) | ~fed[moving][1:]
    out = np.full(len(moves), -1, dtype=np.intp)
    out[moving] = np.cumsum(new) - 1
    return np.where(rows, out, -1)


def length_in_air(cut: Cut, blocks: CutBlocks) -> Floats:
    """Length of each row that cuts nothing at feed [m]; shape (M,)."""
    length = cut.plan.path.moves.length * 1e-3
    inside = np.zeros(len(length))
    time = blocks.air + blocks.seconds
    inside[blocks.row] = np.divide(blocks.seconds, time, out=np.zeros(len(time)), where=time > 0)
    outside: Floats = length * (1 - inside)
    return outside
