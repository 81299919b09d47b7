"""Control of a machine tool, identified from logs of line numbers and the programs that ran.

The control (:mod:`pipeline.machine.control`) plans each program; its rates, accelerations, corners
and waiting times [mm/min, mm/s^2, s] are those that explain the durations of segments between two
polls of the line number best.
"""

__all__ = ["programs", "runs", "segments", "submodel"]
