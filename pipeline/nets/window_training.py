"""Training of networks on windows: Adam and early stopping on whole recordings.

The linear model is solved at once from the same windows.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import numpy as np
import torch
from torch import Tensor

from pipeline.nets.adam import Adam
from pipeline.nets.best_state import BestState
from pipeline.nets.sequence import Arx, SequenceNetwork, sequence_network
from pipeline.nets.sequence_settings import SequenceSettings, WindowTraining
from pipeline.nets.settings import TrainingSettings
from pipeline.nets.stored import Scaling, reproducible, samples
from pipeline.nets.training import validation_groups
from pipeline.nets.window_model import ROWS, TrainedSequence
from pipeline.nets.windows import Windows
from pipeline.schema.arrays import Bools, Floats

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
    (:class:`~pipeline.nets.best_state.Diverged`).
    """
    x, y = samples("x", windows.x, 3), samples("y", windows.y, 1)
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
    kept = _kept(labels, settings)
    held = np.isin(labels, kept)
    of_x, of_y = Scaling.standard(x[~held], axis=(0, 1)), Scaling.standard(y[~held])
    precision = usable_precision(settings.precision)
    with reproducible():
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
            loop = _Loop(built, settings, precision, generator, of_y.scale)
            state = loop.run(training, validation, watch)
    return TrainedSequence(
        kind=kind, settings=settings, precision=precision, length=x.shape[1],
        inputs=windows.inputs, leaks=windows.leaks, x_scaling=of_x, y_scaling=of_y,
        network=built.requires_grad_(), history=state.errors(of_y.scale), validation_groups=kept,
    )  # fmt: skip


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


def _kept(labels: list[str], settings: WindowTraining) -> tuple[str, ...]:
    """Recordings for early stopping, at random by the seed."""
    if settings.validation and len(set(labels)) < 2:
        raise ValueError(
            f"there is one recording, {labels[0]!r}, to learn from and to stop by: give at least "
            "two, or set window_training.validation = 0"
        )
    chosen = settings.seed if settings.validation_seed is None else settings.validation_seed
    split = TrainingSettings(validation=settings.validation, seed=chosen)
    return validation_groups(labels, split)


class _Loop:
    """Adam over batches of windows."""

    def __init__(
        self, built: SequenceNetwork, settings: WindowTraining, precision: str,
        generator: torch.Generator, unit: Floats,
    ) -> None:  # fmt: skip
        self.built, self.settings, self.precision = built, settings, precision
        self.generator, self.unit = generator, float(unit)
        names, weights = zip(*built.named_parameters(), strict=True)
        l2 = [0.0 if "bias" in name else settings.l2 for name in names]
        self.adam = Adam(weights, settings.learning_rate, l2=l2)

    def run(self, training: Samples, validation: Samples, watch: Watch | None) -> BestState:
        """Train, and give the network its best state."""
        settings = self.settings
        state = BestState(
            self.built,
            "training diverged in its first epoch: lower window_training.learning_rate from "
            f"{settings.learning_rate:g}",
        )
        for done in range(1, settings.epochs + 1):
            self.adam.rate = settings.learning_rate * cooled(
                done, settings.epochs, settings.cooling
            )
            learnt = self._epoch(*training)
            error = _rmse(self.built, validation) if len(validation[1]) else learnt
            if not state.add(done, learnt, error):
                break
            if (watch and watch(done, self.unit * error)) or state.idle >= settings.patience:
                break
        state.keep_best()
        return state

    def _epoch(self, x: Tensor, y: Tensor) -> float:
        """One pass over all windows in a new order; the RMSE that its steps met."""
        total = torch.zeros(())
        for rows in torch.randperm(len(y), generator=self.generator).split(self.settings.batch):
            with autocast(self.precision):
                found = self.built(x[rows])
            loss = torch.nn.functional.mse_loss(found.float(), y[rows])
            self.adam.step(loss)
            total += loss.detach() * len(rows)
        return float(torch.sqrt(total / len(y)))


def _chosen(scaled: Samples, rows: Bools) -> Samples:
    x, y = (part[torch.from_numpy(rows)] for part in scaled)
    return x, y


@torch.no_grad()
def _rmse(built: SequenceNetwork, part: Samples) -> float:
    """RMSE of scaled targets, in the network's own precision."""
    x, y = part
    found = torch.cat([built(piece) for piece in x.split(ROWS)])
    return float(torch.sqrt(torch.mean((found - y) ** 2)))
