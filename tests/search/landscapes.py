"""Landscapes that searches are commonly tried on; the least cost of each is 0."""

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
