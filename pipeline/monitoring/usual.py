"""What is usual for a machine, learnt from its known-good days: limits, loads, the forest.

A rule's limit is the most that it held over its dwell on the known-good days, each left out in turn
of what it was learnt from, times a margin; for residuals at least a multiple of the twin's own
interval.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.monitoring.forest import KnownGood
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.rules import RULES, dwell_name, fixed_limits, rule_values, usual_loads
from pipeline.monitoring.windows import Windows, dwell, held, windows_of
from pipeline.schema.arrays import Floats
from pipeline.schema.incident import Monitor
from pipeline.schema.twin_state import TwinState

FOREST = "forest"
LEARNT = tuple(name for name, rule in RULES.items() if rule.learnt)
NO_DAYS = "there is no known-good day: name training days in the section roles of the machine"
NOT_THERE = "not in the records of two known-good days"
FOLDS = 5
"""Groups of known-good days that are left out in turn."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Usual:
    """The monitor, and the windows that its forest is grown from; None without a forest."""

    monitor: Monitor
    known_good: KnownGood | None


def identify_monitor(
    state: TwinState, folder: Path, clean: Path, settings: IncidentSettings
) -> Usual:
    """What is usual on the training days of a state."""
    days = tuple(sorted(day for day, one in state.days.items() if one.role == "training"))
    windows = windows_of(folder, clean, days, settings)
    loads = usual_loads(windows, settings)
    values = rule_values(windows, loads, settings)
    known_good = KnownGood.of(windows, values, settings)
    parts, centre, usually = list(_left_out(windows, settings)), 0.0, 0.0
    if known_good is not None:
        values[FOREST] = known_good.windows(windows, values)
        known = values[FOREST][np.isfinite(values[FOREST])]
        centre, usually = np.quantile(known, [0.5, 1.0 - settings.contamination]).tolist()
    most = {}
    for name in LEARNT:
        seen = np.concatenate([np.zeros(0), *(one[name] for one in parts)])
        n = dwell(windows, settings.dwell_s[dwell_name(name)])
        most[name] = max(held(seen, n), held(values.get(name, seen), n))
    most = {name: round(one, 6) for name, one in most.items() if np.isfinite(one)}
    monitor = Monitor(
        days=days, bundle=state.bundle, loads=loads, most=most, centre=round(centre, 6),
        limits={name: _limit(name, one, centre, usually, settings) for name, one in most.items()},
        features=() if known_good is None else known_good.names,
        lacking={n: NOT_THERE if days else NO_DAYS for n in LEARNT if n not in most},
    )  # fmt: skip
    return Usual(monitor=monitor, known_good=known_good)


def _limit(
    name: str, most: float, centre: float, usually: float, settings: IncidentSettings
) -> float:
    if name == FOREST:
        return round(max(usually, centre + settings.margin * max(most - centre, 0.0)), 6)
    return round(max(fixed_limits(settings)[name], settings.margin * most), 6)


def _left_out(windows: Windows, settings: IncidentSettings) -> Iterator[dict[str, Floats]]:
    """Values of the rules on groups of days, each by what the other days have."""
    days = sorted(set(windows.day.tolist()))
    folds = [days[k::FOLDS] for k in range(min(FOLDS, len(days)))]
    for fold in folds if len(folds) > 1 else []:
        inside = np.isin(windows.day, fold)
        own, others = windows.where(inside), windows.where(~inside)
        loads = usual_loads(others, settings)
        found = rule_values(own, loads, settings)
        good = KnownGood.of(others, rule_values(others, loads, settings), settings)
        yield found | {FOREST: np.zeros(0) if good is None else good.windows(own, found)}
