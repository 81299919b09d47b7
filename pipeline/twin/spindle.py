"""Spindle temperature of one machine: inputs from the state table, stored model, predictions.

A thermal network under the heat sources and, where days left out say that it helps, a random forest
on its residual.  The forest's features are the network's own answer, the temperature and age of its
start, the heat sources smoothed over several time constants, and extra signals of the machine.  An
unknown value stays unknown (the trees have a branch for it); it is never filled with zeros.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.model import AdaptiveSettings, Bands, Correlation, Model
from pipeline.schema.ranges import NotNegative, Positive, Ranged
from pipeline.schema.store import read_json, write_json
from pipeline.signals.columns import column
from pipeline.signals.windows import StateSegment, state_segments
from pipeline.thermal.network import (
    SOURCES,
    SpindleThermalParameters,
    heat_sources,
    slow_share,
    temperatures,
)

if TYPE_CHECKING:
    from pipeline.schema.forest import Trees

SMOOTHING_S = (120.0, 600.0, 3600.0)
"""Time constants [s] over which sources and extra signals are smoothed."""

NODES = "forest.json"
"""File of the trees, beside ``model.json``."""


@dataclass(frozen=True, kw_only=True)
class Forest:
    """A trained forest as ``model.json`` describes it."""

    used: bool
    """Whether it lowers the error of days left out, and corrects the network."""
    why: str
    """Reason of its use or not."""
    sources: tuple[str, ...]
    extra: tuple[str, ...]
    """Heat sources and further signals that it looks at."""
    smoothing_s: tuple[float, ...] = SMOOTHING_S
    """Time constants of its features [s]."""
    days: tuple[str, ...]
    """Training days."""
    examples: int
    """Samples that it was trained on."""
    rmse_days_left_out_K: float | None
    rmse_without_K: float | None
    """Over days left out, with the forest and without it [K]."""


@dataclass(frozen=True, kw_only=True)
class ResidualForest:
    """A trained forest with the features it wants."""

    forest: "Trees"
    """Fitted on the features in the order of :func:`feature_names`."""
    sources: tuple[str, ...]
    extra: tuple[str, ...]
    """Heat sources and further signals that it looks at."""
    draws: int = 0
    """Forests of trees drawn with replacement whose corrections stand beside the forest's own."""

    def correction(
        self, inputs: pd.DataFrame, physics: Floats, start: float | Floats, at: Floats
    ) -> Floats:
        """Temperature to add to the network's [K], (1 + draws, T); see :func:`features`."""
        x = features(inputs, physics, start, at, self.sources, self.extra)
        return self.forest.drawn(x, self.draws)


def feature_names(sources: Sequence[str], extra: Sequence[str]) -> list[str]:
    """Names of the features, in order."""
    smoothed = [f"{s}_over_{tau:g}_s" for s in (*sources, *extra) for tau in SMOOTHING_S]
    return ["physics", "start_temperature", "horizon_s", *smoothed]


def smoothed_inputs(frame: pd.DataFrame, step: float, names: Sequence[str]) -> pd.DataFrame:
    """Exponential means of ``names`` over each time constant, from the past only.

    An unknown signal has nan; after a gap its mean goes on.  Raises ValueError when a signal is no
    column of ``frame``.
    """
    missing = [name for name in names if name not in frame.columns]
    if missing:
        raise ValueError(
            f"the forest needs {missing[0]}, which the records do not have; "
            "record it, or train again without it (spindle.extra in the machine's file)"
        )
    return pd.DataFrame(
        {
            # pandas carries the last mean into a gap, as if the signal had been known there
            f"{name}_over_{tau:g}_s": frame[name]
            .ewm(alpha=-np.expm1(-step / tau))
            .mean()
            .where(frame[name].notna())
            for name in names
            for tau in SMOOTHING_S
        }
    )


def features(
    inputs: pd.DataFrame, physics: Floats, start: float | Floats, at: Floats,
    sources: Sequence[str], extra: Sequence[str],
) -> Floats:  # fmt: skip
    """Feature matrix, shape (T, features), in the order of :func:`feature_names`.

    ``inputs``: rows of :func:`smoothed_inputs`; ``physics`` (T,): the network's temperature;
    ``start``: the measured one of its start [degC]; ``at`` (T,): time since [s].
    """
    names = feature_names(sources, extra)
    columns = [physics, np.broadcast_to(start, len(physics)), at]
    return np.column_stack([*columns, inputs[names[3:]].to_numpy(float)])


