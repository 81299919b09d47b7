"""Loads of a whole part in each draw, and the feeds at which quantiles of them keep a limit."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.certainty.critical import Critical
from pipeline.optimisation.certainty.response import Responses

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True, eq=False)
class PartLoads:
    """Candidates of a part, what they must stay within, and their loads in each draw.

    Parameters
    ----------
    found : Critical
        Q candidates in C classes.
    limit : float
        Of the load across the tool's axis [N].
    most : ndarray, shape (Q,)
        Feeds above which none is asked for [m].
    responses : Responses
        Of the classes.
    """

    found: Critical
    limit: float
    most: Floats
    responses: Responses

    def feeds(self, loads: Floats) -> Floats:
        """Feeds up to which each stays within where classes have these loads, (C, K); (Q,)."""
        from pipeline.optimisation.certainty.certainty_kernel import feeds_within

        found, out = self.found, np.empty(len(self.found))
        feeds_within(self.limit, self.most, found.curve, found.scale, found.exponent, found.weight,
                     found.group, self.responses.f_z, loads - self.responses.expected,
                     out)  # fmt: skip
        return out

    def peaks(self, feeds: Floats, draws: slice) -> tuple[Floats, Rows]:
        """The part's greatest load in each draw, and how often each candidate passes the limit."""
        from pipeline.optimisation.certainty.certainty_kernel import peak_loads

        found, peaks = self.found, np.zeros(draws.stop - draws.start)
        beyond = np.empty(len(found), dtype=np.intp)
        drawn = self.responses
        peak_loads(feeds, self.limit, found.curve, found.scale, found.exponent, found.weight,
                   found.group, drawn.f_z, drawn.expected, drawn.values, draws.start, peaks,
                   beyond)  # fmt: skip
        return peaks, beyond


def of_rows(found: Critical, feeds: Floats) -> Floats:
    """Least feed of each row's candidates; inf without one.  Shape (M,)."""
    out = np.full(found.rows, np.inf)
    np.minimum.at(out, found.row, feeds)
    return out
