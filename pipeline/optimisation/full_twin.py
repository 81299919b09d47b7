"""A decision as the whole twin sees it: written as text, read again, planned, cut, followed."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program, parse_program
from pipeline.machine.control.path import where
from pipeline.optimisation.job import Job
from pipeline.optimisation.problem.decision import Decision
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.text.matching import matching_rows
from pipeline.optimisation.text.rewrite import WordChange, rewrite, rounded_feeds, rounded_speeds
from pipeline.optimisation.verify import Verified, verify
from pipeline.twin.cut import Cut, recut
from pipeline.twin.program import planned_program

Floats = NDArray[np.float64]

SLACK = 1e-4
"""Over a limit, as a share, that counts as rounding."""
STEP = 0.98
"""Of a feed, to see how loads grow with it."""
ROWS = 256
"""Whose waveforms are computed: those of the greatest loads."""
LEAST = 0.5
"""What feeds are lowered to in one round at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Full:
    """What the whole twin makes of a decision.

    Parameters
    ----------
    decision : Decision
        What was asked.
    text : bytes
        The program with its feeds and speeds, rounded as words are.
    changes : tuple of WordChange
        Against the program as it was.
    cut : Cut
        Of that text; M' rows.
    rows : ndarray of intp, shape (M,)
        Its row for each row of the program as it was.
    objectives : ndarray, shape (4,)
        Of the rounded values, as :data:`~pipeline.optimisation.settings.OBJECTIVES`.
    verified : Verified
        Loads by tooth passing, following errors.
    tightening : ndarray, shape (M,)
        Factor by which each row's feed for each tooth has to go down, 1 where it need not.
    why_not : str
        Which limit is passed; empty where all are kept.
    """

    decision: Decision = field(repr=False)
    text: bytes = field(repr=False)
    changes: tuple[WordChange, ...] = field(repr=False)
    cut: Cut = field(repr=False)
    rows: NDArray[np.intp] = field(repr=False)
    objectives: Floats
    verified: Verified = field(repr=False)
    tightening: Floats = field(repr=False)
    why_not: str

    @property
    def kept(self) -> bool:
        """Whether all limits are kept."""
        return not self.why_not


def full_twin(
    job: Job, program: Program, moves: Moves, problem: Problem, decision: Decision,
    certain: Floats | None,
) -> Full:  # fmt: skip
    """Write ``decision`` into the program and judge it by the whole twin.

    Parameters
    ----------
    job : Job
        What was asked.
    program, moves : Program, Moves
        As it was; M rows.
    problem : Problem
        Of its cut.
    decision : Decision
        F and S.
    certain : ndarray, shape (M,), or None
        Feed for each tooth up to which each row keeps the load limit [m]; None without a limit.

    Raises
    ------
    ValueError
        When the text cannot hold the decision.
    """
    feeds = rounded_feeds(program, moves, decision.row_feeds)
    speeds = rounded_speeds(decision.row_speeds)
    written = rewrite(program, moves, problem.editable, feeds, speeds, job.setup)
    after = interpret(parse_program(written.text, program.name), job.setup)
    rows = matching_rows(moves, after)
    cut = recut(problem.cut, planned_program(after, job.control), rows)
    found = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis])
    verified = verify(cut, drives=job.drives, rows=ROWS)
    tightening = np.ones(len(moves))
    if certain is not None:
        tightening = _tightening(problem.cut, certain, cut.feed_per_tooth[rows], verified, rows)
    return Full(
        decision=decision, text=written.text, changes=written.changes, cut=cut, rows=rows,
        objectives=found.objectives[0], verified=verified, tightening=tightening,
        why_not=_why_not(job, program, moves, tightening, float(found.violation[0])),
    )  # fmt: skip


def _tightening(
    cut: Cut, certain: Floats, reached: Floats, verified: Verified, rows: NDArray[np.intp]
) -> Floats:
    """Factors of the feed for each tooth that bring passing teeth down to what the table promised.

    The table's load at the certain feed stands for the limit; where teeth that pass one by one make
    more of the feed that is reached, the excess over the table's slope has to go.
    """
    bound = np.isfinite(certain)  # elsewhere no feed reaches the limit
    allowed = cut.table.peaks(np.where(bound, certain, reached))
    here = cut.table.peaks(reached)
    excess = verified.ratio[rows] * here - allowed
    slope = (here - cut.table.peaks(STEP * reached)) / (1 - STEP)  # [N] for the whole feed
    over = bound & (excess > SLACK * allowed) & (slope > 0)
    share = np.divide(excess, slope, out=np.zeros(len(over)), where=over)
    return np.where(over, np.maximum(1 - share, LEAST), 1.0)


def _why_not(
    job: Job, program: Program, moves: Moves, tightening: Floats, violation: float
) -> str:  # fmt: skip
    if violation > SLACK:
        return (
            f"{program.name}: feeds and speeds, rounded as words of the program are, pass a limit "
            f"by {100 * violation:.2g} % in all: widen the ranges of F and S"
        )
    if tightening.min(initial=1.0) < 1.0:
        row = int(np.argmin(tightening))
        return (
            f"{where(moves, row)}: passing teeth load the tool more than the limit of "
            f"{job.limits.load_N:g} N allows, whatever the feed: raise the limit"
        )
    return ""
