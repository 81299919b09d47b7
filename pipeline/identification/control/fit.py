"""Bounded least squares on the durations of segments: the control that explains the logs best.

Residual of a segment: measured duration without stops - planned duration of its rows under the
overrides in force.  Both ends are polls, so that an error of a polling interval is noise; waits of
the operator that the log does not tell are outliers (soft L1).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.control.free import Free, control_of, free_parameters
from pipeline.identification.control.segments import Observed, clusters
from pipeline.identification.control.rates import Rate, rapid_rates
from pipeline.identification.least_squares import Certainty, certainty
from pipeline.machine.control import ControlParameters
from pipeline.twin.program import planned_program

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ControlFitSettings:
    """How a control is identified.

    Parameters
    ----------
    shortest_s : float
        Segments are at least as long [s], those of waits excepted.
    scales_s : tuple of float
        Residuals above count linearly [s]: from what the start may be wrong by down to what polling
        adds to the duration of a segment.
    loose_s : float
        Waiting times are sought about their start as loosely as this [s]; rates within a factor e.
    widest : float
        A parameter whose 95 % interval is wider than this share of it is not determined [1].
    step : float
        Of the differences that the Jacobian is made of [1 on the logarithmic scale, s].
    evaluations : int
        Jacobians at most.
    """

    shortest_s: float = 1.0
    scales_s: tuple[float, ...] = (3.0, 0.8, 0.2)
    loose_s: float = 5.0
    widest: float = 0.5
    step: float = 0.02
    evaluations: int = 60


@dataclass(frozen=True, kw_only=True)
class ControlFit:
    """What was found.

    Parameters
    ----------
    free : tuple of Free
        What was sought.
    values : ndarray, shape (D,)
        In the units of ``free``.
    low, high : ndarray, shape (D,)
        95 % interval.
    determined : ndarray of bool, shape (D,)
        Whether the logs say anything of it.
    told : ndarray of bool, shape (D,)
        Whether it was read from logged speeds, not fitted to durations.
    control : dict of str to ControlParameters
        Of each unit; what is not determined as it was at the start.
    sure : Certainty
        Of the determined ones, on the scale of the search.
    rmse_s : float
        Of the residuals, without outliers beyond 10 times the noise [s].
    segments : int
        How many.
    """

    free: tuple[Free, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: NDArray[np.bool_]
    told: NDArray[np.bool_]
    control: dict[str, ControlParameters]
    sure: Certainty
    rmse_s: float
    segments: int


def planned(observed: Observed, control: ControlParameters) -> Floats:
    """Duration of each segment [s]; shape (N,)."""
    times = planned_program(observed.moves, control, observed.overrides).time
    until = np.concatenate([[0.0], np.cumsum(times)])
    durations: Floats = until[observed.after] - until[observed.first]
    return durations


def identify_control(
    observed: Sequence[Observed], start: ControlParameters, settings: ControlFitSettings
) -> ControlFit:
    """Find the control of the runs ``observed``.

    Raises
    ------
    ValueError
        When there is no run.
    """
    if not observed:
        raise ValueError(
            "no run of a program is there to identify the control from: "
            "put logs of line numbers and the programs that ran beside them"
        )
    units = sorted({one.unit for one in observed})
    free = free_parameters(start, units)
    measured = np.concatenate([one.measured for one in observed])

    def residuals(values: Floats) -> Floats:
        controls = {unit: control_of(start, free, values, unit) for unit in units}
        return measured - np.concatenate([planned(o, controls[o.unit]) for o in observed])

    blocks = clusters(observed)
    values = np.array([f.start for f in free])
    rates = _rates(observed, free, units)
    values[list(rates)] = [rate.value for rate in rates.values()]
    active = np.ones(len(free), dtype=bool)
    active[list(rates)] = False
    for scale in settings.scales_s:  # waits that the start explains badly must not count as strange
        values, jacobian, rest = _solve(residuals, free, values, active, scale, settings)
    while True:
        sure = _certainty(jacobian, rest, blocks)
        bad = _undetermined(free, values, jacobian, sure, active, settings)
        if not bad.any():
            break
        active &= ~bad  # they stay where they are, the others are found again
        if not active.any():
            raise ValueError(
                f"{len(measured)} stretches of {len(observed)} runs determine no parameter of the "
                "control: log more runs of programs"
            )
        values, jacobian, rest = _solve(
            residuals, free, values, active, settings.scales_s[-1], settings
        )
    return _fit(free, values, rates, active, sure, rest, start, units, settings)


def _rates(
    observed: Sequence[Observed], free: Sequence[Free], units: Sequence[str]
) -> dict[int, Rate]:
    """Rapid rates that the logged speeds tell, by their place in ``free``."""
    told = {unit: rapid_rates([o for o in observed if o.unit == unit]) for unit in units}
    return {
        i: told[unit][one.axes[0]]
        for i, one in enumerate(free)
        for unit in one.units
        if one.key == "rapid_speed" and one.axes[0] in told[unit]
    }


def _solve(
    residuals: Callable[[Floats], Floats], free: Sequence[Free], values: Floats,
    active: NDArray[np.bool_], scale_s: float, settings: ControlFitSettings,
) -> tuple[Floats, Floats, Floats]:  # fmt: skip
    """Values at the optimum of the active ones, Jacobian and residuals there in ``scale_s``.

    A weak pull towards where the search began decides what the logs leave open; it has no part in
    the Jacobian and the residuals that are returned.
    """
    from scipy.optimize import least_squares

    sought = [one for one, used in zip(free, active, strict=True) if used]
    low, high = np.array([one.bounds for one in sought]).T
    begin = np.clip([one.coordinate(one.start) for one in sought], low, high)
    pull = np.array([1.0 if one.shrink else 1 / settings.loose_s for one in sought])

    def full(x: Floats) -> Floats:
        out = values.copy()
        out[active] = [one.value(v) for one, v in zip(sought, x, strict=True)]
        return out

    def scaled(x: Floats) -> Floats:
        return residuals(full(x)) / scale_s

    def jacobian(x: Floats) -> Floats:
        columns = []
        for k in range(len(x)):
            ahead, behind = x.copy(), x.copy()
            ahead[k] = min(x[k] + settings.step, high[k])
            behind[k] = max(x[k] - settings.step, low[k])
            columns.append((scaled(ahead) - scaled(behind)) / (ahead[k] - behind[k]))
        return np.column_stack(columns)

    x = [one.coordinate(v) for one, v in zip(sought, values[active], strict=True)]
    found = least_squares(
        lambda x: np.concatenate([scaled(x), pull * (x - begin)]),
        np.clip(x, low, high),
        jac=lambda x: np.vstack([jacobian(x), np.diag(pull)]),
        bounds=(low, high),
        loss="soft_l1",
        max_nfev=settings.evaluations,
    ).x
    return full(found), jacobian(found), scaled(found)


def _certainty(jacobian: Floats, rest: Floats, blocks: NDArray[np.int64]) -> Certainty:
    """Of the optimum, each residual weighted as the loss did; on the scale of the search."""
    weight = (1 + rest**2) ** -0.25  # square root of soft L1's derivative
    return certainty(jacobian * weight[:, None], rest * weight, blocks)


def _undetermined(
    free: Sequence[Free], values: Floats, jacobian: Floats, sure: Certainty,
    active: NDArray[np.bool_], settings: ControlFitSettings,
) -> NDArray[np.bool_]:  # fmt: skip
    """Which active parameters the logs do not determine: those unfelt, else the loosest one."""
    index = np.flatnonzero(active)
    loose = np.zeros(len(free))
    felt = np.linalg.norm(jacobian, axis=0)
    for k, i in enumerate(index):
        one, value = free[i], values[i]
        scale = 1.0 if one.shrink else max(abs(value), 2 * settings.scales_s[-1])
        alone = 2 / felt[k] if felt[k] > 0 else np.inf  # half width if all others were known
        loose[i] = max(sure.half_width[k], alone) / scale
        if one.shrink and not one.low * 1.001 < value < one.high * 0.999:
            loose[i] = np.inf
    worst = loose.max(initial=0.0)
    return active & (loose > settings.widest) & (loose >= worst)


def _fit(
    free: Sequence[Free], values: Floats, rates: dict[int, Rate], active: NDArray[np.bool_],
    sure: Certainty, rest: Floats, start: ControlParameters, units: Sequence[str],
    settings: ControlFitSettings,
) -> ControlFit:  # fmt: skip
    low, high = np.full(len(free), np.nan), np.full(len(free), np.nan)
    for i, width in zip(np.flatnonzero(active), sure.half_width, strict=True):
        middle = free[i].coordinate(values[i])
        low[i] = max(free[i].value(middle - width), free[i].low)
        high[i] = free[i].value(middle + width)
    for i, rate in rates.items():
        low[i], high[i] = rate.low, rate.high
    told = np.isin(np.arange(len(free)), list(rates))
    usual = rest[np.abs(rest) < 10]
    return ControlFit(
        free=tuple(free),
        values=values,
        low=low,
        high=high,
        determined=active | told,
        told=told,
        control={unit: control_of(start, free, values, unit) for unit in units},
        sure=sure,
        rmse_s=float(np.sqrt(np.mean(usual**2))) * settings.scales_s[-1] if len(usual) else np.nan,
        segments=len(rest),
    )
