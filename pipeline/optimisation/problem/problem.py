"""An optimisation as arrays: what limits each row, and what a population of F and S makes of it.

Loads, chips and power count at the speed that is asked for or, where that is less, what axes, arcs
and tolerances allow: at least what the control reaches.  Times, wear and energy are those of the
look-ahead.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.machine.control.commands import spindle_speeds
from pipeline.machine.control.path import Motion
from pipeline.optimisation.problem.bounds import Bounds, bounds_of
from pipeline.optimisation.problem.chatter import Chatter, Lobes
from pipeline.optimisation.problem.constraints import CONSTRAINTS
from pipeline.optimisation.problem.decision import Evaluation
from pipeline.optimisation.problem.drive_power import power_feeds
from pipeline.optimisation.problem.evaluation import evaluation, row_objectives
from pipeline.optimisation.problem.feasible import check
from pipeline.optimisation.problem.groups import Groups
from pipeline.optimisation.problem.nearness import nearest, shares
from pipeline.optimisation.problem.objectives import Demand, demand_of
from pipeline.optimisation.problem.ranges import Ranges, ranges_of
from pipeline.optimisation.problem.speed_changes import SpeedChanges, speed_changes
from pipeline.optimisation.settings import CutLimit
from pipeline.optimisation.text.editable import Editable
from pipeline.twin.cut import Cut
from pipeline.twin.cut_blocks import CutBlocks, cut_blocks, station_arcs
from pipeline.twin.cut_cost import tool_life
from pipeline.twin.cut_document import CutBasis

__all__ = ["CONSTRAINTS", "Problem", "problem_of"]

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """M rows, what limits them, what they take.

    Parameters
    ----------
    cut : Cut
        Of the program as it is.
    basis : CutBasis
        What it is judged by.
    limits : CutLimit
        Of the part.
    editable : Editable
        What may be changed.
    blocks : CutBlocks
        Of the cut.
    bounds : Bounds
        Feed for each tooth of each row, whatever the speed.
    ranges : Ranges
        F and S of each row.
    demand : Demand
        Objectives of each row.
    lobes : Lobes
        Of stability.
    """

    cut: Cut = field(repr=False)
    basis: CutBasis = field(repr=False)
    limits: CutLimit
    editable: Editable = field(repr=False)
    blocks: CutBlocks = field(repr=False)
    bounds: Bounds = field(repr=False)
    ranges: Ranges = field(repr=False)
    demand: Demand = field(repr=False)
    lobes: Lobes = field(repr=False)

    def __len__(self) -> int:
        return len(self.cut.plan.path)

    @cached_property
    def cuts(self) -> Flags:
        """Rows that cut at feed; shape (M,)."""
        return self.cut.tool >= 0

    @cached_property
    def flutes(self) -> Floats:
        """Teeth of the tool of each row, 0 where nothing is cut; shape (M,)."""
        many = np.array([tool.flutes for tool in self.cut.tools], dtype=np.float64)
        return np.where(self.cuts, many[self.cut.tool], 0.0)

    @cached_property
    def f_z_low(self) -> Floats:
        """Least feed for each tooth [m]; shape (M,)."""
        return self.bounds.least

    @cached_property
    def f_z_high(self) -> Floats:
        """Greatest feed for each tooth, whatever the speed [m]; infinite in air.  Shape (M,)."""
        return self.bounds.high

    @cached_property
    def binds_high(self) -> Rows:
        """Which of ``CONSTRAINTS`` makes it, -1 where none does; shape (M,)."""
        return self.bounds.binds

    @property
    def feed_low(self) -> Floats:
        """[mm/min]; shape (M,)."""
        return self.ranges.feed_low

    @property
    def feed_high(self) -> Floats:
        """[mm/min]; shape (M,)."""
        return self.ranges.feed_high

    @property
    def speed_low(self) -> Floats:
        """[rev/min]; shape (M,)."""
        return self.ranges.speed_low

    @property
    def speed_high(self) -> Floats:
        """[rev/min]; shape (M,)."""
        return self.ranges.speed_high

    @property
    def chatter(self) -> Chatter | None:
        """Margins of stability; None where no dynamics are known."""
        return self.lobes.chatter

    def with_load(self, f_z_load: Floats) -> "Problem":
        """The same with another bound of the load, as :func:`problem_of` takes it.

        Lobes are not computed again.
        """
        bounds = bounds_of(self.cut, self.blocks, self.limits, f_z_load)
        other = replace(self, bounds=bounds, demand=self.demand.with_bounds(bounds))
        check(other, certain=True)
        return other

    def turns(self, speeds: ArrayLike) -> Floats:
        """Speed of the spindle [rev/min] for S of shape (..., M)."""
        asked = np.asarray(speeds, dtype=np.float64)
        return spindle_speeds(self.cut.plan.path, asked.reshape(-1, len(self))).reshape(asked.shape)

    def power_f_z(self, speeds: ArrayLike) -> Floats:
        """Greatest feed for each tooth that the drive allows at S of shape (..., M) [m]."""
        turns = self.turns(speeds)
        if self.basis.drive is None:
            return np.full(turns.shape, np.inf)
        found = power_feeds(self.cut, self.bounds.torque, turns, self.basis.drive, self.limits)
        return np.where(self.cuts, found, np.inf)

    def stable(self, speeds: ArrayLike) -> Flags:
        """Whether rows keep the margin of stability at S of shape (..., M); where known."""
        asked = np.asarray(speeds, dtype=np.float64)
        if self.chatter is None:
            return np.ones(asked.shape, dtype=np.bool_)
        margins = self.chatter.margins(self.turns(asked).reshape(-1, len(self)))
        stable: Flags = ~(margins < self.limits.margins.stability)
        return stable.reshape(asked.shape)

    def feed_per_tooth(self, feeds: ArrayLike, speeds: ArrayLike) -> Floats:
        """f_z of each row at F and S [m], shape (M,) or (P, M); 0 in air."""
        asked = np.broadcast_arrays(np.asarray(feeds, float), self.turns(speeds))
        return self.cut.feed_per_tooth_at(self.speed(*asked), asked[1])

    def speed(self, feeds: Floats, turns: Floats) -> Floats:
        """Along the path at F, as fast as axes and arcs allow [m/s]; shape of both."""
        path = self.cut.plan.path
        by_turn = np.where(path.motion == Motion.PER_TURN, turns, 1.0)
        allowed: Floats = np.minimum(path.factor * feeds * by_turn, path.cap)
        return allowed

    def row_objectives(self, feeds: ArrayLike, speeds: ArrayLike) -> Floats:
        """What rows take, each at its F all along.

        Parameters
        ----------
        feeds, speeds : array_like, shape (..., M)
            F and S in the units of ``Moves``.

        Returns
        -------
        ndarray, shape (4, ..., M)
            Time [s], cost, energy [kWh], share of tool life [1]; NaN where not known.
        """
        both = np.broadcast_arrays(np.asarray(feeds, float), np.asarray(speeds, float))
        feed, speed = (np.ascontiguousarray(one.reshape(-1, len(self))) for one in both)
        return row_objectives(self, feed, speed).reshape(4, *both[0].shape)

    def speed_change_time(self, before: ArrayLike, after: ArrayLike) -> Floats:
        """What the program waits for a change of S of a turning spindle [s].

        Parameters
        ----------
        before, after : array_like
            [rev/min], shapes that broadcast.
        """
        return self.speed_changes.time(before, after)

    @cached_property
    def speed_changes(self) -> SpeedChanges:
        """Where S can change."""
        return speed_changes(self.cut.plan, self.editable, self.cuts)

    def evaluate(self, groups: Groups, feeds: ArrayLike, speeds: ArrayLike) -> Evaluation:
        """What a population makes of the part.

        Parameters
        ----------
        groups : Groups
            What shares an F, what an S.
        feeds : array_like, shape (P, G)
            In the units of ``Moves``.
        speeds : array_like, shape (P, H)
            [rev/min].
        """
        feed, speed = np.asarray(feeds, float), np.asarray(speeds, float)
        return evaluation(
            self, len(feed),
            lambda part: (groups.row_feeds(feed[part]), groups.row_speeds(speed[part])),
        )  # fmt: skip

    def evaluate_rows(self, feeds: ArrayLike, speeds: ArrayLike) -> Evaluation:
        """The same for F and S of rows, of shape (P, M)."""
        feed, speed = np.asarray(feeds, float), np.asarray(speeds, float)
        return evaluation(self, len(feed), lambda part: (feed[part], speed[part]))

    def binding(self, feeds: ArrayLike, speeds: ArrayLike) -> Rows:
        """Which of ``CONSTRAINTS`` each row is at, -1 where none; F, S and answer of shape (M,)."""
        return nearest(shares(self, np.asarray(feeds, float), np.asarray(speeds, float)))


def problem_of(
    cut: Cut, basis: CutBasis, limits: CutLimit, editable: Editable, *,
    f_z_load: Floats | None = None,
) -> Problem:  # fmt: skip
    """What limits the rows of a cut, and what they take.

    Parameters
    ----------
    cut : Cut
        Of M rows.
    basis : CutBasis
        What it is judged by.
    limits : CutLimit
        Of the part.
    editable : Editable
        What may be changed.
    f_z_load : ndarray, shape (M,), optional
        Feed for each tooth up to which the load keeps its limit [m]; by default that of the load
        table.

    Raises
    ------
    ValueError
        When nothing limits the feed of a tool that cuts, when no feed and speed of the ranges keep
        the limits of a row, or when a row that cannot be changed is beyond one.
    """
    arcs = station_arcs(cut.engagement, cut.tools)
    blocks = cut_blocks(cut, arcs)
    bounds = bounds_of(cut, blocks, limits, f_z_load)
    ranges = ranges_of(cut, cut.tool >= 0, limits, editable, basis.drive)
    life = tool_life(cut, blocks, arcs, basis.material)
    problem = Problem(
        cut=cut,
        basis=basis,
        limits=limits,
        editable=editable,
        blocks=blocks,
        bounds=bounds,
        ranges=ranges,
        demand=demand_of(cut, blocks, life, basis, limits, bounds, ranges),
        lobes=Lobes(cut, blocks, basis.dynamics, ranges, editable.speed),
    )
    check(problem, certain=f_z_load is not None)
    return problem
