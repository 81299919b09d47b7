"""Preflight of a part program: travel, spindle speed, feed, tool length; holder against the part.

Positions are those of the axes in machine coordinates, tool length in force included.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.cutting.engagement.clearance import BODIES, bodies, contacts
from pipeline.cutting.engagement.engagement import engage
from pipeline.cutting.engagement.stock import HeightMap
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import AXES, IN_PLANE, METRE, FeedMode, Kind, Moves
from pipeline.gcode.setup import MachineLimits, Setup
from pipeline.machine.control.parameters import LINEAR, ControlParameters
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Floats
from pipeline.schema.program_cut import CutWarning
from pipeline.twin.cut.path import CuttingPath

NEAR = 1e-6
"""Rounding of a position or a word, as a share of the limit and its range [1]."""
MOST_SAID = 5
"""Violations of one axis or word that are printed; documents hold all of them."""
RAPID = "rapid"
IN_MATERIAL = (*BODIES, RAPID)
"""Violations that concern the part, not the machine."""
_BEYOND, _CONTACT = "The program leaves the machine’s limits", "A tool’s body meets the part"
_CLEAR = "Clamp the tool longer, take a slimmer holder, or cut what is in its way before."
SAID = {"S": ("spindle speed", "rev/min"), "F": ("feed", "mm/min"), "length": ("tool length", "mm")}
"""Name and unit of what is no axis."""


@dataclass(frozen=True, kw_only=True)
class Violation:
    """A line of a program that the machine cannot carry out."""

    line: int
    """Line of the program, or of the subprogram ``file``."""
    file: str = ""
    """Name of the subprogram; empty for the program itself."""
    what: str
    """Letter of the axis or word, ``length`` of a tool, its ``shank`` or ``holder``, or
    ``rapid``."""
    value: float
    """Position in machine coordinates, value of the word, or depth in the material
    [mm, deg, rev/min, mm/min]."""
    limit: tuple[float, float]
    """Range of the machine in the same unit."""
    frame: str = ""
    """Work coordinate system in force, where the position of an axis is meant."""
    tool: int = -1
    """Tool in the spindle; -1 before the first."""
    tool_length_mm: float | None = None
    """Length of that tool in the machine's file [mm]."""
    body: str = ""
    """Diameter of shank or holder and where it begins, in words."""

    @property
    def words(self) -> str:
        """Place, quantity, value and limit in words."""
        low, high = self.limit
        where = f"{self.file} line {self.line}" if self.file else f"line {self.line}"
        if self.what == RAPID:
            return f"{where}: a rapid of T{self.tool} goes {self.value:.3g} mm through the material"
        if self.what in BODIES:
            return (
                f"{where}: the {self.what} of T{self.tool} ({self.body}) goes {self.value:.3g} mm "
                "deep into the material"
            )
        side, limit = ("below", low) if self.value < low else ("above", high)
        if self.what in SAID:
            name, unit = SAID[self.what]
            own = f"length of T{self.tool}" if self.what == "length" else self.what
            end = "least" if side == "below" else "greatest"
            return (
                f"{where}: {own} {self.value:g} {unit} is {side} {limit:g} {unit}, the {end} "
                f"{name} of the machine"
            )
        unit = "mm" if self.what in LINEAR else "deg"
        tool = ""
        if self.what == "Z" and self.tool_length_mm:
            tool = f"; T{self.tool} is {self.tool_length_mm:g} mm long"
        return (
            f"{where}: {self.what} moves to {self.value:g} {unit} in machine coordinates "
            f"({self.frame}{tool}), {abs(self.value - limit):g} {unit} {side} its travel of "
            f"{low:g} to {high:g} {unit}"
        )


@dataclass(frozen=True, kw_only=True)
class Preflight:
    """Violations of the machine's limits by a program, and what was not checked."""

    violations: tuple[Violation, ...] = ()
    """Violations in the order of the program; a modal word counts once for each time that it is
    set."""
    not_checked: tuple[str, ...] = ()
    """Limits that the machine's file does not list, in words."""
    clearance: tuple[str, ...] | None = None
    """Shanks and holders that were not checked against the part; None where no blank was given."""


def limits_of(
    setup: Setup, control: ControlParameters | None = None, top_speed_rpm: float | None = None
) -> MachineLimits:
    """The limits of the set-up; of speed and feed else those of spindle drive and control."""
    found = setup.limits
    top = [] if top_speed_rpm is None else [top_speed_rpm]
    if control is not None:
        top.append(control.auxiliary.maximum_speed)
    fastest = min(top, default=np.inf)
    if found.spindle_rpm is None and np.isfinite(fastest):
        found = replace(found, spindle_rpm=(0.0, float(fastest)))
    axes = [] if control is None else [a for name, a in control.axes.items() if name in LINEAR]
    if found.feed_mm_min is None and axes:
        found = replace(found, feed_mm_min=(0.0, max(axis.cutting_speed for axis in axes)))
    return found


