"""What mechanics leave over of a waveform, learnt over the spindle's angle.

Under the same tool, speed, depth and immersion the same thing is left over, whatever it is: a mode
that the channels do not have, an edge that is no straight line, a chip that is no sine.  It is
affine in the feed for each tooth, R(theta) = A(theta) f_z + B(theta), where the training recordings
have two feeds or more of such conditions, and B(theta) where they have one.  It says nothing of
other conditions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.conditions import Conditions
from pipeline.identification.cutting.problem import Cut
from pipeline.identification.cutting.spectrum import turned

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SPEED = 0.01
"""Speeds that differ by less, as a share, are the same: harmonics meet the same modes."""
ALIKE = 0.01
"""Depths, as a share, and angles, in rad, that differ by less are the same."""
FEEDS = 1.1
"""Ratio of feeds that are two."""
BEYOND = 2.0
"""Feeds up to that many times the highest trained, or down to the lowest over it, are near."""
FURTHER = 0.5
"""How far the straight line over the feed is followed beyond them, as a share of their range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Remainder:
    """What is left over under one set of conditions.

    Parameters
    ----------
    conditions : Conditions
        Of the first of its recordings.
    feeds : tuple of float
        f_z of its recordings [m].
    constant, slope : ndarray of complex, shape (H + 1, 3)
        Harmonics B [N] and A [N/m], the first tooth at the angle 0.
    """

    conditions: Conditions
    feeds: tuple[float, ...]
    constant: Complexes
    slope: Complexes

    def covers(self, other: Conditions) -> bool:
        """Whether it holds for ``other`` conditions."""
        near = min(self.feeds) / BEYOND <= other.f_z <= max(self.feeds) * BEYOND
        return near and same(self.conditions, other)

    def at(self, f_z: float, harmonics: int) -> Complexes:
        """What is left over at a feed for each tooth [m]; shape (H + 1, 3)."""
        found = np.zeros((harmonics + 1, 3), dtype=np.complex128)
        least, most = min(self.feeds), max(self.feeds)
        further = FURTHER * (most - least)
        feed = min(max(f_z, least - further), most + further)
        here = (self.constant + self.slope * feed)[: harmonics + 1]
        found[: len(here)] = here
        return found


def same(one: Conditions, other: Conditions) -> bool:
    """Whether conditions differ in nothing but the feed."""
    return (
        one.flutes == other.flutes
        and abs(one.speed / other.speed - 1) < SPEED
        and abs(one.a_p / other.a_p - 1) < ALIKE
        and abs(one.phi_st - other.phi_st) < ALIKE
        and abs(one.phi_ex - other.phi_ex) < ALIKE
    )


def remainders(
    cuts: Sequence[Cut], modelled: Sequence[Complexes], phases: Sequence[float], zero: float
) -> list[Remainder]:
    """What a model leaves over of recordings, by their conditions.

    Parameters
    ----------
    cuts : sequence of Cut
        The recordings.
    modelled : sequence of ndarray, shape (H + 1, 3)
        What the model says of each, at its phase.
    phases : sequence of float
        Where the first tooth is in each [rad].
    zero : float
        Variance of the zeros beyond what the recordings say of theirs [N^2].
    """
    groups: list[list[int]] = []
    for k, cut in enumerate(cuts):
        home = next((g for g in groups if same(cuts[g[0]].conditions, cut.conditions)), None)
        if home is None:
            groups.append([k])
        else:
            home.append(k)
    over = [
        turned(_clear(cut, cut.lines - model, zero), -phase)
        for cut, model, phase in zip(cuts, modelled, phases, strict=True)
    ]
    return [_remainder([cuts[k] for k in g], [over[k] for k in g]) for g in groups]


def _clear(cut: Cut, left: Complexes, zero: float) -> Complexes:
    """``left`` drawn towards 0 by the share of scatter in it (James and Stein 1961)."""
    square, variance = np.abs(left) ** 2, cut.variance.copy()
    variance[0] += zero
    variance[1:] *= 2  # of real and imaginary part together
    share = 1 - variance / np.maximum(square, 1e-300)
    return np.asarray(left * np.maximum(share, 0.0))


def _remainder(cuts: Sequence[Cut], over: Sequence[Complexes]) -> Remainder:
    size = min(len(one) for one in over)
    feeds = np.array([cut.conditions.f_z for cut in cuts])
    table = np.stack([one[:size] for one in over]).reshape(len(over), -1)
    if feeds.max() < FEEDS * feeds.min():
        constant, slope = table.mean(axis=0), np.zeros(table.shape[1], dtype=np.complex128)
    else:
        design = np.stack([np.ones_like(feeds), feeds], axis=1)
        constant, slope = np.linalg.pinv(design) @ table
    return Remainder(
        conditions=cuts[0].conditions, feeds=tuple(feeds.tolist()),
        constant=constant.reshape(size, 3), slope=slope.reshape(size, 3),
    )  # fmt: skip
