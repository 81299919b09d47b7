"""Path of a program from above and from the front, coloured by the reached feed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from pipeline.charts import svg
from pipeline.report.programs.moves import Pieces, ProgramMoves, pieces, radii
from pipeline.report.programs.panels import UNKNOWN, Classes

UNITS = 1200  # across a map, so that a unit is less than a pixel
BUDGET = 120_000  # bytes of one view's paths; beyond it the grid that points lie on gets coarser
TALLEST, FLATTEST = (1.0, 0.7), (0.28, 0.14)  # height over width: from above, from the front
LEAST = 1.0  # mm across a map
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
    wide = max(LEAST, float(span[0]), *(span[1:] / TALLEST))
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
        viewBox=f"0 0 {UNITS} {round(UNITS * high / wide)}",
    )  # fmt: skip
    across, up = ("XYZ"[axis] for axis in axes)
    head = svg.text(0, -7, f"{label.partition(':')[0]}: {up} over {across}, mm", "head")
    widest = HIGHEST * float(shown.span[0] / shown.span[1])
    parts = [*behind, *grid(shown, axes), inside, head, *above]
    return svg.map_plot(parts, wide=float(wide / high), most=widest, label=label)


def map_figure(moves: ProgramMoves, classes: Classes, label: str) -> Markup:
    """The view from above and, below it with the same X, the view from the front."""
    shown = view(moves)
    cut = pieces(moves, 0.3 * float(shown.span[0]) / UNITS)
    kind = np.where(moves.cutting, classes.of(moves.reached), UNKNOWN)
    drawn = PathMap(cut=cut, moves=moves, kind=kind, classes=classes, shown=shown)
    return svg.group([
        panel(shown, axes, drawn.strokes(axes), f"{words}: {label}") for axes, words in VIEWS
    ])  # fmt: skip


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
            if sum(map(len, drawn)) <= BUDGET or coarse > UNITS:
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
    scale = UNITS / float(shown.span[0]) / coarse
    flat = np.stack(
        [points[:, u] - shown.low[u], shown.low[v] + shown.span[v] - points[:, v]], axis=1
    )
    limit = 20.0 * UNITS  # a stray point far outside must not overflow
    found: np.ndarray = np.rint(np.clip(flat * scale, -limit, limit)).astype(np.int64) * coarse
    return found


def _along_axis(cut: Pieces, axes: Axes) -> np.ndarray:
    """Flags of pieces along the tool's axis alone: a dot from above, as a drilled hole is."""
    step = np.abs(cut.b - cut.a)
    found: np.ndarray = (axes == (0, 1)) & (step[:, :2].max(axis=1) < 1e-3) & (step[:, 2] > 1e-3)
    return found


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
