"""Chance constraint of a part's load limit: uncertainty, draws, feeds that keep the limit.

Loads in [N], feeds for each tooth in [m], probabilities in [1].
"""

__all__ = ["chance_constraint", "part_loads", "uncertainty"]
