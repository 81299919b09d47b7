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
Gaussian filter, whose derivatives are theirs.  Intervals are of a jackknife over
ways of motion, within which an error of the equation is the same, with the systematic parts that it
does not show: what is left over and outlasts the filter, dilution by noise of the current, the
class of its sensor, and what a quantity differs by with friction of the motor's bearings and
without.  Without play all samples count.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.drive import Shaft
from pipeline.schema.model import Parameter, significant
from pipeline.submodels.drive import shaft_signals as ends
from pipeline.submodels.drive.estimates import SENSOR
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.drive.shaft_signals import COULOMB, DAMPING, MASS, PLAY, VISCOUS, WIDTH, C
from pipeline.submodels.statistics import jackknife_half_width, student_quantile

ROUNDS = 6
"""Rounds of the fit, which finds the flanks in contact."""
WAYS = 3
"""Speeds of each direction, whose samples are left out in turn."""
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
NO_FLANKS = "not determined: the shaft's force hardly changes its flank"


@dataclass(frozen=True, kw_only=True, eq=False)
class Rounds:
    """A fit, and what it was made of."""

    shared: Floats
    """Factors of the columns that recordings share; shape (7,)."""
    sides: tuple[Floats, ...]
    sure: tuple[Bools, ...]
    """Flank of each recording's samples, and where it is sure."""
    whole: tuple[Floats, Floats]
    """Normal equations (7, 7), (7,)."""
    ways: tuple[Floats, Floats]
    """Part of each phase of motion in the normal equations, (B, 7, 7), (B, 7)."""
    left: float
    """Root mean square of what it leaves over [m]."""
    lasting: float
    """The same of the part that outlasts the filter, an error of the equation [m]."""
    noise: float
    """Sum of squares of its derivative, if it is white before the filter [m^2/s^2]."""
    out: tuple[int, ...]
    """Columns that are left out."""


@dataclass(frozen=True, kw_only=True)
class ShaftFit:
    """Shaft of an axis as fitted."""

    shaft: Shaft
    parameters: dict[str, Parameter]
    """``shaft_stiffness``, ``shaft_damping``, ``backlash``, ``motor_mass``."""


def identify_shaft(
    recordings: Sequence[Recording], axis: str, *, force_constant: float, force_unit: str,
    lead: float | None, widest: float,
) -> ShaftFit | None:  # fmt: skip
    """Shaft of ``axis``; None where no recording shows both of its ends.

    ``lead`` is that of the screw [m], ``widest`` the greatest half width of a determined interval,
    as a share.
    """
    shown = [ends.signals_of(one, axis, force_constant, lead) for one in recordings
             if axis in one.shafts]  # fmt: skip
    shown = [one for one in shown if one.good.sum() > 10 * (7 + one.nuisance.shape[1])]
    if not shown:
        return None
    found, shown = _fitted(shown)
    used = np.concatenate(found.sides)[np.concatenate(found.sure)]
    play = len(used) > 0 and min((used > 0).mean(), (used < 0).mean()) >= FLANKS
    backlash = _backlash(found, why="" if play else NO_FLANKS)
    if not play or not found.shared[PLAY] > _half(found, lambda f: f[..., PLAY]):
        # no play that shows: the flank does not matter, and all samples count
        found = _rounds(shown, found.shared, (*found.out, PLAY))
    twist = np.concatenate([one.twist[ok] for one, ok in zip(shown, found.sure, strict=True)])
    shaft = Shaft(
        factors=tuple(map(significant, found.shared.tolist())), lead=lead, samples=len(twist),
        twist_um=significant(1e6 * float(twist.std())), left_um=significant(1e6 * found.left),
    )  # fmt: skip
    known = _parameters(found, force_unit, widest) | {"backlash": backlash}
    return ShaftFit(shaft=shaft, parameters=known)


def _fitted(shown: Sequence[ends.Signals]) -> tuple[Rounds, list[ends.Signals]]:
    """Best of the fits from all first guesses, with the waves that stand out of what it leaves."""
    # bearings that push are none: their friction stays out where it comes out below 0
    tried = [_rounds(shown, start, out) for start in _starts(shown) for out in ((COULOMB,), ())]
    best = min((one for one in tried if one.shared[COULOMB] >= 0), key=lambda one: one.left)
    waved = ends.with_waves(shown, best.sides, best.sure)
    free = _rounds(waved, best.shared, ())
    best = free if free.shared[COULOMB] >= 0 else _rounds(waved, best.shared, (COULOMB,))
    return best, waved


def _starts(shown: Sequence[ends.Signals]) -> list[Floats]:
    """First guesses: shares of all that the force moves are the motor's; each of shape (7,)."""
    moving = np.concatenate([one.columns[one.good] for one in shown])
    inside = [MASS, VISCOUS, COULOMB]
    found = np.linalg.lstsq(moving[:, inside], -moving[:, C], rcond=None)[0]
    return [np.array([1.0, share * found[0], *np.zeros(5)]) for share in SHARES]


