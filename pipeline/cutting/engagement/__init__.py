"""Engagement of tool and stock: the blank as a height map, the tool swept through its columns.

Lengths are in metres, angles in radians, in the stock's frame with the tool's axis along z; angles
of a tooth are those of milling (Altintas 2012, fig. 2.20), counted from the direction of feed.
"""

__all__ = ["clearance", "end_rings", "engagement", "stock"]
