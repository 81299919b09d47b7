"""One training loop for all networks on windows: Adam, early stopping, checkpoints.

Whole recordings are kept for early stopping, and the state with the least error on them is the
result.  A training that was interrupted goes on from its checkpoint to the same bits.  The linear
model is solved at once from the same windows.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from hashlib import sha256
from math import inf, isfinite
from pathlib import Path
from time import perf_counter

import numpy as np
import torch
from torch import Tensor

from pipeline.nets.adam import Adam
from pipeline.nets.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from pipeline.nets.sequence import Arx, SequenceNetwork, sequence_network
from pipeline.nets.sequence_settings import SequenceSettings, WindowTraining
from pipeline.nets.settings import TrainingSettings
from pipeline.nets.trained import reproducible, samples
from pipeline.nets.training import validation_groups
from pipeline.nets.window_model import ROWS, TrainedSequence, WindowScaling
from pipeline.nets.windows import Windows
from pipeline.schema.arrays import Bools

Samples = tuple[Tensor, Tensor]
"""Scaled windows and targets."""


class Diverged(ValueError):  # noqa: N818
    """A training whose first epoch gave no finite error."""


@dataclass(frozen=True, kw_only=True)
class Epoch:
    """What a training says after each epoch."""

    number: int
    of: int
    """Epochs that are done, and that there are at most."""
    training: float
    validation: float
    """RMSE, as in the history, in the unit of the target."""
    seconds: float
    left_s: float
    """Time of this call so far [s], and at most to come, at the mean time of its epochs."""


Watch = Callable[[Epoch], bool | None]
"""Called after each epoch; true ends the training."""


def train_windows(
    kind: SequenceSettings, windows: Windows, *, settings: WindowTraining,
    checkpoint: Path | None = None, watch: Watch | None = None, device: str = "cpu",
) -> TrainedSequence:  # fmt: skip
    """Network that is trained on windows, in its best state.

    Parameters
    ----------
    kind : SequenceSettings
        Settings of the network, which say which one it is.
    windows : Windows
        To learn from and to stop by; their groups are whole recordings.
    settings : WindowTraining
        Budget.
    checkpoint : Path or None
        File to go on from where it is there, written after each epoch.  One that was ended by its
        patience or by ``watch`` goes on too, when more epochs are asked for than it has.
    watch : callable or None
        Called after each epoch.
    device : str
        Of torch.  The same bits come out of every run on the CPU; a GPU's may differ.

    Raises
    ------
    ValueError
        When windows are empty, not finite or of shapes that do not fit, when there is no recording
        to learn from beside those for validation, when the first epoch diverges
        (:class:`Diverged`), or when the checkpoint is of another training.
    """
    x, y = samples("x", windows.x, 3), samples("y", windows.y, np.ndim(windows.y))
    labels = [str(one) for one in windows.group]
    if not len(x) == len(y) == len(labels) or y.ndim not in (1, 2):
        raise ValueError(
            f"x, y and group have shapes {x.shape}, {y.shape} and ({len(labels)},): give as many "
            "windows of each, y with one or two dimensions"
        )
    if x.size == 0 or y.size == 0:
        raise ValueError(
            f"there is nothing to learn from: x and y have shapes {x.shape} and {y.shape}"
        )
    kept = _kept(labels, settings)
    held = np.isin(labels, kept)
    scaling = WindowScaling.of(x[~held], y[~held])
    outputs = None if y.ndim == 1 else y.shape[1]
    precision = usable_precision(settings.precision, device)
    with reproducible():
        generator = torch.Generator().manual_seed(settings.seed)
        built = sequence_network(kind, x.shape[1], x.shape[2], outputs, generator)
        dtype = built.dense.weight.dtype
        scaled = scaling.inputs(x, dtype), scaling.output(y, dtype)
        training, validation = (_chosen(scaled, rows, device) for rows in (~held, held))
        if isinstance(built, Arx):
            precision = "float64"
            built.solve(*training)
            least = _rmse(built, training)
            history = [(1.0, least, _rmse(built, validation) if kept else least)]
        else:
            loop = _Loop(built.to(device), settings, precision, generator, scaling.y_scale)
            told = (kind, windows.inputs, scaled, held, precision, device)
            loop.run(training, validation, watch, checkpoint, _fingerprint(settings, *told))
            history = loop.at.history
        built.to("cpu")
    found = np.array(history)
    found[:, 1:] *= scaling.y_scale
    return TrainedSequence(
        kind=kind, settings=settings, precision=precision, length=x.shape[1],
        inputs=windows.inputs, leaks=windows.leaks, scaling=scaling, network=built.requires_grad_(),
        history=found, validation_groups=kept,
    )  # fmt: skip


def usable_precision(precision: str, device: str = "cpu") -> str:
    """``precision``, or float32 where the device has no products in bfloat16.

    A processor that torch is told to use like an older one, as stages do, has none.
    """
    if precision == "float32":
        return precision
    if device.startswith("cuda"):
        there = torch.cuda.is_bf16_supported(including_emulation=False)
    else:
        told = torch.cpu.get_capabilities()
        older = torch.backends.cpu.get_cpu_capability() in ("DEFAULT", "AVX2")
        own = bool(told.get("avx512_bf16") or told.get("amx_bf16") or told.get("bf16"))
        there = own and not older
    return precision if there else "float32"


def cooled(done: int, many: int, cooling: float) -> float:
    """Share of the learning rate at one of many steps: it falls to zero over the last ones."""
    return min((1.0 - (done - 1) / many) / cooling, 1.0) if cooling else 1.0


def autocast(precision: str, device: str) -> AbstractContextManager[object]:
    """Within which products are of that precision."""
    if precision == "float32":
        return nullcontext()
    return torch.autocast(device.partition(":")[0], dtype=torch.bfloat16, cache_enabled=False)


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
    """Adam over batches of windows, with the best state so far."""

    def __init__(
        self, built: SequenceNetwork, settings: WindowTraining, precision: str,
        generator: torch.Generator, unit: float,
    ) -> None:  # fmt: skip
        self.built, self.settings, self.precision = built, settings, precision
        self.generator, self.unit = generator, unit
        names, weights = zip(*built.named_parameters(), strict=True)
        l2 = [0.0 if "bias" in name else settings.l2 for name in names]
        self.adam = Adam(weights, settings.learning_rate, l2=l2)
        self.at = Checkpoint(history=[], best=inf, best_at=0, best_state=self._state())

    def run(
        self, training: Samples, validation: Samples, watch: Watch | None,
        checkpoint: Path | None, fingerprint: str,
    ) -> None:  # fmt: skip
        """Train, and give the network its best state."""
        at = self.at
        if checkpoint is not None and checkpoint.exists():
            at = self.at = read_checkpoint(checkpoint, fingerprint, self.built, self.adam.state)
            self.generator.set_state(at.generator)
        started, first = perf_counter(), len(at.history)
        for done in range(first + 1, self.settings.epochs + 1):
            if at.history and done - 1 - at.best_at >= self.settings.patience:
                break
            self.adam.rate = self.settings.learning_rate * cooled(
                done, self.settings.epochs, self.settings.cooling
            )
            learnt = self._epoch(*training)
            error = _rmse(self.built, validation) if len(validation[1]) else learnt
            if not (isfinite(learnt) and isfinite(error)):
                if done == 1:
                    raise Diverged(
                        "training diverged in its first epoch: lower window_training.learning_rate "
                        f"from {self.settings.learning_rate:g}"
                    )
                break  # the best state is an earlier one
            at.history.append((float(done), learnt, error))
            if error < at.best:
                at.best, at.best_at, at.best_state = error, done, self._state()
            if checkpoint is not None:
                at.generator = self.generator.get_state()
                write_checkpoint(checkpoint, fingerprint, at, self.built, self.adam.state)
            if watch and watch(self._told(done, first, perf_counter() - started)):
                break
        self.built.load_state_dict(at.best_state)

    def _epoch(self, x: Tensor, y: Tensor) -> float:
        """One pass over all windows in a new order; the RMSE that its steps met."""
        device = x.device
        total = torch.zeros((), device=device)
        for rows in torch.randperm(len(y), generator=self.generator).split(self.settings.batch):
            rows = rows.to(device)
            with autocast(self.precision, device.type):
                found = self.built(x[rows])
            loss = torch.nn.functional.mse_loss(found.float(), y[rows])
            self.adam.step(loss)
            total += loss.detach() * len(rows)
        return float(torch.sqrt(total / len(y)))

    def _state(self) -> dict[str, Tensor]:
        return {k: v.detach().clone() for k, v in self.built.state_dict().items()}

    def _told(self, done: int, first: int, seconds: float) -> Epoch:
        _, learnt, error = self.at.history[-1]
        left = seconds / (done - first) * (self.settings.epochs - done)
        return Epoch(
            number=done, of=self.settings.epochs, training=self.unit * learnt,
            validation=self.unit * error, seconds=seconds, left_s=left,
        )  # fmt: skip


def _chosen(scaled: Samples, rows: Bools, device: str) -> Samples:
    x, y = (part[torch.from_numpy(rows)].to(device) for part in scaled)
    return x, y


@torch.no_grad()
def _rmse(built: SequenceNetwork, part: Samples) -> float:
    """Of scaled targets, in the network's own precision."""
    x, y = part
    found = torch.cat([built(piece) for piece in x.split(ROWS)])
    return float(torch.sqrt(torch.mean((found - y) ** 2)))


def _fingerprint(settings: WindowTraining, *told: object) -> str:
    """SHA-256 of what decides on the bits of a training; the number of epochs does not."""
    digest = sha256(torch.__version__.encode())
    same = {k: v for k, v in vars(settings).items() if k not in ("epochs", "patience")}
    for one in (same, *told):
        parts = one if isinstance(one, tuple) else (one,)
        for part in parts:
            if isinstance(part, Tensor):
                part = part.numpy()
            if isinstance(part, np.ndarray):
                digest.update(f"{part.shape}{part.dtype}".encode())
                digest.update(np.ascontiguousarray(part).tobytes())
            else:
                digest.update(repr(part).encode())
    return digest.hexdigest()
