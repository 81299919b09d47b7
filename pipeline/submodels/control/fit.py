"""Bounded least squares on the durations of segments: the control that explains the logs best.

Residual of a segment: measured duration without stops - planned duration of its rows under the
overrides in force.  Both ends are polls, so that an error of a polling interval is noise; waits of
the operator that the log does not tell are outliers (soft L1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.submodels.control.parameters import (
    BY_UNIT,
    FreeParameter,
    control_of,
    expected,
    free_parameters,
)
from pipeline.submodels.control.segments import Observed, Rate, clusters, rapid_rates
from pipeline.submodels.statistics import Uncertainty, uncertainty_of
from pipeline.twin.control import planned_program

Residuals = Callable[[Floats], Floats]
TOLERANCE = 1e-5
"""Relative change of cost or parameters at which a search ends [1]: far inside any interval."""


@dataclass(frozen=True, kw_only=True)
class ControlFitSettings(Ranged, section="control_fit"):
    """Settings of the identification of a control."""

    loose_s: Positive = 5.0
    """Width about the start of the weak prior on waiting times [s]; that of rates is a factor e."""
    step: Positive = 0.02
    """Step of the differences that the Jacobian is made of [1 on the logarithmic scale, s]."""
    evaluations: Count = 60
    """Jacobians at most."""
    shortest_s: Positive = 1.0
    """Least duration of a segment [s], those of waits excepted."""
    scales_s: tuple[Positive, ...] = (3.0, 0.8, 0.2)
    """Residuals above which each search counts linearly [s]: from what the start may be wrong by
    down to what polling adds to the duration of a segment."""
    widest: Positive = 0.5
    """Share of a parameter beyond which the width of its 95 % interval leaves it open [1]."""
    folds: Annotated[int, Range(least=2)] = 5
    """Controls that are identified without some of the programs for the intervals, at most."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.scales_s:
            raise ValueError("control_fit.scales_s is empty: name one scale of residuals at least")


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """End of a search."""

    values: Floats
    """Values of all parameters, in their units; shape (D,)."""
    jacobian: Floats
    """Jacobian of the residuals, on the scale of the search [1]; 0 if not fitted; shape (N, D)."""
    residuals: Floats
    """Residuals over the scale beyond which they count linearly [1]; shape (N,)."""

    @property
    def weight(self) -> Floats:
        """Square root of soft L1's derivative: how much each residual counts [1]; shape (N,)."""
        return (1 + self.residuals**2) ** -0.25


