"""What Kerf stores and what its parameters may be, typed.

Frozen dataclasses with a unit for each number.  Whoever writes a document writes the type, whoever
reads it reads the type; JSON and Parquet are made of it in one place, ``store``; every
file is written whole, by ``files``.
Nothing in here computes physics, and nothing in here imports another room.
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
