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
from pipeline.submodels.control.parameters import FreeParameter, control_of, free_parameters
from pipeline.submodels.control.segments import Observed, Rate, clusters, rapid_rates
from pipeline.submodels.statistics import Uncertainty, textbook_half_width, uncertainty_of
from pipeline.twin.control import planned_program

Residuals = Callable[[Floats], Floats]
TOLERANCE = 1e-5
"""Relative change of cost or parameters at which a search ends [1]: far inside any interval."""


@dataclass(frozen=True, kw_only=True)
class SearchSettings(Ranged, section="control_fit"):
    """Settings of the search for an optimum.

    Parameters
    ----------
    loose_s : float
        Width about the start of the weak prior on waiting times [s]; that of rates is a factor e.
    step : float
        Of the differences that the Jacobian is made of [1 on the logarithmic scale, s].
    evaluations : int
        Jacobians at most.
    """

    loose_s: Positive = 5.0
    step: Positive = 0.02
    evaluations: Count = 60


@dataclass(frozen=True, kw_only=True)
class Optimum:
    """Where a search ended.

    Parameters
    ----------
    values : ndarray, shape (D,)
        Of all parameters, in their units.
    jacobian : ndarray, shape (N, S)
        Of the residuals by the S parameters that were fitted, on the scale of the search [1].
    residuals : ndarray, shape (N,)
        In units of the scale beyond which they count linearly [1].
    """

    values: Floats
    jacobian: Floats
    residuals: Floats


def optimum(
    residuals: Residuals, free: Sequence[FreeParameter], values: Floats, active: NDArray[np.bool_],
    scale_s: float, settings: SearchSettings,
) -> Optimum:  # fmt: skip
    """Least squares (soft L1) of the ``active`` parameters; the others stay as in ``values``.

    A weak pull towards where the search began decides what the residuals leave open; it has no part
    in the Jacobian and the residuals that are returned.

    Parameters
    ----------
    residuals : callable
        Residuals, shape (N,) [s], of all parameters, shape (D,), in their units.
    free : sequence of FreeParameter
        The D parameters.
    values : ndarray, shape (D,)
        Where the search begins.
    active : ndarray of bool, shape (D,)
        Which are fitted.
    scale_s : float
        Residuals above count linearly [s].
    settings : SearchSettings
        Of the search.
    """
    from scipy.optimize import least_squares

    fitted = [one for one, used in zip(free, active, strict=True) if used]
    low, high = np.array([one.bounds for one in fitted]).T
    begin = np.clip([one.coordinate(one.start) for one in fitted], low, high)
    pull = np.array([1.0 if one.log_scale else 1 / settings.loose_s for one in fitted])

    def full(x: Floats) -> Floats:
        out = values.copy()
        out[active] = [one.value(v) for one, v in zip(fitted, x.tolist(), strict=True)]
        return out

    def scaled(x: Floats) -> Floats:
        return residuals(full(x)) / scale_s

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
    return Optimum(values=full(found), jacobian=jacobian(found), residuals=scaled(found))


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
class ControlFitSettings(SearchSettings, section="control_fit"):
    """Settings of the identification of a control.

    Parameters
    ----------
    shortest_s : float
        Segments are at least as long [s], those of waits excepted.
    scales_s : tuple of float
        Residuals above count linearly [s]: from what the start may be wrong by down to what polling
        adds to the duration of a segment.
    widest : float
        A parameter whose 95 % interval is wider than this share of it is not determined [1].
    folds : int
        Controls that are identified without some of the programs for the intervals, at most.
    loose_s, step, evaluations
        As in :class:`~pipeline.submodels.control.fit.SearchSettings`.
    """

    shortest_s: Positive = 1.0
    scales_s: tuple[Positive, ...] = (3.0, 0.8, 0.2)
    widest: Positive = 0.5
    folds: Annotated[int, Range(least=2)] = 5

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.scales_s:
            raise ValueError("control_fit.scales_s is empty: name one scale of residuals at least")


