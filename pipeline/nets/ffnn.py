"""Fuzzy-filtered networks, and the sigmoid network that they are compared with.

All take scaled temperatures x, shape (T, N), in the order of the sensors, and scaled consequent
inputs c, shape (T, K), and give the scaled output, shape (T,), in float64.

The improved fuzzy-filtered network (FFNN2015) has five layers: temperatures; pass-bands over the
channel index; shares of the bands; rules that are linear in the consequent inputs, weighted by the
shares; their sum.  In the paper c are the temperatures of the three fuzzy c-means centres, K = 3.
The classic one (after Sun and Jang 1993) has bells for bands and sigmoids for shares.  Given the
bands, both are linear in the consequents, which ridge least squares finds.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence

import torch
from torch import Tensor, nn

from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
)

FLOOR = 0.05
"""Least temperature above the zero of the shares, as a part of their offset [1]."""
NARROWEST = 0.3
"""Least width of a band [channels]: one between two channels still sees both."""
ROWS = 4096
"""Samples whose design is held at once while normal equations are summed."""


class FilteredNetwork(nn.Module, ABC):
    """Bands over the channels, and rules that are linear in the consequent inputs.

    ``bounds``: of the F parameters of a band; ``start`` (J, F): first bands.
    """

    channels: Tensor
    low: Tensor
    high: Tensor

    def __init__(
        self, bands: int, sensors: int, inputs: int, bounds: Sequence[tuple[float, float]],
        start: Tensor,
    ) -> None:  # fmt: skip
        super().__init__()
        channels = torch.arange(sensors, dtype=torch.float64)
        low, high = torch.tensor(bounds, dtype=torch.float64).T
        self.register_buffer("channels", channels, persistent=False)
        self.register_buffer("low", low.expand(bands, -1).clone(), persistent=False)
        self.register_buffer("high", high.expand(bands, -1).clone(), persistent=False)
        self.places = nn.Parameter(torch.empty(bands, len(bounds), dtype=torch.float64))
        self.set_bands(start)
        self.consequents = nn.Parameter(torch.zeros(bands, inputs + 1, dtype=torch.float64))

    @property
    def bands(self) -> Tensor:
        """Parameters of the bands, shape (J, F); ``places`` are shares of their bounds."""
        return self.low + self.places * (self.high - self.low)

    @torch.no_grad()
    def set_bands(self, bands: Tensor) -> None:
        """Put the bands at values of shape (J, F), brought into their bounds."""
        self.places.copy_((bands - self.low) / (self.high - self.low))
        self.keep_bounds()

    @abstractmethod
    def strengths(self, bands: Tensor, x: Tensor) -> Tensor:
        """Weights w of the rules, shape (..., T, J), with bands of shape (..., J, F)."""

    @abstractmethod
    def memberships(self, bands: Tensor) -> Tensor:
        """Membership of each channel in each band, shape (..., J, N)."""

    def filtered(self, bands: Tensor, t: Tensor) -> Tensor:
        """Layer 2: O_j = sum_i mu_j(i) t_i / sum_i mu_j(i), shape (..., T, J)."""
        mu = self.memberships(bands)
        return t @ (mu / mu.sum(-1, keepdim=True)).transpose(-1, -2)

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """Scaled output, shape (T,)."""
        return self.output(self.consequents, x, c)

    def output(self, consequents: Tensor, x: Tensor, c: Tensor) -> Tensor:
        """Layers 4 and 5: sum_j w_j (p_j . c + s_j), shape (T,), of consequents (J, K + 1)."""
        rules = nn.functional.linear(c, consequents[:, :-1], consequents[:, -1])
        return (self.strengths(self.bands, x) * rules).sum(-1)

    def designs(self, bands: Tensor, x: Tensor, c: Tensor) -> Tensor:
        """Matrices whose products with the consequents are outputs; (..., T, J (K + 1))."""
        w = self.strengths(bands, x)
        rules = torch.cat([c, torch.ones_like(c[:, :1])], dim=1)
        return (w[..., :, None] * rules[:, None, :]).flatten(-2)

    def normal_equations(
        self, bands: Tensor, x: Tensor, c: Tensor, y: Tensor
    ) -> tuple[Tensor, Tensor]:
        """A'A / T, shape (..., M, M), and A'y / T, shape (..., M, 1), with M = J (K + 1)."""
        gram: Tensor | float = 0.0
        moment: Tensor | float = 0.0
        for k in range(0, len(y), ROWS):
            a = self.designs(bands, x[k : k + ROWS], c[k : k + ROWS])
            gram = gram + a.mT @ a
            moment = moment + a.mT @ y[k : k + ROWS, None]
        return torch.as_tensor(gram) / len(y), torch.as_tensor(moment) / len(y)

    @torch.no_grad()
    def solve_consequents(self, x: Tensor, c: Tensor, y: Tensor, ridge: float) -> None:
        """Set the consequents to those of ridge least squares.

        Least is mean((A b - y)^2) + ``ridge`` b'b over samples x (T, N), c (T, K), y (T,).
        """
        found = ridge_solution(*self.normal_equations(self.bands, x, c, y), ridge)
        self.consequents.copy_(found.view_as(self.consequents))

    @torch.no_grad()
    def keep_bounds(self) -> None:
        """Bring the bands back into their bounds."""
        self.places.clamp_(0.0, 1.0)


def ridge_solution(gram: Tensor, moment: Tensor, ridge: float) -> Tensor:
    """Solutions b of (G + ridge 1) b = m, shape (..., M, H) as m, G of shape (..., M, M).

    The ridge bounds the condition, so that normal equations lose no more than the ridge hides.
    """
    diagonal = ridge * torch.eye(gram.shape[-1], dtype=gram.dtype)
    return torch.cholesky_solve(moment, torch.linalg.cholesky(gram + diagonal))


class Whitened:
    """Filtered network with consequents b = b0 + L^-T z, where L L' = A'A / T + ridge 1.

    In z the columns of the design A are orthogonal at the start, for gradient descent.  b0 is the
    solution of the least squares of samples x (T, N), c (T, K), y (T,).
    """

    def __init__(
        self, built: FilteredNetwork, x: Tensor, c: Tensor, y: Tensor, ridge: float
    ) -> None:
        self.built = built
        with torch.no_grad():
            gram, moment = built.normal_equations(built.bands, x, c, y)
            one = torch.eye(len(gram), dtype=gram.dtype)
            factor = torch.linalg.cholesky(gram + ridge * one)
            self.map = torch.linalg.solve_triangular(factor.mT, one, upper=True)
            self.start = ridge_solution(gram, moment, ridge)[..., 0]
        self.z = torch.zeros_like(self.start).requires_grad_()
        self.parameters = [built.places, self.z]
        self.settle()

    def __call__(self, x: Tensor, c: Tensor) -> Tensor:
        """Scaled output, shape (T,)."""
        return self.built.output(self._consequents(), x, c)

    def _consequents(self) -> Tensor:
        return (self.start + self.map @ self.z).view_as(self.built.consequents)

    @torch.no_grad()
    def settle(self) -> None:
        """Give the network its consequents."""
        self.built.consequents.copy_(self._consequents())


class FuzzyFilteredNetwork(FilteredNetwork):
    """Improved network: Gaussian bands (centre, width [channels]), shares O_j / sum_k O_k.

    The bands take the scaled rise, 0 to 1 over the training data, plus an offset, so that shares
    cannot vanish; a sum below a twentieth of the offset counts as that twentieth.
    """

    def __init__(self, settings: FuzzyFilteredSettings, sensors: int, inputs: int) -> None:
        bounds = ((0.0, sensors - 1.0), (NARROWEST, float(sensors)))
        start = torch.stack(_spread(settings.bands, sensors), dim=1)
        super().__init__(settings.bands, sensors, inputs, bounds, start)
        self.offset = settings.offset

    def memberships(self, bands: Tensor) -> Tensor:
        """Gaussians exp(-((i - centre) / width)^2 / 2), shape (..., J, N)."""
        centre, width = bands[..., :1], bands[..., 1:2]
        return torch.exp(-0.5 * ((self.channels - centre) / width) ** 2)

    def strengths(self, bands: Tensor, x: Tensor) -> Tensor:
        """Layer 3: shares of the bands, shape (..., T, J); they are positive and their sum is 1."""
        o = self.filtered(bands, torch.clamp(x + self.offset, min=FLOOR * self.offset))
        return o / o.sum(-1, keepdim=True)


class ClassicFuzzyNetwork(FilteredNetwork):
    """The classic network: bells (centre, half-width, slope), sigmoids (steepness, threshold)."""

    def __init__(self, settings: ClassicFuzzySettings, sensors: int, inputs: int) -> None:
        along = ((0.0, sensors - 1.0), (NARROWEST, float(sensors)), (1.0, 6.0))
        bounds = (*along, (0.1, 20.0), (0.0, 1.0))
        centre, width = _spread(settings.bands, sensors)
        one = torch.ones_like(centre)
        start = torch.stack([centre, width, 2.0 * one, 4.0 * one, 0.5 * one], dim=1)
        super().__init__(settings.bands, sensors, inputs, bounds, start)

    def memberships(self, bands: Tensor) -> Tensor:
        """Bells 1 / (1 + |(i - centre) / half-width|^(2 slope)), shape (..., J, N)."""
        centre, width, slope = bands[..., :1], bands[..., 1:2], bands[..., 2:3]
        square = ((self.channels - centre) / width) ** 2
        tiny = 1e-12  # the power's derivative by the slope has a logarithm
        return 1.0 / (1.0 + (square + tiny) ** slope)

    def strengths(self, bands: Tensor, x: Tensor) -> Tensor:
        """Sigmoids of the filtered temperatures, shape (..., T, J)."""
        steepness, threshold = bands[..., None, :, 3], bands[..., None, :, 4]
        return torch.sigmoid(steepness * (self.filtered(bands, x) - threshold))


class BackPropagationNetwork(nn.Module):
    """One sigmoid layer of H nodes and a linear output: 9-7-1 and 9-16-1 in the comparison.

    Initial weights are uniform within 1 / sqrt(inputs of the node).
    """

    def __init__(
        self, settings: BackPropagationSettings, sensors: int, inputs: int,
        generator: torch.Generator,
    ) -> None:  # fmt: skip
        super().__init__()
        self.consequent_inputs = settings.consequent_inputs
        wide = sensors + (inputs if settings.consequent_inputs else 0)
        with torch.random.fork_rng([]):  # torch's own initial weights use its global numbers
            self.hidden = nn.Linear(wide, settings.hidden, dtype=torch.float64)
            self.output = nn.Linear(settings.hidden, 1, dtype=torch.float64)
        with torch.no_grad():
            for layer in (self.hidden, self.output):
                reach = layer.in_features**-0.5
                for weights in (layer.weight, layer.bias):
                    weights.uniform_(-reach, reach, generator=generator)

    def inputs(self, x: Tensor, c: Tensor) -> Tensor:
        """Inputs of the first layer, shape (T, N) or (T, N + K)."""
        return torch.cat([x, c], dim=1) if self.consequent_inputs else x

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """Scaled output, shape (T,)."""
        hidden = torch.sigmoid(self.hidden(self.inputs(x, c)))
        output: Tensor = self.output(hidden)
        return output[:, 0]


Network = FilteredNetwork | BackPropagationNetwork


def network(
    settings: NetworkSettings, sensors: int, inputs: int, generator: torch.Generator
) -> Network:
    """The network of a kind's settings for N sensors and K consequent inputs, not yet trained.

    Raises ValueError when there are fewer than three sensors, no input, or the settings are of no
    network.
    """
    if sensors < 3 or inputs < 1:
        raise ValueError(
            f"a network on {sensors} sensors and {inputs} consequent inputs cannot be built: "
            "give at least 3 sensors and 1 input"
        )
    if isinstance(settings, FuzzyFilteredSettings):
        return FuzzyFilteredNetwork(settings, sensors, inputs)
    if isinstance(settings, ClassicFuzzySettings):
        return ClassicFuzzyNetwork(settings, sensors, inputs)
    if isinstance(settings, BackPropagationSettings):
        return BackPropagationNetwork(settings, sensors, inputs, generator)
    raise ValueError(f"{type(settings).__name__} is of no network: give one of nets.settings")


def _spread(bands: int, sensors: int) -> tuple[Tensor, Tensor]:
    """Centres and widths of bands that cover the channels evenly, both of shape (J,)."""
    spacing = sensors / bands
    centre = (torch.arange(bands, dtype=torch.float64) + 0.5) * spacing - 0.5
    width = torch.full_like(centre, max(0.5 * spacing, NARROWEST))
    return centre.clamp(0.0, sensors - 1.0), width
