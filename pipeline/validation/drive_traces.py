"""Traces of the drives for people: each axis in each recording, measured and modelled."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

if TYPE_CHECKING:
    from pipeline.validation.drive import Compared

Floats = NDArray[np.float64]

MOST = 4000
"""Rows of an axis in a recording."""
SCHEMA = pa.schema(
    [
        pa.field("axis", pa.string(), nullable=False),
        pa.field("recording", pa.string(), nullable=False),
        pa.field("role", pa.string(), nullable=False),
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("reference_mm", pa.float64()),
        pa.field("velocity_mm_s", pa.float64()),
        pa.field("following_measured_um", pa.float64()),
        pa.field("following_modelled_um", pa.float64()),
        pa.field("command_measured", pa.float64()),
        pa.field("command_modelled", pa.float64()),
    ]
)


def traces_table(found: Sequence["Compared"]) -> pa.Table:
    """Rows of all, null where something was not recorded or not modelled."""
    parts = [_trace(one) for one in found if one.recording.samples]
    return pa.concat_tables(parts) if parts else SCHEMA.empty_table()


def _trace(one: "Compared") -> pa.Table:
    record, recording = one.recording.axes[one.axis], one.recording
    rows = np.unique(np.linspace(0, recording.samples - 1, MOST).astype(int))
    velocity = record.velocity
    if velocity is None and record.position is not None:
        velocity = np.gradient(record.position, recording.period)
    measured = modelled = command = None
    if not isinstance(one.following, str):
        measured, modelled, command = (
            one.following.measured, one.following.modelled, one.following.command,
        )  # fmt: skip
    elif record.reference is not None and record.position is not None:
        measured = record.reference - record.position
    return pa.table(
        [
            *([word] * len(rows) for word in (
                one.axis, recording.name, "training" if recording.trained else "judged")),
            rows * recording.period,
            _taken(record.reference, rows, 1e3), _taken(velocity, rows, 1e3),
            _taken(measured, rows, 1e6), _taken(modelled, rows, 1e6),
            _taken(record.command, rows, 1.0), _taken(command, rows, 1.0),
        ],
        schema=SCHEMA,
    )  # fmt: skip


def _taken(values: Floats | None, rows: NDArray[np.int64], factor: float) -> pa.Array:
    if values is None:
        return pa.nulls(len(rows), pa.float64())
    return pa.array(values[rows] * factor, from_pandas=True)
