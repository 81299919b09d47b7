"""Tool life from measured wear: time until the criterion, from tool to tool.

A flank wears with the length over which its teeth rub in the material, so that lives under
different cuts are compared by that length: time in the cut times v_c (phi_ex - phi_st) / 2 pi,
averaged over the cuts that a tool makes.  Its logarithm until the criterion is a line over log
v_c with an offset for each type of tool; the slope starts at that of Taylor's V T^n = C, 1 - 1/n.
Its scatter from tool to tool starts at 0.25 (Rossetto, Levi 1977, have lives scatter by 0.15 to
0.35) with the weight of three tools; five tools alone would not tell it.  The estimate is Bayes'
with normal-inverse-gamma priors, the prediction of a further tool a t distribution (Gelman et
al., *Bayesian Data Analysis*, 3rd ed., ch. 14).

How far a tool is through its life the training tools tell too: the share of the length that was
spent when the land had each width.  What was read or estimated of a tool in use corrects its own
life by that; the more precise of the two counts.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from pipeline.cutting.economics.material import Taylor, life
from pipeline.schema.arrays import Floats
from pipeline.schema.model import Parameter
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged
from pipeline.schema.si import MINUTE, MM
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.statistics import student_quantile

EXPONENT = 0.25
"""Taylor's n of cemented carbide where the machine's file has none [1]."""
SLOPE_SCATTER, KIND_SCATTER = 1.0, 0.3
"""Prior standard deviations of the slope over log v_c, of a type's offset [1]."""
TOOL_SCATTER, WEIGHT = 0.25, 3.0
"""Prior scatter of log life from tool to tool [1], and the tools that it weighs [1]."""
LEVELS = np.linspace(0.1, 1.0, 19)
"""Widths of the land against the criterion of the shares of life [1]."""
FEWEST = 3
"""Least number of worn tools for a life."""


@dataclass(frozen=True, kw_only=True)
class CutterShape(Ranged, section="wear_life.cutters"):
    """Shape of a tool by its type."""

    diameter_mm: Annotated[float, Range(above=0.0, most=500.0, unit="mm")]
    flutes: Annotated[int, Range(least=1, most=50)]


