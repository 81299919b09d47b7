"""What the spindle of the simulated shop draws, and what its load meter shows."""

import numpy as np

from pipeline.shop.s_curve import Floats
from pipeline.shop.spindle_load_parameters import SpindleTests
from pipeline.shop.spindle_parameters import BearingParameters, MotorParameters, SpindleParameters

RPM = 2 * np.pi / 60
SLOWEST = 10.0
"""Below this speed the meter counts as at it [rev/min]."""
FULL = 200.0
"""The meter's end [percent]."""
TREMBLE = 0.1
"""Time constant of its noise [s]."""


def no_load_power(speed: Floats, spindle: SpindleParameters, oil: float) -> Floats:
    """Power that the spindle takes without a cut at each speed [rev/min], in [W].

    Friction of all bearings with oil of ``oil`` [degC] (Palmgren), and the air about the rotor.
    """
    from pipeline.shop.losses import viscosity, viscosity_line

    thick = viscosity(oil, *viscosity_line(spindle.viscosity_40, spindle.viscosity_100))
    torque = sum(_friction(b, speed, thick) for b in (spindle.front, spindle.rear))
    air = spindle.motor.windage * (speed / 12000) ** 3
    power: Floats = np.where(speed >= 1, torque * speed * RPM + air, 0.0)
    return power


def _friction(bearings: BearingParameters, speed: Floats, thick: float) -> Floats:
    """Torque of a set of bearings in oil ``thick`` [mm2/s], in [N m]."""
    from pipeline.shop.losses import friction_torque

    b, distinct = bearings, np.unique(speed)
    torque = [
        b.count * friction_torque(n, thick, b.preload, b.mean_diameter, b.f0, b.static_capacity)
        for n in distinct.tolist()
    ]
    out: Floats = np.interp(speed, distinct, torque)
    return out


def available_power(speed: Floats, motor: MotorParameters) -> Floats:
    """Rated power at each speed [rev/min], in [W]: torque is limited below the base speed."""
    shares = np.minimum(np.maximum(speed, SLOWEST) / motor.base_speed, 1.0)
    power: Floats = motor.rated_power * shares
    return power


def shown_load(
    speed: Floats, cutting: Floats, cycle: float, spindle: SpindleParameters,
    tests: SpindleTests, random: np.random.Generator,
) -> Floats:  # fmt: skip
    """What the load meter shows in each cycle, shape (T,) [percent].

    Parameters
    ----------
    speed, cutting : (T,) arrays
        Of the spindle [rev/min], power of the cut at the tool [W].
    cycle : float
        [s].
    spindle, tests, random
        The spindle, what its meter is like, and chance.
    """
    from pipeline.shop.filters import lagged

    turning = np.gradient(speed * RPM, cycle) * speed * RPM * spindle.motor.inertia
    steady = no_load_power(speed, spindle, tests.oil_temperature)
    power = np.abs(steady + cutting / tests.efficiency + turning)
    load = 100 * power / available_power(speed, spindle.motor)
    smooth = lagged(load, -np.expm1(-cycle / tests.lag), 0.0)
    share = -np.expm1(-cycle / TREMBLE)
    noise = lagged(random.standard_normal(speed.size), share, 0.0) * np.sqrt((2 - share) / share)
    seen = np.clip(smooth + tests.noise * noise * (speed >= 1), 0.0, FULL)
    out: Floats = np.round(np.round(seen / tests.step) * tests.step, 2)
    return out
