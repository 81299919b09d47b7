"""Check of a decision by the whole twin: written as text, read again, planned, cut, followed.

The peaks of the blocks with the greatest loads are those of the waveform over a turn, with each
tooth's runout, within an eighth of a degree, in place of the load table's
(:mod:`pipeline.cutting.force.load_table`); axes lag as their identified drives do.

A following error is proportional to the speed of its axis, so that its excess over the limit is the
share by which the feed has to fall.  A motor command holds Coulomb friction, weight and the edge
forces, which no feed changes, so that it takes more rounds.  Where a residual network gives the
interval of a following error, the limit holds against its worst end, independent of the feed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.waveform import profile_waveform
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import METRE_PER_SECOND, Moves
from pipeline.gcode.program import Program, parse_program
from pipeline.machine.control.path import where
from pipeline.optimisation.job import Job
from pipeline.optimisation.methods.genes import Front, Method, written_feeds
from pipeline.optimisation.problem.arrays import Decision, feeds_per_minute
from pipeline.optimisation.problem.feasible import LimitsError, passed_limit, tool_name
from pipeline.optimisation.problem.limits import row_limits
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.proof.prove import Proof
from pipeline.optimisation.proof.text import WordChange
from pipeline.optimisation.reliability.chance_constraint import Exceedance
from pipeline.optimisation.reliability.part_loads import critical
from pipeline.optimisation.reliability.uncertainty import Uncertainty
from pipeline.optimisation.text.rewrite import matching_rows, rewrite
from pipeline.optimisation.text.words import rounded_feeds, rounded_speeds
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import AxisInCut
from pipeline.schema.limits import CutLimit, limit_words
from pipeline.twin.control import planned_program
from pipeline.twin.cut.axes import NEWTON, CutFollowing, axes_in_cut, follow_cut
from pipeline.twin.cut.loads import Cut, recut
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import Residual

AMPERE = "A"
LIMITED = ("following_um", "motor_command_A")
UM = 1e6
AXIS_SLACK = 1e-3
"""Excess over a limit, as a share, that counts as rounding."""
FALLING = 1e-3
"""Share by which an error falls from one position to the next where an earlier block caused it."""
LEAST_FACTOR = 0.5
"""Least factor of a feed in one round."""
ALIKE = 0.98
"""Factor on feeds that have to go down, for what does not fall with them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxesCheck:
    """Axes of a cut of M rows, and the feeds by their limits."""

    axes: tuple[AxisInCut, ...]
    """Axes whose drives are known."""
    factor: Floats = field(repr=False)
    """Factor by which each row's feed has to go down, 1 where it need not; shape (M,)."""
    limit: str = ""
    """Limit that is passed most, in words; empty where all are kept."""
    why_not: str = ""
    """Limit that is passed, with its place, in one sentence."""
    reason: str = ""
    """Reason why no figures are there; empty where there are some."""


def check_axes(
    cut: Cut, drives: Mapping[str, IdentifiedDrive] | None, limits: CutLimit | None = None,
    residual: Residual | None = None,
) -> AxesCheck:  # fmt: skip
    """Follow a cut with its drives and what they leave over, and hold them against the limits."""
    free = np.ones(len(cut.plan.path))
    if not drives:
        return AxesCheck(axes=(), factor=free, reason="no drives were identified")
    try:
        followed = follow_cut(cut, drives, residual=residual)
    except ValueError as error:
        return AxesCheck(axes=(), factor=free, reason=str(error))
    if not followed.cut:
        return AxesCheck(axes=(), factor=free, reason=_unknown(drives))
    axes = axes_in_cut(followed, cut.plan.path.moves.line)
    if limits is None or not followed.load.cutting.any():
        return AxesCheck(axes=axes, factor=free)
    factor, limit, why_not = _held_against(cut, followed, drives, limits)
    return AxesCheck(axes=axes, factor=factor, limit=limit, why_not=why_not)


def check_axes_known(drives: Mapping[str, IdentifiedDrive], limits: CutLimit) -> None:
    """Refuse limits of the axes that cannot be judged."""
    for name in LIMITED:
        limit = getattr(limits, name)
        if limit is None:
            continue
        known = {a: d for a, d in drives.items() if d.servo is not None and d.force_unit == NEWTON}
        if not known:
            raise ValueError(
                f"limits.{name} = {limit:g} cannot be kept: {_unknown(drives)}: record the drives "
                "and run `dvc repro`, or leave the limit out"
            )
        other = next((a for a, d in known.items() if d.command_unit != AMPERE), None)
        if name == "motor_command_A" and other is not None:
            raise ValueError(
                f"limits.{name} = {limit:g} cannot be kept: the command of axis {other} is in "
                f"{known[other].command_unit}: leave the limit out"
            )


