"""Derivative-free minimisation within bounds: arrays in, arrays out, no knowledge of the problem.

Parameters are searched in the unit cube of their :class:`~pipeline.search.box.Box`, in their own
units or on a logarithmic scale, real or whole numbers.  All random numbers come from the settings'
seed.

Sources: Deb and Agrawal 1995; Baker 1987; Srinivas and Patnaik 1994; Mirjalili and Lewis 2016;
Clerc and Kennedy 2002; Mirjalili, Mirjalili and Lewis 2014; Bergstra and Bengio 2012; Deb, Pratap,
Agarwal and Meyarivan 2002; Kolda, Lewis and Torczon 2003; Branke, Deb, Dierolf and Osswald 2004.
"""

__all__ = ["box", "compass", "genetic", "methods", "nsga2", "operators", "result"]
