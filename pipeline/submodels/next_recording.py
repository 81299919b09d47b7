"""What to record next: the recording that narrows the deciding interval most, by optimal design.

A sub-model may declare a :class:`Design`: what the records so far, and with each recording that the
shop floor can make, tell of its parameters.  The covariance of the parameters is

    C = s^2 (I + P)^-1 + diag(f^2),

with I the information, P a weak prior on what the records do not determine and f what no recording
narrows (a sensor's scale).  The scale s is that with which the records so far give the intervals
that the model states, so it holds errors of the model and residuals that hang together; where
parameters are left out of a fit, it is that of the rows with them in it (Fedorov 1972; Atkinson,
Donev and Tobias, *Optimum Experimental Designs*, 2007).  First comes what determines a parameter
that nothing determined; else what narrows most the mean variance of the predictions that are
judged (I-optimality, there section 10.6).

Without a declaration the remedy of a parameter that is not determined comes first, then conditions
that the judged records have and the training records lack, whose intervals are widened, then one
more group of records like the one that is predicted worst: the 95 % interval of a mean error over G
groups is t s / sqrt(G).

An interval from n units of records (strokes, cuts, groups) is itself uncertain by 1 / sqrt(2 (n -
1)), the relative deviation of s; a smaller gain is not noticed, and not promised.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.model import Model
from pipeline.schema.verdict import (
    JudgedCase,
    NextRecording,
    OutsideConditions,
    Score,
    Verdict,
    significant,
    widening,
)
from pipeline.submodels.statistics import NORMAL_95, student_quantile

MINUTES = 20.0
"""Time of a recording that is designed [min]."""
WIDEST = 0.5
"""Half width over the size of a parameter up to which a recording determines it [1]."""
PRIOR = 3.0
"""Standard deviation of a parameter that nothing determines, over its size [1]."""
STATED = 0.1
"""Least part of a stated interval that more records would narrow [1]."""
BEST = 3
"""Recordings that are kept of a design [1]."""
OPTIMAL = "I-optimal design on the sensitivities of the fit"
DETERMINES = "information of the fit: determines what no record does"
REMEDY = "remedy of a parameter that is not determined"
COVERS = "widening of intervals beyond the learnt conditions"
GROUPS = "spread of the error over groups of records, t s / sqrt(groups)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A recording that can be made in :data:`MINUTES`."""

    record: str
    """What to record, in a sentence."""
    information: Floats = field(repr=False)
    """Information of the fit with it among the records; shape (D, D)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Design:
    """D parameters of a fit, what the records tell of them, and recordings that would tell more."""

    names: tuple[str, ...]
    """Parameters in words; D."""
    units: tuple[str, ...]
    """Units of the half widths; D."""
    half_widths: Floats
    """Half of each stated 95 % interval; NaN where the parameter is not determined; shape (D,)."""
    floors: Floats
    """Part of them that no recording narrows; shape (D,)."""
    sizes: Floats
    """Sizes of the parameters, of undetermined ones a plausible one; shape (D,)."""
    information: Floats = field(repr=False)
    """X'X of the derivatives of the fit's rows so far, in rows of variance 1; shape (D, D)."""
    independent: int
    """Strokes or cuts among them, which count once each [1]."""
    judged: Floats = field(repr=False)
    """Derivatives of the predictions that are judged; shape (K, D)."""
    interval: str
    unit: str
    """Interval of those predictions in words, and its unit."""
    limit: float
    """What it is compared with among designs, as the greatest error [unit]."""
    candidates: Sequence[Candidate]
    noise: float | None = None
    """Standard deviation of a row with every parameter fitted, where the records say it; else that
    with which they give the stated intervals."""

    @property
    def determined(self) -> Bools:
        """Parameters that have an interval; shape (D,)."""
        return np.isfinite(self.half_widths)

    def half_width(self, information: Floats | None = None) -> float:
        """Half of the 95 % interval of the judged predictions, root mean square over them."""
        own = self.determined
        rows = self.judged[:, own]
        variance = np.einsum("ki,ij,kj->k", rows, self.covariance(own, information), rows)
        return NORMAL_95 * float(np.sqrt(variance.mean()))

    def covariance(self, known: Bools, information: Floats | None = None) -> Floats:
        """Covariance of the parameters of ``known``, by other ``information`` than the present."""
        noise = self._stated_noise() if self.noise is None else self.noise
        lasting = np.diag((self.floors[known] / NORMAL_95) ** 2)
        return noise**2 * self._inverse(known, information, (noise / PRIOR) ** 2) + lasting

    def _stated_noise(self) -> float:
        """Standard deviation of a row by the stated intervals, the median over parameters."""
        own = self.determined
        stated, floor = self.half_widths[own], self.floors[own]
        narrowed = np.sqrt(np.maximum(stated**2 - floor**2, (STATED * stated) ** 2)) / NORMAL_95
        root = np.sqrt(np.diag(self._inverse(own, None, 0.0)))
        return float(np.median(narrowed / np.maximum(root, 1e-300)))

    def _inverse(self, known: Bools, information: Floats | None, prior: float) -> Floats:
        """(I + P)^-1 of some parameters, with P for each that is not determined."""
        scale = np.outer(self.sizes[known], self.sizes[known])
        own = (self.information if information is None else information)[np.ix_(known, known)]
        total = own * scale + np.diag(np.where(self.determined[known], 0.0, prior))
        return np.asarray(np.linalg.pinv(total, rcond=1e-14, hermitian=True) * scale)


def by_design(design: Design) -> list[NextRecording]:
    """Recordings of a design, the best first; empty where no parameter is determined."""
    tables = (design.information, design.judged, *(one.information for one in design.candidates))
    known = design.determined.any() and len(design.judged) and len(design.candidates)
    if not (known and all(np.isfinite(table).all() for table in tables)):
        return []
    return _determining(design) or _narrowing(design)


def _determining(design: Design) -> list[NextRecording]:
    """Recordings by how many parameters they determine that nothing did, then by how well."""
    lost = np.flatnonzero(~design.determined)
    every = np.ones(len(design.names), bool)
    found = []
    for one in design.candidates:
        half = NORMAL_95 * np.sqrt(np.diag(design.covariance(every, one.information)))
        share = (half / np.abs(design.sizes))[lost]
        if (share <= WIDEST).any():
            at = int(lost[np.argmin(share)])
            found.append((-int((share <= WIDEST).sum()), float(share.min()), one.record, at, half))
    return [
        NextRecording(
            record=record, minutes=MINUTES, interval=design.names[at], unit=design.units[at],
            expected=significant(half[at], 3), method=DETERMINES,
        )
        for _, _, record, at, half in sorted(found, key=lambda row: row[:2])[:BEST]
    ]  # fmt: skip


def _narrowing(design: Design) -> list[NextRecording]:
    """Recordings by the interval that they leave; the best alone where that is not noticed."""
    now = design.half_width()
    after = sorted((design.half_width(one.information), one.record) for one in design.candidates)
    found = [
        _narrowed(record, design.interval, design.unit, now, half, method=OPTIMAL,
                  units=design.independent, minutes=MINUTES)
        for half, record in after[:BEST]
    ]  # fmt: skip
    return [one for k, one in enumerate(found) if one.noticed or not k]


def _narrowed(
    record: str, interval: str, unit: str, now: float, half: float, *, method: str, units: int,
    minutes: float | None = None,
) -> NextRecording:  # fmt: skip
    """A recording after which an interval that ``units`` of records gave is ``half``."""
    gain = 1 - half / now if now > 0 else 0.0
    return NextRecording(
        record=record, minutes=minutes, interval=interval, unit=unit, method=method,
        now=significant(now, 3), expected=significant(half, 3), gain_percent=round(100 * gain, 1),
        uncertain_percent=round(100 / (2 * max(units - 1, 1)) ** 0.5, 1),
    )  # fmt: skip


def next_recordings(
    title: str, model: Model, verdict: Verdict, designs: Sequence[Design]
) -> tuple[NextRecording, ...]:
    """What to record next for a sub-model, the best first; empty where nothing tells.

    ``title`` is the sub-model's, ``designs`` what it declares.
    """
    lists = [(one, found) for one in designs if (found := by_design(one))]
    if not lists:
        groups = len({one.group for one in model.trained_on})
        some = [*_remedy(model), *_covering(verdict, groups), *_of_groups(title, verdict, groups)]
        return tuple(sorted(some, key=lambda one: not one.noticed))
    lists.sort(key=lambda pair: _rank(pair[0], pair[1][0]))
    return (*lists[0][1], *(found[0] for _, found in lists[1:]))


def _rank(design: Design, best: NextRecording) -> tuple[bool, bool, float]:
    """What nothing determines first, then the interval that is widest for its size."""
    return best.now is not None, not best.noticed, -(best.now or 0.0) / max(design.limit, 1e-300)


def _remedy(model: Model) -> list[NextRecording]:
    """The stored remedy of the first parameter that is not determined."""
    return [
        NextRecording(
            record=one.remedy, interval=f"{group} {name}".strip(), unit=one.unit, method=REMEDY
        )
        for group, parameters in model.parameters.items()
        for name, one in parameters.items() if not one.determined and one.remedy
    ][:1]  # fmt: skip


def _covering(verdict: Verdict, groups: int) -> Iterator[NextRecording]:
    """The condition that narrows most what the judged cases have beyond the learnt ones."""
    judged = [one.case for one in verdict.cases if one.role == verdict.judged_role]
    outside = [one for one in verdict.outside if one.case in judged]
    total = next((s for s in _deciding(verdict) if s.group == "all" and s.half_width), None)
    if not outside or total is None or total.half_width is None:
        return

    def mean(rest: Sequence[OutsideConditions]) -> float:
        factor = dict.fromkeys(judged, 1.0)
        for one in rest:
            factor[one.case] = max(factor[one.case], widening(one))
        return sum(factor.values()) / len(factor)

    def after(name: str) -> float:
        return mean([one for one in outside if one.condition != name])

    name = min({one.condition for one in outside}, key=lambda n: (after(n), n))
    far = max((one for one in outside if one.condition == name), key=widening)
    value = far.value if isinstance(far.value, str) else f"{far.value:g}"
    yield _narrowed(
        f"{name} at {value} {far.unit}".strip() + f", learnt {far.learnt} alone",
        f"mean 90 % interval of {total.quantity}", total.unit, total.half_width,
        total.half_width * after(name) / mean(outside), method=COVERS, units=groups,
    )  # fmt: skip


def _of_groups(title: str, verdict: Verdict, groups: int) -> Iterator[NextRecording]:
    """One more group like that of the greatest error."""
    some = [s for s in _deciding(verdict) if s.group != "all" and s.rmse is not None]
    some = [s for s in some if (s.quantity, s.regime) == (some[0].quantity, some[0].regime)]
    errors = np.array([s.rmse for s in some], dtype=np.float64)
    if len(some) < 2 or groups < 2 or not errors.std():
        return
    now, half = (
        student_quantile(many - 1) * float(errors.std(ddof=1)) / many**0.5
        for many in (groups, groups + 1)
    )
    worst = some[int(errors.argmax())]
    like = next((_conditions(one) for one in verdict.cases if one.group == worst.group), "")
    yield _narrowed(
        f"one more like {worst.group}{like}, where the {title} is predicted worst",
        f"mean RMSE of {worst.quantity}", worst.unit, now, half, method=GROUPS,
        units=groups,
    )  # fmt: skip


def _deciding(verdict: Verdict) -> list[Score]:
    """Scores that decide; those with limits before others."""
    some = [s for s in verdict.scores if s.role == (verdict.judged_role or "held_out")]
    return sorted(some, key=lambda s: not (s.limits or s.coverage_limits))


def _conditions(case: JudgedCase) -> str:
    words = [
        f"{name} {fact.value:g} {fact.unit}".strip()
        for name, fact in case.conditions.items() if isinstance(fact.value, float | int)
    ]  # fmt: skip
    return f" ({', '.join(words[:5])})" if words else ""
