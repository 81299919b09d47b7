"""Stability of milling: dynamics of tool tips, modal fit, semi-discretisation, margins, recordings.

Depths are in metres, spindle speeds in 1/s, responses in m/N in the machine's frame x, y.
Semi-discretisation is that of Insperger and Stepan 2004.
"""

__all__ = ["margins", "modal_fit", "recorded_chatter", "semi_discretisation", "tip_dynamics"]
