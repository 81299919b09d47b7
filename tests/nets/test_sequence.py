"""Networks on windows: shapes, gradients, causality, attention, the linear model's oracle."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn
from torch.nn import functional

from pipeline.nets.sequence import (
    Arx,
    CnnLstm,
    CnnLstmAttention,
    Tcn,
    over_rows,
    sequence_network,
)
from pipeline.nets.settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    ResNetSettings,
    SequenceSettings,
    TcnSettings,
    WindowTraining,
)

TINY: tuple[SequenceSettings, ...] = (
    CnnLstmAttentionSettings(filters=3, kernel=2, units=4, attention=3),
    CnnLstmAttentionSettings(filters=3, pool=2, units=4),
    CnnLstmSettings(filters=3, kernel=2, units=4),
    LstmSettings(units=4),
    TcnSettings(filters=3, kernel=2, blocks=2),
    ResNetSettings(filters=2, kernel=3, blocks=2),
    ResNetSettings(filters=2, kernel=3, blocks=1, rows=2),
    ArxSettings(lags=3),
)


def built(kind: SequenceSettings, length: int = 7, channels: int = 2):  # type: ignore[no-untyped-def]
    return sequence_network(kind, length, channels, torch.Generator().manual_seed(3))


def rows(many: int = 5, length: int = 7, channels: int = 2) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.randn(many, length, channels, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize("kind", TINY, ids=repr)
def test_gradients_are_those_of_finite_differences(kind: SequenceSettings) -> None:
    """Of windows and of all weights; seeds keep ReLU and pool away from their kinks."""
    network = built(kind, 2).double()
    names = [name for name, _ in network.named_parameters()]

    def output(x: torch.Tensor, *values: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(network, dict(zip(names, values, strict=True)), (x,))

    weights = [p.detach().clone().requires_grad_() for p in network.parameters()]
    assert torch.autograd.gradcheck(output, (rows(2).requires_grad_(), *weights))


@pytest.mark.parametrize("kind", TINY, ids=repr)
def test_initial_weights_are_the_generator_s_and_no_other_random_number_is_used(
    kind: SequenceSettings,
) -> None:
    before = torch.get_rng_state()
    one, two = built(kind), built(kind)
    assert torch.equal(torch.get_rng_state(), before)
    for a, b in zip(one.parameters(), two.parameters(), strict=True):
        assert torch.equal(a, b) and torch.isfinite(a).all() and a.abs().max() > 0
    other = sequence_network(kind, 7, 2, torch.Generator().manual_seed(4))
    assert not torch.equal(other.dense.weight, one.dense.weight)


@pytest.mark.parametrize("kernel", [1, 2, 3])
def test_the_convolution_as_a_product_is_the_convolution(kernel: int) -> None:
    network = built(CnnLstmSettings(filters=5, kernel=kernel, units=2)).double()
    assert isinstance(network, CnnLstm)
    x, inner = rows(), network.convolution.convolution
    before = functional.pad(x.transpose(1, 2), (kernel - 1, 0))
    wanted = functional.conv1d(before, inner.weight, inner.bias)
    found = network.convolution.in_time(x.transpose(0, 1))
    torch.testing.assert_close(found, wanted.permute(2, 0, 1), rtol=1e-12, atol=1e-12)
    found = network.convolution(x)
    torch.testing.assert_close(found, wanted.transpose(1, 2), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("stride", "padding", "dilation"), [(1, 0, 1), (4, 3, 1), (2, 2, 3)])
def test_a_convolution_over_rows_is_that_over_time(
    stride: int, padding: int, dilation: int
) -> None:
    inner = nn.Conv1d(2, 5, 3, stride, padding, dilation).double()
    x = torch.randn(4, 20, 2, dtype=torch.float64)
    wanted = inner(x.transpose(1, 2)).transpose(1, 2)
    torch.testing.assert_close(over_rows(x, inner), wanted, rtol=1e-12, atol=1e-12)


@torch.no_grad()
def test_attention_is_the_softmax_of_the_published_scores() -> None:
    network = built(TINY[0]).double()
    assert isinstance(network, CnnLstmAttention)
    x = rows()
    weights = network.attention(x)
    assert weights.shape == (5, 7) and (weights > 0).all()
    torch.testing.assert_close(weights.sum(1), torch.ones(5, dtype=torch.float64))
    h = network.states(x).transpose(0, 1).numpy()  # (B, T, units)
    W, b = network.score.weight.numpy(), network.score.bias.numpy()
    v = network.direction.weight.numpy()[0]
    e = np.tanh(h @ W.T + b) @ v
    share = np.exp(e) / np.exp(e).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(weights.numpy(), share, rtol=1e-12)
    context = (share[..., None] * h).sum(axis=1)
    wanted = context @ network.dense.weight.numpy()[0] + network.dense.bias.numpy()
    np.testing.assert_allclose(network(x).numpy(), wanted, rtol=1e-12)


@torch.no_grad()
@pytest.mark.parametrize("pool", [2, 3, 9])
def test_the_pool_drops_the_oldest_rows_only(pool: int) -> None:
    network = built(CnnLstmSettings(filters=4, kernel=1, pool=pool, units=3)).double()
    assert isinstance(network, CnnLstm)
    x = rows()
    assert len(network.states(x)) == max(7 // pool, 1)
    left = 7 % min(pool, 7)
    changed = x.clone()
    changed[:, :left] += 10.0
    assert torch.equal(network(changed), network(x))
    changed = x.clone()
    changed[:, -1] += 10.0
    assert not torch.equal(network(changed), network(x))


@torch.no_grad()
def test_what_comes_later_changes_no_row_of_the_tcn() -> None:
    network = built(TcnSettings(filters=4, kernel=2, blocks=3), length=20).double()
    assert isinstance(network, Tcn)
    x = rows(length=20)
    for t in range(19):
        changed = x.clone()
        changed[:, t + 1 :] += 5.0
        torch.testing.assert_close(
            network.rows(changed)[:, : t + 1], network.rows(x)[:, : t + 1], rtol=1e-13, atol=1e-13
        )
        assert not torch.allclose(network.rows(changed)[:, t + 1 :], network.rows(x)[:, t + 1 :])


@torch.no_grad()
def test_the_tcn_sees_as_far_as_its_settings_say() -> None:
    """1 + 2 (kernel - 1) (2^blocks - 1) = 7 samples: the gradient ends there."""
    network = built(TcnSettings(filters=6, kernel=2, blocks=2), length=12).double()
    x = rows(length=12)
    with torch.enable_grad():
        x.requires_grad_()
        network(x).sum().backward()
    assert x.grad is not None
    reached = x.grad.abs().sum((0, 2)) > 0
    assert not reached[: 12 - 7].any() and reached[12 - 7]


@torch.no_grad()
@pytest.mark.parametrize("ridge", [1e-10, 0.3])
def test_the_linear_model_is_numpy_s_least_squares(ridge: float) -> None:
    network = built(ArxSettings(lags=4, ridge=ridge))
    assert isinstance(network, Arx)
    x = rows(many=60) + 0.7
    y = torch.randn(60, 1, generator=torch.Generator().manual_seed(2)).double() + 2.0
    network.solve(x, y[:, 0])
    a = x[:, -4:].reshape(60, -1).numpy()
    # rows of the penalty below those of the samples; the constant, last, has none
    penalty = np.hstack([np.sqrt(60 * ridge) * np.eye(8), np.zeros((8, 1))])
    stacked = np.vstack([np.hstack([a, np.ones((60, 1))]), penalty])
    wanted, *_ = np.linalg.lstsq(stacked, np.vstack([y, np.zeros((8, 1))]), rcond=None)
    np.testing.assert_allclose(network.dense.weight.numpy().T, wanted[:8], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(network.dense.bias.numpy(), wanted[8], rtol=1e-7)


def test_what_cannot_be_built_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one of each"):
        built(LstmSettings(), channels=0)
    with pytest.raises(ValueError, match=r"give one of nets\.settings"):
        built(SequenceSettings())
    with pytest.raises(ValueError, match=r"lstm\.units = 0 must be"):
        LstmSettings(units=0)
    with pytest.raises(ValueError, match="must be one of float32, bfloat16"):
        replace(WindowTraining(), precision="float16")
