"""Whole lives of end mills: flank wear of each tooth, and what seven sensors record of it.

A tool wears by its temperature, faster where it is hotter, and a worn flank heats itself; teeth
wear apart by their runout and their edges.  Of some cuts a data-acquisition system keeps half a
second of forces on the workpiece, vibration of the spindle's nose and the envelope of the acoustic
emission; now and then the land is measured under a microscope.
"""

__all__ = ["parameters", "records", "sensors", "teeth"]
