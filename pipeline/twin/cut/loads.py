"""Cut of a program: its engagement with a blank, and the loads at its feeds and speeds.

Other feeds and speeds cost a look-up (:meth:`Cut.loads`).  Peaks are those of the highest speed
that the control reaches in a block; means (power, removal rate, energy) of its mean speed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.engagement.engagement import Engagement, engage
from pipeline.cutting.engagement.stock import HeightMap, Stock, height_map
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import BlockLoads, LoadTable, load_table
from pipeline.cutting.tool import Tool, odd_sizes
from pipeline.gcode.moves import METRE
from pipeline.gcode.setup import Vector
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.path import Motion
from pipeline.machine.control.planner import Plan
from pipeline.schema.arrays import Floats, Rows
from pipeline.twin.cut.path import CuttingPath, cutting_path, nothing_cut_message

CHORD = 0.1
"""Greatest distance of a chord from its arc, over the resolution of the blank [1]."""
FEED_RANGE = 2.0
"""Greatest feed per tooth that is tabulated, over the greatest of the program [1]."""


@dataclass(frozen=True, kw_only=True)
class CutJob:
    """Blank, tools and cutting coefficients of a cut."""

    stock: Stock
    """Blank, in the coordinates of the work offset ``offset``."""
    tools: Mapping[int, Tool]
    """Tools by number."""
    force_laws: Mapping[int, ForceLaw]
    """Force laws of each of them in the blank's material."""
    resolution: float
    """Resolution of the blank [m]."""
    offsets: Mapping[str, Vector] = field(default_factory=dict)
    """Work offsets before the program [mm, deg]."""
    offset: str | None = None
    """Work offset in which the blank is measured; by default that of the first cut."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Cut:
    """The cut of a program of M rows; a row is a block."""

    plan: Plan = field(repr=False)
    """Speeds as the control reaches them."""
    path: CuttingPath = field(repr=False)
    """Path through the blank."""
    numbers: tuple[int, ...]
    tools: tuple[Tool, ...] = field(repr=False)
    force_laws: tuple[ForceLaw, ...] = field(repr=False)
    """Force laws of the tools that cut."""
    engagement: Engagement = field(repr=False)
    """Engagement in N stations."""
    blank: HeightMap = field(repr=False)
    left: HeightMap = field(repr=False)
    """Blank before and after."""
    table: LoadTable = field(repr=False)
    """Loads of each block."""

    @cached_property
    def tool(self) -> Rows:
        """Index of each row's tool; -1 for rows that cut nothing at feed.  Shape (M,)."""
        index = np.full(self.engagement.blocks, -1, dtype=np.intp)
        fed = self.engagement.feed
        index[self.engagement.block[fed]] = self.engagement.tool[fed]
        return index

    @cached_property
    def feed_per_tooth(self) -> Floats:
        """At the highest speed reached in each row; 0 where nothing is cut [m].  Shape (M,)."""
        return self.feed_per_tooth_at(self.plan.v_peak, self.plan.spindle_speed)

    @cached_property
    def mean_speed(self) -> Floats:
        """Along the path in each row [m/s]; 0 where nothing moves.  Shape (M,)."""
        time = self.plan.motion.time
        length = self.plan.path.moves.length * METRE
        return np.divide(length, time, out=np.zeros(len(time)), where=time > 0)

    @cached_property
    def mean_feed_per_tooth(self) -> Floats:
        """At the mean speed of each row; 0 where nothing is cut [m].  Shape (M,)."""
        return self.feed_per_tooth_at(self.mean_speed, self.plan.spindle_speed)

    def feed_per_tooth_at(self, speed: Floats, spindle_speed: Floats) -> Floats:
        """f_z = v / (n N) of each row [m], of speeds of path [m/s] and spindle [rev/min].

        Shapes are (M,) or (P, M); where the spindle stands no chip is cut.
        """
        flutes = np.array([tool.flutes for tool in self.tools], dtype=np.float64)
        teeth = np.where(self.tool >= 0, flutes[self.tool] * spindle_speed / 60, 0.0)
        return np.divide(speed, teeth, out=np.zeros(teeth.shape), where=teeth > 0)

    def loads(self, feeds: ArrayLike | None = None, speeds: ArrayLike | None = None) -> BlockLoads:
        """Loads of each row for a population of feeds and speeds.

        The speed along the path is that programmed or, where that is less, allowed by axes, arcs
        and tolerances.  F and S are in the units of ``Moves``, by default the program's own; shapes
        are (M,) or (P, M).
        """
        return self.table.loads(self.commanded_feed_per_tooth(feeds, speeds))

    def commanded_feed_per_tooth(
        self, feeds: ArrayLike | None = None, speeds: ArrayLike | None = None
    ) -> Floats:
        """f_z of each row as :meth:`loads` takes it [m]; shape (M,) or (P, M)."""
        path, moves = self.plan.path, self.plan.path.moves
        feed = np.asarray(moves.feed if feeds is None else feeds, dtype=np.float64)
        spindle = np.asarray(moves.speed if speeds is None else speeds, dtype=np.float64)
        spindle = np.where(moves.direction == 0, 0.0, spindle)
        speed = path.factor * feed * np.where(path.motion == Motion.PER_TURN, spindle, 1.0)
        speed, spindle = np.broadcast_arrays(np.minimum(speed, path.cap), spindle)
        return self.feed_per_tooth_at(speed, spindle)

    @cached_property
    def block_loads(self) -> BlockLoads:
        """Loads of the plan's blocks at the highest speed reached in each row; shape (M,) each."""
        return self.table.loads(self.feed_per_tooth)

    @cached_property
    def station_loads(self) -> BlockLoads:
        """The same of each station; arrays of shape (N,)."""
        if not len(self.engagement):
            return BlockLoads(**{item.name: np.zeros(0) for item in fields(BlockLoads)})
        return self.table.station_loads(self.feed_per_tooth)

    @cached_property
    def in_material(self) -> Floats:
        """Time of each station in the plan [s]; shape (N,)."""
        engagement = self.engagement
        length = self.path.pieces.length
        whole = np.bincount(self.path.pieces.block, length, minlength=engagement.blocks)
        share = engagement.length / np.maximum(whole[engagement.block], 1e-12)
        return np.minimum(share, 1.0) * self.plan.motion.time[engagement.block]


