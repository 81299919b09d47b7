"""Scaling, stored form and reproducible execution of all trained networks.

A document holds plain lists, numbers and words, as JSON does, and weights in base64; no pickle.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor, nn

from pipeline.schema.arrays import Floats, packed, unpacked


@contextmanager
def reproducible() -> Iterator[None]:
    """One thread and deterministic algorithms of torch; afterwards as before."""
    threads, before = torch.get_num_threads(), torch.get_deterministic_debug_mode()
    memory: Any = torch.utils.deterministic
    filled = memory.fill_uninitialized_memory
    torch.set_num_threads(1)
    memory.fill_uninitialized_memory = False  # each operation here writes all of its result
    # the same switch as use_deterministic_algorithms, which imports a compiler beside it
    torch.set_deterministic_debug_mode("error")
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_deterministic_debug_mode(before)
        memory.fill_uninitialized_memory = filled


def samples(name: str, values: ArrayLike, dimensions: int) -> Floats:
    """``values`` as an array of that many dimensions.

    Raises ValueError when it has another number of dimensions, or a value that is not finite.
    """
    array = np.array(values, dtype=np.float64)
    if array.ndim != dimensions:
        raise ValueError(f"{name} has shape {array.shape}: give it {dimensions} dimension(s)")
    wrong = ~np.isfinite(array)
    if wrong.any():
        first = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise ValueError(
            f"{name} has {int(wrong.sum())} values that are not finite, the first at {first}: "
            "fill them, or leave these samples out"
        )
    return array


@dataclass(frozen=True, kw_only=True, eq=False)
class Scaling:
    """Shift and scale of K quantities or of one."""

    shift: Floats
    scale: Floats
    """Shift and scale in the units of the quantities; shape (K,) or ()."""

    @staticmethod
    def of(shift: ArrayLike, scale: ArrayLike, values: Floats) -> "Scaling":
        """Scaling of values (..., K), or (...); by 1 where they vary by no more than rounding."""
        shift, scale = np.asarray(shift, np.float64), np.asarray(scale, np.float64)
        largest = np.abs(values).max(axis=tuple(range(values.ndim - shift.ndim)))
        varies = scale > 1e-12 * np.maximum(largest, 1e-300)
        return Scaling(shift=shift, scale=np.where(varies, scale, 1.0))

    @staticmethod
    def standard(values: Floats, axis: int | tuple[int, ...] | None = None) -> "Scaling":
        """Scaling of values to mean 0 and standard deviation 1 over some axes, all by default."""
        return Scaling.of(values.mean(axis=axis), values.std(axis=axis), values)

    def scaled(self, values: Floats, kind: torch.dtype = torch.float64) -> Tensor:
        """Scaled values."""
        return torch.from_numpy((values - self.shift) / self.scale).to(kind)

    def restored(self, scaled: Floats) -> Floats:
        """Values in their units."""
        return scaled * self.scale + self.shift


def scaling_document(**parts: Scaling) -> dict[str, Any]:
    """Shift and scale of each part, as ``<part>_shift`` and ``<part>_scale``."""
    return {
        f"{name}_{what}": getattr(one, what).tolist()
        for name, one in parts.items()
        for what in ("shift", "scale")
    }


def restored_scaling(document: Mapping[str, Any], part: str) -> Scaling:
    """Scaling of a part of a :func:`scaling_document`."""
    shift, scale = (np.array(document[f"{part}_{what}"], float) for what in ("shift", "scale"))
    return Scaling(shift=shift, scale=scale)


@contextmanager
def document_of(what: str) -> Iterator[None]:
    """Say what is wrong with the document that is read inside, in one sentence.

    Raises ValueError when the document lacks something, or its parts do not fit together.
    """
    try:
        yield
    except KeyError as error:
        raise ValueError(f"the document of {what} has no or no known {error}") from error
    except (TypeError, RuntimeError) as error:
        said = " ".join(str(error).split())
        raise ValueError(f"the document of {what} does not fit together: {said}") from error


def state_of(built: nn.Module) -> dict[str, Any]:
    """Weights of a network, packed."""
    return {name: packed(values.numpy()) for name, values in built.state_dict().items()}


def fill(built: nn.Module, stored: Mapping[str, Any]) -> None:
    """Put stored weights into a network, packed ones or lists of float64."""
    built.load_state_dict({
        name: torch.from_numpy(unpacked(one)) if isinstance(one, Mapping)
        else torch.tensor(one, dtype=torch.float64)
        for name, one in stored.items()
    })  # fmt: skip


def history_of(document: Mapping[str, Any]) -> Floats:
    """History of a document, shape (H, 3)."""
    return np.array(document["history"], dtype=np.float64).reshape(-1, 3)
