"""What to look at before a part is cut: rapids in the material, limits passed, tools too short."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks
from pipeline.twin.cut_limits import CutLimits

Rows = NDArray[np.intp]


def cut_warnings(
    cut: Cut, blocks: CutBlocks, limits: CutLimits, limit_load: float | None, *, measured: bool
) -> list[dict[str, Any]]:
    """Each with ``what`` it is, what to ``do``, its ``lines``, and whether it is ``grave``.

    Chatter is grave only where the tips' dynamics were ``measured``.
    """
    found = cut.engagement
    deep = found.resolution * (1 + 1e-6)
    rapid = np.unique(found.block[~found.feed & (found.axial_depth > deep)]).astype(np.intp)
    standing = blocks.row[blocks.turns <= 0]
    told = [
        _warning(cut, rapid, "rapids go through the material",
                 "Retract further, or move around the blank.", grave=True),
        _warning(cut, standing, "the spindle stands while the tool is fed into the material",
                 "Program S and M3 before it.", grave=True),
        _warning(cut, blocks.row[limits.drive > 1], "the spindle’s drive cannot give the power",
                 "Lower feed or depth, or another speed.", grave=True),
        _warning(cut, blocks.row[limits.margin < 0],
                 "blocks chatter" if measured else "blocks may chatter",
                 "Less depth, or a speed between the lobes" + (
                     "." if measured else "; the tips’ dynamics were not measured: tap them."
                 ), grave=measured),
        _warning(cut, _too_deep(cut, blocks), "cuts are deeper than the tool’s flutes are long",
                 "A longer tool, or more passes."),
        _warning(cut, _below(cut), "the tool goes below the blank’s underside",
                 "Check what the blank lies on."),
    ]  # fmt: skip
    if limit_load is not None:
        over = blocks.row[blocks.peak > limit_load]
        what = f"the load passes its limit of {limit_load:g} N"
        told.insert(1, _warning(cut, over, what, "Lower the feed of these blocks.", grave=True))
    return [one for one in told if one is not None]


def _warning(
    cut: Cut, rows: Rows, what: str, do: str, *, grave: bool = False
) -> dict[str, Any] | None:
    if not len(rows):
        return None
    lines = list(dict.fromkeys(cut.plan.path.moves.line[np.sort(rows)].tolist()))
    return {"what": what, "do": do, "lines": lines, "blocks": len(rows), "grave": grave}


def _too_deep(cut: Cut, blocks: CutBlocks) -> Rows:
    long = np.array([np.inf if t.flute_length_mm is None else t.flute_length_mm for t in cut.tools])
    # depth is known to a cell's height error of a surface that another tool has left
    return blocks.row[blocks.axial_depth * 1e3 > long[blocks.tool] + 1e-6]


def _below(cut: Cut) -> Rows:
    """Rows whose tip is below the blank's floor by more than a cell, within its outline."""
    blank, pieces = cut.blank, cut.path.pieces
    rows, columns = blank.heights.shape
    radius = np.array([tool.radius for tool in cut.tools])[pieces.tool]
    below = np.minimum(pieces.start[:, 2], pieces.end[:, 2]) < blank.floor - blank.cell
    for axis, low, many in ((0, blank.x0, columns), (1, blank.y0, rows)):
        ends = pieces.start[:, axis], pieces.end[:, axis]
        below &= np.maximum(*ends) > low - radius
        below &= np.minimum(*ends) < low + many * blank.cell + radius
    return np.unique(pieces.block[below]).astype(np.intp)
