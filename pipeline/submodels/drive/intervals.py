"""90 % intervals of an axis' force and following error: conformal over training recordings.

Each recording is predicted by a drive that was identified from the others.  Where these do not
determine what all together do (a single recording moves the axis at all speeds), it is predicted by
the drive that it helped to identify: of some ten parameters and tens of thousands of samples,
little is its own.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.drive import FOLLOWING, FORCE, DriveAxis
from pipeline.schema.interval import Band
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands, splits
from pipeline.submodels.drive import comparison
from pipeline.submodels.drive.records import Recording
from pipeline.twin.drive import IdentifiedDrive, identified_drive

FOLDS = 5
"""Drives that are identified for the intervals of an axis, at most."""


def with_intervals(
    letter: str, axis: DriveAxis, recordings: Sequence[Recording],
    again: Callable[[list[Recording]], DriveAxis | None], substeps: int,
) -> DriveAxis:  # fmt: skip
    """The axis with the half widths of its force and following error.

    Without those where fewer than two training recordings move the axis.

    Parameters
    ----------
    letter : str
        Of the axis.
    axis : DriveAxis
        As identified from all ``recordings``.
    recordings : sequence of Recording
        Those to train on.
    again : callable
        The axis as some of them tell it; None where they determine less of it.
    substeps : int
        Of the closed loop in one sample [1].
    """
    shown = {one.name: one for one in recordings if one.trained and letter in one.axes}
    errors: dict[str, list[Residuals]] = {FORCE: [], FOLLOWING: []}
    for fitted, left in splits(list(shown), FOLDS):
        drive = identified_drive(again([shown[name] for name in fitted]) or axis)
        for name in left:
            for quantity, error in _errors(shown[name], letter, drive, substeps):
                errors[quantity].append(_residuals(error, name))
    return replace(axis, intervals={
        quantity: _rounded(bands(Residuals.joined(parts))[ALL_REGIMES])
        for quantity, parts in errors.items() if len(parts) > 1
    })  # fmt: skip


def _errors(
    recording: Recording, letter: str, drive: IdentifiedDrive, substeps: int
) -> Iterator[tuple[str, Floats]]:
    """Measured less predicted force [N or the command's unit] and following error [um]."""
    compared = comparison.axis_comparison(recording, letter, drive, substeps)
    force, following = compared.force, compared.following
    if force.seconds >= comparison.LEAST:
        yield FORCE, force.measured - force.modelled
        if not isinstance(following, str):
            yield FOLLOWING, 1e6 * (following.measured - following.modelled)


def _residuals(error: Floats, group: str) -> Residuals:
    count = len(error)
    return Residuals(
        error=error, regime=np.full(count, ALL_REGIMES), group=np.full(count, group),
        t=np.zeros(count),
    )  # fmt: skip


def _rounded(band: Band) -> Band:
    return replace(band, lower=float(f"{band.lower:.4g}"), upper=float(f"{band.upper:.4g}"))