def _rounds(shown: Sequence[ends.Signals], shared: Floats, out: tuple[int, ...]) -> Rounds:
    """Fit from a guess of the motor's mass, which fixes the flanks; without columns ``out``."""
    for _ in range(ROUNDS):
        sides, sure = zip(*(ends.flanks(one, shared) for one in shown), strict=True)
        if PLAY in out:
            sure = tuple(one.good for one in shown)
        whole, ways = _blocks(shown, sides, sure)
        shared = _solution(*whole, out)
    left = [ends.left_over(*one) for one in zip(shown, sides, sure, strict=True)]
    count = max(sum(part.size for part in left), 1)
    enough = count > 10 * len(shared) and whole[0].any()
    rms = float(np.sqrt(sum(float(part @ part) for part in left) / count)) if enough else np.inf
    return Rounds(
        shared=shared, sides=sides, sure=sure, whole=whole, ways=ways, out=out,
        left=rms, lasting=rms * ends.lasting(shown, left, sure) ** 0.5 if enough else np.inf,
        noise=sum(float(part @ part) / (2 * (WIDTH * one.period) ** 2)
                  for one, part in zip(shown, left, strict=True)),
    )  # fmt: skip


def _blocks(
    shown: Sequence[ends.Signals], sides: Sequence[Floats], sure: Sequence[Bools]
) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Normal equations (7, 7), (7,), and the part of each of B phases of motion in them.

    Each recording's own errors are removed, refitted without a phase.
    """
    found: list[tuple[Floats, Floats]] = []
    gram, product = np.zeros((7, 7)), np.zeros(7)
    for one, side, ok in zip(shown, sides, sure, strict=True):
        rows = np.flatnonzero(ok)
        columns = np.concatenate([ends.table(one, side), one.twist[:, np.newaxis]], axis=1)[rows]
        if len(rows) < 2 * columns.shape[1]:
            continue
        own, _ = np.linalg.qr(columns[:, 7:-1])
        kept = columns[:, [*range(7), -1]]
        kept = kept - own @ (own.T @ kept)
        gram, product = gram + kept[:, :7].T @ kept[:, :7], product + kept[:, :7].T @ kept[:, 7]
        found += [_taken(kept[way], own[way]) for way in _ways(one.speed[rows])]
    found = found or [(np.zeros((7, 7)), np.zeros(7))]
    grams, products = zip(*found, strict=True)
    return (gram, product), (np.array(grams), np.array(products))


def _taken(kept: Floats, own: Floats) -> tuple[Floats, Floats]:
    """Part of left-out rows in the normal equations, a recording's own errors refitted.

    ``own`` is orthonormal over all rows, and ``kept`` orthogonal to it: K' (1 - Q Q')^-1 K.
    """
    shared = own.T @ kept
    lost = shared.T @ np.linalg.lstsq(np.eye(own.shape[1]) - own.T @ own, shared, rcond=1e-9)[0]
    both = kept.T @ kept + lost
    return both[:7, :7], both[:7, 7]


def _ways(speed: Floats) -> list[Ints]:
    """Samples of each phase of motion: both directions, each slow, medium and fast."""
    found: list[Ints] = []
    for rows in (np.flatnonzero(speed > 0), np.flatnonzero(speed < 0)):
        found += np.array_split(rows[np.argsort(np.abs(speed[rows]))], WAYS)
    return [rows for rows in found if len(rows)]


def _solution(gram: Floats, product: Floats, out: tuple[int, ...]) -> Floats:
    """Least squares of normal equations, each column scaled to length one; 0 for those left out."""
    gram, product = gram.copy(), product.copy()
    gram[out, :] = gram[:, out] = product[[*out]] = 0.0
    scale = np.sqrt(np.diag(gram))
    scale = np.where(scale > 0, scale, 1.0)
    found: Floats = np.linalg.lstsq(gram / np.outer(scale, scale), product / scale, rcond=1e-12)[0]
    found = found / scale
    found[[*out]] = 0.0
    return found


def _half(found: Rounds, derived: Callable[[Floats], Floats]) -> float:
    """Half width of the 95 % interval of a quantity of the factors (..., 7).

    Jackknife over the phases of motion, within which the equation's errors are alike.
    """
    # friction that was left out for its sign is as uncertain as any
    out, (whole, sums) = tuple(set(found.out) - {COULOMB}), found.whole
    if len(found.ways[0]) < 2:
        return np.inf
    left = derived(np.array([_solution(whole - g, sums - p, out)
                             for g, p in zip(*found.ways, strict=True)]))  # fmt: skip
    return float(jackknife_half_width(left))


def _doubt(found: Rounds, derived: Callable[[Floats], Floats]) -> float:
    """Difference of a quantity with friction of the motor's bearings and without."""
    out = tuple(set(found.out) - {COULOMB})
    ends = derived(np.array([_solution(*found.whole, one) for one in (out, (*out, COULOMB))]))
    return float(abs(ends[1] - ends[0]))