@dataclass(frozen=True, kw_only=True)
class Left:
    """Information of the runs on parameters that they do not determine; shapes (D,)."""

    values: Floats
    """Value of each at the end of the search, in its unit."""
    felt: Floats
    """Inverse half width from the residuals, all others given; on the scale of the search."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """N segments of runs, and the D parameters that explain their durations."""

    residuals: Residuals
    """Measured less planned durations [s], (N,), of all parameters, (D,), in their units."""
    free: Sequence[FreeParameter]
    """The parameters."""
    fitted: Bools
    """Whether each is fitted to the durations; shape (D,)."""
    unit: NDArray[np.str_]
    blocks: NDArray[np.int64]
    """Unit and cluster of each segment; shape (N,)."""
    settings: ControlFitSettings

    def optimum(self, values: Floats, active: Bools, scale_s: float) -> Optimum:
        """Least squares (soft L1) of the ``active`` parameters; the others stay as in ``values``.

        A weak pull towards where the search began decides what the residuals leave open; it has no
        part in the Jacobian and the residuals that are returned.  Residuals above ``scale_s`` [s]
        count linearly.
        """
        from scipy.optimize import least_squares

        settings = self.settings
        fitted = [one for one, used in zip(self.free, active, strict=True) if used]
        low, high = np.array([one.bounds for one in fitted]).T
        begin = np.clip([one.coordinate(one.start) for one in fitted], low, high)
        pull = np.array([1.0 if one.log_scale else 1 / settings.loose_s for one in fitted])

        def full(x: Floats) -> Floats:
            out = values.copy()
            out[active] = [one.value(v) for one, v in zip(fitted, x.tolist(), strict=True)]
            return out

        def scaled(x: Floats) -> Floats:
            return self.residuals(full(x)) / scale_s

        def jacobian(x: Floats) -> Floats:
            return _differences(scaled, x, low, high, settings.step)

        def pulled(x: Floats) -> Floats:
            return np.concatenate([scaled(x), pull * (x - begin)])

        def pulled_jacobian(x: Floats) -> Floats:
            return np.vstack([jacobian(x), np.diag(pull)])

        x = [one.coordinate(v) for one, v in zip(fitted, values[active].tolist(), strict=True)]
        found = least_squares(
            pulled, np.clip(x, low, high), jac=pulled_jacobian, bounds=(low, high), loss="soft_l1",
            max_nfev=settings.evaluations, ftol=TOLERANCE, xtol=TOLERANCE,
        ).x  # fmt: skip
        left = scaled(found)
        by_all = np.zeros((len(left), len(self.free)))
        by_all[:, active] = jacobian(found)
        return Optimum(values=full(found), jacobian=by_all, residuals=left)

    def uncertainty(self, found: Optimum, jacobian: Floats) -> Uncertainty:
        """Uncertainty by a ``jacobian`` (N, S), on the scale of the search, residuals weighted."""
        jacobian, residuals = jacobian * found.weight[:, None], found.residuals * found.weight
        noise = 1.4826 * float(np.median(np.abs(found.residuals)))  # outliers have no part in it
        return uncertainty_of(jacobian, residuals, self.blocks, noise)

    def reach(self, one: FreeParameter, value: float) -> float:
        """Reference of a width on the scale of the search [1, s]."""
        return 1.0 if one.log_scale else max(abs(value), 2 * self.settings.scales_s[-1])


def _differences(function: Residuals, x: Floats, low: Floats, high: Floats, step: float) -> Floats:
    """Jacobian of ``function`` at ``x`` from differences within the bounds; shape (N, D)."""
    columns = []
    for k in range(len(x)):
        ahead, behind = x.copy(), x.copy()
        ahead[k] = min(x[k] + step, high[k])
        behind[k] = max(x[k] - step, low[k])
        columns.append((function(ahead) - function(behind)) / (ahead[k] - behind[k]))
    return np.column_stack(columns)


@dataclass(frozen=True, kw_only=True)
class ControlFit:
    """Identified control with its intervals."""

    free: tuple[FreeParameter, ...]
    """The parameters that were fitted."""
    values: Floats
    """Values in the units of ``free``; shape (D,)."""
    low: Floats
    high: Floats
    """95 % interval; NaN of what is not determined; shape (D,)."""
    determined: Bools
    """Whether the logs say anything of it; shape (D,)."""
    from_speeds: Bools
    """Whether it was read from logged speeds, not fitted to durations; shape (D,)."""
    control: dict[str, ControlParameters]
    """Control of each unit; undetermined parameters near the prior of their kind."""
    ends: dict[str, tuple[ControlParameters, ControlParameters]]
    """Control with the undetermined parameters at their slow and fast end, by unit."""
    apart: frozenset[str]
    """Parameters that units do not share, or that runs of one unit alone determine."""
    differ: frozenset[str]
    """Names with the unit of those of them that units do not share."""
    left: Left
    """Information of the runs on undetermined parameters."""
    uncertainty: Uncertainty
    """Uncertainty of those fitted to durations, on the scale of the search."""
    rmse_s: float
    """Rmse of the residuals, without outliers beyond 10 times the noise [s]."""
    segments: int
    """Number of segments."""

    def lenders(self, place: int) -> list[str]:
        """Units whose value a parameter has that the runs of its own unit do not excite."""
        one = self.free[place]
        if self.left.felt[place] > 0:
            return []
        return [
            other.units[0]
            for other, known in zip(self.free, self.determined, strict=True)
            if known and other.shared == one.shared and other != one and one.key not in BY_UNIT
        ]


def planned(observed: Observed, control: ControlParameters) -> Floats:
    """Duration of each segment [s]; shape (N,)."""
    times = planned_program(observed.moves, control, observed.overrides).time
    until = np.concatenate([[0.0], np.cumsum(times)])
    return until[observed.after] - until[observed.first]


def identify_control(
    observed: Sequence[Observed], start: ControlParameters, settings: ControlFitSettings,
    near: ControlFit | None = None,
) -> ControlFit:  # fmt: skip
    """Control parameters identified from the runs ``observed``.

    Undetermined parameters are removed one by one, the loosest first, and set to their prior, and
    the others are fitted again.  Parameters shared by units are tested by unit, and fitted for each
    where they differ or runs of one alone determine it.

    Where ``near`` is given, a control of more runs of the same units, the search begins there in
    place of ``start``, and shared parameters are not tested again. ValueError when there is no run,
    or the runs determine no parameter.
    """
    if not sum(len(one.measured) for one in observed):
        raise ValueError(
            "no run of a program is there to identify the control from: "
            "put logs of line numbers and the programs that ran beside them"
        )
    fit = _identified(observed, start, settings, near)
    while near is None and fit.apart - {one.shared for one in fit.free if one.units}:
        fit = _identified(observed, start, settings, fit)
    return fit


def _identified(
    observed: Sequence[Observed], start: ControlParameters, settings: ControlFitSettings,
    near: ControlFit | None,
) -> ControlFit:  # fmt: skip
    """Control, with a value by unit of those parameters that ``near`` holds apart."""
    units = sorted({one.unit for one in observed})
    free = free_parameters(start, units, near.apart if near is not None else ())
    rates = _rates(observed, free, units)
    fitted = ~np.isin(np.arange(len(free)), list(rates))
    begin = np.array([one.start for one in free])
    likely, left, differ = fitted, Left(values=begin, felt=np.zeros(len(free))), frozenset[str]()
    if near is not None:
        before = {one.name: k for k, one in enumerate(near.free)}
        place = [before.get(one.name, before.get(one.shared, -1)) for one in free]
        begin, likely = near.values[place], fitted & near.determined[place]
        left = Left(values=near.left.values[place], felt=near.left.felt[place])
        settings, differ = replace(settings, scales_s=settings.scales_s[-1:]), near.differ
    begin[list(rates)] = [rate.value for rate in rates.values()]
    own = {unit: np.array([not one.units or unit in one.units for one in free]) for unit in units}
    problem = Problem(
        residuals=_residuals(observed, start, free, own), free=free, fitted=fitted,
        unit=np.repeat([one.unit for one in observed], [len(one.measured) for one in observed]),
        blocks=clusters(observed), settings=settings,
    )  # fmt: skip
    for scale in settings.scales_s:  # waits that the start explains badly must not count as strange
        found = problem.optimum(begin, likely, scale)
        begin = found.values
    differ |= _apart(problem, found, likely, unfelt=False)
    found, active, left = _determined(problem, found, likely, left, differ)
    if not active.any():
        raise ValueError(
            f"{len(found.residuals)} stretches of {len(observed)} runs determine no parameter of "
            "the control: log more runs of programs"
        )
    differ |= _apart(problem, found, active, unfelt=False)
    names = differ | _apart(problem, found, active, unfelt=True)
    uncertainty = problem.uncertainty(found, found.jacobian[:, active])
    _, half_width = _kept(problem, found.values, active, left)
    ends = _ends(free, found.values, half_width)
    low, high = _intervals(free, found, rates, active, uncertainty)
    usual = found.residuals[np.abs(found.residuals) < 10]
    return ControlFit(
        free=tuple(free), values=found.values, low=low, high=high, determined=active | ~fitted,
        from_speeds=~fitted, differ=differ, left=left, uncertainty=uncertainty,
        control={unit: control_of(start, free, found.values, unit) for unit in units},
        ends={u: (control_of(start, free, ends[0], u), control_of(start, free, ends[1], u))
              for u in units if half_width[own[u]].any()},
        apart=frozenset({name.partition("@")[0] for name in names}
                        | {one.shared for one in free if one.units}),
        rmse_s=float(np.sqrt(np.mean(usual**2))) * settings.scales_s[-1] if len(usual) else np.nan,
        segments=len(found.residuals),
    )  # fmt: skip


def _residuals(
    observed: Sequence[Observed], start: ControlParameters, free: Sequence[FreeParameter],
    own: dict[str, Bools],
) -> Residuals:  # fmt: skip
    """Residuals of all segments, by ``own``, the parameters (D,) that hold for each unit."""
    measured = np.concatenate([one.measured for one in observed])

    @lru_cache(maxsize=4 * len(own))  # a step in a parameter of one unit leaves the others' times
    def durations(unit: str, values: tuple[float, ...]) -> list[Floats]:
        control = control_of(start, free, np.array(values), unit)
        return [planned(one, control) for one in observed if one.unit == unit]

    def residuals(values: Floats) -> Floats:
        each = {
            unit: iter(durations(unit, tuple(np.where(holds, values, 0.0).tolist())))
            for unit, holds in own.items()
        }
        return measured - np.concatenate([next(each[one.unit]) for one in observed])

    return residuals


def _determined(
    problem: Problem, found: Optimum, active: Bools, left: Left, differ: frozenset[str]
) -> tuple[Optimum, Bools, Left]:
    """The optimum near ``found``, which parameters the logs determine, what they leave."""
    free = problem.free
    # what machines of a kind have in common the other units know better than a few stray stretches
    lent = np.array([bool(one.units) and one.key not in BY_UNIT for one in free])
    lent &= [one.name not in differ for one in free]
    while (loose := _loosest(problem, found, active)).any():
        active = active & ~loose
        felt = np.linalg.norm(found.jacobian * found.weight[:, None], axis=0) / 2
        felt = np.where([one.name in differ for one in free], np.maximum(felt, 1.0), felt)
        felt[lent] = 0.0
        left = Left(
            values=np.where(loose, found.values, left.values), felt=np.where(loose, felt, left.felt)
        )
        values, _ = _kept(problem, found.values, active, left)
        if not active.any():
            break
        found = problem.optimum(values, active, problem.settings.scales_s[-1])
    return found, active, left


def _kept(problem: Problem, values: Floats, active: Bools, left: Left) -> tuple[Floats, Floats]:
    """Values with those that are not determined where they are expected, and half their intervals.

    That is the mean of where the search left them and of what is expected of their kind, each by
    its interval, and inside of the latter; half widths on the scale of the search, shape (D,).
    """
    free, fitted, settings = problem.free, problem.fitted, problem.settings
    out, half_width = values.copy(), np.zeros(len(free))
    centre, usual = expected(free, values, active | ~fitted)
    for i in np.flatnonzero(fitted & ~active).tolist():
        one = free[i]
        width = max(usual[i], settings.step if one.log_scale else 2 * settings.scales_s[-1])
        share = 1 / (1 + (left.felt[i] * width) ** 2)
        away = (1 - share) * (one.coordinate(left.values[i]) - centre[i])
        middle = centre[i] + float(np.clip(away, -width, width))
        out[i] = min(max(one.value(middle), one.low), one.high)
        half_width[i] = np.sqrt(share) * width
    return out, half_width


def _ends(
    free: Sequence[FreeParameter], values: Floats, half_width: Floats
) -> tuple[Floats, Floats]:
    """Values at the slow and at the fast end of their intervals."""
    slow, fast = values.copy(), values.copy()
    for i in np.flatnonzero(half_width).tolist():
        one, middle = free[i], free[i].coordinate(values[i])
        ends = [one.value(middle + side * half_width[i]) for side in (-1.0, 1.0)]
        ends = [min(max(end, one.low), one.high) for end in ends]
        slow[i], fast[i] = ends if one.log_scale else reversed(ends)
    return slow, fast


APART = 2.0
"""Half widths of the 95 % interval of a difference beyond which units differ [1]: four standard
deviations, since a dozen differences are tested."""
EACH = 2
"""Clusters of each unit for every parameter that it may differ in, or none is tested [1]: fewer
show no scatter, and any difference would be one."""
STEPS = 3
"""Times that the residuals are weighted anew on the way to the units' own parameters [1]."""


