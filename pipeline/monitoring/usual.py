"""What is usual for a machine, learnt from its known-good days: limits, loads, the forest.

A rule's limit is the most that it held over its dwell on a known-good day that was left out of what
it was learnt from, times a margin; for residuals at least a multiple of the twin's own interval.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.monitoring.forest import KnownGood, feature_names, features
from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.rules import RULES, dwell_name, fixed_limits, rule_values, usual_loads
from pipeline.monitoring.windows import Windows, dwell, held, windows_of
from pipeline.schema.arrays import Floats
from pipeline.schema.incident import Monitor
from pipeline.schema.twin_state import TwinState

LEARNT = tuple(name for name, rule in RULES.items() if rule.learnt and name != "forest")
FOREST = "forest"
NO_DAYS = "there is no known-good day: name training days in the section roles of the machine"
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
    windows = windows_of(state, folder, clean, days, settings)
    loads = usual_loads(windows, settings)
    left_out = _left_out(windows, settings)
    most = {name: held(left_out[name], dwell(windows, settings.dwell_s[dwell_name(name)]))
            for name in LEARNT}  # fmt: skip
    values = rule_values(windows, loads, settings)
    usual = values["cut_load_high"]
    names = feature_names(windows, settings)
    x, _ = features(windows, names, usual, settings)
    keep = np.isfinite(x).any(axis=0) if len(x) else np.zeros(len(names), bool)
    names = tuple(name for name, one in zip(names, keep, strict=True) if one)
    known_good, centre = None, 0.0
    if names and len(x) >= dwell(windows, settings.dwell_s[FOREST]):
        known_good = KnownGood.of(names, x[:, keep], settings)
        centre = float(np.median(known_good.scores(known_good.x)))
        most[FOREST] = held(left_out[FOREST], dwell(windows, settings.dwell_s[FOREST]))
    lacking = {name: "not in the records of the known-good days" if days else NO_DAYS
               for name in (*LEARNT, FOREST) if not np.isfinite(most.get(name, -np.inf))}  # fmt: skip
    limits = {name: _limit(name, most[name], centre, settings) for name in most
              if name not in lacking}  # fmt: skip
    monitor = Monitor(
        machine=state.machine, days=days, bundle=state.bundle, centre=round(centre, 6),
        most={name: round(one, 6) for name, one in most.items() if name not in lacking},
        limits=limits, loads=loads, features=names, lacking=lacking,
    )  # fmt: skip
    return Usual(monitor=monitor, known_good=known_good)


def _limit(name: str, most: float, centre: float, settings: IncidentSettings) -> float:
    if name == FOREST:
        return round(centre + settings.margin * max(most - centre, 0.0), 6)
    return round(max(fixed_limits(settings)[name], settings.margin * most), 6)


def _left_out(windows: Windows, settings: IncidentSettings) -> dict[str, Floats]:
    """Values of the learnt rules on each day by what the other days have."""
    days = sorted(set(windows.day.tolist()))
    folds = [days[k::FOLDS] for k in range(min(FOLDS, len(days)))]
    parts: dict[str, list[Floats]] = {name: [] for name in (*LEARNT, FOREST)}
    for fold in folds if len(folds) > 1 else []:
        inside = np.isin(windows.day, fold)
        own, others = windows.where(inside), windows.where(~inside)
        loads = usual_loads(others, settings)
        found = rule_values(own, loads, settings)
        for name in LEARNT:
            parts[name].append(found[name])
        names = feature_names(others, settings)
        x, _ = features(others, names, rule_values(others, loads, settings)["cut_load_high"],
                        settings)  # fmt: skip
        keep = np.isfinite(x).any(axis=0) if len(x) else np.zeros(len(names), bool)
        if not keep.any():
            continue
        good = KnownGood.of(tuple(n for n, k in zip(names, keep, strict=True) if k), x[:, keep],
                            settings)  # fmt: skip
        seen, _ = features(own, good.names, found["cut_load_high"], settings)
        parts[FOREST].append(good.scores(seen))
    return {name: np.concatenate([np.zeros(0), *some]) for name, some in parts.items()}
