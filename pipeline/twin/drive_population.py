"""Traces of many variants of one axis under its servo, at the encoder.

The equations are those of :mod:`pipeline.twin.drive`, compiled.  A variant is a row of numbers,
:class:`pipeline.machine.axis.feed_drive.DriveColumn`.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pipeline.machine.axis.feed_drive import DriveColumn, check_rows
from pipeline.schema.arrays import Floats
from pipeline.twin.drive import DriveStart, check_steps, samples


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


def simulate_traces(
    reference: ArrayLike,
    period: float,
    table: ArrayLike,
    *,
    load: ArrayLike | None = None,
    substeps: int = 1,
    servo_substeps: bool = False,
    start: DriveStart | None = None,
) -> DriveTraces:
    """Traces of many variants of one axis under one reference.

    Parameters
    ----------
    reference, period, load, substeps, servo_substeps, start
        As of :func:`pipeline.twin.drive.simulate_drive`; each row's load factor counts.
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
    from pipeline.machine.axis.drive_step import ROWS, drive_traces

    check_steps(period, substeps)
    rows = np.ascontiguousarray(table, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(DriveColumn) or not rows.size:
        raise ValueError(f"table has shape {rows.shape}: give (P, {len(DriveColumn)})")
    check_rows(rows)
    x_ref = samples("reference", reference)
    push = np.zeros(1) if load is None else samples("load", load, len(x_ref))
    starts = np.zeros((len(rows), 4))
    if start is None:  # as :func:`pipeline.twin.drive.at_rest`
        starts[:, 0] = x_ref[0]
        starts[:, 2] = rows[:, DriveColumn.OFFSET] / rows[:, DriveColumn.FORCE_CONSTANT]
    else:
        starts[:] = start.position, start.velocity, start.command, start.reference_velocity
    found = np.empty((3, len(rows), len(x_ref)))
    inner, held = (substeps, 1) if servo_substeps else (1, substeps)
    drive_traces(x_ref, push, rows, starts, period, inner, held, np.empty(ROWS), *found)
    return DriveTraces(position=found[0], velocity=found[1], command=found[2])
