"""Mean revolutions of recordings, measured and predicted, as they are shown."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.identification.cutting.known import CHANNELS, CuttingKnown
from pipeline.identification.cutting.records import CuttingRecording
from pipeline.identification.cutting.revolution import GRID, wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

BANDS = ("measured", "low", "high", "modelled", "plain", "cross")
COLUMNS = [f"{band}_{channel}" for band in BANDS for channel in CHANNELS]


def traces_of(
    recording: CuttingRecording,
    modelled: Complexes,
    plain: Complexes,
    cross: Complexes | None,
    known: CuttingKnown,
) -> pa.Table:
    """One recording: forces that the channels show over the angle of the spindle [N].

    Parameters
    ----------
    recording : CuttingRecording
        Measured.
    modelled, plain : ndarray of complex, shape (H + 1, 3)
        Predicted harmonics of the force on the tool, in the recording's phase.
    cross : ndarray of complex, shape (H + 1, 3), optional
        The same of a fit without this recording; its columns are NaN without one.
    known : CuttingKnown
        How the dynamometer stands.
    """
    _, revolution = recording.cut
    turning = known.dynamometer.turning
    angles = np.linspace(0.0, 2 * np.pi, GRID, endpoint=False)
    ends = np.stack([revolution.low @ turning, revolution.high @ turning])
    shown = np.concatenate(
        [
            wave(revolution.lines, angles) @ turning, ends.min(axis=0), ends.max(axis=0),
            wave(modelled, angles) @ turning, wave(plain, angles) @ turning,
            np.full((GRID, 3), np.nan) if cross is None else wave(cross, angles) @ turning,
        ],
        axis=1,
    )  # fmt: skip
    columns = {name: np.round(shown[:, k], 4) for k, name in enumerate(COLUMNS)}
    names = pa.array([recording.name] * GRID)
    return pa.table({"recording": names, "angle_deg": np.degrees(angles), **columns})


def traces_table(parts: Sequence[pa.Table]) -> pa.Table:
    """All recordings, one under the other; its columns alone when there is none."""
    if parts:
        return pa.concat_tables(parts)
    fields = [pa.field("recording", pa.string())]
    fields += [pa.field(name, pa.float64()) for name in ("angle_deg", *COLUMNS)]
    return pa.schema(fields).empty_table()
