"""Genes of decisions that keep the limits, and one cost for each individual of a search.

A gene of F is a place from 0 to 1 on a logarithmic scale in the interval of F that the limits leave
at the S of its rows (:mod:`pipeline.optimisation.methods.feeds`); genes of S are spindle speeds.
"""

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.path import Motion
from pipeline.optimisation.methods.feeds import common_bounds, feed_bounds
from pipeline.optimisation.problem.arrays import Decision, Groups, RowGroups, first_rows
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.text.words import stepped
from pipeline.schema.arrays import Floats
from pipeline.schema.part import MethodLimits

FINER = (100.0, 10.0, 1.0)
"""Parts of a step of F that are tried where a range is narrow, the last that fits is taken."""
INCH_STEP = 20.0
"""Step of F in millimetres over that in inches [1]: 10 mm/min, 0.5 in/min."""
ROUNDING = 1e-9
"""Excess over limits, as a share, up to which an evaluation keeps them [1]."""
LEAST = 1e-3
"""Least F as a share of the greatest allowed F [1], where the range of F begins below."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundedGenes:
    """Genes of G groups and H stretches: first G shares of F [1], then H speeds [rev/min]."""

    problem: Problem = field(repr=False)
    """Problem of M rows."""
    start: Decision = field(repr=False)
    """Decision whose groups they are; its S may stay as it is, all other S are whole."""
    low: Floats = field(repr=False)
    high: Floats = field(repr=False)
    """Bounds; shape (G + H,)."""

    @classmethod
    def of(cls, problem: Problem, start: Decision) -> "BoundedGenes":
        """The genes of a decision's groups; its S may lie outside of what rows allow."""
        slow, fast = speed_ranges(problem, start.groups, start.speeds)
        slow, fast = np.minimum(slow, start.speeds), np.maximum(fast, start.speeds)
        many = start.groups.feeds
        return cls(
            problem=problem, start=start, low=np.concatenate([np.zeros(many), slow]),
            high=np.concatenate([np.ones(many), fast]),
        )  # fmt: skip

    @property
    def groups(self) -> Groups:
        """Rows that share an F, and an S."""
        return self.start.groups

    @property
    def log(self) -> NDArray[np.bool_]:
        """Genes on a logarithmic scale: the speeds; shape (G + H,)."""
        return np.arange(len(self.low)) >= self.groups.feeds

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F, shape (P, G), and S, shape (P, H), of genes of shape (P, G + H)."""
        many = self.groups.feeds
        speeds = whole(genes[:, many:], self.start.speeds, self.problem.speed_step)
        low, high = group_bounds(self.problem, self.groups, speeds)
        possible = low <= high
        with np.errstate(over="ignore", invalid="ignore"):
            feeds = low * (high / low) ** genes[:, :many]
        # groups without an F that keeps the limits take the greatest that keeps the upper ones
        other = np.where((high > 0) & np.isfinite(high), high, self.start.feeds)
        chosen = np.where(possible, np.minimum(feeds, high), other)
        return _stepped_down(self.problem, self.groups, chosen, low), speeds

    def encoded(self, feeds: Floats, speeds: Floats) -> Floats:
        """Genes, shape (P, G + H), of F, shape (P, G), and S, shape (P, H)."""
        low, high = group_bounds(self.problem, self.groups, speeds)
        wide = high > low
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.log(feeds / low) / np.log(high / low)
        share = np.clip(np.where(wide & np.isfinite(share), share, 1.0), 0.0, 1.0)
        many = self.groups.feeds
        return np.concatenate([share, np.clip(speeds, self.low[many:], self.high[many:])], axis=1)


class WordGenes:
    """Genes that are F [mm/min] and S [rev/min] themselves, from their ranges alone."""

    def __init__(self, problem: Problem, groups: Groups) -> None:
        self.groups, self._step = groups, problem.speed_step
        first = first_rows(groups.feed)
        self._first = first
        self._by_turn = problem.cut.plan.path.motion[first] == Motion.PER_TURN
        (slow,), (fast,) = RowGroups(groups.feed).intersection(
            problem.ranges.feed_low[None], problem.ranges.feed_high[None]
        )
        own = groups.own_speed[first_rows(groups.speed)]
        speeds = speed_ranges(problem, groups, own)
        self.low = np.concatenate([np.minimum(slow, fast), speeds[0]])
        self.high = np.concatenate([fast, speeds[1]])

    def decoded(self, genes: Floats) -> tuple[Floats, Floats]:
        """F in the units of ``Moves``, shape (P, G), and whole S, shape (P, H)."""
        many = len(self._first)
        speeds = np.round(stepped(genes[:, many:], self._step))
        spindle_speed = self.groups.row_speeds(speeds)[:, self._first]
        by_turn = np.where(self._by_turn & (spindle_speed > 0), spindle_speed, 1.0)
        return genes[:, :many] / by_turn, speeds


def whole(speeds: Floats, start: Floats, step: float) -> Floats:
    """Whole S, shape (P, H); those next to where the search began as it had them, (H,)."""
    near = np.abs(speeds - start) < max(0.5, 0.5 * step)
    return np.where(near, start, np.round(stepped(speeds, step)))


def written_feeds(problem: Problem, decision: Decision) -> Decision:
    """A decision with its F as people write them, where that keeps the limits."""
    low, _ = group_bounds(problem, decision.groups, decision.speeds[None])
    feeds = _stepped_down(problem, decision.groups, decision.feeds[None], low)
    return replace(decision, feeds=feeds[0])


def _stepped_down(problem: Problem, groups: Groups, feeds: Floats, low: Floats) -> Floats:
    """F, shape (P, G), in steps, in finer ones where those are below the least of (P, G)."""
    practice = problem.practice
    if practice is None or not groups.feeds:
        return feeds
    first = first_rows(groups.feed)
    unit = practice.unit[first]
    step = practice.settings.feed_step_mm_min * np.where(unit != 1.0, 1 / INCH_STEP, 1.0)
    chosen = feeds
    for finer in FINER:
        down = stepped(feeds / unit, step / finer, np.floor) * unit
        chosen = np.where(down < low, chosen, down)
    return np.where(feeds == groups.own_feed[first], feeds, chosen)


def speed_ranges(problem: Problem, groups: Groups, own: Floats) -> tuple[Floats, Floats]:
    """Least and greatest whole S that suits all rows of each stretch, shape (H,) each.

    Where there is no whole S to choose from it is kept as in ``own``, shape (H,).
    """
    ranges, step = problem.ranges, problem.speed_step
    (low,), (high,) = RowGroups(groups.speed).intersection(
        ranges.speed_low[None], ranges.speed_high[None]
    )
    low = np.maximum(np.ceil(stepped(low, step, np.ceil)), 1.0)
    below = np.floor(stepped(np.minimum(high, 1e9), step, np.floor))
    high = np.where(np.isfinite(high), below, high)
    free = np.isfinite(high) & (low <= high)
    return np.where(free, low, own), np.where(free, high, own)


def group_bounds(problem: Problem, groups: Groups, speeds: Floats) -> tuple[Floats, Floats]:
    """Least and greatest F of each group, (P, G) each, at S (P, H) [rev/min].

    In the units of ``Moves``; the least is above the greatest where no F keeps the limits.
    """
    rows = groups.row_speeds(speeds)
    least, most = common_bounds(problem, RowGroups(groups.feed), *feed_bounds(problem, rows), rows)
    return np.maximum(least, LEAST * most), most


@dataclass(frozen=True, kw_only=True, eq=False)
class Method:
    """Objectives of one method to choose F and S."""

    name: str
    """Name of the method."""
    decision: Decision | None = field(repr=False)
    """F and S that it chose; None for the program as it is."""
    objectives: Floats
    """Time [s], cost, energy [kWh], share of tool life [1]; NaN where not known; shape (4,)."""
    violation: float
    """Sum over rows of what passes each limit, as a share of it [1]; 0 inside all limits."""
    evaluations: int
    """Number of evaluations."""
    limits: MethodLimits = "certain"
    """Load limit at nominal values, or with the probability that is allowed."""
    refused: str = ""
    """Reason why the whole twin does not accept it; empty where it does, or did not check it."""

    @property
    def kept(self) -> bool:
        """Whether it keeps the limits, as far as it was tested."""
        return self.violation <= ROUNDING and not self.refused


def method_of(problem: Problem, name: str, decision: Decision, evaluations: int) -> Method:
    """Objectives and violation of a decision."""
    objectives, violation = problem.decided(decision)
    return Method(name=name, decision=decision, objectives=objectives, violation=violation,
                  evaluations=evaluations)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Front:
    """Decisions of which none is better than another in all that counts."""

    decisions: tuple[Decision, ...] = field(repr=False)
    """F of them, inside all limits, by the first of the objectives that count."""
    objectives: Floats
    """Time [s], cost, energy [kWh], share of tool life [1]; NaN where not known; shape (F, 4)."""
    no_worse: NDArray[np.bool_] = field(repr=False)
    """Members that are in nothing that counts worse than the program as it is; shape (F,)."""
    knee: int
    """The member that gives most for what it takes (:func:`pipeline.search.nsga2.knee`), of
    those that are no worse than the program; of all where there is none."""
    evaluations: int
    """Number of evaluations."""


@dataclass(kw_only=True)
class Fitness:
    """Evaluates individuals, counts them, and keeps the best that was inside all limits.

    With the objective v as a share of a reference, an individual that keeps all limits costs
    v / (1 + v), less than 1 however much it takes; one that does not costs 1 and the sum of its
    violations.  A search that only compares costs never takes a violation for a gain, and no weight
    has to be chosen.
    """

    problem: Problem
    """Problem that evaluates them."""
    genes: BoundedGenes | WordGenes
    """Genes of the individuals."""
    column: int
    """Column of the objective, see :data:`~pipeline.optimisation.settings.OBJECTIVES`."""
    reference: float
    """The objective's size; above 0."""
    weight: float | None = None
    """Weight of violations beside the objective as a share of the reference, as in Sim2023;
    without it limits come first."""
    best: float = inf
    decision: Decision | None = None
    evaluations: int = 0
    history: list[float] = field(default_factory=list)

    def __call__(self, genes: Floats) -> Floats:
        """Costs, shape (P,), of genes, shape (P, D); NaN where the objective is not known."""
        feeds, speeds = self.genes.decoded(genes)
        evaluated = self.problem.evaluate(self.genes.groups, feeds, speeds)
        value = evaluated.objectives[:, self.column]
        inside = evaluated.violation <= 0
        self._keep(np.where(inside, value, inf), feeds, speeds)
        share = value / self.reference
        if self.weight is not None:
            penalised: Floats = share + self.weight * evaluated.violation
            return penalised
        return np.where(inside, share / (1 + share), 1 + evaluated.violation)

    def _keep(self, values: Floats, feeds: Floats, speeds: Floats) -> None:
        values = np.where(np.isnan(values), inf, values)
        self.evaluations += len(values)
        best_so_far = np.minimum.accumulate(np.minimum(values, self.best))
        self.history.extend(best_so_far.tolist())
        k = int(values.argmin())
        if values[k] < self.best:
            self.best = float(values[k])
            self.decision = Decision(
                groups=self.genes.groups, feeds=feeds[k].copy(), speeds=speeds[k].copy()
            )
