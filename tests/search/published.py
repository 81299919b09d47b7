"""Functions F1 to F13 of Mirjalili and Lewis 2016, and the mean costs that were published.

The paper has 30 variables in boxes that are symmetric about zero, 30 runs with 30 agents over 500
iterations, and a particle swarm beside its whales; the means of the wolves are those of Mirjalili,
Mirjalili and Lewis 2014.  The least cost of all but F8 is 0, and lies in the middle of the box or
(F5, F12, F13) close to it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.search.landscapes import ackley, rastrigin, rosenbrock, sphere

Cost = Callable[[np.ndarray], np.ndarray]


def schwefel_2_22(x: np.ndarray) -> np.ndarray:
    return np.abs(x).sum(axis=1) + np.abs(x).prod(axis=1)


def schwefel_1_2(x: np.ndarray) -> np.ndarray:
    return (x.cumsum(axis=1) ** 2).sum(axis=1)


def schwefel_2_21(x: np.ndarray) -> np.ndarray:
    return np.abs(x).max(axis=1)


def step(x: np.ndarray) -> np.ndarray:
    """As in the authors' program, (x + 1/2)^2 without the brackets that round."""
    return ((x + 0.5) ** 2).sum(axis=1)


def quartic(x: np.ndarray) -> np.ndarray:
    """Without its noise, which :meth:`Published.cost` adds."""
    return (np.arange(1, x.shape[1] + 1) * x**4).sum(axis=1)


def schwefel_2_26(x: np.ndarray) -> np.ndarray:
    return -(x * np.sin(np.sqrt(np.abs(x)))).sum(axis=1)


def griewank(x: np.ndarray) -> np.ndarray:
    waves = np.cos(x / np.sqrt(np.arange(1, x.shape[1] + 1))).prod(axis=1)
    return (x**2).sum(axis=1) / 4000 - waves + 1


def beyond(x: np.ndarray, a: float, k: float, m: int) -> np.ndarray:
    return (k * np.maximum(np.abs(x) - a, 0) ** m).sum(axis=1)


def penalised_1(x: np.ndarray) -> np.ndarray:
    y = 1 + (x + 1) / 4
    waves = ((y[:, :-1] - 1) ** 2 * (1 + 10 * np.sin(np.pi * y[:, 1:]) ** 2)).sum(axis=1)
    ends = 10 * np.sin(np.pi * y[:, 0]) ** 2 + (y[:, -1] - 1) ** 2
    return np.pi / x.shape[1] * (ends + waves) + beyond(x, 10, 100, 4)


def penalised_2(x: np.ndarray) -> np.ndarray:
    waves = ((x[:, :-1] - 1) ** 2 * (1 + np.sin(3 * np.pi * x[:, 1:]) ** 2)).sum(axis=1)
    last = (x[:, -1] - 1) ** 2 * (1 + np.sin(2 * np.pi * x[:, -1]) ** 2)
    return 0.1 * (np.sin(3 * np.pi * x[:, 0]) ** 2 + waves + last) + beyond(x, 5, 100, 4)


@dataclass(frozen=True)
class Published:
    """A function, its box from -bound to bound, and the published mean cost of each search."""

    plain: Cost
    bound: float
    whale: float
    swarm: float
    wolf: float
    noisy: bool = False
    least: float = 0.0

    def bounds(self, dimensions: int) -> tuple[np.ndarray, np.ndarray]:
        return np.full(dimensions, -self.bound), np.full(dimensions, self.bound)

    def cost(self, seed: int, *, moved: bool, dimensions: int) -> Cost:
        """The cost of one run: its noise, and with ``moved`` its optimum elsewhere.

        It is moved by up to 0.4 of the bound along each axis; that of F8 is far off the middle
        as it is.
        """
        rng = np.random.default_rng([seed, 16])
        far = 0.4 * self.bound if moved and not self.least else 0.0
        shift = rng.uniform(-far, far, dimensions)

        def cost(x: np.ndarray) -> np.ndarray:
            noise = rng.random(len(x)) if self.noisy else 0.0
            return self.plain(x - shift) + noise

        return cost


FUNCTIONS = {
    "F1": Published(sphere, 100, 1.41e-30, 0.000136, 6.59e-28),
    "F2": Published(schwefel_2_22, 10, 1.06e-21, 0.042144, 7.18e-17),
    "F3": Published(schwefel_1_2, 100, 5.39e-07, 70.12562, 3.29e-06),
    "F4": Published(schwefel_2_21, 100, 0.072581, 1.086481, 5.61e-07),
    "F5": Published(rosenbrock, 30, 27.86558, 96.71832, 26.81258),
    "F6": Published(step, 100, 3.116266, 0.000102, 0.816579),
    "F7": Published(quartic, 1.28, 0.001425, 0.122854, 0.002213, noisy=True),
    "F8": Published(schwefel_2_26, 500, -5080.76, -4841.29, -6123.1, least=-418.9829),
    "F9": Published(rastrigin, 5.12, 0.0, 46.70423, 0.310521),
    "F10": Published(ackley, 32, 7.4043, 0.276015, 1.06e-13),
    "F11": Published(griewank, 600, 0.000289, 0.009215, 0.004485),
    "F12": Published(penalised_1, 50, 0.339676, 0.006917, 0.053438),
    "F13": Published(penalised_2, 50, 1.889015, 0.006675, 0.654464),
}
