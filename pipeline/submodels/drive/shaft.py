"""Shaft of a drive: stiffness, damping, play and the motor's mass, from both of its ends.

The motor's equation k A = M_m x_m'' + B x_m' + F_c sgn x_m' + F holds whatever the carriage does,
with the shaft's force F = K (d - b/2 sgn F) + D d' in contact, d = x_m - x_c.  Solved for what both
encoders differ by, with C = 1 / K,

d = C (k A - M_m x_m'' - B x_m' - F_c sgn x_m') - C D d' + b/2 sgn F + e(x_c, t),

it is linear in C, C M_m, C B, C F_c, C D and b, and well posed for a stiff shaft, whose C is 0
within its interval.  The play's flank sgn F is not the direction of motion: an axis that brakes
harder than its friction hangs on the other one.  It follows from the fit and is found in rounds;
samples near its change, and near standstill, are left out.  e is what encoders and screw err by: of
each recording a constant, a straight line over position and one over time, and waves once a turn
where the lead is known.  A lag of the command is fitted with it.  All signals pass the same
Gaussian filter, whose derivatives are theirs.  Intervals are of the jackknife over stretches of
time, and forces are no more certain than the sensor of the current.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.stats import t as student

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.mechanics.estimates import SENSOR
from pipeline.submodels.drive.records import Recording

WIDTH = 1.5
"""Standard deviation of the filter [samples]."""
REACH = 8.0
"""Where the filter ends [standard deviations].  Cut at 4, as is usual, its second derivative has a
sum, which makes of a place of 30 mm at 1 kHz an acceleration of 4 m/s^2."""
ROUNDS = 6
"""Rounds of the fit, which finds the flanks in contact."""
STRETCHES = 8
"""Stretches of each recording that are left out in turn."""
SLOW = 0.01
"""Share of the highest speed below which an axis may stand [1]."""
FLAT = 0.15
"""Share of the shaft's force, as root mean square, near which the flank may change [1]."""
LEFT = 0.05
"""Greatest share of the twist that a fit may leave over [1]: beyond it the intervals, which take
the equation for granted, are not to be believed."""
FLANKS = 0.05
"""Least share of samples on each flank that shows the play [1]."""
HOW = "twist between motor and carriage against the motor's force"
REVERSALS = (
    "record motor position, scale and current at 1 kHz or more while the axis reverses in short "
    "strokes and brakes from rapid"
)
SWEPT = "record a frequency response: both positions and the current under a swept sine"
SHARES = (0.0, 0.25, 0.5, 0.75, 0.9)
"""Shares of the motor in all that moves, from which the fit starts [1]."""
Rounds = tuple[Floats, tuple[Floats, ...], tuple[Bools, ...], Floats, Floats, float]
C, MASS, VISCOUS, COULOMB, DAMPING, LAG, PLAY = range(7)
"""Columns of the fit that recordings share."""


@dataclass(frozen=True, kw_only=True)
class ShaftFit:
    """Shaft of an axis as fitted.

    Parameters
    ----------
    shared : ndarray, shape (7,)
        Factors of the columns that recordings share.
    parameters : dict of str to Parameter
        ``shaft_stiffness``, ``shaft_damping``, ``backlash``, ``motor_mass``.
    samples : int
        That were fitted [1].
    twist_um : float
        Root mean square of the twist that the records show [um].
    left_um : float
        The same of what the fit leaves over [um].
    """

    shared: Floats
    parameters: dict[str, Parameter]
    samples: int
    twist_um: float
    left_um: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """Filtered signals of one recording, T samples.

    Parameters
    ----------
    twist : ndarray, shape (T,)
        Motor's position less the carriage's [m].
    columns : ndarray, shape (T, 7)
        Of the fit, in SI; that of the flank is empty.
    nuisance : ndarray, shape (T, N)
        Columns of what encoders and screw err by.
    speed : ndarray, shape (T,)
        Of the motor [m/s].
    good : ndarray of bool, shape (T,)
        Recorded samples, away from the ends.
    """

    twist: Floats
    columns: Floats
    nuisance: Floats
    speed: Floats
    good: Bools


