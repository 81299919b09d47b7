"""A servo's scale factors, feed-forward and lags from its records (Sim2023, put right).

Sim2023 seeks S_pp, S_vp and S_vi with the closed loop simulated, by RMSE(e) + RMSE(A).  There all
that the mechanics' model leaves out (cogs, twist, bristles) has to be explained by the gains: on a
simulated axis of that kind S_vp comes out wrong by a third.  The servo's own equation holds
whatever the mechanics do, so that it is fitted here, and the closed loop is what the result is
judged by (:mod:`pipeline.validation.drive`).

Where a scale at the carriage closes the position loop and the motor's encoder the velocity loop,
the twist of the screw makes S_vp and S_vi smaller by 1 + S_vi V_i k / K, k the force constant and K
the stiffness: those are the gains that the carriage sees, and a twin of one mass needs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.known import AxisConstants
from pipeline.identification.drive.records import DriveFitSettings, Recording
from pipeline.identification.drive.servo_choice import (
    ServoCertainty,
    none_seen,
    servo_certainty,
    wanted_servo,
)
from pipeline.identification.drive.servo_equation import ServoEquation, servo_equation
from pipeline.identification.drive.servo_records import (
    servo_bandwidth,
    servo_records,
)
from pipeline.identification.drive.servo_search import (
    ServoOptimum,
    genetic_servo,
    least_squares_servo,
)
from pipeline.identification.drive.servo_terms import (
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
)
from pipeline.machine.axis.servo import ServoParameters

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

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
    """A servo found from records, D parameters in the order of ``names``.

    Parameters
    ----------
    names, units : tuple of str
        Of the parameters; scale factors are gains in SI where the control's list names none.
    values, low, high : ndarray, shape (D,)
        With the 95 % interval; those of what is not determined have no meaning.
    determined : ndarray of bool, shape (D,)
        Whether the records determine it.
    how, remedy : tuple of str
        Where each value is from; what to record where it is not determined.
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
        What ``correlation`` is of.
    correlation : ndarray, shape (S, S)
        Of the parameters that were sought.
    left_out : tuple of str
        Recordings of another list of gains than the first's: another servo.
    """

    names: tuple[str, ...] = SHOWN
    units: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Flags
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
    """The servo of ``axis``, from recordings that show its commanded and its measured position.

    Parameters
    ----------
    recordings : sequence of Recording
        To learn from.
    axis : str
        Its letter.
    settings : DriveFitSettings
        How it is sought.

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
    best, sure, told = _determined(equation, slower, wanted_servo(equation), settings.widest)
    methods, best = _methods(equation, best, settings, unit)
    found = _Terms.of(nominal, best, sure, told)
    found.add_rounding(nominal, constants, records[0].period)
    found.take_none_seen(equation, slower, best)
    return replace(_fit(equation, found, sure, methods, unit, bandwidth), left_out=tuple(others))


@dataclass(kw_only=True)
class _Terms:
    """What is known of each term while it is put together; every array has shape (D,)."""

    values: Floats
    low: Floats
    high: Floats
    determined: Flags
    how: list[str]
    error: float

    @classmethod
    def of(
        cls, nominal: Nominal, best: ServoOptimum, sure: ServoCertainty, told: Flags
    ) -> "_Terms":
        values = best.values.copy()
        values[TX] = max(values[TX] - values[TH], 0.0)
        values[[TX, TV]] = np.where(values[[TX, TV]] < SHORTEST, 0.0, values[[TX, TV]])
        return cls(
            values=values, low=np.maximum(values - sure.half_width, 0.0),
            high=values + sure.half_width, determined=told.copy(),
            how=[
                _how(nominal, k, bool(told[k]), bool(best.sought[k])) for k in range(len(TERMS))
            ],
            error=best.error,
        )  # fmt: skip

    def add_rounding(self, nominal: Nominal, constants: AxisConstants, period: float) -> None:
        """What a sampled integral adds to S_vp.

        Sum and integral of the velocity error differ by half a sample of it, which acts like a part
        S_vi V_i T / 2 of the proportional gain.  Of a servo whose period T nobody knows, no more is
        known than that it is not above the recorder's.
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
        """A feed-forward that the records do not want is none, where they would have shown it."""
        for k in (FV, FA):
            if best.sought[k] or equation.nominal.named(TERMS[k]):
                continue
            if (most := none_seen(equation, slower, best, k)) is not None:
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
) -> tuple[ServoOptimum, ServoCertainty, Flags]:
    """Take what the list says for scales that stay open, and say which are determined."""
    while True:
        sure = servo_certainty(equation, slower, best)
        least = np.zeros(len(TERMS))
        least[[TX, TV]] = equation.period
        told: Flags = 2 * sure.half_width <= widest * np.maximum(np.abs(best.values), least)
        open_ = [k for k in SCALES if best.sought[k] and not told[k]
                 and equation.nominal.named(TERMS[k])]  # fmt: skip
        if not open_:
            return best, sure, told
        worst = max(open_, key=lambda k: sure.half_width[k] / best.values[k])
        values, sought = best.values.copy(), best.sought.copy()
        values[worst], sought[worst] = 1.0, False
        again = least_squares_servo(equation, values, sought)
        best = replace(again, evaluations=again.evaluations + best.evaluations)


def _methods(
    equation: ServoEquation, best: ServoOptimum, settings: DriveFitSettings, unit: str
) -> tuple[tuple[dict[str, Any], ...], ServoOptimum]:
    found = {"least_squares": best}
    if settings.compare or settings.method == "genetic":
        found["genetic"] = genetic_servo(equation, best.values, best.sought, settings.genetic)
    methods = tuple(
        {
            "task": "servo", "method": name, "chosen": name == settings.method,
            "error": one.error, "error_unit": unit, "evaluations": one.evaluations,
        }
        for name, one in found.items()
    )  # fmt: skip
    return methods, found[settings.method]


def _how(nominal: Nominal, term: int, told: bool, sought: bool) -> str:
    if told:
        return FITTED
    if sought:
        return LOOSE
    return LISTED if nominal.named(TERMS[term]) else WITHOUT


def _fit(
    equation: ServoEquation, found: _Terms, sure: ServoCertainty,
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
        condition=sure.condition, rank=sure.rank, correlated=sure.correlated,
        correlation=sure.correlation,
    )  # fmt: skip
