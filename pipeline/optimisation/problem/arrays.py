"""Arrays of an optimisation: constraints in their order, editable rows, bounds, groups, decisions.

Rows of one line form a block; blocks that share an F form one of G groups, those that share an S
one of H stretches.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.cutting.catalogue import CuttingRange, Operation
from pipeline.gcode.moves import METRE_PER_SECOND, FeedMode, Kind
from pipeline.machine.control.path import Motion
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import MachiningPractice
from pipeline.schema.part import HeldRows
from pipeline.twin.cut.loads import Cut

CONSTRAINTS = (
    "load limit", "deflection", "roughness", "greatest chip", "least chip", "spindle torque",
    "spindle power", "stability", "cutting speed", "spindle speed", "feed", "as programmed",
    "feed per tooth", "change from the program",
)  # fmt: skip
"""Names of the constraints.

``feed as programmed`` holds where the operation allows no more feed per tooth, and in a plunge or a
drill that nothing else bounds; the last two are the tool's range and the greatest change."""

(
    LOAD, DEFLECTION, ROUGHNESS, GREATEST_CHIP, LEAST_CHIP, TORQUE, POWER, STABILITY,
    CUTTING_SPEED, SPINDLE_SPEED, FEED, AS_PROGRAMMED, FEED_PER_TOOTH, CHANGE,
) = range(len(CONSTRAINTS))  # fmt: skip

SAME = 1 + 1e-9
"""Factor by which a value may pass the programmed one and count as it: rounding."""
BEYOND = ("depth of the table", "width of the table", "length of the flutes")
"""Quantities beyond which a cut's feed is no more than programmed; beside the deflection."""