def signals_of(one: Recording, axis: str, force_constant: float, lead: float | None) -> Signals:
    """Filtered signals of both ends of ``axis`` in a recording.

    Parameters
    ----------
    one : Recording
        That shows both ends.
    axis : str
        Its letter.
    force_constant : float
        k [N/A].
    lead : float or None
        Of the screw [m].
    """
    raw, period = one.shafts[axis], one.period

    def filtered(values: Floats, order: int = 0) -> Floats:
        made: Floats = gaussian_filter1d(
            values, WIDTH, order=order, mode="nearest", truncate=REACH
        )
        return made / period**order

    place = raw["motor"] - raw["motor"].mean()
    twist = raw["motor"] - raw["load"]
    force = force_constant * raw["command"]
    speed = filtered(place, 1)
    x, time = filtered(place), np.linspace(-1, 1, place.size)
    columns = np.zeros((place.size, 7))
    columns[:, C], columns[:, MASS] = filtered(force), -filtered(place, 2)
    columns[:, VISCOUS], columns[:, COULOMB] = -speed, -np.sign(speed)
    columns[:, DAMPING], columns[:, LAG] = -filtered(twist, 1), -filtered(force, 1)
    waves = [] if lead is None else [f(2 * np.pi * raw["motor"] / lead) for f in (np.sin, np.cos)]
    good = one.air & (np.abs(speed) > SLOW * np.abs(speed).max())
    edge = int(np.ceil(REACH * WIDTH))
    good[:edge] = good[-edge:] = False
    return Signals(
        twist=filtered(twist - twist.mean()), columns=columns,
        nuisance=np.stack([np.ones(x.size), x, time, *waves], axis=1), speed=speed, good=good,
    )  # fmt: skip


def shaft_force(one: Signals, shared: Floats) -> Floats:
    """Force of the shaft [N] by the motor's equation, shape (T,), for a C above 0."""
    inside = [C, MASS, VISCOUS, COULOMB]
    return np.asarray(one.columns[:, inside] @ shared[inside] / shared[C])


def flanks(one: Signals, shared: Floats) -> tuple[Floats, Bools]:
    """Flank in contact, -1 or 1, and where it is sure; both of shape (T,)."""
    if shared[C] <= 0:  # no twist that tells it: nothing hangs on the flank
        return np.sign(one.columns[:, C]), one.good
    force = shaft_force(one, shared)
    level = float(np.sqrt(np.mean(force[one.good] ** 2))) if one.good.any() else 0.0
    side, size = np.sign(force), 2 * int(np.ceil(4 * WIDTH)) + 1
    # what the filter mixes must hang on one flank
    pulled = minimum_filter1d(side * np.maximum(np.abs(force) - FLAT * level, 0), size)
    pushed = minimum_filter1d(-side * np.maximum(np.abs(force) - FLAT * level, 0), size)
    return side, one.good & ((pulled > 0) | (pushed > 0))