@dataclass(frozen=True, kw_only=True)
class WearLifeSettings(Ranged, section="wear_life"):
    """Wear criterion, tools in use, and description of their cuts."""

    criterion_um: Positive | None = None
    """Flank wear VB at which a tool is changed [um]; None where no lives are needed."""
    reading_error_um: NotNegative = 3.0
    """Standard deviation of a measured VB [um]."""
    in_use: tuple[str, ...] = ()
    """Tools that are in the machine now."""
    kind: str = ""
    """Condition that names a tool's type; empty where there is one only."""
    cutters: Mapping[str, CutterShape] = field(default_factory=dict)
    """Shapes by tool type."""
    speed: str = "spindle_speed"
    feed: str = "feed"
    depth: str = "axial_depth"
    width: str = "radial_depth"
    """Conditions of a recording: spindle speed, feed, axial and radial depth."""
    cut: str = "cut_type"
    up: tuple[str, ...] = ()
    """Condition that names the cut, and its words where teeth enter without a chip (up-milling)."""
    forces: Mapping[Literal["feed", "normal"], str] = field(default_factory=dict)
    """Channel of the force on the tool along the feed and to the left of it, with ``-`` before it
    where it points the other way, as that on the workpiece does; empty without forces."""
    material: str = ""
    """Material of conf/material/ that the tools cut; the growth of forces holds for it."""
    taylor: Taylor | None = None
    """Catalogue constants of these tools in this material."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Engaged:
    """Geometry of the cuts of N windows, by their conditions."""

    kind: np.ndarray
    """Type of tool; shape (N,)."""
    flutes: Floats
    v_c: Floats
    f_z: Floats
    a_p: Floats
    phi_st: Floats
    phi_ex: Floats
    """Teeth [1], cutting speed [m/min], feed per tooth [m], axial depth [m], arc of a tooth [rad];
    shape (N,)."""

    @property
    def rubbing(self) -> Floats:
        """Length over which a tooth rubs for each minute in the cut [m/min], shape (N,)."""
        return self.v_c * (self.phi_ex - self.phi_st) / (2 * np.pi)


def engaged(windows: WearWindows, settings: WearLifeSettings) -> Engaged:
    """Cuts of windows."""

    def number(name: str, unit: str) -> Floats:
        if name not in windows.condition_units:
            raise ValueError(
                f"wear_life: {name!r} is no condition with a unit: name it in "
                "wear_records.continuous"
            )
        factor, offset = conversion(windows.condition_units[name], unit)
        return np.asarray(windows.conditions[name], np.float64) * factor + offset

    kind = _words(windows, settings.kind)
    if strange := sorted(set(kind.tolist()) - set(settings.cutters)):
        raise ValueError(
            f"wear_life.cutters has no {strange[0]!r}: give its diameter and its number of flutes"
        )
    shapes = [settings.cutters[one] for one in kind.tolist()]
    diameter = np.array([one.diameter_mm for one in shapes])
    flutes = np.array([float(one.flutes) for one in shapes])
    speed = number(settings.speed, "rev/min")
    width = np.minimum(number(settings.width, "mm"), diameter)
    arc = np.arccos(np.clip(1.0 - 2.0 * width / diameter, -1.0, 1.0))
    up = np.isin(_words(windows, settings.cut), settings.up)
    return Engaged(
        kind=kind, flutes=flutes, v_c=np.pi * diameter * speed * MM,
        f_z=number(settings.feed, "mm/min") / (speed * flutes) * MM,
        a_p=number(settings.depth, "mm") * MM,
        phi_st=np.where(up, 0.0, np.pi - arc), phi_ex=np.where(up, arc, np.pi),
    )  # fmt: skip


def _words(windows: WearWindows, name: str) -> np.ndarray:
    if not name:
        return np.full(len(windows), "")
    if name not in windows.conditions:
        raise ValueError(f"wear_life: {name!r} is no condition: name it in wear_records.discrete")
    return np.asarray(windows.conditions[name], str)


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolUse:
    """Use of one tool over K recordings."""

    tool: str
    kind: str
    """Its name and its type."""
    time: Floats
    """Time in the cut since new [min]; shape (K,)."""
    read: Floats
    """Measured wear [um], NaN where nobody measured it; shape (K,)."""
    v_c: float
    rubbing: float
    """Mean cutting speed, mean length of rubbing for each minute [m/min]."""


def uses(windows: WearWindows, settings: WearLifeSettings) -> list[ToolUse]:
    """Use of each tool in windows, in the order of their names."""
    try:
        per, _ = conversion(windows.progress_unit, "min")
    except ValueError as error:
        raise ValueError(
            f"wear_life: the use of tools is told in {windows.progress_unit!r}: name the time in "
            "the cut as wear_records.progress"
        ) from error
    cuts, found = engaged(windows, settings), []
    for tool in sorted(set(windows.tool.tolist())):
        rows = np.flatnonzero(windows.tool == tool)
        _, first = np.unique(windows.recording[rows], return_index=True)
        at = rows[first]
        at = at[np.argsort(windows.progress[at], kind="stable")]
        found.append(ToolUse(
            tool=tool, kind=str(cuts.kind[at[0]]),
            time=np.asarray(windows.progress[at], np.float64) * per,
            read=np.where(windows.measured[at], windows.wear[at], np.nan),
            v_c=float(cuts.v_c[at].mean()), rubbing=float(cuts.rubbing[at].mean()),
        ))  # fmt: skip
    return found


@dataclass(frozen=True, kw_only=True)
class WornTool:
    """Tool at the criterion: time [min], rubbing length [m], catalogue life [min] or None."""

    tool: str
    kind: str
    v_c_m_min: float
    minutes: float
    length_m: float
    catalogue_minutes: float | None = None


@dataclass(frozen=True, kw_only=True)
class LifeLaw:
    """Life of tools of one machine and material, as stored."""

    criterion_um: float
    reading_error_um: float
    """Criterion, and standard deviation of a reading, by the settings [um]."""
    worn: tuple[WornTool, ...]
    """Tools that it was fitted on."""
    kinds: tuple[str, ...]
    """Types, in the order of their offsets."""
    v_ref_m_min: float
    """Cutting speed at which the offsets hold."""
    mean: tuple[float, ...]
    """Estimate of log length [log m]: intercept, offset of each type, slope over log v_c."""
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of ``mean``, over ``scale`` squared."""
    scale: float
    dof: float
    """Scale of the t distribution of tools about the line [1], its degrees of freedom."""
    share_mean: tuple[float, ...]
    share_sd: tuple[float, ...]
    """Logarithm of the share of the length spent, mean and deviation, at each of ``LEVELS`` [1]."""

    def log_length(self, kind: str, v_c: float) -> tuple[float, float]:
        """Centre and scale of a further tool's log length until the criterion [log m]."""
        x = _row(kind, v_c, self.kinds, self.v_ref_m_min)
        spread = 1.0 + float(x @ np.array(self.covariance) @ x)
        return float(x @ np.array(self.mean)), self.scale * np.sqrt(spread)

    def life(self, kind: str, v_c: float, rubbing: float) -> "TimeLeft":
        """Life of a further tool from new, with its 90 % interval from tool to tool."""
        centre, scale = self.log_length(kind, v_c)
        return _left(centre, scale, self.dof, 0.0, rubbing)

    def left(self, use: ToolUse, *, now: float, wear: float, error: float) -> "TimeLeft":
        """Time in the cut left of a tool of wear ``wear`` +- ``error`` [um] at ``now`` [min]."""
        if wear >= self.criterion_um:
            return TimeLeft(low=0.0, middle=0.0, high=0.0)
        centre, scale = self.log_length(use.kind, use.v_c)
        spent, level = now * use.rubbing, wear / self.criterion_um
        if spent > 0 and level > LEVELS[0]:
            shares = np.array(self.share_mean)
            share, spread = (
                np.interp(level, LEVELS, shares),
                np.interp(level, LEVELS, self.share_sd),
            )
            steep = np.interp(level, LEVELS, np.gradient(shares, LEVELS))
            own = np.hypot(spread, steep * error / self.criterion_um)
            weight = scale**2 / (scale**2 + own**2)
            centre += weight * (np.log(spent) - share - centre)
            scale *= np.sqrt(1.0 - weight)
        return _left(float(centre), float(scale), self.dof, spent, use.rubbing)

    def parameters(self) -> dict[str, Parameter]:
        """Median life length of each type, exponent and scatter, with their 95 % intervals."""
        from scipy.special import gammaincinv

        quantile, cov = student_quantile(self.dof), np.array(self.covariance)
        n = len(self.worn)
        method = f"measured wear of {n} tools, Bayes with Taylor's exponent and usual scatter"
        found = {}
        for kind in self.kinds:
            x = _row(kind, self.v_ref_m_min, self.kinds, self.v_ref_m_min)
            half = quantile * self.scale * float(np.sqrt(x @ cov @ x))
            middle = float(x @ np.array(self.mean))
            found[f"life_length_{kind}" if kind else "life_length"] = Parameter(
                value=float(np.exp(middle)), unit="m", determined=True, method=method,
                interval_95=(float(np.exp(middle - half)), float(np.exp(middle + half))),
            )  # fmt: skip
        slope, half = self.mean[-1], quantile * self.scale * float(np.sqrt(cov[-1, -1]))
        ends = (1 - slope - half, 1 - slope + half)
        sure = half < 0.5 * SLOPE_SCATTER and ends[0] > 0
        found["inverse_taylor_exponent"] = Parameter(
            value=1 - slope if sure else None, unit="1", interval_95=ends if sure else None,
            determined=sure,
            method=method if sure else "speeds of the tools lie too close: it is as assumed",
            remedy="" if sure else "wear tools at speeds that differ by a third",
        )  # fmt: skip
        found["tool_scatter"] = Parameter(
            value=self.scale, unit="1", determined=True, method=method,
            interval_95=(
                float(self.scale * np.sqrt(0.5 * self.dof / gammaincinv(0.5 * self.dof, 0.975))),
                float(self.scale * np.sqrt(0.5 * self.dof / gammaincinv(0.5 * self.dof, 0.025))),
            ),
        )  # fmt: skip
        return found


