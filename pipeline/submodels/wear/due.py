"""Remaining life of tools in use: their wear now, and the time in the cut until the criterion.

Its wear now is what the signals of its last recording say, with the interval of the model that
says it.  The time left is told by that, by what was last read under the microscope, and by its use
alone.  Of tools that were used up it is counted how often the interval held.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.model import Parameter
from pipeline.schema.verdict import Fact
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.wear.edge_growth import EdgeGrowth, fit_edge_growth
from pipeline.submodels.wear.life import (
    LifeLaw,
    TimeLeft,
    ToolUse,
    WearLifeSettings,
    fit_life,
    uses,
)

NORMAL_90 = 1.645
"""Half of a 90 % interval in standard deviations of a normal distribution [1]."""
MINUTES = "min"
IN_USE, TYPE, TIME, READ, READ_AT = "in use", "type", "time in cut", "wear read", "read at"
NOW, NOW_LOW, NOW_HIGH = "wear now", "wear now, low", "wear now, high"
LIFE, LIFE_LOW, LIFE_HIGH = "life of such a tool", "life, low", "life, high"
NO_ESTIMATE = "no time left is told"
ESTIMATES, HELD = "times left that were told", "of those inside the 90 % interval"
"""Names of the facts of a tool."""
SIGNALS, READING, USE = "signals", "reading", "use alone"
"""Basis of the remaining time."""


def left_names(rests_on: str) -> tuple[str, str, str]:
    """Names of the facts of the time left: its lower end, its median, its upper end."""
    name = f"time left by {rests_on}"
    return f"{name}, low", name, f"{name}, high"


@dataclass(frozen=True, kw_only=True)
class Lasting:
    """Life and forces of worn tools, as stored; None with the reason where records do not tell."""

    life: LifeLaw | None = None
    """Life until the criterion."""
    edges: EdgeGrowth | None = None
    """Growth of the edge forces."""
    reasons: tuple[str, ...] = ()
    """Reason for a missing one; empty where none was requested."""


def fit_lasting(windows: WearWindows, settings: WearLifeSettings) -> Lasting:
    """Life and edge forces from windows of training tools, as far as the settings ask for them."""
    life, edges, reasons = None, None, []
    if windows.is_class or settings.criterion_um is None:
        return Lasting()
    try:
        life = fit_life(uses(windows, settings), settings)
    except ValueError as error:
        reasons.append(str(error))
    if settings.forces:
        try:
            edges = fit_edge_growth(windows, settings)
        except ValueError as error:
            reasons.append(str(error))
    return Lasting(life=life, edges=edges, reasons=tuple(reasons))


def parameters(lasting: Lasting) -> dict[str, Mapping[str, Parameter]]:
    """Identified parameters, by group."""
    found: dict[str, Mapping[str, Parameter]] = {}
    if lasting.life is not None:
        found["life"] = lasting.life.parameters()
    if lasting.edges is not None:
        found["edge force"] = lasting.edges.parameters
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """Wear of a tool at its last recording by its signals [um]; NaN ends without an interval."""

    wear: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Standard deviation [um]."""
        return (self.high - self.low) / (2 * NORMAL_90)


def due_facts(
    windows: WearWindows, estimate: Estimate, law: LifeLaw, settings: WearLifeSettings
) -> dict[str, Fact]:
    """Facts of one tool: wear now, time left, share of such times that held, or a reason."""
    try:
        use = uses(windows, settings)[0]
    except ValueError as error:
        return {NO_ESTIMATE: Fact(value=str(error))}
    if use.kind not in law.kinds or not np.isfinite([use.v_c, use.rubbing, use.time[-1]]).all():
        return {NO_ESTIMATE: Fact(value="no tool of its type was worn, or its cuts are not known")}
    facts = {TYPE: Fact(value=use.kind)} | _held(use, law)
    if use.tool not in settings.in_use:
        return facts
    now, life = float(use.time[-1]), law.life(use.kind, use.v_c, use.rubbing)
    facts |= _left(USE, _later(life, now))
    there = np.flatnonzero(np.isfinite(use.read))
    if there.size:
        at, read = float(use.time[there[-1]]), float(use.read[there[-1]])
        told = law.left(use, now=at, wear=read, error=law.reading_error_um)
        facts |= {READ: Fact(value=read, unit="um"), READ_AT: _minutes(at)}
        facts |= _left(READING, _later(told, now - at))
    if np.isfinite(estimate.error):
        told = law.left(use, now=now, wear=estimate.wear, error=estimate.error)
        facts |= _left(SIGNALS, told)
    return facts | {
        IN_USE: Fact(value="yes"), TIME: _minutes(now), NOW: _micrometres(estimate.wear),
        NOW_LOW: _micrometres(estimate.low), NOW_HIGH: _micrometres(estimate.high),
        LIFE: _minutes(life.middle), LIFE_LOW: _minutes(life.low), LIFE_HIGH: _minutes(life.high),
    }  # fmt: skip


def _left(rests_on: str, left: TimeLeft) -> dict[str, Fact]:
    told = (left.low, left.middle, left.high)
    return {n: _minutes(v) for n, v in zip(left_names(rests_on), told, strict=True)}


def _later(left: TimeLeft, minutes: float) -> TimeLeft:
    ends: Floats = np.maximum(np.array([left.low, left.middle, left.high]) - minutes, 0.0)
    return TimeLeft(low=float(ends[0]), middle=float(ends[1]), high=float(ends[2]))


def _held(use: ToolUse, law: LifeLaw) -> dict[str, Fact]:
    """Check on a tool that reached the criterion: how often the time left by a reading held."""
    there = np.isfinite(use.read)
    time, read = use.time[there], use.read[there]
    if not read.size or read.max() < law.criterion_um:
        return {}
    rising = np.maximum.accumulate(read) + 1e-9 * np.arange(read.size)
    worn = float(np.interp(law.criterion_um, rising, time))
    told = [
        (law.left(use, now=t, wear=w, error=law.reading_error_um), worn - t)
        for t, w in zip(time.tolist(), read.tolist(), strict=True)
        if w < law.criterion_um and t < worn
    ]
    if not told:
        return {}
    inside = sum(one.low <= left <= one.high for one, left in told)
    return {
        ESTIMATES: Fact(value=float(len(told)), unit="1"),
        HELD: Fact(value=float(inside), unit="1"),
    }


def _minutes(value: float) -> Fact:
    return Fact(value=float(f"{value:.4g}"), unit=MINUTES)


def _micrometres(value: float) -> Fact:
    return Fact(value=float(f"{value:.4g}") if np.isfinite(value) else None, unit="um")


def held(facts: Mapping[str, Mapping[str, Fact]]) -> tuple[int, int]:
    """Number of predicted times left, and of those that held, over all tools."""
    pairs = [(one[ESTIMATES].value, one[HELD].value) for one in facts.values() if ESTIMATES in one]
    told, inside = (sum(float(str(one[k])) for one in pairs) for k in (0, 1))
    return int(told), int(inside)
