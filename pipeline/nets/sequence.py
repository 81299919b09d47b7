"""Networks on windows of signals: CNN-LSTM with attention, and the networks it is compared with.

All take scaled windows, shape (B, T, C), the newest row last, and give the scaled output, shape
(B,).  Convolutions are causal, but for those of the residual network.

Sources: Feed2025 (Conv1D, LSTM, additive attention over time, dense layer); Bahdanau, Cho and
Bengio 2015 (additive attention); Bai, Kolter and Koltun 2018 (TCN); He, Zhang, Ren and Sun 2016,
Wang, Yan and Oates 2017 (residual network).
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.nets.ffnn import ridge_solution
from pipeline.nets.settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    ResNetSettings,
    SequenceSettings,
    TcnSettings,
)


class SequenceNetwork(nn.Module, ABC):
    """A network whose last step is a dense layer on features of the window."""

    def __init__(self, features: int) -> None:
        super().__init__()
        self.dense = nn.Linear(features, 1)

    @abstractmethod
    def features(self, x: Tensor) -> Tensor:
        """Features of windows, shape (B, F)."""

    def forward(self, x: Tensor) -> Tensor:
        """Scaled output, shape (B,)."""
        y: Tensor = self.dense(self.features(x))
        return y[:, 0]


class CausalConvolution(nn.Module):
    """Convolution over time that sees a row and those before it, zeros before the first."""

    def __init__(self, inputs: int, filters: int, kernel: int, dilation: int = 1) -> None:
        super().__init__()
        self.before = (kernel - 1) * dilation
        self.convolution = nn.Conv1d(inputs, filters, kernel, dilation=dilation)

    def forward(self, x: Tensor) -> Tensor:
        """Rows of shape (B, T, C) become (B, T, filters)."""
        return over_rows(functional.pad(x, (0, 0, self.before, 0)), self.convolution)

    def in_time(self, x: Tensor) -> Tensor:
        """Rows of shape (T, B, C) become (T, B, filters), without dilation.

        As one product, which for few channels takes a fraction of the time of a convolution.
        """
        weight, bias = self.convolution.weight, self.convolution.bias
        rows = functional.pad(x, (0, 0, 0, 0, self.before, 0)).unfold(0, self.before + 1, 1)
        return functional.linear(rows.flatten(2), weight.flatten(1), bias)


def over_rows(x: Tensor, convolution: nn.Conv1d) -> Tensor:
    """Convolution over time of rows (B, T, C), shape (B, T', filters).

    In two dimensions, one row high and channels last, it takes half of the time.
    """
    found = functional.conv2d(
        x.transpose(1, 2).unsqueeze(2), convolution.weight.unsqueeze(2), convolution.bias,
        stride=(1, *convolution.stride), padding=(0, int(convolution.padding[0])),
        dilation=(1, *convolution.dilation),
    )  # fmt: skip
    return found.squeeze(2).transpose(1, 2)


class Lstm(SequenceNetwork):
    """A plain LSTM; its last state enters the dense layer."""

    def __init__(self, settings: LstmSettings, length: int, channels: int) -> None:
        super().__init__(settings.units)
        self.lstm = nn.LSTM(channels, settings.units)

    def features(self, x: Tensor) -> Tensor:
        """Last state, shape (B, units)."""
        states: Tensor = self.lstm(x.transpose(0, 1))[0]
        return states[-1]


class CnnLstm(SequenceNetwork):
    """Convolution, ReLU, max-pool, LSTM; its last state enters the dense layer."""

    def __init__(self, settings: CnnLstmSettings, length: int, channels: int) -> None:
        super().__init__(settings.units)
        self.pool = settings.pool
        self.convolution = CausalConvolution(channels, settings.filters, settings.kernel)
        self.lstm = nn.LSTM(settings.filters, settings.units)

    def states(self, x: Tensor) -> Tensor:
        """States of the LSTM, shape (T // pool, B, units); the oldest left over are dropped."""
        found = torch.relu(self.convolution.in_time(x.transpose(0, 1)))
        if self.pool > 1:
            pool = min(self.pool, len(found))
            found = found[len(found) % pool :].unflatten(0, (-1, pool)).amax(1)
        return self.lstm(found)[0]

    def features(self, x: Tensor) -> Tensor:
        """Last state, shape (B, units)."""
        return self.states(x)[-1]


class CnnLstmAttention(CnnLstm):
    """Convolution, LSTM, and the mean of its states with weights that depend on them."""

    def __init__(self, settings: CnnLstmAttentionSettings, length: int, channels: int) -> None:
        super().__init__(settings, length, channels)
        rows = settings.attention or settings.units
        self.score = nn.Linear(settings.units, rows)
        self.direction = nn.Linear(rows, 1, bias=False)

    def weights(self, states: Tensor) -> Tensor:
        """Softmax over time of e_t = v' tanh(W h_t + b), shape (T', B, 1)."""
        e: Tensor = self.direction(torch.tanh(self.score(states)))
        return torch.softmax(e, dim=0)

    def attention(self, x: Tensor) -> Tensor:
        """Weights of the states in time, shape (B, T'); those of a window add up to 1."""
        return self.weights(self.states(x))[..., 0].T

    def features(self, x: Tensor) -> Tensor:
        """Weighted mean of the states, shape (B, units)."""
        states = self.states(x)
        return (self.weights(states) * states).sum(0)


class ResidualBlock(nn.Module):
    """Two causal convolutions of one dilation, and what enters them added to what they give."""

    def __init__(self, inputs: int, filters: int, kernel: int, dilation: int) -> None:
        super().__init__()
        self.first = CausalConvolution(inputs, filters, kernel, dilation)
        self.second = CausalConvolution(filters, filters, kernel, dilation)
        self.beside = nn.Conv1d(inputs, filters, 1) if inputs != filters else None

    def forward(self, x: Tensor) -> Tensor:
        """Rows of shape (B, T, C) become (B, T, filters)."""
        found = torch.relu(self.second(torch.relu(self.first(x))))
        return torch.relu(found + (x if self.beside is None else over_rows(x, self.beside)))


class Tcn(SequenceNetwork):
    """Residual blocks of dilated causal convolutions; their last row enters the dense layer."""

    def __init__(self, settings: TcnSettings, length: int, channels: int) -> None:
        super().__init__(settings.filters)
        wide = [channels] + [settings.filters] * settings.blocks
        self.blocks = nn.Sequential(
            *(
                ResidualBlock(wide[k], wide[k + 1], settings.kernel, 2**k)
                for k in range(settings.blocks)
            )
        )

    def rows(self, x: Tensor) -> Tensor:
        """Output of the blocks at each time, shape (B, T, filters)."""
        return self.blocks(x)

    def features(self, x: Tensor) -> Tensor:
        """Last row, shape (B, filters)."""
        return self.rows(x)[:, -1]


class StridedBlock(nn.Module):
    """Two convolutions, the first with a stride, and what enters them added to what they give."""

    def __init__(self, inputs: int, filters: int, kernel: int, stride: int) -> None:
        super().__init__()
        reach = kernel // 2
        self.first = nn.Conv1d(inputs, filters, kernel, stride=stride, padding=reach)
        self.second = nn.Conv1d(filters, filters, kernel, padding=reach)
        same = inputs == filters and stride == 1
        self.beside = None if same else nn.Conv1d(inputs, filters, 1, stride=stride)

    def forward(self, x: Tensor) -> Tensor:
        """Rows of shape (B, T, C) become (B, ceil(T / stride), filters)."""
        found = over_rows(torch.relu(over_rows(x, self.first)), self.second)
        return torch.relu(found + (x if self.beside is None else over_rows(x, self.beside)))


class ResNet(SequenceNetwork):
    """Residual blocks over the whole window; mean and RMS of each filter enter the dense layer."""

    def __init__(self, settings: ResNetSettings, length: int, channels: int) -> None:
        wide = [settings.filters * 2**k for k in range(settings.blocks)]
        super().__init__(2 * wide[-1])
        stride = -(-length // settings.rows)
        reach = max(settings.kernel // 2, stride - 1)  # every sample is seen
        self.stem = nn.Conv1d(channels, wide[0], 2 * reach + 1, stride=stride, padding=reach)
        self.blocks = nn.Sequential(
            *(
                StridedBlock(before, after, settings.kernel, 1 if k == 0 else 2)
                for k, (before, after) in enumerate(zip([wide[0], *wide], wide, strict=False))
            )
        )

    def features(self, x: Tensor) -> Tensor:
        """Mean and RMS over time, shape (B, 2 filters)."""
        found: Tensor = self.blocks(torch.relu(over_rows(x, self.stem)))
        rms = torch.sqrt((found**2).mean(1) + 1e-12)
        return torch.cat([found.mean(1), rms], dim=1)


class Arx(SequenceNetwork):
    """Linear in the last rows of the window; :meth:`solve` finds its coefficients."""

    def __init__(self, settings: ArxSettings, length: int, channels: int) -> None:
        self.lags = min(settings.lags or length, length)
        super().__init__(self.lags * channels)
        self.ridge = settings.ridge
        self.to(torch.float64)

    def features(self, x: Tensor) -> Tensor:
        """Last rows one after another, shape (B, lags C)."""
        return x[:, -self.lags :].flatten(1)

    @torch.no_grad()
    def solve(self, x: Tensor, y: Tensor) -> None:
        """Set the coefficients: least mean((A b + a - y)^2) + ridge b'b, the constant a free."""
        a, y = self.features(x), y.reshape(len(y), -1)
        a_mean, y_mean = a.mean(0), y.mean(0)
        a, y = a - a_mean, y - y_mean
        b = ridge_solution(a.T @ a / len(y), a.T @ y / len(y), self.ridge)
        self.dense.weight.copy_(b.T)
        self.dense.bias.copy_(y_mean - a_mean @ b)


NETWORKS: dict[type[SequenceSettings], Callable[[Any, int, int], SequenceNetwork]] = {
    CnnLstmAttentionSettings: CnnLstmAttention, CnnLstmSettings: CnnLstm, LstmSettings: Lstm,
    TcnSettings: Tcn, ResNetSettings: ResNet, ArxSettings: Arx,
}  # fmt: skip
"""Settings of a kind -> what builds its network for windows of T rows and C channels."""


def sequence_network(
    settings: SequenceSettings, length: int, channels: int, generator: torch.Generator
) -> SequenceNetwork:
    """Network of a kind's settings for windows of T rows and C channels, not yet trained.

    Initial weights are uniform within 1 / sqrt(inputs of the node), in an LSTM within 1 /
    sqrt(units) with 1 added for its forget gates.  Raises ValueError when windows are empty, or the
    settings are of no network.
    """
    if length < 1 or channels < 1:
        raise ValueError(
            f"a network on windows of {length} rows and {channels} channels cannot be built: give "
            "at least one of each"
        )
    if type(settings) not in NETWORKS:
        raise ValueError(
            f"{type(settings).__name__} is of no network on windows: give one of nets.settings"
        )
    with torch.device("meta"):  # without torch's own initial weights
        built = NETWORKS[type(settings)](settings, length, channels)
    built.to_empty(device="cpu")
    with torch.no_grad():
        for module in built.modules():
            if isinstance(module, nn.Linear | nn.Conv1d):
                reach = module.weight[0].numel() ** -0.5
            elif isinstance(module, nn.LSTM):
                reach = module.hidden_size**-0.5
            else:
                continue
            for name, values in module.named_parameters():
                values.uniform_(-reach, reach, generator=generator)
                if name == "bias_ih_l0":  # of an LSTM: input, forget, cell and output gates
                    values.unflatten(0, (4, -1))[1] += 1.0
    return built
