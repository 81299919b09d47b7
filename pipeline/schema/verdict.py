"""Stored verdict: errors beside those of baselines, limits, judgement, distance from training."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, SupportsFloat

from pipeline.schema.model import Condition, LeftOut, Origin

Role = Literal["training", "held_out", "golden", "sealed"]
"""Use of a case: fitted on; not fitted on; frozen to judge by; scored at promotion only."""
Status = Literal["passed", "failed", "not decided", "not judged"]
"""Status; not decided: nearer to a limit than trainings differ or the sensor resolves."""
UsedStatus = Literal[Status, "not identified"]
"""Status of a sub-model that figures rest on; one that no record identified has no verdict."""
MOST_PERCENT = 1000.0
"""Relative error above which what was measured is next to nothing beside it [%]."""
OF_NOTHING = f"more than {MOST_PERCENT:g} % of nearly 0"
"""Such an error in words."""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Errors of a prediction against what was measured, in the unit of the quantity."""

    mae: float | None = None
    rmse: float | None = None
    max: float | None = None
    """Mean absolute, root mean square, largest absolute error."""
    bias: float | None = None
    """Mean of predicted less measured."""
    relative_percent: float | None = None
    """RMSE over the RMS of what was measured [%]."""
    max_percent: float | None = None
    """Largest error over the largest measured magnitude [%]."""
    peak_percent: float | None = None
    mean_percent: float | None = None
    """Error of the largest value and of the mean, over those measured [%], with their sign."""


