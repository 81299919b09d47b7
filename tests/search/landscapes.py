"""Landscapes that searches are commonly tried on; the least cost of each is 0.

Problems of two objectives have fronts of closed form (Zitzler, Deb and Thiele 2000).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Landscape:
    cost: Callable[[np.ndarray], np.ndarray]
    bound: float

    def bounds(self, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
        return np.full(dimensions, -self.bound), np.full(dimensions, self.bound)


def sphere(x: np.ndarray) -> np.ndarray:
    return (x**2).sum(axis=1)


class Counting:
    """A cost that keeps what it was asked."""

    def __init__(self, cost=sphere) -> None:
        self.cost, self.asked = cost, []

    def __call__(self, x: np.ndarray) -> np.ndarray:
        self.asked.append(x.copy())
        return self.cost(x)


def rosenbrock(x: np.ndarray) -> np.ndarray:
    return (100 * (x[:, 1:] - x[:, :-1] ** 2) ** 2 + (1 - x[:, :-1]) ** 2).sum(axis=1)


def rastrigin(x: np.ndarray) -> np.ndarray:
    return 10 * x.shape[1] + (x**2 - 10 * np.cos(2 * np.pi * x)).sum(axis=1)


def ackley(x: np.ndarray) -> np.ndarray:
    far = -20 * np.exp(-0.2 * np.sqrt((x**2).mean(axis=1)))
    return far - np.exp(np.cos(2 * np.pi * x).mean(axis=1)) + 20 + np.e


LANDSCAPES = {
    "sphere": Landscape(sphere, 5.12),
    "rosenbrock": Landscape(rosenbrock, 2.048),
    "rastrigin": Landscape(rastrigin, 5.12),
    "ackley": Landscape(ackley, 32.768),
}


def zdt(which: int):
    """ZDT1 (convex), ZDT2 (concave) or ZDT3 (in five pieces): all genes 0 to 1."""

    def judge(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        f, g = x[:, 0], 1 + 9 * x[:, 1:].mean(axis=1)
        return np.stack([f, g * shape(which, f / g, f)], axis=1), np.zeros(len(x))

    return judge


def shape(which: int, ratio: np.ndarray, f: np.ndarray) -> np.ndarray:
    if which == 1:
        return 1 - np.sqrt(ratio)
    if which == 2:
        return 1 - ratio**2
    return 1 - np.sqrt(ratio) - ratio * np.sin(10 * np.pi * f)


def on_front(which: int, f: np.ndarray) -> np.ndarray:
    """The second objective at g = 1, the least that any individual reaches."""
    return shape(which, f, f)


def hypervolume(objectives: np.ndarray, reference: float = 1.1) -> float:
    """Area between a front and (reference, reference)."""
    inside = objectives[(objectives < reference).all(axis=1)]
    area, last = 0.0, reference
    for first, second in inside[inside[:, 0].argsort()]:
        if second < last:
            area += (reference - first) * (last - second)
            last = second
    return area


def ideal_hypervolume(which: int, reference: float = 1.1) -> float:
    """The same of the whole front, by its closed form on a fine grid."""
    f = np.linspace(0, 1, 200_001)
    return hypervolume(np.stack([f, on_front(which, f)], axis=1), reference)


def binh_korn(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """BNH: 0 to 5 and 0 to 3, two circles as limits (Binh and Korn 1997)."""
    a, b = x.T
    objectives = np.stack([4 * a**2 + 4 * b**2, (a - 5) ** 2 + (b - 5) ** 2], axis=1)
    inside = (a - 5) ** 2 + b**2 - 25
    outside = 7.7 - (a - 8) ** 2 - (b + 3) ** 2
    return objectives, np.maximum(inside, 0) + np.maximum(outside, 0)


def binh_korn_front(many: int = 2001) -> np.ndarray:
    """x1 = x2 up to 3, then x2 = 3 and x1 from 3 to 5."""
    a = np.concatenate([np.linspace(0, 3, many), np.linspace(3, 5, many)])
    b = np.minimum(a, 3)
    return np.stack([4 * a**2 + 4 * b**2, (a - 5) ** 2 + (b - 5) ** 2], axis=1)
