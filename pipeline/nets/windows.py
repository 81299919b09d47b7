"""Windows of recordings, with a guard against inputs that could not be known yet.

A window predicts the target at its last time t.  Inputs known before the motion (commands, states
of a model) reach up to t; a measurement only as far as it is older than the horizon, so that its
column ends at t less its age.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, inf, isfinite
from typing import Annotated, Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.ranges import Positive, Range, Ranged


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording(Ranged):
    """Signals of one run, sampled at even times."""

    name: str
    """Name of the recording, which is the group of its windows."""
    step_s: Positive
    """Time between samples [s]."""
    signals: Mapping[str, Floats]
    """Signals with as many samples; shape (N,)."""
    measured: frozenset[str] = frozenset()
    """Signals that are measured, or made of what is measured; they are not known before the motion,
    whatever an input declares."""

    def __post_init__(self) -> None:
        if not (isfinite(self.step_s) and self.step_s > 0):
            raise ValueError(f"step_s of recording {self.name} = {self.step_s} s must be positive")
        shapes = {name: np.shape(values) for name, values in self.signals.items()}
        if len(set(shapes.values())) > 1 or any(len(shape) != 1 for shape in shapes.values()):
            raise ValueError(
                f"signals of recording {self.name} have shapes {shapes}: give one dimension and as "
                "many samples of each"
            )


@dataclass(frozen=True, kw_only=True)
class WindowInput(Ranged, section="input"):
    """An input of windows, and since when it is known."""

    name: str
    """Name of the signal."""
    older_than_s: Annotated[float | None, Range(least=0.0, unit="s")] = None
    """A measurement that is used when it is at least this old [s]; None for what is known before
    the motion."""

    def rows(self, step_s: float) -> int:
        """Age in rows of ``step_s`` [s]."""
        return 0 if self.older_than_s is None else ceil(self.older_than_s / step_s * (1 - 1e-12))


@dataclass(frozen=True, eq=False)
class Joined:
    """Windows of several recordings as one array (B, T, C), copied only where rows are read."""

    parts: Sequence[Floats]
    """Parts of each recording: views of its table; shape (N, T, C)."""
    rows: Ints
    """Selected rows, counted over all parts; shape (B,)."""

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape (B, T, C)."""
        return (len(self.rows), *self.parts[0].shape[1:])

    def of(self, rows: Any) -> "Joined":
        """Some of the rows, not yet copied."""
        return Joined(self.parts, self.rows[rows])

    def __getitem__(self, key: Any) -> Floats:
        first, *others = key if isinstance(key, tuple) else (key,)
        rows, begin = self.rows[first], 0
        found = np.empty((len(rows), *self.parts[0].shape[1:]))
        for part in self.parts:
            mine = (begin <= rows) & (rows < begin + len(part))
            found[mine] = part[rows[mine] - begin]
            begin += len(part)
        return found[(slice(None), *others)]

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Floats:
        return self[:].astype(dtype or np.float64, copy=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class Windows:
    """Windows with what they predict."""

    x: Floats
    """Inputs, the newest row last; shape (B, T, C)."""
    y: Floats
    """Target; shape (B,)."""
    group: NDArray[np.str_]
    """Recording that each is of; shape (B,)."""
    at: Ints = field(default_factory=lambda: np.array(-1))
    """Sample of the recording whose target is predicted; -1 where not known; shape (B,)."""
    inputs: tuple[WindowInput, ...] = ()
    """Inputs of the C channels."""
    leaks: tuple[str, ...] = ()
    """Inputs that could not be known yet, where they were allowed; empty otherwise."""

    def of(self, *names: str) -> "Windows":
        """Those of the recordings ``names``."""
        rows = np.isin(self.group, names)
        at = np.broadcast_to(self.at, rows.shape)
        return Windows(
            x=self.x[rows], y=self.y[rows], group=self.group[rows], at=at[rows],
            inputs=self.inputs, leaks=self.leaks,
        )  # fmt: skip


def windows_of(
    recordings: Sequence[Recording], inputs: Sequence[WindowInput], target: str, length: int,
    horizon_s: float, *, allow_leaks: bool = False, joined: bool = False,
) -> Windows:  # fmt: skip
    """All windows of recordings.

    ``inputs`` are the channels in this order, ``length`` the rows T; a prediction comes
    ``horizon_s`` [s] before what it predicts, infinite for one before the motion, which no
    measurement may enter.  ``allow_leaks`` lets inputs in that could not be known yet and names
    them in ``leaks``, to show what a leak would seem to gain; ``joined`` inputs stay views, of
    which some are taken.  Raises ValueError when an input could not be known yet: a measurement
    younger than the horizon, a measurement or the target that is declared as known before the
    motion, or an input that holds the very values of the target.  Also when a signal is missing or
    not finite, two recordings have one name, or none is long enough for a window.
    """
    _check(recordings, inputs, target, length, horizon_s)
    leaks = []
    for one in inputs:
        said = _leak(one, recordings, target, horizon_s)
        if said and not allow_leaks:
            raise ValueError(said)
        if said:
            leaks.append(one.name)
    parts = [_of_recording(one, inputs, target, length) for one in recordings]
    if not any(len(part.at) for part in parts):
        raise ValueError(
            f"no recording of {', '.join(one.name for one in recordings)} is long enough for a "
            f"window of {length} samples and the ages of its inputs: shorten them"
        )
    parted = [part.x for part in parts]
    together: Any = Joined(parted, np.arange(sum(map(len, parted))))
    return Windows(
        x=together if joined else np.concatenate(parted),
        y=np.concatenate([part.y for part in parts]),
        group=np.concatenate([part.group for part in parts]),
        at=np.concatenate([part.at for part in parts]), inputs=tuple(inputs), leaks=tuple(leaks),
    )  # fmt: skip


def _check(
    recordings: Sequence[Recording], inputs: Sequence[WindowInput], target: str, length: int,
    horizon_s: float,
) -> None:  # fmt: skip
    """Refuse what cannot be made windows of."""
    if not recordings or not inputs:
        raise ValueError("windows need a recording and an input: give at least one of each")
    if length < 1 or not horizon_s >= 0:
        raise ValueError(
            f"windows of {length} rows and a horizon of {horizon_s} s cannot be made: give at "
            "least one row and a horizon that is not negative"
        )
    names = [one.name for one in recordings]
    double = sorted({name for name in names if names.count(name) > 1})
    if double:
        raise ValueError(
            f"recording {double[0]} is given {names.count(double[0])} times: give each a name of "
            "its own, for groups are split by name"
        )
    for one in recordings:
        for name in [*(i.name for i in inputs), target]:
            if name not in one.signals:
                raise ValueError(
                    f"recording {one.name} has no signal {name!r}; it has "
                    f"{', '.join(sorted(one.signals))}"
                )
            wrong = ~np.isfinite(one.signals[name])
            if wrong.any():
                raise ValueError(
                    f"signal {name!r} of recording {one.name} has {int(wrong.sum())} values that "
                    f"are not finite, the first at sample {int(wrong.argmax())}: fill them, or cut "
                    "the recording there"
                )


def _leak(
    given: WindowInput, recordings: Sequence[Recording], target: str, horizon_s: float
) -> str:
    """Reason why an input could not be known yet; empty where it could."""
    age = given.older_than_s
    if age is not None:
        if age < horizon_s * (1.0 - 1e-12) or horizon_s == inf:
            most = "that no measurement may enter" if horizon_s == inf else f"of {horizon_s:g} s"
            return (
                f"input {given.name!r} is a measurement that may be {age:g} s old, younger than "
                f"the horizon {most}: raise its older_than_s, or leave it out"
            )
        return ""
    if given.name == target or any(given.name in one.measured for one in recordings):
        return (
            f"input {given.name!r} is measured, but declared as known before the motion: give its "
            "older_than_s, or leave it out"
        )
    if all(np.array_equal(one.signals[given.name], one.signals[target]) for one in recordings):
        return (
            f"input {given.name!r} holds the very values of the target {target!r}: leave it out, "
            "or give its older_than_s"
        )
    return ""


def _of_recording(
    recording: Recording, inputs: Sequence[WindowInput], target: str, length: int
) -> Windows:
    """Windows of one recording; there may be none."""
    lags = [one.rows(recording.step_s) for one in inputs]
    truth = np.asarray(recording.signals[target], dtype=np.float64)
    first = length - 1 + max(lags)
    at = np.arange(first, len(truth))
    columns = [
        np.asarray(recording.signals[one.name], dtype=np.float64)[max(lags) - lag :][: -lag or None]
        for one, lag in zip(inputs, lags, strict=True)
    ]
    x = np.empty((0, length, len(inputs)))
    if len(at):  # a view: rows of all windows are those of one table
        table = np.stack(columns, axis=1)
        x = sliding_window_view(table, length, axis=0).transpose(0, 2, 1)
    return Windows(x=x, y=truth[at], group=np.full(len(at), recording.name), at=at)
