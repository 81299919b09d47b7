"""Settings of monitoring: limits and dwells of its rules, its forest, what recurs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from pipeline.schema.ranges import Count, Range, Ranged, Share

Seconds = Annotated[float, Range(above=0.0, most=86400.0, unit="s")]
DWELL_S: Mapping[str, float] = {
    "load_over_limit": 30.0, "load_without_feed": 30.0, "temperature_slope": 30.0,
    "temperature_outside": 600.0, "no_load_power": 120.0, "following_error": 30.0,
    "cut_load_high": 60.0, "cut_load_low": 60.0, "sensor_silent": 600.0, "sensor_stuck": 10.0,
    "forest": 60.0,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class IncidentSettings(Ranged, section="incidents"):
    """Limits and dwells of the rules, and of the isolation forest."""

    window_s: Annotated[float, Range(least=1.0, most=60.0, unit="s")] = 10.0
    dwell_s: Mapping[str, Seconds] = field(default_factory=lambda: dict(DWELL_S))
    """Time over which a rule must hold, by its name [s]."""
    load_limit_percent: Annotated[float, Range(above=0.0, most=500.0, unit="%")] = 110.0
    slope_K_min: Annotated[float, Range(above=0.0, most=100.0, unit="K/min")] = 5.0
    slope_s: Annotated[float, Range(least=60.0, most=3600.0, unit="s")] = 60.0
    """Rise of the spindle's temperature, by least squares over a time."""
    idle_load_percent: Annotated[float, Range(above=0.0, most=500.0, unit="%")] = 60.0
    idle_feed_mm_min: Annotated[float, Range(above=0.0, most=1000.0, unit="mm/min")] = 1.0
    """Load from which on it is strange that the feed is below its limit while a program runs."""
    interval: Annotated[float, Range(least=1.0, most=20.0, unit="1")] = 2.0
    """Least distance from the twin's estimate that counts, over half of its 90 % interval."""
    margin: Annotated[float, Range(least=1.0, most=10.0, unit="1")] = 1.25
    """Limit over the most that the known-good days have."""
    stuck_s: Seconds = 3600.0
    stuck_interval: Annotated[float, Range(above=0.0, most=20.0, unit="1")] = 1.5
    """Time for which a sensor says the same; move of the estimate then, in half intervals."""
    start_s: Seconds = 3600.0
    """Time after records begin in a run over which the estimated temperature does not count."""
    level_s: Seconds = 60.0
    """Time over which loads of a program and tool are compared, by their medians."""
    least_windows: Count = 18
    """Windows of a program and tool from which its usual load is known."""
    trees: Annotated[int, Range(least=10, most=2000)] = 200
    contamination: Share = 0.01
    samples: Annotated[int, Range(least=256, most=1_000_000)] = 20000
    """Isolation forest: trees, share of known-good windows beyond its limit, windows learnt."""
    residuals: bool = True
    vibration: bool = True
    """Residuals of the twin, and recorded vibration, among its features."""
    join_h: Annotated[float, Range(least=0.0, most=1000.0, unit="h")] = 8.0
    """Worked time between events of a component that are one incident."""
    alarm_times: Count = 3
    alarm_days: Count = 14
    """Alarms of one code within a number of days that make an incident."""
    alarm_growth_min: Annotated[float, Range(least=0.0, most=10080.0, unit="min")] = 10.0
    """Minutes of an alarm beyond those of the week before that make an incident."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if set(self.dwell_s) != set(DWELL_S):
            raise ValueError(
                f"incidents.dwell_s names {', '.join(sorted(self.dwell_s))}: give one time to each "
                f"of {', '.join(sorted(DWELL_S))}"
            )
