"""Methods that choose F and S: the blockwise optimum, genetic search, baselines, Pareto front.

The blockwise optimum is dynamic programming over spindle speeds (Viterbi 1967) with the best feed
of each block; the genetic search is that of Sim2023, the front NSGA-II's.  Times in [s], S in
[rev/min], F in the units of ``Moves``.
"""

__all__ = ["blockwise", "feed_groups", "genes", "genetic", "pareto", "speed_pieces", "speeds"]
