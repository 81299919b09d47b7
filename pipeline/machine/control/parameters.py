"""Parameters of a control: limits of each axis, corners, filters, auxiliary functions.

Numbers stand as the parameter pages of controls have them, in millimetre and minute (degree and
minute of rotary axes); the properties give them in SI, as the planner works.

After interpolation the command of each axis runs through two moving averages of lengths T1 and T2.
With a speed jump of at most dV at a corner, the jumps of dense corners spread so that they average
to at most a_arc (see :mod:`pipeline.machine.control.limits`) and a tangential acceleration of at
most a_cut, the filtered acceleration of an axis is at most a_cut + a_arc + dV / max(T1, T2) and its
jerk at most twice that over min(T1, T2).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np

from pipeline.gcode.moves import AXES, METRE, METRE_PER_SECOND, RADIAN
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged

LINEAR = "XYZ"
"""Letters of the linear axes."""

_Seconds = Annotated[float, Range(least=0.0, unit="s")]
_Unbounded = Annotated[float, Range(above=0.0, finite=False)]
"""Positive, infinite for no limit."""


class Limit(IntEnum):
    """Rows of :attr:`ControlParameters.limits`."""

    RAPID_SPEED = 0
    CUTTING_SPEED = 1
    RAPID_ACCELERATION = 2
    CUTTING_ACCELERATION = 3
    ARC_ACCELERATION = 4
    CORNER_JUMP = 5
    JERK = 6


_PER_MINUTE = {Limit.RAPID_SPEED, Limit.CUTTING_SPEED, Limit.CORNER_JUMP}


@dataclass(frozen=True, kw_only=True)
class AxisParameters(Ranged):
    """Limits of one axis; read degree for millimetre at A, B and C."""

    rapid_speed: Positive
    cutting_speed: Positive
    """Greatest speed in G0, and in G1 to G3 [mm/min]."""
    rapid_acceleration: Positive
    cutting_acceleration: Positive
    """Acceleration along the path, in G0 and in G1 to G3 [mm/s^2]."""
    arc_acceleration: Positive
    """Towards the centre of arcs, and the average that the corners of a curve made of chords may
    reach [mm/s^2]."""
    corner_jump: NotNegative
    """Greatest jump of speed at a corner [mm/min]; 0 stops wherever an axis changes its speed."""
    jerk: Positive | None = None
    """Greatest jerk before interpolation [mm/s^3]; the profile ``s_curve`` needs it."""
    acceleration_limit: Positive | None = None
    """Capacity of the drive [mm/s^2]: the filtered acceleration must stay below it."""


@dataclass(frozen=True, kw_only=True)
class AuxiliaryParameters(Ranged, section="auxiliary"):
    """Times of auxiliary functions: spindle, tool change, M codes, stop."""

    spindle_acceleration: _Unbounded = np.inf
    """Acceleration below the base speed [rev/min/s]; M3, M4 and M5 last as long as the change of
    speed, see :mod:`pipeline.machine.spindle`."""
    spindle_base_speed: _Unbounded = np.inf
    """Speed above which the motor gives constant power instead of constant torque [rev/min]."""
    spindle_deceleration: _Unbounded | None = None
    """Deceleration of a spindle that stops [rev/min/s]; ``spindle_acceleration`` by default."""
    spindle_delay: _Seconds = 0.0
    """Added to each of them [s]."""
    spindle_wait: Literal["at_code", "next_line", "before_cutting", "none"] = "at_code"
    """Place of the wait for the spindle: at M3, M4 and M5 themselves, before the line that follows,
    before the next cutting move (the axes meanwhile move on), or nowhere."""
    spindle_stop_wait: Literal["as_start", "before_change"] = "as_start"
    """Whether a spindle that is stopped is waited for as one that starts, or only by what needs it
    at rest: tool change, M0, M1, M2, M30 and the next spindle code."""
    speed_change_waits: bool = False
    """Whether an S word while the spindle rotates is waited for like a start; otherwise the axes
    move on and nothing is waited for."""
    spindle_orientation: _Seconds = 0.0
    """M19 [s]."""
    maximum_speed: _Unbounded = np.inf
    """Greatest speed of the spindle, limits constant surface speed [rev/min]."""
    tool_change: _Seconds = 0.0
    """M6 [s]."""
    tools: dict[int, float] = field(default_factory=dict)
    """Additional time of M6 for a tool [s]."""
    m_code: _Seconds = 0.0
    """An M code that ``m_codes`` does not name [s]."""
    m_codes: dict[int, float] = field(default_factory=dict)
    """M codes by number [s]."""
    flying_m_codes: tuple[int, ...] = ()
    """M codes that are sent while the axes move on; they take no time."""
    stop: _Seconds = 0.0
    """M0 and M1 [s]; 0 leaves out what the operator does."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, times in (("tools", self.tools), ("m_codes", self.m_codes)):
            for number, time in times.items():
                if not (np.isfinite(time) and time >= 0):
                    raise ValueError(
                        f"auxiliary.{name}[{number}] = {time} s must be finite and at least 0"
                    )


