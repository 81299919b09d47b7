"""The cut: engagement of tool and stock, cutting forces, stability, tool life and cost.

Formulas are in SI, angles in radians.  Stock and tool path lie in the work coordinates of the
program, forces in the frame of the feed, vibration in that of the machine.  Sources are named by
each file; most of them follow Altintas, *Manufacturing Automation*, 2nd ed. 2012.
"""

__all__ = ["catalogue", "economics", "engagement", "force", "stability", "tool"]
