"""Trained network on windows with its scaling: predictions from arrays, and a document of it.

Predictions are made in float32 (the linear model's in float64) on one thread, whatever the
precision of the training was.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from pipeline.nets.sequence import CnnLstmAttention, SequenceNetwork, sequence_network
from pipeline.nets.sequence_settings import (
    KINDS,
    CnnLstmAttentionSettings,
    SequenceSettings,
    WindowTraining,
)
from pipeline.nets.stored import (
    Scaling,
    document_of,
    fill,
    history_of,
    reproducible,
    restored_scaling,
    samples,
    scaling_document,
    state_of,
)
from pipeline.nets.windows import WindowInput
from pipeline.schema.arrays import Floats

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
    x_scaling: Scaling
    y_scaling: Scaling
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
        x = samples("windows", windows, 3)
        wanted = self.length, len(self.x_scaling.shift)
        if x.shape[1:] != wanted:
            raise ValueError(
                f"windows have shape {x.shape}: this network takes {wanted[0]} rows of {wanted[1]} "
                "channels each"
            )
        dtype = self.network.dense.weight.dtype
        with reproducible(), torch.no_grad():
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
            "scaling": scaling_document(x=self.x_scaling, y=self.y_scaling),
            "state": state_of(self.network),
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }


def restore_sequence(document: Mapping[str, Any]) -> TrainedSequence:
    """The network of a :meth:`TrainedSequence.document`; it predicts the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit the network that
    it names.
    """
    with document_of("a network"):
        kind = KINDS[document["kind"]](**document["network"])
        x, y = (restored_scaling(document["scaling"], part) for part in "xy")
        built = sequence_network(kind, document["length"], len(x.shift), torch.Generator())
        fill(built, document["state"])
        return TrainedSequence(
            kind=kind, settings=WindowTraining(**document["training"]),
            precision=document["precision"], length=document["length"],
            inputs=tuple(WindowInput(**one) for one in document["inputs"]),
            leaks=tuple(document["leaks"]), x_scaling=x, y_scaling=y, network=built,
            history=history_of(document),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip
