"""Each layer against an independent restatement; gradients, shapes, limits, least squares."""

import numpy as np
import pytest
import torch

from pipeline.nets import ffnn
from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
)
from tests.nets.samples import KINDS, tensors

FILTERED = (FuzzyFilteredSettings(bands=4), ClassicFuzzySettings(bands=4))


def built(kind: NetworkSettings, sensors: int = 9, inputs: int = 3) -> ffnn.FilteredNetwork:
    """A network at random bands and consequents."""
    generator = torch.Generator().manual_seed(3)
    made = ffnn.network(kind, sensors, inputs, generator)
    if isinstance(made, ffnn.FilteredNetwork):
        with torch.no_grad():
            for values in made.parameters():
                values.uniform_(0.05, 0.95, generator=generator)
    return made  # type: ignore[return-value]


def some(many: int, sensors: int = 9, inputs: int = 3) -> tuple[torch.Tensor, ...]:
    rng = np.random.default_rng(1)
    return tensors(
        rng.random((many, sensors)), rng.normal(size=(many, inputs)), rng.normal(size=many)
    )


def test_the_improved_network_is_the_published_sum() -> None:
    made = built(FuzzyFilteredSettings(bands=4))
    x, c, _ = some(5)
    bands, rules = made.bands.detach().numpy(), made.consequents.detach().numpy()
    for sample in range(5):
        t = x[sample].numpy() + 1.0
        o = []
        for centre, width in bands:
            mu = [np.exp(-((i - centre) ** 2) / (2 * width**2)) for i in range(9)]
            o.append(sum(m * v for m, v in zip(mu, t, strict=True)) / sum(mu))
        y = 0.0
        for j in range(4):
            p, q, r, s = rules[j]
            y += o[j] / sum(o) * (p * c[sample, 0] + q * c[sample, 1] + r * c[sample, 2] + s)
        assert float(made(x, c)[sample].detach()) == pytest.approx(float(y), rel=1e-12)


def test_the_classic_network_has_bells_and_sigmoids() -> None:
    made = built(ClassicFuzzySettings(bands=4))
    x = some(5)[0]
    found = made.strengths(made.bands, x).detach().numpy()
    for j, (centre, width, slope, steepness, threshold) in enumerate(made.bands.tolist()):
        mu = 1 / (1 + np.abs((np.arange(9) - centre) / width) ** (2 * slope))
        o = x.numpy() @ mu / mu.sum()
        expected = 1 / (1 + np.exp(-steepness * (o - threshold)))
        np.testing.assert_allclose(found[:, j], expected, rtol=1e-9)


@pytest.mark.parametrize("kind", KINDS, ids=repr)
@pytest.mark.parametrize(("sensors", "inputs"), [(3, 1), (9, 3), (14, 8)])
def test_shapes(kind: NetworkSettings, sensors: int, inputs: int) -> None:
    made = built(kind, sensors, inputs)
    x, c, _ = some(7, sensors, inputs)
    out = made(x, c)
    assert out.shape == (7,) and out.dtype == torch.float64
    if isinstance(made, ffnn.FilteredNetwork):
        a = made.designs(made.bands, x, c)
        assert a.shape == (7, 3 * (inputs + 1))
        torch.testing.assert_close(a @ made.consequents.flatten(), out, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS, ids=repr)
def test_gradients_are_finite_differences(kind: NetworkSettings) -> None:
    made = built(kind)
    x, c, _ = some(6)
    names = [name for name, _ in made.named_parameters()]

    def output(*values: torch.Tensor) -> torch.Tensor:
        return torch.func.functional_call(made, dict(zip(names, values, strict=True)), (x, c))

    at = tuple(p.detach().clone().requires_grad_() for p in made.parameters())
    assert torch.autograd.gradcheck(output, at, rtol=1e-6, atol=1e-8)


def test_a_band_on_a_channel_has_a_gradient() -> None:
    """A bell's derivative by its slope has a logarithm, which must not spoil the rest."""
    made = ffnn.ClassicFuzzyNetwork(ClassicFuzzySettings(bands=3), 9, 3)
    assert float(made.bands[1, 0].detach()) == 4.0
    x, c, _ = some(6)
    torch.nn.init.ones_(made.consequents)
    made(x, c).sum().backward()
    assert all(torch.isfinite(p.grad).all() for p in made.parameters() if p.grad is not None)


@pytest.mark.parametrize("kind", FILTERED, ids=repr)
def test_a_population_of_bands_is_one_by_one(kind: NetworkSettings) -> None:
    made = built(kind)
    x, c, y = some(5000)  # more than are summed at once
    bands = made.low + torch.rand(6, *made.bands.shape, dtype=torch.float64) * (
        made.high - made.low
    )
    gram, moment = made.normal_equations(bands, x, c, y)
    for k in range(6):
        a = made.designs(bands[k], x, c)
        torch.testing.assert_close(gram[k], a.mT @ a / 5000, rtol=1e-10, atol=1e-13)
        torch.testing.assert_close(moment[k, :, 0], a.mT @ y / 5000, rtol=1e-10, atol=1e-13)
    found = ffnn.ridge_solution(gram, moment, 1e-6)
    made.set_bands(bands[4])
    made.solve_consequents(x, c, y, 1e-6)
    alone = made.consequents.detach().flatten()
    torch.testing.assert_close(found[4, :, 0], alone, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("kind", FILTERED, ids=repr)
@pytest.mark.parametrize("ridge", [1e-8, 1e-4, 1.0])
def test_consequents_are_those_of_an_augmented_least_squares(
    kind: NetworkSettings, ridge: float
) -> None:
    """Orthogonal, of twice the digits that normal equations have."""
    made = built(kind)
    x, c, y = some(400)
    made.solve_consequents(x, c, y, ridge)
    found = made.consequents.detach().flatten().numpy()
    a = made.designs(made.bands, x, c).detach().numpy()
    columns = a.shape[1]
    rows = np.concatenate([a, np.sqrt(400 * ridge) * np.eye(columns)])
    oracle = np.linalg.lstsq(rows, np.concatenate([y.numpy(), np.zeros(columns)]), rcond=None)[0]
    # eps over ridge bounds what the normal equations lose
    np.testing.assert_allclose(found, oracle, rtol=1e-6, atol=1e-6 * np.abs(oracle).max())


@pytest.mark.parametrize("kind", FILTERED, ids=repr)
def test_whitened_consequents_start_at_least_squares_with_orthogonal_columns(
    kind: NetworkSettings,
) -> None:
    made, alone = built(kind), built(kind)
    x, c, y = some(400)
    white = ffnn.Whitened(made, x, c, y, 1e-8)
    alone.solve_consequents(x, c, y, 1e-8)
    torch.testing.assert_close(white(x, c), alone(x, c), rtol=1e-7, atol=1e-7)
    columns = (made.designs(made.bands, x, c) @ white.map).detach()
    one = torch.eye(len(white.z), dtype=torch.float64)
    ridge = 1e-8 * white.map.mT @ white.map  # what it adds to the squares of the columns
    torch.testing.assert_close(columns.mT @ columns / 400 + ridge, one, rtol=0.0, atol=1e-6)
    with torch.no_grad():
        white.z += 0.3
    white.settle()
    torch.testing.assert_close(made(x, c), white(x, c), rtol=1e-9, atol=1e-9)


def test_shares_are_positive_and_sum_to_one_however_cold() -> None:
    made = built(FuzzyFilteredSettings(bands=4, offset=0.3))
    x = torch.tensor(np.random.default_rng(0).normal(0.0, 50.0, (300, 9)))
    w = made.strengths(made.bands, x)
    assert (w > 0).all()
    torch.testing.assert_close(w.sum(-1), torch.ones(300, dtype=torch.float64))


def test_a_uniform_temperature_gives_equal_shares_and_the_mean_rule() -> None:
    made = built(FuzzyFilteredSettings(bands=4))
    x, c = torch.full((1, 9), 0.7, dtype=torch.float64), some(1)[1]
    rules = made.consequents[:, :3] @ c[0] + made.consequents[:, 3]
    torch.testing.assert_close(made(x, c)[0], rules.mean(), rtol=1e-12, atol=0.0)


def test_a_narrow_band_reads_its_channel_and_a_wide_one_the_mean() -> None:
    made = ffnn.FuzzyFilteredNetwork(FuzzyFilteredSettings(bands=2), 9, 3)
    x = some(4)[0]
    bands = torch.tensor([[6.0, ffnn.NARROWEST], [4.0, 9.0e3]], dtype=torch.float64)
    o = made.filtered(bands, x)
    neighbours = 2 * np.exp(
        -0.5 / ffnn.NARROWEST**2
    )  # of both sides, as a share of the channel's own
    torch.testing.assert_close(o[:, 0], x[:, 6], atol=float(neighbours), rtol=0.0)
    torch.testing.assert_close(o[:, 1], x.mean(1), rtol=1e-6, atol=0.0)


@pytest.mark.parametrize("bands", [1, 2, 3, 5, 12])
def test_bands_start_spread_inside_their_bounds_and_are_kept_there(bands: int) -> None:
    made = ffnn.FuzzyFilteredNetwork(FuzzyFilteredSettings(bands=bands), 9, 3)
    centre = made.bands[:, 0].detach().numpy()
    np.testing.assert_allclose(centre + centre[::-1], 8.0, atol=1e-12)
    with torch.no_grad():
        made.places += 7.0
    made.keep_bounds()
    torch.testing.assert_close(made.bands.detach(), made.high)


def test_what_no_network_can_be_built_on_is_refused() -> None:
    generator = torch.Generator()
    with pytest.raises(ValueError, match="on 2 sensors and 3 consequent inputs"):
        ffnn.network(FuzzyFilteredSettings(), 2, 3, generator)
    with pytest.raises(ValueError, match="on 9 sensors and 0 consequent inputs"):
        ffnn.network(BackPropagationSettings(), 9, 0, generator)
    with pytest.raises(ValueError, match="NetworkSettings is of no network"):
        ffnn.network(NetworkSettings(), 9, 3, generator)
    with pytest.raises(ValueError, match=r"fuzzy_filtered.bands = 0"):
        FuzzyFilteredSettings(bands=0)
