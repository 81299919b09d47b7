"""The whole twin on one answer: speeds that the control reaches, drives, and force waveforms.

A search takes loads of a table, whose chords, angles and jumps err by its stated accuracy
(:mod:`pipeline.cutting.force.load_table`).  Here the peaks of the blocks with the greatest loads are
those of the waveform over a turn, with each tooth's runout, within an eighth of a degree.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.waveform import profile_waveform
from pipeline.optimisation.certainty.critical import critical
from pipeline.twin.cut import Cut
from pipeline.twin.drive_file import IdentifiedDrive
from pipeline.twin.program_axes import follow_program

Floats = NDArray[np.float64]

ROWS = 64
"""Rows whose waveforms are computed, those with the greatest loads of the table."""
ANGLES = 360
"""Of a turn of the spindle, at least."""
FINER = 8
"""Into how many the angles next to the greatest load are divided."""
NOTHING = 1e-6
"""Load that counts as none [N]: that of teeth in balance is what rounding leaves."""
MICROMETRE = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Verified:
    """What the whole twin says of M rows.

    Parameters
    ----------
    row_peak : ndarray, shape (M,)
        Peak across the tool's axis [N]: of the waveform where it was computed, else of the table.
    ratio : ndarray, shape (M,)
        Peak of the waveform over that of the table; 1 where none was computed.
    looked_at : ndarray of bool, shape (M,)
        Where one was.
    f_z : ndarray, shape (M,)
        Feed for each tooth at the highest speed reached [m].
    following_um : dict of str to float, optional
        Greatest following error of each axis while it cuts, in air [um]; None without drives.
    following_reason : str
        Why there is none.
    """

    row_peak: Floats = field(repr=False)
    ratio: Floats = field(repr=False)
    looked_at: NDArray[np.bool_] = field(repr=False)
    f_z: Floats = field(repr=False)
    following_um: dict[str, float] | None
    following_reason: str = ""

    @property
    def peak_N(self) -> float:
        """Greatest of the part [N]."""
        return float(self.row_peak.max(initial=0.0))

    @property
    def peak_row(self) -> int:
        """Where that is; -1 where nothing is cut."""
        return int(np.argmax(self.row_peak)) if self.peak_N > 0 else -1


def verify(
    cut: Cut, *, drives: Mapping[str, IdentifiedDrive] | None = None, rows: int = ROWS
) -> Verified:
    """The whole twin on the plan of a cut.

    Parameters
    ----------
    cut : Cut
        Of the answer, see :func:`pipeline.twin.cut.recut`; M rows.
    drives : mapping of str to IdentifiedDrive, optional
        By the axis' letter.
    rows : int
        Rows whose waveforms are computed, those with the greatest loads of the table.
    """
    f_z, peak = cut.feed_per_tooth, cut.block_loads.peak
    worst = np.argsort(-peak, kind="stable")[:rows]
    worst = worst[peak[worst] > NOTHING]
    found = critical(cut, worst)
    exact = np.zeros(len(peak))
    for row, station in zip(found.row.tolist(), found.own_station.tolist(), strict=True):
        exact[row] = max(exact[row], station_peak(cut, station, float(f_z[row])))
    looked_at = exact > 0
    following, reason = _following(cut, drives)
    return Verified(
        row_peak=np.where(looked_at, exact, peak),
        ratio=np.divide(exact, peak, out=np.ones(len(peak)), where=looked_at),
        looked_at=looked_at, f_z=f_z, following_um=following, following_reason=reason,
    )  # fmt: skip


def station_peak(cut: Cut, station: int, f_z: float) -> float:
    """Peak of the waveform at a station across the tool's axis [N], at a feed for each tooth."""
    tool = cut.tools[cut.engagement.tool[station]]
    several = tool.runout > 0 and tool.flutes > 1
    period = 2 * np.pi / (1 if several else tool.flutes)
    many = ceil(ANGLES / (1 if several else tool.flutes))
    step = period / many
    angles: Floats = step * np.arange(many, dtype=np.float64)
    load = _loads(cut, station, f_z, angles)
    place = FINER * int(np.argmax(load)) + np.arange(1.0 - FINER, FINER)
    about: Floats = step / FINER * place
    return float(max(load.max(), _loads(cut, station, f_z, about).max()))


def _loads(cut: Cut, station: int, f_z: float, angles: Floats) -> Floats:
    engagement = cut.engagement
    index = int(engagement.tool[station])
    forces = profile_waveform(
        cut.laws[index], cut.tools[index], f_z=f_z, lower=engagement.lower[station],
        upper=engagement.upper[station], angles=angles,
        slope=float(np.clip(engagement.slope[station], -1.0, 1.0)),
    )  # fmt: skip
    load: Floats = np.hypot(forces[:, 0], forces[:, 1])
    return load


def _following(
    cut: Cut, drives: Mapping[str, IdentifiedDrive] | None
) -> tuple[dict[str, float] | None, str]:
    if not drives:
        return None, "no drives were identified"
    try:
        axes = follow_program(cut.plan, drives)
    except ValueError as error:
        return None, str(error)
    if not axes:
        return None, "no axis that moves has an identified servo"
    errors = {
        letter: np.abs(one.error[cut.tool[one.row] >= 0]).max(initial=0.0)
        for letter, one in axes.items()
    }
    return {letter: float(error) / MICROMETRE for letter, error in errors.items()}, ""
