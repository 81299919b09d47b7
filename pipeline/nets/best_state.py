"""Best state of a network in training: errors so far, and the weights with the least of them."""

from math import inf, isfinite

import numpy as np
from torch import nn

from pipeline.schema.arrays import Floats


class Diverged(ValueError):  # noqa: N818
    """A training whose first errors are not finite."""


class BestState:
    """Errors so far, and the state of a network with the least validation error."""

    def __init__(self, built: nn.Module, diverged: str) -> None:
        self.built, self.diverged = built, diverged
        self.history: list[tuple[float, float, float]] = []
        self.best, self.best_at, self.idle = inf, 0, 0
        self._copy()

    def add(self, done: int, training: float, validation: float) -> bool:
        """Take down both errors of the scaled output after so many passes; whether they are finite.

        Raises Diverged when the first ones are not.
        """
        if not (isfinite(training) and isfinite(validation)):
            if not self.history:
                raise Diverged(self.diverged)
            return False  # the best state is an earlier one
        self.history.append((float(done), training, validation))
        if validation < self.best:
            self.best, self.best_at = validation, done
            self._copy()
        self.idle = done - self.best_at
        return True

    def keep_best(self) -> None:
        """Give the network its best state."""
        self.built.load_state_dict(self.state)

    def errors(self, unit: Floats) -> Floats:
        """The history with errors in the unit of the output, shape (H, 3)."""
        return np.array(self.history) * np.array([1.0, unit, unit])

    def _copy(self) -> None:
        self.state = {k: v.detach().clone() for k, v in self.built.state_dict().items()}
