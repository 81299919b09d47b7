"""Optimisation as arrays over the M rows of a program: limits, objectives, utilisation.

Feeds for each tooth in [m], F in the units of ``Moves``, S in [rev/min], time in [s]; a population
of P decisions is evaluated at once by compiled loops.
"""

__all__ = ["arrays", "feasible", "limits", "problem"]
