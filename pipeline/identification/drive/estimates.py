"""From a vector of the inverse dynamics to named parameters with intervals, or "not determined"."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.inverse_dynamics import Dynamics
from pipeline.identification.drive.loads import Factor
from pipeline.identification.drive.offset import UNEQUAL, Split, coulomb_and_offset

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

WAYS = ("positive", "negative")
NAMES = (
    "mass", "coulomb_positive", "coulomb_negative", "static_positive", "static_negative",
    "stribeck_velocity_positive", "stribeck_velocity_negative", "viscous_positive",
    "viscous_negative", "offset",
)  # fmt: skip
"""Order of the D parameters."""
SENSOR = 0.01
"""Share by which a recorded current may be wrong as a whole (an amplifier's sensor of class 1, and
ripple between its samples): no force is known better, whatever the residuals say."""
DEFAULT_VELOCITY = 0.005
"""v_s where static friction is Coulomb friction and v_s has no meaning [m/s]."""
FITTED = "bounded robust least squares on motion and force through one filter"
GENETIC = "genetic algorithm on motion and force through one filter"
INSTRUMENTAL = "instrumental variables: the reference's motion in place of the noisy measured one"
SAME = "not determined; static friction is taken as Coulomb friction"
LEFT = "not determined by these recordings; the twin uses the best value all the same"

_SLOW = (
    "record strokes of constant speed from a tenth of the Stribeck velocity (0.1 to 1 mm/s) "
    "upward, each as long as a turn of the screw or more"
)  # fmt: skip
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
    """D parameters.

    Parameters
    ----------
    names : tuple of str
        :data:`NAMES`, then ``force_constant`` or ``load_factor`` where a load tells it.
    values, low, high : ndarray, shape (D,)
        With the 95 % interval [SI, force in the fit's unit].
    determined : ndarray of bool, shape (D,)
        Whether the recordings determine it.
    how, remedy : tuple of str
        Where each is from, and what to record where it is open.
    """

    names: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: Flags
    how: tuple[str, ...]
    remedy: tuple[str, ...]


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


def physical(found: Dynamics, split: Split) -> Floats:
    """Values of the D parameters; of a direction that was not recorded those of the other."""
    coulomb = dict(zip(WAYS, coulomb_and_offset(found, split), strict=False))
    offset = coulomb_and_offset(found, split)[2]
    static, velocity, viscous = {}, {}, {}
    for way in WAYS:
        seen = is_sought(found, f"dip_{way}")
        static[way] = coulomb[way] + (found.value(f"dip_{way}") if seen else 0.0)
        velocity[way] = (
            float(np.exp(found.value(f"log_velocity_{way}"))) if seen else DEFAULT_VELOCITY
        )
        viscous[way] = found.value(f"viscous_{way}")
    for way, other in (WAYS, WAYS[::-1]):
        if not is_sought(found, f"level_{way}"):
            for table in (coulomb, static, velocity, viscous):
                table[way] = table[other]
    ordered = [table[way] for table in (coulomb, static, velocity, viscous) for way in WAYS]
    return np.array([found.value("mass"), *ordered, offset])


def is_sought(found: Dynamics, name: str) -> bool:
    """Whether the parameter called ``name`` was sought."""
    return bool(found.sought[found.names.index(name)])


def estimates(
    found: Dynamics,
    half_width: Floats,
    correlation: Floats,
    others: Sequence[Dynamics],
    split: Split,
    widest: float,
    how: str,
) -> Estimates:
    """Parameters with intervals.

    Parameters
    ----------
    found : Dynamics
        With S parameters that were sought.
    half_width, correlation : ndarray, shape (S,) and (S, S)
        Of these.
    others : sequence of Dynamics
        The same sought at other bandwidths; what they differ by widens the interval.
    split : Split
        How levels become Coulomb friction and offset.
    widest : float
        Half an interval that is wider, as a share, is no determination [1].
    how : str
        Where what was sought is from.
    """
    values = physical(found, split)
    slopes = _slopes(lambda one: physical(one, split), found)
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
    told: Flags = (half <= widest * scale) & (scale > 0)
    ways = [_told(found, name, split) for name in NAMES]
    told &= np.array(ways)
    low, high = values - half, values + half
    for k in (5, 6):  # sought on a logarithmic scale
        factor = np.exp(half[k] / max(values[k], 1e-300)) if np.isfinite(half[k]) else np.inf
        low[k], high[k] = values[k] / factor, values[k] * factor
    low[:-1] = np.maximum(low[:-1], 0.0)
    return Estimates(
        names=NAMES, values=values, low=low, high=high, determined=told,
        how=tuple(_how(n, t, split, how) for n, t in zip(NAMES, told, strict=True)),
        remedy=tuple(REMEDY[_kind(name)] for name in NAMES),
    )  # fmt: skip


def with_load(
    told: Estimates, constant: Factor | None, factor: Factor | None, widest: float
) -> Estimates:
    """With what a load tells: a force constant, of which every force is as uncertain, or a factor.

    Parameters
    ----------
    told : Estimates
        Of the drive.
    constant : Factor or None
        Force constant that the load told [N/A].
    factor : Factor or None
        Of the load's channel, where the force constant was known.
    widest : float
        As in :func:`estimates`.
    """
    if constant is not None:
        share = constant.half_width / constant.value
        forces = ~np.char.startswith(told.names, "stribeck")
        more = np.where(forces, np.abs(told.values) * share, 0.0)
        low = told.values - np.hypot(told.values - told.low, more)
        high = told.values + np.hypot(told.high - told.values, more)
        told = replace(told, low=low, high=high)
    for name, one, how, remedy in (
        ("force_constant", constant, BY_LOAD, REMEDY["load"]),
        ("load_factor", factor, LOAD_FACTOR, REMEDY["load"]),
    ):
        if one is None:
            continue
        told = replace(
            told, names=(*told.names, name), values=np.r_[told.values, one.value],
            low=np.r_[told.low, one.value - one.half_width],
            high=np.r_[told.high, one.value + one.half_width],
            determined=np.r_[told.determined, one.is_told(widest)],
            how=(*told.how, how), remedy=(*told.remedy, remedy),
        )  # fmt: skip
    return told


def _slopes(function: Callable[[Dynamics], Floats], found: Dynamics) -> Floats:
    """Derivatives by the parameters that were sought; shape (D, S)."""
    columns = []
    for k in np.flatnonzero(found.sought):
        step = np.zeros(len(found.values))
        step[k] = 1e-5 * max(abs(found.values[k]), 1e-3)
        ends = [function(replace(found, values=found.values + s * step)) for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * step[k]))
    return np.column_stack(columns)


def _kind(name: str) -> str:
    return name.removesuffix("_positive").removesuffix("_negative")


def _told(found: Dynamics, name: str, split: Split) -> bool:
    """Whether what a parameter is made of was sought."""
    way = name.rpartition("_")[2]
    kind = _kind(name)
    if kind == "offset":
        return split.equal
    if kind == "mass":
        return is_sought(found, "mass")
    seen = is_sought(found, f"level_{way}")
    if kind in ("static", "stribeck_velocity"):
        return seen and is_sought(found, f"dip_{way}")
    return seen and is_sought(found, f"viscous_{way}")


def _how(name: str, told: bool, split: Split, how: str) -> str:
    kind = _kind(name)
    if kind == "offset" and not split.equal:
        return UNEQUAL
    if not told:
        return SAME if kind in ("static", "stribeck_velocity") else LEFT
    return f"{how}; {split.reason}" if kind in ("coulomb", "offset") and split.equal else how
