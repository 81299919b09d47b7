"""Choice of F and S: blockwise optimum (Viterbi 1967), genetic search (Sim2023), Pareto (NSGA-II).

Times in [s], S in [rev/min], F in the units of ``Moves``.
"""

__all__ = ["blockwise", "feed_groups", "genes", "genetic", "speeds"]
