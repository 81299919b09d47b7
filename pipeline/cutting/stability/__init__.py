"""Stability of milling: dynamics of tool tips, modal fit, lobes, semi-discretisation, margins.

Depths are in metres, spindle speeds in 1/s, responses in m/N in the machine's frame x, y.  The
zero-order solution is that of Altintas and Budak 1995, semi-discretisation that of Insperger and
Stepan 2004.
"""

__all__ = [
    "directional", "frf_file", "lobes", "margins", "modal_fit", "semi_discretisation",
    "tip_dynamics",
]  # fmt: skip