F_Z_CONSTRAINTS = (
    LOAD, DEFLECTION, ROUGHNESS, GREATEST_CHIP, TORQUE, AS_PROGRAMMED, FEED_PER_TOOTH, CHANGE,
)  # fmt: skip
"""Constraints that bound f_z from above, whatever the spindle speed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Bounds:
    """Feed for each tooth of M rows [m], whatever the spindle's speed."""

    most: Floats = field(repr=False)
    """Greatest feed per tooth by each of ``F_Z_CONSTRAINTS`` [m]; infinite where it does not limit;
    shape (8, M)."""
    least: Floats = field(repr=False)
    """Least feed per tooth by the least chip [m]; 0 where there is none; shape (M,)."""
    torque: Floats = field(repr=False)
    """Mean torque over the turn at each row's hardest station, at the nodes of the load table
    [N m]; shape (M, K + 1)."""

    @cached_property
    def high(self) -> Floats:
        """Greatest that all of them allow; infinite in air.  Shape (M,)."""
        return self.most.min(axis=0)

    @cached_property
    def binds(self) -> Rows:
        """Binding one of ``CONSTRAINTS`` for ``high``, -1 where none does; shape (M,)."""
        which = np.array(F_Z_CONSTRAINTS)[self.most.argmin(axis=0)]
        return np.where(np.isfinite(self.high), which, -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Ranges:
    """Ranges of M rows; every array has shape (M,).

    Rows that keep their F have the range of all there is, and so have those that cut nothing their
    range of S: a stretch of one S is bounded by its rows that cut.
    """

    feed_low: Floats = field(repr=False)
    feed_high: Floats = field(repr=False)
    """Least and greatest F [mm/min]."""
    speed_low: Floats = field(repr=False)
    speed_high: Floats = field(repr=False)
    """Least and greatest S [rev/min]."""
    surface_low: Floats = field(repr=False)
    surface_high: Floats = field(repr=False)
    """S that the cutting speed allows; 0 and infinite where it does not limit [rev/min]."""
    counted: Bools = field(repr=False)
    """Rows that must keep within the range of S: those that cut, or whose cut is not known."""


@dataclass(frozen=True, kw_only=True)
class OperationRange:
    """Ranges that hold for one tool in one operation."""

    tool: int
    """Number of the tool."""
    operation: Operation
    """Operation of :data:`pipeline.cutting.catalogue.OPERATIONS`."""
    range: CuttingRange
    """Range with its source; None in it where nothing is known."""
    kept: str = ""
    """Reason why F and S stay as programmed; empty where they may change."""
    rows: Bools = field(repr=False, compare=False)
    """Rows that it holds for; shape (M,)."""


@dataclass(frozen=True, eq=False)
class NotRaised:
    """Rows whose feed for each tooth and F rise no further than programmed, and why."""

    limit: str
    """Quantity that their cut is beyond, a noun."""
    why: str
    """Reason in words, with the values."""
    rows: Bools = field(repr=False)
    """Rows of these; shape (M,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Practice:
    """Limits of M rows; every array has shape (M,) and is infinite (or 0) where nothing limits."""

    settings: MachiningPractice
    """Greatest changes of F and S."""
    operation: NDArray[np.int8] = field(repr=False)
    """Place in :data:`pipeline.cutting.catalogue.OPERATIONS`; -1 of rows that do not move at
    feed."""
    ranges: tuple[OperationRange, ...]
    """Ranges of each tool in each operation."""
    kept_feed: tuple[tuple[str, Bools], ...] = field(repr=False)
    kept_speed: tuple[tuple[str, Bools], ...] = field(repr=False)
    """Rows whose F, S stay as programmed, by reason."""
    no_more: tuple[tuple[str, Bools], ...] = field(repr=False)
    """Rows whose F, S and feed for each tooth do not rise, by the reason for which that is said."""
    given_up: Bools = field(repr=False)
    """Rows of tools that cannot keep their limits: as programmed, and no limit holds for them."""
    f_z_low: Floats = field(repr=False)
    f_z_high: Floats = field(repr=False)
    """Feed for each tooth by the tool's range [m]."""
    f_z_change: Floats = field(repr=False)
    """Greatest feed for each tooth by the change from the program [m]."""
    f_z_own: Floats = field(repr=False)
    """Programmed feed per tooth where the operation or ``not_raised`` allows no more [m]."""
    f_z_bent: Floats = field(repr=False)
    """Feed for each tooth by the bending of the tip, no less than programmed [m]."""
    not_raised: tuple[NotRaised, ...] = field(repr=False)
    """Rows that cut deeper or wider than is known to be safe for more."""
    thicker: Floats = field(repr=False)
    """Greatest feed for each tooth of the range over that of its source: a thin chip [1]."""
    feed_low: Floats = field(repr=False)
    feed_high: Floats = field(repr=False)
    """F by the change from the program [mm/min]."""
    speed_low: Floats = field(repr=False)
    speed_high: Floats = field(repr=False)
    """S by the change from the program, and where no tool life is known [rev/min]."""
    unstable: Bools = field(repr=False)
    """Rows whose stability is not known and that have no requested range of S."""
    surface_low: Floats = field(repr=False)
    surface_high: Floats = field(repr=False)
    """S by the range of the cutting speed and by the least tool life [rev/min]."""
    unit: Floats = field(repr=False)
    """Millimetres in the unit of length that F counts in the text."""
    passes: Rows = field(repr=False)
    """Pass of each row that shares its F with it, -1 for others."""

    @property
    def greatest_f_z(self) -> Floats:
        """Feed for each tooth that no row can pass [m]; shape (M,)."""
        every = (self.f_z_high, self.f_z_change, self.f_z_own, self.f_z_bent)
        return np.minimum.reduce(every)


@dataclass(frozen=True, kw_only=True, eq=False)
class Groups:
    """M rows in G groups of one F and H stretches of one S."""

    feed: Rows = field(repr=False)
    """Group of each row, -1 for rows that keep their F; shape (M,)."""
    speed: Rows = field(repr=False)
    """Stretch of each row, -1 for rows that keep their S; shape (M,)."""
    own_feed: Floats = field(repr=False)
    own_speed: Floats = field(repr=False)
    """F and S as programmed, in the units of ``Moves``; shape (M,)."""

    @property
    def feeds(self) -> int:
        """Number of groups G."""
        return int(self.feed.max(initial=-1)) + 1

    @property
    def speeds(self) -> int:
        """Number of stretches H."""
        return int(self.speed.max(initial=-1)) + 1

    def row_feeds(self, feeds: ArrayLike) -> Floats:
        """F of each row, shape (M,) or (P, M), of those of groups, (G,) or (P, G)."""
        return spread(feeds, self.feed, self.own_feed)

    def row_speeds(self, speeds: ArrayLike) -> Floats:
        """S of each row, shape (M,) or (P, M), of those of stretches, (H,) or (P, H)."""
        return spread(speeds, self.speed, self.own_speed)


def feeds_per_minute(cut: Cut, feeds: Floats, spindle_speed: Floats) -> Floats:
    """F in [mm/min] of feeds in the units of ``Moves``; shape of ``feeds``."""
    by_turn = np.where(cut.plan.path.motion == Motion.PER_TURN, spindle_speed, 1.0)
    return feeds * by_turn * feed_units(cut)


def feed_units(cut: Cut) -> Floats:
    """Feed in [mm/min] of one unit of F, of 1 mm/rev at 1 rev/min; shape (M,)."""
    path = cut.plan.path
    inverse = path.moves.feed_mode == FeedMode.INVERSE_TIME
    return np.where(inverse, path.factor / METRE_PER_SECOND, 1.0)


def first_rows(group: Rows) -> Rows:
    """First row of each group, shape (G,), of the group of each row, -1 for none; shape (M,)."""
    numbers, first = np.unique(group, return_index=True)
    return first[numbers >= 0]


def spread(values: ArrayLike, group: Rows, own: Floats) -> Floats:
    """Values of rows, (..., M), of those of their groups, (..., G); ``own`` in rows of none."""
    given = np.asarray(values, dtype=np.float64)
    padded = np.concatenate([given, np.zeros((*given.shape[:-1], 1))], axis=-1)
    return np.where(group >= 0, padded[..., group], own)


@dataclass(frozen=True, kw_only=True, eq=False)
class Decision:
    """F of each group and S of each stretch."""

    groups: Groups
    """Rows that share an F, and an S."""
    feeds: Floats = field(repr=False)
    """F in the units of ``Moves`` ([mm/min] or [mm/rev]); shape (G,)."""
    speeds: Floats = field(repr=False)
    """Speeds [rev/min]; shape (H,)."""

    @property
    def row_feeds(self) -> Floats:
        """F of each row in the units of ``Moves``, shape (M,)."""
        return self.groups.row_feeds(self.feeds)

    @property
    def row_speeds(self) -> Floats:
        """S of each row [rev/min], shape (M,)."""
        return self.groups.row_speeds(self.speeds)


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Objectives and violated limits of P decisions."""

    objectives: Floats
    """Time [s], cost [currency], energy [kWh], share of tool life [1]; NaN where not known;
    shape (P, 4)."""
    violation: Floats
    """Excess over each limit, as a share of it, summed over rows [1]; 0 inside all limits;
    shape (P,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Editable:
    """F and S that may change in a program of M rows and B editable blocks (lines)."""

    block: Rows = field(repr=False)
    """Block whose F each row takes, -1 for rows that keep theirs; in the order of the program;
    shape (M,)."""
    line: Rows = field(repr=False)
    """Line of each block; shape (B,)."""
    speed: Bools = field(repr=False)
    """Rows whose S may be changed; shape (M,)."""
    may_start: Bools = field(repr=False)
    """Rows whose line may get (or has) an S word: where a stretch of one S can begin;
    shape (M,)."""
    own_start: Bools = field(repr=False)
    """Rows whose line has an S word already; shape (M,)."""
    held: tuple[HeldRows, ...]
    """Blocks that stay as programmed."""


def speeds_between_cuts(editable: Editable, kind: NDArray[np.uint8]) -> Editable:
    """Editable rows with S changes at own S words and rapids alone; ``kind`` (M,): of the moves."""
    fitting = editable.own_start | np.isin(kind, (Kind.RAPID, Kind.SPINDLE))
    return replace(editable, may_start=editable.may_start & fitting)


def one_feed_each_pass(editable: Editable, passes: Rows) -> Editable:
    """Editable rows in which the rows of a pass (M,), -1 for none, are one block of constant S."""
    block, line = editable.block, editable.line
    rows = np.flatnonzero((passes >= 0) & (block >= 0))
    lowest = np.arange(len(line))
    while len(rows):
        of_pass = np.full(int(passes.max()) + 1, len(line))
        np.minimum.at(of_pass, passes[rows], lowest[block[rows]])
        joined = lowest.copy()
        np.minimum.at(joined, block[rows], of_pass[passes[rows]])
        if (joined == lowest).all():
            break
        lowest = joined
    kept, number = np.unique(lowest, return_inverse=True)
    goes_on = (passes >= 0) & (passes == np.roll(passes, 1))
    return replace(
        editable, block=np.where(block >= 0, number[block], -1) if len(line) else block,
        line=line[kept], may_start=editable.may_start & ~goes_on,
    )  # fmt: skip


class RowGroups:
    """Rows of each of U groups; ``group`` (M,): from 0 without gaps, -1 for rows of none."""

    def __init__(self, group: Rows) -> None:
        self.group = group
        order = np.argsort(group, kind="stable")
        self._order = order[np.searchsorted(group[order], 0) :]
        sorted_groups = group[self._order]
        self._first = np.flatnonzero(np.diff(sorted_groups, prepend=-1))
        self._many = np.diff(np.append(self._first, len(self._order)))

    def total(self, values: Floats) -> Floats:
        """Sums over the rows of each group, shape (P, U) of (P, M)."""
        return self._reduced(np.add, values)

    def greatest(self, values: Floats) -> Floats:
        """Greatest values of the rows of each group, shape (P, U) of (P, M)."""
        return self._reduced(np.maximum, values)

    def intersection(self, low: Floats, high: Floats) -> tuple[Floats, Floats]:
        """Interval that all rows of each group have in common, shape (P, U) each of (P, M)."""
        return self.greatest(low), -self.greatest(-high)

    def mean(self, values: Floats) -> Floats:
        """Means over the rows of each group, shape (U,) of (M,)."""
        return self.total(values[None])[0] / np.maximum(self._many, 1)

    def first(self, values: Floats) -> Floats:
        """Value of the first row of each group; shape (U,) of (M,)."""
        return values[self._order[self._first]]

    def common(self, values: Floats) -> Floats:
        """Value that all rows of each group have, NaN where they differ; (U,) of (M,)."""
        (most,), (least,) = self.intersection(values[None], values[None])
        return np.where(least == most, least, np.nan)

    def spread(self, values: Floats, other: Floats) -> Floats:
        """Shape (P, M) of (P, U); ``other`` in rows of no group."""
        return spread(values, self.group, other)

    def _reduced(self, operation: np.ufunc, values: Floats) -> Floats:
        if not len(self._first):
            return np.zeros((len(values), 0))
        return operation.reduceat(values[:, self._order], self._first, axis=1)