def preflight(moves: Moves, setup: Setup, limits: MachineLimits) -> Preflight:
    """Hold a program against the limits of a machine."""
    low, high = extents(moves)
    speed, feed = _set(spindle_speed(moves)), _set(path_feed(moves))
    length = _lengths(moves, setup)
    checks: list[tuple[str, tuple[float, float] | None, Floats, Floats]] = [
        *((axis, limits.travel.get(axis), low[:, i], high[:, i]) for i, axis in enumerate(AXES)),
        ("S", limits.spindle_rpm, speed, speed),
        ("F", limits.feed_mm_min, feed, feed),
        ("length", limits.tool_length_mm, length, length),
    ]
    seen: dict[tuple[str, int, str, float], tuple[int, Violation]] = {}
    for what, limit, least, greatest in checks:
        for row, value in () if limit is None else _beyond(limit, least, greatest):
            one = _violation(moves, setup, row, what, limit or (0.0, 0.0), value)
            # a loop or subprogram comes to the same line again
            seen.setdefault((one.file, one.line, what, one.value), (row, one))
    moved = [axis for i, axis in enumerate(AXES) if np.isfinite(low[:, i]).any()]
    return Preflight(
        violations=tuple(one for _, one in sorted(seen.values(), key=lambda pair: pair[0])),
        not_checked=tuple(_not_checked(moves, setup, limits, moved)),
    )


def contact_violations(
    moves: Moves, path: CuttingPath, tools: Mapping[int, Tool], blank: HeightMap
) -> tuple[Violation, ...]:
    """Lines in which a tool's shank or holder enters the material, each at its deepest."""
    numbers = sorted(tools)
    found = contacts(path.pieces, [tools[number] for number in numbers], blank)
    seen: dict[tuple[int, int, str], Violation] = {}
    for piece, body, depth in zip(*(column.tolist() for column in found), strict=True):
        row, tool = int(path.pieces.block[piece]), tools[numbers[path.pieces.tool[piece]]]
        radius, under = bodies(tool)[body] / METRE
        one = replace(
            _violation(moves, Setup(), row, BODIES[body], (0.0, 0.0), depth / METRE),
            body=f"⌀ {2 * radius:g} mm from {under:g} mm above the tip",
        )
        key = int(moves.file[row]), one.line, one.what
        if key not in seen or one.value > seen[key].value:
            seen[key] = one
    return tuple(seen.values())


def rapid_violations(
    moves: Moves, path: CuttingPath, tools: Mapping[int, Tool], blank: HeightMap
) -> Iterator[Violation]:
    """Rapids that go through the material; arguments as of :func:`contact_violations`."""
    swept, _ = engage(path.pieces, [tools[number] for number in sorted(tools)], blank)
    depth = swept.rapid_depth / METRE
    for row in np.flatnonzero(depth).tolist():
        yield _violation(moves, Setup(), row, RAPID, (0.0, 0.0), float(depth[row]))


def clearance_not_checked(moves: Moves, tools: Mapping[int, Tool]) -> tuple[str, ...]:
    """Tools that move and whose holder is not listed, in words."""
    used = sorted({t for t in moves.tool[moves.length > 0].tolist() if t >= 0})
    without = [t for t in used if t not in tools or not np.isfinite(bodies(tools[t])[1, 1])]
    if not without:
        return ()
    named = ", ".join(f"T{number}" for number in without)
    return (f"holder of {named} (stickout_mm and holder_diameter_mm in the tool table)",)


def extents(moves: Moves) -> tuple[Floats, Floats]:
    """Least and greatest position of each axis in each row, NaN at rest, arcs included; (M, 6)."""
    start, end = moves.start, moves.end
    low = np.where(start != end, end, np.nan)
    high = low.copy()
    arcs = (moves.kind == Kind.ARC) & (moves.angle != 0)
    for plane, (*axes, _) in IN_PLANE.items():
        rows = np.flatnonzero(arcs & (moves.plane == plane))
        if not len(rows):
            continue
        u, v = (start[rows, a] - moves.centre[rows, a] for a in axes)
        begin, sweep = np.arctan2(v, u), moves.angle[rows]
        first, last = moves.radii(rows)
        for quadrant in range(4):
            axis, sign = axes[quadrant % 2], 1.0 if quadrant < 2 else -1.0
            ahead = ((quadrant * np.pi / 2 - begin) * np.sign(sweep)) % (2 * np.pi)
            turns = np.floor((np.abs(sweep) - ahead) / (2 * np.pi))
            for turn in (np.zeros_like(turns), turns):
                share = (ahead + 2 * np.pi * turn) / np.abs(sweep)
                point = moves.centre[rows, axis] + sign * (first + (last - first) * share)
                point = np.where(turns >= 0, point, np.nan)
                low[rows, axis] = np.fmin(low[rows, axis], point)
                high[rows, axis] = np.fmax(high[rows, axis], point)
    return low, high


