"""90 % intervals of an axis' force and following error: conformal over training recordings.

Each recording is predicted by a drive that was identified from the others.  Where these do not
determine what all together do (a single recording moves the axis at all speeds), it is predicted by
the drive that it helped to identify: of some ten parameters and tens of thousands of samples,
little is its own.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import FOLLOWING, FORCE, DriveAxis
from pipeline.schema.interval import Band
from pipeline.submodels.conformal import ALL_REGIMES, Residuals, bands, splits
from pipeline.submodels.drive import comparison
from pipeline.submodels.drive.prior import DriveFitSettings
from pipeline.submodels.drive.records import Recording, of_axis
from pipeline.twin.drive import IdentifiedDrive, identified_drive

Again = Callable[[str, list[Recording]], DriveAxis | None]


def with_intervals(
    axes: Mapping[str, DriveAxis],
    recordings: Sequence[Recording],
    again: Again,
    settings: DriveFitSettings,
) -> dict[str, DriveAxis]:
    """The axes with the half widths of their force and following error.

    Without those where fewer than two training recordings move an axis.

    ``again`` gives an axis by its letter as some recordings tell it; None where they determine less
    of it.
    """
    tasks = []
    for letter, axis in axes.items():
        shown = {one.name: one for one in of_axis(recordings, letter) if one.trained}
        tasks += [
            (letter, axis, [shown[one] for one in fitted], [shown[one] for one in left])
            for fitted, left in splits(list(shown), settings.folds)
        ]
    parts = mapped(partial(_left_over, again=again, substeps=settings.substeps), tasks)
    errors: dict[tuple[str, str], list[Residuals]] = {}
    for (letter, *_), found in zip(tasks, parts, strict=True):
        for quantity, error in found:
            errors.setdefault((letter, quantity), []).append(error)
    return {
        letter: replace(axis, intervals={
            quantity: _rounded(bands(Residuals.joined(each))[ALL_REGIMES])
            for (of, quantity), each in errors.items() if of == letter and len(each) > 1
        })
        for letter, axis in axes.items()
    }  # fmt: skip


def _left_over(
    fold: tuple[str, DriveAxis, list[Recording], list[Recording]], again: Again, substeps: int
) -> list[tuple[str, Residuals]]:
    """Errors of force and following error of an axis in the recordings left out of a fold."""
    letter, axis, fitted, left = fold
    drive = identified_drive(again(letter, fitted) or axis)
    return [
        (quantity, _residuals(error, one.name))
        for one in left
        for quantity, error in _errors(one, letter, drive, substeps)
    ]


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
