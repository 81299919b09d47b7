"""Physics of motion: the control, the feed axes and the spindle of a machine tool.

``control`` plans how a program is run (times, speeds, commanded positions), ``axis`` follows the
commanded positions, ``spindle`` runs up and down.  Axes X Y Z A B C as in ISO 841, machine
coordinates; SI units, but parameters of the control in millimetre and minute as on its own pages.
"""

__all__ = ["axis", "control", "spindle"]
