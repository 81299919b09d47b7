"""Programs before and after, row by row: limits exceeded, groups of blocks, load along the path."""

from dataclasses import dataclass, field

import numpy as np

from pipeline.cutting.tool import tool_limits
from pipeline.optimisation.problem.limits import feed_for_marks
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import BY_TOOL, CutLimit
from pipeline.schema.part import LoadTrace
from pipeline.twin.cut.document import AssessedCut
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import stations_of_columns

ROUNDING = 1e-3
"""Excess over a limit, as a share, up to which it is rounding."""
UM = 1e6
COLUMNS = 900
"""Columns of equal path length; about as many as a page has pixels."""
MM = 1e3


def exceeded_limits(of: AssessedCut, limits: CutLimit) -> dict[str, Bools]:
    """Blocks (K,) that cut and exceed a limit, by the limit's name; margins are not counted."""
    blocks, found, tools = of.results.blocks, of.results.limits, of.results.cut.tools
    running = blocks.spindle_speed > 0
    load, bending, torque = (
        tool_limits(tools, name, getattr(limits, name))[blocks.tool] for name in BY_TOOL
    )
    surface = (
        np.pi * np.array([tool.diameter for tool in tools])[blocks.tool] * blocks.spindle_speed
    )
    height = None if limits.roughness_um is None else limits.roughness_um / UM
    checks = {
        "load": (np.where(running, blocks.peak, np.nan), load),
        "deflection": (found.deflection * UM, bending),
        "roughness": (_marks(of, height), None if height is None else 1.0),
        "chip": (blocks.thickness * UM, limits.chip_um),
        "torque": (blocks.torque, torque),
        "power": (found.drive, limits.power_share),
        "cutting speed": (np.where(running, surface, np.nan), limits.cutting_speed_m_min),
        "spindle speed": (np.where(running, blocks.spindle_speed, np.nan), limits.speed_rpm),
        "feed": (blocks.feed, None if limits.feed_mm_min is None else (0.0, limits.feed_mm_min[1])),
    }
    out = {"stability": found.margin < 0}
    for name, (values, limit) in checks.items():
        if limit is not None:
            low, high = limit if isinstance(limit, tuple) else (0.0, limit)
            out[name] = (values > high * (1 + ROUNDING)) | (values < low * (1 - ROUNDING))
    return out


def _marks(of: AssessedCut, height: float | None) -> Floats:
    """Feed for each tooth over that whose marks have the height; NaN where none is given."""
    blocks, tools = of.results.blocks, of.results.cut.tools
    if height is None:
        return np.full(len(blocks), np.nan)
    most = np.array([feed_for_marks(tool, height) for tool in tools])[blocks.tool]
    return blocks.feed_per_tooth / most


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """A program, before or after, by the M rows that it had before."""

    cut: Cut = field(repr=False)
    of: AssessedCut = field(repr=False)
    """Assessed cut of the program with its own M' rows."""
    time: Floats = field(repr=False)
    cost: Floats = field(repr=False)
    """Time [s] and cost [currency] of each row with those that were added before it, NaN where not
    known; shape (M,)."""
    feed: Floats = field(repr=False)
    speed: Floats = field(repr=False)
    """F and S, in the units of ``Moves``; shape (M,)."""
    peak: Floats = field(repr=False)
    """Greatest load of each row [N]; shape (M,)."""

    @classmethod
    def of_rows(cls, cut: Cut, of: AssessedCut, rows: Rows) -> "Side":
        """``rows`` (M,) are those of the cut that the rows before have become."""
        moves, cost = cut.plan.path.moves, of.results.cost
        owner = np.minimum(np.searchsorted(rows, np.arange(len(moves))), len(rows) - 1)
        each = np.full(len(moves), np.nan) if cost is None else cost.block
        return cls(
            cut=cut, of=of,
            time=np.bincount(owner, cut.plan.time, minlength=len(rows)).astype(np.float64),
            cost=np.bincount(owner, each, minlength=len(rows)).astype(np.float64),
            feed=moves.feed[rows], speed=moves.speed[rows], peak=cut.block_loads.peak[rows],
        )  # fmt: skip


def load_trace(cut: Cut, columns: int = COLUMNS) -> LoadTrace:
    """Highest load in each column of the path length at feed, equal places before and after."""
    pieces, engagement = cut.path.pieces, cut.engagement
    begin, total = path_length(cut)
    scale = columns / max(total, 1e-12)
    kept = engagement.feed
    start = begin[engagement.piece[kept]] + engagement.along[kept]
    low = np.clip((start * scale).astype(np.intp), 0, columns - 1)
    end = (start + engagement.length[kept]) * scale
    high = np.clip(np.ceil(end - 1e-9).astype(np.intp) - 1, low, columns - 1)
    load = np.full(columns, -np.inf)
    station, column = stations_of_columns(low, high)
    np.maximum.at(load, column, cut.station_loads.peak[kept][station])
    edges = np.arange(columns) / scale
    fed = np.flatnonzero(pieces.feed)
    place = np.searchsorted(begin[fed], edges + 1e-12, side="right") - 1 if len(fed) else fed
    line = cut.plan.path.moves.line[pieces.block[fed[np.maximum(place, 0)]]] if len(fed) else place
    return LoadTrace(
        total_mm=round(total * MM, 3),
        way_mm=tuple(round(v, 3) for v in (edges * MM).tolist()),
        load_N=tuple(float(f"{v:.4g}") if np.isfinite(v) else None for v in load.tolist()),
        line=tuple(line.tolist()),
    )


def tool_spans(cut: Cut) -> tuple[tuple[int, float, float], ...]:
    """Number, begin and end of each stretch of one tool, as shares of the path length at feed."""
    begin, total = path_length(cut)
    pieces = cut.path.pieces
    fed = np.flatnonzero(pieces.feed)
    if not len(fed) or total <= 0:
        return ()
    tool = pieces.tool[fed]
    edges = np.flatnonzero(np.diff(tool, prepend=tool[0] - 1))
    ends = [*(begin[fed[edges[1:]]] / total).tolist(), 1.0]
    return tuple(
        (cut.numbers[int(tool[k])], round(float(begin[fed[k]] / total), 5), round(end, 5))
        for k, end in zip(edges.tolist(), ends, strict=True)
    )


def path_length(cut: Cut) -> tuple[Floats, float]:
    """Path length at feed before each piece, shape (Q,), and in all [m]."""
    pieces = cut.path.pieces
    length = np.where(pieces.feed, pieces.length, 0.0)
    end = np.cumsum(length)
    return end - length, float(end[-1]) if len(end) else 0.0
