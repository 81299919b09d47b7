"""The record of an axis motor under speed steps and load, as the drive's own trace writes it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.shop.drive_parameters import Axis
from pipeline.shop.motor_parameters import AxisMotor
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.s_curve import Floats
from pipeline.shop.servo_tool import Column, write_trace

if TYPE_CHECKING:
    from pipeline.shop.motor_motion import Machine

RATE = 10000
"""Rows a second, and the rate of the current loops."""
STEPS = 5
"""Of the integration in each."""
SPEEDS = (300.0, -300.0, 900.0, -900.0, 1500.0, -1500.0, 2200.0, -2200.0, 600.0, -600.0, 0.0)
"""Commanded one after the other [rev/min]."""
HOLD = 0.5
"""Time for each [s]."""
FIELD = (0.0, -3.0, 2.0)
"""Commanded i_d [A], each for a third of the time of a speed."""
PUSH = 6.0
"""Torque of the load in the second half of every other speed [N m]."""
BANDWIDTH = 2 * np.pi * 500
"""Of the current loops [rad/s]."""
RPM = 2 * np.pi / 60
NAMES = {
    "plain": ("Ud", "Uq", "Id", "Iq", "Speed"),
    "bracketed": ("UD(X)", "UQ(X)", "ID(X)", "IQ(X)", "SPEED(X)"),
}
UNITS = ("V", "V", "A", "A", "1/min")
DECIMALS = (2, 2, 3, 3, 2)
NOISE = (0.0, 0.0, 0.02, 0.02, 0.05)
"""Standard deviations of what is measured, in those units; voltages are commands."""


def write_motor(folder: Path, parameters: ShopParameters) -> tuple[dict[str, Any], dict[str, Any]]:
    """Write ``motor/speed-steps-X.csv``: what the motor is, and what is true of the file."""
    axis, tool = parameters.drives.x, parameters.drives.tool
    out = speed_steps(axis)
    random = parameters.generator("motor speed-steps-X")
    scales = (1.0, 1.0, 1.0, 1.0, 1 / RPM)
    columns = [
        Column(
            name=name, unit=unit, decimals=digits,
            values=out[:, k] * scales[k] + random.standard_normal(len(out)) * NOISE[k],
        )
        for k, (name, unit, digits) in enumerate(
            zip(NAMES[tool.style], UNITS, DECIMALS, strict=True)
        )
    ]  # fmt: skip
    file = "motor/speed-steps-X.csv"
    head = {"Machine": parameters.machine, "Axis": "X", "Sampling": f"{1e3 / RATE:g} ms"}
    done = write_trace(folder / file, head, columns, RATE, tool, None)
    return _truth(axis, out), {"file": file, **done}


def speed_steps(axis: Axis) -> Floats:
    """What the motor of an axis does, columns as of :func:`.motor_motion.driven`."""
    from pipeline.shop.motor_motion import driven

    part = np.arange(int(HOLD * RATE)) / (HOLD * RATE)
    top = axis.motor.top_speed
    speed = np.concatenate([np.full(part.size, np.clip(v, -top, top)) for v in SPEEDS]) * RPM
    field = np.tile(np.array(FIELD)[np.minimum((part * 3).astype(int), 2)], len(SPEEDS))
    pushed = [np.where(part > 0.5, PUSH * (k % 2), 0.0) for k in range(len(SPEEDS))]
    out: Floats = driven(_machine(axis), speed, field, np.concatenate(pushed))
    return out


def _machine(axis: Axis) -> "Machine":
    from pipeline.shop.motor_motion import Machine

    motor, f = axis.motor, axis.friction
    inertia = axis.inertia + axis.carriage / axis.gear**2
    viscous = axis.motor_viscous + (f.viscous_positive + f.viscous_negative) / 2 / axis.gear**2
    bandwidth = 2 * np.pi * 30
    gain = bandwidth * inertia / motor.torque_constant
    return Machine(
        period=1 / RATE, steps=STEPS, pole_pairs=float(motor.pole_pairs),
        resistance=motor.resistance, inductance_d=motor.inductance_d * 1e-3,
        inductance_q=motor.inductance_q * 1e-3,
        saturation=motor.saturation / motor.saturation_current**2, flux=motor.flux,
        inertia=inertia, viscous=viscous,
        coulomb=(f.coulomb_positive + f.coulomb_negative) / 2 / axis.gear,
        heat_capacity=motor.heat_capacity, cooling=motor.cooling,
        lost_voltage=motor.dead_time_error, limit_voltage=motor.bus_voltage / np.sqrt(3),
        limit_current=motor.saturation_current, current_gain=BANDWIDTH, speed_gain=gain,
        speed_integral=gain * bandwidth / 6,
    )  # fmt: skip


def _truth(axis: Axis, out: Floats) -> dict[str, Any]:
    """In SI; R and L_q of the record's middle, beside those of a cold motor without current."""
    from pipeline.shop.motor_motion import COPPER, I_Q, WARMTH

    motor: AxisMotor = axis.motor
    warm = motor.resistance * (1 + COPPER * out[:, WARMTH])
    bend = motor.saturation * (out[:, I_Q] / motor.saturation_current) ** 2
    return {
        "axis": "X",
        "R": float(warm.mean()),
        "L_d": motor.inductance_d * 1e-3,
        "L_q": motor.inductance_q * 1e-3 * float(1 - bend.mean()),
        "flux": motor.flux,
        "pole_pairs": motor.pole_pairs,
        "R_cold": motor.resistance,
        "R_at_end": float(warm[-1]),
        "L_q_without_current": motor.inductance_q * 1e-3,
        "dead_time_voltage": motor.dead_time_error,
    }
