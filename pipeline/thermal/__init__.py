"""Heat of a machine tool: thermal networks of one or two nodes.

``network`` gives the spindle's temperature from its speed and load.  Temperatures in degC, rates in
1/s, spindle speed in rad/s; only quotients k / C and 1 / (R C) are parameters, since temperatures
determine no more.  Source: Harris, Kotzalas, Essential Concepts of Bearing Technology, 5th ed.
"""

__all__ = ["network"]
