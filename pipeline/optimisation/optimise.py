"""Optimisation of a part program: faster or cheaper inside its limits.

The blockwise optimum comes first; it is exact where blocks do not interact.  A genetic search goes
on from it in the fast planner and the load table.  The answers of both are written as text, read
again, and checked by the whole twin: speeds that the control reaches, loads by tooth passing,
servo.  Rows whose loads the table took too low get less feed, and the search begins again.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program, parse_program
from pipeline.optimisation.axis_limits import check_axes_known
from pipeline.optimisation.full_twin import Full, Result, full_twin
from pipeline.optimisation.job import Interrupted, Job, Progress
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.methods.genes import Front, Method, method_of
from pipeline.optimisation.methods.genetic import baselines, improve
from pipeline.optimisation.methods.pareto import pareto
from pipeline.optimisation.problem.arrays import Decision, Editable
from pipeline.optimisation.problem.feasible import check_known, problem_of, with_feed_cap, with_load
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.proof.prove import Proof, prove
from pipeline.optimisation.reliability.chance_constraint import (
    ChanceConstrainedFeeds,
    Exceedance,
    chance_constrained_feeds,
    exceedance,
)
from pipeline.optimisation.reliability.uncertainty import Uncertainty, uncertainty
from pipeline.optimisation.settings import OBJECTIVES
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.split import split_blocks
from pipeline.schema.arrays import Floats
from pipeline.schema.part import Objective
from pipeline.twin.control import planned_program
from pipeline.twin.cut import Cut, cut_program
from pipeline.twin.cut_limits import missed_blank

ROUNDS = 4
"""Rounds of tightening where the whole twin finds loads above the limit."""
AXIS_ROUNDS = 8
"""The same where limits of the axes were given: commands fall by less than feeds do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """Result of one round; ``written``: objectives of the blockwise optimum, rounded as words."""

    blockwise: Decision
    written: Floats | None
    answer: Full
    front: Front | None
    evaluations: int


def optimise(job: Job, progress: Progress | None = None) -> Result:
    """The best program that keeps the limits of ``job``.

    Raises
    ------
    ValueError
        When the program cannot be followed, nothing is cut, a tool is not in the table, nothing
        limits a feed, or no feed and speed keep the limits.
    Interrupted
        When the search was ended before anything kept the limits.
    """
    return _Course(job, progress or _alone).result()


def _alone(what: str, share: float) -> bool:
    return False


