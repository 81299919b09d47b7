"""Thermal growth of the simulated spindle: what nine Pt100 and a probe at the nose record.

A network of about ninety nodes along spindle, head and column, the expansion of each part, and
what speed does to rings and shaft.  Growth is positive where the nose comes nearer to the table;
SI inside, degC, um and rev/min in the files.  Sources stand in
:mod:`pipeline.shop.growth.parameters`.
"""

__all__ = ["heat", "parameters", "records"]
