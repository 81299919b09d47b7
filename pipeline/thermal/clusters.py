"""Fuzzy c-means, and groups of temperature sensors that warm alike.

Fuzzy c-means (Bezdek: Pattern Recognition with Fuzzy Objective Function Algorithms, 1981) minimises

    J = sum_i sum_c u_ic^m |x_i - v_c|^2,    sum_c u_ic = 1,

by turns: u_ic = 1 / sum_k (d_ic / d_ik)^(2 / (m - 1)), and v_c the mean of the points by u_ic^m.

Applied to the sensors of a spindle, each a point whose coordinates are its course in time, the
centre of a cluster is itself a course: the mean temperature of its group.  So a group's temperature
is a fixed weighted mean of the sensors, which needs no clustering when serving.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.ranges import Count, Positive, Range, Ranged
from pipeline.thermal.cluster_kernel import BLOCK, fuzzy_memberships, fuzzy_pass


@dataclass(frozen=True, kw_only=True)
class FuzzyClusterSettings(Ranged, section="clusters"):
    """Settings of fuzzy c-means.

    Parameters
    ----------
    fuzzifier : float
        Exponent m of the memberships [1], above 1; 2 is usual, and needs no powers.
    tolerance : float
        Move of the centres in an iteration at which it ends, as a share of the root mean square
        distance of the points from their mean [1].
    iterations : int
        Most iterations [1].
    seed : int
        Of the initial centres.

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    fuzzifier: Annotated[float, Range(above=1.0, most=50.0)] = 2.0
    tolerance: Positive = 1e-9
    iterations: Count = 1000
    seed: Annotated[int, Range(least=0)] = 0


@dataclass(frozen=True, kw_only=True)
class FuzzyClusters:
    """Clusters of points.

    Parameters
    ----------
    centres : ndarray, shape (C, D)
        In the unit of the points.
    memberships : ndarray, shape (N, C)
        u of each point in each cluster for these centres [1]; rows add up to 1.
    objective : float
        J, in the squared unit of the points.
    iterations : int
        Iterations that were made [1].
    converged : bool
        Whether the centres came to rest within the tolerance.
    """

    centres: Floats
    memberships: Floats
    objective: float
    iterations: int
    converged: bool


def fuzzy_c_means(
    points: ArrayLike,
    clusters: int,
    settings: FuzzyClusterSettings | None = None,
    *,
    memberships: ArrayLike | None = None,
) -> FuzzyClusters:
    """Fuzzy c-means of points; an iteration is new centres, then their memberships.

    Parameters
    ----------
    points : array_like, shape (N, D)
        Finite, in one unit.
    clusters : int
        How many, C.
    settings : FuzzyClusterSettings, optional
        The usual ones unless given.
    memberships : array_like, shape (N, C), optional
        Where to start; from centres drawn by k-means++ (Arthur, Vassilvitskii 2007) unless given.

    Raises
    ------
    ValueError
        When the points are no finite table or lie in fewer places than there are clusters, or the
        memberships do not fit them.

    Examples
    --------
    >>> found = fuzzy_c_means([[0.0], [0.1], [5.0], [5.1]], 2)
    >>> np.sort(found.centres[:, 0]).round(2).tolist()
    [0.05, 5.05]
    """
    settings = settings or FuzzyClusterSettings()
    x = np.ascontiguousarray(points, float)
    _check_points(x, clusters)
    if memberships is None:
        centres = _spread_points(x, clusters, np.random.default_rng(settings.seed))
    else:
        centres = _means(x, _start(memberships, len(x), clusters), settings.fuzzifier)
    return _iterate(x, centres, settings)


def _check_points(x: Floats, clusters: int) -> None:
    if x.ndim != 2 or x.shape[1] == 0:
        raise ValueError(f"points of shape {x.shape} must be a table of N points x D coordinates")
    if not 1 <= clusters <= len(x):
        raise ValueError(
            f"clusters = {clusters} of {len(x)} points must lie from 1 to the number of points"
        )
    if not np.isfinite(x).all():
        row, column = np.argwhere(~np.isfinite(x))[0]
        raise ValueError(
            f"points[{row}, {column}] = {x[row, column]} must be finite: leave that point out"
        )


def _start(memberships: ArrayLike, many: int, clusters: int) -> Floats:
    u = np.asarray(memberships, float)
    if u.shape != (many, clusters):
        raise ValueError(
            f"memberships of shape {u.shape} must have a row for each of {many} points and a "
            f"column for each of {clusters} clusters"
        )
    if not (np.isfinite(u).all() and (u >= 0).all() and (u.sum(axis=0) > 0).all()):
        raise ValueError("memberships must be finite and at least 0, with a point in each cluster")
    return u


