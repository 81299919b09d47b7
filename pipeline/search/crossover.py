"""Children of two parents, in the unit cube."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_NARROW = 1e-14  # parents nearer to each other than this are the same but for rounding


def simulated_binary(
    first: Floats, second: Floats, crossed: NDArray[np.bool_], eta: float, rng: np.random.Generator
) -> Floats:
    """Two children each, as far from their middle as beta times the parents; shape (2, N, D).

    The spread factor beta has density (eta + 1) / 2 beta^eta up to 1 and
    (eta + 1) / 2 beta^-(eta + 2) beyond (Deb and Agrawal 1995), cut off where the first child
    would leave the cube, the same for both, so that they keep their parents' middle.  Which child
    is nearer to which parent is left to chance for each gene.

    Parameters
    ----------
    first, second : ndarray, shape (N, D)
        Parents.
    crossed : ndarray of bool, shape (N, D)
        Genes that cross; the others are their parent's.
    eta : float
        The greater, the nearer the children are to their parents.
    rng : numpy.random.Generator
        Source of chance.
    """
    middle = 0.5 * (first + second)
    half = 0.5 * np.abs(second - first)
    room = np.minimum(middle, 1.0 - middle)
    # half / room is 1 / beta at the nearer wall
    cut = (half / np.maximum(room, _NARROW)) ** (eta + 1.0)
    chance = rng.uniform(-1.0, 1.0, middle.shape)
    share = np.abs(chance) * (2.0 - cut)
    spread = np.where(share <= 1.0, share, 1.0 / np.maximum(2.0 - share, _NARROW))
    beta = spread ** (1.0 / (eta + 1.0))
    step = np.copysign(np.minimum(beta * half, room), chance)
    return _pair(first, second, crossed, middle - step, middle + step)


def blend(
    first: Floats, second: Floats, crossed: NDArray[np.bool_], alpha: float,
    rng: np.random.Generator,
) -> Floats:  # fmt: skip
    """Two children each, anywhere in the parents' interval widened by ``alpha`` of its length.

    What is outside the cube is cut off (BLX-alpha, Eshelman and Schaffer 1993); shape (2, N, D).

    Parameters
    ----------
    first, second : ndarray, shape (N, D)
        Parents.
    crossed : ndarray of bool, shape (N, D)
        Genes that cross; the others are their parent's.
    alpha : float
        At least 0; at 0.5 the children spread as their parents do.
    rng : numpy.random.Generator
        Source of chance.
    """
    wider = alpha * np.abs(second - first)
    low = np.maximum(np.minimum(first, second) - wider, 0.0)
    high = np.minimum(np.maximum(first, second) + wider, 1.0)
    chance = rng.random((2, *first.shape))
    child, other = low + chance * (high - low)
    return _pair(first, second, crossed, child, other)


def _pair(
    first: Floats, second: Floats, crossed: NDArray[np.bool_], child: Floats, other: Floats
) -> Floats:
    children = np.empty((2, *first.shape))
    children[0], children[1] = first, second
    np.copyto(children[0], child, where=crossed)
    np.copyto(children[1], other, where=crossed)
    return children
