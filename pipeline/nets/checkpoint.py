"""Checkpoints of a training on windows: what goes on from one ends in the same bits.

A file holds the network, its best state so far, Adam's moments, the random numbers and the history,
as arrays and JSON in numpy's archive; no pickle is written or read.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import torch
from torch import Tensor, nn

from pipeline.schema.store import write_bytes


@dataclass(kw_only=True)
class Checkpoint:
    """Where a training stands, beside the network and Adam."""

    history: list[tuple[float, float, float]]
    """Epochs up to then [1], RMSE of the scaled training and validation windows [1]."""
    best: float
    best_at: int
    """Least of the latter, and its epoch."""
    best_state: dict[str, Tensor]
    """The network's then."""
    generator: Tensor = field(default_factory=lambda: torch.Generator().get_state())
    """State of the random numbers."""


def write_checkpoint(
    path: Path, fingerprint: str, at: Checkpoint, built: nn.Module, adam: Mapping[str, Tensor]
) -> None:
    """Store where a training stands; the file is whole at every time."""
    told = {
        "fingerprint": fingerprint, "history": at.history, "best": at.best, "best_at": at.best_at,
    }  # fmt: skip
    arrays = {
        "told": np.frombuffer(json.dumps(told).encode(), dtype=np.uint8),
        "generator": at.generator.numpy(),
        **{f"network/{k}": _array(v) for k, v in built.state_dict().items()},
        **{f"best/{k}": _array(v) for k, v in at.best_state.items()},
        **{f"adam/{k}": _array(v) for k, v in adam.items()},
    }
    data = BytesIO()
    np.savez(data, **arrays)  # type: ignore[arg-type]
    write_bytes(data.getvalue(), path)


def read_checkpoint(
    path: Path, fingerprint: str, built: nn.Module, adam: Mapping[str, Tensor]
) -> Checkpoint:
    """Where a training stood; its network and Adam are brought there.

    Parameters
    ----------
    path : Path
        Of the file.
    fingerprint : str
        Of the training that is to go on.
    built : Module
        Its network.
    adam : mapping of str to Tensor
        State of what moves the network, which is filled.

    Raises
    ------
    ValueError
        When the file is broken, or of another training.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays: Mapping[str, Any] = {name: archive[name] for name in archive.files}
        told = json.loads(arrays["told"].tobytes())
        theirs, history = told["fingerprint"], told["history"]
        at = Checkpoint(
            history=[(float(k), float(a), float(b)) for k, a, b in history], best=told["best"],
            best_at=told["best_at"], best_state=_below("best/", arrays),
            generator=torch.from_numpy(arrays["generator"]),
        )  # fmt: skip
    except (
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        EOFError,
        OSError,
        BadZipFile,
    ) as error:
        raise ValueError(f"checkpoint {path} cannot be read ({error}): remove it") from error
    if theirs != fingerprint:
        raise ValueError(
            f"checkpoint {path} is of another training (other windows, settings, seed or version "
            "of torch): remove it, or give another path"
        )
    built.load_state_dict(_below("network/", arrays))
    for name, values in _below("adam/", arrays).items():
        adam[name].copy_(values)
    return at


def _array(values: Tensor) -> "np.ndarray[Any, Any]":
    return values.detach().cpu().numpy()


def _below(prefix: str, arrays: Mapping[str, Any]) -> dict[str, Tensor]:
    return {
        name.removeprefix(prefix): torch.from_numpy(values)
        for name, values in arrays.items()
        if name.startswith(prefix)
    }
