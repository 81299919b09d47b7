"""Factors of the units in which people and tables speak: value in SI = value * factor."""

from math import pi

MM, UM = 1e-3, 1e-6
"""Millimetre and micrometre [m]."""
MINUTE, HOUR, DAY = 60.0, 3600.0, 86_400
"""Minute, hour and day [s]; a frequency [1/s] times ``MINUTE`` is one for each minute."""
NS = 1_000_000_000
"""Nanoseconds in one second [1]."""
RPM = 2 * pi / 60
"""Revolution for each minute [rad/s]."""
DEGREE = pi / 180
"""Degree [rad]."""
ZERO_CELSIUS = 273.15
"""Temperature at 0 degC [K]."""
KW, KWH = 1e3, 3.6e6
"""Kilowatt [W] and kilowatt hour [J]."""
N_MM2 = 1e6
"""Newton for each square millimetre [Pa]."""