class _Course:
    """An optimisation under way."""

    def __init__(self, job: Job, progress: Progress) -> None:
        self.job, self._progress = job, progress
        self.interrupted = False
        self.evaluated = 0
        self.program, self.moves, self.before = _as_programmed(job)
        check_known(self.before, job.limits, job.basis.drive)
        self.editable: Editable = editable_blocks(self.program, self.moves)
        self.uncertain, self.certain = self._chance_constraint()
        self.f_z = None if self.certain is None else self.certain.f_z.copy()
        check_axes_known(job.models.drives, job.limits)
        self.feed_cap = np.full(len(self.moves), np.inf)

    def ends(self, what: str, share: float) -> bool:
        """Report progress; whether the search is to end."""
        self.interrupted = self._progress(what, share) or self.interrupted
        return self.interrupted

    def result(self) -> Result:
        """Search, check by the whole twin, tighten where loads pass the limit, and compare."""
        job, tightened = self.job, 0
        problem = problem_of(self.before, job.basis, job.limits, self.editable, f_z_load=self.f_z)
        while True:
            outcome = self._search(problem)
            answer, done = outcome.answer, self.evaluated >= job.settings.search.full
            axes = bool(np.isfinite(answer.feed_cap).any())
            if answer.kept or done or tightened >= (AXIS_ROUNDS if axes else ROUNDS):
                break
            if self.f_z is None and not axes:
                break
            problem = self._tightened(problem, answer)
            tightened += 1
        if not answer.kept:
            raise ValueError(answer.why_not)
        self.ends("comparing", 0.8)
        return Result(
            job=job, moves=self.moves, before=self.before, problem=problem,
            blockwise=outcome.blockwise, answer=answer, proof=self._proof(answer),
            methods=self._methods(problem, outcome), front=outcome.front, uncertain=self.uncertain,
            nominal=self._nominal(problem), risk=self._risk(answer),
            tightened=tightened, evaluated=self.evaluated, interrupted=self.interrupted,
        )  # fmt: skip

    def _tightened(self, problem: Problem, answer: Full) -> Problem:
        """The problem with less feed where loads or axes pass their limit by the whole twin."""
        if self.f_z is not None:
            self.f_z = self.f_z * answer.tightening
            problem = with_load(problem, self.f_z)
        if np.isfinite(answer.feed_cap).any():
            self.feed_cap = np.minimum(self.feed_cap, answer.feed_cap)
            problem = with_feed_cap(problem, self.feed_cap, answer.verified.axes.limit)
        return problem

    def _chance_constraint(self) -> tuple[Uncertainty | None, ChanceConstrainedFeeds | None]:
        limit, settings = self.job.limits.load_N, self.job.settings.certainty
        if limit is None:
            return None, None
        if self.ends("drawing what is uncertain", 0.05):
            raise Interrupted
        basis, models = self.job.basis, self.job.models
        uncertain = uncertainty(
            basis.coefficients, self.job.cut.tools, models.cutting, models.judged, settings
        )
        margin = self.job.limits.margins.load
        feeds = chance_constrained_feeds(self.before, limit, margin, uncertain, settings)
        return uncertain, feeds

    @property
    def objective(self) -> Objective:
        """Objective of the blockwise optimum: a front begins with the fastest."""
        return "time" if self.job.objective == "pareto" else self.job.objective

    def _search(self, problem: Problem) -> "_Found":
        """The blockwise optimum, the best that the whole twin accepts, and the front."""
        if self.ends("solving block by block", 0.2):
            raise Interrupted
        grouping, settings = self.job.settings.grouping, self.job.settings.search
        optimum = blockwise_optimum(problem, self.objective, grouping)
        elite, front, evaluations = [optimum], None, 1
        if not self.ends("searching", 0.3):
            if self.job.objective == "pareto":
                front = self._front(problem, optimum)
                elite = [front.decisions[front.knee]]
            else:
                better = improve(problem, optimum, self.objective, settings, self._each)
                evaluations += better.evaluations
                elite.append(better.decision)
        self.ends("whole twin", 0.6)
        checked = [self._full(problem, one) for one in elite]
        kept = [one for one in checked if one.kept] or checked
        index = OBJECTIVES.index(self.objective)
        return _Found(
            blockwise=optimum, front=front,
            written=checked[0].objectives if front is None else None,
            answer=min(kept, key=lambda one: float(one.objectives[index])),
            evaluations=evaluations,
        )  # fmt: skip

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

    def _full(self, problem: Problem, decision: Decision) -> Full:
        self.evaluated += 1
        certain = None if self.certain is None else self.certain.f_z
        return full_twin(self.job, self.program, self.moves, problem, decision, certain)

    def _proof(self, answer: Full) -> Proof:
        name, split = self.job.program.name, self.job.settings.grouping.split
        proof = prove(self.job.program.data, answer.text, name, name, self.job.setup, splits=split)
        if not proof.same:
            raise ValueError(
                f"{name}: the rewritten program does not prove to be the same "
                f"({proof.first}): keep the program as it is and report this"
            )
        return proof

    def _risk(self, answer: Full) -> Exceedance | None:
        limit, settings = self.job.limits.load_N, self.job.settings.certainty
        if limit is None or self.uncertain is None:
            return None
        return exceedance(
            answer.cut, answer.cut.feed_per_tooth, limit, self.uncertain, settings,
            seed=settings.seed + 1,
        )  # fmt: skip

    def _methods(self, problem: Problem, outcome: "_Found") -> tuple[Method, ...]:
        """The answer beside the blockwise optimum as it would be written, and the baselines."""
        answer = outcome.answer
        final = Method(
            name="answer", decision=answer.decision, objectives=answer.objectives, violation=0.0,
            evaluations=outcome.evaluations,
        )  # fmt: skip
        first = method_of(problem, "direct", outcome.blockwise, 1)
        if outcome.written is not None:
            first = replace(first, objectives=outcome.written)
        if self.interrupted:
            return first, final
        settings = self.job.settings.search
        others = baselines(
            problem, outcome.blockwise.groups, self.objective, settings, self._compared
        )  # fmt: skip
        return (*others[:1], first, *others[1:], final)

    def _compared(self, _: int, __: Floats, ___: object) -> bool:
        return self.ends("comparing", 0.85)

    def _nominal(self, problem: Problem) -> Method | None:
        """The blockwise optimum at nominal values."""
        if self.certain is None or self.interrupted:
            return None
        nominal = with_load(problem, self.certain.nominal)
        optimum = blockwise_optimum(nominal, self.objective, self.job.settings.grouping)
        return method_of(nominal, "nominal", optimum, 1)


def _as_programmed(job: Job) -> tuple[Program, Moves, Cut]:
    """Program (its long blocks split where the settings say so), moves and cut."""
    program = job.program
    moves = interpret(program, job.setup)
    cut = cut_program(planned_program(moves, job.models.control), job.cut)
    if not (cut.tool >= 0).any():
        said = missed_blank(cut, job.basis.stock)
        why = "no move at feed is in the material" if said is None else said.what
        raise ValueError(
            f"{program.name}: nothing is cut: {why}: give the blank that the program cuts"
        )
    if not job.settings.grouping.split:
        return program, moves, cut
    data = split_blocks(program, moves, cut, job.settings.grouping)
    program = parse_program(data, program.name)
    moves = interpret(program, job.setup)
    return program, moves, cut_program(planned_program(moves, job.models.control), job.cut)