def _means(x: Floats, memberships: Floats, fuzzifier: float) -> Floats:
    weights = memberships**fuzzifier
    means: Floats = (weights.T @ x) / weights.sum(axis=0)[:, None]
    return means


def _spread_points(x: Floats, clusters: int, rng: np.random.Generator) -> Floats:
    """Initial centres of k-means++: each a point, drawn by its squared distance from the others."""
    chosen = [int(rng.integers(len(x)))]
    nearest = np.full(len(x), np.inf)
    while len(chosen) < clusters:
        gap = x - x[chosen[-1]]
        nearest = np.minimum(nearest, np.einsum("nd,nd->n", gap, gap))
        reach = np.cumsum(nearest)
        if reach[-1] == 0:
            raise ValueError(
                f"points lie in {len(chosen)} places for {clusters} clusters: take fewer clusters"
            )
        drawn = int(np.searchsorted(reach, rng.uniform(0, reach[-1]), side="right"))
        chosen.append(min(drawn, int(np.flatnonzero(nearest)[-1])))
    return x[chosen]


def _iterate(x: Floats, centres: Floats, settings: FuzzyClusterSettings) -> FuzzyClusters:
    m, many = settings.fuzzifier, len(centres)
    exponent = 1.0 / (m - 1.0)
    blocks, last = _in_blocks(x)
    distance, nearest, total = np.empty((many, BLOCK)), np.empty(BLOCK), np.empty(BLOCK)
    sums = np.empty((many, x.shape[1] + 1, BLOCK))
    least = settings.tolerance * np.sqrt(x.var(axis=0).sum())
    done, converged = 1, False
    while done < settings.iterations and not converged:
        fuzzy_pass(blocks, last, centres, exponent, m, BLOCK, distance, nearest, total, sums)
        moved = sums.sum(axis=2)
        # a cluster that no point belongs to keeps its place
        weight = np.where(moved[:, -1:] > 0, moved[:, -1:], np.nan)
        moved = np.where(np.isnan(weight), centres, moved[:, :-1] / weight)
        converged = bool(np.abs(moved - centres).max() <= least)
        centres, done = moved, done + 1
    u = np.empty((len(blocks), many, BLOCK))
    fuzzy_memberships(blocks, centres, exponent, BLOCK, nearest, total, u)
    memberships = np.ascontiguousarray(u.transpose(0, 2, 1).reshape(-1, many)[: len(x)])
    objective = sum(
        float(memberships[:, c] ** m @ ((x - centre) ** 2).sum(axis=1))
        for c, centre in enumerate(centres)
    )
    return FuzzyClusters(
        centres=centres, memberships=memberships, objective=objective, iterations=done,
        converged=converged,
    )  # fmt: skip


