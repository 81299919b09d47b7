"""Which parameters of a control are found from logs, and how a vector of them makes a control."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.machine.auxiliary import AuxiliaryParameters
from pipeline.machine.control import AxisParameters, ControlParameters

Floats = NDArray[np.float64]

PLANE, HEIGHT = ("X", "Y"), ("Z",)


@dataclass(frozen=True, kw_only=True)
class Free:
    """One parameter.

    Parameters
    ----------
    name : str
        As in :class:`~pipeline.machine.control.ControlParameters`, with axes or the unit behind it.
    unit : str
        Of its value.
    low, high : float
        No machine tool is outside.
    start : float
        Where the search begins.
    shrink : bool
        Whether it is sought on a logarithmic scale; times are not, they may be 0.
    remedy : str
        What to record when it is not determined.
    units : tuple of str
        Machines of the kind that it holds for; all when empty.
    """

    name: str
    unit: str
    low: float
    high: float
    start: float
    shrink: bool
    remedy: str
    units: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Name without axes and unit."""
        return self.name.partition(" ")[0]

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that it holds for."""
        return tuple(self.name.partition(" ")[2].partition("@")[0])

    @property
    def bounds(self) -> tuple[float, float]:
        """Of the search."""
        return self.coordinate(self.low), self.coordinate(self.high)

    def coordinate(self, value: float) -> float:
        """Where ``value`` stands in the search."""
        return float(np.log(value)) if self.shrink else value

    def value(self, coordinate: float) -> float:
        """The reverse of :meth:`coordinate`."""
        return float(np.exp(coordinate)) if self.shrink else coordinate


_RAPIDS = "log a program with rapids of 5 to 500 mm along each axis alone, at 100 % rapid override"
_CORNERS = "log a program with corners of 10 to 90 degrees and with chords of curves at high feed"
_ARCS = "log full circles of 1 to 20 mm radius at rising feeds"
_WAITS = "log programs with tool changes and spindle starts at several speeds"

_AXIS = {
    "rapid_speed": ("mm/min", 500.0, 150_000.0, _RAPIDS),
    "rapid_acceleration": ("mm/s^2", 50.0, 30_000.0, _RAPIDS),
    "cutting_acceleration": ("mm/s^2", 20.0, 30_000.0, _CORNERS),
    "arc_acceleration": ("mm/s^2", 5.0, 30_000.0, _ARCS),
    "corner_jump": ("mm/min", 1.0, 10_000.0, _CORNERS),
}
_WAITING = {
    "tool_change": ("s", 0.0, 120.0, _WAITS),
    "m_code": ("s", 0.0, 20.0, "log a program with M codes that switch coolant, ten times each"),
    "stop": ("s", 0.0, 20.0, "log M1 with the optional stop switched off, ten times"),
}
_SPINDLE = {
    "spindle_acceleration": ("rev/min/s", 50.0, 200_000.0, _WAITS),
    "spindle_deceleration": ("rev/min/s", 50.0, 200_000.0, _WAITS),
    "spindle_base_speed": ("rev/min", 100.0, 60_000.0, _WAITS),
}


def free_parameters(control: ControlParameters, units: Sequence[str]) -> list[Free]:
    """What is sought: rates and accelerations in the plane and of Z, corners, waiting times.

    Rapid rates and corners, which shops set, are sought for each of ``units``, everything else for
    all together.  Limits of cutting are the same for X, Y and Z.
    """
    each = [(f"@{u}" if len(units) > 1 else "", (u,)) for u in units]
    found = []
    for axes in (PLANE, HEIGHT):
        letters = "".join(a for a in axes if a in control.axes)
        if not letters:
            continue
        found += [_axis(control, "rapid_speed", a, s, u) for a in letters for s, u in each]
        found.append(_axis(control, "rapid_acceleration", letters))
    linear = "".join(a for a in "XYZ" if a in control.axes)
    found += [_axis(control, n, linear) for n in ("cutting_acceleration", "arc_acceleration")]
    found += [_axis(control, "corner_jump", linear, s, u) for s, u in each]
    found.append(Free(
        name="settle_time", unit="s", low=0.0, high=2.0, start=control.settle_time, shrink=False,
        remedy=_RAPIDS,
    ))  # fmt: skip
    for table, shrink in ((_WAITING, False), (_SPINDLE, True)):
        for name, (unit_, low, high, remedy) in table.items():
            value = getattr(control.auxiliary, name)
            start = value if value is not None and np.isfinite(value) else float(np.sqrt(low * high))
            found.append(Free(
                name=name, unit=unit_, low=low, high=high, start=min(max(start, low), high),
                shrink=shrink, remedy=remedy,
            ))  # fmt: skip
    return found


def _axis(
    control: ControlParameters, name: str, letters: str, suffix: str = "", units: tuple[str, ...] = ()
) -> Free:
    unit, low, high, remedy = _AXIS[name]
    start = float(np.mean([getattr(control.axes[a], name) for a in letters]))
    return Free(
        name=f"{name} {letters}{suffix}", unit=unit, low=low, high=high,
        start=min(max(start, low), high), shrink=True, remedy=remedy, units=units,
    )  # fmt: skip


def control_of(
    start: ControlParameters, free: Sequence[Free], values: Floats, unit: str
) -> ControlParameters:
    """The control of machine ``unit`` with ``values`` in place of those of ``start``.

    Parameters
    ----------
    values : ndarray, shape (D,)
        In the units of ``free``.
    """
    axes: dict[str, dict[str, float]] = {letter: {} for letter in start.axes}
    waits: dict[str, float] = {}
    settle = start.settle_time
    for one, value in zip(free, values, strict=True):
        if one.units and unit not in one.units:
            continue
        if one.axes:
            for letter in one.axes:
                axes[letter][one.key] = float(value)
        elif one.key == "settle_time":
            settle = float(value)
        else:
            waits[one.key] = float(value)
    made: Callable[[AxisParameters, Mapping[str, float]], AxisParameters] = lambda a, v: replace(a, **v)
    auxiliary: AuxiliaryParameters = replace(start.auxiliary, **waits)
    return replace(
        start,
        axes={letter: made(start.axes[letter], axes[letter]) for letter in start.axes},
        settle_time=settle,
        auxiliary=auxiliary,
    )
