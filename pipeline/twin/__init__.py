"""Sub-models at work: a program on a control, drives on their axes, the cut of a program.

Positions in mm, times in s, forces in N, in the machine's frame.
"""

__all__ = [
    "command_correction",
    "control",
    "cut",
    "drive",
    "preflight",
    "program_axes",
    "simulation",
    "spindle",
]
