"""Rules on windows of the twin's state: values, limits, what to check.

A value is not assessed (NaN) where its channels are not recorded, where what is usual is not known,
and where its rows do not count.  A rule holds where its value exceeds its limit for its dwell.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.windows import Windows, dwell
from pipeline.schema.arrays import Floats
from pipeline.schema.incident import Severity, UsualLoad, Who
from pipeline.schema.si import MINUTE, NS
from pipeline.schema.twin_state import AXES

TEMPERATURE, BEARINGS, DRIVE, CUT = ("spindle temperature", "spindle bearings", "spindle drive",
                                     "tool and cut")  # fmt: skip
SPEED_SHARE = 0.05
"""Speed beside the usual one up to which a load is compared, as a share of it."""
LEAST_SPREAD_PERCENT, LEAST_SPREAD_SHARE = 1.0, 0.05
"""Least spread of a usual load: the step of a load in whole percent, and a share of the load."""
QUANTILES = (0.05, 0.95)


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A rule: where it looks, how grave it is, who looks at what."""

    component: str
    severity: Severity
    who: Who
    unit: str
    title: str
    check: str
    needs: str
    """Quantity of the state, or channel, that it needs."""
    learnt: bool = False
    """Whether its limit comes from the known-good days."""


RULES: Mapping[str, Rule] = {
    "sensor_silent": Rule(
        component=TEMPERATURE, severity="act", who="maintenance", unit="of the readings",
        title="Temperature sensor of the spindle reports nothing while a program runs",
        check="Plug and cable of the sensor, its input at the control; is the item still sent?",
        needs="spindle temperature",
    ),
    "sensor_stuck": Rule(
        component=TEMPERATURE, severity="act", who="maintenance", unit="× half interval",
        title="Temperature sensor of the spindle says the same while the spindle must have changed",
        check="Sensor and its input: touch or heat it and see whether the reading moves.",
        needs="spindle_temperature",
    ),
    "temperature_slope": Rule(
        component=TEMPERATURE, severity="act", who="maintenance", unit="K/min",
        title="Spindle heats faster than it should",
        check="Chiller and its flow, bearing noise by hand; a jump without heat is the sensor.",
        needs="spindle temperature", learnt=True,
    ),
    "temperature_outside": Rule(
        component=TEMPERATURE, severity="act", who="maintenance", unit="× half interval",
        title="Spindle temperature is not what speed and load explain",
        check="Hotter: chiller, pump, filter, then bearings. Colder, or drifting with the machine "
        "at rest: the sensor, against a thermometer on the housing.",
        needs="spindle_temperature", learnt=True,
    ),
    "no_load_power": Rule(
        component=BEARINGS, severity="act", who="maintenance", unit="× half interval",
        title="Spindle needs another power than usual without a cut",
        check="Bearings: noise, play, lubrication, temperature at the nose; belt or clamping. Turn "
        "by hand, then run the warm-up and compare.",
        needs="no_load_power", learnt=True,
    ),
    "load_over_limit": Rule(
        component=DRIVE, severity="act", who="process engineer", unit="%",
        title="Spindle load over its limit",
        check="Tool and its edge, depth and width of cut, material; the drive's own limit.",
        needs="spindle_load",
    ),
    "load_without_feed": Rule(
        component=CUT, severity="act", who="process engineer", unit="%",
        title="Spindle under load while nothing is fed",
        check="Jammed tool or chips, dwell in the program, collision; look before the next part.",
        needs="spindle_load",
    ),
    "cut_load_high": Rule(
        component=CUT, severity="watch", who="tool room", unit="× usual spread",
        title="Cut needs more load than this program and tool usually do",
        check="Wear of the tool, then material and blank, then offsets.",
        needs="spindle_load", learnt=True,
    ),
    "cut_load_low": Rule(
        component=CUT, severity="act", who="tool room", unit="× usual spread",
        title="Cut needs less load than this program and tool usually do",
        check="Is the tool broken or the blank missing? Tool length, offsets; check the last part.",
        needs="spindle_load", learnt=True,
    ),
    **{f"{axis}_following_error": Rule(
        component=f"{axis.upper()} axis", severity="act", who="maintenance", unit="× half interval",
        title=f"{axis.upper()} axis follows otherwise than the twin says",
        check="Friction of guide and screw, lubrication, backlash, encoder; then the drive.",
        needs=f"{axis}_following_error", learnt=True,
    ) for axis in AXES},
    "forest": Rule(
        component="machine", severity="watch", who="maintenance", unit="score",
        title="Machine behaves unlike its known-good days",
        check="The named quantities, beside those of the same program on a good day.",
        needs="spindle_load", learnt=True,
    ),
}  # fmt: skip


def dwell_name(rule: str) -> str:
    """Name of a rule's dwell in the settings: axes share one."""
    return "following_error" if rule.endswith("following_error") else rule


def fixed_limits(settings: IncidentSettings) -> dict[str, float]:
    """Limits that the settings give; of a rule that is learnt from known-good days, the least."""
    learnt = dict.fromkeys((name for name, one in RULES.items() if one.learnt), settings.interval)
    return learnt | {
        "load_over_limit": settings.load_limit_percent,
        "load_without_feed": settings.idle_load_percent,
        "temperature_slope": settings.slope_K_min, "sensor_silent": 0.5,
        "sensor_stuck": settings.stuck_interval,
    }  # fmt: skip


