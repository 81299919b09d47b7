"""Settings of cleaning: data items of a machine's signals, and rules."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from pipeline.schema.days import UTC, check_zone
from pipeline.schema.ranges import Positive, Range, Ranged
from pipeline.schema.si import DAY
from pipeline.signals.columns import COLUMNS, Column, column


@dataclass(frozen=True, kw_only=True)
class PositionControl:
    """Data items that show when a spindle is held by its position loop."""

    angle: str
    """Data item of the C axis' angle [DEGREE]."""
    speed: str
    """Data item of the same spindle's speed [REVOLUTION/MINUTE]."""
    rate: str | None = None
    """Data item of the C axis' angular velocity [DEGREE/SECOND]: it shows a motion that ended
    between two reports of the angle."""
    tool_speed: str | None = None
    """Data item of a second spindle's speed [REVOLUTION/MINUTE] that carries driven tools: while it
    turns and this spindle stands, the work is held for it."""
    mode: str | None = None
    """Data item of the spindle's MTConnect rotary mode; where it is known it decides alone."""

    @property
    def signals(self) -> dict[str, str]:
        """Data item -> the signal that it is."""
        named = {
            self.angle: "c_angle",
            self.speed: "spindle_speed",
            self.rate: "c_angular_velocity",
            self.tool_speed: "second_spindle_speed",
            self.mode: "spindle_rotary_mode",
        }
        return {item: signal for item, signal in named.items() if item is not None}


@dataclass(frozen=True, kw_only=True)
class CleanMachine:
    """Sources of the canonical signals in one machine's records."""

    signals: Mapping[str, str] = field(default_factory=dict)
    """Canonical signal -> name of the data item or of the trace channel."""
    highest: Mapping[str, Positive] = field(default_factory=dict)
    """Canonical signal -> greatest size that it has on this machine, in the signal's unit: what is
    beyond, as -1 read as 65535, is no value of it."""
    position_control: PositionControl | None = None
    """Signs of position control, for machines whose spindle also works as a C axis."""
    warm_up_programs: tuple[str, ...] = ()
    """Programs that only warm the machine up."""
    tool_tables: tuple[str, ...] = ()
    """Tables of ``conf/tool/`` with the tools that ``tool_number`` names; of the same number in two
    tables the later one counts."""
    time_zone: str = UTC
    """Zone of the plant's clock, as ``America/New_York``: days, and golden sets with them, go from
    midnight to midnight of it."""

    def __post_init__(self) -> None:
        check_zone(self.time_zone)
        for name in self.highest:
            if column(name).text:
                raise ValueError(f"highest of {name!r} in the machine's mapping: it has no numbers")
        seen: dict[str, str] = {}
        for name, item in self.signals.items():
            column(name)
            if item in seen:
                raise ValueError(
                    f"data item {item!r} stands for {seen[item]!r} and for {name!r}; "
                    f"name it once in the machine's signals"
                )
            seen[item] = name

    @property
    def signal_of(self) -> dict[str, str]:
        """Data item or channel -> the signal that it is."""
        spindle = {} if self.position_control is None else self.position_control.signals
        return spindle | {item: name for name, item in self.signals.items()}

    def column(self, item: str) -> Column:
        """Signal of a data item or channel, within what this machine reaches."""
        own = COLUMNS[self.signal_of[item]]
        most = self.highest.get(own.name, np.inf)
        return replace(own, low=max(own.low, -most), high=min(own.high, most))

    @property
    def items(self) -> tuple[str, ...]:
        """Data items and channels that are read, sorted."""
        return tuple(sorted(self.signal_of))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the state table, in the order of the table of signals."""
        wanted = set(self.signals)
        if self.position_control is not None:
            wanted.add("spindle_position_control")
        return tuple(name for name in COLUMNS if name in wanted)


@dataclass(frozen=True, kw_only=True)
class CleanSettings(Ranged, section="cleaning"):
    """By which rules records are cleaned."""

    period_s: Annotated[float, Range(least=1e-3, most=3600, unit="s")] = 1.0
    """Period of the state table [s]."""
    off_after_s: Annotated[float, Range(least=1, most=7 * DAY, unit="s")] = 900.0
    """A machine that is silent for longer was off [s]; shorter gaps stay in the table as nulls."""
    lookahead_s: Annotated[float, Range(least=60, most=DAY, unit="s")] = 3600.0
    """Time of the next day that is read to clean and to join a day's last values [s]."""
    silence_factor: Annotated[float, Range(least=1, most=1000)] = 5.0
    """A silence is this many times as long as an item's habitual interval [1]."""
    silence_min_s: Annotated[float, Range(least=0.1, most=DAY, unit="s")] = 10.0
    """No silence is shorter [s]."""
    bridge_s: Annotated[float, Range(least=0, most=DAY, unit="s")] = 60.0
    """Longest run of removed values over which a signal still counts as known [s]."""
    settle_s: Annotated[float, Range(least=1, most=DAY, unit="s")] = 60.0
    """A level that lasts this long is a new level, not a glitch [s]."""
    temperature_step_K: Annotated[float, Range(least=0.1, most=50, unit="K")] = 5.0
    temperature_slew_K_per_s: Annotated[float, Range(least=1e-4, most=10, unit="K/s")] = 0.1
    temperature_reach_s: Annotated[float, Range(least=1, most=3600, unit="s")] = 60.0
    """From one report to the next a temperature changes by at most ``step + slew * min(elapsed,
    reach)``: an item that reports on change would have reported in between."""
    counter_slack_s: Annotated[float, Range(least=0, most=3600, unit="s")] = 5.0
    """Time by which a counter of seconds may run ahead of the clock [s]."""
    linear_intervals: Annotated[float, Range(least=1, most=100)] = 3.0
    """Values further apart than this many typical intervals are held, not joined by a line [1]."""
    turning_rpm: Annotated[float, Range(least=0.1, most=1000, unit="rev/min")] = 5.0
    """A spindle turns above this speed [rev/min]."""
    cold_after_s: Annotated[float, Range(least=60, most=30 * DAY, unit="s")] = 7200.0
    """A machine that was off for this long starts cold [s]."""
    warm_up_min_s: Annotated[float, Range(least=1, most=DAY, unit="s")] = 120.0
    """Shortest warm-up [s]."""
    segment_min_s: Annotated[float, Range(least=0, most=3600, unit="s")] = 3.0
    """Shorter segments join the one before [s]."""
    load_margin: Annotated[float, Range(least=0, most=100, unit="PERCENT")] = 2.0
    load_spreads: Annotated[float, Range(least=1, most=20)] = 4.0
    """A load is above no-load by more than ``max(load_margin, load_spreads * spread)``
    [PERCENT, 1]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.lookahead_s < self.off_after_s:
            raise ValueError(
                f"lookahead_s = {self.lookahead_s} s is shorter than off_after_s = "
                f"{self.off_after_s} s; a day must see whether the machine goes on after midnight"
            )
        if not (DAY / self.period_s).is_integer():
            raise ValueError(f"period_s = {self.period_s} s does not divide a day of 86400 s")
