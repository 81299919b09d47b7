"""One training loop for all networks: the same samples, scaling, budget and early stopping.

``genetic``: adaptive genetic search over the bands with ridge least squares for the consequents
inside (FFNN2015), a generation at once.  ``projection``: the same least squares, and Adam on the
bands; at the least-squares consequents the gradient of the projected error is that with these
held (variable projection, Golub and Pereyra 1973).  ``gradient``: Adam on everything, from evenly
spread bands and their least squares.  ``back_propagation``: plain gradient descent, sample by
sample.

Whole groups are kept for early stopping, and the state with the least error on them is the result.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from pipeline.kernels import compiled
from pipeline.nets import stored
from pipeline.nets.descent import BestState, training_loop, validation_groups
from pipeline.nets.ffnn import (
    BackPropagationNetwork,
    FilteredNetwork,
    Network,
    Whitened,
    network,
    ridge_solution,
)
from pipeline.nets.settings import KINDS, BackPropagationSettings, NetworkSettings, TrainingSettings
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise

ROWS = 8192
"""Samples of one step of a prediction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """A trained network."""

    kind: NetworkSettings
    """Kind of the network."""
    method: str
    """Method of the training."""
    settings: TrainingSettings
    """Settings of the training."""
    x_scaling: stored.Scaling
    """Scaling of the temperatures [K]: all the same for bands over the channels, which compare
    them; each its own for the sigmoid network."""
    c_scaling: stored.Scaling
    y_scaling: stored.Scaling
    """Scaling of the consequent inputs and of the output [µm]."""
    network: Network
    """Network in its best state."""
    history: Floats
    """Passes up to then [1], RMSE of the training samples and of the validation samples [µm]; where
    no groups were kept for validation, the former twice; shape (H, 3)."""
    validation_groups: tuple[str, ...]
    """Labels of the groups that decided on the best state."""

    @property
    def passes(self) -> int:
        """Passes over the training samples that were used [1]."""
        return int(self.history[-1, 0])

    def predict(self, x: ArrayLike, c: ArrayLike) -> Floats:
        """Output at samples, shape (T,), in the unit of what was learnt [µm].

        x (T, N) are temperatures above the reference [K], c (T, K) the consequent inputs.  Raises
        ValueError when shapes do not fit the network, or a value is not finite.
        """
        many = len(self.x_scaling.shift), len(self.c_scaling.shift)
        x, c = stored.samples("x", x, 2), stored.samples("c", c, 2)
        if x.shape[1] != many[0] or c.shape[1] != many[1] or len(x) != len(c):
            raise ValueError(
                f"x and c have shapes {x.shape} and {c.shape}: this network takes {many[0]} "
                f"temperatures and {many[1]} consequent inputs of each sample"
            )
        found = np.empty(len(x))
        with stored.reproducible(), torch.no_grad():
            for k in range(0, len(x), ROWS):
                rows = slice(k, k + ROWS)
                scaled = self.x_scaling.scaled(x[rows]), self.c_scaling.scaled(c[rows])
                found[rows] = self.network(*scaled).numpy()
        return self.y_scaling.restored(found)

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them."""
        state = {name: values.tolist() for name, values in self.network.state_dict().items()}
        return {
            "kind": self.kind.kind,
            "network": asdict(self.kind),  # type: ignore[call-overload]
            "method": self.method,
            "training": asdict(self.settings),
            "scaling": stored.scaling_document(
                x=self.x_scaling, c=self.c_scaling, y=self.y_scaling
            ),
            "state": state,
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }


def restore(document: Mapping[str, Any]) -> Trained:
    """The trained network of a :meth:`Trained.document`; it predicts the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit the network that
    it names.
    """
    with stored.document_of("a network"):
        kind = KINDS[document["kind"]](**document["network"])
        x, c, y = (stored.restored_scaling(document["scaling"], part) for part in "xcy")
        built = network(kind, len(x.shift), len(c.shift), torch.Generator())
        stored.fill(built, document["state"])
        return Trained(
            kind=kind, method=document["method"],
            settings=TrainingSettings(**document["training"]), x_scaling=x, c_scaling=c,
            y_scaling=y, network=built, history=stored.history_of(document),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip


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
    x, c, y = stored.samples("x", x, 2), stored.samples("c", c, 2), stored.samples("y", y, 1)
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
    kept = validation_groups(labels, settings.validation, settings.seed, "training")
    held = np.isin(labels, kept)
    learnt = ~held
    with stored.reproducible():
        generator = torch.Generator().manual_seed(settings.seed)
        built = network(kind, x.shape[1], c.shape[1], generator)
        of_x, of_c = _inputs_scaling(kind, x[learnt]), stored.Scaling.standard(c[learnt], axis=0)
        of_y = stored.Scaling.standard(y[learnt])

        def scaled(rows: Bools) -> Samples:
            return of_x.scaled(x[rows]), of_c.scaled(c[rows]), of_y.scaled(y[rows])

        training = scaled(learnt)
        validation = scaled(held) if kept else training
        progress = Progress(built, training, validation, settings.patience)
        _LOOPS[method](progress, settings, generator)
        progress.keep_best()
    return Trained(
        kind=kind, method=method, settings=settings, x_scaling=of_x, c_scaling=of_c, y_scaling=of_y,
        network=built, history=progress.errors(of_y.scale), validation_groups=kept,
    )  # fmt: skip


def _inputs_scaling(kind: NetworkSettings, x: Floats) -> stored.Scaling:
    """Temperatures to 0..1, all alike, or for the sigmoid network each to -1..1."""
    low, high = x.min(axis=0), x.max(axis=0)
    if isinstance(kind, BackPropagationSettings):
        return stored.Scaling.of(0.5 * (low + high), 0.5 * (high - low), x)
    one = np.ones(x.shape[1])
    return stored.Scaling.of(low.min() * one, (high.max() - low.min()) * one, x)


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

    @property
    def bands(self) -> FilteredNetwork:
        """The network, which has bands; TypeError for one without."""
        if not isinstance(self.built, FilteredNetwork):
            raise TypeError(f"{type(self.built).__name__} has no bands to search")
        return self.built

    @torch.no_grad()
    def _rmse(self, part: Samples) -> float:
        x, c, y = part
        return float(torch.sqrt(torch.mean((self.built(x, c) - y) ** 2)))


def _genetic(progress: Progress, settings: TrainingSettings, generator: torch.Generator) -> None:
    """Adaptive genetic search over the bands, ridge least squares inside."""
    built, (x, c, y) = progress.bands, progress.training
    shape, power = built.bands.shape, torch.mean(y**2)

    @torch.no_grad()
    def cost(genes: Floats) -> Floats:
        bands = torch.from_numpy(genes).view(-1, *shape)
        gram, moment = built.normal_equations(bands, x, c, y)
        b = ridge_solution(gram, moment, settings.ridge)[..., 0]
        # mean((A b - y)^2) + ridge b'b is the power of y less b'm where b solves the equations
        return (power - (b * moment[..., 0]).sum(-1)).numpy()

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


def _projection(progress: Progress, settings: TrainingSettings, generator: torch.Generator) -> None:
    """Adam on the bands, with the consequents of ridge least squares at every step."""
    built, (x, c, y) = progress.bands, progress.training
    optimizer = torch.optim.Adam([built.places], lr=settings.learning_rate, fused=True)
    for done in training_loop(settings.passes, progress.stopped):
        if done > 1:
            optimizer.zero_grad()
            found = built.output(built.consequents.detach(), x, c)
            torch.mean((found - y) ** 2).backward()
            optimizer.step()
            built.keep_bounds()
        built.solve_consequents(x, c, y, settings.ridge)


def _gradient(progress: Progress, settings: TrainingSettings, generator: torch.Generator) -> None:
    """Adam on all parameters in batches, its rate falling along a cosine to the last pass."""
    built, (x, c, y), whitened = progress.built, progress.training, None
    if isinstance(built, FilteredNetwork):
        whitened = Whitened(built, x, c, y, settings.ridge)
    parameters = whitened.parameters if whitened else list(built.parameters())
    output = whitened or built
    optimizer = torch.optim.Adam(parameters, lr=settings.learning_rate, fused=True)
    rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, T_max=settings.passes)
    for done in training_loop(settings.passes, progress.stopped):
        if whitened and done == 1:
            continue  # its least squares are a pass
        for rows in torch.randperm(len(y), generator=generator).split(settings.batch):
            optimizer.zero_grad()
            torch.mean((output(x[rows], c[rows]) - y[rows]) ** 2).backward()
            optimizer.step()
            if whitened:
                whitened.built.keep_bounds()
        rate.step()
        if whitened:
            whitened.settle()


def _descent(progress: Progress, settings: TrainingSettings, generator: torch.Generator) -> None:
    """Plain gradient descent on half the squared error, sample by sample."""
    built, (x, c, y) = progress.built, progress.training
    if not isinstance(built, BackPropagationNetwork):
        raise TypeError(f"{type(built).__name__} is not trained by plain back-propagation")
    inputs = np.ascontiguousarray(built.inputs(x, c).numpy())
    weights = [p.detach().numpy() for p in built.parameters()]  # views: changed in place
    scratch = np.empty(len(weights[1]))
    for _ in training_loop(settings.passes, progress.stopped):
        order = torch.randperm(len(y), generator=generator).numpy()
        descend(order, inputs, y.numpy(), *weights, scratch, settings.learning_rate)


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


_LOOPS: dict[str, Callable[..., None]] = {
    "genetic": _genetic, "projection": _projection, "gradient": _gradient,
    "back_propagation": _descent,
}  # fmt: skip
