"""Named parameters of a feed drive with 95 % intervals, from a vector of the inverse dynamics.

Motion shows two Coulomb levels, F_c+ + F_g and F_c- - F_g, of three unknowns (gravity split).  What
is declared of the axis decides (``coulomb`` in conf/machine/): with equal Coulomb friction in both
directions the difference of the levels is twice the constant force; without a constant force each
level is Coulomb friction.  "auto" takes the first where the levels differ by more than ``GRAVITY``
of their mean, or one is negative, which friction alone does not explain, and the second otherwise.
"Equal" is meant within ``ALIKE``, the usual difference on horizontal axes of one machine; where
"auto" decides, within the relative difference of viscous friction, if that is more.  Coulomb
friction and constant force are uncertain by as much.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import Method
from pipeline.submodels.drive.inverse_dynamics import DIRECTIONS, Dynamics
from pipeline.submodels.drive.records import Coulomb
from pipeline.submodels.statistics import Factor

GRAVITY = 0.5
"""Relative difference of the Coulomb levels above which a constant force explains it [1]."""
ALIKE = 0.05
"""Relative difference of Coulomb friction in both directions that counts as equal [1]."""
EQUAL = "Coulomb friction taken as alike both ways"
GIVEN = f"{EQUAL}, as conf/machine/ says"
SHOWN = f"{EQUAL}: the levels differ by more than friction does"
UNEQUAL = "taken as 0: motion cannot tell it from Coulomb friction that differs both ways"


@dataclass(frozen=True, kw_only=True)
class GravitySplit:
    """Split of the Coulomb levels into Coulomb friction and constant force."""

    equal: bool
    """Whether Coulomb friction is taken as equal in both directions."""
    reason: str
    """Why."""
    unequal_share: float = 0.0
    """Relative difference of Coulomb friction that remains possible [1]."""


def gravity_split(fit: Dynamics, coulomb: Coulomb) -> GravitySplit:
    """Split of the Coulomb levels of ``fit``."""
    positive, negative = (fit.value(f"coulomb_level_{one}") for one in DIRECTIONS)
    if not all(fit.is_fitted(f"coulomb_level_{one}") for one in DIRECTIONS):
        return GravitySplit(equal=False, reason="only one direction was recorded")
    if coulomb == "equal":
        return GravitySplit(equal=True, reason=GIVEN, unequal_share=ALIKE)
    mean = 0.5 * (positive + negative)
    impossible = min(positive, negative) < 0
    if impossible or (coulomb == "auto" and abs(positive - negative) > GRAVITY * mean):
        up, down = (fit.value(f"viscous_{one}") for one in DIRECTIONS)
        share = abs(up - down) / (up + down) if up + down > 0 else 0.0
        return GravitySplit(equal=True, reason=SHOWN, unequal_share=max(share, ALIKE))
    return GravitySplit(equal=False, reason=UNEQUAL)


def coulomb_and_offset(fit: Dynamics, split: GravitySplit) -> tuple[float, float, float]:
    """F_c+, F_c- and F_g [N]."""
    positive, negative = (fit.value(f"coulomb_level_{one}") for one in DIRECTIONS)
    if split.equal:
        mean = 0.5 * (positive + negative)
        return mean, mean, 0.5 * (positive - negative)
    return positive, negative, 0.0


NAMES = (
    "mass", "coulomb_positive", "coulomb_negative", "static_positive", "static_negative",
    "stribeck_velocity_positive", "stribeck_velocity_negative", "viscous_positive",
    "viscous_negative", "offset",
)  # fmt: skip
"""The D parameters in their order."""
SENSOR = 0.01
"""Relative error of a recorded current as a whole [1] (a sensor of class 1, and ripple between its
samples): no force is more certain, whatever the residuals."""
DEFAULT_VELOCITY = 0.005
"""Stribeck velocity [m/s] where static equals Coulomb friction, so that it is irrelevant."""
FITTED = "bounded robust least squares on motion and force through one filter"
GENETIC = "genetic algorithm on motion and force through one filter"
INSTRUMENTAL = "instrumental variables: the reference's motion in place of the noisy measured one"
SAME = "not determined; static friction is taken as Coulomb friction"
LEFT = "not determined by these recordings; the twin uses the best value all the same"

IMPOSSIBLE = "not determined: no drive has such a value; the twin uses the best value all the same"
MISFIT_PERCENT = 70.0
"""Force that the model leaves over, of what was measured, from which nothing is determined [%]: it
explains less than half of the mean square."""
UNEXPLAINED = "not determined: the model leaves {:.3g} % of the force over"
OPPOSED = -0.5
"""Correlation of force with motion below which one of the two has the wrong sign [1]."""
REVERSED = (
    "the force falls as the {} rises (correlation {:.2f}), so that one of them has the wrong sign: "
    "set factor: -1 at the command's column in conf/machine/, or at that of the position"
)
BY_SIGN = "not determined: force and motion have opposite signs"

_SLOW = (
    "record strokes of constant speed from a tenth of the Stribeck velocity (0.1 to 1 mm/s) "
    "upward, each as long as a turn of the screw or more"
)
BY_LOAD = "a recorded load against the command that carries it"
LOAD_FACTOR = "force of the motor for one unit of the recorded load"
REMEDY = {
    "mass": "record strokes that reverse with strong acceleration, in air, at 1 kHz",
    "coulomb": "record strokes of constant speed at ten speeds in both directions, in air",
    "static": _SLOW,
    "stribeck_velocity": _SLOW,
    "viscous": "record strokes of constant speed from slow to rapid in both directions, in air",
    "offset": "say in conf/machine/ (coulomb: equal) that Coulomb friction is alike both ways, "
    "where it is; no motion tells it",
    "load": "record a slow feed while a load of at least the friction's size comes and goes",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimates:
    """Named parameters of a part of an axis, D of them."""

    names: tuple[str, ...]
    """Names of a feed drive :data:`NAMES`, then ``force_constant`` or ``load_factor`` where a load
    determines it."""
    values: Floats
    low: Floats
    high: Floats
    """Values, 95 % intervals [SI, force in the fit's unit]; NaN if undetermined; shape (D,)."""
    determined: Bools
    """Whether the recordings determine it; shape (D,)."""
    how: tuple[str, ...]
    remedy: tuple[str, ...]
    """Source of each value, and the record that would determine it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisFit(Estimates):
    """Parameters of a part of an axis, and how well they explain the recordings."""

    units: tuple[str, ...]
    """Units of the parameters."""
    methods: tuple[Method, ...] = ()
    """Each method that was tried."""
    samples: int = 0
    """Rows that were fitted."""
    relative_error_percent: float = np.nan
    """Error of what is modelled, over what was measured on those rows [%]."""
    bandwidth_Hz: float = np.nan
    """Bandwidth of the comparison of model and recording [Hz]; nan for unfiltered ones."""
    condition: float = np.nan
    rank: int = 0
    """Condition number and rank of the Jacobian with columns scaled to length one."""
    correlated: tuple[str, ...] = ()
    """Names of the S parameters that were fitted."""
    correlation: Floats
    """Correlation of these; shape (S, S)."""


def compared_methods(
    tried: Mapping[tuple[str, str], tuple[float, int]], chosen: str, unit: str
) -> tuple[Method, ...]:
    """Methods by task and name, each with its error in ``unit`` and its evaluations."""
    return tuple(
        Method(
            task=task, method=method, chosen=method == chosen, error=error, error_unit=unit,
            evaluations=evaluations,
        )
        for (task, method), (error, evaluations) in tried.items()
    )  # fmt: skip


def units(force_unit: str, names: Sequence[str], command_unit: str) -> tuple[str, ...]:
    """Unit of each parameter where forces are in ``force_unit``."""
    of_kind = {
        "mass": "kg" if force_unit == "N" else f"{force_unit} s^2/m",
        "stribeck_velocity": "m/s",
        "viscous": f"{force_unit} s/m",
        "force_constant": f"N/{command_unit}",
        "load_factor": "1" if force_unit == "N" else f"{force_unit}/N",
    }
    return tuple(of_kind.get(_kind(name), force_unit) for name in names)


def physical(fit: Dynamics, split: GravitySplit) -> Floats:
    """Values of the D parameters; a direction that was not recorded has those of the other."""
    *coulomb, offset = coulomb_and_offset(fit, split)
    # Coulomb and static friction, Stribeck velocity and viscous friction of both directions
    table = np.empty((4, 2))
    for k, direction in enumerate(DIRECTIONS):
        amplitude, velocity = 0.0, DEFAULT_VELOCITY
        if fit.is_fitted(f"stribeck_amplitude_{direction}"):
            amplitude = fit.value(f"stribeck_amplitude_{direction}")
            velocity = float(np.exp(fit.value(f"log_velocity_{direction}")))
        viscous = fit.value(f"viscous_{direction}")
        table[:, k] = coulomb[k], coulomb[k] + amplitude, velocity, viscous
    for k, direction in enumerate(DIRECTIONS):
        if not fit.is_fitted(f"coulomb_level_{direction}"):
            table[:, k] = table[:, 1 - k]
    return np.array([fit.value("mass"), *table.ravel(), offset])


def estimates(
    fit: Dynamics,
    half_width: Floats,
    correlation: Floats,
    others: Sequence[Dynamics],
    split: GravitySplit,
    *,
    widest: float,
    how: str,
) -> Estimates:
    """Parameters with intervals.

    Half widths, shape (S,), and correlation, shape (S, S), are those of the fitted parameters; what
    ``others``, fits at other bandwidths, differ by widens the intervals. Beyond ``widest``, a
    relative half width [1], nothing is determined; ``how`` says where fitted values come from.
    """
    values = physical(fit, split)
    slopes = _slopes(lambda one: physical(one, split), fit)
    spread = np.outer(half_width, half_width) * correlation
    variance = np.einsum("is,st,it->i", slopes, np.where(np.isfinite(spread), spread, 0), slopes)
    blind = (slopes != 0) @ ~np.isfinite(half_width)
    half = np.where(blind > 0, np.inf, np.sqrt(np.maximum(variance, 0)))
    for one in others:
        half = np.hypot(half, np.abs(physical(one, split) - values))
    forces = ~np.char.startswith(NAMES, "stribeck")
    half[forces] = np.hypot(half[forces], SENSOR * np.abs(values[forces]))
    coulomb = 0.5 * (values[1] + values[2])
    unequal = np.isin(NAMES, ("coulomb_positive", "coulomb_negative", "static_positive",
                              "static_negative", "offset"))  # fmt: skip
    half[unequal] = np.hypot(half[unequal], split.unequal_share * coulomb)
    scale = np.abs(values)
    scale[-1] = max(scale[-1], abs(coulomb))  # an offset may well be 0
    determined: Bools = (half <= widest * scale) & (scale > 0)
    determined &= np.array([_components_fitted(fit, name, split) for name in NAMES])
    possible = (values > 0) | (np.array(NAMES) == "offset")
    possible[0] &= not fit.at_bound("mass")
    determined &= possible
    low, high = values - half, values + half
    for k in (5, 6):  # fitted on a logarithmic scale
        factor = np.exp(half[k] / max(values[k], 1e-300)) if np.isfinite(half[k]) else np.inf
        low[k], high[k] = values[k] / factor, values[k] * factor
    low[:-1] = np.minimum(np.maximum(low[:-1], 0.0), high[:-1])
    return Estimates(
        names=NAMES, values=values, low=low, high=high, determined=determined,
        how=tuple(
            _how(name, known, split, how) if can or not np.isfinite(value) else IMPOSSIBLE
            for name, value, known, can in zip(NAMES, values, determined, possible, strict=True)
        ),
        remedy=tuple(REMEDY[_kind(name)] for name in NAMES),
    )  # fmt: skip


def with_misfit(estimated: Estimates, error_percent: float) -> Estimates:
    """Estimates of a drive, none determined where the RMS residual of the force [%] is large."""
    if not error_percent > MISFIT_PERCENT:
        return estimated
    return _undetermined(estimated, UNEXPLAINED.format(error_percent), estimated.remedy)


def with_signs(
    estimated: Estimates, acceleration: Floats, speed: Floats, force: Floats
) -> Estimates:
    """Estimates of a drive, none determined where the force opposes the motion that it makes.

    A motor's force rises with the acceleration and with the direction of the motion, since friction
    takes energy; a constant force has no part in a correlation.  ``acceleration``, ``speed``,
    ``force`` (N,) are those of the rows.
    """
    found = {"acceleration": _correlation(acceleration, force),
             "speed": _correlation(np.sign(speed), force)}  # fmt: skip
    name = min(found, key=lambda one: found[one])
    if found[name] > OPPOSED or max(found.values()) > -OPPOSED:
        return estimated
    words = REVERSED.format(name, found[name])
    return _undetermined(estimated, BY_SIGN, (words,) * len(estimated.names))


def _correlation(x: Floats, y: Floats) -> float:
    return float(np.corrcoef(x, y)[0, 1]) if np.ptp(x) > 0 and np.ptp(y) > 0 else 0.0


def _undetermined(estimated: Estimates, how: str, remedy: tuple[str, ...]) -> Estimates:
    many = len(estimated.names)
    return replace(estimated, determined=np.zeros(many, bool), how=(how,) * many, remedy=remedy)


def with_load(
    estimated: Estimates, constant: Factor | None, factor: Factor | None, widest: float
) -> Estimates:
    """Estimates with a load's force constant, whose uncertainty all forces share, or load factor.

    ``constant`` is the force constant by the load [N/A]; ``factor`` is that of the channel of the
    load, where the force constant was known.
    """
    if constant is not None:
        share = constant.half_width / constant.value
        forces = ~np.char.startswith(estimated.names, "stribeck")
        more = np.where(forces, np.abs(estimated.values) * share, 0.0)
        low = estimated.values - np.hypot(estimated.values - estimated.low, more)
        high = estimated.values + np.hypot(estimated.high - estimated.values, more)
        estimated = replace(estimated, low=low, high=high)
    for name, one, how in (
        ("force_constant", constant, BY_LOAD), ("load_factor", factor, LOAD_FACTOR),
    ):  # fmt: skip
        if one is None:
            continue
        estimated = replace(
            estimated, names=(*estimated.names, name), values=np.r_[estimated.values, one.value],
            low=np.r_[estimated.low, one.value - one.half_width],
            high=np.r_[estimated.high, one.value + one.half_width],
            determined=np.r_[estimated.determined, one.is_determined(widest)],
            how=(*estimated.how, how), remedy=(*estimated.remedy, REMEDY["load"]),
        )  # fmt: skip
    return estimated


def _slopes(function: Callable[[Dynamics], Floats], found: Dynamics) -> Floats:
    """Derivatives by the parameters that were fitted; shape (D, S)."""
    columns = []
    for k in np.flatnonzero(found.fitted):
        step = np.zeros(len(found.values))
        step[k] = 1e-5 * max(abs(found.values[k]), 1e-3)
        ends = [function(replace(found, values=found.values + s * step)) for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * step[k]))
    return np.column_stack(columns)


def _kind(name: str) -> str:
    return name.removesuffix("_positive").removesuffix("_negative")


def _components_fitted(found: Dynamics, name: str, split: GravitySplit) -> bool:
    """Whether all that a parameter is computed from was fitted."""
    direction = name.rpartition("_")[2]
    kind = _kind(name)
    if kind == "offset":
        return split.equal
    if kind == "mass":
        return found.is_fitted("mass")
    other = "stribeck_amplitude" if kind in ("static", "stribeck_velocity") else "viscous"
    return all(found.is_fitted(f"{one}_{direction}") for one in ("coulomb_level", other))


def _how(name: str, determined: bool, split: GravitySplit, how: str) -> str:
    kind = _kind(name)
    if kind == "offset" and not split.equal:
        return UNEQUAL
    if not determined:
        return SAME if kind in ("static", "stribeck_velocity") else LEFT
    return f"{how}; {split.reason}" if kind in ("coulomb", "offset") and split.equal else how
