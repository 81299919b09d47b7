"""Limits that every machinist takes for granted: by tool and operation, and against the program.

They hold beside the limits of the part.  A feed for each tooth and a cutting speed stay in the
range of the tool table, or else of the catalogue of cutting data; where neither knows the tool, the
material or the operation, F and S stay as programmed.  A value that lies outside of its range in
the program may stay where it is and goes no farther out.  F, S and the feed for each tooth change
by no more than a factor.  Each operation has a rule of its own (:data:`RULES`).
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pipeline.cutting.catalogue import OPERATIONS, CuttingCatalogue, Operation
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.tool_life import MINUTE, Condition, cutting_speed, life
from pipeline.cutting.tool_range import listed_range, tool_range
from pipeline.gcode.moves import METRE_PER_SECOND, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.operation_cuts import LEAD, drills_on_one_side, length_in_air
from pipeline.optimisation.operations import Operations, operations, passes
from pipeline.optimisation.problem.arrays import OperationRange, Practice, feeds_per_minute
from pipeline.optimisation.text.words import FeedText, ProgramWords
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.limits import CutLimit
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks, cut_blocks

MM = 1e-3
SAME = 1 + 1e-9
"""Factor by which a value may pass the programmed one and count as it: rounding."""


@dataclass(frozen=True)
class Rule:
    """What may change in an operation."""

    feed: Literal["free", "no_more", "no_faster", "keep"] = "free"
    """Inside its limits; no more for each tooth than programmed; F no more than programmed; F as
    programmed."""
    speed: Literal["free", "no_more", "keep"] = "free"
    """The same of S."""
    one_feed: bool = False
    """Whether a pass has one F."""


KEEP = Rule("keep", "keep")
RULES: dict[Operation, Rule] = {
    "air": Rule("no_faster"),
    "lead": Rule("no_more"),
    "ramping": Rule("no_more"),
    "plunging": Rule("no_more"),
    "finishing": Rule("no_more", one_feed=True),
    "ball_finishing": Rule("no_more", one_feed=True),
    "chamfering": Rule("no_more", "no_more", one_feed=True),
    "centre_drilling": Rule("no_more", "no_more"),
    "countersinking": Rule("no_more", "no_more"),
    "counterboring": Rule("no_more", "no_more"),
    "deep_drilling": Rule("no_more", "no_more"),
    "engraving": KEEP,
    "tapping": KEEP,
    "thread_milling": KEEP,
    "reaming": KEEP,
    "boring": KEEP,
    "probing": KEEP,
}
"""Rules of operations; those that are not here are free inside their limits."""


def practice_of(
    program: Program, moves: Moves, cut: Cut, *, limits: CutLimit, catalogue: CuttingCatalogue,
    material: Material, given_up: Collection[int] = (),
) -> Practice:  # fmt: skip
    """Limits of machining practice of each row of a program.

    Parameters
    ----------
    program, moves : Program, Moves
        Text, and as interpreted; M rows.
    cut : Cut
        Of those rows.
    limits : CutLimit
        Of the part; its cutting speed, where given, stands for the range of a tool without one.
    catalogue : CuttingCatalogue
        Where the tool table gives no range.
    material : Material
        Of the blank.
    given_up : collection of int, optional
        Numbers of tools that cannot keep their limits: they stay as programmed.

    Raises
    ------
    ValueError
        When something to be kept is not in the program.
    """
    blocks = cut_blocks(cut)
    found = operations(program, moves, cut, blocks)
    rows = _Rows(program, moves, cut, blocks, found, limits, given_up=tuple(given_up))
    return rows.practice(catalogue, material)


class _Rows:
    """Rows of a program on the way to their practice."""

    def __init__(
        self, program: Program, moves: Moves, cut: Cut, blocks: CutBlocks, found: Operations,
        limits: CutLimit, *, given_up: tuple[int, ...],
    ) -> None:  # fmt: skip
        self.given_up = given_up
        self.program, self.moves, self.cut, self.blocks = program, moves, cut, blocks
        self.found, self.limits, self.settings = found, limits, limits.practice
        self.fed = found.code >= 0
        self.cuts = cut.tool >= 0
        self.one_sided = drills_on_one_side(cut) & found.of("drilling", "deep_drilling")
        self.own_speed = cut.plan.spindle_speed
        self.own_feed = feeds_per_minute(cut, moves.feed, self.own_speed)
        # of F as it is written: a block that is too short to reach it has no other range
        self.own_f_z = cut.feed_per_tooth_at(self.own_feed * METRE_PER_SECOND, self.own_speed)
        self.reached_f_z = cut.commanded_feed_per_tooth()

    def practice(self, catalogue: CuttingCatalogue, material: Material) -> Practice:
        ranges = tuple(self._ranges(catalogue, material))
        kept_feed, kept_speed = self._kept(ranges)
        f_z_low, f_z_high, surface_low, surface_high = self._of_ranges(ranges)
        low, high = self._change()
        life = self._by_life(material, high)
        speed_high = np.where(
            self._rules("speed", "no_more") | np.isnan(life), self.own_speed, high * self.own_speed
        )
        held = np.logical_or.reduce([rows for _, rows in kept_feed]) | ~self.fed
        one_feed = self.found.of(*(name for name, rule in RULES.items() if rule.one_feed))
        return Practice(
            settings=self.settings, operation=self.found.code, ranges=ranges, kept_feed=kept_feed,
            kept_speed=kept_speed, no_more=tuple(self._no_more()), f_z_low=f_z_low,
            given_up=self.cuts & np.isin(self.moves.tool, self.given_up),
            f_z_high=f_z_high, f_z_change=np.where(self.cuts, high * self.own_f_z * SAME, np.inf),
            f_z_own=np.where(
                self.cuts & self._rules("feed", "no_more"), self.own_f_z * SAME, np.inf
            ),
            feed_low=low * self.own_feed, feed_high=self._greatest_feed(high),
            speed_low=low * self.own_speed, speed_high=speed_high, surface_low=surface_low,
            surface_high=np.minimum(surface_high, np.where(np.isnan(life), np.inf, life)),
            unit=FeedText.of(ProgramWords(self.program), self.moves).unit,
            passes=passes(self.found, self.moves, one_feed & self.cuts & ~held),
        )  # fmt: skip

    def _rules(self, of: str, word: str) -> Bools:
        """Rows whose operation has a rule, or whose drill cuts on one side; shape (M,)."""
        rows = self.found.of(*(name for name, rule in RULES.items() if getattr(rule, of) == word))
        return rows | self.one_sided if word == "no_more" else rows

    def _no_more(self) -> Iterator[tuple[str, Bools]]:
        """Rows whose F and S rise no more for another reason than their operation."""
        for number in np.unique(self.moves.tool[self.one_sided]).tolist():
            why = f"T{number} drills on one side only, no more than programmed"
            yield why, self.one_sided & (self.moves.tool == number)

    def _change(self) -> tuple[Floats, Floats]:
        """Least and greatest factor of what is programmed; shape (M,) each."""
        low, high = (np.full(len(self.cut.tools) + 1, bound) for bound in self.settings.change)
        for index, tool in enumerate(self.cut.tools):
            if tool.change is not None:
                low[index], high[index] = tool.change
        return low[self.cut.tool], high[self.cut.tool]

    def _greatest_feed(self, high: Floats) -> Floats:
        """F of each row at most [mm/min]; shape (M,)."""
        most = high * self.own_feed
        air = self.fed & ~self.cuts
        given = self.settings.air_feed_mm_min
        most[air] = self.own_feed[air] if given is None else np.maximum(given, self.own_feed[air])
        if given is None:  # a row that leaves the cut for more than a lead-out
            diameter = np.array([tool.diameter for tool in self.cut.tools] or [0.0])
            outside = length_in_air(self.cut, self.blocks) > LEAD * diameter[self.cut.tool]
            most = np.where(self.cuts & outside, self.own_feed, most)
        return most * SAME

    def _by_life(self, material: Material, high: Floats) -> Floats:
        """Greatest S by the least life of an edge [rev/min]; NaN where no life is known; (M,)."""
        out = np.full(len(self.cuts), np.inf)
        blocks = self.blocks
        for index, tool in enumerate(self.cut.tools):
            mine = np.flatnonzero(blocks.tool == index)
            rows, constants = blocks.row[mine], material.tool_life(tool)
            if constants is None:
                out[rows] = np.nan
                continue
            conditions: dict[Condition, Floats] = {
                "f_z": np.maximum(high[rows] * self.own_f_z[rows], 1e-9),
                "a_p": np.maximum(blocks.axial_depth[mine], 1e-9),
                "a_e": np.maximum(blocks.radial_depth[mine], 1e-9),
            }
            with np.errstate(divide="ignore", over="ignore"):  # without end: need not last
                lasts = life(constants, 1.0, conditions) / (self.settings.tool_life_min * MINUTE)
                by_speed = lasts**constants.n / cutting_speed(tool.diameter, 1.0) * 60.0
            out[rows] = np.maximum(by_speed, self.own_speed[rows])
        return out

    def _ranges(self, catalogue: CuttingCatalogue, material: Material) -> Iterator[OperationRange]:
        """Ranges of each tool that cuts in each of its operations."""
        for index, tool in enumerate(self.cut.tools):
            mine = self.cuts & (self.cut.tool == index)
            for code in np.unique(self.found.code[mine]).tolist():
                operation = OPERATIONS[code]
                listed = listed_range(catalogue, material, tool, (operation,))
                known = tool_range(
                    tool, listed, cutting_speed_m_min=self.limits.cutting_speed_m_min
                )
                kept, rule = "", RULES.get(operation, Rule())
                if rule.feed == "keep":
                    kept = f"{words(operation)} keeps F and S"
                elif known.feed_per_tooth_mm is None and rule.feed != "no_more":
                    kept = catalogue.why_not(tool, material, operation)
                yield OperationRange(
                    tool=self.cut.numbers[index], operation=operation, range=known, kept=kept
                )

    def _of_ranges(self, ranges: tuple[OperationRange, ...]) -> tuple[Floats, ...]:
        """Least and greatest f_z [m], least and greatest S [rev/min] by ranges; shape (M,) each."""
        many = len(self.cuts)
        bounds = np.stack([np.zeros(many), np.full(many, np.inf)] * 2)
        diameter = dict(zip(self.cut.numbers, self.cut.tools, strict=True))
        for one in ranges:
            mine = self._of(one)
            spans = (
                (one.range.feed_per_tooth_mm, MM, self.own_f_z),
                (one.range.cutting_speed_m_min, 1 / (np.pi * diameter[one.tool].diameter),
                 self.own_speed),
            )  # fmt: skip
            for k, (span, unit, own) in enumerate(spans):
                if span is not None:
                    bounds[2 * k, mine] = np.minimum(span[0] * unit, own[mine]) / SAME
                    bounds[2 * k + 1, mine] = np.maximum(span[1] * unit, own[mine]) * SAME
        bounds[0] = np.minimum(bounds[0], self.reached_f_z)
        again = self._again_in_air()
        bounds[0, again] = np.minimum(
            bounds[0, again], self._change()[0][again] * self.own_f_z[again]
        )
        return tuple(bounds)

    def _again_in_air(self) -> Bools:
        """Rows that cut in lines that are also run in air, where F may not rise; shape (M,)."""
        line = np.where(self.moves.file == 0, self.moves.line, 0)
        air = np.zeros(len(self.program) + 1, dtype=np.bool_)
        air[line[self.fed & ~self.cuts]] = True
        rows: Bools = self.cuts & air[line]
        return rows

    def _of(self, one: OperationRange) -> Bools:
        """Rows that cut with the tool and in the operation of a range; shape (M,)."""
        mine: Bools = self.cuts & (self.moves.tool == one.tool) & self.found.of(one.operation)
        return mine

    def _kept(
        self, ranges: tuple[OperationRange, ...]
    ) -> tuple[tuple[tuple[str, Bools], ...], tuple[tuple[str, Bools], ...]]:
        """Rows that keep their F, and their S, by reason.

        S is kept as long as the tool is in the spindle: between two of its cuts there may be no
        time for another speed.
        """
        feed: list[tuple[str, Bools]] = []
        speed: list[tuple[str, Bools]] = []
        for text in self.settings.keep:
            rows = self._named(text)
            feed.append((f"keep {text}", rows))
            speed.append((f"keep {text}", rows))
        for number in self.given_up:
            reason = f"T{number} cannot keep its limits", self.moves.tool == number
            feed.append(reason)
            speed.append(reason)
        if self.settings.air_feed_mm_min is None:
            feed.append(("moves in air keep their own F", self._air_words()))
        for operation, rule in RULES.items():
            rows = self.found.of(operation)
            if rule.feed == "keep":
                feed.append((f"{words(operation)} keeps it", rows))
            if rule.speed == "keep":
                speed.append((f"{words(operation)} keeps it", rows))
        for one in ranges:
            if one.kept and RULES.get(one.operation, Rule()).feed != "keep":
                feed.append((f"T{one.tool}: {one.kept}", self._of(one)))
            if one.kept or one.range.cutting_speed_m_min is None:
                why = one.kept or "no range of its cutting speed is known"
                speed.append((f"T{one.tool}: {why}", self._of(one)))
        runs = np.cumsum(np.diff(self.moves.tool, prepend=-2) != 0)
        whole = ((why, np.isin(runs, runs[rows])) for why, rows in speed)
        nothing = np.zeros(len(self.fed), dtype=np.bool_)
        return (*feed, ("", nothing)), (*whole, ("", nothing))

    def _air_words(self) -> Bools:
        """Rows in air whose line has an F word and nothing that cuts; shape (M,)."""
        words = ProgramWords(self.program).token("F") >= 0
        line = np.where(self.moves.file == 0, self.moves.line, 0)
        cutting = np.zeros(len(words), dtype=np.bool_)
        cutting[line[self.cuts]] = True
        rows: Bools = self.fed & ~self.cuts & words[line] & ~cutting[line]
        return rows

    def _named(self, text: str) -> Bools:
        """Rows that a person names: a tool, lines, a word of a comment or of a tool's name."""
        moves, number = self.moves, text[1:] if text[:1] in "Tt" else ""
        if number.isdigit():
            rows = moves.tool == int(number)
            if not rows.any():
                raise ValueError(f"practice.keep names {text}, which the program does not use")
            return rows
        first, dash, last = text.partition("-")
        if first.strip().isdigit() and (last.strip().isdigit() or not dash):
            span = int(first), int(last) if dash else int(first)
            rows = (moves.file == 0) & (moves.line >= span[0]) & (moves.line <= span[1])
            if not rows.any():
                raise ValueError(f"practice.keep names lines {text}, which have no moves")
            return rows
        return self._tagged(text)

    def _tagged(self, text: str) -> Bools:
        """Rows with a word in a comment in force, or in what names or describes the tool."""
        tools = [
            number for number, about in self.found.tool_texts.items()
            if text.casefold() in about.casefold()
        ]  # fmt: skip
        rows = self.found.comments.below(text) | np.isin(self.moves.tool, tools)
        if not rows.any():
            raise ValueError(
                f"practice.keep names {text!r}, which stands in no comment that holds for a move "
                "and in no name of a tool in use: name a tool as T5, lines as 120-180, or a word "
                "that stands there"
            )
        return rows


def words(operation: Operation) -> str:
    """An operation in words.

    Examples
    --------
    >>> words("ball_finishing")
    'ball finishing'
    """
    return operation.replace("_", " ")
