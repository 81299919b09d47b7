"""Descent of networks: Adam on one vector of weights, the training loop, the best state so far.

On sixty small tensors a step of ``torch.optim`` takes longer than a small network, and it imports a
compiler.  Source: Kingma and Ba 2015.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from math import inf, isfinite

import numpy as np
import torch
from torch import Tensor, nn

from pipeline.schema.arrays import Floats

EPSILON = 1e-8
"""Least size of a gradient that counts [1]."""


def flat(weights: Sequence[nn.Parameter]) -> Tensor:
    """All weights in one vector, of which they are views from then on."""
    vector = torch.cat([one.detach().reshape(-1) for one in weights])
    for one, part in zip(weights, vector.split([one.numel() for one in weights]), strict=True):
        one.data = part.view(one.shape)
    return vector


class Adam:
    """Adam optimiser: steps down the gradient of a loss.

    ``rate`` may change before any step; ``betas``: shares of the mean gradient and of its mean
    square kept by a step [1]; ``l2``: penalty on the squares of each weight [1]; ``decay``: share
    of the weights, times the rate, taken off by a step: AdamW (Loshchilov and Hutter 2019).  The
    rest of the graph gets no gradient.
    """

    def __init__(
        self, weights: Sequence[nn.Parameter], rate: float, *,
        betas: tuple[float, float] = (0.9, 0.999), l2: Sequence[float] | None = None,
        decay: float = 0.0,
    ) -> None:  # fmt: skip
        self.weights, self.values = list(weights), flat(weights)
        self.rate, self.betas, self.decay = rate, betas, decay
        self.mean, self.square = (torch.zeros_like(self.values) for _ in range(2))
        self.steps = torch.zeros((), dtype=torch.float64)
        self.slope_of_l2 = None
        if l2 is not None and any(l2):
            many = torch.tensor([one.numel() for one in weights])
            each = torch.tensor([2.0 * one for one in l2], dtype=torch.float64)
            self.slope_of_l2 = each.repeat_interleave(many).to(self.values)

    def step(self, loss: Tensor) -> None:
        """Move the weights."""
        slopes = torch.autograd.grad(loss, self.weights, allow_unused=True, materialize_grads=True)
        with torch.no_grad():
            slope = torch.cat([one.reshape(-1) for one in slopes])
            if self.slope_of_l2 is not None:
                slope.addcmul_(self.slope_of_l2, self.values)
            self.steps += 1
            left = [1.0 - beta ** float(self.steps) for beta in self.betas]
            self.mean.lerp_(slope, 1.0 - self.betas[0])
            self.square.mul_(self.betas[1]).addcmul_(slope, slope, value=1.0 - self.betas[1])
            size = (self.square / left[1]).sqrt_().add_(EPSILON)
            if self.decay:
                self.values.mul_(1.0 - self.rate * self.decay)
            self.values.addcdiv_(self.mean, size, value=-self.rate / left[0])


def training_loop(many: int, stopped: Callable[[int], bool], every: int = 1) -> Iterator[int]:
    """Loop of every training: passes 1, 2, … to make, until all are done or ``stopped`` ends it.

    ``stopped`` is called every so many passes and after the last: it records errors and returns
    whether the training is over.
    """
    for done in range(1, many + 1):
        yield done
        if (done % every == 0 or done == many) and stopped(done):
            return


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


def usable_precision(precision: str) -> str:
    """``precision``, or float32 where the processor has no products in bfloat16."""
    known = torch.cpu.get_capabilities()
    older = torch.backends.cpu.get_cpu_capability() in ("DEFAULT", "AVX2")
    own = bool(known.get("avx512_bf16") or known.get("amx_bf16") or known.get("bf16"))
    return precision if own and not older else "float32"


def cooled(done: int, many: int, cooling: float) -> float:
    """Share of the learning rate at one of many steps: it falls to zero over the last ones."""
    return min((1.0 - (done - 1) / many) / cooling, 1.0) if cooling else 1.0


def autocast(precision: str) -> AbstractContextManager[object]:
    """Within which products are of that precision."""
    if precision == "float32":
        return nullcontext()
    return torch.autocast("cpu", dtype=torch.bfloat16, cache_enabled=False)


def validation_groups(
    labels: Sequence[str], share: float, seed: int, section: str
) -> tuple[str, ...]:
    """Labels of the groups that are kept for early stopping, at random by the seed.

    Raises ValueError when a group is to be kept and there is only one; ``section`` is that of the
    settings.
    """
    if share == 0:
        return ()
    groups = np.unique(np.asarray(labels))
    if len(groups) < 2:
        raise ValueError(
            f"there is one recording, {str(groups[0])!r}, to learn from and to stop by: give at "
            f"least two, or set {section}.validation = 0"
        )
    many = min(max(round(share * len(groups)), 1), len(groups) - 1)
    order = np.random.default_rng(seed).permutation(len(groups))
    return tuple(sorted(str(one) for one in groups[order[:many]]))
