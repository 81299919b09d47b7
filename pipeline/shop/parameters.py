"""What is simulated: machine, weeks, working hours, shop air, agent, thermocouple logger."""

from dataclasses import dataclass, field
from datetime import date
from typing import Literal

import numpy as np

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.cutting_parameters import Cutting
from pipeline.shop.drive_parameters import Drives
from pipeline.shop.ranges import Ranged, quantity
from pipeline.shop.spindle_parameters import SpindleParameters

DAY = 86400
"""Seconds in a day."""


@dataclass(frozen=True, kw_only=True)
class ShiftParameters(Ranged):
    """How people work at the machine; hours count from midnight."""

    start_earliest: float = quantity(6.0, "h", 3, 12)
    start_latest: float = quantity(7.0, "h", 3, 12)
    end: float = quantity(16.5, "h", 10, 21)
    friday_end: float = quantity(14.5, "h", 10, 21)
    breaks: tuple[tuple[float, float], ...] = ((9.25, 0.25), (12.0, 0.67), (14.5, 0.17))
    batch_smallest: int = quantity(3, "1", 1, 1000)
    batch_largest: int = quantity(9, "1", 1, 1000)
    abort_chance: float = quantity(0.025, "1", 0, 1)  # for each cycle
    feed_hold_chance: float = quantity(0.03, "1", 0, 1)  # for each operation
    warm_up_chance: float = quantity(0.85, "1", 0, 1)  # for each morning

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start_latest < self.start_earliest or self.batch_largest < self.batch_smallest:
            raise ValueError(
                "ShiftParameters: start_latest and batch_largest must not be below start_earliest "
                f"and batch_smallest; got {self.start_latest}, {self.batch_largest}"
            )


@dataclass(frozen=True, kw_only=True)
class AirParameters(Ranged):
    """The air of the shop: heating with setback, outdoors, doors."""

    working: float = quantity(20.5, "degC", 0, 40)
    setback: float = quantity(15.5, "degC", -10, 40)
    weekend: float = quantity(13.5, "degC", -10, 40)
    daily_amplitude: float = quantity(1.4, "K", 0, 20)
    day_to_day: float = quantity(1.2, "K", 0, 20)  # weather, standard deviation
    building_lag: float = quantity(2.5, "h", 0.1, 48)
    doors_a_day: float = quantity(8.0, "1", 0, 200)
    door_drop: float = quantity(2.5, "K", 0, 20)
    door_recovery: float = quantity(11.0, "min", 0.5, 300)


@dataclass(frozen=True, kw_only=True)
class LogParameters(Ranged):
    """How the machine's log is written, and its dirt (rates are means)."""

    kind: Literal["agent", "adapter"] = "agent"
    poll: float = quantity(1.05, "s", 0.1, 60)
    jitter: float = quantity(0.015, "s", 0, 0.5)
    skipped_polls: float = quantity(0.02, "1", 0, 0.5)  # share
    zero_temperatures: float = quantity(300.0, "1/day", 0, 2e4)
    feedrate_spikes: float = quantity(4.0, "1/day", 0, 500)
    speed_spikes: float = quantity(1.0, "1/day", 0, 500)
    position_spikes: float = quantity(0.6, "1/day", 0, 500)
    counter_resets: float = quantity(0.5, "1/day", 0, 500)
    disconnects: float = quantity(4.0, "1/day", 0, 100)
    late_disconnects: float = quantity(0.5, "1", 0, 1)  # share stamped before what precedes it
    silences: float = quantity(0.2, "1/day", 0, 20)
    late_lines: float = quantity(6.0, "1/day", 0, 1e3)
    broken_lines: float = quantity(1.5, "1/day", 0, 1e3)


@dataclass(frozen=True, kw_only=True)
class LoggerParameters(Ranged):
    """The thermocouple logger beside the machine."""

    interval: int = quantity(10, "s", 1, 3600)
    decimal: Literal[".", ","] = "."
    encoding: Literal["utf-8", "cp1252"] = "utf-8"
    clock_offset: float = quantity(3.0, "s", -600, 600)
    clock_drift: float = quantity(1.7, "s/day", -60, 60)
    zone_hours: int = quantity(0, "h", -12, 14)  # of the logger's clock against UTC
    noise: float = quantity(0.06, "K", 0, 5)
    offset: float = quantity(0.3, "K", 0, 5)  # standard deviation over the channels
    dropouts: int = quantity(4, "1", 0, 1000)  # in all: one channel blank for a while
    spikes: int = quantity(7, "1", 0, 10000)  # in all: one sample of one channel


@dataclass(frozen=True, kw_only=True)
class ShopParameters(Ranged):
    """A machine of the simulated shop and the weeks to live through.

    Raises
    ------
    ValueError
        When a value is out of its range or ``first_day`` is not an ISO date on a Monday.
    """

    machine: str
    seed: int = quantity(1, "1", 0, 2**32 - 1)
    first_day: str = "2026-01-05"
    weeks: int = quantity(3, "1", 1, 104)
    c_axis: bool = True
    programs: tuple[str, ...] = ("O1101", "O2040", "O3307", "O4410")
    power_scale: float = quantity(1.0, "1", 0.05, 5)  # of the cuts
    spindle: SpindleParameters = field(default_factory=SpindleParameters)
    shift: ShiftParameters = field(default_factory=ShiftParameters)
    air: AirParameters = field(default_factory=AirParameters)
    log: LogParameters = field(default_factory=LogParameters)
    logger: LoggerParameters = field(default_factory=LoggerParameters)
    control: ControlParameters = field(default_factory=ControlParameters)
    drives: Drives = field(default_factory=Drives)
    cutting: Cutting = field(default_factory=Cutting)

    def __post_init__(self) -> None:
        super().__post_init__()
        if date.fromisoformat(self.first_day).weekday() != 0:
            raise ValueError(f"ShopParameters.first_day = {self.first_day} must be a Monday")
        if not self.programs:
            raise ValueError("ShopParameters.programs = () must name at least one part program")

    @property
    def start(self) -> np.datetime64:
        """Midnight (UTC) at which the simulation starts [s]."""
        return np.datetime64(self.first_day, "s")

    @property
    def days(self) -> int:
        """Number of days simulated."""
        return 7 * self.weeks

    def generator(self, stream: str) -> np.random.Generator:
        """Random numbers of one source of chance, independent of how much others draw."""
        words = [self.seed, *stream.encode()]
        return np.random.Generator(np.random.PCG64(words))
