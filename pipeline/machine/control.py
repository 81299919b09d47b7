"""What the control of a machine is set to: limits of each axis, corners, filters, waits.

Numbers stand as the parameter pages of controls have them, in millimetre and minute (degree and
minute of rotary axes); the properties give them in SI, as the planner works.

After interpolation the command of each axis runs through two moving averages of lengths T1 and T2.
With a speed jump of at most dV at a corner, the jumps of dense corners spread so that they average
to at most a_arc (see :mod:`pipeline.machine.corners`) and a tangential acceleration of at most
a_cut, the filtered acceleration of an axis is at most a_cut + a_arc + dV / max(T1, T2) and its jerk
at most twice that over min(T1, T2).
"""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from pipeline.gcode.moves import AXES, METRE, METRE_PER_SECOND, RADIAN
from pipeline.machine.auxiliary import AuxiliaryParameters

Floats = npt.NDArray[np.float64]

LINEAR = "XYZ"


@dataclass(frozen=True, kw_only=True)
class AxisParameters:
    """Limits of one axis; read degree for millimetre at A, B and C.

    Parameters
    ----------
    rapid_speed, cutting_speed : float
        Greatest speed in G0, and in G1 to G3 [mm/min].
    rapid_acceleration, cutting_acceleration : float
        Along the path, in G0 and in G1 to G3 [mm/s^2].
    arc_acceleration : float
        Towards the centre of arcs, and what the corners of a curve made of chords come to [mm/s^2].
    corner_jump : float
        Greatest jump of speed at a corner [mm/min]; 0 stands still wherever the axis changes its
        speed.
    jerk : float, optional
        Greatest jerk before interpolation [mm/s^3]; the profile ``s_curve`` needs it.
    acceleration_limit : float, optional
        What the drive can do [mm/s^2]: the filtered acceleration must stay below it.
    """

    rapid_speed: float
    cutting_speed: float
    rapid_acceleration: float
    cutting_acceleration: float
    arc_acceleration: float
    corner_jump: float
    jerk: float | None = None
    acceleration_limit: float | None = None

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if value is None:
                continue
            low_enough = value >= 0 if item.name == "corner_jump" else value > 0
            if not (np.isfinite(value) and low_enough):
                least = "at least 0" if item.name == "corner_jump" else "positive"
                raise ValueError(f"{item.name} = {value} must be finite and {least}")