def save_forest(forest: "Trees", folder: Path) -> None:
    """Write the trees into a folder; the same forest gives the same bytes."""
    write_json(forest.document(), folder / NODES)


def load_forest(folder: Path, about: Forest, draws: int = 0) -> ResidualForest | None:
    """Forest in ``folder``, None when training found that it does not help.

    Raises ValueError when its features are those of another version, or its file cannot be read.
    """
    if not about.used:
        return None
    if about.smoothing_s != SMOOTHING_S:
        raise ValueError(
            f"{folder}: the forest was trained on means over {list(about.smoothing_s)} s, this "
            f"version takes {list(SMOOTHING_S)} s: train it again with `dvc repro`"
        )
    from pipeline.schema.forest import Trees

    trees = Trees.restored(read_json(folder / NODES, dict[str, str]))
    return ResidualForest(forest=trees, sources=about.sources, extra=about.extra, draws=draws)


TARGET = "spindle_temperature"
"""The column that is modelled [CELSIUS]."""


@dataclass(frozen=True, kw_only=True)
class SpindleRecords:
    """Signals that a machine records of its spindle."""

    position_control: bool = False
    """Whether the spindle also works as a C axis, its state in ``spindle_position_control``."""
    ambient: bool = False
    """Whether ``ambient_temperature`` is recorded; otherwise one constant is identified."""
    coolant: bool = False
    """Whether ``coolant_temperature`` is recorded and the network may lose heat to it; days left
    out decide whether it does."""
    extra: tuple[str, ...] = ()
    """Further columns of the state table that a forest may look at."""

    @property
    def sources(self) -> list[str]:
        """Heat sources that this machine's records can excite."""
        return [s for s in SOURCES if s != "position_hold" or self.position_control]

    @property
    def signals(self) -> list[str]:
        """Columns of the state table that the model needs to be served."""
        listed = {
            "spindle_speed": True, "spindle_load": True,
            "spindle_position_control": self.position_control,
            "ambient_temperature": self.ambient, "coolant_temperature": self.coolant,
        }  # fmt: skip
        return [name for name, recorded in listed.items() if recorded]

    @property
    def inputs(self) -> list[str]:
        """Columns of a stretch that have to be known: heat sources and measured surrounds."""
        surrounds = [name for name in self.signals if name.endswith("_temperature")]
        return [*SOURCES, *surrounds]


def with_heat(state: pd.DataFrame, records: SpindleRecords) -> pd.DataFrame:
    """``state`` with one column a heat source, taken before averaging: n^(5/3) is not linear.

    Raises ValueError when a needed column is missing; the message names it.
    """
    missing = [name for name in records.signals if name not in state.columns]
    if missing:
        raise ValueError(
            f"the state table has no column {missing[0]}; "
            "map it to a data item in conf/machine/, or say in its spindle section that it is "
            "not recorded"
        )

    def si(name: str) -> Floats:
        c = column(name)
        return state[name].to_numpy(float) * c.factor + c.offset

    hold = (
        state["spindle_position_control"].to_numpy(float)
        if records.position_control
        else np.zeros(len(state))
    )
    heat = heat_sources(si("spindle_speed"), si("spindle_load"), hold)
    return state.assign(**{name: heat[:, i] for i, name in enumerate(SOURCES)})


def spindle_stretches(
    state: pd.DataFrame, day: str, records: SpindleRecords, *,
    step: float, bridge_s: float, shortest_s: float,
) -> Iterator[StateSegment]:  # fmt: skip
    """The stretches of one day's state table, ready for the network."""
    yield from state_segments(
        with_heat(state, records), day, inputs=records.inputs, target=TARGET, step=step,
        bridge_s=bridge_s, shortest_s=shortest_s,
    )  # fmt: skip


def stretch_of(
    state: pd.DataFrame, start_temperature: float, records: SpindleRecords, *, step: float
) -> StateSegment:
    """Whole state table as one stretch from a given temperature, unknown inputs held.

    Raises ValueError when the table is empty, a column is missing, an input is unknown in the first
    step, or the temperature to start from is not a number.
    """
    if state.empty:
        raise ValueError("the state table has no row: give the time that is to be predicted")
    if not np.isfinite(start_temperature):
        raise ValueError(f"start temperature {start_temperature} degC is no number: measure it")
    given = state.assign(**{TARGET: float(start_temperature)})
    day = str(state.index[0].date())
    held = spindle_stretches(given, day, records, step=step, bridge_s=np.inf, shortest_s=0.0)
    if not (found := list(held)):
        raise ValueError(
            f"no row of the state table knows all of {', '.join(records.signals)}: "
            "nothing can be predicted without them"
        )
    frame = found[0].frame
    if frame.index[0] > state.index[0]:
        raise ValueError(
            f"{', '.join(records.signals)} are not all known before {frame.index[0]}, the start "
            f"temperature is of {state.index[0]}: start where they are known"
        )
    return found[0]


