"""Derivative-free minimisation within bounds: arrays in, arrays out, no knowledge of the problem.

Genetic algorithm (``genetic``: selection, crossover and mutation in ``operators``), NSGA-II for
several objectives (``nsga2``, with constrained domination and knee in ``dominance``), and compass
search around a good start (``compass``).  Parameters are searched in the unit cube of their
:class:`~pipeline.search.box.Box`, in their own units or on a logarithmic scale.  All random numbers
come from the settings' seed.

Sources: Deb and Agrawal 1995; Baker 1987; Srinivas and Patnaik 1994; Deb, Pratap, Agarwal and
Meyarivan 2002; Kolda, Lewis and Torczon 2003; Branke, Deb, Dierolf and Osswald 2004.
"""

__all__ = ["box", "compass", "dominance", "genetic", "nsga2", "operators", "result"]
