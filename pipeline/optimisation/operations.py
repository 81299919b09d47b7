"""Operations of a part program: what a machinist calls the moves at feed, row by row.

They are told from the kind of the move and its canned cycle, from comments and the names of tools
(FINISH, REAM, PROBE ...), and from the cut itself: what goes down, what is thin, what is full
width, what cuts nothing.  In doubt the operation is the one whose rule allows less.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import Operation
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.comments_in_force import CommentsInForce, comments_in_force
from pipeline.optimisation.operation_cuts import CODE, fill_from_cut, spots_only
from pipeline.optimisation.operation_words import comments_of, named_operation, says_roughing
from pipeline.optimisation.text.modal_words import reads_feed
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
"""Operations that a row may be of that is told as one without its cut; others are what is told."""
ROUGH_SHARE = 0.5
"""Share of the length of what one tool roughs at one F up to which cuts may be thin [1]."""


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
        there: Bools = np.isin(self.code, [CODE[name] for name in names])
        return there

    def of_parts(self, whole: NDArray[np.int8]) -> "Operations":
        """These operations of the parts of blocks, where ``whole`` (M,) are those of the blocks.

        A part is of its block's operation: its first part is no lead.  Only what of it is in air
        is that, and beside a slot there may be less than one.
        """
        own = self.of("air") | ((whole == CODE["slotting"]) & self.of("roughing"))
        return replace(self, code=np.where(own | (self.code < 0), self.code, whole))


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
    slender = fill_from_cut(code, moves, cut, blocks)
    known = dict(zip(cut.numbers, cut.tools, strict=True))
    return _told(code, program, moves, known, slender)


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
    """Operations with what cycles, comments and tools say of them; ``code`` is filled in."""
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
    """Fill in what a comment or a tool says of rows."""
    if tag is not None:
        code[rows & np.isin(code, _given_way(tag))] = CODE[tag]


def _given_way(tag: Operation) -> list[int]:
    """Numbers of the operations that give way to what a tool or a comment is called.

    What keeps F and S gives way only to what does so too, milling to all but roughing.
    """
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
    """Name of a tool, and what the program's head says of it."""
    return f"{'' if tool is None else tool.name}; {comment}"


def _of_tool(tool: Tool | None, about: str) -> Operation | None:
    """Operation that a tool is for, by its role and what :func:`_about` it is said."""
    named = named_operation(about)
    if tool is None or not tool.role or (tool.role == "face_mill" and named == "finishing"):
        return named
    return OF_ROLE[tool.role]


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