def _unknown(drives: Mapping[str, IdentifiedDrive]) -> str:
    if not drives:
        return "no drives were identified"
    unlisted = [a for a, d in drives.items() if d.servo is not None and d.force_unit != NEWTON]
    if unlisted:
        return f"the force constant of axis {', '.join(unlisted)} is not listed"
    return "no axis that moves has an identified servo"


def _held_against(
    cut: Cut, followed: CutFollowing, drives: Mapping[str, IdentifiedDrive], limits: CutLimit
) -> tuple[Floats, str, str]:
    """Factors of the rows' feeds, shape (M,), the limit that is passed most, and a sentence."""
    moves, kept = cut.plan.path.moves, 1.0 - limits.margins.axes
    factor, worst, words, why_not = np.ones(len(moves)), 1.0 + AXIS_SLACK, "", ""
    for letter, one in followed.cut.items():
        screw = drives[letter].feed_drive
        still = (screw.friction.positive.coulomb + abs(screw.offset)) / screw.force_constant
        width = np.zeros(len(one.error)) if one.half_width is None else one.half_width * UM
        for name, values, unit, base in (
            ("following_um", np.abs(one.error) * UM + width, "um", width),
            ("motor_command_A", np.abs(one.command), one.command_unit, np.full(len(width), still)),
        ):
            limit = getattr(limits, name)
            if limit is None:
                continue
            size = np.where(followed.load.cutting, values, 0.0)
            over = size > limit * kept * (1.0 + AXIS_SLACK)
            if name == "following_um":
                over &= ~_falls(size)
            if not over.any():
                continue
            rest = np.maximum(size[over] - base[over], 1e-12)
            share = 1.0 - (size[over] - limit * kept) / rest
            np.minimum.at(factor, one.row[over], np.maximum(ALIKE * share, LEAST_FACTOR))
            k = int(np.argmax(np.where(over, size, 0.0)))
            if size[k] / (limit * kept) > worst:
                worst = float(size[k] / (limit * kept))
                about = limit_words(name)[0].name
                words = f"limit of {limit:g} {unit} on the {about} of axis {letter}"
                what = "is behind by" if name == "following_um" else "draws"
                why_not = (
                    f"{where(moves, int(one.row[k]))}: axis {letter} {what} {size[k]:.4g} {unit} "
                    f"in the cut{_of_it(width, k, name)}, its limit of {limit:g} {unit} allows "
                    f"{limit * kept:.4g} {unit}, "
                    f"and no feed of its range keeps it: raise limits.{name} or take less depth"
                )
    return factor, words, why_not


def _of_it(width: Floats, k: int, name: str) -> str:
    """Share of a following error at sample k that half of its interval makes up, in words."""
    return f", {width[k]:.4g} um of it uncertain" if name == "following_um" and width[k] else ""


def _falls(values: Floats) -> Bools:
    return np.diff(values, prepend=values[:1]) < -FALLING * values


