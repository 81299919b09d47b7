"""Training of networks on windows: Adam and early stopping on whole recordings.

The linear model is solved at once from the same windows.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from pipeline.nets import stored
from pipeline.nets.descent import (
    Adam,
    BestState,
    autocast,
    cooled,
    training_loop,
    usable_precision,
    validation_groups,
)
from pipeline.nets.sequence import Arx, CnnLstmAttention, SequenceNetwork, sequence_network
from pipeline.nets.settings import (
    WINDOW_KINDS,
    CnnLstmAttentionSettings,
    SequenceSettings,
    WindowTraining,
)
from pipeline.nets.windows import WindowInput, Windows
from pipeline.schema.arrays import Bools, Floats

ROWS = 1024
"""Windows of one step of a prediction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrainedSequence:
    """A trained network on windows."""

    kind: SequenceSettings
    """Kind of the network."""
    settings: WindowTraining
    """Settings of its training."""
    precision: str
    """Precision of the training's products, as the processor had it."""
    length: int
    """Rows T of a window."""
    inputs: tuple[WindowInput, ...]
    """Inputs of the channels, where they were given."""
    leaks: tuple[str, ...]
    """Inputs that could not be known yet; empty but for a demonstration."""
    x_scaling: stored.Scaling
    y_scaling: stored.Scaling
    """Scaling of each channel, and of the target."""
    network: SequenceNetwork
    """Network in its best state."""
    history: Floats
    """Epochs up to then [1], RMSE of the training windows as an epoch's steps met them and of the
    validation windows after it, in the unit of the target; where no recordings were kept for
    validation, the former twice; shape (E, 3)."""
    validation_groups: tuple[str, ...]
    """Recordings that decided on the best state."""

    @property
    def epochs(self) -> int:
        """Epochs that were trained [1]."""
        return len(self.history)

    def predict(self, windows: ArrayLike) -> Floats:
        """Target of windows, shape (B,), in its unit.

        Windows (B, T, C) are in the units that were learnt from, the newest row last.  Raises
        ValueError when the shape does not fit the network, or a value is not finite.
        """
        parts = [self.network(x).numpy() for x in self._steps(windows)]
        found = np.concatenate(parts) if parts else np.empty(0)
        return self.y_scaling.restored(found.astype(np.float64))

    def attention(self, windows: ArrayLike) -> Floats:
        """Weight of each row of the states, shape (B, T // pool); those of a window add up to 1.

        Raises ValueError for windows that :meth:`predict` refuses, or a network without attention.
        """
        built = self.network
        if not isinstance(built, CnnLstmAttention):
            raise ValueError(
                f"a {self.kind.kind} network has no attention: ask one of kind "
                f"{CnnLstmAttentionSettings.kind}"
            )
        parts = [built.attention(x).numpy() for x in self._steps(windows)]
        rows = max(self.length // built.pool, 1)
        return (np.concatenate(parts) if parts else np.empty((0, rows))).astype(np.float64)

    def _steps(self, windows: ArrayLike) -> Iterator[Tensor]:
        """Scaled windows in pieces, for which gradients are off and torch has one thread."""
        x = stored.samples("windows", windows, 3)
        wanted = self.length, len(self.x_scaling.shift)
        if x.shape[1:] != wanted:
            raise ValueError(
                f"windows have shape {x.shape}: this network takes {wanted[0]} rows of {wanted[1]} "
                "channels each"
            )
        dtype = self.network.dense.weight.dtype
        with stored.reproducible(), torch.no_grad():
            for k in range(0, len(x), ROWS):
                yield self.x_scaling.scaled(x[k : k + ROWS], dtype)

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them; weights in base64."""
        return {
            "kind": self.kind.kind,
            "network": asdict(self.kind),  # type: ignore[call-overload]
            "training": asdict(self.settings),
            "precision": self.precision,
            "length": self.length,
            "outputs": None,
            "inputs": [asdict(one) for one in self.inputs],
            "leaks": list(self.leaks),
            "scaling": stored.scaling_document(x=self.x_scaling, y=self.y_scaling),
            "state": stored.state_of(self.network),
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }


def restore_sequence(document: Mapping[str, Any]) -> TrainedSequence:
    """The network of a :meth:`TrainedSequence.document`; it predicts the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit the network that
    it names.
    """
    with stored.document_of("a network"):
        kind = WINDOW_KINDS[document["kind"]](**document["network"])
        x, y = (stored.restored_scaling(document["scaling"], part) for part in "xy")
        built = sequence_network(kind, document["length"], len(x.shift), torch.Generator())
        stored.fill(built, document["state"])
        return TrainedSequence(
            kind=kind, settings=WindowTraining(**document["training"]),
            precision=document["precision"], length=document["length"],
            inputs=tuple(WindowInput(**one) for one in document["inputs"]),
            leaks=tuple(document["leaks"]), x_scaling=x, y_scaling=y, network=built,
            history=stored.history_of(document),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip


Samples = tuple[Tensor, Tensor]
"""Scaled windows and targets."""


Watch = Callable[[int, float], bool | None]
"""Called after each epoch with its number and the RMSE of the validation windows, in the unit of
the target; true ends the training."""


def train_windows(
    kind: SequenceSettings, windows: Windows, *, settings: WindowTraining,
    watch: Watch | None = None,
) -> TrainedSequence:  # fmt: skip
    """Network that is trained on windows, in its best state.

    The groups of ``windows`` are whole recordings; ``watch`` is called after each epoch.  Raises
    ValueError when windows are empty, not finite or of shapes that do not fit, when there is no
    recording to learn from beside those for validation, or when the first epoch diverges
    (:class:`~pipeline.nets.descent.Diverged`).
    """
    x, y = stored.samples("x", windows.x, 3), stored.samples("y", windows.y, 1)
    labels = [str(one) for one in windows.group]
    if not len(x) == len(y) == len(labels):
        raise ValueError(
            f"x, y and group have shapes {x.shape}, {y.shape} and ({len(labels)},): give as many "
            "windows of each"
        )
    if x.size == 0 or y.size == 0:
        raise ValueError(
            f"there is nothing to learn from: x and y have shapes {x.shape} and {y.shape}"
        )
    seed = settings.seed if settings.validation_seed is None else settings.validation_seed
    kept = validation_groups(labels, settings.validation, seed, "window_training")
    held = np.isin(labels, kept)
    of_x, of_y = stored.Scaling.standard(x[~held], axis=(0, 1)), stored.Scaling.standard(y[~held])
    precision = usable_precision(settings.precision)
    with stored.reproducible():
        generator = torch.Generator().manual_seed(settings.seed)
        built = sequence_network(kind, x.shape[1], x.shape[2], generator)
        dtype = built.dense.weight.dtype
        scaled = of_x.scaled(x, dtype), of_y.scaled(y, dtype)
        training, validation = (_chosen(scaled, rows) for rows in (~held, held))
        if isinstance(built, Arx):
            precision = "float64"
            built.solve(*training)
            least = _rmse(built, training)
            state = BestState(built, "the linear model has no finite error: raise arx.ridge")
            state.add(1, least, _rmse(built, validation) if kept else least)
        else:
            state = _trained(
                built, settings, precision, generator, training, validation,
                unit=float(of_y.scale), watch=watch,
            )  # fmt: skip
    return TrainedSequence(
        kind=kind, settings=settings, precision=precision, length=x.shape[1],
        inputs=windows.inputs, leaks=windows.leaks, x_scaling=of_x, y_scaling=of_y,
        network=built.requires_grad_(), history=state.errors(of_y.scale), validation_groups=kept,
    )  # fmt: skip


def _trained(
    built: SequenceNetwork, settings: WindowTraining, precision: str, generator: torch.Generator,
    training: Samples, validation: Samples, *, unit: float, watch: Watch | None,
) -> BestState:  # fmt: skip
    """Errors by epoch of Adam over batches of windows; the network is left in its best state."""
    names, weights = zip(*built.named_parameters(), strict=True)
    l2 = [0.0 if "bias" in name else settings.l2 for name in names]
    adam = Adam(weights, settings.learning_rate, l2=l2)
    state = BestState(
        built,
        "training diverged in its first epoch: lower window_training.learning_rate from "
        f"{settings.learning_rate:g}",
    )
    (x, y), total = training, torch.zeros(())

    def stopped(done: int) -> bool:
        learnt = float(torch.sqrt(total / len(y)))  # RMSE that the epoch's steps met
        error = _rmse(built, validation) if len(validation[1]) else learnt
        if not state.add(done, learnt, error):
            return True
        return bool(watch and watch(done, unit * error)) or state.idle >= settings.patience

    for done in training_loop(settings.epochs, stopped):
        adam.rate = settings.learning_rate * cooled(done, settings.epochs, settings.cooling)
        total.zero_()
        for rows in torch.randperm(len(y), generator=generator).split(settings.batch):
            with autocast(precision):
                found = built(x[rows])
            loss = torch.nn.functional.mse_loss(found.float(), y[rows])
            adam.step(loss)
            total += loss.detach() * len(rows)
    state.keep_best()
    return state


def _chosen(scaled: Samples, rows: Bools) -> Samples:
    x, y = (part[torch.from_numpy(rows)] for part in scaled)
    return x, y


@torch.no_grad()
def _rmse(built: SequenceNetwork, part: Samples) -> float:
    """RMSE of scaled targets, in the network's own precision."""
    x, y = part
    found = torch.cat([built(piece) for piece in x.split(ROWS)])
    return float(torch.sqrt(torch.mean((found - y) ** 2)))