def cut_program(plan: Plan, job: CutJob) -> Cut:
    """The cut of a planned program.

    Raises ValueError when the blank cannot be made, nothing cuts, or a cut has no tool of the job.
    """
    moves = plan.path.moves
    listed = sorted(job.tools)
    path = cutting_path(
        moves, listed, chord=CHORD * job.resolution, offsets=job.offsets, offset=job.offset,
        rapid_speeds=rapid_speeds(plan.path.control),
    )  # fmt: skip
    tools = tuple(job.tools[number] for number in listed)
    force_laws = tuple(job.force_laws[number] for number in listed)
    _check_resolution(path, tools, listed, job.resolution)
    blank = height_map(job.stock, job.resolution)
    swept, left = engage(path.pieces, tools, blank)
    if not len(swept) and not path.pieces.feed.any():
        raise ValueError(nothing_cut_message(moves, path.left_out))
    engagement = replace(swept, blocks=len(moves))
    return Cut(
        plan=plan, path=path, numbers=tuple(listed), tools=tools, force_laws=force_laws,
        engagement=engagement, blank=blank, left=left,
        table=load_table(engagement, tools, force_laws, _greatest(plan, engagement, tools)),
    )  # fmt: skip


def _check_resolution(
    path: CuttingPath, tools: tuple[Tool, ...], numbers: list[int], resolution: float
) -> None:
    """Refuse cells wider than half of the widest tool that cuts, a likely slip of units."""
    used = np.unique(path.pieces.tool[path.pieces.feed]).tolist()
    widest = max(used, key=lambda index: tools[index].diameter, default=None)
    if widest is None or odd_sizes(tools[widest]):
        return
    if 2 * resolution > tools[widest].diameter:
        size = tools[widest].diameter_mm
        raise ValueError(
            f"a resolution of {resolution / METRE:g} mm is too coarse for T{numbers[widest]}, the "
            f"widest tool with {size:g} mm: give at most a tenth of it, {size / 10:g} mm"
        )


