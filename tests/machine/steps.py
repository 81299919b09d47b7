"""Single steps of a servo drive, and its traces with what follows from them, for tests."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pipeline.kernels import compiled
from pipeline.machine.axis import drive
from pipeline.machine.axis.drive_parameters import DriveColumn, drive_row
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.twin.drive import check_stability
from tests.twin.axes import DriveParameters


@compiled
def _speed_after(v, push, row, per_newton):  # type: ignore[no-untyped-def]
    up = drive._side(row, DriveColumn.COULOMB_POSITIVE, per_newton)
    down = drive._side(row, DriveColumn.COULOMB_NEGATIVE, per_newton)
    return drive.sliding_step(v, push, up, down)


def speed_after(
    v: float, force: float, mass: float, period: float, friction: FrictionParameters
) -> tuple[float, float]:
    """Speed one step on under a held force, and friction's mean over the step."""
    row = np.zeros(len(DriveColumn))
    for first, side in ((10, friction.positive), (14, friction.negative)):
        row[first : first + 4] = (side.coulomb, side.static, side.stribeck_velocity, side.viscous)
    v_next = _speed_after(float(v), period / mass * force, row, period / mass)
    return v_next, force - mass * (v_next - v) / period


def screw_step(
    x: float, v: float, command: float, load: float, period: float, screw: FeedDriveParameters
) -> tuple[float, float, float]:
    """Position and speed one step on under a held command, and friction's mean over the step."""
    force = screw.force_constant * command - screw.offset - load
    v_next, friction = speed_after(v, force, screw.mass, period, screw.friction)
    return x + 0.5 * period * (v + v_next), v_next, friction


def both(side: DirectionFriction) -> FrictionParameters:
    return FrictionParameters(positive=side, negative=side)


@dataclass(frozen=True, kw_only=True)
class DriveTrace:
    """One axis at T samples; every array has shape (T,)."""

    reference: Floats
    position: Floats
    velocity: Floats
    command: Floats

    @property
    def following_error(self) -> Floats:
        return self.reference - self.position


def simulate_drive(
    reference: ArrayLike, period: float, axis: DriveParameters, **options: object
) -> DriveTrace:
    """The product's trace of one axis whose loop is stable."""
    inner = options.get("substeps", 1) if options.get("servo_substeps") else 1
    held = 1 if options.get("servo_substeps") else options.get("substeps", 1)
    if np.ndim(reference) == 1 and period > 0 and min(inner, held) > 0:
        check_stability(axis.servo, axis.feed_drive, period / inner, held)
    row = drive_row(axis.servo, axis.feed_drive)[np.newaxis]
    found = drive.simulate(reference, period, row, **options)
    return DriveTrace(
        reference=np.asarray(reference, float), position=found.position[0],
        velocity=found.velocity[0], command=found.command[0],
    )  # fmt: skip
