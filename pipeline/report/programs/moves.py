"""Moves of a part program: rows of a table, paths as straight pieces, classes of feed."""

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

COLUMNS = (
    "kind", "x", "y", "z", "cx", "cy", "cz", "angle", "plane",
    "programmed_feed", "reached_feed", "time", "tool",
)  # fmt: skip

CUTTING = ("feed", "arc", "probe", "thread")
IN_PLANE = {17: (0, 1), 18: (2, 0), 19: (1, 2)}
"""First and second axis of a plane: XY, ZX, YZ."""
MOST_PIECES = 720  # of one arc or helix


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
        found: np.ndarray = np.isin(self.kind, CUTTING)
        return found

    @property
    def rapid(self) -> np.ndarray:
        """Flags of rapids; shape (M,)."""
        found: np.ndarray = self.kind == "rapid"
        return found


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
    found: np.ndarray = known & (moves.angle != 0)
    return found


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


def lengths(moves: ProgramMoves) -> np.ndarray:
    """Path of X, Y, Z in each move [mm], (M,), exact but for spirals; NaN without an end."""
    step = moves.end - moves.start
    length = np.linalg.norm(step, axis=1)
    r_0, r_1 = radii(moves)
    normal = np.select([moves.plane == 18, moves.plane == 19], [step[:, 1], step[:, 0]], step[:, 2])
    turned = np.abs(moves.angle) * (r_0 + r_1) / 2
    return np.where(_arcs(moves), np.sqrt(turned**2 + normal**2 + (r_1 - r_0) ** 2), length)
