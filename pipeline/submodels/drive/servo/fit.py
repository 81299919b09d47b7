"""Servo of one axis from its records: scale factors, feed-forward and lags (Sim2023, corrected).

Sim2023 identifies S_pp, S_vp and S_vi with the closed loop simulated, by RMSE(e) + RMSE(A).  There
the gains have to explain all that the model of the mechanics leaves out (cogging, twist, bristles):
on a simulated axis of that kind S_vp comes out wrong by a third.  The servo's control law holds
whatever the mechanics do, so that it is fitted here; the closed loop judges the result.

Where a scale at the carriage closes the position loop and the motor's encoder the velocity loop,
the twist of the screw makes S_vp and S_vi smaller by 1 + S_vi V_i k / K, k the force constant and K
the stiffness: those are the gains that the carriage sees, and a twin of one mass needs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.machine.axis.servo import ServoParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.submodels.drive.prior import DriveFitSettings
from pipeline.submodels.drive.records import AxisConstants, Recording
from pipeline.submodels.drive.servo.equation import (
    FA,
    FV,
    REMEDY,
    SCALES,
    SPP,
    SVI,
    SVP,
    TERMS,
    TH,
    TV,
    TX,
    Nominal,
    ServoEquation,
    servo_bandwidth,
    servo_equation,
    servo_records,
)
from pipeline.submodels.drive.servo.search import (
    ServoOptimum,
    ServoUncertainty,
    genetic_servo,
    greatest_unseen,
    least_squares_servo,
    selected_servo,
    servo_uncertainty,
)

FITTED = "the servo's own equation on recorded reference, position and command"
LISTED = "as conf/machine/ has it; these records do not tell it better"
WITHOUT = "not determined by these records; the twin goes without"
LOOSE = "not determined by these records; the twin uses the best value all the same"
SHORTEST = 1e-7
"""Lags below are none [s]."""
NONE_SEEN = "the records want none"
SHOWN = TERMS[:TH]


@dataclass(frozen=True, kw_only=True)
class ServoFit:
    """Servo identified from records, D parameters in the order of ``names``.

    Parameters
    ----------
    names, units : tuple of str
        Of the parameters; scale factors are gains in SI where the control's list names none.
    values, low, high : ndarray, shape (D,)
        With the 95 % interval; those of what is not determined have no meaning.
    determined : ndarray of bool, shape (D,)
        Whether the records determine it.
    how, remedy : tuple of str
        Where each value comes from; what to record where it is not determined.
    servo : ServoParameters or None
        With all of them; None where a gain is neither determined nor listed.
    reason : str
        Why there is no servo, in one sentence.
    methods : tuple of mapping
        Each method that was tried: task, method, chosen, error, error_unit, evaluations.
    samples : int
        Rows that were fitted.
    relative_error_percent : float
        Of the command, RMSE over its standard deviation [%].
    bandwidth_Hz : float
        Below which the command was compared [Hz].
    condition : float
        Of the Jacobian with columns scaled to length one.
    rank : int
        Of the same.
    correlated : tuple of str
        Names of the parameters in ``correlation``.
    correlation : ndarray, shape (S, S)
        Of the parameters that were fitted.
    left_out : tuple of str
        Recordings of another list of gains than the first's: another servo.
    """

    names: tuple[str, ...] = SHOWN
    units: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Bools
    how: tuple[str, ...]
    remedy: tuple[str, ...]
    servo: ServoParameters | None
    reason: str = ""
    methods: tuple[Mapping[str, Any], ...] = ()
    samples: int = 0
    relative_error_percent: float = np.nan
    bandwidth_Hz: float = np.nan
    condition: float = np.nan
    rank: int = 0
    correlated: tuple[str, ...] = ()
    correlation: Floats
    left_out: tuple[str, ...] = ()


def identify_servo(
    recordings: Sequence[Recording], axis: str, settings: DriveFitSettings
) -> ServoFit:
    """Servo of ``axis`` from recordings of its commanded and measured position.

    Parameters
    ----------
    recordings : sequence of Recording
        For training.
    axis : str
        Its letter.
    settings : DriveFitSettings
        Choices of the identification.

    Returns
    -------
    ServoFit
        Without a servo, and with the reason, where the recordings cannot give one.
    """
    records, constants, unit, others = servo_records(recordings, axis)
    nominal = Nominal.of(constants)
    if not records:
        return _without(nominal, unit, f"no training recording of axis {axis} has commanded "
                        "position, measured position and command: record all three")  # fmt: skip
    bandwidth = settings.bandwidth_Hz or servo_bandwidth(records)
    try:
        equation, slower = (servo_equation(records, nominal, b) for b in (bandwidth, bandwidth / 2))
    except ValueError as error:
        return _without(nominal, unit, f"axis {axis}: {error}")
    best, uncertainty, determined = _determined(
        equation, slower, selected_servo(equation), settings.widest
    )
    methods, best = _methods(equation, best, settings, unit)
    found = _Terms.of(nominal, best, uncertainty, determined)
    found.add_rounding(nominal, constants, records[0].period)
    found.take_none_seen(equation, slower, best)
    return replace(
        _fit(equation, found, uncertainty, methods, unit, bandwidth), left_out=tuple(others)
    )


@dataclass(kw_only=True)
class _Terms:
    """Estimates of the terms while they are put together; every array has shape (D,)."""

    values: Floats
    low: Floats
    high: Floats
    determined: Bools
    how: list[str]
    error: float

    @classmethod
    def of(
        cls, nominal: Nominal, best: ServoOptimum, uncertainty: ServoUncertainty, determined: Bools
    ) -> "_Terms":
        values = best.values.copy()
        values[TX] = max(values[TX] - values[TH], 0.0)
        values[[TX, TV]] = np.where(values[[TX, TV]] < SHORTEST, 0.0, values[[TX, TV]])
        return cls(
            values=values, low=np.maximum(values - uncertainty.half_width, 0.0),
            high=values + uncertainty.half_width, determined=determined.copy(),
            how=[
                _how(nominal, k, bool(determined[k]), bool(best.fitted[k]))
                for k in range(len(TERMS))
            ],
            error=best.error,
        )  # fmt: skip

    def add_rounding(self, nominal: Nominal, constants: AxisConstants, period: float) -> None:
        """Add the contribution of a sampled integral to S_vp.

        Sum and integral of the velocity error differ by half a sample of it, which acts like a part
        S_vi V_i T / 2 of the proportional gain.  Where the servo's period T is not listed, it is
        only bounded by the recorder's.
        """
        part = 0.5 * self.values[SVI] * nominal.integral_gain / nominal.velocity_gain
        least, most = 0.0, part * period
        if constants.servo_period is not None:
            least = most = part * constants.servo_period
        self.values[SVP] += 0.5 * (least + most)
        self.low[SVP], self.high[SVP] = self.low[SVP] + least, self.high[SVP] + most

    def take_none_seen(
        self, equation: ServoEquation, slower: ServoEquation, best: ServoOptimum
    ) -> None:
        """Set a feed-forward that was not fitted to 0 where the records would have shown it."""
        for k in (FV, FA):
            if best.fitted[k] or equation.nominal.named(TERMS[k]):
                continue
            if (most := greatest_unseen(equation, slower, best, k)) is not None:
                self.determined[k], self.low[k], self.high[k] = True, 0.0, most
                self.how[k] = NONE_SEEN


def _without(nominal: Nominal, unit: str, reason: str) -> ServoFit:
    none = np.full(len(SHOWN), np.nan)
    return ServoFit(
        units=tuple(nominal.unit(n, unit) for n in SHOWN), values=none, low=none, high=none,
        determined=np.zeros(len(SHOWN), bool), how=(LISTED,) * len(SHOWN),
        remedy=(reason,) * len(SHOWN), servo=None, reason=reason, correlation=np.empty((0, 0)),
    )  # fmt: skip


def _determined(
    equation: ServoEquation, slower: ServoEquation, best: ServoOptimum, widest: float
) -> tuple[ServoOptimum, ServoUncertainty, Bools]:
    """Optimum with the listed value of scales that are not determined, and which are."""
    while True:
        uncertainty = servo_uncertainty(equation, slower, best)
        least = np.zeros(len(TERMS))
        least[[TX, TV]] = equation.period
        determined: Bools = 2 * uncertainty.half_width <= widest * np.maximum(
            np.abs(best.values), least
        )
        open_ = [k for k in SCALES if best.fitted[k] and not determined[k]
                 and equation.nominal.named(TERMS[k])]  # fmt: skip
        if not open_:
            return best, uncertainty, determined
        worst = max(open_, key=lambda k: uncertainty.half_width[k] / best.values[k])
        values, fitted = best.values.copy(), best.fitted.copy()
        values[worst], fitted[worst] = 1.0, False
        again = least_squares_servo(equation, values, fitted)
        best = replace(again, evaluations=again.evaluations + best.evaluations)


def _methods(
    equation: ServoEquation, best: ServoOptimum, settings: DriveFitSettings, unit: str
) -> tuple[tuple[dict[str, Any], ...], ServoOptimum]:
    found = {"least_squares": best}
    if settings.compare or settings.method == "genetic":
        found["genetic"] = genetic_servo(equation, best.values, best.fitted, settings.genetic)
    methods = tuple(
        {
            "task": "servo", "method": name, "chosen": name == settings.method,
            "error": one.error, "error_unit": unit, "evaluations": one.evaluations,
        }
        for name, one in found.items()
    )  # fmt: skip
    return methods, found[settings.method]


def _how(nominal: Nominal, term: int, determined: bool, fitted: bool) -> str:
    if determined:
        return FITTED
    if fitted:
        return LOOSE
    return LISTED if nominal.named(TERMS[term]) else WITHOUT


def _fit(
    equation: ServoEquation, found: _Terms, uncertainty: ServoUncertainty,
    methods: tuple[dict[str, Any], ...], unit: str, bandwidth: float,
) -> ServoFit:  # fmt: skip
    nominal = equation.nominal
    open_ = [k for k in (SPP, SVP) if not found.determined[k] and not nominal.named(TERMS[k])]
    names = " and ".join(TERMS[k].removesuffix("_scale") + "_gain" for k in open_)
    lacking = (
        f"the records do not determine {names}: {REMEDY['velocity_scale']}, or name {names} in "
        "conf/machine/"
    )
    return ServoFit(
        units=tuple(nominal.unit(n, unit) for n in SHOWN),
        values=found.values[:TH], low=found.low[:TH], high=found.high[:TH],
        determined=found.determined[:TH], how=tuple(found.how[:TH]),
        remedy=tuple(REMEDY[n] for n in SHOWN),
        servo=None if open_ else nominal.servo(found.values), reason=lacking if open_ else "",
        methods=methods, samples=equation.rows, bandwidth_Hz=bandwidth,
        relative_error_percent=100 * found.error / equation.spread,
        condition=uncertainty.condition, rank=uncertainty.rank, correlated=uncertainty.correlated,
        correlation=uncertainty.correlation,
    )  # fmt: skip