def heat_of(frame: pd.DataFrame) -> Floats:
    """Heat sources of a stretch's frame, shape (T, len(SOURCES))."""
    return frame[list(SOURCES)].to_numpy(float)


def ambient_of(frame: pd.DataFrame, records: SpindleRecords) -> Floats | None:
    """Measured ambient of a stretch's frame [degC], shape (T,), None when it is not recorded."""
    return frame["ambient_temperature"].to_numpy(float) if records.ambient else None


def coolant_of(frame: pd.DataFrame, records: SpindleRecords) -> Floats | None:
    """Coolant's temperature of a stretch's frame [degC], shape (T,), None when it is no sink."""
    return frame["coolant_temperature"].to_numpy(float) if records.coolant else None


def free_run(
    stretch: StateSegment, records: SpindleRecords, parameters: SpindleThermalParameters
) -> Floats:
    """Node temperatures over a stretch from its first measured temperature only, (nodes, T)."""
    frame = stretch.frame
    return temperatures(
        heat_of(frame), frame[TARGET].iloc[0], parameters, stretch.step,
        ambient=ambient_of(frame, records), coolant=coolant_of(frame, records),
    )  # fmt: skip


def from_measured(
    stretch: StateSegment, starts: Sequence[int] | Ints, length: int, records: SpindleRecords,
    parameters: SpindleThermalParameters, nodes: Floats,
) -> Floats:  # fmt: skip
    """Temperature over ``length`` steps from that measured at each of N ``starts``, (N, length).

    ``nodes`` (nodes, T) is a free run from the stretch's beginning, whose error at a start counts
    as one of the slow mode.  Beyond the end of the stretch its last inputs are held.
    """
    frame, at = stretch.frame, np.asarray(starts, dtype=np.intp)
    rows = np.minimum(at[:, None] + np.arange(length), len(frame) - 1)
    first = frame[TARGET].to_numpy(float)[at]
    body = None
    if len(nodes) == 2:
        body = nodes[1][at] + slow_share(parameters) * (first - nodes[0][at])
    ambient, coolant = ambient_of(frame, records), coolant_of(frame, records)
    return temperatures(
        heat_of(frame)[rows], first, parameters, stretch.step, body_start=body,
        ambient=None if ambient is None else ambient[rows],
        coolant=None if coolant is None else coolant[rows],
    )[0]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SpindleFitFacts:
    """Goodness of fit of the network to its training days."""

    step_s: float
    """Step of the simulation [s]."""
    nodes: int
    """Nodes of the network."""
    rmse_K: float
    """Over the training days, each a free run [K]."""
    rmse_days_left_out_K: Mapping[str, float]
    """RMSE in windows of days left out [K], by network, ``", hours"`` behind it of hours left out,
    ``" with coolant"`` where that sink was tried; empty when there was no choice."""
    condition: float | None
    """Condition number of the scaled Jacobian [1]."""
    correlation: Correlation
    """Correlation of the fitted parameters."""
    evaluations: int
    """Simulations of all training days that the fit took."""
    seconds: float
    bridged_s: float
    """Bridged time of the training days, with inputs held from before [s]."""
    in_doubt: tuple[str, ...] = ()
    """Other networks that the left-out data cannot distinguish from this one."""
    resolution_K: float = 0.0
    """Step of the temperature sensor [K]."""


@dataclass(frozen=True, kw_only=True)
class SpindleIntervals(Ranged, section="intervals"):
    """90 % prediction intervals of a spindle's temperature, and the regimes that they are by."""

    trend_s: Positive = 600.0
    steady_K_h: NotNegative = 1.0
    """Warming and cooling are a change of the network's free run over ``trend_s`` [s] faster than
    ``steady_K_h`` [K/h]; anything slower is steady."""
    windows_horizons_s: tuple[Positive, ...] = ()
    free_run_horizons_s: tuple[Positive, ...] = ()
    """Times since the last measured temperature that part the regimes [s]."""
    windows: Bands = field(default_factory=dict)
    free_run: Bands = field(default_factory=dict)
    """Half widths [K] by regime, of windows that start from a measured temperature and of days that
    run free."""
    follow: AdaptiveSettings = field(default_factory=AdaptiveSettings)
    """Adaptation of the width in windows to earlier errors of the day."""