def _apart(problem: Problem, found: Optimum, active: Bools, *, unfelt: bool) -> frozenset[str]:
    """Names of shared parameters in units that differ, and where ``unfelt`` that excite them alone.

    What a parameter of one unit alone does is that part of the Jacobian that belongs to its
    residuals; how far the unit departs from the others is a step from the common optimum.
    """
    apart, names, contrasts = set(), [], []
    free, unit = problem.free, problem.unit
    many = min(len(np.unique(problem.blocks[unit == one])) for one in np.unique(unit))
    for i in np.flatnonzero(active).tolist():
        if free[i].units:
            continue
        widest = problem.settings.widest * problem.reach(free[i], found.values[i])
        parts = {one: found.jacobian[:, i] * (unit == one) for one in np.unique(unit).tolist()}
        excited = [one for one in parts if widest * np.linalg.norm(parts[one]) >= 2]
        own = [f"{free[i].shared}@{one}" for one in excited]
        if unfelt and excited and len(excited) < len(parts):
            apart.update(own)
        names += [own] * len(excited[1:])
        contrasts += [parts[one] for one in excited[1:]]
    if contrasts and many > EACH * len({own[0] for own in names}):
        jacobian, after = np.column_stack([*contrasts, found.jacobian[:, active]]), found
        for _ in range(STEPS):  # what units differ in must not count as strange, nor as noise
            w = after.weight
            step = np.linalg.lstsq(jacobian * w[:, None], -found.residuals * w, rcond=None)[0]
            after = replace(found, residuals=found.residuals + jacobian @ step)
        half_width = problem.uncertainty(after, jacobian).half_width
        for own, away, half in zip(names, np.abs(step), half_width, strict=False):
            if away > APART * half:
                apart.update(own)
    return frozenset(apart)


