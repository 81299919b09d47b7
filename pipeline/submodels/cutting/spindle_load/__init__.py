"""No-load power and specific cutting force from the spindle load of a control's display.

Logs of speed, load and executed line (MTConnect, even times) are compared with the engagement that
the program's path has in its blank.  Powers are at the tool [W], speeds [rev/s], removal rates
[m^3/s]; loads in percent become powers by rated power, base speed and efficiency, which are given.
"""

__all__ = ["identify", "levels", "readings"]
