"""Reasons of each row's F and S: the limit that it is at, or why it is kept."""

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from pipeline.cutting.catalogue import OPERATIONS
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
from pipeline.optimisation.text.editable_blocks import Reasons, places_of
from pipeline.schema.arrays import Bools, Floats, Rows

if TYPE_CHECKING:
    from pipeline.optimisation.full_twin import Result

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
        stays: Bools = (self.editable.block < 0) & ~self.editable.speed
        return stays

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
        rows: Bools = self.problem.cuts & unknown[self.problem.cut.tool]
        return rows

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
        own: Floats = self.own_speed[rows] * ROUNDED
        return own


def _first(reasons: Reasons, many: int) -> tuple[tuple[str, ...], Rows]:
    """Words of reasons, and the place among them of each row's first, -1 for none; (M,)."""
    first = np.full(many, -1, dtype=np.intp)
    for k in range(len(reasons) - 1, -1, -1):
        first[reasons[k][1]] = k
    return tuple(words for words, _ in reasons), first
