"""Loads of a part in draws of its uncertain quantities, and 90 % intervals of its forces.

The load of a station in a draw is its own nominal load, of the load table, and by how much the load
of its class' representative R changes in that draw:

    load(station, f_z, draw) = table(station, f_z) + w (load(R, f_z, draw) - load(R, f_z)),

with w what both loads are over each other in the table.  Stations of one tool are alike whose
engaged arcs begin and end in the same 5 degrees, whose depths differ by less than 10 %, and whose
slopes by less than 0.03.  A block has one candidate for each class among its critical stations,
those whose load comes near to its greatest, for in a draw another one may be the greatest.

Draws come from a scrambled Sobol sequence, which fills its cube more evenly than chance, so that
far quantiles settle with fewer draws (Owen 1998).  The load of each class' representative is
computed in each draw, over the feed for each tooth; candidates of the part follow their class.

The force intervals of a tool are those of the station with the greatest peak, and of that with the
greatest mean: quantiles of the draws, the load between them their median.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, log2
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import Engagement, engaged_arc
from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.optimisation.problem.limits import crossings
from pipeline.optimisation.reliability.uncertainty import CutRange, ToolUncertainty, Uncertainty
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats, Rows
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.files import keep, kept
from pipeline.schema.program_cut import ForceInterval
from pipeline.twin.cut.blocks import STEEP
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import figure

ALIKE_RAD = np.pi / 36
"""Angle by which engaged arcs of one class may differ at their ends [rad]."""
ALIKE_DEPTH = 1.1
"""Ratio of depths within one class."""
ALIKE_SLOPE = 0.03
WEIGHT = 1.25
"""Greatest w; the least is its inverse."""
ENDLESS = 1.0
"""Feed for each tooth from which on a load counts as not growing with it [m]."""
NEAR = 0.9
"""Share of a block's greatest load from which on a station is a candidate [1]."""
COEFFICIENTS, SIZE, ANGLE, MOUNTING, DEPTH = slice(0, 6), 6, 7, slice(8, 10), 10
DIMENSIONS = 11
"""Number of uncertain quantities of one tool."""
NODES = np.array([0.01, 0.1, 0.25, 0.42, 0.6, 0.8, 1.0])
"""Feeds at which a class is computed, over its greatest."""
CLOSE = 1.25
"""Ratio of two nodes next to each other, greater over less."""
FEW, MANY = 2, 6
DEPTHS = 7
"""Depths at which a class is computed."""
FLOOR = 1e-4
"""Height up to which material counts as lying on the tool's tip [m]."""
SKIN = 1e-6
"""Height that is left in the material [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Critical:
    """Q candidates in C classes."""

    row: Rows = field(repr=False)
    """Row of each candidate, never falling; shape (Q,)."""
    curve: Floats = field(repr=False)
    """Peak load over the nodes of the table, never falling [N]; shape (Q, K + 1)."""
    scale: Floats = field(repr=False)
    exponent: Floats = field(repr=False)
    """Exponent of the nodes of :class:`pipeline.cutting.force.load_table.LoadTable`; shape (Q,)."""
    own_station: Rows = field(repr=False)
    """Station with the greatest load at the middle of the table, of each candidate; shape (Q,)."""
    weight: Floats = field(repr=False)
    """Weight w of each candidate [1]; shape (Q,)."""
    group: Rows = field(repr=False)
    """Class of each; shape (Q,)."""
    station: Rows = field(repr=False)
    """Representative of each class; shape (C,)."""
    tool: Rows = field(repr=False)
    """Tool of each class, an index; shape (C,)."""
    rows: int
    """Number of rows M of the program."""

    def __len__(self) -> int:
        return len(self.row)

    @property
    def classes(self) -> int:
        """Number of classes C."""
        return len(self.station)

    @property
    def last_feeds(self) -> Floats:
        """f_z of the last node of each candidate's table [m]; shape (Q,)."""
        return ((self.curve.shape[1] - 2.0) ** 2 / self.scale) ** (1.0 / self.exponent)

    def over(self, limits_N: Floats) -> "Critical":
        """The same with loads over the limit of their tool, (T,) [N], in place of newtons."""
        limit = limits_N[self.tool][self.group]
        return replace(self, curve=self.curve / limit[:, None])

    def feeds(self, limit: float) -> Floats:
        """Greatest f_z up to which each stays within a load [m]; inf where none reaches it."""
        f_z = crossings(self.curve, self.scale, self.exponent, limit)
        return np.where(f_z < ENDLESS, f_z, np.inf)


