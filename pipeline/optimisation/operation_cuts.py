"""Operations as the cut itself tells them: what goes down, what is thin, what is full width.

A cut is taken from where the tool enters the material to where it leaves it, goes straight down or
is lifted: its first and last rows may be leads, and one that is thin in most of its length is a
finishing cut.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS, SLOTTING_IMMERSION
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import STEEP, CutBlocks

CODE = {name: code for code, name in enumerate(OPERATIONS)}
"""Operation -> its number in arrays of rows; -1 is none."""
DESCENDS = float(np.sin(np.radians(0.25)))
"""|dz / ds| from which one that goes down is a ramp."""
THIN, THIN_SHARE = 0.5e-3, 0.1
"""Depth of cut up to which a cut is a finishing one: [m], and as a share of the diameter."""
LEAD = 2.0
"""Length over the diameter up to which a row that is partly in air leads in or out [1]."""
SPOTTING_POINT = 100.0
"""Greatest point angle of spot drills and countersinks that no twist drill has [deg]."""
WHOLE_CONE = 0.98
"""Depth over the height of a drill's cone from which on its full diameter cuts [1]."""


def spots_only(tool: Tool) -> bool:
    """Whether a tool of kind drill has the point of a spot drill or a countersink."""
    return tool.kind == "drill" and tool.point_angle_deg <= SPOTTING_POINT


def fill_from_cut(code: NDArray[np.int8], moves: Moves, cut: Cut, blocks: CutBlocks) -> Bools:
    """Fill in the operations of rows in the material; which of them are thin across alone.

    Parameters
    ----------
    code : ndarray of int8, shape (M,)
        Number of each row's operation; filled in.
    moves, cut, blocks : Moves, Cut, CutBlocks
        M rows, their cut, its blocks.

    Returns
    -------
    ndarray of bool, shape (M,)
        Rows that are told as finishing by their radial depth, with a greater axial one.
    """
    row = blocks.row
    slender = np.zeros(len(code), dtype=np.bool_)
    if not len(row):
        return slender
    diameter = np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    kind = np.array([tool.kind for tool in cut.tools])[blocks.tool]
    thin = np.minimum(THIN, THIN_SHARE * diameter)
    fine = np.minimum(blocks.axial_depth, blocks.radial_depth) <= thin
    finishing = np.where(kind == "ball", CODE["ball_finishing"], CODE["finishing"])
    fall = _fall(moves)[row]
    found = np.full(len(row), CODE["roughing"], dtype=np.int8)
    found[blocks.radial_depth >= SLOTTING_IMMERSION * diameter] = CODE["slotting"]
    begins = _begins(moves, cut)
    passes = np.cumsum(begins | (np.diff(moves.feed, prepend=-1.0) != 0)).astype(np.intp)[row]
    mostly = fine | _mostly(fine, passes, moves.length[row])
    found[mostly] = finishing[mostly]
    lead = _leads(moves, cut, blocks, np.cumsum(begins).astype(np.intp)[row])
    found[lead & (found != CODE["ball_finishing"])] = CODE["lead"]
    found[(fall > DESCENDS) & (found != CODE["ball_finishing"])] = CODE["ramping"]
    found[fall >= STEEP] = CODE["plunging"]
    drill, sideways = kind == "drill", np.abs(fall) < STEEP
    found[drill] = np.where(sideways[drill], CODE["chamfering"], CODE["drilling"])
    found[drill & ~sideways & _spots(moves, cut, blocks)] = CODE["centre_drilling"]
    code[row] = found
    slender[row] = (found == CODE["finishing"]) & (blocks.axial_depth > thin)
    return slender


def _fall(moves: Moves) -> Floats:
    """Height lost over the length of each row [1]; shape (M,)."""
    fall: Floats = (moves.start[:, 2] - moves.end[:, 2]) / np.maximum(moves.length, 1e-9)
    return fall


