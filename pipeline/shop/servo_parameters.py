"""The loops of a simulated axis, and the tool that records them.

Sources of the orders of magnitude: Altintas: *Manufacturing Automation*, 2nd ed., ch. 6 (position
gains of 25 to 40 1/s, velocity loops of 30 to 60 Hz, feed-forward of 50 to 100 %); Siemens:
*SINAMICS S120 function manual* (current controller 125 us and less, speed controller 125 or 250
us, position controller 0.5 to 2 ms); Heidenhain: *Encoders for servo drives*, *LC 400* (2^17 to
2^20 and more steps a turn, scales of 0.1 um and finer).
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from pipeline.shop.ranges import Ranged, quantity

INTEGRATION = 40000
"""Steps a second in which the drives are simulated."""
RATE = 1000
"""Rows a second that the tool writes."""


@dataclass(frozen=True, kw_only=True)
class Cascade(Ranged):
    """Position loop P, velocity loop PI, with the rates at which they run.

    Parameters
    ----------
    position_gain, velocity_gain, integral_gain : float
        As the list of the control's parameters says.
    position_scale, velocity_scale, integral_scale : float
        What the loops have of them: the maker's own scalings, which the list does not say.
    velocity_feedforward : float
        Share of the commanded velocity.
    feedback : {"scale", "motor"}
        What closes the position loop: a scale at the carriage, or the motor's encoder.
    steps_per_turn : int
        Of the motor's encoder, from which the velocity comes.
    velocity_filter : float
        Time constant.

    Raises
    ------
    ValueError
        When a value is out of its range or the rates do not divide one another.
    """

    position_frequency: int = quantity(2000, "Hz", RATE, INTEGRATION)
    velocity_frequency: int = quantity(8000, "Hz", RATE, INTEGRATION)
    position_gain: float = quantity(40.0, "1/s", 1, 500)
    velocity_gain: float = quantity(500.0, "A s/m", 1, 1e5)
    integral_gain: float = quantity(48e3, "A/m", 0, 1e7)
    position_scale: float = quantity(0.825, "1", 0.2, 5)
    velocity_scale: float = quantity(1.17, "1", 0.2, 5)
    integral_scale: float = quantity(0.86, "1", 0.2, 5)
    velocity_feedforward: float = quantity(0.6, "1", 0, 1)
    acceleration_feedforward: float = quantity(1.3, "A s2/m", 0, 100)
    current_limit: float = quantity(40.0, "A", 0.1, 1e3)
    feedback: Literal["scale", "motor"] = "scale"
    scale_step: float = quantity(0.1, "um", 1e-3, 10)
    steps_per_turn: int = quantity(2**20, "1", 1000, 2**26)
    velocity_filter: float = quantity(0.4, "ms", 0.01, 10)

    def __post_init__(self) -> None:
        super().__post_init__()
        chain = (RATE, self.position_frequency, self.velocity_frequency, INTEGRATION)
        if any(b % a for a, b in pairwise(chain)):
            raise ValueError(
                f"Cascade: position_frequency = {self.position_frequency} and velocity_frequency = "
                f"{self.velocity_frequency} [Hz] must divide one another between {RATE} and "
                f"{INTEGRATION}"
            )


@dataclass(frozen=True, kw_only=True)
class ServoTool(Ranged):
    """The servo tuning tool: its files, their dirt, and what it is told to record.

    Parameters
    ----------
    style : {"plain", "bracketed"}
        Of whose columns: ``X_PosAct`` and seconds, or ``APOS(X)`` and milliseconds.
    clock_error : float
        Of its stamps: positive where its clock goes fast.
    position_step, current_step : float
        Of what it writes.
    dropped, torn : int, str
        Gaps in each file; the file that ends inside a row.
    speeds : tuple of float
        Of the strokes [mm/s]; rapid comes after them.
    workpiece : float
        That is set down between strokes.

    Raises
    ------
    ValueError
        When a value is out of its range or no speed of the strokes is positive.
    """

    style: Literal["plain", "bracketed"] = "plain"
    decimal: Literal[".", ","] = "."
    clock_error: float = quantity(50.0, "ppm", -1e3, 1e3)
    position_step: float = quantity(0.1, "um", 0.01, 10)
    current_step: float = quantity(0.005, "A", 1e-5, 1)
    current_noise: float = quantity(0.03, "A", 0, 1)
    dropped: int = quantity(3, "1", 0, 100)
    torn: Literal["", "circle-20mm", "circle-80mm", "inertia-step-X"] = "circle-80mm"
    speeds: tuple[float, ...] = (
        0.2, 0.4, 0.8, 1.5, 3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 180.0, 300.0, 450.0,
    )  # fmt: skip
    workpiece: float = quantity(160.0, "kg", 1, 1e4)
    load_cell_noise: float = quantity(4.0, "N", 0, 100)
    load_cell_offset: float = quantity(3.0, "N", -100, 100)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.speeds or min(self.speeds) <= 0:
            raise ValueError(f"ServoTool.speeds = {self.speeds} [mm/s] must be positive")
