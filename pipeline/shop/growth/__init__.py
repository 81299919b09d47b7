"""Thermal growth of the simulated spindle, by nine Pt100 and a displacement probe at the nose.

Growth is positive where the nose comes nearer to the table; SI inside, degC, um and rev/min in the
files.  Sources stand in :mod:`pipeline.shop.growth.parameters`.
"""

__all__ = ["heat", "parameters", "records"]
