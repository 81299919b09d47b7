"""Moves of a part program: rows of a table, paths as straight pieces, their map by feed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.charts.numbers import number
from pipeline.schema.arrays import Floats

COLUMNS = (
    "kind", "x", "y", "z", "cx", "cy", "cz", "angle", "plane",
    "programmed_feed", "reached_feed", "time", "tool",
)  # fmt: skip

CUTTING = ("feed", "arc", "probe", "thread")
IN_PLANE = {17: (0, 1), 18: (2, 0), 19: (1, 2)}
"""First and second axis of a plane: XY, ZX, YZ."""
MOST_PIECES = 720  # of one arc or helix
COLOURS = 6
"""Colours of the scale in style.css, f0 to f5."""
UNKNOWN = -1
"""Class of a missing value."""


@dataclass(frozen=True, kw_only=True)
class Classes:
    """Classes of a quantity between ``bounds``, ascending, each with a colour and its words."""

    bounds: tuple[float, ...]
    unit: str = "mm/min"
    alike: str = "at one feed"
    """Words of the only class there is."""
    unknown: str = "feed not known"

    def __len__(self) -> int:
        return len(self.bounds) + 1

    def of(self, values: Floats) -> np.ndarray:
        """Class of each value; :data:`UNKNOWN` where it is missing."""
        found = np.searchsorted(np.array(self.bounds), values, side="right")
        return np.where(np.isfinite(values), found, UNKNOWN)

    def colour(self, index: int) -> str:
        """CSS name of a class's colour; few classes lie as far apart as many."""
        if index == UNKNOWN:
            return "f-none"
        return f"f{round(index * (COLOURS - 1) / max(1, len(self) - 1))}"

    def words(self, index: int) -> str:
        """Range of a class."""
        ends = [number(round(b) if b >= 1 else b) for b in self.bounds]
        if index == UNKNOWN:
            return self.unknown
        if not ends:
            return self.alike
        if index == 0:
            return f"below {ends[0]} {self.unit}"
        if index == len(ends):
            return f"{ends[-1]} {self.unit} and more"
        return f"{ends[index - 1]} to {ends[index]}"

    def legend(self, index: int) -> tuple[str, str, str]:
        """Entry of a class in the legend."""
        return f"s-{self.colour(index)}", self.words(index), "box"


@dataclass(frozen=True, kw_only=True)
class ProgramMoves:
    """M moves."""

    start: np.ndarray
    end: np.ndarray
    centre: np.ndarray
    """Centre of an arc in the machine's frame [mm]; NaN of other moves."""
    angle: np.ndarray
    """Angle of an arc about its plane's normal, anticlockwise positive [rad]."""
    plane: np.ndarray
    """17, 18 or 19."""
    kind: np.ndarray
    """Kind of move, in lower case."""
    programmed: np.ndarray
    reached: np.ndarray
    """Programmed feed, and the greatest in the block [mm/min]; NaN where there is none."""
    time: np.ndarray
    """Duration of the move [s]."""
    tool: np.ndarray
    """Number of the tool."""

    @property
    def cutting(self) -> np.ndarray:
        """Flags of moves at a feed; shape (M,)."""
        return np.isin(self.kind, CUTTING)

    @property
    def rapid(self) -> np.ndarray:
        """Flags of rapids; shape (M,)."""
        return self.kind == "rapid"


@dataclass(frozen=True, kw_only=True)
class Pieces:
    """Straight pieces from ``a`` to ``b`` (S, 3) [mm], each of the move ``row`` (S,)."""

    a: np.ndarray
    b: np.ndarray
    row: np.ndarray


def program_moves(table: pa.Table, origin: tuple[float, float, float] | None) -> ProgramMoves:
    """Rows of ``table`` with :data:`COLUMNS`; ``origin`` is where the first move starts [mm].

    pyarrow.ArrowException when a column of numbers holds something else.
    """
    end, centre = (
        np.stack([_floats(table, name) for name in names], axis=1)
        for names in (("x", "y", "z"), ("cx", "cy", "cz"))
    )
    kind = pc.fill_null(table.column("kind").cast(pa.string()), "")
    time = _floats(table, "time")
    if len(end):  # without an origin nothing is drawn before the first end
        first = end[0] if origin is None else np.array(origin)
    return ProgramMoves(
        start=np.vstack([first, end[:-1]]) if len(end) else end,
        end=end,
        centre=centre,
        angle=np.nan_to_num(_floats(table, "angle"), posinf=0.0, neginf=0.0),
        plane=_floats(table, "plane"),
        kind=np.char.replace(np.char.lower(np.array(kind.to_pylist(), dtype=str)), "_", " "),
        programmed=_feeds(table, "programmed_feed"),
        reached=_feeds(table, "reached_feed"),
        time=np.where(np.isfinite(time) & (time > 0), time, 0.0),
        tool=np.nan_to_num(_floats(table, "tool"), nan=-1.0).astype(int),
    )