def spindle_speed(moves: Moves) -> Floats:
    """Speed of the turning spindle [rev/min], NaN where it stands or under G96; shape (M,)."""
    turns = (moves.direction != 0) & (moves.speed > 0) & ~moves.constant_surface_speed
    return np.where(turns, moves.speed, np.nan)


def path_feed(moves: Moves) -> Floats:
    """Programmed feed along the path of cuts [mm/min], NaN of other rows; shape (M,)."""
    length, per_turn = moves.length, moves.feed_mode == FeedMode.PER_REVOLUTION
    feed = np.where(per_turn, moves.feed * moves.speed, moves.feed)
    feed = np.where(moves.feed_mode == FeedMode.INVERSE_TIME, moves.feed * length, feed)
    cuts = np.isin(moves.kind, CUTTING) & (length > 0) & (moves.feed > 0)
    known = cuts & ~(moves.constant_surface_speed & per_turn)
    return np.where(known, feed, np.nan)


def _lengths(moves: Moves, setup: Setup) -> Floats:
    """Length of the tool at each tool change [mm], NaN of other rows; shape (M,)."""
    found = np.full(len(moves), np.nan)
    for row in np.flatnonzero(moves.kind == Kind.TOOL_CHANGE).tolist():
        found[row] = _length(setup, int(moves.tool[row])) or np.nan
    return found


def _set(value: Floats) -> Floats:
    """A modal value where it begins to hold, NaN where it holds on; shape (M,)."""
    known = np.flatnonzero(np.isfinite(value))
    again = known[1:][value[known[1:]] == value[known[:-1]]]
    out = value.copy()
    out[again] = np.nan
    return out


def _beyond(limit: tuple[float, float], low: Floats, high: Floats) -> Iterator[tuple[int, float]]:
    slack = NEAR * max(abs(limit[0]), abs(limit[1]))
    for row in np.flatnonzero(high > limit[1] + slack).tolist():
        yield row, float(high[row])
    for row in np.flatnonzero(low < limit[0] - slack).tolist():
        yield row, float(low[row])


def _violation(
    moves: Moves, setup: Setup, row: int, what: str, limit: tuple[float, float], value: float
) -> Violation:
    tool, file = int(moves.tool[row]), int(moves.file[row])
    return Violation(
        line=int(moves.line[row]), file=Path(moves.files[file]).name if file else "", what=what,
        value=round(value, 6), limit=(float(limit[0]), float(limit[1])),
        frame=moves.frames[moves.frame[row]].name if what in AXES else "", tool=tool,
        tool_length_mm=_length(setup, tool),
    )  # fmt: skip


def _length(setup: Setup, tool: int) -> float | None:
    """Length of a tool in the set-up [mm]; None where it is not listed or 0."""
    listed = setup.tools.get(tool)
    return listed.length or None if listed is not None else None


def _not_checked(
    moves: Moves, setup: Setup, limits: MachineLimits, moved: Sequence[str]
) -> Iterator[str]:
    if without := [axis for axis in moved if axis not in limits.travel]:
        yield f"travel of {', '.join(without)} (setup.limits.travel)"
    if limits.spindle_rpm is None:
        yield "spindle speed (setup.limits.spindle_rpm)"
    if moves.constant_surface_speed.any():
        yield "spindle speed under G96, which depends on the diameter"
    if limits.feed_mm_min is None:
        yield "feed (setup.limits.feed_mm_min)"
    if limits.tool_length_mm is None:
        yield "tool length (setup.limits.tool_length_mm)"
    used = sorted({t for t in moves.tool[moves.kind == Kind.TOOL_CHANGE].tolist() if t > 0})
    if unlisted := [f"T{tool}" for tool in used if _length(setup, tool) is None]:
        yield f"length of {', '.join(unlisted)} (setup.tools): Z is taken as the program has it"


def violation_lines(violations: Sequence[Violation]) -> Iterator[str]:
    """Violations in words, the first of each axis or word; then how many more there are."""
    for what, every in _by_what(violations).items():
        yield from (one.words for one in every[:MOST_SAID])
        if len(every) > MOST_SAID:
            yield f"… and {len(every) - MOST_SAID} more of {what}"


def _by_what(violations: Sequence[Violation]) -> dict[str, list[Violation]]:
    found: dict[str, list[Violation]] = {}
    for one in violations:
        found.setdefault(one.what, []).append(one)
    return found


def preflight_warnings(violations: Sequence[Violation]) -> tuple[CutWarning, ...]:
    """The same as warnings on the page of a cut: one for each axis or word, with its lines."""
    return tuple(
        CutWarning(
            what=f"{_CONTACT if what in BODIES else _BEYOND}: {every[0].words}",
            do=_CLEAR if what in BODIES
            else "Correct the program, the work offset or the tool before it is run.",
            lines=tuple(dict.fromkeys(one.line for one in every)), grave=True,
        )
        for what, every in _by_what(violations).items()
    )  # fmt: skip
