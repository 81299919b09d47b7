"""Drives of the simulated shop floor as a perfect identification of one mass would have them."""

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.drive import DirectionFriction, FeedDriveParameters, FrictionParameters
from pipeline.shop.drives.axis import hidden, truth
from pipeline.shop.drives.parameters import Axis, Drives
from pipeline.twin.drive import IdentifiedDrive


def shop_drive(axis: Axis) -> IdentifiedDrive:
    """Truth of one axis; lags are those of its filter, current loop and ticks."""
    known, loops = truth(axis), axis.cascade
    sides = {
        side: DirectionFriction(
            coulomb=known[f"coulomb_{side}"], static=known[f"static_{side}"],
            stribeck_velocity=known[f"stribeck_velocity_{side}"], viscous=known[f"viscous_{side}"],
        )
        for side in ("positive", "negative")
    }  # fmt: skip
    return IdentifiedDrive(
        feed_drive=FeedDriveParameters(
            mass=known["mass"], force_constant=known["force_constant"], offset=known["offset"],
            friction=FrictionParameters(**sides),
        ),
        servo=ServoParameters(
            position_gain=loops.position_gain, position_scale=known["position_scale"],
            velocity_gain=loops.velocity_gain, velocity_scale=known["velocity_scale"],
            integral_gain=loops.integral_gain, integral_scale=known["integral_scale"],
            velocity_feedforward=loops.velocity_feedforward,
            acceleration_feedforward=loops.acceleration_feedforward,
            current_limit=loops.current_limit,
            velocity_lag=(loops.velocity_filter + axis.motor.current_lag) * 1e-3
            + 1.5 / loops.velocity_frequency,
            position_lag=0.5 / loops.position_frequency,
        ),
        command_unit="A", force_unit="N", presliding_stiffness=hidden(axis)["bristle_stiffness"],
    )  # fmt: skip


def shop_drives(drives: Drives) -> dict[str, IdentifiedDrive]:
    """All of them by letter."""
    return {letter: shop_drive(axis) for letter, axis in drives.axes.items()}