def _floats(table: pa.Table, name: str) -> np.ndarray:
    column = pc.fill_null(table.column(name).cast(pa.float64()), np.nan)
    return np.array(column.to_numpy())


def _feeds(table: pa.Table, name: str) -> np.ndarray:
    feed = _floats(table, name)
    return np.where(np.isfinite(feed) & (feed > 0), feed, np.nan)


def pieces(moves: ProgramMoves, tolerance: float) -> Pieces:
    """Paths of the moves, arcs cut so that no piece leaves its arc by more than ``tolerance`` [mm].

    Moves with an unknown end are left out; an arc without a centre is drawn straight.
    """
    arcs = _arcs(moves)
    count = np.where(arcs, _counts(moves, tolerance), 1)
    row = np.repeat(np.arange(len(count)), count)
    first = np.cumsum(count) - count
    share = np.stack([np.arange(len(row)) - first[row] + i for i in (0, 1)]) / count[row]
    start, end = moves.start[row], moves.end[row]
    a, b = (start + s[:, None] * (end - start) for s in share)
    for plane, axes in IN_PLANE.items():
        here = (arcs & (moves.plane == plane))[row]
        for points, s in ((a, share[0]), (b, share[1])):
            points[here] = _on_arc(moves, row[here], s[here], axes, points[here])
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    return Pieces(a=a[good], b=b[good], row=row[good])


def _arcs(moves: ProgramMoves) -> np.ndarray:
    """Flags of moves that can be drawn as arcs; shape (M,)."""
    known = np.isfinite(moves.centre).all(axis=1) & np.isin(moves.plane, list(IN_PLANE))
    return known & (moves.angle != 0)


def _counts(moves: ProgramMoves, tolerance: float) -> np.ndarray:
    """Pieces of each move, were it an arc: by the sagitta of a piece, at least eight a turn."""
    radius = np.fmax(*radii(moves))
    flat = np.clip(tolerance / np.maximum(np.nan_to_num(radius), 1e-9), 0.0, 1.0)
    step = np.clip(2 * np.arccos(1 - flat), 1e-6, np.pi / 4)
    return np.clip(np.ceil(np.abs(moves.angle) / step), 1, MOST_PIECES).astype(int)


def radii(moves: ProgramMoves) -> tuple[np.ndarray, np.ndarray]:
    """Radius in its plane at the start and at the end of each arc [mm]; NaN in other moves."""
    ends = []
    for point in (moves.start, moves.end):
        found = np.full(len(moves.angle), np.nan)
        for plane, (u, v) in IN_PLANE.items():
            here = moves.plane == plane
            arm = point[here] - moves.centre[here]
            found[here] = np.hypot(arm[:, u], arm[:, v])
        ends.append(found)
    return ends[0], ends[1]


