"""Operations by the cut itself: plunges, thin cuts, full width.

A cut reaches from where the tool enters the material to where it leaves it, plunges or is lifted;
its first and last rows may be leads.
"""

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS, SLOTTING_IMMERSION
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut.blocks import STEEP, CutBlocks
from pipeline.twin.cut.loads import Cut

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
DEEP_HOLE = 3.0
"""Depth of a hole over its diameter from which tables of drills reduce speed and feed [1]
(catalogue source ``deep_holes``)."""
SAME_HOLE = 2e-5
"""Distance up to which drills go down the same hole [m]: rounding of coordinates."""
UNEVEN, UNEVEN_SHARE = 1.5, 0.1
"""Difference of the engaged radius of a drill around its axis from which on it cuts on one side:
cells of the blank [1], and share of its radius [1]; less is not resolved."""
SECTORS = 6
"""A sixth of a turn: the part of it over which that radius is averaged."""


def spots_only(tool: Tool) -> bool:
    """Whether a tool of kind drill has the point of a spot drill or a countersink."""
    return tool.kind == "drill" and tool.point_angle_deg <= SPOTTING_POINT


def fill_from_cut(code: NDArray[np.int8], moves: Moves, cut: Cut, blocks: CutBlocks) -> Bools:
    """Fill in the operations of rows in the material; rows that are thin across alone.

    ``code`` (M,) is filled in; returned are the rows (M,) that count as finishing by their radial
    depth, with a greater axial one.
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
    shallow, deep = (rows[row] & ~sideways for rows in _holes(cut))
    found[deep] = CODE["deep_drilling"]
    found[shallow] = CODE["centre_drilling"]
    code[row] = found
    slender[row] = (found == CODE["finishing"]) & (blocks.axial_depth > thin)
    return slender


def _fall(moves: Moves) -> Floats:
    """Height lost over the length of each row [1]; shape (M,)."""
    fall: Floats = (moves.start[:, 2] - moves.end[:, 2]) / np.maximum(moves.length, 1e-9)
    return fall


def _moving(moves: Moves) -> Rows:
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


def _drilling_stations(cut: Cut) -> Rows:
    engagement = cut.engagement
    drills = np.array([tool.kind == "drill" for tool in cut.tools])[engagement.tool]
    return np.flatnonzero(drills & engagement.feed & (engagement.slope <= -STEEP))


def _holes(cut: Cut) -> tuple[Bools, Bools]:
    """Rows of drills in holes that their full diameter does not reach, and in deep ones; (M,) each.

    A hole is all that drills cut at one place in the plane, with whatever codes and however often:
    it is as deep as from where the first of them met the material down to where the drill's full
    diameter ends at its lowest.
    """
    shallow, deep = np.zeros((2, cut.engagement.blocks), dtype=np.bool_)
    stations = _drilling_stations(cut)
    if not len(stations):
        return shallow, deep
    engagement, pieces, tools = cut.engagement, cut.path.pieces, cut.tools
    piece, tool = engagement.piece[stations], engagement.tool[stations].astype(np.intp)
    places = np.rint(pieces.end[piece, :2] / SAME_HOLE)
    hole = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    begin = pieces.start[piece, 2] + engagement.slope[stations] * engagement.along[stations]
    end = begin + engagement.slope[stations] * engagement.length[stations]
    top, bottom = np.full(hole.max() + 1, -np.inf), np.full((hole.max() + 1, len(tools)), np.inf)
    reach = np.zeros(bottom.shape)
    np.maximum.at(top, hole, begin)
    np.minimum.at(bottom, (hole, tool), end)
    np.maximum.at(reach, (hole, tool), engagement.axial_depth[stations])
    cone = np.array([one.radius / np.tan(one.point_angle / 2) for one in tools])[tool]
    diameter = np.array([one.diameter for one in tools])[tool]
    spots = np.array([spots_only(one) for one in tools])[tool]
    row, depth = engagement.block[stations], top[hole] - bottom[hole, tool] - cone
    shallow[row[spots | (reach[hole, tool] < WHOLE_CONE * cone)]] = True
    deep[row[depth >= DEEP_HOLE * diameter - SAME_HOLE]] = True
    return shallow, deep


def drills_on_one_side(cut: Cut) -> Bools:
    """Rows (M,) in which a drill cuts more on one side: over a slot, on a slope, at an edge."""
    uneven = np.zeros(cut.engagement.blocks, dtype=np.bool_)
    stations = _drilling_stations(cut)
    engagement = cut.engagement
    height = np.maximum(engagement.upper[stations] - engagement.lower[stations], 0.0)
    if not len(stations):
        return uneven
    resolved = np.array([
        max(UNEVEN * engagement.resolution, UNEVEN_SHARE * tool.radius)
        / np.tan(tool.point_angle / 2)
        for tool in cut.tools
    ])[engagement.tool[stations]]  # fmt: skip
    width = height.shape[1] // SECTORS
    sums = np.cumsum(np.pad(height, ((0, 0), (1, width)), mode="wrap")[:, 1:], axis=1)
    sector = (sums[:, width:] - sums[:, :-width]) / width
    least = np.maximum(resolved, UNEVEN_SHARE * height.max(axis=1))  # a flat end has no cone
    uneven[engagement.block[stations[np.ptp(sector, axis=1) > least]]] = True
    return uneven


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
