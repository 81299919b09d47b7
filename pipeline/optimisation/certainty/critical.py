"""The stations that decide a block's peak load, in classes that react alike to what is uncertain.

The load of a station in a draw is its own nominal load, of the load table, and by how much the load
of its class' representative R changes in that draw:

    load(station, f_z, draw) = table(station, f_z) + w (load(R, f_z, draw) - load(R, f_z)),

with w what both loads are over each other in the table.  Stations of one tool are alike whose
engaged arcs begin and end in the same 5 degrees, whose depths differ by less than 10 %, and whose
slopes by less than 0.03.  A block has one candidate for each class among its stations whose load
comes near to its greatest, for in a draw another one may be the greatest.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.engagement.engagement import engaged_arc
from pipeline.twin.cut import Cut

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

ALIKE_RAD = np.pi / 36
"""What arcs of one class may begin and end apart."""
ALIKE_DEPTH = 1.1
"""What their depths may be over each other."""
ALIKE_SLOPE = 0.03
WEIGHT = 1.25
"""What w is at most, and at least its inverse."""
ENDLESS = 1.0
"""Feed for each tooth from which on a load counts as not growing with it [m]."""
NEAR = 0.9
"""Share of a block's greatest load from which on a station is a candidate [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Critical:
    """Q candidates in C classes.

    Parameters
    ----------
    row : ndarray of intp, shape (Q,)
        Whose candidate it is, never falling.
    curve : ndarray, shape (Q, K + 1)
        Peak load over the nodes of the table, never falling [N].
    scale, exponent : ndarray, shape (Q,)
        Of the nodes, as in :class:`pipeline.cutting.force.load_table.LoadTable`.
    own_station : ndarray of intp, shape (Q,)
        Of each candidate, the one with the greatest load at the middle of the table.
    weight : ndarray, shape (Q,)
        w [1].
    group : ndarray of intp, shape (Q,)
        Class of each.
    station : ndarray of intp, shape (C,)
        Representative of each class.
    tool : ndarray of intp, shape (C,)
        Its tool, an index.
    rows : int
        M, of the program.
    """

    row: Rows = field(repr=False)
    curve: Floats = field(repr=False)
    scale: Floats = field(repr=False)
    exponent: Floats = field(repr=False)
    own_station: Rows = field(repr=False)
    weight: Floats = field(repr=False)
    group: Rows = field(repr=False)
    station: Rows = field(repr=False)
    tool: Rows = field(repr=False)
    rows: int

    def __len__(self) -> int:
        return len(self.row)

    @property
    def classes(self) -> int:
        """C."""
        return len(self.station)

    @property
    def last_feeds(self) -> Floats:
        """f_z of the last node of each candidate's table [m]; shape (Q,)."""
        last: Floats = ((self.curve.shape[1] - 2.0) ** 2 / self.scale) ** (1.0 / self.exponent)
        return last

    def loads(self, f_z: Floats) -> Floats:
        """Nominal peak of each candidate [N] at one feed for each, shape (Q,)."""
        from pipeline.cutting.force.profile_kernel import look_up

        out = np.empty((1, len(self)))
        if len(self):
            look_up(f_z[np.newaxis], self.curve, self.scale, self.exponent, out)
        return out[0]

    def feeds(self, limit: float) -> Floats:
        """Greatest f_z up to which each stays within a load [m]; inf where none reaches it."""
        squares = np.arange(self.curve.shape[1]) ** 2.0
        beyond = self.curve > limit
        beyond[:, -1] = True  # the last two go on
        node = np.argmax(beyond, axis=1)
        after = np.maximum(node, 1)
        low, high = (np.take_along_axis(self.curve, k[:, None], axis=1)[:, 0]
                     for k in (after - 1, after))  # fmt: skip
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            share = (limit - low) / (high - low)
            u = squares[after - 1] + share * (squares[after] - squares[after - 1])
            found = (u / self.scale) ** (1.0 / self.exponent)
        found = np.where((high > low) & (found < ENDLESS), found, np.inf)
        return np.where(node == 0, 0.0, found)


def critical(cut: Cut, rows: Rows | None = None) -> Critical:
    """Candidates of all rows that cut at feed, or of ``rows`` alone."""
    engagement, table = cut.engagement, cut.table
    wanted = engagement.feed
    if rows is not None:
        asked = np.zeros(engagement.blocks, dtype=np.bool_)
        asked[rows] = True
        wanted = wanted & asked[engagement.block]
    fed = np.flatnonzero(wanted)
    values = table.station_values[0]
    nodes = values.shape[1]
    middle = nodes // 2
    block = engagement.block[fed]
    load = values[table.station[fed], middle]
    greatest = np.zeros(engagement.blocks)
    np.maximum.at(greatest, block, load)
    near = (load >= NEAR * greatest[block]) & (load > 0)
    fed, block, load = fed[near], block[near], load[near]
    _, kind = np.unique(_kinds(cut, fed), axis=0, return_inverse=True)
    kind = kind.ravel()
    pair, member = np.unique(np.stack([block, kind], axis=1), axis=0, return_inverse=True)
    member = member.ravel()
    curve = np.zeros((len(pair), nodes))
    np.maximum.at(curve, member, values[table.station[fed]])
    first, candidate = _greatest_of(kind, load), _greatest_of(member, load)
    group = kind[candidate].astype(np.intp)
    return Critical(
        row=pair[:, 0].astype(np.intp),
        curve=np.maximum.accumulate(curve, axis=1),
        scale=table.scale[pair[:, 0]],
        exponent=table.exponent[pair[:, 0]],
        own_station=fed[candidate],
        weight=np.clip(load[candidate] / load[first][group], 1 / WEIGHT, WEIGHT),
        group=group,
        station=fed[first],
        tool=engagement.tool[fed[first]].astype(np.intp),
        rows=engagement.blocks,
    )


def _greatest_of(kind: NDArray[np.int64], load: Floats) -> Rows:
    """Where the greatest load of each kind is, counted from 0 without a gap."""
    order = np.lexsort((-load, kind))
    return order[np.flatnonzero(np.diff(kind[order], prepend=-1))]


def _kinds(cut: Cut, stations: Rows) -> NDArray[np.int64]:
    """What stations of one class have in common; shape (N, 7)."""
    engagement = cut.engagement
    lower, upper = engagement.lower[stations], engagement.upper[stations]
    height = np.where(upper > lower, upper - lower, 0.0).astype(np.float64)
    ahead = np.sin(engagement.angles) > 0
    begin, end = engaged_arc(np.where(ahead, height, 0.0))
    depth = np.maximum(height.max(axis=1, initial=0.0), 1e-9)
    many = np.maximum((height > 0).sum(axis=1), 1)
    columns = (
        engagement.tool[stations],
        np.nan_to_num(begin, nan=-1.0) / ALIKE_RAD,
        np.nan_to_num(end, nan=-1.0) / ALIKE_RAD,
        np.log(depth) / np.log(ALIKE_DEPTH),
        engagement.slope[stations] / ALIKE_SLOPE,
        np.sign(engagement.slope[stations]),  # a flat end cuts on its way down only
        np.log(many) / np.log(ALIKE_DEPTH),
    )
    return np.round(np.stack(columns, axis=1)).astype(np.int64)
