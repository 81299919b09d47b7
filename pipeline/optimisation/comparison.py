"""Programs before and after, row by row: limits exceeded, load along the path, their reasons."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS
from pipeline.cutting.tool import tool_limits
from pipeline.gcode.program import Program, parse_program
from pipeline.optimisation.problem.arrays import (
    AS_PROGRAMMED,
    BEYOND,
    CHANGE,
    CONSTRAINTS,
    STABILITY,
    feeds_per_minute,
)
from pipeline.optimisation.problem.feasible import AT, binding_constraints
from pipeline.optimisation.problem.limits import feed_for_marks
from pipeline.optimisation.text.editable_blocks import Reasons, places_of
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import BY_TOOL, CutLimit
from pipeline.schema.part import LoadTrace
from pipeline.twin.cut.document import AssessedCut
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import stations_of_columns, tool_stretches

if TYPE_CHECKING:
    from pipeline.optimisation.full_twin import Result

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
    stretches = tool_stretches(pieces.tool[fed], begin[fed], total)
    return tuple((cut.numbers[tool], first, last) for tool, first, last in stretches)


def alike_runs(rows: Rows, *columns: NDArray[np.generic]) -> list[Rows]:
    """Runs of ascending ``rows`` over which none of the columns (M,) changes."""
    if not len(rows):
        return []
    keys = np.stack(columns)[:, rows]
    return np.split(rows, np.flatnonzero((np.diff(keys, axis=1) != 0).any(axis=0)) + 1)


def path_length(cut: Cut) -> tuple[Floats, float]:
    """Path length at feed before each piece, shape (Q,), and in all [m]."""
    pieces = cut.path.pieces
    length = np.where(pieces.feed, pieces.length, 0.0)
    end = np.cumsum(length)
    return end - length, float(end[-1]) if len(end) else 0.0


KEPT, LEAVES, NO_LIFE, NO_STABILITY, NO_MORE = (
    "kept as programmed", "F no faster where it leaves the cut", "tool life not known",
    "stability not known", "S no more than programmed",
)  # fmt: skip
BINDS = (*CONSTRAINTS, KEPT, LEAVES, NO_LIFE, NO_STABILITY, NO_MORE, *BEYOND)
"""Reasons that may hold a row: a constraint, or why its F or S is no more than programmed."""
ROUNDED = 1 + 1e-6
"""Factor by which a bound may lie above what is programmed and be that."""


class RowReasons:
    """Reasons of M rows of an answer."""

    def __init__(self, result: "Result") -> None:
        self.result = result
        self.problem, self.editable = result.problem, result.problem.editable
        decision = result.answer.decision
        self.feeds, self.speeds = decision.row_feeds, decision.row_speeds
        self.spindle_speed = self.problem.spindle_speed(self.speeds)
        self.own_speed = result.before.plan.spindle_speed

    @cached_property
    def program(self) -> Program:
        """Text whose lines the rows come of: as programmed, or with its blocks split."""
        job, answer = self.result.job, self.result.answer
        if not job.settings.grouping.split:
            return job.program
        return parse_program(answer.text, job.program.name)

    @cached_property
    def kept(self) -> Bools:
        """Rows whose F and S both stay; shape (M,)."""
        return (self.editable.block < 0) & ~self.editable.speed

    @cached_property
    def binds(self) -> Rows:
        """Binding one of ``BINDS`` in each row, -1 where none; shape (M,)."""
        which = binding_constraints(self.problem, self.feeds, self.speeds)
        which = np.where(self.kept, BINDS.index(KEPT), which)
        practice = self.problem.practice
        if practice is None:
            return which
        cut = self.problem.cut
        own = feeds_per_minute(cut, self.result.moves.feed, self.own_speed)
        feed = feeds_per_minute(cut, self.feeds, self.spindle_speed)
        thick = self.problem.feed_per_tooth(self.feeds, self.speeds) >= AT * practice.f_z_change
        fast = feed >= AT * practice.feed_high
        leaves = fast & (practice.feed_high <= own * ROUNDED)
        turns = self.spindle_speed >= AT * practice.speed_high
        stays = practice.speed_high <= self.own_speed * ROUNDED
        changed = thick | (fast & ~leaves) | (turns & ~stays)
        other = np.where(practice.unstable, BINDS.index(NO_STABILITY), BINDS.index(NO_MORE))
        other = np.where(self._unknown_life, BINDS.index(NO_LIFE), other)
        other = np.where(leaves, BINDS.index(LEAVES), other)
        held = ((which == CHANGE) & ~changed) | (which == AS_PROGRAMMED)
        which = np.where((which == CHANGE) & ~changed, other, which)
        for one in practice.not_raised:
            which = np.where(one.rows & held, BINDS.index(one.limit), which)
        return which

    @cached_property
    def _unknown_life(self) -> Bools:
        """Rows that cut with a tool whose life in the material is not known; shape (M,)."""
        material, tools = self.result.job.basis.material, self.problem.cut.tools
        unknown = np.array([material.tool_life(tool) is None for tool in tools] or [False])
        return self.problem.cuts & unknown[self.problem.cut.tool]

    @cached_property
    def _held(self) -> dict[str, tuple[tuple[str, ...], Rows]]:
        """Words of the reasons for which F, and S, are held, and the first of each row (M,)."""
        practice, moves = self.problem.practice, self.result.moves
        held = ((), ()) if practice is None else (practice.kept_feed, practice.kept_speed)
        places = places_of(self.program, moves, *held)
        return {
            "F": _first(places.feed_reasons, len(moves)),
            "S": _first(places.speed_reasons, len(moves)),
        }

    def why_kept(self, letter: str, rows: Rows) -> str:
        """Most frequent reason why the F, or the S, of rows that keep it is kept."""
        words, first = self._held[letter]
        known = first[rows][first[rows] >= 0]
        return words[int(np.bincount(known).argmax())] if len(known) else ""

    def kept_by_reason(self, rows: Rows) -> Iterator[tuple[str, Rows]]:
        """Rows that keep F and S, by the reason for which they keep F."""
        words, first = self._held["F"]
        for k in np.unique(first[rows]).tolist():
            why = words[k].replace("keeps it", "keeps F and S") if k >= 0 else ""
            yield why, rows[first[rows] == k]

    def why_both(self, rows: Rows) -> str | None:
        """Reason why rows keep both F and S; None where one of them may change."""
        if not len(rows) or not self.kept[rows].all():
            return None
        feed, speed = (self.why_kept(letter, rows) for letter in "FS")
        if feed == speed:
            why = feed.replace("keeps it", "keeps F and S")
            return why or "none of its F and S words may be changed"
        return "; ".join(f"{letter}: {why}" for letter, why in zip("FS", (feed, speed), strict=True)
                         if why)  # fmt: skip

    def why_no_faster(self, rows: Rows) -> str | None:
        """Reason why S of rows that cut is nowhere above that programmed; None where it is."""
        if (self.spindle_speed[rows] > self.own_speed[rows] * ROUNDED).any():
            return None
        free = rows[self.editable.speed[rows]]
        if not len(free):
            number = self.problem.cut.numbers[self.problem.cut.tool[rows[0]]]
            why = self.why_kept("S", rows).removeprefix(f"T{number}: ")
            return why or "no S word of it may be changed"
        practice, ranges = self.problem.practice, self.problem.ranges
        unknown = []
        if practice is not None and self._unknown_life[free].all():
            tool = self.problem.cut.tools[self.problem.cut.tool[free[0]]]
            unknown.append(f"tool life of {tool.material} in this material is not known")
        if practice is not None and practice.unstable[free].all():
            unknown.append("its stability is not known and no range of S is given")
        if unknown:
            return "; ".join(unknown)
        held = self._held_speed(free)
        if held:
            return held
        by_range = (ranges.surface_high[free] * AT <= self.spindle_speed[free]).any()
        if by_range:
            return "cutting speed or life of the edge is at its limit"
        if (ranges.speed_high[free] * AT <= self.spindle_speed[free]).any():
            return "S is at the spindle’s top speed, or at the end of its range"
        least = 100 * self.result.job.settings.grouping.least_speed_gain
        return f"no higher one that keeps its limits saves {least:g} % of the part"

    def _held_speed(self, rows: Rows) -> str:
        practice = self.problem.practice
        if practice is None:
            return ""
        there = rows[practice.speed_high[rows] <= self._own(rows)]
        if not len(there):
            return ""
        row = int(there[0])
        operation = OPERATIONS[practice.operation[row]].replace("_", " ")
        reasons = (*practice.no_more, *((one.why, one.rows) for one in practice.not_raised
                                        if one.limit == CONSTRAINTS[STABILITY]))  # fmt: skip
        why = next((why for why, of in reasons if of[row]), "")
        return why or f"{operation} takes no more than programmed"

    def why_no_more_feed(self, rows: Rows) -> str | None:
        """Reason why rows that cut have no more feed per tooth than programmed, by their cut."""
        practice = self.problem.practice
        found = () if practice is None else practice.not_raised
        return "; ".join(dict.fromkeys(one.why for one in found if one.rows[rows].any())) or None

    def _own(self, rows: Rows) -> Floats:
        return self.own_speed[rows] * ROUNDED


def _first(reasons: Reasons, many: int) -> tuple[tuple[str, ...], Rows]:
    """Words of reasons, and the place among them of each row's first, -1 for none; (M,)."""
    first = np.full(many, -1, dtype=np.intp)
    for k in range(len(reasons) - 1, -1, -1):
        first[reasons[k][1]] = k
    return tuple(words for words, _ in reasons), first
