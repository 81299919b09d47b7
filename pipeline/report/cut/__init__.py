"""Page of one program's cut: loads, engagement, stability and cost from its JSON document.

The document is what ``kerf simulate --json`` writes with a stock; nothing else is read.  Loads are
in [N], depths in [mm], angles in [deg], speeds in [rev/min], power in [kW], shares in [1].
"""

__all__ = ["page"]