def rule_values(
    windows: Windows, loads: Mapping[str, UsualLoad], settings: IncidentSettings
) -> dict[str, Floats]:
    """Value of each rule but the forest in each window, NaN where it is not assessed; (W,) each.

    ``sensor_silent`` is the share of missing readings, and ``cut_load_…`` the distance from the
    usual load over its spread.
    """
    have = windows.values
    cut = np.where(windows.counts, have["load"], np.nan)
    warm = have["warming"] > 0
    reported = np.cumsum(np.isfinite(have["temperature"])) > 0
    found = {
        "load_over_limit": cut,
        "load_without_feed": np.where(have["fed"] < 0.5, cut, np.nan),
        "temperature_slope": np.where(warm, np.nan, slope(windows, settings)),
        "temperature_outside": np.abs(have["temperature_distance"]),
        "no_load_power": np.abs(have["no_load_distance"]),
        "sensor_silent": np.where(reported, have["silent"], np.nan),
        "sensor_stuck": stuck(windows, settings),
        **{f"{axis}_following_error": np.abs(have[f"{axis}_following_distance"]) for axis in AXES},
    }  # fmt: skip
    off = distance_from_usual(windows, loads, settings)
    return found | {"cut_load_high": off, "cut_load_low": -off}


def slope(windows: Windows, settings: IncidentSettings) -> Floats:
    """Slope of the temperature by least squares over ``slope_s`` up to each window [K/min]; (W,).

    NaN where windows lack or do not follow on each other.
    """
    n, step = dwell(windows, settings.slope_s) + 1, windows.length_s / MINUTE
    found = np.full(len(windows), np.nan)
    if len(windows) < n:
        return found
    t = (np.arange(n) - (n - 1) / 2) * step
    seen = np.lib.stride_tricks.sliding_window_view(windows.values["temperature"], n)
    apart = (windows.start[n - 1 :] - windows.start[: len(windows) - n + 1]) / NS
    found[n - 1 :] = np.where(apart <= n * windows.length_s, seen @ t / (t @ t), np.nan)
    return found


def stuck(windows: Windows, settings: IncidentSettings) -> Floats:
    """Range of the estimate over ``stuck_s`` where the sensor says the same, in half intervals."""
    have, n = windows.values, dwell(windows, settings.stuck_s)
    rolled = {
        name: pd.Series(have[name]).rolling(n, min_periods=n // 2)
        for name in ("temperature", "temperature_estimated")
    }
    ranges = {name: (one.max() - one.min()).to_numpy() for name, one in rolled.items()}
    since = (
        windows.start
        - np.concatenate([windows.start[:1].repeat(n - 1), windows.start])[: len(windows)]
    )
    together = since <= 1.5 * settings.stuck_s * NS
    half = (have["temperature_high"] - have["temperature_low"]) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        moved = np.where(ranges["temperature"] == 0, ranges["temperature_estimated"] / half, 0.0)
    known = together & np.isfinite(ranges["temperature"]) & np.isfinite(half)
    return np.where(known, moved, np.nan)


def cut_of(program: str, tool: str) -> str:
    """Key of a program's cuts with one tool."""
    return f"{program} with tool {tool}"


def _levels(windows: Windows, settings: IncidentSettings) -> pd.DataFrame:
    """Median load of a program and tool over ``level_s`` up to each fed window, with its cut."""
    have, words = windows.values, windows.words
    good = windows.counts & (have["fed"] >= 0.5) & (have["speed"] > 0) & (words["program"] != "")
    rows = pd.DataFrame({
        "cut": [cut_of(p, t) for p, t in zip(words["program"][good], words["tool_number"][good],
                                             strict=True)],
        "place": np.flatnonzero(good), "speed": have["speed"][good], "load": have["load"][good],
        "start": windows.start[good],
    }).dropna()  # fmt: skip
    n = dwell(windows, settings.level_s)
    grouped = rows.groupby("cut", sort=False)
    level = grouped["load"].rolling(n).median().droplevel(0)
    apart = grouped["start"].diff(n - 1)
    most = 3 * n * windows.length_s * NS
    return rows.assign(level=level.where(apart.fillna(0) <= most)).dropna()


def usual_loads(windows: Windows, settings: IncidentSettings) -> dict[str, UsualLoad]:
    """Usual load of each program and tool that was cut often enough."""
    found = {}
    for cut, rows in _levels(windows, settings).groupby("cut"):
        speed = float(rows["speed"].median())
        near = rows["level"][(rows["speed"] - speed).abs() <= SPEED_SHARE * speed]
        if len(near) < settings.least_windows:
            continue
        low, middle, high = near.quantile([QUANTILES[0], 0.5, QUANTILES[1]])
        spread = max((high - low) / 2, LEAST_SPREAD_PERCENT, LEAST_SPREAD_SHARE * middle)
        found[str(cut)] = UsualLoad(
            speed_rpm=round(speed, 1), load_percent=round(float(middle), 3),
            spread_percent=round(float(spread), 3), windows=len(near),
        )  # fmt: skip
    return found


def distance_from_usual(
    windows: Windows, loads: Mapping[str, UsualLoad], settings: IncidentSettings
) -> Floats:
    """Load over ``level_s`` less the usual one, over its spread; (W,), NaN where not known."""
    found = np.full(len(windows), np.nan)
    if not loads or not len(windows):
        return found
    rows = _levels(windows, settings)
    usual = pd.DataFrame({cut: vars(one) for cut, one in loads.items()}).T
    rows = rows.join(usual, on="cut").dropna()
    near = (rows["speed"] - rows["speed_rpm"]).abs() <= SPEED_SHARE * rows["speed_rpm"]
    rows = rows[near]
    off = (rows["level"] - rows["load_percent"]) / rows["spread_percent"]
    found[rows["place"].to_numpy(int)] = off.to_numpy(float)
    return found
