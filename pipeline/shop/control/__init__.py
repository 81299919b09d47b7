"""Numerical control of the simulated mill: part programs, motion planning, run logs.

Programs are Fanuc text in mm in the frame of G54.  The planner follows Jeon's junction rule (2011)
with limited jerk (Altintas, Manufacturing Automation, 2nd ed., ch. 5); positions of the axes are in
the machine's frame [mm], times in seconds from the start of a run.
"""

__all__ = ["part_programs", "records"]
