"""Populations of axes under their servos: following errors and commands, or traces.

A variant is a row of numbers for
each axis, :class:`pipeline.machine.axis.feed_drive.DriveColumn`.  Errors are those at the encoder:
backlash does not show in them.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.axis.feed_drive import DriveColumn, check_rows, drive_row
from pipeline.schema.arrays import Floats
from pipeline.twin.drive import DriveParameters, DriveStart, check_steps, samples


@dataclass(frozen=True, kw_only=True)
class DriveErrors:
    """P individuals of A axes; every array has shape (P, A), inf where an unstable loop ran away.

    Parameters
    ----------
    max_error, rms_error : array
        Greatest and root mean square following error at the servo's samples [m].
    max_command, rms_command : array
        Of the command [A].
    """

    max_error: Floats = field(repr=False)
    rms_error: Floats = field(repr=False)
    max_command: Floats = field(repr=False)
    rms_command: Floats = field(repr=False)


@dataclass(frozen=True, kw_only=True)
class DriveTraces:
    """P individuals of one axis at T samples; every array has shape (P, T).

    Parameters
    ----------
    position, velocity : array
        At the encoder [m], [m/s].
    command : array
        Set at the sample [A].
    """

    position: Floats = field(repr=False)
    velocity: Floats = field(repr=False)
    command: Floats = field(repr=False)


def drive_table(individuals: Sequence[Sequence[DriveParameters]]) -> Floats:
    """Rows of individuals, each a sequence of its axes; shape (P, A, columns).

    Raises
    ------
    ValueError
        When there are none, or not all have as many axes.
    """
    counts = sorted({len(axes) for axes in individuals})
    if len(counts) != 1 or counts[0] == 0:
        raise ValueError(f"the individuals have {counts} axes: give each as many, at least one")
    return np.array([[drive_row(d.servo, d.feed_drive) for d in axes] for axes in individuals])


def population_errors(
    reference: ArrayLike,
    period: float,
    table: ArrayLike,
    *,
    load: ArrayLike | None = None,
    substeps: int = 1,
    servo_substeps: bool = False,
    threads: int | None = None,
) -> DriveErrors:
    """Follow references from rest, many individuals at once.

    Parameters
    ----------
    reference : (T, A) or (P, T, A) array_like
        Commanded positions [m]: the same for all individuals, or each its own.
    period, substeps, servo_substeps
        As of :func:`simulate_traces`.
    table : (P, A, columns) array_like
        The individuals, :func:`drive_table`.
    load : (T, A) or (P, T, A) array_like, optional
        Against positive motion, before each row's load factor [N].
    threads : int, optional
        As many as there are processors by default.

    Returns
    -------
    DriveErrors

    Raises
    ------
    ValueError
        When an array has another shape or is not finite, or a row's number is out of its range.
    """
    check_steps(period, substeps)
    rows = _rows(table, 3)
    many, axes = rows.shape[:2]
    motion = _grid("reference", reference, many, axes)
    push = np.zeros((1, 1, axes)) if load is None else _grid("load", load, many, axes)
    if load is not None and push.shape[1] != motion.shape[1]:
        raise ValueError(
            f"load has {push.shape[1]} samples, the reference {motion.shape[1]}: give as many"
        )
    start = _at_rest(rows, np.broadcast_to(motion[:, 0], (many, axes)))
    found = np.empty((many, axes, 4))
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    _fill(motion, push, rows, start, period, inner=inner, held=held, threads=threads, found=found)
    lost = ~np.isfinite(found).all(axis=-1)
    if lost.any():
        # what is not finite comes through to the end: looking at all samples first takes longer
        _check_finite("reference", motion)
        _check_finite("load", push)
        found[lost] = np.inf
    return DriveErrors(
        max_error=found[..., 0], rms_error=found[..., 1],
        max_command=found[..., 2], rms_command=found[..., 3],
    )  # fmt: skip


def simulate_traces(
    reference: ArrayLike,
    period: float,
    table: ArrayLike,
    *,
    load: ArrayLike | None = None,
    substeps: int = 1,
    servo_substeps: bool = False,
    start: DriveStart | None = None,
    state: Floats | None = None,
) -> DriveTraces:
    """Traces of many variants of one axis under one reference.

    Parameters
    ----------
    reference : (T,) array_like
        Commanded position [m].
    period : float
        From sample to sample [s].
    load : (T,) array_like, optional
        Against positive motion, before each row's load factor; holds until the next sample [N].
    substeps : int
        Steps of the mechanics in one period.
    servo_substeps : bool
        Whether the servo samples at each substep, its reference interpolated linearly: for records
        that are slower than the servo.
    start : DriveStart, optional
        At rest at the first reference by default.
    state : array, optional
        Of one variant, :func:`state_before`, kept from call to call, where a reference comes in
        parts.
    table : (P, columns) array_like
        The variants, rows of :func:`pipeline.machine.axis.feed_drive.drive_row`.

    Returns
    -------
    DriveTraces
        Not finite from where an unstable loop has grown out of all numbers.

    Raises
    ------
    ValueError
        When an array has another shape or is not finite, or a row's number is out of its range.
    """
    from pipeline.machine.axis.drive_step import LANES, ROWS
    from pipeline.machine.axis.simd_population import drive_traces

    check_steps(period, substeps)
    rows = _rows(table, 2)
    x_ref = samples("reference", reference)
    push = np.zeros(1) if load is None else samples("load", load, len(x_ref))
    if start is None:
        starts = _at_rest(rows, x_ref[:1])
    else:
        first = [start.position, start.velocity, start.command, start.reference_velocity]
        starts = np.tile(first, (len(rows), 1))
    found = np.empty((3, len(rows), len(x_ref)))
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    data = np.empty(ROWS * LANES) if state is None else state
    begun = state is not None and bool(np.isfinite(state[0]))
    drive_traces(x_ref, push, rows, starts, period, inner, held, data, begun, *found)
    return DriveTraces(position=found[0], velocity=found[1], command=found[2])


def state_before() -> Floats:
    """What :func:`simulate_traces` keeps of an axis whose reference comes in parts, before them."""
    from pipeline.machine.axis.drive_step import LANES, ROWS

    return np.full(ROWS * LANES, np.nan)


def _fill(
    motion: Floats, push: Floats, rows: Floats, start: Floats, period: float, *,
    inner: int, held: int, threads: int | None, found: Floats,
) -> None:  # fmt: skip
    """Share blocks of lanes among threads; the compiled loop lets go of the interpreter."""
    from pipeline.machine.axis.drive_step import LANES, ROWS
    from pipeline.machine.axis.simd_population import CHUNK, drive_errors

    many, axes = rows.shape[:2]
    blocks = -(-many // LANES)
    shares = min(threads or os.cpu_count() or 1, blocks)
    ends = [min(LANES * (blocks * i // shares), many) for i in range(shares + 1)]

    def part(i: int) -> None:
        room, coming = _on_lines(axes * ROWS * LANES), _on_lines(CHUNK * axes * 2 * LANES)
        drive_errors(
            motion, push, rows, start, ends[i], ends[i + 1], period, inner, held, LANES, room,
            coming, found,
        )  # fmt: skip

    if shares == 1:
        part(0)
        return
    with ThreadPoolExecutor(shares) as pool:
        list(pool.map(part, range(shares)))


def _on_lines(size: int) -> Floats:
    """Room that begins on a line of the cache, so that no vector lies on two [64 bytes]."""
    room = np.zeros(size + 8)
    first = -room.ctypes.data % 64 // 8
    return room[first : first + size]


def _at_rest(rows: Floats, position: Floats) -> Floats:
    """Axes that stand, their commands carrying what is always there; shape (..., 4)."""
    start = np.zeros((*rows.shape[:-1], 4))
    start[..., 0] = position
    start[..., 2] = rows[..., DriveColumn.OFFSET] / rows[..., DriveColumn.FORCE_CONSTANT]
    return start


def _rows(table: ArrayLike, dimensions: int) -> Floats:
    rows = np.ascontiguousarray(table, dtype=np.float64)
    if rows.ndim != dimensions or rows.shape[-1] != len(DriveColumn) or not rows.size:
        axes = "(P, A" if dimensions == 3 else "(P"
        raise ValueError(f"table has shape {rows.shape}: give {axes}, {len(DriveColumn)})")
    check_rows(rows)
    return rows


def _grid(name: str, values: ArrayLike, many: int, axes: int) -> Floats:
    grid = np.ascontiguousarray(values, dtype=np.float64)
    if grid.ndim == 2:
        grid = grid[np.newaxis]
    if grid.ndim != 3 or grid.shape[0] not in (1, many) or grid.shape[2] != axes or not grid.size:
        raise ValueError(
            f"{name} has shape {np.shape(values)}: give (T, {axes}) or ({many}, T, {axes})"
        )
    return grid


def _check_finite(name: str, grid: Floats) -> None:
    if not np.isfinite(grid).all():
        at = [int(i) for i in np.argwhere(~np.isfinite(grid))[0]]
        raise ValueError(f"{name}{at} = {grid[tuple(at)]}: give finite samples")
