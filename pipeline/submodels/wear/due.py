"""What wear does: growth of the edge forces, and the life that tools in use have left.

On the land of a worn flank pressure and friction act, so that edge forces grow as its width:
K_te = K_te0 + k_t VB and K_re = K_re0 + k_r VB (Smithey, Kapoor, DeVor 2000).  Mean forces of
milling are linear in the edge coefficients (:mod:`pipeline.cutting.force.force_law`).  The force
of the sharp tool is free for each tool and cut, so that runout, depth and the law of the chip are
none of the growth.  A recording counts by its relative error, since depth and hardness err in per
cent, and less where it lies apart (Huber).  Intervals leave out one tool after another: recordings
of one tool share its edges, its mounting and its batches.  Under chips thinner than the edge is
round a land carries less than this law says.

The wear of a tool now is what the signals of its last recording say, with the interval of the
model that says it.  The time left rests on that, on what was last read under the microscope, and on
its use alone.  Of tools that were used up it is counted how often the interval held.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pipeline.cutting.force.force_law import COEFFICIENTS, regressors
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.model import Parameter
from pipeline.schema.si import N_MM2, UM
from pipeline.schema.verdict import Fact
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.statistics import jackknife_half_width
from pipeline.submodels.wear.life import (
    Engaged,
    LifeLaw,
    TimeLeft,
    ToolUse,
    WearLifeSettings,
    engaged,
    fit_life,
    uses,
)

EDGE_NAMES = ("K_te_over_VB", "K_re_over_VB")
"""Order of the fitted coefficients, in N/mm of depth for each mm of land."""
UNIT = "N/mm^2"
EDGE = (COEFFICIENTS.index("K_te"), COEFFICIENTS.index("K_re"))
WHOLE = 0.85
"""Least force of a window against the greatest of its recording, so that the tool is all in [1]."""
HUBER = 1.5
"""Residual from which on a recording counts less, in robust standard deviations."""
PLANE = 1.177
"""Median size of a plane normal distribution of standard deviation 1 [1]."""
ROUNDS = 30
FEWEST = 3
"""Least number of tools for an interval."""
SOON = 0.15
"""Share of a life below which the least time left makes a tool due soon [1]."""


@dataclass(frozen=True, kw_only=True)
class EdgeGrowth:
    """Contribution of wear to the edge coefficients, as stored."""

    parameters: Mapping[str, Parameter]
    """Parameters by ``EDGE_NAMES``."""
    tools: int
    recordings: int
    """Tools and recordings that they were fitted on."""
    wear_um: tuple[float, float]
    """Least and greatest wear of those."""
    error_percent: float
    """Median of the relative error of the mean force after the fit."""
    material: str = ""
    """Material of conf/material/ that was cut; empty where nobody said it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MeanForces:
    """Mean forces of M recordings with the tool all in the material."""

    force: Floats
    """Force on the tool along the feed and to the left of it [N]; shape (M, 2)."""
    land: Floats
    """Area by which each of ``EDGE_NAMES`` adds to it [m^2]: design of the edge coefficients times
    the wear; shape (M, 2, 2)."""
    wear: Floats
    """Wear [um]; shape (M,)."""
    tool: np.ndarray
    """Tool of each row; shape (M,)."""
    cut: Ints
    """Number of the tool and its cut: one sharp force each; shape (M,)."""

    def of(self, rows: Bools) -> "MeanForces":
        """Some of the recordings."""
        return MeanForces(
            force=self.force[rows], land=self.land[rows], wear=self.wear[rows],
            tool=self.tool[rows], cut=self.cut[rows],
        )  # fmt: skip


def mean_forces(windows: WearWindows, settings: WearLifeSettings) -> MeanForces:
    """Mean forces and what a land adds to them, one row a recording."""
    cuts = engaged(windows, settings)
    each = np.stack([_channel(windows, settings, axis) for axis in ("feed", "normal")], axis=1)
    _, first, place = np.unique(windows.recording, return_index=True, return_inverse=True)
    size, greatest = np.hypot(each[:, 0], each[:, 1]), np.zeros(len(first))
    np.maximum.at(greatest, place, size)
    kept = size >= WHOLE * greatest[place]
    count = np.bincount(place[kept], minlength=len(first))
    sums = [np.bincount(place[kept], each[kept, k], minlength=len(first)) for k in (0, 1)]
    wear = np.asarray(windows.wear[first], np.float64)
    return MeanForces(
        force=np.stack(sums, axis=1) / count[:, None], wear=wear, tool=windows.tool[first],
        land=_edges(cuts, first) * (wear * UM)[:, None, None], cut=_cut(windows, cuts, first),
    )  # fmt: skip


def _channel(windows: WearWindows, settings: WearLifeSettings, axis: str) -> Floats:
    """Mean of a force on the tool in each window [N], shape (N,)."""
    named = {str(k): v for k, v in settings.forces.items()}.get(axis, "")
    name = named.removeprefix("-")
    if name not in windows.channels:
        raise ValueError(
            f"wear_life.forces.{axis} = {named!r} is no channel of the windows: use one of "
            f"{', '.join(windows.channels)}"
        )
    mean: Floats = windows.values[:, windows.channels.index(name)].mean(axis=1, dtype=np.float64)
    return -mean if named.startswith("-") else mean


