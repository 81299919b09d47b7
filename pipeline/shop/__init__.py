"""Simulated machine shop that writes the records real machines write, with their faults.

Another machine than the twin: heat and growth of the spindle, control, drives, cutting forces and
wear of tools have effects that the twin leaves out, so that an identification from these records
proves something.  Only the reader of part programs, the types and the compiler are shared.  Lengths
are in mm and speeds in mm/min and rev/min where a control or a catalogue says them, in SI inside
the physics.  Everything shown from here is labelled "simulated".
"""

__all__ = ["control", "cutting", "drives", "growth", "parameters", "simulate", "trial", "wear"]
