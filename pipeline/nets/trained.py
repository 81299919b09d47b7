"""Trained network with its scaling: predictions from plain arrays, and a document to restore it.

Scaling belongs to the network: temperatures come in as rises above a reference [K], consequent
inputs in units of their own, the output leaves in that of what was learnt [µm].
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from pipeline.nets.ffnn import Network, network
from pipeline.nets.settings import (
    BackPropagationSettings,
    ClassicFuzzySettings,
    FuzzyFilteredSettings,
    NetworkSettings,
    TrainingSettings,
)
from pipeline.schema.arrays import Bools, Floats

KINDS: dict[str, type[NetworkSettings]] = {
    one.kind: one for one in (FuzzyFilteredSettings, ClassicFuzzySettings, BackPropagationSettings)
}
"""Kind of network by its name in files -> its settings."""
ROWS = 8192
"""Samples of one step of a prediction."""


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

    Raises
    ------
    ValueError
        When it has another number of dimensions, or a value that is not finite.
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
    """What is taken off and divided by, of inputs and output."""

    x_shift: Floats
    x_scale: Floats
    """Of the temperatures [K]: all the same for bands over the channels, which compare them; each
    its own for the sigmoid network; shape (N,)."""
    c_shift: Floats
    c_scale: Floats
    """Mean and standard deviation of the consequent inputs; shape (K,)."""
    y_shift: float
    y_scale: float
    """Mean and standard deviation of the output [µm]."""

    @staticmethod
    def of(kind: NetworkSettings, x: Floats, c: Floats, y: Floats) -> "Scaling":
        """Scaling by what is learnt from: x to 0..1, or each to -1..1; c and y to mean 0, std 1."""
        low, high = x.min(axis=0), x.max(axis=0)
        if isinstance(kind, BackPropagationSettings):
            shift, scale = 0.5 * (low + high), 0.5 * (high - low)
        else:
            shift = np.full(x.shape[1], low.min())
            scale = np.full(x.shape[1], high.max() - low.min())
        return Scaling(
            x_shift=shift, x_scale=_divisor(scale, x), c_shift=c.mean(axis=0),
            c_scale=_divisor(c.std(axis=0), c), y_shift=float(y.mean()),
            y_scale=float(_divisor(np.array(y.std()), y)),
        )  # fmt: skip

    def inputs(self, x: Floats, c: Floats) -> tuple[Tensor, Tensor]:
        """Scaled x and c."""
        return (
            torch.from_numpy((x - self.x_shift) / self.x_scale),
            torch.from_numpy((c - self.c_shift) / self.c_scale),
        )

    def output(self, y: Floats) -> Tensor:
        """Scaled y."""
        return torch.from_numpy((y - self.y_shift) / self.y_scale)


def _divisor(scale: Floats, values: Floats) -> Floats:
    """``scale``, or 1 where the values do not vary by more than rounding."""
    varies: Bools = scale > 1e-12 * np.maximum(np.abs(values).max(axis=0), 1e-300)
    return np.where(varies, scale, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Trained:
    """A trained network."""

    kind: NetworkSettings
    """Kind of the network."""
    method: str
    """By which it was trained."""
    settings: TrainingSettings
    """Budget and the like."""
    scaling: Scaling
    """Of inputs and output."""
    network: Network
    """In its best state."""
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

        Parameters
        ----------
        x : array_like, shape (T, N)
            Temperatures above the reference [K].
        c : array_like, shape (T, K)
            Consequent inputs.

        Raises
        ------
        ValueError
            When shapes do not fit the network, or a value is not finite.
        """
        many = len(self.scaling.x_shift), len(self.scaling.c_shift)
        x, c = samples("x", x, 2), samples("c", c, 2)
        if x.shape[1] != many[0] or c.shape[1] != many[1] or len(x) != len(c):
            raise ValueError(
                f"x and c have shapes {x.shape} and {c.shape}: this network takes {many[0]} "
                f"temperatures and {many[1]} consequent inputs of each sample"
            )
        found = np.empty(len(x))
        with reproducible(), torch.no_grad():
            for k in range(0, len(x), ROWS):
                scaled = self.network(*self.scaling.inputs(x[k : k + ROWS], c[k : k + ROWS]))
                found[k : k + ROWS] = scaled.numpy()
        return found * self.scaling.y_scale + self.scaling.y_shift

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them."""
        state = {name: values.tolist() for name, values in self.network.state_dict().items()}
        scaling = {f.name: _plain(getattr(self.scaling, f.name)) for f in fields(Scaling)}
        return {
            "kind": self.kind.kind,
            "network": asdict(self.kind),  # type: ignore[call-overload]
            "method": self.method,
            "training": asdict(self.settings),
            "scaling": scaling,
            "state": state,
            "history": self.history.tolist(),
            "validation_groups": list(self.validation_groups),
        }


def restore(document: Mapping[str, Any]) -> Trained:
    """The trained network of a :meth:`Trained.document`; it predicts the same bits.

    Raises
    ------
    ValueError
        When the document lacks something, or its numbers do not fit the network that it names.
    """
    try:
        kind = KINDS[document["kind"]](**document["network"])
        scaling = Scaling(**{k: _array(v) for k, v in document["scaling"].items()})
        many = len(scaling.x_shift), len(scaling.c_shift)
        built = network(kind, *many, torch.Generator())
        state = {k: torch.tensor(v, dtype=torch.float64) for k, v in document["state"].items()}
        built.load_state_dict(state)
        return Trained(
            kind=kind, method=document["method"],
            settings=TrainingSettings(**document["training"]), scaling=scaling, network=built,
            history=np.array(document["history"], dtype=np.float64).reshape(-1, 3),
            validation_groups=tuple(document["validation_groups"]),
        )  # fmt: skip
    except KeyError as error:
        raise ValueError(f"the document of a network has no or no known {error}") from error
    except (TypeError, RuntimeError) as error:
        said = " ".join(str(error).split())
        raise ValueError(f"the document of a network does not fit together: {said}") from error


def _plain(value: Floats | float) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def _array(value: Any) -> Any:
    return np.array(value, dtype=np.float64) if isinstance(value, list) else float(value)