def identify_shaft(
    recordings: Sequence[Recording], axis: str, *, force_constant: float, force_unit: str,
    lead: float | None, widest: float,
) -> ShaftFit | None:  # fmt: skip
    """Shaft of ``axis``; None where no recording shows both of its ends.

    Parameters
    ----------
    recordings : sequence of Recording
        For training.
    axis : str
        Its letter.
    force_constant : float
        Force for one unit of the command, and ``force_unit``, its unit.
    force_unit : str
        "N", or the command's unit where the constant is 1.
    lead : float or None
        Of the screw [m].
    widest : float
        Greatest half width of a determined interval, as a share.
    """
    shown = [signals_of(one, axis, force_constant, lead) for one in recordings
             if axis in one.shafts]  # fmt: skip
    shown = [one for one in shown if one.good.sum() > 10 * (7 + one.nuisance.shape[1])]
    if not shown:
        return None
    # bearings that push are none: their friction stays out where it comes out below 0
    found = [_rounds(shown, start, out) for start in _starts(shown) for out in ((COULOMB,), ())]
    physical = [one for one in found if one[0][COULOMB] >= 0]
    shared, sides, sure, grams, products, _ = min(physical, key=lambda one: one[-1])
    count = len(grams)
    whole, sums = grams.sum(axis=0), products.sum(axis=0)
    left = np.array([_solution(whole - g, sums - p)
                     for g, p in zip(grams, products, strict=True)])  # fmt: skip
    wide = float(student.ppf(0.975, count - 1)) if count > 1 else np.inf
    used = np.concatenate(sides)[np.concatenate(sure)]
    play = len(used) > 0 and min((used > 0).mean(), (used < 0).mean()) >= FLANKS
    twist = np.concatenate([one.twist[s] for one, s in zip(shown, sure, strict=True)])
    errors = sum(_squares(one, side, ok) for one, side, ok in zip(shown, sides, sure, strict=True))
    over, many = float(np.sqrt(errors / max(len(twist), 1))), float(twist.std())
    said = _parameters(shared, left, wide, force_unit, widest, play=bool(play))
    stiff = not said["shaft_stiffness"].determined
    if over > LEFT * many and not stiff:
        why = (
            f"not determined: the fit leaves {1e6 * over:.2g} of {1e6 * many:.2g} um of twist, "
            f"more than {100 * LEFT:g} %"
        )
        said = {name: replace(p, value=None, interval_95=None, determined=False, method=why,
                              remedy=REVERSALS) for name, p in said.items()}  # fmt: skip
    return ShaftFit(
        shared=shared, parameters=said, samples=len(twist), twist_um=1e6 * many, left_um=1e6 * over
    )  # fmt: skip


def _starts(shown: Sequence[Signals]) -> list[Floats]:
    """First guesses: shares of all that the force moves are the motor's; each of shape (7,)."""
    moving = np.concatenate([one.columns[one.good] for one in shown])
    inside = [MASS, VISCOUS, COULOMB]
    found = np.linalg.lstsq(moving[:, inside], -moving[:, C], rcond=None)[0]
    return [np.array([1.0, share * found[0], *np.zeros(5)]) for share in SHARES]


def _rounds(shown: Sequence[Signals], shared: Floats, out: tuple[int, ...]) -> Rounds:
    """Fit from a first guess of the motor's mass, by which the flanks are known.

    ``out`` are columns that are left out.
    """
    for _ in range(ROUNDS):
        sides, sure = zip(*(flanks(one, shared) for one in shown), strict=True)
        grams, products = _blocks(shown, sides, sure)
        grams[:, out, :] = grams[:, :, out] = products[:, out] = 0.0
        shared = _solution(grams.sum(axis=0), products.sum(axis=0))
        shared[[*out]] = 0.0
    errors = sum(_squares(one, side, ok) for one, side, ok in zip(shown, sides, sure, strict=True))
    count = sum(int(ok.sum()) for ok in sure)
    return shared, sides, sure, grams, products, errors / max(count, 1)


def _squares(one: Signals, side: Floats, ok: Bools) -> float:
    """Sum of squares that a recording's own fit leaves over [m^2]."""
    table = _table(one, side)[ok]
    if not len(table):
        return 0.0
    found = np.linalg.lstsq(table, one.twist[ok], rcond=None)[0]
    return float(((one.twist[ok] - table @ found) ** 2).sum())


def _table(one: Signals, side: Floats) -> Floats:
    columns = one.columns.copy()
    columns[:, PLAY] = side / 2
    return np.concatenate([columns, one.nuisance], axis=1)


