"""Stored documents and ranges of parameters, typed: frozen dataclasses with a unit for each number.

Nothing in here computes physics, and nothing in here imports another package of Kerf.
"""

__all__ = [
    "arrays",
    "bundle",
    "cache",
    "cutting",
    "days",
    "drive",
    "files",
    "forest",
    "golden",
    "identity",
    "imports",
    "interval",
    "limits",
    "model",
    "outside",
    "part",
    "part_sheet",
    "plots",
    "predictions",
    "program",
    "program_cut",
    "ranges",
    "si",
    "store",
    "structure",
    "verdict",
]
