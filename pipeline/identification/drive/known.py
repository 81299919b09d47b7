"""What is known of the drives before anything is identified: data sheets, parameter lists."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import isfinite
from typing import Literal

from pipeline.machine.axis.feed_drive import force_constant

Number = float | str | None
"""A value, or the name of a constant that stands beside the channels of the recordings."""
Coulomb = Literal["auto", "equal", "unequal"]

_OF_THE_LOOPS = (
    "position_gain", "velocity_gain", "integral_gain", "velocity_feedforward",
    "acceleration_feedforward", "current_limit", "servo_period",
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class AxisConstants:
    """What is known of an axis, in numbers of SI; None of what nobody knows.

    Parameters
    ----------
    force_constant : float or None
        Force on the carriage for one unit of the command [N/A].
    position_gain, velocity_gain, integral_gain, velocity_feedforward, acceleration_feedforward, \
current_limit : float or None
        As in :class:`~pipeline.machine.axis.servo.ServoParameters`.
    servo_period : float or None
        Of the velocity loop [s].
    """

    force_constant: float | None = None
    position_gain: float | None = None
    velocity_gain: float | None = None
    integral_gain: float | None = None
    velocity_feedforward: float | None = None
    acceleration_feedforward: float | None = None
    current_limit: float | None = None
    servo_period: float | None = None


@dataclass(frozen=True, kw_only=True)
class AxisKnown:
    """What is known of one axis; each number may be the name of a constant of the recordings.

    Parameters
    ----------
    force_constant : float or str, optional
        Force on the carriage for one unit of the command [N/A]; without it, and without torque
        constant and lead, forces are in the command's unit.
    torque_constant, lead : float or str, optional
        Of motor [N m/A] and screw [mm/rev], in place of ``force_constant``.
    position_gain, velocity_gain, integral_gain, velocity_feedforward, acceleration_feedforward, \
current_limit : float or str, optional
        As in :class:`~pipeline.machine.axis.servo.ServoParameters`.
    servo_period : float or str, optional
        Of the velocity loop [s]; the record's own when nobody knows it.
    coulomb : {"auto", "equal", "unequal"}
        Motion shows only the sum of Coulomb friction and a force that is always there.  "equal":
        Coulomb friction is alike both ways, and what differs is the force (a vertical axis, an
        amplifier with an offset); "unequal": no such force; "auto": see
        :mod:`pipeline.identification.drive.offset`.
    """

    force_constant: Number = None
    torque_constant: Number = None
    lead: Number = None
    position_gain: Number = None
    velocity_gain: Number = None
    integral_gain: Number = None
    velocity_feedforward: Number = None
    acceleration_feedforward: Number = None
    current_limit: Number = None
    servo_period: Number = None
    coulomb: Coulomb = "auto"

    def __post_init__(self) -> None:
        if (self.torque_constant is None) != (self.lead is None):
            raise ValueError("drive: torque_constant and lead go together: give both or neither")
        if self.force_constant is not None and self.lead is not None:
            raise ValueError("drive: force_constant stands beside torque_constant: give one")
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name != "coulomb" and not isinstance(value, str):
                _number(item.name, value, {})

    def resolved(self, constants: Mapping[str, float]) -> AxisConstants:
        """Numbers in place of names.

        Parameters
        ----------
        constants : mapping of str to float
            Those that stand beside the channels of a recording.

        Raises
        ------
        ValueError
            When a name is none of ``constants``, or a value is out of its range.
        """
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
class DriveKnown:
    """What is known of the drives of a machine.

    Parameters
    ----------
    axes : mapping of str to AxisKnown
        By the axis' letter.
    """

    axes: Mapping[str, AxisKnown] = field(default_factory=dict)

    def axis(self, letter: str) -> AxisKnown:
        """What is known of one axis; nothing when it is not named."""
        return self.axes.get(letter, AxisKnown())


def constants_of(entries: Mapping[str, Mapping[str, object]]) -> dict[str, float]:
    """Constants on which all recordings that hold them agree, by name.

    Parameters
    ----------
    entries : mapping of str to mapping
        Constants of each recording.
    """
    seen: dict[str, set[float]] = {}
    for entry in entries.values():
        for name, value in entry.items():
            if isinstance(value, int | float) and not isinstance(value, bool):
                seen.setdefault(name, set()).add(float(value))
    return {name: values.pop() for name, values in seen.items() if len(values) == 1}


def names_of(known: AxisKnown) -> list[str]:
    """Names of constants that ``known`` asks for."""
    values = [getattr(known, item.name) for item in fields(known) if item.name != "coulomb"]
    return [value for value in values if isinstance(value, str)]