@dataclass(frozen=True, kw_only=True)
class TimeLeft:
    """Time in the cut until the criterion [min]: median and ends of the 90 % interval."""

    low: float
    middle: float
    high: float


def _left(centre: float, scale: float, dof: float, spent: float, rubbing: float) -> TimeLeft:
    """Quantiles of the remaining length, of a tool that has passed ``spent`` [m]."""
    from scipy.special import stdtr, stdtrit

    below = float(stdtr(dof, (np.log(spent) - centre) / scale)) if spent > 0 else 0.0
    shares = below + np.array([0.05, 0.5, 0.95]) * (1.0 - below)
    lengths = np.exp(centre + scale * stdtrit(dof, np.minimum(shares, 1.0 - 1e-12)))
    low, middle, high = (np.maximum(lengths - spent, 0.0) / rubbing).tolist()
    return TimeLeft(low=low, middle=middle, high=high)


def _row(kind: str, v_c: float, kinds: Sequence[str], v_ref: float) -> Floats:
    own = [1.0 if kind == one else 0.0 for one in kinds]
    return np.array([1.0, *own, np.log(v_c / v_ref)])


def fit_life(tools: Sequence[ToolUse], settings: WearLifeSettings) -> LifeLaw:
    """The life law of three training tools or more that were measured up to the criterion."""
    limit = settings.criterion_um
    if limit is None:
        raise ValueError("no tool life: give wear_life.criterion_um, the wear at which tools go")
    worn, shares = [], []
    for use in tools:
        curve = _curve(use)
        if curve is None or curve[1][-1] < limit:
            continue
        minutes = float(np.interp(limit, curve[1], curve[0]))
        worn.append(WornTool(
            tool=use.tool, kind=use.kind, v_c_m_min=use.v_c, minutes=minutes,
            length_m=minutes * use.rubbing, catalogue_minutes=_catalogue(use, settings),
        ))  # fmt: skip
        shares.append(np.log(np.interp(LEVELS * limit, curve[1], curve[0]) / minutes))
    if len(worn) < FEWEST:
        raise ValueError(
            f"no tool life: {FEWEST} tools measured up to VB = {limit:g} um are needed, there "
            f"{'is' if len(worn) == 1 else 'are'} {len(worn)}: measure more until they are changed"
        )
    kinds = tuple(sorted({one.kind for one in worn}))
    v_ref = float(np.exp(np.mean([np.log(one.v_c_m_min) for one in worn])))
    n_taylor = EXPONENT if settings.taylor is None else settings.taylor.n
    x = np.array([_row(one.kind, one.v_c_m_min, kinds, v_ref) for one in worn])
    y = np.log([one.length_m for one in worn])
    prior = np.array([0.0, *[0.0] * len(kinds), 1.0 - 1.0 / n_taylor])
    precision = np.diag(
        [1e-6, *[(TOOL_SCATTER / KIND_SCATTER) ** 2] * len(kinds),
         (TOOL_SCATTER / SLOPE_SCATTER) ** 2]
    )  # fmt: skip
    whole = precision + x.T @ x
    mean = np.linalg.solve(whole, precision @ prior + x.T @ y)
    off, from_prior = y - x @ mean, mean - prior
    dof = WEIGHT + len(worn) - 1
    squares = float(off @ off + from_prior @ precision @ from_prior)
    variance = (WEIGHT * TOOL_SCATTER**2 + squares) / dof
    spread = np.std(shares, axis=0, ddof=1) * np.sqrt(1 + 1 / len(worn))
    return LifeLaw(
        criterion_um=limit, reading_error_um=settings.reading_error_um, worn=tuple(worn),
        kinds=kinds, v_ref_m_min=v_ref, mean=tuple(mean.tolist()),
        covariance=tuple(map(tuple, np.linalg.inv(whole).tolist())),
        scale=float(np.sqrt(variance)), dof=float(dof),
        share_mean=tuple(np.mean(shares, axis=0).tolist()), share_sd=tuple(spread.tolist()),
    )  # fmt: skip


def _catalogue(use: ToolUse, settings: WearLifeSettings) -> float | None:
    """Life of the tool by the catalogue's constants [min]."""
    if settings.taylor is None:
        return None
    reference = {"f_z": settings.taylor.f_z_ref_mm, "a_p": settings.taylor.a_p_ref_mm,
                 "a_e": settings.taylor.a_e_ref_mm}  # fmt: skip
    conditions = {name: value * MM for name, value in reference.items() if value is not None}
    return float(life(settings.taylor, use.v_c / MINUTE, conditions)) / MINUTE  # type: ignore[arg-type]


def _curve(use: ToolUse) -> tuple[Floats, Floats] | None:
    """Times [min] and wear [um] of the readings of a tool from new, wear rising; None without."""
    there = np.isfinite(use.read)
    if not there.any():
        return None
    time = np.concatenate([[0.0], use.time[there]])
    wear = np.maximum.accumulate(np.concatenate([[0.0], use.read[there]]))
    return time, wear + 1e-9 * np.arange(wear.size)  # so that a width has one time
