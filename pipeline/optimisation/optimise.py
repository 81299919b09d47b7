"""Optimisation of a part program: faster or cheaper inside its limits.

The blockwise optimum comes first, a genetic search goes on from it in the fast planner and the load
table.  Both answers are checked by the whole twin; rows whose loads the table took too low get less
feed, and the search begins again.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import tool_limits
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.full_twin import Result, TwinAnswer, check_axes_known, full_twin
from pipeline.optimisation.job import (
    Interrupted,
    Job,
    JobRequest,
    Progress,
    job_of,
)
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.genes import Front, Method, method_of, written_feeds
from pipeline.optimisation.methods.genetic import baselines, improve, pareto
from pipeline.optimisation.methods.speeds import staying
from pipeline.optimisation.operation_signs import long_in_air
from pipeline.optimisation.practice import practice_of
from pipeline.optimisation.problem.arrays import (
    Decision,
    Editable,
    Practice,
    one_feed_each_pass,
    speeds_between_cuts,
)
from pipeline.optimisation.problem.feasible import (
    LimitsError,
    check_known,
    problem_of,
    with_feed_cap,
    with_load,
)
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.proof.prove import Proof, prove
from pipeline.optimisation.reliability.chance_constraint import (
    ChanceConstrainedFeeds,
    Exceedance,
    chance_constrained_feeds,
    exceedance,
)
from pipeline.optimisation.reliability.part_loads import cut_ranges
from pipeline.optimisation.reliability.uncertainty import Uncertainty, uncertainty
from pipeline.optimisation.settings import OBJECTIVES
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.split import SplitProgram, split_blocks
from pipeline.optimisation.text.words import rounded_feeds, rounded_speeds
from pipeline.schema.arrays import Floats
from pipeline.schema.part import Objective
from pipeline.twin.control import planned_program
from pipeline.twin.cut.blocks import cut_blocks
from pipeline.twin.cut.loads import Cut, cut_program
from pipeline.twin.cut.warnings import missed_blank

ANSWER, DIRECT = "answer", "direct"
"""Names of the answer and of the blockwise optimum among the methods."""
ROUNDS = 4
"""Rounds of tightening where the whole twin finds loads above the limit."""
AXIS_ROUNDS = 8
"""Rounds of tightening where limits of the axes were given: commands fall by less than feeds."""

GivenUp = Mapping[int, str]
"""Tools that cannot keep their limits, by number, and why."""
NOTHING: GivenUp = {}
SHARES = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
"""Wear over the criterion, in the order in which it is tried [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Outcome:
    """Result of the search in its last, tightened problem."""

    problem: Problem
    blockwise: Decision
    answer: TwinAnswer
    front: Front | None
    evaluations: int


def optimise(job: Job, progress: Progress | None = None) -> Result:
    """Best program that keeps the limits of ``job``.

    Raises Interrupted when the search was ended before anything kept the limits.
    """
    return _best(_Optimisation(job, progress or _alone, NOTHING))


def optimise_worn(request: JobRequest, progress: Progress | None = None) -> Result:
    """Best program that keeps the limits until its tools are changed.

    Where no feed keeps them at the criterion of wear, it is lowered to the greatest of ``SHARES``
    that allows one; a requested wear is not.  Raises as :func:`optimise` does.
    """
    whole = job_of(request)
    wear, coefficients = whole.basis.wear, whole.basis.coefficients.values()
    fixed = wear.rule != "criterion" or wear.requested or wear.given
    if fixed or all(one.sharp is None for one in coefficients):
        return optimise(whole, progress)
    given_up = NOTHING
    while True:  # again without the tools that cannot keep their limits even when they are sharp
        for share in SHARES[:-1]:
            try:
                run = _Optimisation(job_of(request, share), progress or _alone, given_up)
                kept = run.outcome()
            except LimitsError:
                continue
            return kept if kept.interrupted else _best(run, kept)
        sharp = _best(_Optimisation(job_of(request, SHARES[-1]), progress or _alone, given_up))
        if sharp.given_up == given_up:
            return sharp
        given_up = sharp.given_up


def _alone(what: str, share: float) -> bool:
    return False


@dataclass(frozen=True, kw_only=True, eq=False)
class _Text:
    """A program, its moves and their cut; of parts of blocks, the operations of these blocks."""

    program: Program
    moves: Moves
    cut: Cut
    whole: NDArray[np.int8] | None = None
    points: int = 0


class _Optimisation:
    """Optimisation in progress."""

    def __init__(
        self, job: Job, progress: Progress, given_up: GivenUp, text: _Text | None = None
    ) -> None:
        self.job, self.progress, self.text = job, progress, text or _as_programmed(job)
        self.interrupted = False
        if job.settings.with_residual and job.models.residual is None:
            raise ValueError(
                "optimisation.with_residual is true and no residual model is loaded: leave the "
                "setting out here, and give `kerf optimise --residual` for a part"
            )
        self.evaluated = self.tightened = 0
        self.program, self.moves, self.before = self.text.program, self.text.moves, self.text.cut
        check_known(self.before, job.limits, job.basis.drive)
        check_axes_known(job.models.drives, job.limits)
        self.given_up = dict(given_up)
        self._begin()

    def _begin(self) -> None:
        """Practice and certain feeds of the tools that are to keep their limits."""
        self.practice, self.editable = self._practice()
        self.uncertain, self.certain = self._chance_constraint()
        self.f_z = None if self.certain is None else self.certain.f_z.copy()
        self.editable = self._passes_joined()
        self.feed_cap = np.full(len(self.moves), np.inf)

    def ends(self, what: str, share: float) -> bool:
        """Report progress; whether the search is to end."""
        if self.job.settings.grouping.split:  # the program as it is comes first, then its parts
            share = 0.5 * (share + (self.text.points > 0))
        self.interrupted = self.progress(what, share) or self.interrupted
        return self.interrupted

    def result(self) -> Result:
        """Best program, with tools that cannot keep their limits as programmed."""
        while True:
            try:
                return self.outcome()
            except LimitsError as error:
                cut, tool = self.before, error.tool
                used = np.unique(cut.tool[cut.tool >= 0]).tolist()
                left = {cut.numbers[k] for k in used if cut.tools[k].load_known} - {*self.given_up}
                if self.practice is None or tool is None or tool not in left or len(left) == 1:
                    raise
                self.given_up[tool] = str(error)
                self._begin()

    def outcome(self) -> Result:
        """Search, check by the whole twin, tighten where loads pass the limit, and compare."""
        job = self.job
        outcome = self._search(self._problem())
        problem = outcome.problem
        if outcome.answer.why_not is not None:
            raise Interrupted if self.interrupted else outcome.answer.why_not
        self.ends("comparing", 0.8)
        answer, methods = self._methods(problem, outcome)
        nominal = self._nominal(problem)
        return Result(
            job=job, moves=self.moves, before=self.before, written=self.before, problem=problem,
            blockwise=outcome.blockwise, answer=answer, proof=self._proof(answer),
            methods=(*methods, *nominal), front=outcome.front, uncertain=self.uncertain,
            nominal=DIRECT if nominal else None, risk=self._risk(answer),
            tightened=self.tightened, evaluated=self.evaluated, interrupted=self.interrupted,
            given_up=self.given_up,
        )  # fmt: skip

    def _problem(self) -> Problem:
        problem = problem_of(
            self.before, self.job.basis, self.job.limits, self.editable, f_z_load=self.f_z,
            practice=self.practice,
        )  # fmt: skip
        return staying(problem, self.job.settings.grouping)

    def in_parts(self) -> "_Optimisation | None":
        """The same with long blocks split where their best F differ; None where none do."""
        settings, practice = self.job.settings.grouping, self.practice
        rows = self.editable.block >= 0
        in_air = np.ones(len(self.moves), dtype=np.bool_)
        if practice is not None:
            rows &= practice.passes < 0
            if practice.settings.air_feed_mm_min is None:
                in_air = long_in_air(self.before, cut_blocks(self.before))
        split = split_blocks(self.program, self.moves, self.before, settings, rows, in_air)
        if not split.added:
            return None
        parts = self._of_parts(split)
        feeds = parts._blockwise(parts._problem()).row_feeds
        split = split.without(split.alike(parts.moves, feeds, settings.split_gain))
        return self._of_parts(split) if split.added else None

    def _of_parts(self, split: SplitProgram) -> "_Optimisation":
        moves = interpret(split.program, self.job.setup)
        cut = cut_program(planned_program(moves, self.job.models.control), self.job.cut)
        of = None if self.practice is None else self.practice.operation[split.whole_rows(moves)]
        text = _Text(program=split.program, moves=moves, cut=cut, whole=of, points=len(split.added))
        return _Optimisation(self.job, self.progress, self.given_up, text)

    @property
    def _limits_N(self) -> Floats:
        """Load limit of each tool of the cut [N], infinite where none holds; shape (T,)."""
        outside = [k for k, number in enumerate(self.before.numbers) if number in self.given_up]
        return tool_limits(self.before.tools, "load_N", self.job.limits.load_N, outside)

    def _practice(self) -> tuple[Practice | None, Editable]:
        job = self.job
        if job.catalogue is None:
            return None, editable_blocks(self.program, self.moves)
        practice = practice_of(
            self.program, self.moves, self.before, limits=job.limits, catalogue=job.catalogue,
            material=job.basis.material, dynamics=job.basis.dynamics, whole=self.text.whole,
            given_up=self.given_up,
        )  # fmt: skip
        editable = editable_blocks(
            self.program, self.moves, practice.kept_feed, practice.kept_speed, practice.no_more
        )
        return practice, speeds_between_cuts(editable, self.moves.kind)

    def _passes_joined(self) -> Editable:
        """Editable rows with one F for each pass but where the load limit needs less."""
        if self.practice is None:
            return self.editable
        passes = self.practice.passes
        if self.f_z is not None:
            passes = np.where(self.f_z < self.before.commanded_feed_per_tooth(), -1, passes)
        return one_feed_each_pass(self.editable, passes)

    def _settled(
        self, problem: Problem, solve: Callable[[Problem], tuple[Decision, Front | None]]
    ) -> _Outcome:
        """The solution of a problem that is tightened until the whole twin accepts it."""
        for rounds in count():
            decision, front = solve(problem)
            full = self._full(problem, decision)
            axes = bool(np.isfinite(full.feed_cap).any())
            spent = rounds >= (AXIS_ROUNDS if axes else ROUNDS) or self.interrupted
            spent = spent or self.evaluated >= self.job.settings.search.full
            if full.kept or spent or not (axes or np.isfinite(full.f_z_cap).any()):
                break
            problem = self._tightened(problem, full)
            self.tightened += 1
        return _Outcome(
            problem=problem, blockwise=decision, answer=full, front=front, evaluations=1
        )

    def _tightened(self, problem: Problem, answer: TwinAnswer) -> Problem:
        """The problem with less feed where loads or axes pass their limit by the whole twin."""
        if self.f_z is not None:
            self.f_z = np.minimum(self.f_z, answer.f_z_cap)
            problem = with_load(problem, self.f_z)
        if np.isfinite(answer.feed_cap).any():
            self.feed_cap = np.minimum(self.feed_cap, answer.feed_cap)
            problem = with_feed_cap(problem, self.feed_cap, answer.verified.axes.limit)
        return problem

    def _chance_constraint(self) -> tuple[Uncertainty | None, ChanceConstrainedFeeds | None]:
        limits_N, settings = self._limits_N, self.job.settings.certainty
        if not np.isfinite(limits_N).any():
            return None, None
        if self.ends("drawing what is uncertain", 0.05):
            raise Interrupted
        basis, models = self.job.basis, self.job.models
        uncertain = uncertainty(
            basis.coefficients, self.job.cut.tools, models.cutting, models.judged, settings,
            ranges=cut_ranges(self.before),
        )  # fmt: skip
        margin = self.job.limits.margins.load
        most = None if self.practice is None else self.practice.greatest_f_z
        feeds = chance_constrained_feeds(
            self.before, limits_N, margin, uncertain, settings, greatest=most
        )
        return uncertain, feeds

    @property
    def objective(self) -> Objective:
        """Objective of the blockwise optimum: a front begins with the fastest."""
        return "time" if self.job.objective == "pareto" else self.job.objective

    def _search(self, problem: Problem) -> _Outcome:
        """Best answer that the whole twin accepts: blockwise, then genetic, or of a front."""
        if self.ends("solving block by block", 0.2):
            raise Interrupted
        direct = self._settled(problem, lambda one: (self._blockwise(one), None))
        if self.ends("searching", 0.3):
            return direct
        if self.job.objective == "pareto":
            front = self._settled(direct.problem, self._knee)
            return replace(front, blockwise=direct.blockwise) if front.answer.kept else direct
        better = improve(
            direct.problem, direct.blockwise, self.objective, self.job.settings.search, self._each
        )
        return replace(
            direct, answer=self._better(direct, better.decision or direct.blockwise),
            evaluations=1 + better.evaluations,
        )  # fmt: skip

    def _blockwise(self, problem: Problem) -> Decision:
        optimum = blockwise_optimum(problem, self.objective, self.job.settings.grouping)
        return written_feeds(problem, optimum)

    def _knee(self, problem: Problem) -> tuple[Decision, Front]:
        front = self._front(problem, self._blockwise(problem))
        return front.decisions[front.knee], front

    def _better(self, direct: _Outcome, decision: Decision) -> TwinAnswer:
        """The better of the blockwise optimum and another decision that the whole twin accepts."""
        if decision is direct.blockwise:
            return direct.answer
        self.ends("whole twin", 0.6)
        which = OBJECTIVES.index(self.objective)
        other = self._full(direct.problem, decision)
        kept = [one for one in (direct.answer, other) if one.kept] or [direct.answer]
        return min(kept, key=lambda one: float(one.objectives[which]))

    def _front(self, problem: Problem, fastest: Decision) -> Front:
        values = problem.evaluate_rows(fastest.row_feeds[None], fastest.row_speeds[None])
        known = [o for o, v in zip(OBJECTIVES, values.objectives[0], strict=True) if np.isfinite(v)]
        grouping = self.job.settings.grouping
        starts = [
            fastest,
            *(blockwise_optimum(problem, one, grouping) for one in known if one != "time"),
        ]
        return pareto(problem, starts, tuple(known), self.job.settings.search, self._each)

    def _each(self, generation: int, _: Floats, __: object) -> bool:
        share = generation / self.job.settings.search.generations
        return self.ends("searching", 0.3 + 0.3 * min(share, 1.0))

    def _full(self, problem: Problem, decision: Decision) -> TwinAnswer:
        self.evaluated += 1
        certain = None if self.certain is None else self.certain.f_z
        return full_twin(self.job, self.program, self.moves, problem, decision, certain)

    def _proof(self, answer: TwinAnswer) -> Proof:
        name, split = self.job.program.name, self.text.points > 0
        proof = prove(self.job.program.data, answer.text, name, name, self.job.setup, splits=split)
        if not proof.same:
            raise ValueError(
                f"{name}: the rewritten program does not prove to be the same "
                f"({proof.first}): keep the program as it is and report this"
            )
        return proof

    def _risk(self, answer: TwinAnswer) -> Exceedance | None:
        settings = self.job.settings.certainty
        if self.uncertain is None:
            return None
        return exceedance(
            answer.cut, answer.cut.feed_per_tooth, self._limits_N, self.uncertain, settings,
            seed=settings.seed + 1,
        )  # fmt: skip

    def _methods(
        self, problem: Problem, outcome: _Outcome
    ) -> tuple[TwinAnswer, tuple[Method, ...]]:
        """Answer, and beside it the blockwise optimum and the baselines, all as written."""
        answer, which = outcome.answer, OBJECTIVES.index(self.objective)
        methods, contest = [], self.job.objective != "pareto"
        for one in self._others(problem, outcome.blockwise):
            better = one.kept and one.objectives[which] < answer.objectives[which]
            if not (better and contest):
                methods.append(one)
                continue
            full = self._full(problem, one.decision or _unchanged(outcome.blockwise))
            refused = str(full.why_not or "")
            methods.append(replace(one, objectives=full.objectives, refused=refused))
            if full.kept and full.objectives[which] < answer.objectives[which]:
                answer = full
        final = Method(
            name=ANSWER, decision=answer.decision, objectives=answer.objectives, violation=0.0,
            evaluations=outcome.evaluations,
        )  # fmt: skip
        return answer, (*methods, final)

    def _nominal(self, problem: Problem) -> tuple[Method, ...]:
        """The same methods where every value is as stated; the answer's last.

        It is not put through the whole twin.  A front's knee is not searched again.
        """
        if self.certain is None or self.interrupted:
            return ()
        nominal = with_load(problem, self.certain.nominal)
        optimum = blockwise_optimum(nominal, self.objective, self.job.settings.grouping)
        methods = self._others(nominal, optimum)
        which = OBJECTIVES.index(self.objective)
        if self.job.objective != "pareto":
            better = improve(
                nominal, optimum, self.objective, self.job.settings.search, self._compared
            )
            found = self._written(
                nominal,
                method_of(nominal, ANSWER, better.decision or optimum, 1 + better.evaluations),
            )
            best = min(
                (one for one in (found, *methods) if one.kept),
                key=lambda one: float(one.objectives[which]), default=found,
            )  # fmt: skip
            methods.append(replace(best, name=ANSWER, evaluations=found.evaluations))
        return tuple(replace(one, limits="nominal") for one in methods)

    def _others(self, problem: Problem, optimum: Decision) -> list[Method]:
        """Blockwise optimum of a problem among the baselines, as words hold them."""
        direct = method_of(problem, DIRECT, optimum, 1)
        if self.interrupted:
            return [self._written(problem, direct)]
        found = baselines(
            problem, optimum.groups, self.objective, self.job.settings.search, self._compared
        )
        return [self._written(problem, one) for one in (*found[:1], direct, *found[1:])]

    def _written(self, problem: Problem, method: Method) -> Method:
        """Method with the objectives of its F and S rounded as words are.

        Its limits are not checked again: F is rounded down, S by less than a word shows.
        """
        if method.decision is None:
            return method
        decision = written_feeds(problem, method.decision)
        feeds = rounded_feeds(self.program, self.moves, decision.row_feeds)
        speeds = rounded_speeds(decision.row_speeds)
        objectives = problem.evaluate_rows(feeds[None], speeds[None]).objectives[0]
        return replace(method, objectives=objectives)

    def _compared(self, _: int, __: Floats, ___: object) -> bool:
        return self.ends("comparing", 0.85)


def _unchanged(decision: Decision) -> Decision:
    """The program as it is: no row shares an F or an S that is chosen."""
    groups, none = decision.groups, np.full(len(decision.groups.feed), -1, dtype=np.intp)
    return Decision(
        groups=replace(groups, feed=none, speed=none), feeds=np.zeros(0), speeds=np.zeros(0)
    )


def _as_programmed(job: Job) -> _Text:
    program, moves = job.program, job.moves
    cut = cut_program(planned_program(moves, job.models.control), job.cut)
    if not (cut.tool >= 0).any():
        said = missed_blank(cut, job.basis.stock)
        why = "no move at feed is in the material" if said is None else said.what
        raise ValueError(
            f"{program.name}: nothing is cut: {why}: give the blank that the program cuts"
        )
    return _Text(program=program, moves=moves, cut=cut)


def _best(run: _Optimisation, whole: Result | None = None) -> Result:
    """Better of the program as it is (``whole``) and with long blocks split where that gains."""
    grouping, refused = run.job.settings.grouping, None
    try:
        whole = whole or run.result()
    except LimitsError as error:
        refused = error
        if not grouping.split:
            raise
    if whole is not None and not grouping.split:
        return whole
    split, points = None, 0
    with suppress(ValueError, Interrupted):  # what splitting cannot do, the whole program can
        parts = None if run.interrupted else run.in_parts()
        if parts is not None:
            split, points = replace(parts.result(), written=run.before), parts.text.points
    at = f"long blocks are split at {points} point{'s' * (points > 1)}"
    if whole is None:
        if split is None:
            raise refused or Interrupted
        return replace(split, split=f"{at}: without that no F and S keep the limits")
    gain = 0.0 if split is None else _gain(whole, split)
    if split is not None and gain > points * grouping.least_gain:
        return replace(split, split=f"{at}, which gains {100 * gain:.2g} %")
    ended = run.interrupted or run.progress("splitting", 1.0)
    nothing = "splitting long blocks gains nothing: none is split"
    return replace(whole, split=nothing, interrupted=ended)


def _gain(whole: Result, split: Result) -> float:
    """Share of the objective that splitting saves; of a front's knee the least of all."""
    objective = whole.job.objective
    known = [OBJECTIVES.index(objective)] if objective in OBJECTIVES else slice(None)
    return float(np.nanmin(1 - split.answer.objectives[known] / whole.answer.objectives[known]))
