"""90 % intervals of force and following error, held against recordings that are new."""

from functools import partial

import numpy as np
import pytest

from pipeline.schema.drive import FOLLOWING, FORCE
from pipeline.submodels.drive import comparison
from pipeline.submodels.drive.comparison import with_intervals
from pipeline.submodels.drive.model import axis_again, identified_axis, stored_axis
from pipeline.submodels.drive.records import AxisConstants, DriveFitSettings, DrivePrior
from pipeline.twin.drive import identified_drive
from tests.submodels.drive.servo_rig import Rig, recording, strokes

SETTINGS = DriveFitSettings(compare=False)
RIG = Rig()
CONSTANTS = AxisConstants(
    position_gain=60.0, velocity_gain=450.0, integral_gain=18e3, force_constant=100.0
)
SPEEDS = (
    (0.002, 0.01, 0.03, 0.1, 0.25),
    (0.003, 0.015, 0.05, 0.12, 0.2),
    (0.004, 0.02, 0.08, 0.22),
)


def strokes_at(speeds, seed, *, trained=True):
    return recording(
        RIG, strokes(speeds), seed, CONSTANTS, name=f"strokes-{seed}.csv", trained=trained
    )


def axis_of(recordings):
    found = identified_axis("X", recordings, DrivePrior(), SETTINGS)
    axis = stored_axis("X", found, recordings)
    again = partial(axis_again, axes={"X": found}, prior=DrivePrior(), settings=SETTINGS)
    return with_intervals({"X": axis}, recordings, again, SETTINGS)["X"]


@pytest.fixture(scope="module")
def axis():
    return axis_of([strokes_at(speeds, seed) for seed, speeds in enumerate(SPEEDS)])


@pytest.mark.parametrize("seed", [10, pytest.param(11, marks=pytest.mark.proof)])
def test_the_intervals_hold_in_a_recording_that_is_new(axis, seed):
    new = strokes_at((0.006, 0.04, 0.15), seed, trained=False)
    found = comparison.axis_comparison(new, "X", identified_drive(axis), SETTINGS.substeps)
    force = found.force.measured - found.force.modelled
    following = 1e6 * (found.following.measured - found.following.modelled)
    for name, error in ((FORCE, force), (FOLLOWING, following)):
        held = np.mean(np.abs(error) <= axis.intervals[name].upper)
        assert 0.8 <= held <= 1.0
        # and they are no wider than need be: the greatest errors are outside of them
        assert axis.intervals[name].upper < np.abs(error).max()
        assert axis.intervals[name].groups == 3


def test_the_drive_has_the_half_width_of_its_following_error(axis):
    drive = identified_drive(axis)
    assert drive.following_half_width == pytest.approx(1e-6 * axis.intervals[FOLLOWING].upper)


def test_one_recording_gives_no_interval():
    alone = axis_of([strokes_at(SPEEDS[0], 0)])
    assert alone.intervals == {}
    assert identified_drive(alone).following_half_width is None


def test_a_recording_that_alone_tells_the_friction_does_not_widen_them(axis):
    """Slow strokes alone know nothing of fast ones: these are not predicted by a drive of those."""
    slow = [strokes_at((0.002, 0.0025), seed) for seed in (3, 4)]
    mixed = axis_of([strokes_at(SPEEDS[0], 0), *slow])
    assert mixed.intervals[FORCE].upper < 1.5 * axis.intervals[FORCE].upper
