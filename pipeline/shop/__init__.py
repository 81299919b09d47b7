"""A simulated machine shop that writes the records real machines write, with their faults.

Another machine than the twin: heat and growth of the spindle, control, drives, cutting forces and
wear of tools are modelled here with effects that the twin leaves out, so that a model that is
identified from these records proves something.  Of ours, nothing but the reader of part programs,
the types and the compiler is imported.  Lengths are in mm and speeds in the units of the shop floor
(mm/min, rev/min) where a control or a catalogue says them, in SI inside the physics; the docstring
of each quantity names its unit.  Sources stand with the parameters.  Everything shown from here is
labelled "simulated".
"""

__all__ = ["control", "cutting", "drives", "growth", "parameters", "simulate", "trial", "wear"]
