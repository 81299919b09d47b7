"""Stored documents and ranges of parameters, typed: frozen dataclasses with a unit for each number.

Nothing in here computes physics, and nothing in here imports another package of Kerf.
"""

__all__ = [
    "arrays",
    "bundle",
    "condition",
    "cutting",
    "days",
    "decision",
    "drive",
    "files",
    "forest",
    "golden",
    "history",
    "identity",
    "imports",
    "incident",
    "ledger",
    "limits",
    "model",
    "part",
    "part_record",
    "part_sheet",
    "predictions",
    "program_cut",
    "ranges",
    "si",
    "store",
    "twin_state",
    "verdict",
]
