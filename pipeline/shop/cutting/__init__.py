"""Cutting tests of the simulated mill: forces of an end mill, dynamometer, spindle load meter.

Forces follow each tooth on its trochoid with runout, tilt, size effect, ploughing and flank wear.
The frame of the forces is that of the feed: x along it, y to its left, the axial force positive
where the edge lifts the workpiece; SI inside, N, mm and rev/min in the files.  Sources stand in
:mod:`pipeline.shop.cutting.parameters`.
"""

__all__ = ["dynamometer", "parameters", "records"]