def with_force_laws(cut: Cut, force_laws: tuple[ForceLaw, ...]) -> Cut:
    """The same cut with other force laws, one for each of its tools."""
    most = _greatest(cut.plan, cut.engagement, cut.tools)
    return replace(
        cut, force_laws=force_laws, table=load_table(cut.engagement, cut.tools, force_laws, most)
    )


def recut(cut: Cut, plan: Plan, rows: ArrayLike) -> Cut:
    """Same path through the same blank under another plan: other feeds, speeds and rows.

    ``rows`` (M,) says which row of the plan each row of ``cut`` has become, rising.  Raises
    ValueError when a row has no place, or a row with a cut moves otherwise than before.
    """
    place, moves = np.asarray(rows, dtype=np.intp), plan.path.moves
    before = cut.plan.path.moves
    if place.shape != (len(before),) or (np.diff(place, prepend=-1) < 1).any() or (
        len(place) and place[-1] >= len(moves)
    ):  # fmt: skip
        raise ValueError(
            f"recut: {place.shape} places for {len(before)} rows in a plan of {len(moves)}: give "
            "each row one, rising"
        )
    cutting = np.unique(cut.path.pieces.block)
    other = (moves.length[place[cutting]] != before.length[cutting]) | (
        moves.tool[place[cutting]] != before.tool[cutting]
    )
    if other.any():
        wrong = cutting[np.argmax(other)]
        raise ValueError(
            f"recut: line {before.line[wrong]} moves {before.length[wrong]:g} mm with "
            f"T{before.tool[wrong]} in the cut and otherwise in the plan: give the same moves"
        )
    pieces, engagement, row = cut.path.pieces, cut.engagement, place.astype(np.int32)
    return replace(
        cut,
        plan=plan,
        path=replace(cut.path, pieces=replace(pieces, block=row[pieces.block])),
        engagement=replace(engagement, block=row[engagement.block], blocks=len(moves)),
        table=_placed(cut.table, place, len(moves)),
    )


def _placed(table: LoadTable, place: Rows, rows: int) -> LoadTable:
    """The table with its blocks at other rows; those between cut nothing."""
    values = np.zeros((table.values.shape[0], rows, table.values.shape[2]))
    values[:, place] = table.values
    scale, exponent, length = np.ones(rows), np.ones(rows), np.zeros(rows)
    scale[place], exponent[place] = table.scale, table.exponent
    length[place] = table.length
    block = place.astype(np.int32)[table.block]
    return replace(table, values=values, block=block, scale=scale, exponent=exponent, length=length)


def rapid_speeds(control: ControlParameters) -> Floats | None:
    """Rapid speeds of X, Y and Z, each as fast as it can; an absent axis never moves."""
    if control.rapid_mode != "independent":
        return None
    axes = control.axes
    return np.array([axes[x].rapid_speed if x in axes else 1.0 for x in "XYZ"])


def _greatest(plan: Plan, engagement: Engagement, tools: tuple[Tool, ...]) -> Floats:
    """Feed for each tooth up to which loads are tabulated, for each tool [m]."""
    fed = engagement.feed
    block, tool = engagement.block[fed], engagement.tool[fed]
    flutes = np.array([one.flutes for one in tools], dtype=np.float64)
    teeth = flutes[tool] * plan.spindle_speed[block] / 60
    chip = np.divide(plan.v_peak[block], teeth, out=np.zeros(len(teeth)), where=teeth > 0)
    most = np.zeros(len(tools))
    np.maximum.at(most, tool, chip)
    return np.where(most > 0, FEED_RANGE * most, 1e-4)
