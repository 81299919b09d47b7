"""What the simulated motor spindle is: bearings, motor, masses, heat paths, chiller.

Typical of a 15 kW, 12 000 rpm integrated motor spindle with hybrid angular contact bearings.
Sources of the orders of magnitude:

- Harris, Kotzalas: *Rolling Bearing Analysis*, 5th ed., ch. 10 (Palmgren's friction torque);
  SKF and FAG super-precision catalogues (70xx C hybrid series: diameters, preload, capacity, f0).
- Bossmanns, Tu: *A thermal model for high speed motorized spindles*, Int. J. Mach. Tools Manuf. 39
  (1999) 1345-1366 (motor loss split, air gap, jacket, share of each heat path).
- Catalogue efficiency of 15 kW induction spindle motors, 88 to 91 % at the rated point: about 6 %
  stator copper, 3 % rotor copper, 3 % iron (IEC 60034-2-1 gives the split of losses).
- Masses times specific heat (steel 460, cast iron 500, copper 385, water 4180 J/kg K).
"""

from dataclasses import dataclass, field

from pipeline.shop.ranges import Ranged, quantity


@dataclass(frozen=True, kw_only=True)
class BearingParameters(Ranged):
    """A set of equal angular contact ball bearings."""

    count: int = quantity(2, "1", 1, 6)
    mean_diameter: float = quantity(0.0825, "m", 0.02, 0.3)
    f0: float = quantity(1.0, "1", 0.3, 10.0)  # oil-air; 2 for grease (Harris, table 10.3)
    preload: float = quantity(450.0, "N", 0.0, 5e3)
    static_capacity: float = quantity(29e3, "N", 1e3, 1e6)
    thermal_preload: float = quantity(0.06, "1/K", 0.0, 0.5)  # shaft grows against housing


@dataclass(frozen=True, kw_only=True)
class MotorParameters(Ranged):
    """An induction motor with field weakening above its base speed."""

    rated_power: float = quantity(15e3, "W", 1e3, 1e5)
    base_speed: float = quantity(2500.0, "rev/min", 100, 2e4)
    copper_loss: float = quantity(900.0, "W", 10, 1e4)  # stator, rated point, at 20 degC
    rotor_loss: float = quantity(420.0, "W", 0, 1e4)
    hysteresis_loss: float = quantity(240.0, "W", 0, 1e4)  # at base speed and full flux
    eddy_loss: float = quantity(150.0, "W", 0, 1e4)
    magnetising_share: float = quantity(0.5, "1", 0.1, 0.9)  # of rated current
    hold_share: float = quantity(0.25, "1", 0.0, 1.0)  # servo torque at standstill, rms, of rated
    windage: float = quantity(90.0, "W", 0, 2e3)  # air gap shear at 12 000 rev/min, grows as n^3
    inertia: float = quantity(0.055, "kg m2", 1e-4, 5)
    acceleration: float = quantity(3500.0, "rev/min/s", 100, 1e5)


@dataclass(frozen=True, kw_only=True)
class MassParameters(Ranged):
    """Heat capacities of the nodes of the network."""

    winding: float = quantity(2.6e3, "J/K", 100, 1e6)
    stator: float = quantity(9.5e3, "J/K", 100, 1e6)
    rotor: float = quantity(8.5e3, "J/K", 100, 1e6)
    front_bearing: float = quantity(2.6e3, "J/K", 100, 1e6)
    rear_bearing: float = quantity(1.5e3, "J/K", 100, 1e6)
    housing: float = quantity(26e3, "J/K", 100, 1e7)
    head: float = quantity(125e3, "J/K", 100, 1e8)
    bed: float = quantity(1.5e6, "J/K", 1e4, 1e8)
    chiller: float = quantity(110e3, "J/K", 1e3, 1e7)
    coolant: float = quantity(1.1e6, "J/K", 1e3, 1e8)


