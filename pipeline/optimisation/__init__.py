"""Optimisation of part programs: faster or cheaper inside the limits of a part, with proof.

Rows are the moves of a program as interpreted; F in [mm/min] or [mm/rev], S in [rev/min], all else
in SI.  Sources: Sim2023 (genetic search); NSGA-II for a front.
"""

__all__ = [
    "document", "full_twin", "job", "methods", "operations", "optimise", "problem", "proof",
    "reliability", "settings", "text",
]  # fmt: skip