def critical(cut: Cut, rows: Rows | None = None) -> Critical:
    """Candidates of all rows that cut at feed, or of ``rows`` alone."""
    engagement, table = cut.engagement, cut.table
    wanted = engagement.feed
    if rows is not None:
        among = np.zeros(engagement.blocks, dtype=np.bool_)
        among[rows] = True
        wanted = wanted & among[engagement.block]
    fed = np.flatnonzero(wanted)
    values = table.station_values[0]
    nodes = values.shape[1]
    middle = nodes // 2
    block = engagement.block[fed]
    load = values[table.station[fed], middle]
    greatest = np.zeros(engagement.blocks)
    np.maximum.at(greatest, block, load)
    near = (load >= NEAR * greatest[block]) & (load > 0)
    fed, block, load = fed[near], block[near], load[near]
    _, kind = np.unique(_kinds(cut, fed), axis=0, return_inverse=True)
    kind = kind.ravel()
    pair, member = np.unique(np.stack([block, kind], axis=1), axis=0, return_inverse=True)
    member = member.ravel()
    curve = np.zeros((len(pair), nodes))
    np.maximum.at(curve, member, values[table.station[fed]])
    first, candidate = _greatest_of(kind, load), _greatest_of(member, load)
    group = kind[candidate].astype(np.intp)
    return Critical(
        row=pair[:, 0].astype(np.intp),
        curve=np.maximum.accumulate(curve, axis=1),
        scale=table.scale[pair[:, 0]],
        exponent=table.exponent[pair[:, 0]],
        own_station=fed[candidate],
        weight=np.clip(load[candidate] / load[first][group], 1 / WEIGHT, WEIGHT),
        group=group,
        station=fed[first],
        tool=engagement.tool[fed[first]].astype(np.intp),
        rows=engagement.blocks,
    )


def _greatest_of(kind: NDArray[np.int64], load: Floats) -> Rows:
    """Index of the greatest load of each kind, counted from 0 without a gap."""
    order = np.lexsort((-load, kind))
    return order[np.flatnonzero(np.diff(kind[order], prepend=-1))]


def _kinds(cut: Cut, stations: Rows) -> NDArray[np.int64]:
    """Features that stations of one class share; shape (N, 8)."""
    engagement = cut.engagement
    lower, upper = engagement.lower[stations], engagement.upper[stations]
    height = np.where(upper > lower, upper - lower, 0.0).astype(np.float64)
    ahead = np.sin(engagement.angles) > 0
    begin, end = engaged_arc(np.where(ahead, height, 0.0))
    depth = np.maximum(height.max(axis=1, initial=0.0), 1e-9)
    many = np.maximum((height > 0).sum(axis=1), 1)
    columns = (
        engagement.tool[stations],
        np.nan_to_num(begin, nan=-1.0) / ALIKE_RAD,
        np.nan_to_num(end, nan=-1.0) / ALIKE_RAD,
        np.log(depth) / np.log(ALIKE_DEPTH),
        engagement.slope[stations] / ALIKE_SLOPE,
        np.sign(engagement.slope[stations]),  # a flat end cuts on its way down only
        np.log(many) / np.log(ALIKE_DEPTH),
        _ring_widths(engagement)[stations],
    )
    return np.round(np.stack(columns, axis=1)).astype(np.int64)


def _ring_widths(engagement: Engagement) -> Floats:
    """Width of each station's ring, in steps of ``ALIKE_DEPTH``; 0 where its end is whole."""
    widths, rings = np.zeros(len(engagement)), engagement.rings
    widths[rings.station] = np.log(np.maximum(rings.width, 1e-9)) / np.log(ALIKE_DEPTH)
    return widths


class ToolDraws(NamedTuple):
    """D draws of one tool."""

    coefficients: Floats
    """Coefficients K_tc, K_rc, K_ac, K_te, K_re, K_ae, SI; shape (D, 6)."""
    offsets: Floats
    """Offset of the tool's axis from the spindle's along the first tooth and across (D, 2) [m]."""
    depth: Floats
    """Depth by which it stands deeper [m]; shape (D,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """D draws of a part: those of each tool, by number, and the model's factor, shape (D,)."""

    tools: dict[int, ToolDraws]
    model: Floats

    def __len__(self) -> int:
        return len(self.model)

    def first(self, many: int) -> "Draws":
        """First ``many`` draws."""
        tools = {k: ToolDraws(*(part[:many] for part in one)) for k, one in self.tools.items()}
        return Draws(tools=tools, model=self.model[:many])


def draws_of(uncertain: Uncertainty, many: int, seed: int) -> Draws:
    """Draws D = ``many`` of each tool."""
    from scipy.special import ndtri

    numbers = sorted(uncertain.tools)
    common = 1 + len(uncertain.sources)
    places = _sobol(common + DIMENSIONS * len(numbers), many, seed)
    normal = ndtri(places)
    tools = {}
    for k, number in enumerate(numbers):
        own = slice(common + DIMENSIONS * k, common + DIMENSIONS * (k + 1))
        tool = uncertain.tools[number]
        shared = normal[:, 1 + tool.source] if tool.source >= 0 else np.zeros(many)
        tools[number] = _of_tool(tool, uncertain.depth, shared, normal[:, own], places[:, own])
    return Draws(tools=tools, model=np.maximum(1.0 + uncertain.model * normal[:, 0], 0.0))


def _of_tool(
    tool: ToolUncertainty, depth: float, shared: Floats, normal: Floats, places: Floats
) -> ToolDraws:
    scale = np.maximum(1.0 + tool.common * shared, 0.0)
    drawn = tool.mean * scale[:, None] + normal[:, COEFFICIENTS] @ tool.own.T
    drawn[:, [0, 3]] = np.maximum(drawn[:, [0, 3]], 0.0)  # a cut does not drive its tool
    size = np.abs(tool.runout + tool.runout_sd * normal[:, SIZE])
    angle = 2 * np.pi * places[:, ANGLE]
    offsets = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets += tool.mounting * normal[:, MOUNTING]
    return ToolDraws(coefficients=drawn, offsets=offsets, depth=depth * normal[:, DEPTH])


def _sobol(dimensions: int, many: int, seed: int) -> Floats:
    """Points (many, dimensions) of a Sobol sequence inside the unit cube, cached between runs."""
    power = ceil(log2(many))
    key = f"{dimensions}-{power}-{seed}-scipy-{scipy.__version__}-numpy-{np.__version__}"
    content = kept("sobol", key)
    if content is None or not _is_cube(content, dimensions << power):
        from scipy.stats.qmc import Sobol

        sequence = Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
        content = sequence.random_base2(power).astype("<f8").tobytes()
        keep("sobol", key, content)
    points = np.frombuffer(content, "<f8").reshape(-1, dimensions)[:many]
    least = 0.5**33
    return np.clip(points, least, 1.0 - least)


def _is_cube(content: bytes, many: int) -> bool:
    if len(content) != 8 * many:
        return False
    values = np.frombuffer(content, "<f8")
    return bool(((values >= 0) & (values <= 1)).all())


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """Loads of the representatives of C classes, in D draws."""

    f_z: Floats = field(repr=False)
    """Feeds, rising [m]; shape (C, K)."""
    expected: Floats = field(repr=False)
    """Loads without uncertainty [N]; shape (C, K)."""
    values: Floats = field(repr=False)
    """Loads in the draws [N]; shape (C, K, D)."""

    def over(self, candidates: Critical, limits_N: Floats) -> "Responses":
        """The same with loads over the limit of their tool, (T,) [N], in place of newtons."""
        limit = limits_N[candidates.tool][:, None]
        return replace(self, expected=self.expected / limit, values=self.values / limit[..., None])


def nodes_between(least: Floats, most: Floats) -> Floats:
    """Feeds of classes that span the given ones, shape (C, K)."""
    span = float((most / least).max(initial=1.0))
    many = int(np.clip(np.ceil(np.log(span) / np.log(CLOSE)) + 1, FEW, MANY))
    return np.geomspace(least, most * (1 + 1e-9), many, axis=1)


def responses(cut: Cut, candidates: Critical, f_z: Floats, draws: Draws) -> Responses:
    """Loads of all representatives at feeds of shape (C, K)."""
    values, expected = np.empty((*f_z.shape, len(draws))), np.empty(f_z.shape)

    def fill(one: int) -> None:
        drawn = draws.tools[cut.numbers[candidates.tool[one]]]
        _fill(cut, int(candidates.station[one]), f_z[one], drawn, expected[one], values[one])

    mapped(fill, range(candidates.classes), compute="threads")
    values *= draws.model
    return Responses(f_z=f_z, expected=expected, values=values)


def station_loads(cut: Cut, station: int, drawn: ToolDraws, *, mean: bool = False) -> Floats:
    """Peak, or mean, of a station's load at the feed of the plan in D draws of its tool [N].

    Load of the table, and its change in each draw; shape (D,).
    """
    f_z = cut.feed_per_tooth[[cut.engagement.block[station]]]
    expected, values = np.zeros(1), np.zeros((1, len(drawn.depth)))
    _fill(cut, station, f_z, drawn, expected, values, mean=mean)
    loads = cut.station_loads.mean if mean else cut.station_loads.peak
    return np.maximum(loads[station] + values[0] - expected[0], 0.0)


def _fill(
    cut: Cut, station: int, f_z: Floats, drawn: ToolDraws, expected: Floats, out: Floats, *,
    mean: bool = False,
) -> None:  # fmt: skip
    """Fill ``expected`` of shape (K,) and ``out`` of shape (K, D) for one station: peak or mean."""
    engagement = cut.engagement
    tool, law = cut.tools[engagement.tool[station]], cut.force_laws[engagement.tool[station]]
    slope = float(engagement.slope[station])
    lower = engagement.lower[station].astype(np.float64)
    upper = engagement.upper[station].astype(np.float64)
    nominal = np.concatenate([law.cutting, law.edge])[np.newaxis]
    offset = tool.runout * np.array([[np.cos(tool.runout_angle), np.sin(tool.runout_angle)]])

    ring = engagement.rings.of(station)
    turn = edge_turn(tool, lower, upper, slope=slope, ring=ring)
    loads = partial(drawn_loads, f_z=f_z, m_c=law.m_c, mean=mean)
    expected[:] = loads(turn, nominal, offset)[:, 0]
    out[:] = loads(turn, drawn.coefficients, drawn.offsets)
    reach = float(np.abs(drawn.depth).max(initial=0.0))
    if reach == 0.0 or tool.kind == "drill" or abs(slope) > STEEP or not (expected > 0).all():
        return
    depths = np.linspace(-reach, reach, DEPTHS)
    turns = (
        edge_turn(tool, *deeper(lower, upper, depth, slope), slope=slope, ring=ring)
        for depth in depths.tolist()
    )
    shifted = np.stack([loads(one, nominal, offset)[:, 0] for one in turns])
    for k in range(len(f_z)):
        out[k] *= np.interp(drawn.depth, depths, shifted[:, k] / expected[k])


def deeper(lower: Floats, upper: Floats, depth: float, slope: float = 0.0) -> tuple[Floats, Floats]:
    """Heights in the material of a tool that stands deeper by ``depth`` [m]; no arc changes.

    What lies on the tool's tip stays there, for the material below is as much as before; on its way
    down a tool's end stays in the material at any depth, and over a hole its ring stays as wide.
    """
    there = upper > lower
    least = SKIN if slope < 0 else 0.0
    raised = np.where(there, np.maximum(upper + depth, least), upper)
    low = np.where(there & (lower > 2 * FLOOR), np.maximum(lower + depth, 0.0), lower)
    return np.minimum(low, raised), raised


DRAWS = 256
"""Draws of each tool: a 5 % quantile errs by a tenth of the half width."""
LEVELS = (0.05, 0.5, 0.95)
"""Ends of a 90 % interval and its median [1]."""
HEAVY = 0.5
"""Share of a tool's greatest peak load from which a cut counts as heavy [1]."""
DIGITS = 6
"""Decimals of a load [N]: forces of teeth that balance leave less."""


def cut_ranges(cut: Cut) -> dict[int, CutRange]:
    """Feeds, speeds and depths of each tool's heavier cuts, by its number."""
    engagement, found = cut.engagement, {}
    peak = cut.station_loads.peak
    speed = cut.plan.spindle_speed[engagement.block] / 60
    f_z = cut.feed_per_tooth[engagement.block]
    for index, number in enumerate(cut.numbers):
        mine = engagement.feed & (engagement.tool == index) & (f_z > 0) & (speed > 0)
        mine &= engagement.axial_depth > 0
        mine &= peak >= HEAVY * peak[mine].max(initial=0.0)
        if mine.any() and cut.tools[index].load_known:
            found[number] = CutRange(
                feeds_m=_ends(f_z[mine]), speeds=_ends(speed[mine]),
                depths_m=_ends(engagement.axial_depth[mine]),
            )  # fmt: skip
    return found


def _ends(values: Floats) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def force_intervals(
    cut: Cut, uncertain: Uncertainty, coefficients: Mapping[int, ToolCoefficients],
    model: CuttingModel | None, seed: int,
) -> tuple[ForceInterval, ...]:  # fmt: skip
    """Peak and mean load in the plane of each tool that cuts: medians and 90 % intervals."""
    draws, ranges = draws_of(uncertain, DRAWS, seed), cut_ranges(cut)
    rows = []
    for number in dict.fromkeys(cut.numbers[k] for k in cut.tool[cut.tool >= 0].tolist()):
        if number not in ranges or number not in draws.tools:
            continue
        peak_at, mean_at = _stations(cut, cut.numbers.index(number))
        drawn, given = draws.tools[number], coefficients[number]
        (low, peak, high), (mean_low, mean, mean_high) = (
            np.quantile(one * draws.model, LEVELS).round(DIGITS) for one in (
                station_loads(cut, peak_at, drawn), station_loads(cut, mean_at, drawn, mean=True)
            )
        )  # fmt: skip
        rows.append(ForceInterval(
            tool=number, name=cut.tools[cut.numbers.index(number)].name, source=given.source,
            peak_load_N=figure(peak), peak_load_low_N=figure(low), peak_load_high_N=figure(high),
            mean_load_N=figure(mean), mean_load_low_N=figure(mean_low),
            mean_load_high_N=figure(mean_high),
            runout=uncertain.tools[number].runout_words,
            outside=not_learnt(ranges[number], model) if given.kind == "identified" else (),
        ))  # fmt: skip
    return tuple(rows)


def _stations(cut: Cut, index: int) -> tuple[int, int]:
    engagement = cut.engagement
    mine = np.flatnonzero(engagement.feed & (engagement.tool == index))
    loads = cut.station_loads
    return int(mine[np.argmax(loads.peak[mine])]), int(mine[np.argmax(loads.mean[mine])])


ALIKE = 0.01
"""Relative difference up to which conditions count as learnt [1]."""


def not_learnt(used: CutRange, model: CuttingModel | None) -> tuple[str, ...]:
    """Conditions of a tool outside of those that an identified law was learnt at, in words."""
    spread = None if model is None or model.prediction is None else model.prediction.spread
    if spread is None:
        return ()
    every = (
        ("feed per tooth", used.feeds_m, spread.feeds_m, 1e3, "mm"),
        ("spindle speed", used.speeds, spread.speeds, 60.0, "rev/min"),
        ("axial depth of cut", used.depths_m, spread.depths_m, 1e3, "mm"),
    )
    return tuple(
        f"{name} {low * unit:.4g} to {high * unit:.4g} {of}, learnt {least * unit:.4g} to "
        f"{most * unit:.4g}"
        for name, (low, high), (least, most), unit, of in every
        if low < least * (1 - ALIKE) or high > most * (1 + ALIKE)
    )