@dataclass(frozen=True, kw_only=True)
class PathParameters(Ranged):
    """Conductances between nodes; where flow or speed matters, at its nominal value."""

    winding_stator: float = quantity(95.0, "W/K", 0.1, 1e4)
    stator_housing: float = quantity(34.0, "W/K", 0.1, 1e4)
    stator_jacket: float = quantity(24.0, "W/K", 0.1, 1e4)
    stator_rotor: float = quantity(5.0, "W/K", 0.0, 1e4)  # air gap at rest
    rotor_front: float = quantity(9.0, "W/K", 0.1, 1e4)
    rotor_rear: float = quantity(7.0, "W/K", 0.1, 1e4)
    front_housing: float = quantity(20.0, "W/K", 0.1, 1e4)
    rear_housing: float = quantity(13.0, "W/K", 0.1, 1e4)
    housing_jacket: float = quantity(28.0, "W/K", 0.0, 1e4)
    housing_head: float = quantity(22.0, "W/K", 0.1, 1e4)
    head_bed: float = quantity(18.0, "W/K", 0.1, 1e4)
    nose_coolant: float = quantity(9.0, "W/K", 0.0, 1e4)  # flood on the spindle's nose
    bed_coolant: float = quantity(15.0, "W/K", 0.0, 1e4)
    nose_air: float = quantity(1.5, "W/K", 0.0, 1e4)
    housing_air: float = quantity(2.2, "W/K", 0.0, 1e4)
    head_air: float = quantity(9.0, "W/K", 0.0, 1e4)
    bed_air: float = quantity(38.0, "W/K", 0.0, 1e4)
    chiller_air: float = quantity(4.0, "W/K", 0.0, 1e4)
    coolant_air: float = quantity(90.0, "W/K", 0.0, 1e4)  # with evaporation


@dataclass(frozen=True, kw_only=True)
class ChillerParameters(Ranged):
    """A two-point chiller of finite capacity."""

    setpoint: float = quantity(22.0, "degC", 5, 40)
    follows_ambient: bool = False  # then ``setpoint`` is what is added to ambient [K] less 20
    hysteresis: float = quantity(0.8, "K", 0.05, 10)
    capacity: float = quantity(2600.0, "W", 50, 5e4)  # at 20 degC ambient
    capacity_slope: float = quantity(0.012, "1/K", 0, 0.1)  # lost for each kelvin of ambient


@dataclass(frozen=True, kw_only=True)
class SpindleParameters(Ranged):
    """The spindle with everything that heats and cools it."""

    top_speed: float = quantity(12000.0, "rev/min", 500, 1e5)
    front: BearingParameters = field(default_factory=BearingParameters)
    rear: BearingParameters = field(
        default_factory=lambda: BearingParameters(
            mean_diameter=0.07, preload=300.0, static_capacity=21e3
        )
    )
    motor: MotorParameters = field(default_factory=MotorParameters)
    masses: MassParameters = field(default_factory=MassParameters)
    paths: PathParameters = field(default_factory=PathParameters)
    chiller: ChillerParameters = field(default_factory=ChillerParameters)
    viscosity_40: float = quantity(22.0, "mm2/s", 2, 1e3)  # ISO VG 22
    viscosity_100: float = quantity(4.4, "mm2/s", 1, 100)
    bed_heat: float = quantity(160.0, "W", 0, 1e4)  # hydraulics and fans while switched on
    feed_heat: float = quantity(120.0, "W", 0, 1e4)  # guides, screws while axes move
    coolant_pump: float = quantity(750.0, "W", 0, 1e4)
    chip_heat_to_coolant: float = quantity(0.3, "1", 0, 1)  # of the cut's power
    cut_heat_to_tool: float = quantity(0.03, "1", 0, 0.5)
    sensor_lag: float = quantity(35.0, "s", 0, 1e3)  # of the thermistor in the winding
    sensor_noise: float = quantity(0.12, "K", 0, 5)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.viscosity_100 >= self.viscosity_40:
            raise ValueError(
                f"SpindleParameters.viscosity_100 = {self.viscosity_100} [mm2/s] must be below "
                f"viscosity_40 = {self.viscosity_40}: oil gets thinner when warm"
            )
