"""One training loop for all networks: the same samples, scaling, budget and early stopping.

``genetic``: adaptive genetic search over the bands with ridge least squares for the consequents
inside (FFNN2015), a generation at once.  ``projection``: the same least squares, and Adam on the
bands; at the least-squares consequents the gradient of the projected error is that with these
held (variable projection, Golub and Pereyra 1973).  ``gradient``: Adam on everything, from evenly
spread bands and their least squares.  ``back_propagation``: plain gradient descent, sample by
sample.

Whole groups are kept for early stopping, and the state with the least error on them is the result.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from pipeline.kernels import compiled
from pipeline.nets.best_state import BestState
from pipeline.nets.ffnn import (
    BackPropagationNetwork,
    FilteredNetwork,
    Network,
    Whitened,
    network,
    ridge_solution,
)
from pipeline.nets.settings import BackPropagationSettings, NetworkSettings, TrainingSettings
from pipeline.nets.stored import Scaling, reproducible, samples
from pipeline.nets.trained import Trained
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise

METHODS: dict[str, tuple[str, ...]] = {
    "fuzzy_filtered": ("genetic", "projection", "gradient"),
    "classic_fuzzy": ("genetic", "projection", "gradient"),
    "back_propagation": ("back_propagation", "gradient"),
}
"""Kind of network -> methods by which it can be trained."""

Samples = tuple[Tensor, Tensor, Tensor]
"""Scaled x, c and y."""


def train(
    kind: NetworkSettings, method: str, x: ArrayLike, c: ArrayLike, y: ArrayLike,
    group: Sequence[object] | Ints, *, settings: TrainingSettings,
) -> Trained:  # fmt: skip
    """Network that is trained on samples, in its best state.

    x (T, N) are temperatures above the reference [K], the sensors in their order along the machine,
    c (T, K) consequent inputs, y (T,) what is learnt, such as a deformation [µm]; ``group`` (T,)
    labels samples that belong together, such as a speed profile; ``method`` is one of
    :data:`METHODS` for that kind.  Raises ValueError when samples are empty, not finite or of
    shapes that do not fit, when the method is none of that kind, or when there is no group to learn
    from beside those for validation.
    """
    x, c, y = samples("x", x, 2), samples("c", c, 2), samples("y", y, 1)
    labels = [str(one) for one in group]
    if not len(x) == len(c) == len(y) == len(labels):
        raise ValueError(
            f"x, c, y and group have {len(x)}, {len(c)}, {len(y)} and {len(labels)} samples: "
            "give as many of each"
        )
    if len(y) == 0:
        raise ValueError("there are no samples to learn from: x, c, y and group are empty")
    if method not in METHODS.get(kind.kind, ()):
        raise ValueError(
            f"method {method!r} does not train a {kind.kind} network: choose one of "
            f"{', '.join(METHODS.get(kind.kind, ()))}"
        )
    kept = validation_groups(labels, settings)
    held = np.isin(labels, kept)
    learnt = ~held
    with reproducible():
        generator = torch.Generator().manual_seed(settings.seed)
        built = network(kind, x.shape[1], c.shape[1], generator)
        of_x, of_c = _inputs_scaling(kind, x[learnt]), Scaling.standard(c[learnt], axis=0)
        of_y = Scaling.standard(y[learnt])

        def scaled(rows: Bools) -> Samples:
            return of_x.scaled(x[rows]), of_c.scaled(c[rows]), of_y.scaled(y[rows])

        training = scaled(learnt)
        validation = scaled(held) if kept else training
        progress = Progress(built, training, validation, settings.patience)
        _WAYS[method](built, training, settings, progress, generator)
        progress.keep_best()
    return Trained(
        kind=kind, method=method, settings=settings, x_scaling=of_x, c_scaling=of_c, y_scaling=of_y,
        network=built, history=progress.errors(of_y.scale), validation_groups=kept,
    )  # fmt: skip


def _inputs_scaling(kind: NetworkSettings, x: Floats) -> Scaling:
    """Temperatures to 0..1, all alike, or for the sigmoid network each to -1..1."""
    low, high = x.min(axis=0), x.max(axis=0)
    if isinstance(kind, BackPropagationSettings):
        return Scaling.of(0.5 * (low + high), 0.5 * (high - low), x)
    one = np.ones(x.shape[1])
    return Scaling.of(low.min() * one, (high.max() - low.min()) * one, x)


def validation_groups(labels: Sequence[str], settings: TrainingSettings) -> tuple[str, ...]:
    """Labels of the groups that are kept for early stopping, at random by the seed.

    Raises ValueError when a group is to be kept and there is only one.
    """
    if settings.validation == 0:
        return ()
    groups = np.unique(np.asarray(labels))
    if len(groups) < 2:
        raise ValueError(
            f"there is one group, {str(groups[0])!r}, to learn from and to stop by: label at least "
            "two, or set training.validation = 0"
        )
    many = min(max(round(settings.validation * len(groups)), 1), len(groups) - 1)
    order = np.random.default_rng(settings.seed).permutation(len(groups))
    return tuple(sorted(str(one) for one in groups[order[:many]]))


class Progress(BestState):
    """Errors by pass on training and validation samples."""

    def __init__(
        self, built: Network, training: Samples, validation: Samples, patience: int
    ) -> None:
        super().__init__(built, "training diverged in its first pass: lower training.learning_rate")
        self.training, self.validation, self.patience = training, validation, patience

    def stopped(self, passes: int) -> bool:
        """Take down the errors after so many passes; whether the training is over."""
        finite = self.add(passes, self._rmse(self.training), self._rmse(self.validation))
        return not finite or self.idle >= self.patience

    @torch.no_grad()
    def _rmse(self, part: Samples) -> float:
        x, c, y = part
        return float(torch.sqrt(torch.mean((self.built(x, c) - y) ** 2)))


def _genetic(
    built: Network, training: Samples, settings: TrainingSettings, progress: Progress,
    generator: torch.Generator,
) -> None:  # fmt: skip
    """Adaptive genetic search over the bands, ridge least squares inside."""
    if not isinstance(built, FilteredNetwork):
        raise TypeError(f"{type(built).__name__} has no bands to search")
    x, c, y = training
    shape, power = built.bands.shape, torch.mean(y**2)

    @torch.no_grad()
    def cost(genes: Floats) -> Floats:
        bands = torch.from_numpy(genes).view(-1, *shape)
        gram, moment = built.normal_equations(bands, x, c, y)
        b = ridge_solution(gram, moment, settings.ridge)[..., 0]
        # mean((A b - y)^2) + ridge b'b is the power of y less b'm where b solves the equations
        least: Floats = (power - (b * moment[..., 0]).sum(-1)).numpy()
        return least

    gap = settings.population - 1  # children of a generation: one elite stays

    def callback(generation: int, best: Floats, cost: float) -> bool:
        built.set_bands(torch.from_numpy(best).view(shape))
        built.solve_consequents(x, c, y, settings.ridge)
        return progress.stopped(settings.population + (generation - 1) * gap)

    search = GeneticSettings(
        population=settings.population, fitness="exponential", breadth=settings.breadth,
        generations=1 + (settings.passes - settings.population) // gap, adaptive=True,
        seed=settings.seed,
    )  # fmt: skip
    low, high = built.low.flatten().numpy(), built.high.flatten().numpy()
    start = built.bands.detach().flatten().numpy()[None]
    minimise(cost, low, high, search, start=start, callback=callback)


def _projection(
    built: Network, training: Samples, settings: TrainingSettings, progress: Progress,
    generator: torch.Generator,
) -> None:  # fmt: skip
    """Adam on the bands, with the consequents of ridge least squares at every step."""
    if not isinstance(built, FilteredNetwork):
        raise TypeError(f"{type(built).__name__} has no bands to project")
    x, c, y = training
    optimizer = torch.optim.Adam([built.places], lr=settings.learning_rate, fused=True)
    for done in range(1, settings.passes + 1):
        b = built.solve_consequents(x, c, y, settings.ridge)
        if progress.stopped(done):
            return
        optimizer.zero_grad()
        torch.mean((built.output(b, x, c) - y) ** 2).backward()
        optimizer.step()
        built.keep_bounds()


def _gradient(
    built: Network, training: Samples, settings: TrainingSettings, progress: Progress,
    generator: torch.Generator,
) -> None:  # fmt: skip
    """Adam on all parameters in batches, its rate falling along a cosine to the last pass."""
    x, c, y = training
    whitened = None
    if isinstance(built, FilteredNetwork):
        whitened = Whitened(built, *training, settings.ridge)
        progress.stopped(1)  # its least squares are a pass
    parameters = whitened.parameters if whitened else list(built.parameters())
    output = whitened or built
    optimizer = torch.optim.Adam(parameters, lr=settings.learning_rate, fused=True)
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, T_max=settings.passes)
    for done in range(2 if whitened else 1, settings.passes + 1):
        for rows in torch.randperm(len(y), generator=generator).split(settings.batch):
            optimizer.zero_grad()
            torch.mean((output(x[rows], c[rows]) - y[rows]) ** 2).backward()
            optimizer.step()
            if whitened:
                whitened.built.keep_bounds()
        rate.step()
        if whitened:
            whitened.settle()
        if progress.stopped(done):
            return


def _descent(
    built: Network, training: Samples, settings: TrainingSettings, progress: Progress,
    generator: torch.Generator,
) -> None:  # fmt: skip
    """Plain gradient descent on half the squared error, sample by sample."""
    if not isinstance(built, BackPropagationNetwork):
        raise TypeError(f"{type(built).__name__} is not trained by plain back-propagation")
    x, c, y = training
    inputs = np.ascontiguousarray(built.inputs(x, c).numpy())
    weights = [p.detach().numpy() for p in built.parameters()]  # views: changed in place
    scratch = np.empty(len(weights[1]))
    for done in range(1, settings.passes + 1):
        order = torch.randperm(len(y), generator=generator).numpy()
        descend(order, inputs, y.numpy(), *weights, scratch, settings.learning_rate)
        if progress.stopped(done):
            return


@compiled
def descend(order, x, y, hidden, hidden_bias, output, output_bias, h, rate):  # type: ignore[no-untyped-def]
    """One pass of back-propagation: w <- w - rate d(e^2 / 2)/dw after each sample, in place.

    ``order`` (T,) of the samples, scaled x (T, N) and y (T,); weights (H, N), (H,), (1, H), (1,)
    change in place; ``h`` (H,) is to work in.
    """
    for t in order:
        e = output_bias[0] - y[t]
        for j in range(len(h)):
            z = hidden_bias[j]
            for i in range(x.shape[1]):
                z += hidden[j, i] * x[t, i]
            h[j] = 1.0 / (1.0 + np.exp(-z))
            e += output[0, j] * h[j]
        output_bias[0] -= rate * e
        for j in range(len(h)):
            d = e * output[0, j] * h[j] * (1.0 - h[j])
            output[0, j] -= rate * e * h[j]
            hidden_bias[j] -= rate * d
            for i in range(x.shape[1]):
                hidden[j, i] -= rate * d * x[t, i]


_WAYS: dict[str, Callable[..., None]] = {
    "genetic": _genetic, "projection": _projection, "gradient": _gradient,
    "back_propagation": _descent,
}  # fmt: skip