@dataclass(frozen=True, kw_only=True)
class SpindleModelFile(Model):
    """Content of a spindle's ``model.json``; ``intervals`` is None with a single training day."""

    network: SpindleThermalParameters
    records: SpindleRecords
    fit: SpindleFitFacts
    training_days: tuple[str, ...]
    forest: Forest
    intervals: SpindleIntervals | None = None


@dataclass(frozen=True, kw_only=True)
class SpindleModel:
    """Network, forest (None when it does not help) and the records they need."""

    network: SpindleThermalParameters
    records: SpindleRecords
    step_s: float
    forest: ResidualForest | None = None

    def free_run(self, stretch: StateSegment) -> tuple[Floats, Floats]:
        """Temperature of the network alone, (T,), and of the whole model, (1 + draws, T)."""
        physics = free_run(stretch, self.records, self.network)[0]
        if self.forest is None:
            return physics, physics[None]
        at = np.arange(len(physics), dtype=float) * stretch.step
        first = float(stretch.frame[TARGET].iloc[0])
        return physics, physics + self.forest.correction(self._inputs(stretch), physics, first, at)

    def windows(self, stretch: StateSegment, window_s: float) -> tuple[Floats, Floats, Floats]:
        """Network alone, (T,), whole model, (1 + draws, T), and persistence, (T,), by windows.

        Every window starts from a measured temperature; what lies between is nan.
        """
        measured = stretch.frame[TARGET].to_numpy(float)
        length = max(round(window_s / stretch.step), 1)
        nodes = free_run(stretch, self.records, self.network)
        physics, persistence, at = (np.full(len(measured), np.nan) for _ in range(3))
        starts = window_starts(measured, length)
        runs = from_measured(stretch, starts, length, self.records, self.network, nodes)
        for start, run in zip(starts, runs, strict=True):
            window = slice(start, start + length)
            physics[window] = run[: len(measured) - start]
            persistence[window] = measured[start]
            at[window] = np.arange(len(at[window])) * stretch.step
        known = np.isfinite(at)
        model = np.tile(physics, (1 + (self.forest.draws if self.forest else 0), 1))
        if self.forest is not None and known.any():
            inputs = self._inputs(stretch)[known]
            model[:, known] += self.forest.correction(
                inputs, physics[known], persistence[known], at[known]
            )
        return physics, model, persistence

    def _inputs(self, stretch: StateSegment) -> pd.DataFrame:
        """Inputs of the forest over a stretch; no columns when there is no forest."""
        names = [*self.forest.sources, *self.forest.extra] if self.forest else []
        return smoothed_inputs(stretch.frame, stretch.step, names)

    def predict(self, state: pd.DataFrame, start_temperature: float) -> pd.DataFrame:
        """Temperatures [degC] from a state table and the measured temperature of its first row.

        The state has an index of UTC times and the columns that the model needs
        (``records.signals`` and those of its forest); no temperature of the spindle is read from
        it.  Columns of the result are ``spindle_temperature`` and ``physics``.  Raises ValueError
        when a column is missing, or an input is unknown in the first step.
        """
        stretch = stretch_of(state, start_temperature, self.records, step=self.step_s)
        physics, model = self.free_run(stretch)
        return pd.DataFrame(
            {"spindle_temperature": model[0], "physics": physics}, index=stretch.frame.index
        )


def window_starts(measured: Floats, length: int) -> list[int]:
    """Steps at which windows of ``length`` steps start: one after the other, each measured.

    >>> window_starts(np.array([20.0, 21.0, np.nan, 22.0, 22.0]), 2)
    [0, 3]
    """
    starts, free = [], 0
    for step in np.flatnonzero(np.isfinite(measured)).tolist():
        if step >= free:
            starts.append(step)
            free = step + length
    return starts


def load_spindle_model(folder: Path, draws: int = 0) -> SpindleModel:
    """The model in ``model.json`` of a folder, with the forest beside it if it is used.

    Raises StoreError when a file is missing or broken; the message names it and the command that
    writes it.
    """
    stored = read_json(folder / "model.json", SpindleModelFile)
    forest = load_forest(folder / "residual", stored.forest, draws)
    return SpindleModel(
        network=stored.network, records=stored.records, step_s=stored.fit.step_s, forest=forest
    )
