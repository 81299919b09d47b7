"""Heat and deformation of a machine tool: thermal networks, sensor groups, spindle growth.

``network`` gives the spindle's temperature from its speed and load, ``sensors`` groups of sensors
that warm alike by fuzzy c-means and lagged temperatures, ``deformation`` the spindle's growth from
speed and ambient by two nodes (``growth_fit`` fits them), or from measured temperatures.
Temperatures in degC, rates in 1/s, spindle speed in rad/s, growth in m; only quotients k / C and
1 / (R C) are parameters, since temperatures determine no more.
Source: Harris, Kotzalas, Essential Concepts of Bearing Technology, 5th ed.
"""

__all__ = ["deformation", "growth_fit", "network", "sensors"]