@dataclass(frozen=True, kw_only=True)
class Score(Figures):
    """Errors of one quantity in one group (a day, a recording, a tool) and regime."""

    quantity: str
    unit: str
    """Predicted quantity and its unit."""
    group: str
    regime: str
    """Group and regime of the cases; the group ``"all"`` is all of one role together."""
    role: Role
    """Role of the cases."""
    n: int
    """Number of samples, where measurement and all predictors are known."""
    coverage_90: float | None = None
    """Share of samples inside the 90 % prediction interval [1]; None without intervals."""
    half_width: float | None = None
    """Mean half width of that interval; the ideal one of normal errors is 1.64 RMSE."""
    baselines: Mapping[str, Figures] = field(default_factory=dict)
    """Errors of each baseline on the same samples."""
    limits: Mapping[str, float] = field(default_factory=dict)
    """Greatest value of an error (by its name above), empty where nothing is required."""
    coverage_limits: tuple[float, float] | None = None
    """Least and greatest ``coverage_90`` [1], of a score over all groups; None where none is
    set."""
    spread: Mapping[str, float] = field(default_factory=dict)
    """Half of the 95 % interval of each figure, by its name above, over trainings with other seeds;
    empty where nothing was trained, or nothing is decided."""
    rounding: Mapping[str, Figures] = field(default_factory=dict)
    """Rounding of each baseline, the difference of MAE and of RMSE that the sensor's steps leave
    open; empty where the measurement is fine enough."""
    status: Status = "not judged"
    """Whether all limits are kept; "not judged" for training cases and without limits."""
    reasons: tuple[str, ...] = ()
    """Limits that are passed or not decided, with values; or the reason of no judgement."""
    inside_ratio: float | None = None
    """Half width over RMSE inside of the learnt conditions [1]; None where that is not parted."""
    unknown_interval: str = ""
    """Reason why the 90 % interval is not stated; empty where it is."""
    alone: bool = False
    """Whether it is the only one of its target that failed and is left out of the score over all
    groups, since a single record does not decide."""

    @property
    def half_width_over_rmse(self) -> float | None:
        """Half-width of the interval over the RMSE [1], inside of the learnt conditions."""
        if self.inside_ratio is not None:
            return self.inside_ratio
        return self.half_width / self.rmse if self.half_width and self.rmse else None

    @property
    def others(self) -> Mapping[str, Figures]:
        """Baselines that are not the model itself, which then has the same errors."""
        own = (self.mae, self.rmse, self.max, self.bias)
        return {
            name: one for name, one in self.baselines.items()
            if (one.mae, one.rmse, one.max, one.bias) != own
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Skill:
    """Share of a baseline's error saved, 1 - error / error of the baseline [1].

    The 95 % intervals are of a bootstrap that draws whole groups; None with fewer than three.
    """

    quantity: str
    regime: str
    baseline: str
    groups: int
    mae: float | None
    mae_interval_95: tuple[float, float] | None
    rmse: float | None
    rmse_interval_95: tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class OutsideConditions:
    """A case outside of a condition of training, whose range ``learnt`` says."""

    case: str
    condition: str
    value: float | str
    unit: str
    learnt: str


@dataclass(frozen=True, kw_only=True)
class Fact:
    """A number or a word about a case that its sub-model says beside the prediction."""

    value: float | str | None
    unit: str = ""


@dataclass(frozen=True, kw_only=True)
class JudgedCase:
    """One case that was compared: its role, why it was not where it was not, and its facts."""

    case: str
    group: str
    role: Role
    conditions: Mapping[str, Fact] = field(default_factory=dict)
    facts: Mapping[str, Fact] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class GoldenUsed:
    """The golden set that a verdict rests on: its hash, files, and first and last day if any."""

    sha256: str
    files: int
    first: str = ""
    last: str = ""


@dataclass(frozen=True, kw_only=True)
class Canary:
    """A check of whether a model has seen what it predicts; a failed one fails the verdict."""

    name: str
    status: Literal["passed", "failed"]
    """Name of the check, and its result."""
    words: str
    """Figures that it rests on; the cause and what to do where it failed."""


@dataclass(frozen=True, kw_only=True)
class NextRecording:
    """A recording, and how far it is expected to narrow an interval."""

    record: str
    """The recording in a sentence that an operator can follow."""
    minutes: float | None = None
    """Time that it takes [min]; None where it takes as long as the records so far."""
    interval: str
    """Interval that decides, in words."""
    unit: str
    """Unit of its half widths."""
    now: float | None = None
    """Half of it by the records so far; None where they do not determine it."""
    expected: float | None = None
    """Half of it with the recording among the training records; None where nothing tells."""
    gain_percent: float | None = None
    """How much narrower that is [%]; None where one of both is not known."""
    uncertain_percent: float = 0.0
    """Standard deviation of half the interval by chance [%]: a smaller gain is not noticed."""
    method: str
    """How the gain was computed."""

    @property
    def noticed(self) -> bool:
        """Whether the gain is above what the interval varies by chance."""
        return self.gain_percent is None or self.gain_percent > self.uncertain_percent

    @property
    def proposal(self) -> str:
        """The recording in a sentence, which says so where no gain is promised."""
        if self.noticed:
            return self.record
        length = f" of {self.minutes:g} minutes" if self.minutes else ""
        return f"no recording{length} narrows it noticeably; the best would be: {self.record}"


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The content of ``verdict.json``."""

    submodel: str
    machine: str
    origin: Origin
    """Sub-model, machine, and origin of its records."""
    status: Status
    """Status of the sub-model."""
    reasons: tuple[str, ...]
    """Reasons of a failure or of no judgement, the gravest first."""
    judged_role: Role | None
    """Judged role of the cases that decided: golden ones where there are some, else held-out
    ones."""
    golden: GoldenUsed | None
    """Golden set used; None where none was frozen."""
    scores: tuple[Score, ...]
    """Scores by quantity, group, regime and role."""
    skills: tuple[Skill, ...] = ()
    """Over the groups that decided, against each baseline."""
    outside: tuple[OutsideConditions, ...] = ()
    """Cases outside of the conditions of training."""
    cases: tuple[JudgedCase, ...] = ()
    """Cases that were compared."""
    left_out: tuple[LeftOut, ...] = ()
    """Cases that were not compared, with the reason."""
    canaries: tuple[Canary, ...] = ()
    """Checks for what was predicted among the inputs; empty where there was nothing to check."""
    next_recordings: tuple[NextRecording, ...] = ()
    """What to record next, the recording of the greatest gain first."""
    sealed: int = 0
    """Number of sealed cases, which promotion alone looks at."""

    def of(
        self, quantity: str, *, group: str | None = None, role: Role | None = None
    ) -> tuple[Score, ...]:
        """Scores of a quantity; of one group, or one role, where they are named."""
        return tuple(
            s for s in self.scores
            if s.quantity == quantity and group in (None, s.group) and role in (None, s.role)
        )  # fmt: skip

    def total(self, quantity: str, role: Role | None = None) -> Score | None:
        """Score of a quantity over all groups that decided, or over those of ``role``."""
        found = self.of(quantity, group="all", role=role or self.judged_role)
        return found[0] if found else None

    @property
    def unknown_intervals(self) -> Mapping[tuple[str, str], str]:
        """Reasons why intervals are not known, by quantity and regime."""
        return {
            (s.quantity, s.regime): s.unknown_interval for s in self.scores if s.unknown_interval
        }

    @property
    def set_aside(self) -> tuple[str, ...]:
        """Records that failed alone of all and so do not decide, in words."""
        return tuple(
            f"{'; '.join(s.reasons)}, alone of all that were judged, and does not decide"
            for s in self.scores if s.alone
        )  # fmt: skip

    @property
    def missed(self) -> tuple[str, ...]:
        """Reasons of a failure: faults of the judgement, then limits, the furthest missed first."""
        of_limits = [
            (_times_missed(score, reason), reason)
            for score in self.scores
            for reason in score.reasons
            if score.status in ("failed", "not decided")
        ]
        known = {reason for _, reason in of_limits}
        faults = [reason for reason in self.reasons if reason not in known]
        return (*faults, *(reason for _, reason in sorted(of_limits, key=lambda one: -one[0])))


def _times_missed(score: Score, reason: str) -> float:
    """Greatest error over its limit or baseline among those that ``reason`` names by value."""
    bounds = [*score.limits.items(), *(
        (name, value) for other in score.baselines.values() for name in ("mae", "rmse")
        if (value := getattr(other, name)) is not None and f", {value:.4g} " in reason
    )]  # fmt: skip
    errors = [(getattr(score, name), bound) for name, bound in bounds]
    return max(
        (abs(error) / bound for error, bound in errors
         if error is not None and bound > 0 and f" {error:.4g} " in reason),
        default=0.0,
    )  # fmt: skip


def significant(value: SupportsFloat, digits: int = 6) -> float:
    """Number rounded to so many significant digits.

    >>> significant(0.123456789), significant(1234.5, 2)
    (0.123457, 1200.0)
    """
    return float(f"{float(value):.{digits}g}")


def sized(value: float, unit: str, digits: int = 4) -> str:
    """Size with its unit for a sentence; beyond :data:`MOST_PERCENT` no more than that.

    >>> sized(123.4, "N", 2), sized(6.69e8, "%"), sized(0.51644, "1")
    ('120 N', 'more than 1000 % of nearly 0', '0.5164')
    """
    if unit == "%" and abs(value) > MOST_PERCENT:
        return OF_NOTHING
    number = f"{float(f'{value:.{digits}g}'):g}"
    return number if unit == "1" else f"{number} {unit}"


@dataclass(frozen=True, kw_only=True)
class UsedModel:
    """A sub-model that figures rest on, with what its verdict says of them."""

    submodel: str
    """Sub-model: ``control``, ``drive`` or ``cutting``."""
    figures: str
    """Figures that rest on it, in words."""
    status: UsedStatus
    """Status of its verdict."""
    reason: str = ""
    """The limit that it misses by most, or why it was not judged; empty where it passed."""
    missed: int = 0
    """Limits missed, and faults of the judgement."""
    recordings: int = 0
    """Errors of recordings that the fit did not see."""
    error_percent: float | None = None
    """Root mean square of the errors [%]; None without any."""
    spread_percent: float | None = None
    """Standard deviation with which the figures count [%]; None where another one counts."""

    @property
    def doubtful(self) -> bool:
        """Whether it was identified and did not pass."""
        return self.status in ("failed", "not decided", "not judged")

    @property
    def sentence(self) -> str:
        """Status, the worst limit missed, and the error or spread of the figures, no full stop."""
        more = f" and {self.missed - 1} more" if self.missed > 1 else ""
        why = f": {self.reason}{more}" if self.reason else ""
        spread = self.spread_percent
        tail = ""
        if spread is not None:
            meant = f"{self.figures} count with a standard deviation of"
            if spread == self.error_percent:
                meant = f"RMS error of {self.figures} on {self.recordings} judged recordings"
            tail = f"; {meant} {sized(spread, '%', 2)}"
        return f"{self.submodel} {self.status}{why}{tail}"


ONE = 0.1
"""Width of a learnt range, over its greater end, below which it counts as one value [1]."""


def outside_conditions(
    conditions: Mapping[str, Fact], learnt: Mapping[str, Condition], case: str = ""
) -> list[OutsideConditions]:
    """Conditions of ``case`` that the training cases did not cover."""
    found = []
    for name, fact in conditions.items():
        known = learnt.get(name)
        if known is None or fact.value is None:
            continue
        if isinstance(fact.value, str):
            inside, words = fact.value in known.words, ", ".join(known.words)
        else:
            low, high = known.low, known.high
            if low is None or high is None:
                continue
            slack = 1e-9 * max(abs(low), abs(high))
            inside = low - slack <= fact.value <= high + slack
            words = f"{low:g} to {high:g}" if high > low else f"{low:g}"
        if not inside:
            found.append(
                OutsideConditions(
                    case=case, condition=name, value=fact.value, unit=fact.unit, learnt=words
                )
            )
    return found


def widening(one: OutsideConditions) -> float:
    """Factor on an interval: one more for each width of the learnt range beyond its end.

    The width of one value is that value: speeds of 4000 and 4002 rev/min are one.
    """
    low, _, high = one.learnt.partition(" to ")
    try:
        ends = float(low), float(high or low)
    except ValueError:  # words have no distance
        return 2.0
    beyond = max(ends[0] - float(one.value), float(one.value) - ends[1])
    size = max(map(abs, ends))
    width = size if ends[1] - ends[0] < ONE * size else ends[1] - ends[0]
    if not width:  # learnt at 0 alone, as an entry angle: nothing to measure a distance by
        return 2.0
    return 1.0 + max(beyond, 0.0) / width


def widest(conditions: Mapping[str, Fact], learnt: Mapping[str, Condition]) -> float:
    """Factor on the intervals of a prediction under some conditions [1]; 1 inside of the learnt.

    >>> feed = {"highest feed": Condition(unit="mm/min", low=600.0, high=1200.0)}
    >>> widest({"highest feed": Fact(value=1500.0)}, feed)
    1.5
    """
    return max((widening(one) for one in outside_conditions(conditions, learnt)), default=1.0)
