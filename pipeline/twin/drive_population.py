"""Traces of many variants of an axis under its servo.

A variant is a row of numbers, :class:`pipeline.machine.axis.feed_drive.DriveColumn`.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.axis.feed_drive import DriveColumn, check_rows
from pipeline.schema.arrays import Floats
from pipeline.twin.drive import DriveStart, check_steps, samples


@dataclass(frozen=True, kw_only=True)
class DriveTraces:
    """P individuals of one axis at T samples; every array has shape (P, T)."""

    position: Floats = field(repr=False)
    velocity: Floats = field(repr=False)
    """At the encoder [m], [m/s]."""
    command: Floats = field(repr=False)
    """Set at the sample [A]."""


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
    """Traces of many variants of one axis, the rows of ``table`` (P, columns), under one reference.

    ``reference`` (T,) is commanded each ``period`` [s], in [m]; ``load`` (T,) acts against positive
    motion, before each row's load factor, and holds until the next sample [N].  The mechanics make
    ``substeps`` in a period; with ``servo_substeps`` the servo samples at each of them, its
    reference interpolated linearly: for records that are slower than the servo.  The axis begins at
    ``start``, by default at rest at the first reference; ``state``, :func:`state_before`, is kept
    from call to call where the reference of one variant comes in parts.

    Returns
    -------
    DriveTraces
        Not finite from where an unstable loop has grown out of all numbers.

    Raises
    ------
    ValueError
        When an array has another shape or is not finite, or a row's number is out of its range.
    """
    from pipeline.machine.axis.drive_step import ROWS, drive_traces

    check_steps(period, substeps)
    rows = _rows(table)
    x_ref = samples("reference", reference)
    push = np.zeros(1) if load is None else samples("load", load, len(x_ref))
    if start is None:
        starts = _at_rest(rows, x_ref[:1])
    else:
        first = [start.position, start.velocity, start.command, start.reference_velocity]
        starts = np.tile(first, (len(rows), 1))
    found = np.empty((3, len(rows), len(x_ref)))
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    data = np.empty(ROWS) if state is None else state
    begun = state is not None and bool(np.isfinite(state[0]))
    drive_traces(x_ref, push, rows, starts, period, inner, held, data, begun, *found)
    return DriveTraces(position=found[0], velocity=found[1], command=found[2])


def state_before() -> Floats:
    """What :func:`simulate_traces` keeps of an axis whose reference comes in parts, before them."""
    from pipeline.machine.axis.drive_step import ROWS

    return np.full(ROWS, np.nan)


def _at_rest(rows: Floats, position: Floats) -> Floats:
    """Axes that stand, their commands carrying what is always there; shape (..., 4)."""
    start = np.zeros((*rows.shape[:-1], 4))
    start[..., 0] = position
    start[..., 2] = rows[..., DriveColumn.OFFSET] / rows[..., DriveColumn.FORCE_CONSTANT]
    return start


def _rows(table: ArrayLike) -> Floats:
    rows = np.ascontiguousarray(table, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[-1] != len(DriveColumn) or not rows.size:
        raise ValueError(f"table has shape {rows.shape}: give (P, {len(DriveColumn)})")
    check_rows(rows)
    return rows