def _in_blocks(x: Floats) -> tuple[Floats, int]:
    """Points in blocks of shape (K, D, BLOCK), and how many the last block holds."""
    many = -(-len(x) // BLOCK)
    last = len(x) - (many - 1) * BLOCK
    filled = np.concatenate([x, np.broadcast_to(x[-1], (BLOCK - last, x.shape[1]))])
    return np.ascontiguousarray(filled.reshape(many, BLOCK, -1).transpose(0, 2, 1)), last


@dataclass(frozen=True, kw_only=True)
class SensorGroups:
    """Groups of sensors that warm alike, from front to rear.

    Parameters
    ----------
    weights : ndarray, shape (C, N)
        Of each sensor in a group's temperature [1]; rows add up to 1, lost sensors have 0.
    memberships : ndarray, shape (C, N)
        u of each sensor in each group [1]; columns add up to 1, those of lost sensors are 0.
    places : ndarray, shape (C,)
        Mean place of each group, in the unit of the positions; ascending.
    """

    weights: Floats
    memberships: Floats
    places: Floats

    def temperatures(self, measured: ArrayLike) -> Floats:
        """Group temperatures, shape (..., C), from those measured, (..., N), in their unit.

        A sample that is missing (nan) has no weight at its time; where no sensor of a group is
        left, the group's temperature is nan.
        """
        values = np.asarray(measured, float)
        if values.shape[-1] != self.weights.shape[1]:
            raise ValueError(
                f"{values.shape[-1]} temperatures must be those of the {self.weights.shape[1]} "
                "sensors that were grouped"
            )
        seen = np.isfinite(values)
        if seen.all():
            means: Floats = values @ self.weights.T
            return means
        there = seen @ self.weights.T
        sums = np.where(seen, values, 0.0) @ self.weights.T
        return np.where(there > 0, sums / np.where(there > 0, there, 1.0), np.nan)

    def without(self, lost: ArrayLike) -> "SensorGroups":
        """The same groups when the sensors in the mask ``lost``, shape (N,), are lost.

        Raises
        ------
        ValueError
            When the mask does not fit, or a group has no sensor left.
        """
        mask = _lost_mask(lost, self.weights.shape[1])
        weights = np.where(mask, 0.0, self.weights)
        left = weights.sum(axis=1)
        if (left <= 0).any():
            raise ValueError(
                f"group {int(np.argmin(left))} of {len(left)} has no sensor left of "
                f"{weights.shape[1]}: repair one, or group those that are left anew"
            )
        return SensorGroups(
            weights=weights / left[:, None],
            memberships=np.where(mask, 0.0, self.memberships),
            places=self.places,
        )


def sensor_groups(
    temperatures: ArrayLike,
    groups: int = 3,
    *,
    positions: Sequence[float] | Floats | None = None,
    lost: ArrayLike | None = None,
    settings: FuzzyClusterSettings | None = None,
) -> SensorGroups:
    """Groups of sensors by their courses over time, in fixed order from front to rear.

    A sensor's course is centred: what it reads constantly too high does not count.  Its amplitude
    does: sensors that warm differently far are in different groups.

    Parameters
    ----------
    temperatures : array_like, shape (T, N)
        Of training samples, in degC or K; times at which a sensor is missing (nan) are left out.
    groups : int
        How many, C.
    positions : array_like, shape (N,), optional
        Place of each sensor from front to rear; the channel's index unless given.
    lost : array_like of bool, shape (N,), optional
        Sensors that do not count.
    settings : FuzzyClusterSettings, optional
        Of the clustering.

    Raises
    ------
    ValueError
        When fewer sensors are left than groups, fewer than two times have all of them, or the
        sensors' courses are too few different ones.

    Examples
    --------
    >>> t = np.linspace(0, 1, 50)[:, None]
    >>> found = sensor_groups(20 + t * [9.0, 9.1, 4.0, 4.1, 1.0, 1.1])
    >>> found.memberships.argmax(axis=0).tolist()
    [0, 0, 1, 1, 2, 2]
    """
    settings = settings or FuzzyClusterSettings()
    measured = np.asarray(temperatures, float)
    if measured.ndim != 2:
        raise ValueError(f"temperatures of shape {measured.shape} must be T times x N sensors")
    many = measured.shape[1]
    mask = np.zeros(many, bool) if lost is None else _lost_mask(lost, many)
    place = np.arange(many, dtype=float) if positions is None else np.asarray(positions, float)
    if place.shape != (many,) or not np.isfinite(place).all():
        raise ValueError(f"positions must be one finite number for each of {many} sensors")
    if many - mask.sum() < groups:
        raise ValueError(
            f"{many - mask.sum()} of {many} sensors are left for {groups} groups: take fewer groups"
        )
    u = np.zeros((groups, many))
    u[:, ~mask] = fuzzy_c_means(_courses(measured[:, ~mask]), groups, settings).memberships.T
    weights = u**settings.fuzzifier
    weights /= weights.sum(axis=1, keepdims=True)
    order = np.argsort(weights @ place, kind="stable")
    return SensorGroups(
        weights=weights[order], memberships=u[order], places=(weights @ place)[order]
    )


def _courses(measured: Floats) -> Floats:
    """Centred courses in coordinates of their own span, shape (N, at most N), distances kept."""
    whole = measured[np.isfinite(measured).all(axis=1)]
    if len(whole) < 2:
        raise ValueError(
            f"temperatures: {len(whole)} of {len(measured)} times have all {measured.shape[1]} "
            "sensors, 2 are needed: name the sensor that is missing most as lost"
        )
    centred = whole - whole.mean(axis=0)
    triangle = np.linalg.qr(centred, mode="r") / np.sqrt(len(whole))
    return np.ascontiguousarray(triangle.T)


def _lost_mask(lost: ArrayLike, many: int) -> Bools:
    mask = np.asarray(lost)
    if mask.dtype != bool or mask.shape != (many,):
        raise ValueError(
            f"lost of type {mask.dtype} and shape {mask.shape} must be one bool for each of {many} "
            "sensors"
        )
    return mask