@dataclass(frozen=True, kw_only=True)
class ControlFit:
    """Identified control with its intervals.

    Parameters
    ----------
    free : tuple of FreeParameter
        The parameters that were fitted.
    values : ndarray, shape (D,)
        In the units of ``free``.
    low, high : ndarray, shape (D,)
        95 % interval; NaN of what is not determined.
    determined : ndarray of bool, shape (D,)
        Whether the logs say anything of it.
    from_speeds : ndarray of bool, shape (D,)
        Whether it was read from logged speeds, not fitted to durations.
    control : dict of str to ControlParameters
        Of each unit; what is not determined near its start, where a weak pull left it.
    uncertainty : Uncertainty
        Of those fitted to durations, on the scale of the search.
    rmse_s : float
        Of the residuals, without outliers beyond 10 times the noise [s].
    segments : int
        How many.
    """

    free: tuple[FreeParameter, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Bools
    from_speeds: Bools
    control: dict[str, ControlParameters]
    uncertainty: Uncertainty
    rmse_s: float
    segments: int


def planned(observed: Observed, control: ControlParameters) -> Floats:
    """Duration of each segment [s]; shape (N,)."""
    times = planned_program(observed.moves, control, observed.overrides).time
    until = np.concatenate([[0.0], np.cumsum(times)])
    durations: Floats = until[observed.after] - until[observed.first]
    return durations


def identify_control(
    observed: Sequence[Observed], start: ControlParameters, settings: ControlFitSettings,
    near: ControlFit | None = None,
) -> ControlFit:  # fmt: skip
    """Find the control of the runs ``observed``.

    What they do not determine is taken out one by one, the loosest first, and stays where it is
    while the others are found again.

    Parameters
    ----------
    observed : sequence of Observed
        The runs.
    start : ControlParameters
        Where the search begins, and to which a weak prior pulls.
    settings : ControlFitSettings
        Of the search.
    near : ControlFit, optional
        Control of more runs of the same units, where the search begins in place of ``start``.

    Raises
    ------
    ValueError
        When there is no run, or the runs determine no parameter.
    """
    if not sum(len(one.measured) for one in observed):
        raise ValueError(
            "no run of a program is there to identify the control from: "
            "put logs of line numbers and the programs that ran beside them"
        )
    units = sorted({one.unit for one in observed})
    free = free_parameters(start, units)
    measured = np.concatenate([one.measured for one in observed])

    own = {unit: np.array([not one.units or unit in one.units for one in free]) for unit in units}

    @lru_cache(maxsize=4 * len(units))  # a step in a parameter of one unit leaves the others' times
    def durations(unit: str, values: tuple[float, ...]) -> list[Floats]:
        control = control_of(start, free, np.array(values), unit)
        return [planned(one, control) for one in observed if one.unit == unit]

    def residuals(values: Floats) -> Floats:
        each = {
            unit: iter(durations(unit, tuple(np.where(own[unit], values, 0.0).tolist())))
            for unit in units
        }
        return measured - np.concatenate([next(each[one.unit]) for one in observed])

    rates = _rates(observed, free, units)
    begin = np.array([one.start for one in free])
    begin[list(rates)] = [rate.value for rate in rates.values()]
    fitted = ~np.isin(np.arange(len(free)), list(rates))
    if near is not None:
        begin = np.where(fitted, near.values, begin)
        settings = replace(settings, scales_s=settings.scales_s[-1:])
    found, active, uncertainty = _determined(
        residuals, free, begin, fitted, clusters(observed), settings,
        likely=None if near is None else fitted & near.determined,
    )  # fmt: skip
    if not active.any():
        raise ValueError(
            f"{len(measured)} stretches of {len(observed)} runs determine no parameter of the "
            "control: log more runs of programs"
        )
    control = {unit: control_of(start, free, found.values, unit) for unit in units}
    return _fit(free, found, rates, active, uncertainty, control, scale_s=settings.scales_s[-1])


def _determined(
    residuals: Residuals, free: Sequence[FreeParameter], begin: Floats, active: Bools,
    blocks: NDArray[np.int64], settings: ControlFitSettings, *, likely: Bools | None,
) -> tuple[Optimum, Bools, Uncertainty]:  # fmt: skip
    """The optimum of what the logs determine of the ``active`` parameters, and which these are.

    Those that are not ``likely`` to be are taken out together, where these logs left them.
    """
    values = begin
    for scale in settings.scales_s:  # waits that the start explains badly must not count as strange
        found = optimum(residuals, free, values, active, scale, settings)
        values = found.values
    if likely is not None and likely.any():
        active = likely
        found = optimum(residuals, free, values, active, settings.scales_s[-1], settings)
    uncertainty = _uncertainty(found, blocks)
    while (loose := _loosest(free, found, uncertainty, active, settings)).any():
        active = active & ~loose
        if not active.any():
            break
        found = optimum(residuals, free, found.values, active, settings.scales_s[-1], settings)
        uncertainty = _uncertainty(found, blocks)
    return found, active, uncertainty


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


def _uncertainty(found: Optimum, blocks: NDArray[np.int64]) -> Uncertainty:
    """Of the optimum, each residual weighted as the loss did; on the scale of the search."""
    weight = (1 + found.residuals**2) ** -0.25  # square root of soft L1's derivative
    jacobian, residuals = found.jacobian * weight[:, None], found.residuals * weight
    uncertainty = uncertainty_of(jacobian, residuals, blocks)
    noise = 1.4826 * float(np.median(np.abs(found.residuals)))  # outliers have no part in it
    half_width = np.maximum(uncertainty.half_width, textbook_half_width(jacobian, noise))
    return replace(uncertainty, half_width=half_width)


def _loosest(
    free: Sequence[FreeParameter], found: Optimum, uncertainty: Uncertainty, active: Bools,
    settings: ControlFitSettings,
) -> Bools:  # fmt: skip
    """Which active parameters the logs do not determine: those unfelt, else the loosest one.

    With no more clusters than parameters no interval is known; then the least felt one goes.
    """
    felt = np.linalg.norm(found.jacobian, axis=0)
    # half width if all others were known, which clustered residuals may call narrower
    alone = np.divide(2.0, felt, out=np.full(len(felt), np.inf), where=felt > 0)
    enough = bool(np.isfinite(uncertainty.half_width).all())
    width = np.zeros(len(free))
    width[active] = np.maximum(uncertainty.half_width, alone) if enough else alone
    for i, one in enumerate(free):
        value = found.values[i]
        if not one.log_scale:
            width[i] /= max(abs(value), 2 * settings.scales_s[-1])
        elif active[i] and not one.low * 1.001 < value < one.high * 0.999:
            width[i] = np.inf
    widest = settings.widest if enough else 0.0
    loose: Bools = active & (width > widest) & (width >= width.max(initial=0.0))
    return loose


def _fit(
    free: Sequence[FreeParameter], found: Optimum, rates: dict[int, Rate], active: Bools,
    uncertainty: Uncertainty, control: dict[str, ControlParameters], *, scale_s: float,
) -> ControlFit:  # fmt: skip
    low, high = np.full(len(free), np.nan), np.full(len(free), np.nan)
    for i, width in zip(
        np.flatnonzero(active).tolist(), uncertainty.half_width.tolist(), strict=True
    ):
        one, middle = free[i], free[i].coordinate(found.values[i])
        low[i] = max(one.value(middle - width), one.low)
        high[i] = min(one.value(middle + width), one.high)
    for i, rate in rates.items():
        low[i], high[i] = rate.low, rate.high
    from_speeds = np.isin(np.arange(len(free)), list(rates))
    usual = found.residuals[np.abs(found.residuals) < 10]
    return ControlFit(
        free=tuple(free),
        values=found.values,
        low=low,
        high=high,
        determined=active | from_speeds,
        from_speeds=from_speeds,
        control=control,
        uncertainty=uncertainty,
        rmse_s=float(np.sqrt(np.mean(usual**2))) * scale_s if len(usual) else np.nan,
        segments=len(found.residuals),
    )