def _own(found: Rounds, column: int) -> float:
    """Sum of squares of what the other columns do not explain of a column."""
    gram = found.whole[0]
    others = [k for k in range(7) if k not in (*found.out, column)]
    cross, inside = gram[column, others], gram[np.ix_(others, others)]
    scale = np.sqrt(np.where(np.diag(inside) > 0, np.diag(inside), 1.0))
    scaled = np.linalg.lstsq(inside / np.outer(scale, scale), cross / scale, rcond=1e-12)[0]
    return max(float(gram[column, column] - (cross / scale) @ scaled), 0.0)


def _dilution(found: Rounds, column: int) -> float:
    """Share by which noise may lessen a factor [1], were all that is left over noise of its column.

    Regression dilution (Fuller, Measurement error models, 1987): noise of the column over what the
    other columns do not explain of it.
    """
    own, count = _own(found, column), sum(int(ok.sum()) for ok in found.sure)
    noise = found.noise if column == DAMPING else count * (found.left / found.shared[C]) ** 2
    return float(noise / own) if own > noise else np.inf


def _diluted_play(found: Rounds) -> float:
    """Change of the play when the compliance is raised by its dilution [m]."""
    gram, product = found.whole
    raised = found.shared[C] * (1 + _dilution(found, C))
    if not np.isfinite(raised):
        return np.inf
    again = _solution(gram, product - gram[:, C] * raised, (*found.out, C))
    return float(again[PLAY] - found.shared[PLAY])


def _misfit(found: Rounds, column: int) -> float:
    """Half width of a factor's 95 % interval, were errors that outlast the filter the equation's.

    Such an error goes with the phase of motion and does not average over samples: there are as many
    independent ones as phases.  The damping acts over a few periods of the resonance, which do not
    outlast the filter: of it, the whole residual may be.
    """
    own, count = _own(found, column), sum(int(ok.sum()) for ok in found.sure)
    ways, left = len(found.ways[0]), found.left if column == DAMPING else found.lasting
    if own <= 0 or ways < 2:
        return np.inf
    return float(student_quantile(ways - 1) * left * np.sqrt(count / own / ways))


def _parameters(found: Rounds, unit: str, widest: float) -> dict[str, Parameter]:
    """Parameters but the play; of a stiff shaft the least stiffness that it has."""
    shared = found.shared
    mass = "kg" if unit == "N" else f"{unit} s^2/m"
    quantities: dict[str, tuple[Callable[[Floats], Floats], str, str]] = {
        "shaft_stiffness": (lambda f: 1 / f[..., C], f"{unit}/m", REVERSALS),
        "shaft_damping": (lambda f: f[..., DAMPING] / f[..., C], f"{unit} s/m", SWEPT),
        "motor_mass": (lambda f: f[..., MASS] / f[..., C], mass, SWEPT),
    }
    compliance = _half(found, lambda f: f[..., C])
    stiff = not shared[C] > compliance / (2 * widest)
    least = shared[C] + compliance
    said = {}
    for name, (derived, of, remedy) in quantities.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            value = float(derived(shared))
            noisy = (C, DAMPING) if name == "shaft_damping" else (C,)
            diluted = [_dilution(found, column) * value for column in noisy]
            missed = [_misfit(found, k) / shared[k] * value for k in noisy]
            parts = [_half(found, derived), _doubt(found, derived), SENSOR * value]
            reach = float(np.linalg.norm([*parts, *diluted, *missed]))
        why = ""
        if stiff:
            why = "not determined: both ends move together within what the records can tell"
            if name == "shaft_stiffness" and np.isfinite(least) and least > 0:
                why = f"not determined, at least {1 / least:.3g} {of}"
        elif not np.isfinite(reach) or reach > widest * abs(value) or value <= 0:
            why = f"not determined: 95 % interval {value:.3g} ± {reach:.2g} {of}"
        said[name] = _parameter(value, reach, of, why, remedy)
    return said


def _backlash(found: Rounds, why: str) -> Parameter:
    def play(factors: Floats) -> Floats:
        return np.asarray(factors[..., PLAY])

    parts = [_half(found, play), _diluted_play(found), _misfit(found, PLAY)]
    # a flank and the friction of the bearings are one but where an axis brakes: no matter of chance
    reach = float(np.linalg.norm(parts)) + _doubt(found, play)
    if not why and not np.isfinite(reach):
        why = "not determined: too few ways of motion for an interval"
    return _parameter(found.shared[PLAY], reach, "m", why, REVERSALS, least=0.0)


def _parameter(
    value: float, reach: float, unit: str, why: str, remedy: str, least: float | None = None
) -> Parameter:
    value = float(value)
    if least is not None and value < least:
        # beyond what can be: as much as that, at least, the records err
        reach, value = float(np.hypot(reach, least - value)), least
    low = value - reach if least is None else max(value - reach, least)
    return Parameter.estimated(
        value, low, value + reach, unit, method=why or HOW, remedy=remedy, determined=not why
    )