def _blocks(
    shown: Sequence[Signals], sides: Sequence[Floats], sure: Sequence[Bools]
) -> tuple[Floats, Floats]:
    """Normal equations (B, 7, 7), (B, 7) of stretches, each recording's own errors taken out."""
    grams, products = [], []
    for one, side, ok in zip(shown, sides, sure, strict=True):
        rows = np.flatnonzero(ok)
        table = np.concatenate([_table(one, side), one.twist[:, np.newaxis]], axis=1)[rows]
        if len(rows) < 2 * table.shape[1]:
            continue
        own, _ = np.linalg.qr(table[:, 7:-1])
        kept = table[:, [*range(7), -1]]
        kept = kept - own @ (own.T @ kept)
        for part in np.array_split(kept, STRETCHES):
            grams.append(part[:, :7].T @ part[:, :7])
            products.append(part[:, :7].T @ part[:, 7])
    if not grams:
        return np.zeros((1, 7, 7)), np.zeros((1, 7))
    return np.array(grams), np.array(products)


def _solution(gram: Floats, product: Floats) -> Floats:
    """Least squares of normal equations, each column scaled to length one."""
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0, scale, 1.0)
    found: Floats = np.linalg.lstsq(gram / np.outer(scale, scale), product / scale, rcond=1e-12)[0]
    return found / scale


def _parameters(
    shared: Floats, left: Floats, wide: float, unit: str, widest: float, *, play: bool
) -> dict[str, Parameter]:
    """Parameters with jackknife intervals; of a stiff shaft the least stiffness that it has."""
    count = len(left)

    def half(values: Floats) -> float:
        return wide * float(np.sqrt((count - 1) / count * ((values - values.mean()) ** 2).sum()))

    with np.errstate(divide="ignore", invalid="ignore"):
        derived = {
            "shaft_stiffness": (1 / shared[C], 1 / left[:, C], f"{unit}/m", REVERSALS),
            "shaft_damping": (
                shared[DAMPING] / shared[C], left[:, DAMPING] / left[:, C], f"{unit} s/m", SWEPT,
            ),
            "motor_mass": (
                shared[MASS] / shared[C], left[:, MASS] / left[:, C],
                "kg" if unit == "N" else f"{unit} s^2/m", SWEPT,
            ),
        }  # fmt: skip
    compliance = half(left[:, C])
    stiff = not shared[C] > compliance / (2 * widest)
    least = shared[C] + compliance
    found = {}
    for name, (value, parts, of, remedy) in derived.items():
        reach = float(np.hypot(half(parts), SENSOR * value))
        why = ""
        if stiff:
            why = "not determined: both ends move together within what the records can tell"
            if name == "shaft_stiffness" and np.isfinite(least) and least > 0:
                why = f"not determined, at least {1 / least:.3g} {of}"
        elif not np.isfinite(reach) or reach > widest * abs(value) or value <= 0:
            why = f"not determined: 95 % interval {value:.3g} ± {reach:.2g} {of}"
        found[name] = _parameter(value, reach, of, why, remedy)
    reach = half(left[:, PLAY])
    why = "" if play else "not determined: the shaft's force hardly changes its flank"
    if not why and not np.isfinite(reach):
        why = "not determined: too few stretches for an interval"
    found["backlash"] = _parameter(shared[PLAY], reach, "m", why, REVERSALS, least=0.0)
    return found


def _parameter(
    value: float, reach: float, unit: str, why: str, remedy: str, least: float | None = None
) -> Parameter:
    known = not why
    value = float(value)
    if least is not None and value < least:
        # beyond what can be: as much as that, at least, the records err
        reach, value = float(np.hypot(reach, least - value)), least
    low, high = value - reach, value + reach
    low = low if least is None else max(low, least)
    return Parameter(
        value=float(f"{value:.5g}") if known else None, unit=unit,
        interval_95=(float(f"{low:.5g}"), float(f"{high:.5g}")) if known else None,
        determined=known, method=HOW if known else why, remedy="" if known else remedy,
    )  # fmt: skip
