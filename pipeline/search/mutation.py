"""Chance changes of genes, in the unit cube."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def polynomial(x: Floats, eta: float, rng: np.random.Generator) -> Floats:
    """Genes moved by a step of density (eta + 1) / 2 (1 - |d|)^eta, any shape.

    Each side of the density keeps its half and is cut off at the wall on its side, so that no gene
    leaves the cube (Deb and Agrawal 1999).

    Parameters
    ----------
    x : ndarray
        Genes, 0 to 1.
    eta : float
        The greater, the smaller the steps; without walls their mean size is 1 / (eta + 2).
    rng : numpy.random.Generator
        Source of chance.
    """
    chance = rng.uniform(-1.0, 1.0, x.shape)
    room = np.where(chance > 0, 1.0 - x, x)
    beyond = (1.0 - room) ** (eta + 1.0)
    size = 1.0 - (1.0 - np.abs(chance) * (1.0 - beyond)) ** (1.0 / (eta + 1.0))
    size = np.minimum(size, room)
    return x + np.copysign(size, chance)
