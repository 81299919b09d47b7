"""The simulated control of a mill: limits of the axes, corners, waits, how its log is polled.

Typical of a vertical machining centre of 12 to 15 kW.  Sources of the orders of magnitude:

- Brochures of the class (DN Solutions DNM 4500: rapids 36, 36, 30 m/min, tool to tool 1.3 s; Haas
  VF-2SS: 35.6 m/min, 1.6 s): rapids 30 to 36 m/min, with the door, the arm and the check of the
  tool 2 to 3 s; accelerations of 0.3 to 0.6 g.
- Altintas: *Manufacturing Automation*, 2nd ed., ch. 5 and 6: jerk of 5e4 mm/s³, position gain of 30
  to 60 1/s.
- Jeon: *Improving Grbl: cornering algorithm* (2011): centripetal junction rule, 0.01 mm.
- Fanuc operator's manuals: standard look-ahead of 200 blocks (AI contour control II), clearance of
  G83 by parameter, per-axis rapids, in-position check.
"""

from dataclasses import dataclass, field
from typing import Literal

from pipeline.shop.ranges import Ranged, quantity


@dataclass(frozen=True, kw_only=True)
class AxisLimits(Ranged):
    """What one axis can do."""

    rapid: float = quantity(36000.0, "mm/min", 1e3, 2e5)
    acceleration: float = quantity(5.0, "m/s2", 0.2, 30)
    jerk: float = quantity(50.0, "m/s3", 1, 2e3)


@dataclass(frozen=True, kw_only=True)
class CodeTimes(Ranged):
    """Mean time until each M code is answered, without what it starts, and the scatter of all."""

    m1: float = quantity(0.08, "s", 0, 10)
    m3: float = quantity(0.14, "s", 0, 10)
    m5: float = quantity(0.12, "s", 0, 10)
    m8: float = quantity(0.42, "s", 0, 10)
    m9: float = quantity(0.26, "s", 0, 10)
    m30: float = quantity(0.35, "s", 0, 10)
    scatter: float = quantity(0.02, "s", 0, 1)


@dataclass(frozen=True, kw_only=True)
class ControlParameters(Ranged):
    """What the control of a machine is set to, and the adapter that polls it.

    Raises
    ------
    ValueError
        When a value is out of its range or a cut could accelerate more than an axis can.
    """

    x: AxisLimits = field(default_factory=AxisLimits)
    y: AxisLimits = field(default_factory=AxisLimits)
    z: AxisLimits = field(
        default_factory=lambda: AxisLimits(rapid=30000.0, acceleration=4.5, jerk=45.0)
    )
    cutting_acceleration: float = quantity(3.0, "m/s2", 0.2, 30)  # along the path
    cutting_jerk: float = quantity(40.0, "m/s3", 1, 2e3)  # along the path
    centripetal_acceleration: float = quantity(2.4, "m/s2", 0.2, 30)
    junction_deviation: float = quantity(0.012, "mm", 1e-4, 1)
    look_ahead: int = quantity(200, "1", 2, 10000)  # blocks
    greatest_feed: float = quantity(15000.0, "mm/min", 100, 1e5)
    position_gain: float = quantity(33.0, "1/s", 5, 500)
    in_position: float = quantity(0.02, "mm", 1e-4, 1)
    cycle: float = quantity(0.002, "s", 1e-4, 0.02)  # of the interpolation
    hold_ramp: float = quantity(0.25, "s", 0.05, 2)  # of the feed rate, to and from standstill
    tool_change: float = quantity(2.6, "s", 0.5, 30)
    tool_change_scatter: float = quantity(0.1, "s", 0, 2)
    change_height: float = quantity(0.0, "mm", -500, 0)  # machine Z where the arm takes the tool
    spindle_wait: Literal["at_m3", "before_cutting"] = "at_m3"
    spindle_overload: float = quantity(1.5, "1", 0.5, 3)  # of rated torque and power, speeding up
    codes: CodeTimes = field(default_factory=CodeTimes)
    first_program: int = quantity(5100, "1", 1, 9000)  # the number below that of the first
    numbered: bool = True  # N words and no blanks, as the posts of some makers write
    peck_clearance: float = quantity(1.0, "mm", 0.05, 5)
    work_offset: tuple[float, float, float] = (-410.0, -235.0, -470.0)  # G54 [mm]
    poll: float = quantity(0.15, "s", 0.02, 5)
    poll_jitter: float = quantity(0.015, "s", 0, 0.5)

    def __post_init__(self) -> None:
        super().__post_init__()
        weakest = min(axis.acceleration for axis in self.axes)
        needed = (self.cutting_acceleration**2 + self.centripetal_acceleration**2) ** 0.5
        if needed > weakest:
            raise ValueError(
                f"ControlParameters: cutting_acceleration {self.cutting_acceleration} and "
                f"centripetal_acceleration {self.centripetal_acceleration} [m/s2] come to "
                f"{needed:.2f}, more than the weakest axis can: {weakest}"
            )

    @property
    def axes(self) -> tuple[AxisLimits, AxisLimits, AxisLimits]:
        """Limits of X, Y, Z."""
        return self.x, self.y, self.z