@dataclass(frozen=True, kw_only=True)
class BlendParameters(Ranged, section="blend"):
    """Corners that the control blends, as LinuxCNC does; used with ``corner = "blend"``."""

    arcs: bool = True
    """Whether corners may be passed by arcs and by kinks ([TRAJ] ARC_BLEND_ENABLE), or by parabolas
    alone."""
    kink_ratio: Annotated[float, Range(above=0.0, most=0.7071)] = 0.1
    """Share of an axis' acceleration that the change of direction within a cycle may take where
    segments join nearly straight ([TRAJ] ARC_BLEND_KINK_RATIO) [1]."""
    feed_scale: Positive = 1.0
    """Greatest feed override that blends are made for ([DISPLAY] MAX_FEED_OVERRIDE) [1]."""
    arc_share: Annotated[float, Range(above=0.0, below=1.0)] = 0.75**0.5
    """Share of ``cutting_acceleration`` that arcs take towards their centre; along them what is
    left of it, and ``arc_acceleration`` is not used [1]."""


@dataclass(frozen=True, kw_only=True)
class ControlParameters(Ranged):
    """Control and the machine that it moves.

    The filtered acceleration of each axis stays within its ``acceleration_limit``.
    """

    axes: dict[str, AxisParameters]
    """Axes by the letters X Y Z A B C; a program that moves another axis is refused."""
    corner: Literal["jump", "tolerance", "blend"] = "jump"
    """Whether corners are rounded as the filters happen to (Fanuc), so that the filtered path
    stays within ``tolerance``, or by arcs and parabolas of the control's own (LinuxCNC).  A
    tolerance in the program (G64 P) is kept in all."""
    blend: BlendParameters = field(default_factory=BlendParameters)
    """Settings of ``corner = "blend"``."""
    path_speed: _Unbounded = np.inf
    """Greatest speed of X, Y and Z together ([TRAJ] MAX_LINEAR_VELOCITY of LinuxCNC) [mm/min]."""
    path_acceleration: _Unbounded = np.inf
    """Greatest acceleration of X, Y and Z together along the path [mm/s^2]."""
    tolerance: Positive = 0.01
    """The control's own [mm]; used with ``corner = "tolerance"``."""
    rapid_filter: tuple[_Seconds, _Seconds] = (0.0, 0.0)
    cutting_filter: tuple[_Seconds, _Seconds] = (0.0, 0.0)
    """Lengths T1, T2 of the moving averages after interpolation [s]; 0 for none."""
    profile: Literal["trapezoid", "s_curve"] = "trapezoid"
    """Acceleration before interpolation."""
    rapid_mode: Literal["linear", "independent"] = "linear"
    """Whether G0 interpolates, or each axis goes as fast as it can."""
    rapid_stop: Literal["always", "change", "never"] = "always"
    """Rapids that end at a standstill: each one, or only where rapid and feed meet."""
    settle_time: _Seconds = 0.0
    """Duration of the check that the axes are in position at an exact stop [s]."""
    interpolation_period: Positive = 0.001
    """[s]."""
    auxiliary: AuxiliaryParameters = field(default_factory=AuxiliaryParameters)
    """Times of auxiliary functions."""

    def __post_init__(self) -> None:
        if not self.axes or not set(self.axes) <= set(AXES):
            raise ValueError(f"axes = {sorted(self.axes)}: name some of {list(AXES)}")
        super().__post_init__()
        if self.profile == "s_curve":
            for letter, axis in self.axes.items():
                if axis.jerk is None:
                    raise ValueError(f"profile = 's_curve' needs axes.{letter}.jerk: give it")
        if self.corner == "blend":
            self._check_blend()
        self._check_filtered_acceleration()

    def _check_blend(self) -> None:
        for name, is_plain in (
            ("profile", self.profile == "trapezoid"),
            ("rapid_mode", self.rapid_mode == "linear"),
            ("rapid_filter", not any(self.rapid_filter)),
            ("cutting_filter", not any(self.cutting_filter)),
        ):
            if not is_plain:
                raise ValueError(
                    f"corner = 'blend' blends trapezoids without filters, {name} is "
                    f"{getattr(self, name)!r}: leave it out"
                )

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
        curve = 0.0 if self.corner == "blend" else axis.arc_acceleration
        cutting = axis.cutting_acceleration + curve + _spread(axis, self.cutting_filter)
        rapid = axis.rapid_acceleration
        if self.rapid_stop != "always":
            rapid += curve + _spread(axis, self.rapid_filter)
        return max(cutting, rapid)

    @property
    def has_axis(self) -> Bools:
        """Flags of the axes X Y Z A B C that exist; shape (6,)."""
        return np.array([letter in self.axes for letter in AXES])

    @cached_property
    def limits(self) -> Floats:
        """Limits in SI, shape (7, 6); rows as in :class:`Limit`.

        Without an axis infinite, so that what does not move does not count.
        """
        table = np.full((len(Limit), 6), np.inf)
        for letter, axis in self.axes.items():
            column = AXES.index(letter)
            unit = METRE if letter in LINEAR else RADIAN
            per_minute = METRE_PER_SECOND if letter in LINEAR else RADIAN / 60
            for row in Limit:
                value = getattr(axis, row.name.lower())
                if value is not None:
                    table[row, column] = value * (per_minute if row in _PER_MINUTE else unit)
        if self.corner == "blend":
            share = self.blend.arc_share
            table[Limit.ARC_ACCELERATION] = share * table[Limit.CUTTING_ACCELERATION]
        return table

    @property
    def path_limits(self) -> Floats:
        """Greatest speed and acceleration of X, Y and Z together [m/s], [m/s^2]; shape (2,)."""
        return np.array([self.path_speed * METRE_PER_SECOND, self.path_acceleration * METRE])

    @property
    def filters(self) -> Floats:
        """T1, T2 in rapids (row 0) and in cutting (row 1) [s]; shape (2, 2)."""
        return np.array([self.rapid_filter, self.cutting_filter], float)


def _spread(axis: AxisParameters, filters: tuple[float, float]) -> float:
    longest = max(filters)
    return axis.corner_jump / 60 / longest if longest > 0 else 0.0


def of_dialect(said: Mapping[str, Any], dialect: str) -> dict[str, Any]:
    """Section ``control`` completed by the defaults of the dialect's own control.

    LinuxCNC blends corners, and rapids with rapids; other corners, filters, an S-curve or rapids of
    each axis indicate another control that reads its dialect.

    Examples
    --------
    >>> of_dialect({"axes": {}}, "linuxcnc")
    {'corner': 'blend', 'rapid_stop': 'change', 'axes': {}}
    >>> of_dialect({"profile": "s_curve"}, "linuxcnc")
    {'profile': 's_curve'}
    """
    other = {"rapid_filter", "cutting_filter", "profile", "rapid_mode"} & set(said)
    if dialect != "linuxcnc" or other or said.get("corner", "blend") != "blend":
        return dict(said)
    return {"corner": "blend", "rapid_stop": "change", **said}
