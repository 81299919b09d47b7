"""Cutting forces: chip, force law, waveform over the spindle's angle, mean forces, load tables.

All in SI; x along the feed, y to its left, z up along the tool's axis.  F_x and F_y are on the
tool, F_z as on the workpiece (Altintas, *Manufacturing Automation*, 2nd ed. 2012; Kienzle 1952).
"""

__all__ = ["drawn_loads", "force_law", "load_table", "profile_kernel", "waveform"]
