"""The sub-models at work: a program on a control, drives on their axes, the cut of a program.

Physics comes from the rooms below, parameters from what was identified of a machine; positions are
in mm, times in s, forces in N, frames are the machine's.
"""

__all__ = [
    "control",
    "corrected_program",
    "correction",
    "cut",
    "drive",
    "preflight",
    "program_axes",
    "residual",
    "simulation",
    "spindle",
]
