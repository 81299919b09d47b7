"""Whole lives of end mills: flank wear of each tooth, and the records of seven sensors.

Wear grows with the temperature of the flank, which a worn land heats; teeth wear apart by their
runout and their edges.
"""

__all__ = ["parameters", "records", "teeth"]