def _edges(cuts: Engaged, at: Ints) -> Floats:
    """Mean F_x, F_y for each edge coefficient [m], shape (M, 2, 2)."""
    every = regressors(
        flutes=cuts.flutes[at], f_z=cuts.f_z[at], a_p=cuts.a_p[at], phi_st=cuts.phi_st[at],
        phi_ex=cuts.phi_ex[at],
    )  # fmt: skip
    return every[:, :2][:, :, list(EDGE)]


def _cut(windows: WearWindows, cuts: Engaged, at: Ints) -> Ints:
    """Number of the tool and its cut of recordings, shape (M,)."""
    _, tool = np.unique(windows.tool[at], return_inverse=True)
    told = (cuts.v_c, cuts.f_z, cuts.a_p, cuts.phi_st, cuts.phi_ex)
    columns = np.column_stack([tool, *(np.round(one[at], 9) for one in told)])
    _, number = np.unique(columns, axis=0, return_inverse=True)
    return np.asarray(number, np.int64).ravel()


def fit_edge_growth(windows: WearWindows, settings: WearLifeSettings) -> EdgeGrowth:
    """Growth of the edge coefficients over the wear of three training tools or more."""
    rows = mean_forces(windows, settings)
    tools = sorted(set(rows.tool.tolist()))
    if len(tools) < FEWEST:
        raise ValueError(
            f"edge forces over wear need {FEWEST} tools, there are {len(tools)}: record more"
        )
    found, error = _robust(rows)
    half = jackknife_half_width(np.array([_robust(rows.of(rows.tool != one))[0] for one in tools]))
    method = f"mean forces of {len(rows.wear)} cuts, {len(tools)} tools left out in turn"
    parameters = {
        name: _parameter(float(value) / N_MM2, float(width) / N_MM2, method)
        for name, value, width in zip(EDGE_NAMES, found, half, strict=True)
    }
    return EdgeGrowth(
        parameters=parameters, tools=len(tools), recordings=len(rows.wear),
        error_percent=100 * error, wear_um=(float(rows.wear.min()), float(rows.wear.max())),
        material=settings.material,
    )  # fmt: skip


def _parameter(value: float, half: float, method: str) -> Parameter:
    ends = (value - half, value + half)
    if ends[0] <= 0.0:
        return Parameter(
            value=None, unit=UNIT, interval_95=None, determined=False,
            method=f"its 95 % interval, {ends[0]:.3g} to {ends[1]:.3g} {UNIT}, reaches zero",
            remedy="record cuts of tools over their whole life, from new to worn",
        )  # fmt: skip
    return Parameter(value=value, unit=UNIT, interval_95=ends, determined=True, method=method)


def _robust(rows: MeanForces) -> tuple[Floats, float]:
    """Slopes [Pa], shape (2,), by weighted least squares; median of the relative error [1]."""
    size = np.hypot(rows.force[:, 0], rows.force[:, 1])[:, None]
    _, cut = np.unique(rows.cut, return_inverse=True)
    sharp = np.zeros((len(size), 2, cut.max() + 1, 2))
    for axis in (0, 1):
        sharp[np.arange(len(size)), axis, cut, axis] = 1.0
    design = np.concatenate([rows.land, sharp.reshape(len(size), 2, -1)], axis=2)
    x = (design / size[..., None]).reshape(2 * len(size), -1)
    y, unit = (rows.force / size).ravel(), np.linalg.norm(x, axis=0)
    weight, off = np.ones(len(size)), np.zeros(len(size))
    found = np.zeros(x.shape[1])
    for _ in range(ROUNDS):
        root = np.repeat(np.sqrt(weight), 2)
        found = np.linalg.lstsq(x / unit * root[:, None], y * root, rcond=None)[0] / unit
        off = np.hypot(*(y - x @ found).reshape(-1, 2).T)
        usual = max(float(np.median(off)), 1e-9)
        weight = np.minimum(1.0, HUBER * usual / PLANE / np.maximum(off, 1e-12))
    return found[:2], float(np.median(off))


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


@dataclass(frozen=True, kw_only=True)
class DueTool:
    """A tool in use, with what was said of it; ``by_signals`` where those may be relied on."""

    name: str
    facts: Mapping[str, Fact]
    by_signals: bool

    def number(self, name: str) -> float | None:
        """Value of a fact; None where it is not there."""
        fact = self.facts.get(name)
        return fact.value if fact is not None and isinstance(fact.value, int | float) else None

    @property
    def rests_on(self) -> str:
        """Basis of the remaining time: the more precise of reading and signals, else its use."""
        allowed = (READING, SIGNALS) if self.by_signals else (READING,)
        known = [one for one in allowed if self.number(left_names(one)[1]) is not None]
        return min(known, key=lambda one: self._left(one)[2] - self._left(one)[0], default=USE)

    @property
    def left(self) -> tuple[float, float, float]:
        """Time left [min]: lower end of the 90 % interval, median, upper end."""
        return self._left(self.rests_on)

    def _left(self, rests_on: str) -> tuple[float, float, float]:
        low, middle, high = (self.number(name) or 0.0 for name in left_names(rests_on))
        return low, middle, high

    @property
    def status(self) -> str:
        """``failed`` where it is worn, ``unknown`` where it is due soon, else ``passed``."""
        low, middle, _ = self.left
        if middle <= 0:
            return "failed"
        return "unknown" if low < SOON * (self.number(LIFE) or 0.0) else "passed"

    @property
    def within(self) -> float:
        """Time in the cut within which that is to be done [min]."""
        return self.left[0] / 2 if self.status == "passed" else self.left[0]