def _on_arc(
    moves: ProgramMoves, row: np.ndarray, share: np.ndarray, axes: tuple[int, int],
    straight: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Points at a ``share`` of arcs; the radius goes linearly, and so does the plane's normal."""
    u, v = axes
    near, far = moves.start[row] - moves.centre[row], moves.end[row] - moves.centre[row]
    r_0, r_1 = np.hypot(near[:, u], near[:, v]), np.hypot(far[:, u], far[:, v])
    radius = r_0 + share * (r_1 - r_0)
    angle = np.arctan2(near[:, v], near[:, u]) + share * moves.angle[row]
    points = straight.copy()
    points[:, u] = moves.centre[row, u] + radius * np.cos(angle)
    points[:, v] = moves.centre[row, v] + radius * np.sin(angle)
    return points


MAP_UNITS = 1200  # across a map, so that a unit is less than a pixel
MAP_BUDGET = (
    120_000  # bytes of one view's paths; beyond it the grid that points lie on gets coarser
)
TALLEST, FLATTEST = (1.0, 0.7), (0.28, 0.14)  # height over width: from above, from the front
LEAST_MM = 1.0  # mm across a map
HIGHEST = 27.0  # rem, of the view from above


@dataclass(frozen=True, kw_only=True)
class View:
    """Frame of a map: ``low`` and ``span`` of X, Y, Z [mm]."""

    low: np.ndarray
    span: np.ndarray


def view(moves: ProgramMoves) -> View:
    """A frame around what is cut, or around all moves where nothing is; rapids may leave it."""
    drawn = moves.cutting if moves.cutting.any() else np.ones(len(moves.time), dtype=bool)
    shown = pieces(moves, _coarse(moves))
    points = np.concatenate([end[drawn[shown.row]] for end in (shown.a, shown.b)])
    if len(points) == 0:
        points = np.zeros((1, 3))
    return framed(points.min(axis=0), points.max(axis=0))


def framed(low: np.ndarray, high: np.ndarray) -> View:
    """A frame around what lies between two corners (3,) [mm]."""
    span = 1.08 * (high - low)
    wide = max(LEAST_MM, float(span[0]), *(span[1:] / TALLEST))
    span = np.concatenate([[wide], np.maximum(span[1:], wide * np.array(FLATTEST))])
    return View(low=(low + high - span) / 2, span=span)


def _coarse(moves: ProgramMoves) -> float:
    """A tenth of a percent of what the moves span [mm]."""
    known = np.nan_to_num(np.concatenate([moves.start, moves.end]))
    radius = np.nan_to_num(radii(moves)[0])
    extent = float(np.ptp(known, axis=0).max(initial=0.0)) if len(known) else 0.0
    return 1e-3 * max(extent, float(radius.max(initial=0.0)), 1e-3)


Axes = tuple[int, int]
"""The two of X, Y, Z that a view shows across and up."""
VIEWS: tuple[tuple[Axes, str], ...] = (((0, 1), "From above"), ((0, 2), "From the front"))


def panel(
    shown: View, axes: Axes, strokes: list[Markup], label: str, *,
    behind: Sequence[Markup] = (), above: Sequence[Markup] = (),
) -> Markup:  # fmt: skip
    """View: its grid, ``strokes`` on the map's grid, background and foreground."""
    wide, high = shown.span[list(axes)]
    inside = svg.tag(
        "svg", svg.group(strokes), x=0, y=0, width="100%", height="100%",
        viewBox=f"0 0 {MAP_UNITS} {round(MAP_UNITS * high / wide)}",
    )  # fmt: skip
    across, up = ("XYZ"[axis] for axis in axes)
    head = svg.text(0, -7, f"{label.partition(':')[0]}: {up} over {across}, mm", "head")
    widest = HIGHEST * float(shown.span[0] / shown.span[1])
    parts = [*behind, *grid(shown, axes), inside, head, *above]
    return svg.map_plot(parts, wide=float(wide / high), most=widest, label=label)


def map_figure(moves: ProgramMoves, classes: Classes, label: str) -> Markup:
    """The view from above and, below it with the same X, the view from the front."""
    shown = view(moves)
    cut = pieces(moves, 0.3 * float(shown.span[0]) / MAP_UNITS)
    kind = np.where(moves.cutting, classes.of(moves.reached), UNKNOWN)
    drawn = PathMap(cut=cut, moves=moves, kind=kind, classes=classes, shown=shown)
    return svg.group(
        [panel(shown, axes, drawn.strokes(axes), f"{words}: {label}") for axes, words in VIEWS]
    )


@dataclass(frozen=True, kw_only=True)
class PathMap:
    """Path of a program in a frame."""

    cut: Pieces
    """Straight pieces of the path."""
    moves: ProgramMoves
    """Moves that they belong to."""
    kind: np.ndarray
    """Class of the feed of each move."""
    classes: Classes
    """Classes of the machine's programs."""
    shown: View
    """Frame of the map."""

    def strokes(self, axes: Axes) -> list[Markup]:
        """Rapids, then classes of feed from fast to slow, so that what is slow lies on top."""
        coarse = 1
        while True:
            drawn = self._drawn(axes, coarse)
            if sum(map(len, drawn)) <= MAP_BUDGET or coarse > MAP_UNITS:
                return drawn
            coarse *= 2

    def _drawn(self, axes: Axes, coarse: int) -> list[Markup]:
        cut, moves, classes = self.cut, self.moves, self.classes
        a, b = (grid_points(p, self.shown, axes, coarse) for p in (cut.a, cut.b))
        cutting, along = moves.cutting[cut.row], self.kind[cut.row]
        sunk = cutting & _along_axis(cut, axes)
        found = [("rapid", stroke(a[moves.rapid[cut.row]], b[moves.rapid[cut.row]]))]
        for index in [UNKNOWN, *reversed(range(len(classes)))]:
            here = cutting & (along == index)
            found.append((classes.colour(index), stroke(a[here], b[here])))
            found.append((f"{classes.colour(index)} dot", dots(b[here & sunk])))
        return [svg.tag("path", d=data, class_=f"curve {name}") for name, data in found if data]


def grid_points(points: np.ndarray, shown: View, axes: Axes, coarse: int) -> np.ndarray:
    """Points (N, 2) on the map's grid of whole numbers, y downwards."""
    u, v = axes
    scale = MAP_UNITS / float(shown.span[0]) / coarse
    flat = np.stack(
        [points[:, u] - shown.low[u], shown.low[v] + shown.span[v] - points[:, v]], axis=1
    )
    limit = 20.0 * MAP_UNITS  # a stray point far outside must not overflow
    return np.rint(np.clip(flat * scale, -limit, limit)).astype(np.int64) * coarse


def _along_axis(cut: Pieces, axes: Axes) -> np.ndarray:
    """Flags of pieces along the tool's axis alone: a dot from above, as a drilled hole is."""
    step = np.abs(cut.b - cut.a)
    return (axes == (0, 1)) & (step[:, :2].max(axis=1) < 1e-3) & (step[:, 2] > 1e-3)


def grid(shown: View, axes: Axes) -> list[Markup]:
    """Lines at round positions of both axes, and their numbers [mm]."""
    parts = []
    for across, axis in zip((True, False), axes, strict=True):
        low, span = float(shown.low[axis]), float(shown.span[axis])
        for mark in svg.ticks(low, low + span, most=3 if axis == 2 else 5):
            share = 100 * (mark - low) / span
            at = f"{share if across else 100 - share:.2f}%"
            words = f"{round(mark, 6) + 0.0:g}".replace("-", "−")
            if across:
                parts.append(svg.tag("line", x1=at, x2=at, y1=0, y2="100%", class_="grid"))
                parts.append(svg.tag("text", words, x=at, y="100%", dy=15, class_="tick mid"))
            else:
                parts.append(svg.tag("line", x1=0, x2="100%", y1=at, y2=at, class_="grid"))
                parts.append(svg.tag("text", words, x=0, y=at, dx=-6, dy=4, class_="tick end"))
    return parts


def stroke(a: np.ndarray, b: np.ndarray) -> str:
    """Path data of straight pieces from ``a`` to ``b``, both (S, 2) of int, in their order.

    Pieces that follow one another are one stroke, straight stretches one step; what covers an
    earlier piece exactly is drawn once, and pieces of no length not at all.
    """
    keep = _first_of_kind(a, b)
    a, b = a[keep], b[keep]
    if len(a) == 0:
        return ""
    follows = np.concatenate([[False], (a[1:] == b[:-1]).all(axis=1)])
    straight = follows & np.concatenate([[False], _same_direction(b[:-1] - a[:-1], b[1:] - a[1:])])
    last = np.flatnonzero(~np.concatenate([straight[1:], [False]]))  # pieces where a step ends
    first = np.flatnonzero(~straight)
    a, b, follows = a[first], b[last], follows[first]
    steps = [f"{x} {y}".replace(" -", "-") for x, y in (b - a).tolist()]
    starts = np.flatnonzero(~follows).tolist()
    parts = [
        f"M{a[i, 0]} {a[i, 1]}l" + " ".join(steps[i:j]).replace(" -", "-")
        for i, j in zip(starts, [*starts[1:], len(steps)], strict=True)
    ]
    return "".join(parts)


def _first_of_kind(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Indices of the pieces that have a length and are the first between their two points."""
    long = np.flatnonzero((a != b).any(axis=1))
    swap = (a[long, 0] > b[long, 0]) | ((a[long, 0] == b[long, 0]) & (a[long, 1] > b[long, 1]))
    ends = np.where(swap[:, None], np.hstack([b, a])[long], np.hstack([a, b])[long])
    _, first = np.unique(ends, axis=0, return_index=True)
    return long[np.sort(first)]


def _same_direction(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    cross = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    return (cross == 0) & ((one * two).sum(axis=1) > 0)


def dots(points: np.ndarray) -> str:
    """Path data of dots at ``points`` (N, 2) of int, each once; drawn by a round line cap."""
    return "".join(f"M{x} {y}h0" for x, y in np.unique(points, axis=0).tolist())