@dataclass(frozen=True, kw_only=True)
class ControlParameters:
    """A control and the machine that it moves.

    Parameters
    ----------
    axes : dict of str to AxisParameters
        By the letters X Y Z A B C; a program that moves another axis is refused.
    corner : {"jump", "tolerance"}
        Whether corners are rounded as the filters happen to (Fanuc), or so that the filtered path
        stays within ``tolerance``.  A tolerance in the program (G64 P) is kept in both.
    tolerance : float
        The control's own [mm]; used with ``corner = "tolerance"``.
    rapid_filter, cutting_filter : tuple of 2 floats
        Lengths T1, T2 of the moving averages after interpolation [s]; 0 for none.
    profile : {"trapezoid", "s_curve"}
        Acceleration before interpolation.
    rapid_mode : {"linear", "independent"}
        Whether G0 interpolates, or each axis goes as fast as it can.
    rapid_stop : {"always", "change", "never"}
        Where rapids end at a standstill: each one, or only where rapid and feed meet.
    settle_time : float
        What the check that the axes are in position takes at an exact stop [s].
    interpolation_period : float
        [s].
    auxiliary : AuxiliaryParameters
        Times of what does not move an axis.

    Raises
    ------
    ValueError
        When a value is out of its range, or the filtered acceleration could pass an axis'
        ``acceleration_limit``.
    """

    axes: dict[str, AxisParameters]
    corner: Literal["jump", "tolerance"] = "jump"
    tolerance: float = 0.01
    rapid_filter: tuple[float, float] = (0.0, 0.0)
    cutting_filter: tuple[float, float] = (0.0, 0.0)
    profile: Literal["trapezoid", "s_curve"] = "trapezoid"
    rapid_mode: Literal["linear", "independent"] = "linear"
    rapid_stop: Literal["always", "change", "never"] = "always"
    settle_time: float = 0.0
    interpolation_period: float = 0.001
    auxiliary: AuxiliaryParameters = field(default_factory=AuxiliaryParameters)

    def __post_init__(self) -> None:
        if not self.axes or not set(self.axes) <= set(AXES):
            raise ValueError(f"axes = {sorted(self.axes)}: name some of {list(AXES)}")
        for name, allowed in _CHOICES.items():
            if getattr(self, name) not in allowed:
                raise ValueError(f"{name} = {getattr(self, name)!r} must be one of {allowed}")
        for name in ("tolerance", "interpolation_period"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise ValueError(f"{name} = {getattr(self, name)} must be finite and positive")
        for name, values in (
            ("rapid_filter", self.rapid_filter),
            ("cutting_filter", self.cutting_filter),
            ("settle_time", (self.settle_time,)),
        ):
            if not all(np.isfinite(value) and value >= 0 for value in values):
                raise ValueError(f"{name} = {getattr(self, name)} s must be finite and at least 0")
        if self.profile == "s_curve":
            for letter, axis in self.axes.items():
                if axis.jerk is None:
                    raise ValueError(f"profile = 's_curve' needs axes.{letter}.jerk: give it")
        self._check_filtered_acceleration()

    def _check_filtered_acceleration(self) -> None:
        for letter, axis in self.axes.items():
            limit = axis.acceleration_limit
            if limit is None:
                continue
            reached = self.filtered_acceleration(letter)
            if reached > limit * (1 + 1e-12):
                raise ValueError(
                    f"axes.{letter}: rapid_acceleration, or cutting_acceleration + "
                    f"arc_acceleration + corner_jump over the longer filter, comes to "
                    f"{reached:.6g} mm/s^2 and passes acceleration_limit = {limit:.6g}: "
                    "lower one of them or lengthen the filter"
                )

    def filtered_acceleration(self, letter: str) -> float:
        """Greatest acceleration that an axis can be commanded [mm/s^2].

        A corner's jump counts where a filter spreads it; without a filter it is a jump of speed
        and no acceleration.
        """
        axis = self.axes[letter]
        curve = axis.arc_acceleration
        cutting = axis.cutting_acceleration + curve + _spread(axis, self.cutting_filter)
        rapid = axis.rapid_acceleration
        if self.rapid_stop != "always":
            rapid += curve + _spread(axis, self.rapid_filter)
        return max(cutting, rapid)

    @property
    def has_axis(self) -> npt.NDArray[np.bool_]:
        """Which of X Y Z A B C there are; shape (6,)."""
        return np.array([letter in self.axes for letter in AXES])

    @cached_property
    def limits(self) -> Floats:
        """Limits in SI, shape (7, 6); rows as in :class:`pipeline.machine.corners.Limit`.

        Without an axis infinite, so that what does not move does not count.
        """
        table = np.full((len(_ROWS), 6), np.inf)
        for letter, axis in self.axes.items():
            column = AXES.index(letter)
            unit = METRE if letter in LINEAR else RADIAN
            per_minute = METRE_PER_SECOND if letter in LINEAR else RADIAN / 60
            for row, (name, is_speed) in enumerate(_ROWS):
                value = getattr(axis, name)
                if value is not None:
                    table[row, column] = value * (per_minute if is_speed else unit)
        return table

    @property
    def filters(self) -> Floats:
        """T1, T2 in rapids (row 0) and in cutting (row 1) [s]; shape (2, 2)."""
        return np.array([self.rapid_filter, self.cutting_filter], float)


def _spread(axis: AxisParameters, filters: tuple[float, float]) -> float:
    longest = max(filters)
    return axis.corner_jump / 60 / longest if longest > 0 else 0.0


_CHOICES = {
    "corner": ("jump", "tolerance"),
    "profile": ("trapezoid", "s_curve"),
    "rapid_mode": ("linear", "independent"),
    "rapid_stop": ("always", "change", "never"),
}
_ROWS = (
    ("rapid_speed", True),
    ("cutting_speed", True),
    ("rapid_acceleration", False),
    ("cutting_acceleration", False),
    ("arc_acceleration", False),
    ("corner_jump", True),
    ("jerk", False),
)
