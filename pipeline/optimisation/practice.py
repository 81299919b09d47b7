"""Limits of machining practice: by tool and operation, and against the program.

A feed for each tooth and a cutting speed stay in the range of the tool table, or else of the
catalogue of cutting data; without a range F and S stay as programmed.  A programmed value outside
of its range goes no farther out.  F, S and f_z change by no more than a factor.  Each operation has
a rule of its own (:data:`RULES`).

The greatest feed for each tooth of a catalogue holds at the greatest width a_e of its row; a
narrower cut may have the feed whose thickest chip is the same,

    f_z sin(phi) <= f_z,row sin(phi_row),   sin(phi) = sqrt(1 - (1 - 2 a_e / D)^2) for a_e < D / 2.

Deeper or wider than the row, deeper than the flutes, or where the tip bends by more than
:data:`BENDING` and :data:`TEETH` f_z, neither f_z nor F rises.  S does not rise where the stability
of the tool, or its life, is not known.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.catalogue import (
    OPERATIONS,
    CuttingCatalogue,
    CuttingRange,
    Operation,
    by_width,
    tool_range,
)
from pipeline.cutting.economics.material import Condition, Material, cutting_speed, fastest
from pipeline.cutting.stability.tip_dynamics import TipDynamics
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import METRE_PER_SECOND, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.operation_signs import drills_on_one_side, long_in_air
from pipeline.optimisation.operations import Operations, operations, passes
from pipeline.optimisation.problem.arrays import (
    SAME,
    NotRaised,
    OperationRange,
    Practice,
    feeds_per_minute,
)
from pipeline.optimisation.problem.limits import inverse, row_limits, stiffness
from pipeline.optimisation.text.words import FeedText, ProgramWords
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.limits import CutLimit
from pipeline.schema.si import MINUTE, MM, UM
from pipeline.twin.cut.blocks import CutBlocks, StationArcs, cut_blocks, station_arcs
from pipeline.twin.cut.loads import Cut

BENDING, TEETH = 50 * UM, 3.0
"""Deflection of the tip up to which its load may rise: [m], and over the feed for each tooth."""
NARROWEST = 0.01
"""Least a_e over D whose chip counts as thin [1]."""
DEEPER = 1.01
"""Factor by which a depth may pass that of a row and count as it."""


@dataclass(frozen=True)
class Rule:
    """Freedom of F and S in an operation."""

    feed: Literal["free", "no_more", "no_faster", "keep"] = "free"
    """Freedom of F: inside its limits; no more for each tooth than programmed; F no more than
    programmed; F as programmed."""
    speed: Literal["free", "no_more", "keep"] = "free"
    """Freedom of S."""
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
    material: Material, dynamics: TipDynamics | None = None, whole: NDArray[np.int8] | None = None,
    given_up: Collection[int] = (),
) -> Practice:  # fmt: skip
    """Limits of machining practice of each row of a program.

    ``limits``: its cutting speed, where given, stands for the range of a tool without one;
    ``whole`` (M,): operations of the unsplit blocks; ``given_up``: tools that stay as programmed.
    """
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    found = operations(program, moves, cut, blocks)
    if whole is not None:
        found = found.of_parts(whole)
    rows = _Rows(
        program, moves, cut, blocks, found, limits=limits, thinned=thinning(cut, arcs),
        given_up=tuple(given_up),
    )  # fmt: skip
    return rows.practice(catalogue, material, dynamics)


def unknown_stability(cut: Cut, dynamics: TipDynamics | None) -> Bools:
    """Rows that cut with a tool whose stability is not known; a drill has no lobes; shape (M,)."""
    tips = [None] * len(cut.tools) if dynamics is None else dynamics.of(cut.numbers)
    unknown = [
        tip is None and tool.kind != "drill" for tip, tool in zip(tips, cut.tools, strict=True)
    ]
    return np.array([*unknown, False])[cut.tool]


def immersion(width: ArrayLike) -> Floats:
    """Sine of the angle at which teeth enter at a_e over D, 1 from a half on [1].

    >>> immersion([0.1, 0.5, 0.9]).round(3).tolist()
    [0.6, 1.0, 1.0]
    """
    return np.sqrt(1 - (1 - 2 * np.minimum(width, 0.5)) ** 2)


def thinning(cut: Cut, arcs: StationArcs) -> Floats:
    """Thickest chip across the feed over the feed for each tooth; 1 of plunges; shape (M,)."""
    across = (arcs.entry <= np.pi / 2) & (np.pi / 2 <= arcs.exit)
    sine = np.where(across, 1.0, np.maximum(np.sin(arcs.entry), np.sin(arcs.exit)))
    out = np.zeros(cut.engagement.blocks)
    np.maximum.at(out, cut.engagement.block, sine)
    return np.clip(out, immersion(NARROWEST), 1.0)


class _Rows:
    """Rows of a program with their limits of practice in progress."""

    def __init__(
        self, program: Program, moves: Moves, cut: Cut, blocks: CutBlocks, found: Operations,
        *, limits: CutLimit, thinned: Floats, given_up: tuple[int, ...],
    ) -> None:  # fmt: skip
        self.thinned, self.given_up = thinned, given_up
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
        self.axial, self.radial, self.diameter = np.zeros((3, len(moves)))
        self.axial[blocks.row], self.radial[blocks.row] = blocks.axial_depth, blocks.radial_depth
        self.diameter[blocks.row] = blocks.cutting_diameter

    def practice(
        self, catalogue: CuttingCatalogue, material: Material, dynamics: TipDynamics | None
    ) -> Practice:
        ranges = tuple(self._ranges(catalogue, material))
        kept_feed, kept_speed = self._kept(ranges)
        thicker = self._thicker(ranges)
        f_z_low, f_z_high, surface_low, surface_high = self._of_ranges(ranges, thicker)
        low, high = self._change()
        life = self._by_life(material, high)
        unstable = unknown_stability(self.cut, dynamics) & (self.limits.speed_rpm is None)
        unknown = np.isnan(life) | unstable
        speed_high = np.where(
            self._rules("speed", "no_more") | unknown, self.own_speed, high * self.own_speed
        )
        bent, f_z_bent = self._bent()
        not_raised = (*(one for one in self._beyond(ranges) if one.rows.any()), *bent)
        stays = np.logical_or.reduce([one.rows for one in not_raised] or [~self.fed & self.fed])
        held = np.logical_or.reduce([rows for _, rows in kept_feed]) | ~self.fed
        one_feed = self.found.of(*(name for name, rule in RULES.items() if rule.one_feed))
        return Practice(
            settings=self.settings, operation=self.found.code, ranges=ranges, kept_feed=kept_feed,
            kept_speed=kept_speed, no_more=tuple(self._no_more()), f_z_low=f_z_low,
            given_up=self.cuts & np.isin(self.moves.tool, self.given_up),
            f_z_high=f_z_high, f_z_change=np.where(self.cuts, high * self.own_f_z * SAME, np.inf),
            f_z_own=np.minimum(
                np.where(self.cuts & self._rules("feed", "no_more"), self.own_f_z * SAME, np.inf),
                np.where(stays, self.reached_f_z * SAME, np.inf),  # as loaded, also at less S
            ),
            f_z_bent=f_z_bent, not_raised=not_raised, thicker=thicker,
            feed_low=low * self.own_feed,
            feed_high=np.where(stays, self.own_feed * SAME, self._greatest_feed(high)),
            speed_low=low * self.own_speed, speed_high=speed_high, unstable=unstable,
            surface_low=surface_low,
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
            leaves = self.cuts & long_in_air(self.cut, self.blocks)
            most = np.where(leaves, self.own_feed, most)
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
            v_c = fastest(constants, self.settings.tool_life_min * MINUTE, conditions)
            by_speed = v_c / cutting_speed(blocks.cutting_diameter[mine], 1.0) * 60.0
            out[rows] = np.maximum(by_speed, self.own_speed[rows])
        return out

    def _ranges(self, catalogue: CuttingCatalogue, material: Material) -> Iterator[OperationRange]:
        for index, tool in enumerate(self.cut.tools):
            mine = self.cuts & (self.cut.tool == index)
            for code in np.unique(self.found.code[mine]).tolist():
                operation, there = OPERATIONS[code], mine & (self.found.code == code)
                kept, rule = "", RULES.get(operation, Rule())
                for listed, rows in self._by_width(catalogue, material, tool, operation, there):
                    if not rows.any():
                        continue
                    known = tool_range(
                        tool, listed, cutting_speed_m_min=self.limits.cutting_speed_m_min
                    )
                    if rule.feed == "keep":
                        kept = f"{words(operation)} keeps F and S"
                    elif known.feed_per_tooth_mm is None and rule.feed != "no_more":
                        kept = catalogue.why_not(tool, material, operation)
                    yield OperationRange(
                        tool=self.cut.numbers[index], operation=operation, range=known, kept=kept,
                        rows=rows,
                    )  # fmt: skip

    def _by_width(
        self, catalogue: CuttingCatalogue, material: Material, tool: Tool, operation: Operation,
        rows: Bools,
    ) -> Iterator[tuple[CuttingRange | None, Bools]]:  # fmt: skip
        """Ranges of the catalogue for rows of a tool, the narrowest cuts first."""
        found: tuple[CuttingRange | None, ...] = by_width(catalogue, material, tool, operation)
        for listed in found[:-1]:
            if listed is not None and listed.radial_over_diameter is not None:
                inside = rows & ~self._wider(listed.radial_over_diameter[1], tool)
                yield listed, inside
                rows = rows & ~inside
        yield (found or (None,))[-1], rows

    def _wider(self, share: float, tool: Tool) -> Bools:
        return self.radial > share * tool.diameter + self.cut.engagement.resolution

    def _thicker(self, ranges: tuple[OperationRange, ...]) -> Floats:
        """Feed for each tooth over that of the range for a chip as thick, 1 or more; (M,)."""
        out = np.ones(len(self.cuts))
        for one in ranges:
            free = RULES.get(one.operation, Rule()).feed == "free"
            if free and one.range.radial_over_diameter is not None:
                chip = immersion(one.range.radial_over_diameter[1])
                out[one.rows] = np.maximum(chip / self.thinned[one.rows], 1.0)
        return out

    def _beyond(self, ranges: tuple[OperationRange, ...]) -> Iterator[NotRaised]:
        """Rows that cut deeper or wider than the range of their feed, or deeper than the flutes.

        What takes no more for each tooth than programmed is not held to the depth of a range.
        """
        tools = dict(zip(self.cut.numbers, self.cut.tools, strict=True))
        for one in ranges:
            tool, known = tools[one.tool], one.range
            named = f"the row for {words(one.operation)} ({known.makers}) ends at"
            free = one.rows & (not one.kept and RULES.get(one.operation, Rule()).feed == "free")
            if known.axial_depth_mm is not None:
                rows = free & (self.axial > DEEPER * known.axial_depth_mm * MM)
                deep = _times(self.axial[rows].max(initial=0.0) / MM, tool, "deep")
                end = known.axial_depth_mm / tool.diameter_mm
                why = f"{deep}, {named} {end:.2g} D ({known.axial_depth_mm:.3g} mm)"
                yield NotRaised("depth of the table", why, rows)
            if known.radial_over_diameter is not None:
                end = known.radial_over_diameter[1]
                rows = free & self._wider(end, tool)
                wide = _times(self.radial[rows].max(initial=0.0) / MM, tool, "wide")
                yield NotRaised("width of the table", f"{wide}, {named} {end:g} D", rows)
            if tool.flute_length_mm is not None and tool.kind != "drill":
                rows = one.rows & (self.axial > DEEPER * tool.flute_length_mm * MM)
                deep = f"{self.axial[rows].max(initial=0.0) / MM:.3g} mm deep"
                why = f"{deep}, and its flutes are {tool.flute_length_mm:g} mm long"
                yield NotRaised("length of the flutes", why, rows)

    def _bent(self) -> tuple[list[NotRaised], Floats]:
        """Rows whose tip bends too much for more, and the greatest f_z by the bending [m]; (M,).

        A given limit of the deflection stands for it.
        """
        cuts = self.cuts & np.isinf(row_limits(self.cut, self.limits, "deflection_um"))
        cuts &= np.array([*(tool.load_known for tool in self.cut.tools), False])[self.cut.tool]
        most, held = np.maximum(BENDING, TEETH * self.reached_f_z), []
        stiff = np.array([*(stiffness(tool) for tool in self.cut.tools), np.inf])[self.cut.tool]
        bends = np.where(cuts, self.cut.table.peaks(self.reached_f_z), 0.0) / stiff
        for one in np.unique(self.cut.tool[cuts & (bends > most)]).tolist():
            rows = cuts & (bends > most) & (self.cut.tool == one)
            row = int(np.argmax(np.where(rows, bends / most, 0.0)))
            why = (
                f"its tip bends {bends[row] / UM:.4g} um as programmed, more than "
                f"{BENDING / UM:g} um and {TEETH:g} f_z = {most[row] / UM:.3g} um"
            )
            held.append(NotRaised("deflection", why, rows))
        by_bending = inverse(self.cut, self.cut.table.values[0], most * stiff)
        return held, np.where(cuts, np.maximum(by_bending, self.reached_f_z * SAME), np.inf)

    def _of_ranges(self, ranges: tuple[OperationRange, ...], thicker: Floats) -> tuple[Floats, ...]:
        """Least and greatest f_z [m], least and greatest S [rev/min] by ranges; shape (M,) each."""
        many = len(self.cuts)
        bounds = np.stack([np.zeros(many), np.full(many, np.inf)] * 2)
        for one in ranges:
            mine = one.rows
            turns, same = 1 / (np.pi * self.diameter[mine]), np.ones(int(mine.sum()))
            spans = (
                (one.range.feed_per_tooth_mm, MM * same, thicker[mine], self.own_f_z[mine]),
                (one.range.cutting_speed_m_min, turns, same, self.own_speed[mine]),
            )
            for k, (span, unit, more, own) in enumerate(spans):
                if span is not None:
                    bounds[2 * k, mine] = np.minimum(span[0] * unit, own) / SAME
                    most = np.where(own > span[1] * unit * SAME, own, span[1] * unit * more)
                    bounds[2 * k + 1, mine] = most * SAME
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
        return self.cuts & air[line]

    def _kept(
        self, ranges: tuple[OperationRange, ...]
    ) -> tuple[tuple[tuple[str, Bools], ...], tuple[tuple[str, Bools], ...]]:
        """Rows that keep their F, and their S, by reason.

        S is kept as long as the tool is in the spindle: between two of its cuts there may be no
        time for another speed.
        """
        both = [(f"keep {text}", self._named(text)) for text in self.settings.keep]
        both += [(f"T{n} cannot keep its limits", self.moves.tool == n) for n in self.given_up]
        feed, speed = [*both], [*both]
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
                feed.append((f"T{one.tool}: {one.kept}", one.rows))
            if one.kept or one.range.cutting_speed_m_min is None:
                why = one.kept or "no range of its cutting speed is known"
                speed.append((f"T{one.tool}: {why}", one.rows))
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
        return self.fed & ~self.cuts & words[line] & ~cutting[line]

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


def _times(length_mm: float, tool: Tool, what: str) -> str:
    return f"{length_mm:.3g} mm {what} is {length_mm / tool.diameter_mm:.2g} D"


def words(operation: Operation) -> str:
    """An operation in words.

    >>> words("ball_finishing")
    'ball finishing'
    """
    return operation.replace("_", " ")
