"""Choice of a spindle's network by cross-validation over days, and over hours of rare sources.

Days left out decide on what several days show.  A source that one or two days alone excite cannot
be credited so: the other days know nothing of it.  Its hours are then held out in turn, each with
its neighbours of the same day in training, and all sources' hours are spread over the parts
(iterative stratification, Sechidis, Tsoumakas and Vlahavas 2011).  Only the temperature is held
out; speed and load stay given, and the fit runs through.

An interval is conditional on the network that was chosen.  Where others are as good on hours left
out, it is widened to hold theirs.  And where what the fit leaves over still answers to a source, it
is widened to what the residuals say of it: no source is 0 to within little while they rise with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pipeline.parallel import mapped
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.submodels.spindle.fit import (
    ONE,
    Given,
    Problem,
    SpindleFit,
    Structure,
    all_determined,
    excited,
    fit_network,
    is_determined,
    sensor_step,
    solve,
    structure_of,
    window_errors,
)
from pipeline.submodels.statistics import LEVEL, gains, student_quantile, uncertainty_of
from pipeline.thermal.network import SOURCES, first_order
from pipeline.twin import spindle

FEWEST = 3
"""Hours that excite a source below which its residuals say nothing."""


def with_doubt(fit: SpindleFit, others: Mapping[str, SpindleFit], given: Given) -> SpindleFit:
    """Fit with the intervals of its sources widened by the residuals and by ``others``."""
    said = residuals_say(fit, given)
    intervals, left_out = dict(fit.intervals), dict(fit.left_out)
    for name, own in fit.intervals.items():
        value = fit.parameters.heating.get(name, 0.0)
        ends = [own, *(one.intervals[name] for one in others.values() if name in one.intervals)]
        if name in said:
            ends.append((value + said[name][0], value + said[name][1]))
        intervals[name] = min(low for low, _ in ends), max(high for _, high in ends)
        if name in left_out and intervals[name] != own:
            left_out[name] = _words(name, intervals[name], said.get(name), list(others))
    return replace(
        fit, intervals=intervals, left_out=left_out, in_doubt=tuple(others),
        unfollowed=tuple(said),
    )  # fmt: skip


def _words(
    name: str, whole: tuple[float, float], said: tuple[float, float] | None, others: list[str]
) -> str:
    """Why a source that was left out is not 0 to within little."""
    low, high = whole
    text = f"its 95 % interval is {low:.2g} to {high:.2g} {SOURCES[name]}"
    if said is not None:
        way = "rises" if said[0] > 0 else "falls"
        return (
            f"{text}: what the network leaves over {way} while it is on, by {said[0]:.2g} to "
            f"{said[1]:.2g} {SOURCES[name]}, which no network tried here follows"
        )
    return f"{text} over the networks that the records bear as well ({', '.join(others)})"


def residuals_say(fit: SpindleFit, given: Given) -> dict[str, tuple[float, float]]:
    """Sources that the residuals still answer to, with the 95 % interval of the further heating.

    The residual of each hour, less its mean, is regressed on the response of a first-order lag to
    the source, for each time constant from which the fit starts; hours are the clusters.  The
    level is shared out among sources and time constants (Bonferroni); and what they say has to come
    to half a step of the sensor.  In the coefficient's unit.
    """
    constants = given.settings.time_constants_s
    problem = Problem(given, list(fit.parameters.heating), structure_of(fit.parameters))
    left = [-r for r in problem.by_stretch(problem.position(fit.parameters))]
    error = np.concatenate([r[m] for r, m in zip(left, problem.masks, strict=True)])
    found: dict[str, tuple[float, float]] = {}
    least = sensor_step(np.concatenate(problem.measured)) / 2
    level = LEVEL / max(len(fit.intervals) * len(constants), 1)
    for name in fit.intervals:
        best = 0.0
        for constant in constants:
            response = np.concatenate([
                first_order(-1 / constant, p.frame[name].to_numpy(float), 0.0, p.step)[m]
                for p, m in zip(given.pieces, problem.masks, strict=True)
            ])  # fmt: skip
            slope, width, significance = _slope(response, error, problem.blocks, level)
            felt = abs(slope) * float(np.ptp(response)) >= least
            if felt and significance > max(best, 1.0):
                best, found[name] = significance, (slope - width, slope + width)
    return found


def _slope(x: Floats, y: Floats, blocks: Ints, level: float) -> tuple[float, float, float]:
    """Slope within blocks, half of its 95 % interval, its size over what ``level`` asks for.

    The deviation is clustered over the blocks that excite it.
    """
    _, block = np.unique(blocks, return_inverse=True)
    count = np.bincount(block)
    x, y = (v - (np.bincount(block, weights=v) / count)[block] for v in (x, y))
    weight = np.bincount(block, weights=x * x)
    shown = weight > 1e-6 * weight.max(initial=0.0)
    freedom = int(shown.sum()) - 1
    if freedom < FEWEST - 1:
        return 0.0, np.inf, 0.0
    x, y, block = x[shown[block]], y[shown[block]], block[shown[block]]
    slope = float(x @ y / (x @ x))
    half = float(uncertainty_of(x[:, None], y - slope * x, block).half_width[0])
    bound = half * student_quantile(freedom, 1 - level / 2) / student_quantile(freedom)
    return slope, half, abs(slope) / bound if bound else 0.0


PARTS = 5
"""Parts into which days or hours are split; each is left out in turn."""
EXCITED = 0.1
"""A source is excited in an hour whose mean is above this share of its greatest hour's [1]."""
FEWEST_DAYS = 3
"""Days that excite a source from which on days left out say what it does; hours where fewer do."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Hours:
    """Windows of all stretches: ``at`` (H, 3) piece, first step and length, ``excited`` (H, S)."""

    at: Ints
    excited: Bools
    sources: tuple[str, ...]


def hours_of(given: Given, sources: Sequence[str]) -> Hours:
    """Windows that start from a measured temperature, with the sources that each excites."""
    at, means = [], []
    for number, piece in enumerate(given.pieces):
        length = max(round(given.settings.window_s / piece.step), 1)
        heat = piece.frame[list(sources)].to_numpy(float)
        for start in spindle.window_starts(piece.frame[spindle.TARGET].to_numpy(float), length):
            part = heat[start : start + length]
            at.append((number, start, len(part)))
            means.append(part.mean(axis=0))
    mean = np.array(means).reshape(len(means), len(sources))
    return Hours(
        at=np.array(at, dtype=np.int64).reshape(-1, 3),
        excited=(mean > 0) & (mean >= EXCITED * mean.max(axis=0, initial=0.0)),
        sources=tuple(sources),
    )


def stratified(excited: Bools, parts: int) -> Ints:
    """Part of each hour, (H,): hours of the rarest source are dealt out first.

    Examples
    --------
    >>> stratified(np.array([[0, 1], [0, 1], [0, 1], [0, 1], [1, 1], [1, 1]], bool), 2).tolist()
    [0, 1, 0, 1, 0, 1]
    """
    part = np.full(len(excited), -1, dtype=np.int64)
    while (part < 0).any():
        left = excited & (part < 0)[:, None]
        count = left.sum(axis=0)
        if count.any():
            label = int(np.argmin(np.where(count > 0, count, len(excited) + 1)))
            rows = np.flatnonzero(left[:, label])
        else:
            label, rows = -1, np.flatnonzero(part < 0)
        for row in rows:
            mine = part[excited[:, label] & (part >= 0)] if label >= 0 else part[part >= 0]
            of_label = np.bincount(mine, minlength=parts)
            of_all = np.bincount(part[part >= 0], minlength=parts)
            part[row] = np.lexsort((of_all, of_label))[0]
    return part


def hours_left_out(given: Given, whole: SpindleFit, hours: Hours) -> Floats:
    """Mean squared error [K^2] of each hour under a network fitted on the other parts, (H,).

    The start is ``whole``, the fit on all hours; a source that no hour of training excites is not
    known there and stays 0.
    """
    part, pieces, records = stratified(hours.excited, PARTS), given.pieces, given.records
    errors = np.full(len(part), np.nan)
    for held in np.unique(part):
        unseen = [np.zeros(len(p.frame), dtype=bool) for p in pieces]
        for number, start, length in hours.at[part == held]:
            unseen[number][start : start + length] = True
        known = dict(zip(hours.sources, hours.excited[part != held].any(axis=0), strict=True))
        sources = [name for name in whole.parameters.heating if known.get(name, False)]
        problem = Problem(given, sources, structure_of(whole.parameters), unseen=unseen)
        if not len(problem.blocks):
            continue
        fit = solve(problem, [problem.position(whole.parameters)])
        nodes = [spindle.free_run(p, records, fit.parameters) for p in pieces]
        for row in np.flatnonzero(part == held):
            number, start, length = hours.at[row].tolist()
            found = spindle.from_measured(
                pieces[number], [start], length, records, fit.parameters, nodes[number]
            )[0]
            measured = pieces[number].frame[spindle.TARGET].to_numpy(float)
            errors[row] = np.nanmean((found - measured[start : start + length]) ** 2)
    return errors


def days_left_out(given: Given, whole: SpindleFit) -> Floats:
    """Mean squared error [K^2] over windows of each day under a network that did not see it.

    Up to five groups of days are left out in turn.  The sources and the start are those of
    ``whole``, the fit on all days; a source that only the days left out excite is not known to the
    others and stays 0.  Shape (days,), empty when there is one day only.
    """
    days = sorted({p.day for p in given.pieces})
    if len(days) < 2:
        return np.array([])
    errors = []
    for left in np.array_split(np.array(days), min(PARTS, len(days))):
        others = [p for p in given.pieces if p.day not in left]
        sources = excited(others, list(whole.parameters.heating))
        seen = replace(given, pieces=others)
        problem = Problem(seen, sources, structure_of(whole.parameters))
        fit = solve(problem, [problem.position(whole.parameters)])
        for day in left:
            judged = replace(given, pieces=[p for p in given.pieces if p.day == day])
            errors.append(window_errors(judged, fit.parameters))
    return np.array([np.mean(e**2) for e in errors if len(e)])


@dataclass(frozen=True, kw_only=True, eq=False)
class LeftOut:
    """Errors of a network on held-out ``days`` (D,) and, where needed, ``hours`` (H,) [K^2]."""

    days: Floats
    hours: Floats

    @property
    def rmse(self) -> dict[str, float]:
        """RMSE [K], by what was left out."""
        found = {"days": self.days, "hours": self.hours}
        return {
            name: float(np.sqrt(np.nanmean(error)))
            for name, error in found.items() if np.isfinite(error).any()
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Choice:
    """Basis of the choice of a network: the records, ``hours``, ``rare`` (S,).

    ``noise`` is the variance of the sensor's rounding [K^2]: errors below it are all alike.
    """

    given: Given
    hours: Hours
    rare: Bools
    noise: float

    def errors(self, fit: SpindleFit, given: Given) -> LeftOut:
        """Errors of a network on days left out, and on hours where a source needs that."""
        hours = hours_left_out(given, fit, self.hours) if self.rare.any() else np.array([])
        return LeftOut(days=days_left_out(given, fit), hours=hours)

    def gains(self, simple: LeftOut, rich: LeftOut) -> bool:
        """Whether ``rich`` is significantly better, over days or over the hours of a rare source.

        Days are those left out or, where a source is rare, each day's hours left out: a day whose
        source the others never excite is wrong by the same under any network, and its large error
        hides what the other days say.
        """
        if not self.rare.any():
            return gains(simple.days, rich.days)
        known = np.isfinite(simple.hours) & np.isfinite(rich.hours)
        if not known.any() or not rich.hours[known].mean() < simple.hours[known].mean():
            return False
        days = np.array([self.given.pieces[number].day for number in self.hours.at[known, 0]])
        by_day = [
            np.log([one.hours[known][days == day].mean() + self.noise for day in np.unique(days)])
            for one in (simple, rich)
        ]
        return gains(by_day[0], by_day[1], self.level) or self._gains_in_hours(simple, rich)

    def settles(self, simple: LeftOut, rich: LeftOut) -> bool:
        """Whether ``rich`` leaves no doubt of ``simple``, over whole days or a rare source's hours.

        An interval that holds asks for more than the choice of the likelier network does.
        """
        return gains(simple.days, rich.days, self.level) or self._gains_in_hours(simple, rich)

    @property
    def level(self) -> float:
        """Level of each test, shared out among them (Bonferroni) [1]."""
        return LEVEL / (1 + int(self.rare.sum()))

    def _gains_in_hours(self, simple: LeftOut, rich: LeftOut) -> bool:
        """Whether ``rich`` is better in the hours of a rare source, and over all of them too.

        The logarithms of squared errors are compared, as a few hours with large errors are far from
        normal. Two hours are enough where both gain alike: there may be no more.
        """
        known = np.isfinite(simple.hours) & np.isfinite(rich.hours)
        if not known.any() or not rich.hours[known].mean() < simple.hours[known].mean():
            return False
        rare = [self.hours.excited[:, i] for i in np.flatnonzero(self.rare)]
        logs = [np.log(one.hours + self.noise) for one in (simple, rich)]
        return any(
            gains(logs[0][known & one], logs[1][known & one], self.level, fewest=2) for one in rare
        )

    def score(self, error: LeftOut) -> float:
        """Mean squared error that networks are ranked by [K^2]."""
        return float(np.nanmean(error.hours if self.rare.any() else error.days))


def choice_of(given: Given, sources: Sequence[str]) -> Choice:
    """Days and hours to choose on, and the sources that fewer than three of the days excite."""
    hours, pieces = hours_of(given, sources), given.pieces
    day = np.array([pieces[number].day for number in hours.at[:, 0]])
    count = np.array([len(set(day[one])) for one in hours.excited.T])
    enough = len(set(day)) >= FEWEST_DAYS
    rare = (count > 0) & (count < FEWEST_DAYS) & enough
    measured = np.concatenate([p.frame[spindle.TARGET].to_numpy(float) for p in pieces])
    noise = max(sensor_step(measured), 1e-3) ** 2 / 12
    return Choice(given=given, hours=hours, rare=rare, noise=noise)


def identify_spindle_network(given: Given) -> tuple[SpindleFit, dict[str, float]]:
    """Network, and sink to the coolant, selected on held-out data.

    One node is kept unless another gains on it (:meth:`Choice.gains`): two nodes, with the heat of
    the bearings in the one or the other.  Where the records do not determine all parameters of two
    nodes, their limit of a nearly massless winding is tried too, and two nodes have to gain on it.
    The coolant, where it is recorded, becomes a sink on the same condition.

    Beside the fit on all stretches, with the networks that are as good and the intervals over all
    of them, stand the RMSE [K] on days left out by network, with ``" with coolant"`` for that sink
    and ``", hours"`` on hours left out; empty when there was nothing to choose.
    """
    records, settings = given.records, given.settings
    plain = replace(given, records=replace(records, coolant=False))
    if set(settings.nodes) == {1} and not records.coolant:
        return with_doubt(fit_network(plain, ONE), {}, plain), {}
    choice = choice_of(plain, records.sources)
    structures = [Structure(nodes=2, friction_in_body=one) for one in (False, True)]
    structures = [one for one in (ONE, *structures) if one.nodes in settings.nodes]
    tried = mapped(partial(_tried, choice=choice), structures, compute=settings.compute)
    fits = {one: fit for found in tried for one, (fit, _) in found.items()}
    errors = {one: error for found in tried for one, (_, error) in found.items()}
    rivals = _rivals(fits, errors, choice)
    chosen = _chosen(rivals, errors, choice)
    others = {
        one.name: fits[one] for one in rivals
        if one != chosen and all_determined(fits[one])
        and not choice.settles(errors[one], errors[chosen])
    }  # fmt: skip
    fit, scores = fits[chosen], _scores({one.name: error for one, error in errors.items()})
    if not records.coolant or chosen.massless:
        return with_doubt(fit, others, plain), scores
    cooled = fit_network(given, chosen)
    error = choice.errors(cooled, given)
    scores |= _scores({f"{chosen.name} with coolant": error})
    if choice.gains(errors[chosen], error) and is_determined(cooled, "coolant_rate"):
        return with_doubt(cooled, {}, given), scores
    return with_doubt(fit, others, plain), scores


def _tried(structure: Structure, choice: Choice) -> dict[Structure, tuple[SpindleFit, LeftOut]]:
    """A network on all stretches, with its limit where the records do not determine all of it."""
    fits = {structure: fit_network(choice.given, structure)}
    if structure.nodes == 2 and not all_determined(fits[structure]):
        limit = replace(structure, massless=True)
        fits[limit] = fit_network(choice.given, limit)
    return {one: (fit, choice.errors(fit, choice.given)) for one, fit in fits.items()}


def _rivals(
    fits: dict[Structure, SpindleFit], errors: dict[Structure, LeftOut], choice: Choice
) -> list[Structure]:
    """Networks to choose among: two nodes or their limit, whichever the records bear."""
    left = list(fits)
    for limit in [one for one in fits if one.massless]:
        two = replace(limit, massless=False)
        left.remove(limit if choice.gains(errors[limit], errors[two]) else two)
    return left


def _chosen(
    rivals: Sequence[Structure], errors: dict[Structure, LeftOut], choice: Choice
) -> Structure:
    """Network selected on held-out data; one node where none gains on it."""
    better = [
        one for one in rivals
        if ONE not in rivals or (one != ONE and choice.gains(errors[ONE], errors[one]))
    ]  # fmt: skip
    return min(better, key=lambda one: choice.score(errors[one]), default=ONE)


def _scores(errors: dict[str, LeftOut]) -> dict[str, float]:
    return {
        name if what == "days" else f"{name}, {what}": value
        for name, error in errors.items() for what, value in error.rmse.items()
    }  # fmt: skip