def _rates(
    observed: Sequence[Observed], free: Sequence[FreeParameter], units: Sequence[str]
) -> dict[int, Rate]:
    """Rapid rates that the logged speeds tell, by their place in ``free``."""
    by_unit = {unit: rapid_rates([o for o in observed if o.unit == unit]) for unit in units}
    return {
        i: by_unit[unit][one.axes[0]]
        for i, one in enumerate(free)
        for unit in one.units
        if one.key == "rapid_speed" and one.axes[0] in by_unit[unit]
    }


def _loosest(problem: Problem, found: Optimum, active: Bools) -> Bools:
    """Active parameters that the logs do not determine: those without effect, else the loosest one.

    With no more clusters than parameters there is no interval; then the one of least effect goes.
    """
    if not active.any():
        return active
    jacobian = found.jacobian[:, active]
    half_width = problem.uncertainty(found, jacobian).half_width
    felt = np.linalg.norm(jacobian, axis=0)
    # half width if all others were known, which clustered residuals may call narrower
    alone = np.divide(2.0, felt, out=np.full(len(felt), np.inf), where=felt > 0)
    enough = bool(np.isfinite(half_width).all())
    width = np.zeros(len(problem.free))
    width[active] = np.maximum(half_width, alone) if enough else alone
    for i, one in enumerate(problem.free):
        value = float(found.values[i])
        width[i] /= problem.reach(one, value)
        if one.log_scale and active[i] and not one.low * 1.001 < value < one.high * 0.999:
            width[i] = np.inf
    widest = problem.settings.widest if enough else 0.0
    return active & (width > widest) & (width >= width.max(initial=0.0))


def _intervals(
    free: Sequence[FreeParameter], found: Optimum, rates: dict[int, Rate], active: Bools,
    uncertainty: Uncertainty,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Ends of the 95 % interval of each parameter, NaN of what is not determined; (D,) each."""
    low, high = np.full(len(free), np.nan), np.full(len(free), np.nan)
    for i, width in zip(
        np.flatnonzero(active).tolist(), uncertainty.half_width.tolist(), strict=True
    ):
        one, middle = free[i], free[i].coordinate(found.values[i])
        low[i] = max(one.value(middle - width), one.low)
        high[i] = min(one.value(middle + width), one.high)
    for i, rate in rates.items():
        low[i], high[i] = rate.low, rate.high
    return low, high
