"""Trained network with its scaling: predictions from plain arrays, and a document to restore it.

Temperatures are rises above a reference [K], the output is in the target's unit [µm].
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from pipeline.nets.ffnn import Network, network
from pipeline.nets.settings import KINDS, NetworkSettings, TrainingSettings
from pipeline.nets.stored import (
    Scaling,
    document_of,
    fill,
    history_of,
    reproducible,
    restored_scaling,
    samples,
    scaling_document,
)
from pipeline.schema.arrays import Floats

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
    x_scaling: Scaling
    """Scaling of the temperatures [K]: all the same for bands over the channels, which compare
    them; each its own for the sigmoid network."""
    c_scaling: Scaling
    y_scaling: Scaling
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
        x, c = samples("x", x, 2), samples("c", c, 2)
        if x.shape[1] != many[0] or c.shape[1] != many[1] or len(x) != len(c):
            raise ValueError(
                f"x and c have shapes {x.shape} and {c.shape}: this network takes {many[0]} "
                f"temperatures and {many[1]} consequent inputs of each sample"
            )
        found = np.empty(len(x))
        with reproducible(), torch.no_grad():
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
            "scaling": scaling_document(x=self.x_scaling, c=self.c_scaling, y=self.y_scaling),
            "state": state,
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }


def restore(document: Mapping[str, Any]) -> Trained:
    """The trained network of a :meth:`Trained.document`; it predicts the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit the network that
    it names.
    """
    with document_of("a network"):
        kind = KINDS[document["kind"]](**document["network"])
        x, c, y = (restored_scaling(document["scaling"], part) for part in "xcy")
        built = network(kind, len(x.shift), len(c.shift), torch.Generator())
        fill(built, document["state"])
        return Trained(
            kind=kind, method=document["method"],
            settings=TrainingSettings(**document["training"]), x_scaling=x, c_scaling=c,
            y_scaling=y, network=built, history=history_of(document),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip
