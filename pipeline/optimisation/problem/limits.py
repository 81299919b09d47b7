"""Range of feed for each tooth, feed and spindle speed of each row, by the limits of the part.

Loads of a row depend on f_z alone, so that a limit of the load, the tip's deflection or the torque
is one of f_z; so are those of the chip, h = f_z sin(phi) sin(kappa) at its greatest, and of the
height of feed marks,

    R_t = f^2 / (8 rho),

with rho the tool's radius for walls (Martellotti 1941, of teeth that go straight: f_z much less
than D) or its corner's radius for floors, and f the feed for each tooth; where the tool runs out
one tooth leaves the marks, and f is that of a turn.  Plunges and drills leave none.  Ranges of F
and S come from the part's limits, the machine, the tools and the program.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.force.load_table import TORQUE as MEAN_TORQUE
from pipeline.cutting.tool import Tool, tip_stiffness, tool_limits
from pipeline.machine.control.parameters import LINEAR
from pipeline.machine.control.path import where
from pipeline.machine.spindle import CUTTING
from pipeline.optimisation.problem.arrays import (
    F_Z_CONSTRAINTS,
    Bounds,
    Editable,
    Practice,
    Ranges,
    RowGroups,
    feeds_per_minute,
)
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.schema.limits import BY_TOOL, CutLimit
from pipeline.schema.si import MM, UM
from pipeline.twin.cut.blocks import STEEP, CutBlocks
from pipeline.twin.cut.loads import Cut

SOFT = 0.85
"""Share of the greatest feed per tooth that the least one of a range may reach [1]."""
GIVES_WAY = 0.5
"""Share of the greatest F by all limits that the least change may reach [1]."""
LEAST_FEED = 0.1
"""Share of a program's least F from which its range starts without a given one [1]."""


def bounds_of(
    cut: Cut, blocks: CutBlocks, limits: CutLimit, editable: Editable,
    f_z_load: Floats | None = None, practice: Practice | None = None,
) -> Bounds:  # fmt: skip
    """Bounds of each row of a cut.

    ``editable``: the least of a range gives way to what any row of a shared F may take;
    ``f_z_load`` (M,): feed for each tooth by the load limit [m]; by default that of the load table.
    """
    margins = limits.margins
    torque = greatest_torque(cut)
    most = np.full((len(F_Z_CONSTRAINTS), cut.engagement.blocks), np.inf)
    load, deflection, roughness, chip, by_torque, programmed, tooth, change = most
    cuts = cut.tool >= 0
    most_load, give, most_torque = (row_limits(cut, limits, name) for name in BY_TOOL)
    if f_z_load is not None:
        load[cuts] = f_z_load[cuts]
    elif np.isfinite(most_load).any():
        load[:] = inverse(cut, cut.table.values[0], most_load * (1 - margins.load))
    if np.isfinite(give).any():
        stiff = np.array([stiffness(tool) for tool in cut.tools])[cut.tool]
        across = give * UM * (1 - margins.deflection) * stiff
        deflection[:] = inverse(cut, cut.table.values[0], across)
    if practice is not None:
        deflection[:] = np.minimum(deflection, practice.f_z_bent)
    if limits.roughness_um is not None:
        height = limits.roughness_um * UM * (1 - margins.roughness)
        marked = np.array([feed_for_marks(tool, height) for tool in cut.tools])
        roughness[:] = np.where(_plunges(cut), np.inf, marked[cut.tool])
    if np.isfinite(most_torque).any():
        by_torque[:] = inverse(cut, torque, most_torque * (1 - margins.torque))
    factor = _chip_factor(cut, blocks)
    least, chip[:] = _chip_bounds(cut, blocks, limits, factor, by_tool=practice is None)
    if practice is None:
        alone = _only_along(cut) | ~np.isfinite(most).any(axis=0)
        own = cut.commanded_feed_per_tooth()
        programmed[:] = np.where(alone & ~np.isfinite(chip), own, np.inf)
    else:
        programmed[:], tooth[:], change[:] = (
            practice.f_z_own,
            practice.f_z_high,
            practice.f_z_change,
        )
        allowed = _least_of_blocks(editable.block, np.where(cuts, most.min(axis=0), np.inf))
        gives_way = np.minimum(practice.f_z_low, SOFT * allowed)
        least = np.maximum(least, np.where(cuts, gives_way, 0.0))
        free = practice.given_up
        most[:, free], least[free], torque[free] = np.inf, 0.0, 0.0
    most[:, ~cuts] = np.inf
    return Bounds(most=most, least=least, torque=torque)


def row_limits(cut: Cut, limits: CutLimit, name: str) -> Floats:
    """Limit of the tool of each row, as :func:`tool_limits`; infinite in air; shape (M,)."""
    return np.append(tool_limits(cut.tools, name, getattr(limits, name)), np.inf)[cut.tool]


def _least_of_blocks(block: Rows, values: Floats) -> Floats:
    """Least value of the rows that share an F, in each of them; shape (M,)."""
    blocks = RowGroups(block)
    return blocks.spread(-blocks.greatest(-values[None]), values)[0]


def inverse(cut: Cut, values: Floats, limit: Floats | float) -> Floats:
    """Greatest f_z up to which a load of rows stays within a limit [m], as :func:`crossings`."""
    return crossings(values, cut.table.scale, cut.table.exponent, limit)


def crossings(values: Floats, scale: Floats, exponent: Floats, limit: Floats | float) -> Floats:
    """Greatest f_z up to which a load stays within a limit [m].

    ``values`` (M, K + 1): the load at the nodes of a load table with ``scale`` and ``exponent``
    (M,); ``limit`` (..., M): in its unit.  Shape (..., M): 0 where any feed passes the limit,
    infinite where none does.
    """
    from pipeline.optimisation.problem.kernels import first_crossings

    shape = np.broadcast_shapes(np.shape(limit), scale.shape)
    limits = np.ascontiguousarray(np.broadcast_to(limit, shape), dtype=np.float64)
    out = np.empty(shape)
    if out.size:
        many = (-1, shape[-1])
        nodes = np.ascontiguousarray(values)
        first_crossings(limits.reshape(many), nodes, scale, exponent, out.reshape(many))
    return out


def greatest_torque(cut: Cut) -> Floats:
    """Mean torque over the turn at each row's hardest station, at the nodes [N m]; (M, K + 1)."""
    engagement, table = cut.engagement, cut.table
    out = np.zeros((engagement.blocks, table.values.shape[2]))
    fed = np.flatnonzero(engagement.feed)
    order = fed[np.argsort(engagement.block[fed], kind="stable")]
    block = engagement.block[order]
    first = np.flatnonzero(np.diff(block, prepend=-1))
    if len(first):
        each = table.station_values[MEAN_TORQUE][table.station[order]]
        out[block[first]] = np.maximum.reduceat(each, first)
    return out


def at_hardest_station(cut: Cut, torque: Floats, f_z: Floats) -> Floats:
    """Torque of :func:`greatest_torque` at feeds for each tooth [N m]; shape (M,)."""
    from pipeline.cutting.force.profile_kernel import look_up

    out = np.empty((1, len(f_z)))
    look_up(f_z[np.newaxis], torque, cut.table.scale, cut.table.exponent, out)
    return out[0]


def feed_for_marks(tool: Tool, height: float) -> float:
    """Feed for each tooth whose marks have that height [m]; infinite for a drill.

    sqrt(8 rho R_t) with the lesser of the radii that leave marks, over the teeth where the tool
    runs out.  Valid for feeds much less than that radius (Martellotti 1941).

    A ball of 6 mm that leaves marks of 1 um:

    >>> ball = Tool(kind="ball", diameter_mm=6.0, flutes=2)
    >>> round(feed_for_marks(ball, 1e-6) * 1e3, 4)
    0.1549
    """
    if tool.kind == "drill":
        return float("inf")
    radius = tool.corner_radius or tool.radius
    teeth = tool.flutes if tool.runout > 0 else 1
    return float(np.sqrt(8 * radius * height)) / teeth


def stiffness(tool: Tool) -> float:
    """Stiffness of the tip [N/m]; infinite without a stickout and of a drill: its lips balance."""
    known = tool.stickout is not None and tool.kind != "drill"
    return tip_stiffness(tool) if known else float("inf")


def _chip_factor(cut: Cut, blocks: CutBlocks) -> Floats:
    """Thickest chip of each row over its feed for each tooth [1]; 0 without a chip.  Shape (M,)."""
    out = np.zeros(cut.engagement.blocks)
    fed = blocks.feed_per_tooth > 0
    out[blocks.row[fed]] = blocks.thickness[fed] / blocks.feed_per_tooth[fed]
    return out


def _chip_bounds(
    cut: Cut, blocks: CutBlocks, limits: CutLimit, factor: Floats, *, by_tool: bool
) -> tuple[Floats, Floats]:
    """Least and greatest f_z by the thickest chip and by the tools' makers [m]; shape (M,) each.

    A row that is engaged over less than a cell of the blank is too thin for its thickness to count.
    """
    made = [(tool.feed_per_tooth_mm if by_tool else None) or (0.0, np.inf) for tool in cut.tools]
    shares = np.array([1 + limits.margins.chip, 1 - limits.margins.chip])
    least, most = (np.array(made) * MM * shares).T[:, cut.tool]
    if limits.chip_um is not None:
        thinnest, thickest = np.array(limits.chip_um) * UM * shares
        wide = np.zeros(len(least), dtype=np.bool_)
        wide[blocks.row] = blocks.radial_depth >= cut.engagement.resolution
        known = wide & (factor > 0)
        least = np.maximum(
            least, np.divide(thinnest, factor, out=np.zeros(len(least)), where=known)
        )
        with np.errstate(divide="ignore"):
            most = np.minimum(most, thickest / factor)
    return np.where(cut.tool >= 0, least, 0.0), most


def _plunges(cut: Cut) -> Bools:
    """Rows that plunge all along; shape (M,)."""
    engagement = cut.engagement
    out = np.ones(engagement.blocks, dtype=np.bool_)
    out[engagement.block[np.abs(engagement.slope) < STEEP]] = False
    return out


def _only_along(cut: Cut) -> Bools:
    """Rows somewhere loaded along the tool's axis rather than across: plunges, drills; (M,)."""
    engagement = cut.engagement
    out = np.zeros(engagement.blocks, dtype=np.bool_)
    out[engagement.block[np.abs(engagement.slope) >= STEEP]] = True
    drills = np.array([tool.kind == "drill" for tool in cut.tools])
    return out | drills[cut.tool]


def ranges_of(
    cut: Cut, limits: CutLimit, editable: Editable, drive: SpindleDrive | None,
    practice: Practice | None = None, f_z_high: Floats | None = None,
) -> Ranges:  # fmt: skip
    """Ranges of F and S of each row; the least change gives way to ``f_z_high`` (M,) [m]."""
    cuts, unknown = cut.tool >= 0, not_computed(cut)
    feed_low, feed_high = _feeds(cut, limits, editable, unknown)
    surface_low, surface_high = _surface(cut, limits, by_tool=practice is None)
    highest = cut.plan.path.control.auxiliary.maximum_speed
    if drive is not None:
        highest = min(highest, drive.top_speed_rpm)
    low, high = (np.full(len(cuts), end) for end in _speeds(cut, cuts, limits, drive, highest))
    high = np.minimum(high, highest)
    top = np.array([tool.top_speed_rpm or np.inf for tool in cut.tools] or [0.0])[cut.tool]
    given = "the S of the program" if limits.speed_rpm is None else "limits.speed_rpm"
    spans = [
        ("the top speed of the spindle", np.zeros(len(cuts)), np.full(len(cuts), highest)),
        ("the top speed of the tool", np.zeros(len(cuts)), top),
        ("limits.cutting_speed_m_min" if practice or limits.cutting_speed_m_min else
         "the cutting speed of the tool", surface_low, surface_high),
        (given, low, high),
    ]  # fmt: skip
    if practice is not None:
        free_feed = editable.block >= 0
        feed_high = np.where(free_feed, np.minimum(feed_high, practice.feed_high), feed_high)
        least = practice.feed_low
        if f_z_high is not None:
            teeth = np.array([tool.flutes for tool in cut.tools] or [0])[cut.tool]
            allowed = np.minimum(f_z_high, 1.0) * teeth * cut.plan.spindle_speed / MM
            allowed = _least_of_blocks(editable.block, np.where(cuts, allowed, np.inf))
            least = np.minimum(least, GIVES_WAY * allowed)
        feed_low = np.where(free_feed, np.maximum(feed_low, least), feed_low)
        feed_low = np.minimum(feed_low, feed_high)
        spans += [
            ("the cutting speed of the tool or its life", practice.surface_low,
             practice.surface_high),
            ("practice.change (no more than programmed without a tool life)", practice.speed_low,
             practice.speed_high),
        ]  # fmt: skip
        surface_low = np.maximum(surface_low, practice.surface_low)
        surface_high = np.minimum(surface_high, practice.surface_high)
        low, high = np.maximum(low, practice.speed_low), np.minimum(high, practice.speed_high)
        unknown |= practice.given_up
        surface_low = np.where(practice.given_up, 0.0, surface_low)
        surface_high = np.where(practice.given_up, np.inf, surface_high)
    free = editable.speed & ~unknown
    speed_low = np.where(free, np.maximum(low, surface_low), surface_low)
    speed_high = np.minimum(np.where(free, high, highest), surface_high)
    own = cut.plan.spindle_speed
    ranges = Ranges(
        feed_low=feed_low,
        feed_high=feed_high,
        speed_low=np.where(unknown, own, speed_low),
        speed_high=np.where(unknown, own, speed_high),
        surface_low=surface_low,
        surface_high=surface_high,
        counted=cuts | unknown,
    )
    _check(cut, cuts, ranges, spans)
    return ranges


