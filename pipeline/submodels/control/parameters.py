"""Identifiable parameters of a control, and the control of a vector of them."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.arrays import Bools, Floats
from pipeline.submodels.statistics import spread_of

Quantity = tuple[str, float, float, str]
"""Unit, least and greatest value of any machine tool, and what to record to determine it."""

PLANE, HEIGHT = ("X", "Y"), ("Z",)
BY_UNIT = ("rapid_speed", "corner_jump")
"""Parameters set by the shop: fitted for each of several machines of a kind."""
MANY = 4
"""Least number of values of a kind with a scatter of their own."""


@dataclass(frozen=True, kw_only=True)
class FreeParameter:
    """Parameter of the fit."""

    name: str
    """Name in :class:`~pipeline.machine.control.parameters.ControlParameters`, with axes or unit
    behind it."""
    unit: str
    """Unit of its value."""
    low: float
    high: float
    """No machine tool is outside."""
    start: float
    """Start of the search."""
    log_scale: bool
    """Whether it is fitted on a logarithmic scale; times are not, they may be 0."""
    remedy: str
    """Record that would determine it."""
    units: tuple[str, ...] = ()
    """Machines of the kind that it holds for; all when empty."""

    @property
    def shared(self) -> str:
        """Name without the unit."""
        return self.name.partition("@")[0]

    @property
    def key(self) -> str:
        """Name without axes and unit."""
        return self.shared.partition(" ")[0]

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that it holds for."""
        return tuple(self.shared.partition(" ")[2])

    def of_each(self, units: Sequence[str]) -> list["FreeParameter"]:
        """The same parameter of each of ``units``."""
        suffixes = [f"@{unit}" for unit in units] if len(units) > 1 else [""]
        return [
            replace(self, name=self.name + suffix, units=(unit,))
            for suffix, unit in zip(suffixes, units, strict=True)
        ]

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the search."""
        return self.coordinate(self.low), self.coordinate(self.high)

    def coordinate(self, value: float) -> float:
        """Position of ``value`` on the scale of the search."""
        return float(np.log(value)) if self.log_scale else value

    def value(self, coordinate: float) -> float:
        """The reverse of :meth:`coordinate`."""
        return float(np.exp(coordinate)) if self.log_scale else coordinate


_RAPIDS = "log a program with rapids of 5 to 500 mm along each axis alone, at 100 % rapid override"
_CORNERS = "log a program with corners of 10 to 90 degrees and with chords of curves at high feed"
_ARCS = "log full circles of 1 to 20 mm radius at rising feeds"
_WAITS = "log programs with tool changes and spindle starts at several speeds"

_AXIS: dict[str, Quantity] = {
    "rapid_speed": ("mm/min", 500.0, 150_000.0, _RAPIDS),
    "rapid_acceleration": ("mm/s^2", 50.0, 30_000.0, _RAPIDS),
    "cutting_acceleration": ("mm/s^2", 20.0, 30_000.0, _CORNERS),
    "arc_acceleration": ("mm/s^2", 5.0, 30_000.0, _ARCS),
    "corner_jump": ("mm/min", 1.0, 10_000.0, _CORNERS),
}
_SETTLE: Quantity = ("s", 0.0, 2.0, _RAPIDS)
_WAITING: dict[str, Quantity] = {
    "tool_change": ("s", 0.0, 120.0, _WAITS),
    "m_code": ("s", 0.0, 20.0, "log a program with M codes that switch coolant, ten times each"),
    "stop": ("s", 0.0, 20.0, "log M1 with the optional stop switched off, ten times"),
}
_SPINDLE: dict[str, Quantity] = {
    "spindle_acceleration": ("rev/min/s", 50.0, 200_000.0, _WAITS),
    "spindle_deceleration": ("rev/min/s", 50.0, 200_000.0, _WAITS),
    "spindle_base_speed": ("rev/min", 100.0, 60_000.0, _WAITS),
}


def free_parameters(
    control: ControlParameters, units: Sequence[str], apart: Collection[str] = ()
) -> list[FreeParameter]:
    """Parameters to fit: rates and accelerations in the plane and of Z, corners, waiting times.

    Limits of cutting are the same for X, Y and Z.

    Those named in ``apart`` are fitted for each of ``units``, as :data:`BY_UNIT` always are;
    everything else is fitted for all together.
    """
    return [
        own
        for one in _of_a_machine(control)
        for own in (one.of_each(units) if one.key in BY_UNIT or one.name in apart else [one])
    ]


def _of_a_machine(control: ControlParameters) -> list[FreeParameter]:
    found = []
    for axes in (PLANE, HEIGHT):
        letters = "".join(a for a in axes if a in control.axes)
        if letters:
            found += [_axis(control, "rapid_speed", a) for a in letters]
            found.append(_axis(control, "rapid_acceleration", letters))
    linear = "".join(a for a in PLANE + HEIGHT if a in control.axes)
    cutting = ("cutting_acceleration", "arc_acceleration", "corner_jump")
    found += [_axis(control, name, linear) for name in cutting]
    found.append(_wait("settle_time", control.settle_time, _SETTLE, log_scale=False))
    for table, log_scale in ((_WAITING, False), (_SPINDLE, True)):
        for name, quantity in table.items():
            start = getattr(control.auxiliary, name)
            found.append(_wait(name, start, quantity, log_scale=log_scale))
    return found


def _wait(name: str, start: float | None, quantity: Quantity, *, log_scale: bool) -> FreeParameter:
    _, low, high, _ = quantity
    begin = start if start is not None and np.isfinite(start) else float(np.sqrt(low * high))
    return _free(name, begin, quantity, log_scale=log_scale)


def _axis(control: ControlParameters, name: str, letters: str) -> FreeParameter:
    start = float(np.mean([getattr(control.axes[a], name) for a in letters]))
    return _free(f"{name} {letters}", start, _AXIS[name], log_scale=True)


def _free(name: str, start: float, quantity: Quantity, *, log_scale: bool) -> FreeParameter:
    unit, low, high, remedy = quantity
    return FreeParameter(
        name=name, unit=unit, low=low, high=high, start=min(max(start, low), high),
        log_scale=log_scale, remedy=remedy,
    )  # fmt: skip


def expected(
    free: Sequence[FreeParameter], values: Floats, determined: Bools
) -> tuple[Floats, Floats]:
    """Prior of each parameter from others and from the start, and half of its 95 % interval.

    That is the mean of the determined values of its kind, of other axes and units, and of the
    start; what machines of a kind have in common is the other units' own.  Its interval is that of
    one more value like these from :data:`MANY` on; of fewer, a factor e or the value itself.

    Centre and half width stand on the scale of the search, shape (D,); ``values`` in their units.
    """
    at = [one.coordinate(value) for one, value in zip(free, values.tolist(), strict=True)]
    alike = []
    for one in free:
        others = [(k, other) for k, other in enumerate(free) if determined[k] and other != one]
        same = [at[k] for k, other in others if other.shared == one.shared]
        if not same or one.key in BY_UNIT:
            same = [at[k] for k, other in others if other.key == one.key]
            same.append(one.coordinate(one.start))
        alike.append(np.array(same))
    centre = np.array([same.mean() for same in alike])
    usual = np.where([one.log_scale for one in free], 1.0, np.abs(centre))
    spread = [spread_of(same) if len(same) >= MANY else np.inf for same in alike]
    return centre, np.minimum(usual, spread)


def control_of(
    start: ControlParameters, free: Sequence[FreeParameter], values: Floats, unit: str
) -> ControlParameters:
    """The control of machine ``unit`` with ``values`` in place of those of ``start``.

    ``values``, shape (D,), are in the units of ``free``; those of other machines are left out.
    """
    axes: dict[str, dict[str, float]] = {letter: {} for letter in start.axes}
    others: dict[str, Any] = {}
    for one, value in zip(free, values.tolist(), strict=True):
        if one.units and unit not in one.units:
            continue
        for letter in one.axes:
            axes[letter][one.key] = value
        if not one.axes:
            others[one.key] = value
    return replace(
        start,
        axes={letter: replace(axis, **axes[letter]) for letter, axis in start.axes.items()},
        settle_time=others.pop("settle_time", start.settle_time),
        auxiliary=replace(start.auxiliary, **others),
    )
