"""The sub-models at work: a program on a control, drives on their axes, the cut of a program.

Physics comes from the rooms below, parameters from what was identified of a machine; positions are
in mm, times in s, forces in N, frames are the machine's.
"""

__all__ = [
    "control",
    "corrected_program",
    "correction",
    "cut",
    "cut_axes",
    "cut_blocks",
    "cut_coefficients",
    "cut_cost",
    "cut_document",
    "cut_force",
    "cut_limits",
    "cut_stability",
    "cut_tables",
    "cut_wear",
    "cutting_path",
    "drive",
    "preflight",
    "program_axes",
    "residual",
    "setup_warnings",
    "simulation",
    "spindle",
]
