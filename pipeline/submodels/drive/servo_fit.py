"""Servo of one axis from its records: scale factors, feed-forward and lags (Sim2023, corrected).

Sim2023 identifies S_pp, S_vp and S_vi with the closed loop simulated, by RMSE(e) + RMSE(A).  There
the gains have to explain all that the model of the mechanics leaves out (cogging, twist, bristles):
on a simulated axis of that kind S_vp comes out wrong by a third.  The servo's control law holds
whatever the mechanics do, so that it is fitted here; the closed loop judges the result.

Where a scale at the carriage closes the position loop and the motor's encoder the velocity loop,
the twist of the screw makes S_vp and S_vi smaller by 1 + S_vi V_i k / K, k the force constant and K
the stiffness: those are the gains that the carriage sees, and a twin of one mass needs.

Least squares from several starts and a genetic algorithm minimise the same error, the RMSE of the
command in :class:`ServoEquation`.  Optional terms are added one after the other while they improve
it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import Method
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.drive import servo_equation as law
from pipeline.submodels.drive.estimates import MISFIT_PERCENT, AxisFit, Estimates, compared_methods
from pipeline.submodels.drive.loop_gain import DECAYS, LoopGain, loop_gain
from pipeline.submodels.drive.loop_gain import LISTED as GAIN_LISTED
from pipeline.submodels.drive.records import AxisConstants, DriveFitSettings, Recording
from pipeline.submodels.drive.servo_equation import FA, FV, SPP, SVI, SVP, TERMS, TH, TV, TX
from pipeline.submodels.statistics import Uncertainty, block_numbers, uncertainty_of

SHARES = (0.0, 0.5, 0.9)
"""Shares of velocity feed-forward where a search begins [1]."""
DELAYS = (0.1, 0.5)
"""Delays over the longest of the equation where a search begins [1]."""
_EVALUATIONS = 300
_BEYOND = 3.0
"""Factor about the closed forms that bounds the genetic algorithm [1]."""


@dataclass(frozen=True, kw_only=True)
class ServoOptimum:
    """Optimum of a search."""

    values: Floats
    """Values in the order of ``TERMS``; shape (D,)."""
    fitted: Bools
    """The others are as they were given; shape (D,)."""
    error: float
    """RMSE of the command [A]."""
    evaluations: int
    """Number of servos evaluated."""


def closed_forms(equation: law.ServoEquation, share: float, values: Floats) -> Floats:
    """Start of a search: gains by linear least squares for lags of 0 and f_v = ``share``.

    A = (S_vp V_p S_pp P_p) e + (S_vp V_p)(f_v r' - v) + ... is linear in the products of the gains.
    ``values`` (D,) are those of all other parameters; where S_vi is 0 there is no integral part.
    """
    e, v_ref, swept, r, _, v, x, A = equation.undelayed(equation.triangle).T
    columns = [e, share * v_ref - v]
    if values[SVI] > 0:
        columns += [swept, share * r - x]
    gains = np.linalg.lstsq(np.stack(columns, axis=1), A, rcond=None)[0]
    n, found = equation.nominal, values.copy()
    found[FV] = share
    if gains[0] > 0 and gains[1] > 0:
        found[SPP], found[SVP] = gains[0] / gains[1] / n.position_gain, gains[1] / n.velocity_gain
    elif len(gains) > 2 and gains[2] > 0 and gains[3] > 0:
        found[SPP] = gains[2] / gains[3] / n.position_gain
    if len(gains) > 2 and gains[3] > 0:
        found[SVI] = gains[3] / n.integral_gain
    return found


def starts(equation: law.ServoEquation, values: Floats, fitted: Bools) -> Iterator[Floats]:
    """Starts of searches; each of shape (D,)."""
    low, high = equation.nominal.bounds(equation.longest)
    shares = SHARES if fitted[FV] else (float(values[FV]),)
    places = [(share, DELAYS[0]) for share in shares] + [(shares[0], late) for late in DELAYS[1:]]
    for share, late in places:
        found = closed_forms(equation, share, values)
        found[[TX, TV]] = late * equation.longest
        found[TH], found[law.TS] = 0.1 * late * equation.longest, 0.5
        found[~fitted] = values[~fitted]
        yield np.clip(found, low, high)


def least_squares_servo(
    equation: law.ServoEquation, values: Floats, fitted: Bools, begin: Floats | None = None
) -> ServoOptimum:
    """Bounded least squares of the ``fitted`` parameters, (D,); the others stay as in ``values``.

    ``values`` (D,) are also near the start; ``begin`` (D,) is the only start, in place of the
    closed forms.
    """
    from scipy.optimize import least_squares

    low, high = (bound[fitted] for bound in equation.nominal.bounds(equation.longest))

    def full(x: Floats) -> Floats:
        found = values.copy()
        found[fitted] = x
        return found

    def residuals(x: Floats) -> Floats:
        return equation.residuals(full(x))

    def slopes(x: Floats) -> Floats:
        return (equation.triangle @ equation.slopes(full(x)))[:, fitted]

    best = ServoOptimum(values=values, fitted=fitted, error=np.inf, evaluations=0)
    for start in [begin] if begin is not None else starts(equation, values, fitted):
        margin = 1e-6 * np.minimum(high - low, 1.0)
        found = least_squares(
            residuals, np.clip(start[fitted], low + margin, high - margin), jac=slopes,
            bounds=(low, high), x_scale="jac", max_nfev=_EVALUATIONS,
        )  # fmt: skip
        tried = best.evaluations + found.nfev
        error = float(equation.rmse(full(found.x)))
        if error < best.error:
            best = replace(best, values=full(found.x), error=error)
        best = replace(best, evaluations=tried)
    return best


def genetic_servo(
    equation: law.ServoEquation, values: Floats, fitted: Bools, settings: GeneticSettings
) -> ServoOptimum:
    """The same by a genetic algorithm (Sim2023), within a factor about the closed forms."""
    low, high = equation.nominal.bounds(equation.longest)
    about = np.stack(list(starts(equation, values, fitted)))
    scales = np.array([k in (SPP, SVP, SVI) for k in range(len(values))])
    low = np.where(scales, np.maximum(about.min(axis=0) / _BEYOND, low), low)
    high = np.where(scales, np.minimum(about.max(axis=0) * _BEYOND, high), high)
    high[FA] = _BEYOND * equation.steepest

    def cost(x: Floats) -> Floats:
        tried = np.tile(values, (len(x), 1))
        tried[:, fitted] = x
        return equation.rmse(tried)

    found = minimise(cost, low[fitted], high[fitted], settings, start=about[:, fitted])
    best = values.copy()
    best[fitted] = found.x
    return ServoOptimum(values=best, fitted=fitted, error=found.cost, evaluations=found.evaluations)


IMPROVEMENT = 0.05
"""Least relative decrease of the squared error by which another term is kept [1]."""
MATTERS = 0.005
"""Least share of the command that another term explains [1]."""
CLOCK = 1e-4
"""Relative error of a recorder's clock, and with it of every gain [1]."""
GREATEST_UNSEEN = 0.1
"""Greatest end of its interval up to which a feed-forward that is not fitted counts as 0 [1]."""


def always_fitted(nominal: law.Nominal) -> Bools:
    """Terms of every servo of this list; shape (D,)."""
    fitted = np.zeros(len(TERMS), bool)
    fitted[[SPP, SVP, TX, TV, law.TS]] = True
    fitted[[SVI, TH]] = nominal.integral is True
    return fitted


def optional_terms(nominal: law.Nominal) -> list[tuple[int, ...]]:
    """Terms that are fitted where they improve the fit: the list does not name them."""
    found: list[tuple[int, ...]] = [(SVI, TH)] if nominal.integral is None else []
    for k in (FV, FA):
        if TERMS[k] in nominal.unnamed:
            found.append((k,))
    return found


def selected_servo(equation: law.ServoEquation) -> ServoOptimum:
    """Least squares with the terms that improve the fit, added one after the other."""
    values, fitted = equation.nominal.fixed, always_fitted(equation.nominal)
    best = least_squares_servo(equation, values, fitted)
    candidates = optional_terms(equation.nominal)
    while candidates:
        tried = [_with(equation, values, best, terms) for terms in candidates]
        k = int(np.argmin([one.error for one in tried]))
        gain = best.error**2 - tried[k].error ** 2
        if not gain > max(IMPROVEMENT * best.error**2, (MATTERS * equation.spread) ** 2):
            break
        best = tried[k]
        del candidates[k]
    return best


def _with(
    equation: law.ServoEquation, values: Floats, best: ServoOptimum, terms: tuple[int, ...]
) -> ServoOptimum:
    fitted, begin = best.fitted.copy(), values.copy()
    fitted[list(terms)] = True
    if SVI in terms:
        begin[SVI] = 1.0
    found = least_squares_servo(equation, begin, fitted)
    return replace(found, evaluations=found.evaluations + best.evaluations)


def servo_uncertainty(
    equation: law.ServoEquation, slower: law.ServoEquation, optimum: ServoOptimum
) -> Uncertainty:
    """Uncertainty of an optimum: clustered 95 % intervals and the change at half the bandwidth.

    Half widths are of all D terms, infinite where not fitted; the rest is of the S fitted ones.

    ``slower`` has the same recordings below half the bandwidth; sampling and filters of a servo
    that the equation leaves out move the optimum from the one to the other.
    """
    # parameters at a bound count too: a lag of 0 has an interval like any other
    inside = optimum.fitted
    slopes = equation.jacobian(optimum.values, inside)
    residuals = equation.columns @ equation.factors(optimum.values)
    blocks = block_numbers(residuals, equation.stretch, int(inside.sum()))
    uncertainty = uncertainty_of(slopes, residuals, blocks)
    again = least_squares_servo(slower, optimum.values, optimum.fitted)
    half = np.full(len(TERMS), np.inf)
    half[inside] = uncertainty.half_width + np.abs(again.values - optimum.values)[inside]
    half[inside] += CLOCK * np.abs(optimum.values[inside])
    return replace(uncertainty, half_width=half)


def greatest_unseen(
    equation: law.ServoEquation, slower: law.ServoEquation, best: ServoOptimum, term: int
) -> float | None:
    """Upper bound of a feed-forward that is not fitted; None where that is no bound."""
    fitted = best.fitted.copy()
    fitted[term] = True
    tried = least_squares_servo(equation, best.values, fitted, best.values)
    half = servo_uncertainty(equation, slower, tried).half_width[term]
    most = float(tried.values[term] + half) if np.isfinite(half) else np.inf
    return most if most <= GREATEST_UNSEEN * (1.0 if term == FV else equation.steepest) else None


FITTED = "the servo's own equation on recorded reference, position and command"
LISTED = "as conf/machine/ has it; these records do not tell it better"
WITHOUT = "not determined by these records; the twin goes without"
LOOSE = "not determined by these records; the twin uses the best value all the same"
HALVINGS = 4
"""Bandwidths that are tried, each half of the one before [1]."""
SAME = 0.01
"""Relative difference up to which two loop gains are one [1]."""
AT_BOUND = 1e-3
"""Share of a bound within which a term is at it [1]."""
SHORTEST = 1e-7
"""Lags below are none [s]."""
NONE_SEEN = "the records want none"
SHOWN = TERMS[:TH]


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoFit(AxisFit):
    """Servo identified from records; scale factors are gains in SI where its list names none."""

    names: tuple[str, ...] = SHOWN
    servo: ServoParameters | None
    """Servo with all parameters; None where a gain is neither determined nor listed."""
    reason: str = ""
    """Reason why there is no servo, in one sentence."""
    left_out: tuple[str, ...] = ()
    """Recordings of another list of gains than the first's: another servo."""


def identify_servo(
    recordings: Sequence[Recording], axis: str, settings: DriveFitSettings
) -> ServoFit:
    """Servo of ``axis`` from its commanded and measured position, or the reason for none."""
    records, constants, unit, others = law.servo_records(recordings, axis)
    nominal = law.Nominal.of(constants)
    if not records:
        return _without(nominal, unit, f"no training recording of axis {axis} has commanded "
                        "position, measured position and command: record all three")  # fmt: skip
    alone = loop_gain(records, settings.widest)
    bandwidth = settings.bandwidth_Hz or law.servo_bandwidth(records)
    fits: list[ServoFit] = []
    try:
        for k in range(1 if settings.bandwidth_Hz else HALVINGS):
            fits.append(
                _at_bandwidth(records, nominal, constants, unit, bandwidth / 2**k, settings)
            )
            if alone is None or not _contradicts(fits[-1], nominal, alone):
                return replace(_beside(fits[-1], nominal, alone), left_out=tuple(others))
    except ValueError as error:  # too short for as narrow a filter
        if not fits:
            return _without(nominal, unit, f"axis {axis}: {error}")
    return replace(_beside(fits[0], nominal, alone), left_out=tuple(others))


def _contradicts(fit: ServoFit, nominal: law.Nominal, alone: LoopGain) -> bool:
    """Whether speed over following error is another by the equation than by positions alone.

    At high bandwidths the encoder's steps are as large as what the loops answer.  Without an
    integral friction takes a share of the speed, and the two differ by it.  A feed-forward that is
    not determined is fitted in the gain's stead.
    """
    if not (fit.determined[SPP] and alone.determined and fit.values[SVI] > 0):
        return False
    if fit.how[FV] == LOOSE:
        return True
    gain = fit.values[SPP] * nominal.position_gain
    left = 1 - fit.values[FV]
    half = (fit.high[SPP] - fit.values[SPP]) / fit.values[SPP]
    if np.isfinite(fit.high[FV] - fit.values[FV]):
        half += (fit.high[FV] - fit.values[FV]) / max(left, SAME)
    away = abs(gain - left * alone.value) / gain
    return bool(away > SAME + half + (alone.high - alone.low) / alone.value)


def _beside(fit: ServoFit, nominal: law.Nominal, alone: LoopGain | None) -> ServoFit:
    """The loops without what positions alone speak against."""
    if alone is None:
        return fit
    if alone.decays and not nominal.named(TERMS[FV]):
        return _refused(fit, nominal, (SPP,), DECAYS, GAIN_LISTED)
    if _contradicts(fit, nominal, alone):
        how = f"not determined: by positions alone the loop gain is {alone.value:.4g} 1/s"
        return _refused(fit, nominal, law.SCALES, how, law.REMEDY[TERMS[SPP]])
    return fit


def _refused(
    fit: ServoFit, nominal: law.Nominal, terms: Sequence[int], how: str, remedy: str
) -> ServoFit:
    """The loops with some terms not determined; without a servo where no list names their gains."""
    determined, whys, remedies = fit.determined.copy(), list(fit.how), list(fit.remedy)
    for k in terms:
        determined[k], whys[k], remedies[k] = False, how, remedy
    lost = not all(nominal.named(TERMS[k]) for k in terms)
    return replace(
        fit, determined=determined, how=tuple(whys), remedy=tuple(remedies),
        servo=None if lost else fit.servo, reason=f"{how}: {remedy}" if lost else fit.reason,
    )  # fmt: skip


def _at_bandwidth(
    records: Sequence[law.ServoRecord],
    nominal: law.Nominal,
    constants: AxisConstants,
    unit: str,
    bandwidth: float,
    settings: DriveFitSettings,
) -> ServoFit:
    """Servo from its equation below ``bandwidth`` [Hz]."""
    equation, slower = (law.servo_equation(records, nominal, b) for b in (bandwidth, bandwidth / 2))
    best, uncertainty, determined = _determined(
        equation, slower, selected_servo(equation), settings.widest
    )
    determined &= ~_at_end(equation, best)
    determined &= 100 * best.error <= MISFIT_PERCENT * equation.spread
    slopes = equation.jacobian(best.values, best.fitted)
    length = np.linalg.norm(slopes, axis=0)
    rank = int(np.linalg.matrix_rank(slopes / np.where(length > 0, length, 1.0)))
    methods, best = _methods(equation, best, settings, unit)
    estimated = _estimates(nominal, best, uncertainty, determined)
    estimated = _with_rounding(estimated, nominal, constants, records[0].period)
    estimated = _with_none_seen(estimated, equation, slower, best)
    # the twin needs both loops' gains
    lacking = [k for k in (SPP, SVP) if not estimated.determined[k] and not nominal.named(TERMS[k])]
    names = " and ".join(TERMS[k].removesuffix("_scale") + "_gain" for k in lacking)
    reason = (
        f"the records do not determine {names}: {law.REMEDY['velocity_scale']}, or name {names} in "
        "conf/machine/"
    )
    return ServoFit(
        units=tuple(nominal.unit(n, unit) for n in SHOWN),
        values=estimated.values[:TH], low=estimated.low[:TH], high=estimated.high[:TH],
        determined=estimated.determined[:TH], how=estimated.how[:TH], remedy=estimated.remedy,
        servo=None if lacking else nominal.servo(estimated.values),
        reason=reason if lacking else "", methods=methods, samples=equation.rows,
        bandwidth_Hz=bandwidth, relative_error_percent=100 * best.error / equation.spread,
        condition=uncertainty.condition, rank=rank, correlation=uncertainty.correlation,
        correlated=tuple(t for t, fitted in zip(TERMS, best.fitted, strict=True) if fitted),
    )  # fmt: skip


def _at_end(equation: law.ServoEquation, best: ServoOptimum) -> Bools:
    """Terms that the search stopped at their greatest value, and scales at their least; (D,)."""
    low, high = equation.nominal.bounds(equation.longest)
    scales = np.isin(np.arange(len(TERMS)), law.SCALES)
    ends: Bools = (best.values >= (1 - AT_BOUND) * high) | (
        scales & (best.values <= (1 + AT_BOUND) * low)
    )
    return ends & best.fitted


def _estimates(
    nominal: law.Nominal, best: ServoOptimum, uncertainty: Uncertainty, determined: Bools
) -> Estimates:
    """All terms with their intervals; the lag of the position loop is what its hold leaves."""
    values = best.values.copy()
    values[TX] = max(values[TX] - values[TH], 0.0)
    values[[TX, TV]] = np.where(values[[TX, TV]] < SHORTEST, 0.0, values[[TX, TV]])
    return Estimates(
        names=TERMS, values=values, low=np.maximum(values - uncertainty.half_width, 0.0),
        high=values + uncertainty.half_width, determined=determined,
        how=tuple(
            FITTED if seen else LOOSE if fitted else LISTED if nominal.named(name) else WITHOUT
            for name, seen, fitted in zip(TERMS, determined, best.fitted, strict=True)
        ),
        remedy=tuple(law.REMEDY[name] for name in SHOWN),
    )  # fmt: skip


def _with_rounding(
    estimated: Estimates, nominal: law.Nominal, constants: AxisConstants, period: float
) -> Estimates:
    """Estimates with the contribution of a sampled integral to S_vp.

    Sum and integral of the velocity error differ by half a sample of it, which acts like a part
    S_vi V_i T / 2 of the proportional gain, of a servo's period T between its bounds.
    """
    part = 0.5 * estimated.values[SVI] * nominal.integral_gain / nominal.velocity_gain
    least, most = (part * one for one in law.servo_periods(constants, period))
    values, low, high = estimated.values.copy(), estimated.low.copy(), estimated.high.copy()
    values[SVP] += 0.5 * (least + most)
    low[SVP], high[SVP] = low[SVP] + least, high[SVP] + most
    return replace(estimated, values=values, low=low, high=high)


def _with_none_seen(
    estimated: Estimates, equation: law.ServoEquation, slower: law.ServoEquation, best: ServoOptimum
) -> Estimates:
    """Estimates with 0 for a feed-forward that was not fitted, where the records would show it."""
    low, high, how = estimated.low.copy(), estimated.high.copy(), list(estimated.how)
    determined = estimated.determined.copy()
    for k in (FV, FA):
        if best.fitted[k] or equation.nominal.named(TERMS[k]):
            continue
        if (most := greatest_unseen(equation, slower, best, k)) is not None:
            determined[k], low[k], high[k], how[k] = True, 0.0, most, NONE_SEEN
    return replace(estimated, low=low, high=high, determined=determined, how=tuple(how))


def _without(nominal: law.Nominal, unit: str, reason: str) -> ServoFit:
    none = np.full(len(SHOWN), np.nan)
    return ServoFit(
        units=tuple(nominal.unit(n, unit) for n in SHOWN), values=none, low=none, high=none,
        determined=np.zeros(len(SHOWN), bool), how=(LISTED,) * len(SHOWN),
        remedy=(reason,) * len(SHOWN), servo=None, reason=reason, correlation=np.empty((0, 0)),
    )  # fmt: skip


def _determined(
    equation: law.ServoEquation, slower: law.ServoEquation, best: ServoOptimum, widest: float
) -> tuple[ServoOptimum, Uncertainty, Bools]:
    """Optimum with the listed value of scales that are not determined, and which are."""
    while True:
        uncertainty = servo_uncertainty(equation, slower, best)
        least = np.zeros(len(TERMS))
        least[[TX, TV]] = equation.period
        bound = widest * np.maximum(np.abs(best.values), least)
        determined: Bools = 2 * uncertainty.half_width <= bound
        open_ = [k for k in law.SCALES if best.fitted[k] and not determined[k]
                 and equation.nominal.named(TERMS[k])]  # fmt: skip
        if not open_:
            return best, uncertainty, determined
        worst = max(open_, key=lambda k: uncertainty.half_width[k] / best.values[k])
        values, fitted = best.values.copy(), best.fitted.copy()
        values[worst], fitted[worst] = 1.0, False
        again = least_squares_servo(equation, values, fitted)
        best = replace(again, evaluations=again.evaluations + best.evaluations)


def _methods(
    equation: law.ServoEquation, best: ServoOptimum, settings: DriveFitSettings, unit: str
) -> tuple[tuple[Method, ...], ServoOptimum]:
    found = {"least_squares": best}
    if settings.compare or settings.method == "genetic":
        found["genetic"] = genetic_servo(equation, best.values, best.fitted, settings.genetic)
    tried = {("servo", name): (one.error, one.evaluations) for name, one in found.items()}
    return compared_methods(tried, settings.method, unit), found[settings.method]
