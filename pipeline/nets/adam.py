"""Adam on the weights of a network as one vector (Kingma and Ba 2015), with penalty or decay.

On sixty small tensors a step takes longer than a small network; ``torch.optim`` imports a compiler.
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

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