def _moving(moves: Moves) -> Rows:
    """Rows that move, and rapids."""
    return np.flatnonzero((moves.length > 0) | (moves.kind == Kind.RAPID))


def _begins(moves: Moves, cut: Cut) -> Bools:
    """Rows with which another cut begins, or a move that is none; shape (M,)."""
    moving = _moving(moves)
    inside = (cut.tool[moving] >= 0) & (np.abs(_fall(moves)[moving]) < STEEP)
    begins = np.zeros(len(moves), dtype=np.bool_)
    begins[moving] = ~inside | (np.diff(moves.tool[moving], prepend=-2) != 0)
    begins[moving[1:]] |= ~inside[:-1]
    return begins


def _mostly(rows: Bools, passes: Rows, length: Floats) -> Bools:
    """Blocks of a pass of which ``rows`` are at least half, by length."""
    share = np.bincount(passes, rows * length) / np.maximum(np.bincount(passes, length), 1e-12)
    most: Bools = share[passes] >= 0.5
    return most


def _leads(moves: Moves, cut: Cut, blocks: CutBlocks, cuts: Rows) -> Bools:
    """Blocks that lead in or out: the short ends of a cut, partly in air.

    An end is short up to :data:`LEAD` diameters and half of its cut.  A cut that is no longer than
    that altogether is a loop or a pass of its own between two moves in air; beside a rapid or a
    plunge it is a lead too.
    """
    row, length = blocks.row, moves.length[blocks.row] * 1e-3
    longest = LEAD * np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    in_air = length_in_air(cut, blocks)[row] > cut.engagement.resolution
    moving = _moving(moves)
    abrupt = (moves.kind == Kind.RAPID) | (np.abs(_fall(moves)) >= STEEP)
    place = np.searchsorted(moving, row)
    before = np.where(place > 0, abrupt[moving[place - 1]], True)
    after = moving[np.minimum(place + 1, len(moving) - 1)]
    behind = np.where(place + 1 < len(moving), abrupt[after], True)
    first = np.diff(cuts, prepend=-1) != 0
    last = np.diff(cuts, append=-1) != 0
    whole = np.bincount(cuts, length)[cuts]
    end = (first | last) & (length <= whole / 2)
    alone = (first & before) | (last & behind)
    lead: Bools = in_air & (length <= longest) & np.where(whole > longest, end, alone)
    return lead


def _spots(moves: Moves, cut: Cut, blocks: CutBlocks) -> Bools:
    """Blocks of a drill in holes that its full diameter does not reach, or that cannot drill."""
    half = np.array([np.tan(tool.point_angle / 2) for tool in cut.tools])
    cone = np.array([tool.radius for tool in cut.tools]) / half
    never = np.array([spots_only(tool) for tool in cut.tools])
    holes = np.column_stack([blocks.tool, np.round(moves.end[blocks.row, :2], 2)])
    hole = np.unique(holes, axis=0, return_inverse=True)[1].ravel()
    deepest = np.zeros(hole.max() + 1)
    np.maximum.at(deepest, hole, blocks.axial_depth)
    spots: Bools = deepest[hole] < WHOLE_CONE * cone[blocks.tool]
    return spots | never[blocks.tool]


def length_in_air(cut: Cut, blocks: CutBlocks) -> Floats:
    """Length of each row that cuts nothing at feed [m]; shape (M,)."""
    length = cut.plan.path.moves.length * 1e-3
    inside = np.zeros(len(length))
    time = blocks.air + blocks.seconds
    inside[blocks.row] = np.divide(blocks.seconds, time, out=np.zeros(len(time)), where=time > 0)
    outside: Floats = length * (1 - inside)
    return outside


def long_in_air(cut: Cut, blocks: CutBlocks) -> Bools:
    """Rows that leave the cut for more than a lead-out; shape (M,)."""
    diameter = np.array([tool.diameter for tool in cut.tools] or [0.0])
    return length_in_air(cut, blocks) > LEAD * diameter[cut.tool]