SLACK = 1e-4
"""Excess over a limit, as a share, that counts as rounding."""
STEP = 0.98
"""Share of a feed at which the slope of the load over it is taken."""
CHECKED_ROWS = 256
"""Rows of an answer whose waveforms are computed: those of the greatest loads."""
WAVEFORM_ROWS = 64
"""Rows whose waveforms are computed by default: those with the greatest loads of the table."""
ANGLES = 360
"""Angles of a turn of the spindle, at least."""
FINER = 8
"""Parts into which the angles next to the greatest load are divided."""
NOTHING = 1e-6
"""Load that counts as none [N]: that of teeth in balance is what rounding leaves."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Verified:
    """Loads and following errors of M rows by the whole twin."""

    row_peak: Floats = field(repr=False)
    """Peak across the tool's axis [N]: of the waveform where it was computed, else of the table;
    shape (M,)."""
    ratio: Floats = field(repr=False)
    """Peak of the waveform over that of the table; 1 where none was computed; shape (M,)."""
    computed: NDArray[np.bool_] = field(repr=False)
    """Whether a waveform was computed; shape (M,)."""
    f_z: Floats = field(repr=False)
    """Feed for each tooth at the highest speed reached [m]; shape (M,)."""
    axes: AxesCheck
    """Following error and motor command in the cut, against their limits."""

    @property
    def following_um(self) -> dict[str, float] | None:
        """Greatest following error of each axis in the cut [um]; None where not known."""
        return None if self.axes.reason else {a.axis: a.following_um for a in self.axes.axes}

    @property
    def peak_N(self) -> float:
        """Greatest load of the part [N]."""
        return float(self.row_peak.max(initial=0.0))

    @property
    def peak_row(self) -> int:
        """Row of the peak; -1 where nothing is cut."""
        return int(np.argmax(self.row_peak)) if self.peak_N > 0 else -1


@dataclass(frozen=True, kw_only=True, eq=False)
class TwinAnswer:
    """A decision as the whole twin sees it."""

    decision: Decision = field(repr=False)
    """F and S before rounding."""
    text: bytes = field(repr=False)
    """The program with its feeds and speeds, rounded as words are."""
    changes: tuple[WordChange, ...] = field(repr=False)
    """Changes against the program as it was."""
    cut: Cut = field(repr=False)
    """Cut of the optimised text; M' rows."""
    rows: NDArray[np.intp] = field(repr=False)
    """Row of the new program for each row of the program as it was; shape (M,)."""
    objectives: Floats
    """Objectives of the rounded values in the order of
    :data:`~pipeline.optimisation.settings.OBJECTIVES`; shape (4,)."""
    verified: Verified = field(repr=False)
    """Loads by tooth passing, following errors."""
    f_z_cap: Floats = field(repr=False)
    """Feed for each tooth to which each row has to go down for its load [m]; infinite where it need
    not; shape (M,)."""
    feed_cap: Floats = field(repr=False)
    """F to which each row has to go down for its axes [mm/min]; infinite where it need not;
    shape (M,)."""
    why_not: LimitsError | None
    """Limit that is passed; None where all are kept."""

    @property
    def kept(self) -> bool:
        """Whether all limits are kept."""
        return self.why_not is None


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """Answer of an optimisation, with its proof, its risk and the methods beside it."""

    job: Job = field(repr=False)
    """Program, machine, limits."""
    moves: Moves = field(repr=False)
    before: Cut = field(repr=False)
    """Cut of the program as programmed, in the blocks that long ones are split into."""
    written: Cut = field(repr=False)
    """Cut of the program as written."""
    problem: Problem = field(repr=False)
    """Problem in its last form, after tightening."""
    blockwise: Decision = field(repr=False)
    """Blockwise optimum."""
    answer: TwinAnswer = field(repr=False)
    """The answer with its text, as the whole twin sees it."""
    proof: Proof
    """Proof of equality in all but F and S."""
    methods: tuple[Method, ...]
    """The answer beside the baselines, with certainty and at nominal values."""
    front: Front | None = None
    """Front of the objectives, of the objective ``pareto``."""
    uncertain: Uncertainty | None = None
    """Uncertainty of the loads; None without a load limit."""
    nominal: str | None = None
    """Method whose results at nominal values and with certainty make the price of certainty."""
    risk: Exceedance | None = None
    """Risk of the load limit, by the answer."""
    tightened: int = 0
    """Rounds in which loads by the whole twin lowered feeds."""
    evaluated: int = 0
    """Evaluations of the whole twin."""
    interrupted: bool = False
    """Whether the search was ended early."""
    split: str | None = None
    """Gain of splitting long blocks, in words; None without splitting."""
    given_up: Mapping[int, str] = field(default_factory=dict)
    """Tools that stay as programmed since they cannot keep their limits, by number, and why."""


def full_twin(
    job: Job, program: Program, moves: Moves, problem: Problem, decision: Decision,
    certain_f_z: Floats | None,
) -> TwinAnswer:  # fmt: skip
    """Write ``decision`` into the program and check it by the whole twin.

    ``certain_f_z`` (M,): feed for each tooth up to which each row keeps the load limit [m]; None
    without a limit.
    """
    decision = written_feeds(problem, decision)
    feeds = rounded_feeds(program, moves, decision.row_feeds)
    speeds = rounded_speeds(decision.row_speeds)
    written = rewrite(program, moves, problem.editable, feeds, speeds, job.setup)
    after = interpret(parse_program(written.text, program.name), job.setup)
    rows = matching_rows(moves, after)
    cut = recut(problem.cut, planned_program(after, job.models.control), rows)
    evaluated = problem.evaluate_rows(feeds[np.newaxis], speeds[np.newaxis])
    verified = verify(
        cut, drives=job.models.drives, rows=CHECKED_ROWS, limits=job.limits,
        residual=job.models.residual,
    )  # fmt: skip
    loaded, f_z_cap = cut.feed_per_tooth[rows], np.full(len(moves), np.inf)
    if certain_f_z is not None:
        f_z_cap = _f_z_cap(problem.cut, certain_f_z, loaded, verified, rows)
    factor = verified.axes.factor[rows]
    reached = np.minimum(
        feeds_per_minute(problem.cut, feeds, problem.spindle_speed(speeds)),
        cut.plan.v_peak[rows] / METRE_PER_SECOND,
    )
    violation = float(evaluated.violation[0])
    return TwinAnswer(
        decision=decision, text=written.text, changes=written.changes, cut=cut, rows=rows,
        objectives=evaluated.objectives[0], verified=verified, f_z_cap=f_z_cap,
        feed_cap=np.where(factor < 1.0, factor * reached, np.inf),
        why_not=_why_not(
            problem, (feeds, speeds), violation, f_z_cap,
            verified.row_peak[rows],
        ) or (LimitsError(verified.axes.why_not) if verified.axes.why_not else None),
    )  # fmt: skip


