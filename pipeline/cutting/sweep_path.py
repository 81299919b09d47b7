"""The pieces of a path, one after the other, compiled: cut, count, and write stations."""

from math import ceil, floor, sqrt

from pipeline.cutting.sweep_columns import sweep
from pipeline.cutting.sweep_recent import CELLS, add_recent, goes_on, keep_recent
from pipeline.cutting.sweep_room import STEPS, Stretch
from pipeline.cutting.sweep_stations import close, take_step
from pipeline.kernels import compiled

STATE = 3
PIECE, DONE, RECENT = range(STATE)
"""Of the state: piece; 0, or where it stopped within it 1 more than the steps before; and whether
what was swept of late is known."""
_STEEP = 0.7
"""Rise over way above which a motion is followed step by step: its way in the plane is short."""


@compiled
def sweep_path(start, end, tool_of, direction, forms, grid, tally, room, out, state, bins):  # type: ignore[no-untyped-def]
    """Follow the path from ``state`` on until its end or until ``out`` is full.

    Returns the number of stations written; ``state`` says where it stopped.
    """
    n = 0
    while state[PIECE] < start.shape[0]:
        piece = state[PIECE]
        tool, spindle = tool_of[piece], -1.0 if direction[piece] < 0 else 1.0
        joined = _joined(start, end, tool_of, piece)
        if state[DONE] == 0 and not (joined and goes_on(start, end, piece)):
            state[RECENT] = 0
        first = n
        n = _sweep_piece(
            start[piece], end[piece], spindle, joined, forms, tool, grid, tally, room, out, n,
            state, bins,
        )  # fmt: skip
        out.piece[first:n] = piece
        if state[DONE] > 0:
            return n
        state[PIECE] = piece + 1
    return n


@compiled
def _sweep_piece(  # type: ignore[no-untyped-def]
    start, end, spindle, joined, forms, tool, grid, tally, room, out, n, state, bins
):
    """Follow a piece from ``state`` on; ``state[DONE]`` is 0 when it is at its end."""
    x, y, z = start
    dx, dy, dz = end[0] - x, end[1] - y, end[2] - z
    way, flat_way = sqrt(dx * dx + dy * dy + dz * dz), sqrt(dx * dx + dy * dy)
    enter, leave = _within(grid, forms.radius[tool], x, y, z, dx, dy, dz)
    if way == 0.0 or enter > leave:
        state[RECENT] = 0
        return n
    plunge = flat_way < 1e-3 * grid.cell
    steps = ceil(way / max(CELLS * grid.cell, 0.1 * forms.radius[tool]) - 1e-9)
    last = min(ceil(leave * steps), steps)
    at_once = 1 if plunge or abs(dz) > _STEEP * way else STEPS
    first = floor(enter * steps)
    begin = state[DONE] - 1 if state[DONE] > 0 else first
    joined = (joined and begin == 0) or begin > first
    while begin < last:
        if n > out.piece.shape[0] - STEPS - 2:
            state[DONE] = begin + 1
            return n
        many = min(at_once, last - begin)
        a, share = begin / steps, many / steps
        length = 0.0 if plunge else flat_way * share
        stretch = Stretch(
            x + dx * a, y + dy * a, z + dz * a,
            1.0 if plunge else dx / flat_way, 0.0 if plunge else dy / flat_way,
            length, 0.0 if plunge else dz / flat_way, dz * share,
            max(length, CELLS * grid.cell) if at_once == 1 else length, many, spindle, joined,
        )  # fmt: skip
        _clear(tally, many, forms.many[tool] + 1)
        sweep(grid, forms, tool, stretch, tally, bins)
        _settle(grid, forms, tool, stretch, at_once == 1, tally, room, state)
        for step in range(begin, begin + many):
            n = take_step(
                grid, forms, tool, tally, step - begin, plunge,
                way * step / steps, way / steps, z + dz * (step + 0.5) / steps, room, out, n,
            )  # fmt: skip
        begin, joined = begin + many, True
    state[DONE] = 0
    return close(forms, tool, room, out, n)


@compiled
def _settle(grid, forms, tool, stretch, steep, tally, room, state):  # type: ignore[no-untyped-def]
    """Complete the counts of a short stretch, and keep what the next one may need."""
    slices, near = forms.many[tool] + 1, CELLS * grid.cell
    nothing = tally.volume[: stretch.steps].sum() == 0.0
    if steep:
        if nothing:
            # what lies beside its way is not cut
            _clear(tally, stretch.steps, slices)
        state[RECENT] = 0
        return
    if stretch.length < near:
        if state[RECENT] == 1:
            add_recent(tally, room, slices, stretch.length, grid.cell)
        keep_recent(tally, room, slices, 0, 1.0)
    else:
        # where a long way removes nothing, what it meets is the division in slices
        if nothing:
            _clear(tally, stretch.steps, slices)
        share = near * stretch.steps / stretch.length
        keep_recent(tally, room, slices, stretch.steps - 1, share)
    state[RECENT] = 1


@compiled
def _clear(tally, steps, slices):  # type: ignore[no-untyped-def]
    """Nothing counted."""
    tally.swept[:steps, :slices] = 0.0
    tally.met[:steps, :slices] = 0.0
    tally.volume[:steps] = 0.0
    tally.deepest[:steps] = 0.0


@compiled
def _joined(start, end, tool_of, piece):  # type: ignore[no-untyped-def]
    """Whether the same tool stood at the beginning of a piece when the one before had ended."""
    if piece == 0 or tool_of[piece - 1] != tool_of[piece]:
        return False
    moved = False
    for axis in range(3):
        if start[piece, axis] != end[piece - 1, axis]:
            return False
        moved = moved or start[piece - 1, axis] != end[piece - 1, axis]
    # a piece without length cut nothing around itself
    return moved


@compiled
def _within(grid, radius, x, y, z, dx, dy, dz):  # type: ignore[no-untyped-def]
    """First and last part of a piece at which the tool may be in the stock."""
    rows, columns = grid.heights.shape
    wide, deep = columns * grid.cell, rows * grid.cell
    enter, leave = _between(x, dx, grid.x0 - radius, grid.x0 + wide + radius)
    enter_y, leave_y = _between(y, dy, grid.y0 - radius, grid.y0 + deep + radius)
    enter_z, leave_z = _between(z, dz, min(z, z + dz) - 1.0, grid.top)
    return max(enter, enter_y, enter_z), min(leave, leave_y, leave_z)


@compiled
def _between(begin, rise, low, high):  # type: ignore[no-untyped-def]
    """First and last part, of 0 to 1, at which begin + part rise lies from ``low`` to ``high``."""
    if rise == 0.0:
        return (0.0, 1.0) if low <= begin <= high else (1.0, 0.0)
    a, b = (low - begin) / rise, (high - begin) / rise
    return max(min(a, b), 0.0), min(max(a, b), 1.0)
