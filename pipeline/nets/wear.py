"""Judge of tool wear from windows of signals: a residual network with its scaling and inputs.

Windows have shape (N, C, L), in the units of the recordings.  Known conditions enter as further
channels that are constant over the window.  The output is flank wear [um], or the share of worn
tools where wear is a class (least squares on 0 and 1 estimate it).  Whole tools are kept for early
stopping.

    judge = train_judge(values, wear, tool, scaling=(shift, scale), wear_unit="um",
                        conditions={"feed": feed}, training=WindowTraining(epochs=40))
    judge.predict(values, {"feed": feed})             # (N,) in judge.wear_unit
    write_json(judge.document(), path); restore_judge(json.loads(path.read_text()))

Sources: DCGAN2019 (a ResNet as the judge of generated signals); He, Zhang, Ren and Sun 2016.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.nets.settings import ResNetSettings, WindowTraining
from pipeline.nets.stored import document_of
from pipeline.nets.window_training import TrainedSequence, restore_sequence, train_windows
from pipeline.nets.windows import Windows
from pipeline.schema.arrays import Floats

PROBABILITY = "1"
"""Unit of wear that is a class."""
CLIP = 20.0
"""Greatest magnitude of a scaled sample [1]: a glitch counts no more than that."""

Scaling = tuple[Sequence[float], Sequence[float]]
"""Shift and scale of each of C channels."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WearJudge:
    """A trained residual network that gives wear of windows."""

    trained: TrainedSequence
    """Network on scaled channels and conditions."""
    shift: tuple[float, ...]
    scale: tuple[float, ...]
    """Scaling of the C channels, in their units."""
    conditions: tuple[str, ...]
    """Known numbers that it takes beside the window."""
    condition_shift: tuple[float, ...]
    condition_scale: tuple[float, ...]
    """Middle and half range of each, in training."""
    wear_unit: str
    """``"um"``, or ``"1"`` where wear is a class."""

    @property
    def length(self) -> int:
        """Samples L of a window [1]."""
        return self.trained.length

    def predict(
        self, values: ArrayLike, conditions: Mapping[str, ArrayLike] | None = None
    ) -> Floats:
        """Wear of windows in ``wear_unit``, shape (N,); a class from 0 to 1.

        ``values`` (N, C, L) in the units of the recordings; ``conditions`` those that it was
        trained with, (N,) each.  Raises ValueError when shapes do not fit, a condition is missing,
        or a value is not finite.
        """
        found = self.trained.predict(_inputs(
            values, conditions or {}, (self.shift, self.scale), self.conditions,
            (self.condition_shift, self.condition_scale),
        ))  # fmt: skip
        return np.clip(found, 0.0, 1.0) if self.wear_unit == PROBABILITY else found

    def document(self) -> dict[str, Any]:
        """All of it in plain lists, numbers and words, as JSON holds them."""
        return {
            "shift": list(self.shift), "scale": list(self.scale),
            "conditions": list(self.conditions), "condition_shift": list(self.condition_shift),
            "condition_scale": list(self.condition_scale), "wear_unit": self.wear_unit,
            "trained": self.trained.document(),
        }  # fmt: skip


def restore_judge(document: Mapping[str, Any]) -> WearJudge:
    """The judge of a :meth:`WearJudge.document`; it predicts the same bits.

    Raises ValueError when the document lacks something, or its numbers do not fit together.
    """
    with document_of("a judge of wear"):
        return WearJudge(
            trained=restore_sequence(document["trained"]),
            shift=tuple(map(float, document["shift"])), scale=tuple(map(float, document["scale"])),
            conditions=tuple(document["conditions"]),
            condition_shift=tuple(map(float, document["condition_shift"])),
            condition_scale=tuple(map(float, document["condition_scale"])),
            wear_unit=str(document["wear_unit"]),
        )  # fmt: skip


def train_judge(
    values: ArrayLike, wear: ArrayLike, tool: ArrayLike, *, scaling: Scaling, wear_unit: str,
    conditions: Mapping[str, ArrayLike] | None = None, network: ResNetSettings | None = None,
    training: WindowTraining | None = None,
) -> WearJudge:  # fmt: skip
    """Train a judge on windows of known wear.

    ``values`` (N, C, L) in the units of the recordings, ``wear`` (N,) in ``wear_unit`` (``"um"``,
    or ``"1"`` for 0 and 1); whole tools of ``tool`` (N,) are kept for early stopping; ``scaling``
    is shift and scale of the C channels, of training windows; ``conditions`` are known numbers by
    name, (N,) each.  Raises ValueError when shapes do not fit, a value is not finite, or there are
    fewer than two tools to learn from and to stop by.
    """
    given = dict(conditions or {})
    middle, half = [], []
    for one in given.values():
        numbers = np.asarray(one, float)
        low, high = (float(numbers.min()), float(numbers.max())) if numbers.size else (0.0, 0.0)
        middle.append(0.5 * (low + high))
        half.append(0.5 * (high - low) or 1.0)
    names = tuple(given)
    x = _inputs(values, given, scaling, names, (middle, half))
    groups: NDArray[np.str_] = np.asarray(tool, str)
    trained = train_windows(
        network or ResNetSettings(), Windows(x=x, y=np.asarray(wear, float), group=groups),
        settings=training or WindowTraining(),
    )  # fmt: skip
    return WearJudge(
        trained=trained, shift=tuple(map(float, scaling[0])), scale=tuple(map(float, scaling[1])),
        conditions=names, condition_shift=tuple(middle), condition_scale=tuple(half),
        wear_unit=wear_unit,
    )  # fmt: skip


def _inputs(
    values: ArrayLike, conditions: Mapping[str, ArrayLike], scaling: Scaling,
    names: Sequence[str], ranges: Scaling,
) -> Floats:  # fmt: skip
    """Scaled channels and conditions, shape (N, L, C + K)."""
    x = np.asarray(values, np.float64)
    if x.ndim != 3 or x.shape[1] != len(scaling[0]):
        raise ValueError(
            f"windows have shape {x.shape}: this judge takes (N, {len(scaling[0])}, L), one row a "
            "channel"
        )
    shift, scale = (np.asarray(one, float)[:, None] for one in scaling)
    rows = [np.clip((x - shift) / scale, -CLIP, CLIP).transpose(0, 2, 1)]
    for name, middle, half in zip(names, *ranges, strict=True):
        if name not in conditions:
            raise ValueError(f"condition {name!r} of the windows is missing: give it")
        known = np.broadcast_to(np.asarray(conditions[name], float), x.shape[:1])
        scaled = (known - middle) / half
        rows.append(np.broadcast_to(scaled[:, None, None], (x.shape[0], x.shape[2], 1)))
    return np.concatenate(rows, axis=2)