def not_computed(cut: Cut) -> Bools:
    """Rows that move at feed and whose engagement was left out: threads, turned axes; (M,)."""
    moves = cut.plan.path.moves
    fed: Bools = np.isin(moves.kind, CUTTING) & (moves.length > 0)
    fed[cut.path.pieces.block] = False
    return fed


def _descends_in_air(cut: Cut) -> Bools:
    """Rows that go down as steeply as a plunge and cut nothing; shape (M,).

    F of these is at most as programmed: a floor may lie a little higher than it should.
    """
    moves = cut.plan.path.moves
    fall = moves.start[:, 2] - moves.end[:, 2]
    return (fall > 0) & (fall >= STEEP * moves.length) & (cut.tool < 0)


def _feeds(cut: Cut, limits: CutLimit, editable: Editable, unknown: Bools) -> tuple[Floats, Floats]:
    moves, free = cut.plan.path.moves, editable.block >= 0
    own = feeds_per_minute(cut, moves.feed, cut.plan.spindle_speed)
    low = LEAST_FEED * float(own[free].min(initial=np.inf)) if free.any() else 0.0
    if limits.feed_mm_min is not None:
        least, high = limits.feed_mm_min
        low = least or min(low, high)  # a feed of 0 is none
    else:
        axes = cut.plan.path.control.axes
        fastest = max(axis.cutting_speed for letter, axis in axes.items() if letter in LINEAR)
        high = max(fastest, float(own[free].max(initial=0.0)))
    most = np.where(_descends_in_air(cut), np.clip(own, min(low, high), high), high)
    return (
        np.where(free, np.where(unknown, own, low), 0.0),
        np.where(free, np.where(unknown, own, most), np.inf),
    )


def _surface(cut: Cut, limits: CutLimit, *, by_tool: bool) -> tuple[Floats, Floats]:
    """Range of S by the cutting speeds of the limits and of the tools' makers [rev/min]."""
    margin = limits.margins.cutting_speed
    low, high = np.zeros(len(cut.tools) + 1), np.full(len(cut.tools) + 1, np.inf)
    for index, tool in enumerate(cut.tools):
        made = tool.cutting_speed_m_min if by_tool else None
        for span in (limits.cutting_speed_m_min, made):
            if span is not None:
                spindle_speed = np.array(span) / (np.pi * tool.diameter)
                low[index] = max(low[index], spindle_speed[0] * (1 + margin))
                high[index] = min(high[index], spindle_speed[1] * (1 - margin))
        high[index] = min(high[index], tool.top_speed_rpm or np.inf)
    return low[cut.tool], high[cut.tool]


def _speeds(
    cut: Cut, cuts: Bools, limits: CutLimit, drive: SpindleDrive | None, highest: float
) -> tuple[float, float]:
    if limits.speed_rpm is not None:
        low, high = limits.speed_rpm
        if low > highest:
            raise ValueError(
                f"limits.speed_rpm = [{low:g}, {high:g}] begins above the spindle's top speed "
                f"{highest:g} rev/min: lower it"
            )
        return low, high
    own = cut.plan.spindle_speed[cuts]
    least, most = float(own.min(initial=np.inf)), float(own.max(initial=0.0))
    if drive is None:
        return least, most
    return min(least, drive.minimum_speed_rpm), drive.top_speed_rpm


def _check(
    cut: Cut, cuts: Bools, ranges: Ranges, spans: Sequence[tuple[str, Floats, Floats]]
) -> None:
    """Refuse an empty range of S; ``spans`` are what it is made of, by name, shape (M,) each."""
    empty = cuts & (ranges.speed_low > ranges.speed_high)
    if empty.any():
        row = int(np.argmax(empty))
        tool = cut.tools[cut.tool[row]]
        lower = max(spans, key=lambda span: float(span[1][row]))[0]
        upper = min(spans, key=lambda span: float(span[2][row]))[0]
        raise ValueError(
            f"{where(cut.plan.path.moves, row)}: no speed of the spindle keeps the limits of "
            f"T{cut.numbers[cut.tool[row]]}, {tool.diameter_mm:g} mm: it needs at least "
            f"{ranges.speed_low[row]:.6g} rev/min by {lower}, and at most "
            f"{ranges.speed_high[row]:.6g} by {upper}: widen one of the two"
        )
