"""Part programs: faster or cheaper inside the limits of a part, with proof of what was changed.

A program as interpreted has rows, one for each move; F in [mm/min] or [mm/rev], S in [rev/min],
all else in SI.  ``problem`` holds limits and objectives of the rows as arrays, ``reliability`` the
feeds that keep a load limit with a given probability, ``methods`` the blockwise optimum and the
searches that go on from it (Sim2023: genetic; NSGA-II for a front), ``text`` the F and S words that
may change, ``proof`` the comparison of two programs that shares nothing with what wrote them.
"""

__all__ = [
    "axis_limits",
    "document",
    "full_twin",
    "job",
    "methods",
    "operations",
    "optimise",
    "problem",
    "proof",
    "reliability",
    "settings",
    "text",
]
