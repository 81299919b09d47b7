"""Prior knowledge of the drives from data sheets and parameter lists, and settings of the fit."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from math import isfinite
from string import ascii_uppercase
from typing import Annotated, Literal

from pipeline.machine.axis.motor import force_constant
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.search.genetic import GeneticSettings
from pipeline.submodels.drive.records import AxisConstants, DriveRecords

Number = float | str | None
"""A value, or the name of a constant that stands beside the channels of the recordings."""
Coulomb = Literal["auto", "equal", "unequal"]

_OF_THE_LOOPS = (
    "position_gain", "velocity_gain", "integral_gain", "velocity_feedforward",
    "acceleration_feedforward", "current_limit", "servo_period",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class AxisPrior:
    """Prior knowledge of one axis; each number may be the name of a constant of the recordings."""

    force_constant: Number = None
    """Force on the carriage for one unit of the command [N/A]; without it, and without torque
    constant and lead, forces are in the command's unit."""
    torque_constant: Number = None
    lead: Number = None
    """Torque constant [N m/A] and screw lead [mm/rev], in place of ``force_constant``."""
    position_gain: Number = None
    velocity_gain: Number = None
    integral_gain: Number = None
    velocity_feedforward: Number = None
    acceleration_feedforward: Number = None
    current_limit: Number = None
    """Gains, feed-forward and limit as in
    :class:`~pipeline.machine.axis.drive_parameters.ServoParameters`."""
    servo_period: Number = None
    """Period of the velocity loop [s]; the recorder's where it is not listed."""
    coulomb: Coulomb = "auto"
    """Split of Coulomb friction and a constant force, of which motion shows only the sum. "equal":
    Coulomb friction is equal in both directions, and the difference is the force (a vertical axis,
    an amplifier with an offset); "unequal": no such force; "auto": see
    :mod:`pipeline.submodels.drive.mechanics.estimates`."""

    def __post_init__(self) -> None:
        if (self.torque_constant is None) != (self.lead is None):
            raise ValueError("drive: torque_constant and lead go together: give both or neither")
        if self.force_constant is not None and self.lead is not None:
            raise ValueError("drive: force_constant stands beside torque_constant: give one")
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "coulomb" and not isinstance(value, str):
                _number(item.name, value, {})

    @property
    def screw_lead(self) -> float | None:
        """Lead [m/rev]; None where it is not listed as a number."""
        return float(self.lead) * 1e-3 if isinstance(self.lead, int | float) else None

    def resolved(self, constants: Mapping[str, float]) -> AxisConstants:
        """Numbers in place of names."""
        force = _number("force_constant", self.force_constant, constants)
        torque = _number("torque_constant", self.torque_constant, constants)
        lead = _number("lead", self.lead, constants)
        if torque is not None and lead is not None:
            force = force_constant(torque, lead * 1e-3)
        found = {name: _number(name, getattr(self, name), constants) for name in _OF_THE_LOOPS}
        return AxisConstants(force_constant=force, **found)


def _number(name: str, given: Number, constants: Mapping[str, float]) -> float | None:
    if given is None:
        return None
    if isinstance(given, str):
        if given not in constants:
            there = ", ".join(sorted(constants)) or "none"
            raise ValueError(
                f"drive.{name} names the constant {given!r}, the recording holds {there}: "
                "correct the name or write the number"
            )
        given = constants[given]
    positive = name not in ("integral_gain", "velocity_feedforward", "acceleration_feedforward")
    if not isfinite(given) or given < 0 or (positive and given == 0):
        least = "positive" if positive else "at least 0"
        raise ValueError(f"drive.{name} = {given} must be finite and {least}: correct it")
    return float(given)


@dataclass(frozen=True, kw_only=True)
class DrivePrior:
    """Prior knowledge of the drives of a machine."""

    axes: Mapping[str, AxisPrior] = field(default_factory=dict)
    """Priors by axis letter."""

    def axis(self, letter: str) -> AxisPrior:
        """Prior knowledge of one axis; nothing when it is not named."""
        return self.axes.get(letter, AxisPrior())


def constants_of(entries: Mapping[str, Mapping[str, object]]) -> dict[str, float]:
    """Constants on which all recordings that hold them agree, by name."""
    seen: dict[str, set[float]] = {}
    for entry in entries.values():
        for name, value in entry.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                seen.setdefault(name, set()).add(float(value))
    return {name: values.pop() for name, values in seen.items() if len(values) == 1}


def names_of(prior: AxisPrior) -> list[str]:
    """Names of the constants that ``prior`` refers to."""
    values = [getattr(prior, item.name) for item in fields(prior) if item.name != "coulomb"]
    return [value for value in values if isinstance(value, str)]


FINEST = 1000
"""Greatest number of substeps in a sample [1]: a servo samples at most as much faster."""


@dataclass(frozen=True, kw_only=True)
class DriveFitSettings(Ranged, section="drive_fit"):
    """Settings of the identification of drives."""

    method: Literal["least_squares", "genetic"] = "least_squares"
    """Method whose optimum is kept."""
    compare: bool = True
    """Whether the other method runs too, for the report."""
    bandwidth_Hz: Annotated[float | None, Range(above=0.0, unit="Hz")] = None
    """Bandwidth of the parallel filter on motion and force [Hz]; by the records when None."""
    shortest_s: Annotated[float, Range(above=0.0, unit="s")] = 0.2
    """Least duration of a stretch of constant speed [s]."""
    widest: Positive = 0.5
    """Relative half width of the 95 % interval beyond which a parameter is not determined [1]."""
    substeps: Annotated[int, Range(above=0.0, most=FINEST)] = 4
    """Steps of the closed-loop simulation in one sample."""
    folds: Annotated[int, Range(least=2)] = 5
    """Greatest number of drives without some recordings, for the intervals of an axis."""
    genetic: GeneticSettings = field(default_factory=GeneticSettings)
    """Settings of the genetic algorithm."""


def check_axes(records: DriveRecords, prior: DrivePrior) -> None:
    """Check that axes are letters, named in both sections."""
    there = ", ".join(records.axes)
    if not there:
        raise ValueError("drive_records.axes names no axis: name the channels of at least one")
    for letter in records.axes:
        if len(letter) != 1 or letter not in ascii_uppercase:
            raise ValueError(
                f"drive_records.axes names {letter!r}, which is no letter of an axis: write X, Y "
                "or the like"
            )
    named = {f"drive.axes names {letter!r}": letter for letter in prior.axes}
    if records.motor is not None:
        named[f"drive_records.motor.axis is {records.motor.axis!r}"] = records.motor.axis
    if records.shaft is not None:
        named |= {f"drive_records.shaft.axes names {one!r}": one for one in records.shaft.axes}
    for place, letter in named.items():
        if letter not in records.axes:
            raise ValueError(
                f"{place}, drive_records.axes has {there}: correct the letter or name the axis' "
                "channels"
            )


def check_constants(prior: DrivePrior, held: Collection[str]) -> None:
    """Check that every constant that ``prior`` names stands in some recording."""
    for letter, axis in prior.axes.items():
        for name in names_of(axis):
            if name not in held:
                raise ValueError(
                    f"drive.axes.{letter} names the constant {name!r}, the recordings hold "
                    f"{', '.join(sorted(held)) or 'none'}: correct the name or write the number"
                )