def _f_z_cap(
    cut: Cut, certain_f_z: Floats, reached: Floats, verified: Verified, rows: NDArray[np.intp]
) -> Floats:
    """Feeds for each tooth that bring passing teeth down to the load of the table [m].

    The table's load at the certain feed stands for the limit; where teeth that pass one by one make
    more of the feed that is reached, the excess over the table's slope has to go.
    """
    bound = np.isfinite(certain_f_z)  # elsewhere no feed reaches the limit
    allowed = cut.table.peaks(np.where(bound, certain_f_z, reached))
    here = cut.table.peaks(reached)
    excess = verified.ratio[rows] * here - allowed
    slope = (here - cut.table.peaks(STEP * reached)) / (1 - STEP)  # [N] for the whole feed
    over = bound & (excess > SLACK * allowed) & (slope > 0)
    share = np.divide(excess, slope, out=np.zeros(len(over)), where=over)
    return np.where(over, np.maximum(1 - share, LEAST_FACTOR) * reached, np.inf)


def _why_not(
    problem: Problem, words: tuple[Floats, Floats], violation: float, f_z_cap: Floats,
    peak: Floats,
) -> LimitsError | None:  # fmt: skip
    """The limit that F and S, rounded as words, pass with loads ``peak`` of rows; None for none."""
    moves = problem.cut.plan.path.moves
    if violation > SLACK:
        named = passed_limit(problem, *words)
        rounded = "F and S, rounded as words of the program are: "
        return LimitsError(
            f"{rounded}{named}"
            if named
            else f"{moves.files[0]}: F and S, rounded as words of the program are, pass a limit by "
            f"{100 * violation:.2g} % in all: widen the ranges of F and S",
            named.tool if named else None,
        )
    capped = np.isfinite(f_z_cap)
    if capped.any():
        row = int(np.argmax(np.where(capped, peak, -1.0)))
        most = row_limits(problem.cut, problem.limits, "load_N")
        return LimitsError(
            f"{where(moves, row)}: teeth that pass one by one load {tool_name(problem, row)} with "
            f"{peak[row]:.4g} N, and the load limit of {most[row]:g} N less its margin "
            "and what is uncertain allows less at any feed that was tried: raise limits.load_N",
            int(moves.tool[row]),
        )
    return None


def verify(
    cut: Cut, *, drives: Mapping[str, IdentifiedDrive] | None = None, rows: int = WAVEFORM_ROWS,
    limits: CutLimit | None = None, residual: Residual | None = None,
) -> Verified:  # fmt: skip
    """Whole twin on the plan of a cut, with waveforms of the ``rows`` of greatest load."""
    f_z, peak = cut.feed_per_tooth, cut.block_loads.peak
    worst = np.argsort(-peak, kind="stable")[:rows]
    worst = worst[peak[worst] > NOTHING]
    candidates = critical(cut, worst)
    exact = np.zeros(len(peak))
    for row, station in zip(candidates.row.tolist(), candidates.own_station.tolist(), strict=True):
        exact[row] = max(exact[row], station_peak(cut, station, float(f_z[row])))
    computed = exact > 0
    return Verified(
        row_peak=np.where(computed, exact, peak),
        ratio=np.divide(exact, peak, out=np.ones(len(peak)), where=computed),
        computed=computed, f_z=f_z, axes=check_axes(cut, drives, limits, residual),
    )  # fmt: skip


def station_peak(cut: Cut, station: int, f_z: float) -> float:
    """Peak of the waveform at a station across the tool's axis [N], at a feed for each tooth."""
    tool = cut.tools[cut.engagement.tool[station]]
    several = tool.runout > 0 and tool.flutes > 1
    period = 2 * np.pi / (1 if several else tool.flutes)
    many = ceil(ANGLES / (1 if several else tool.flutes))
    step = period / many
    angles: Floats = step * np.arange(many, dtype=np.float64)
    load = _loads(cut, station, f_z, angles)
    place = FINER * int(np.argmax(load)) + np.arange(1.0 - FINER, FINER)
    about: Floats = step / FINER * place
    return float(max(load.max(), _loads(cut, station, f_z, about).max()))


def _loads(cut: Cut, station: int, f_z: float, angles: Floats) -> Floats:
    engagement = cut.engagement
    index = int(engagement.tool[station])
    forces = profile_waveform(
        cut.force_laws[index], cut.tools[index], f_z=f_z, lower=engagement.lower[station],
        upper=engagement.upper[station], angles=angles,
        slope=float(np.clip(engagement.slope[station], -1.0, 1.0)),
        ring=engagement.rings.of(station),
    )  # fmt: skip
    return np.hypot(forces[:, 0], forces[:, 1])
