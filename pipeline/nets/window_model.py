"""Trained network on windows with its scaling: predictions from arrays, and a document of it.

Scaling belongs to the network: windows come in and outputs leave in the units that were learnt
from.  Predictions are made in float32 (the linear model's in float64) on one thread, whatever the
precision of the training was.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from pipeline.nets.sequence import CnnLstmAttention, SequenceNetwork, sequence_network
from pipeline.nets.sequence_settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    ResNetSettings,
    SequenceSettings,
    TcnSettings,
    WindowTraining,
)
from pipeline.nets.trained import reproducible, samples
from pipeline.nets.windows import WindowInput
from pipeline.schema.arrays import Floats, packed, unpacked

KINDS: dict[str, type[SequenceSettings]] = {
    one.kind: one
    for one in (
        CnnLstmAttentionSettings,
        CnnLstmSettings,
        LstmSettings,
        TcnSettings,
        ResNetSettings,
        ArxSettings,
    )
}
"""Kind of network by its name in files -> its settings."""
ROWS = 1024
"""Windows of one step of a prediction."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowScaling:
    """What is taken off and divided by, of inputs and outputs."""

    x_shift: Floats
    x_scale: Floats
    """Mean and standard deviation of each channel; shape (C,)."""
    y_shift: float
    y_scale: float
    """Of the target."""

    @staticmethod
    def of(x: Floats, y: Floats) -> "WindowScaling":
        """Scaling of windows, shape (B, T, C), and targets by what is learnt from."""
        x_scale, y_scale = x.std(axis=(0, 1)), float(y.std())
        still = x_scale <= 1e-12 * np.maximum(np.abs(x).max(axis=(0, 1)), 1e-300)
        same = y_scale <= 1e-12 * max(float(np.abs(y).max()), 1e-300)
        return WindowScaling(
            x_shift=x.mean(axis=(0, 1)), x_scale=np.where(still, 1.0, x_scale),
            y_shift=float(y.mean()), y_scale=1.0 if same else y_scale,
        )  # fmt: skip

    def inputs(self, x: Floats, kind: torch.dtype) -> Tensor:
        """Scaled windows."""
        return torch.from_numpy((x - self.x_shift) / self.x_scale).to(kind)

    def output(self, y: Floats, kind: torch.dtype) -> Tensor:
        """Scaled target."""
        return torch.from_numpy((y - self.y_shift) / self.y_scale).to(kind)


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
    scaling: WindowScaling
    """Of inputs and output."""
    network: SequenceNetwork
    """In its best state."""
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
        """Target of windows, shape (B,) or (B, H), in its unit.

        Parameters
        ----------
        windows : array_like, shape (B, T, C)
            In the units that were learnt from, the newest row last.

        Raises
        ------
        ValueError
            When the shape does not fit the network, or a value is not finite.
        """
        parts = [self.network(x).numpy() for x in self._steps(windows)]
        shape = (0,) if self.network.outputs is None else (0, self.network.outputs)
        found = np.concatenate(parts) if parts else np.empty(shape)
        return found.astype(np.float64) * self.scaling.y_scale + self.scaling.y_shift

    def features(self, windows: ArrayLike) -> Floats:
        """What the dense layer sees of windows, shape (B, F); raises as :meth:`predict`."""
        parts = [self.network.features(x).numpy() for x in self._steps(windows)]
        empty = np.empty((0, self.network.dense.in_features))
        return (np.concatenate(parts) if parts else empty).astype(np.float64)

    def attention(self, windows: ArrayLike) -> Floats:
        """Weight of each row of the states, shape (B, T // pool); those of a window add up to 1.

        Raises
        ------
        ValueError
            As :meth:`predict`, and when the network has no attention.
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
        x = samples("windows", windows, 3)
        wanted = self.length, len(self.scaling.x_shift)
        if x.shape[1:] != wanted:
            raise ValueError(
                f"windows have shape {x.shape}: this network takes {wanted[0]} rows of {wanted[1]} "
                "channels each"
            )
        dtype = self.network.dense.weight.dtype
        with reproducible(), torch.no_grad():
            for k in range(0, len(x), ROWS):
                yield self.scaling.inputs(x[k : k + ROWS], dtype)

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them; weights in base64."""
        scaling = self.scaling
        return {
            "kind": self.kind.kind,
            "network": asdict(self.kind),  # type: ignore[call-overload]
            "training": asdict(self.settings),
            "precision": self.precision,
            "length": self.length,
            "outputs": self.network.outputs,
            "inputs": [asdict(one) for one in self.inputs],
            "leaks": list(self.leaks),
            "scaling": {
                "x_shift": scaling.x_shift.tolist(), "x_scale": scaling.x_scale.tolist(),
                "y_shift": scaling.y_shift, "y_scale": scaling.y_scale,
            },
            "state": {k: packed(v.numpy()) for k, v in self.network.state_dict().items()},
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }  # fmt: skip


def restore_sequence(document: Mapping[str, Any]) -> TrainedSequence:
    """The network of a :meth:`TrainedSequence.document`; it predicts the same bits.

    Raises
    ------
    ValueError
        When the document lacks something, or its numbers do not fit the network that it names.
    """
    with document_of("a network"):
        kind = KINDS[document["kind"]](**document["network"])
        told = document["scaling"]
        scaling = WindowScaling(
            x_shift=np.array(told["x_shift"], dtype=np.float64),
            x_scale=np.array(told["x_scale"], dtype=np.float64),
            y_shift=float(told["y_shift"]), y_scale=float(told["y_scale"]),
        )  # fmt: skip
        built = sequence_network(
            kind, document["length"], len(scaling.x_shift), document["outputs"], torch.Generator()
        )
        fill(built, document["state"])
        return TrainedSequence(
            kind=kind, settings=WindowTraining(**document["training"]),
            precision=document["precision"], length=document["length"],
            inputs=tuple(WindowInput(**one) for one in document["inputs"]),
            leaks=tuple(document["leaks"]), scaling=scaling, network=built,
            history=np.array(document["history"], dtype=np.float64).reshape(-1, 3),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip


@contextmanager
def document_of(what: str) -> Iterator[None]:
    """Say what is wrong with the document that is read inside, in one sentence.

    Raises
    ------
    ValueError
        When the document lacks something, or its parts do not fit together.
    """
    try:
        yield
    except KeyError as error:
        raise ValueError(f"the document of {what} has no or no known {error}") from error
    except (TypeError, RuntimeError) as error:
        said = " ".join(str(error).split())
        raise ValueError(f"the document of {what} does not fit together: {said}") from error


def fill(built: nn.Module, stored: Mapping[str, Any]) -> None:
    """Put stored weights into a network."""
    built.load_state_dict({k: torch.from_numpy(unpacked(v)) for k, v in stored.items()})
