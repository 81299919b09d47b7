"""Spindle model as it is stored, and its predictions: thermal network and, if it helps, forest."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.model import Correlation, Model
from pipeline.schema.store import read_json
from pipeline.signals.windows import StateSegment
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.residual import Forest, ResidualForest, load_forest, smoothed_inputs
from pipeline.twin.spindle import TARGET, SpindleRecords, free_run, from_measured, stretch_of


@dataclass(frozen=True, kw_only=True)
class SpindleFitFacts:
    """How well the network fits its training days.

    Parameters
    ----------
    step_s : float
        Step of the simulation [s].
    nodes : int
        Of the network.
    rmse_K : float
        Over the training days, each a free run [K].
    rmse_days_left_out_K : mapping of str to float
        RMSE in windows of days left out [K], by number of nodes; empty when there was no choice.
    condition : float or None
        Condition number of the scaled Jacobian [1].
    correlation : Correlation
        Of the fitted parameters.
    evaluations : int
        Simulations of all training days that the fit took.
    seconds, bridged_s : float
        Of the training days; of them with inputs that were held from before [s].
    """

    step_s: float
    nodes: int
    rmse_K: float
    rmse_days_left_out_K: Mapping[str, float]
    condition: float | None
    correlation: Correlation
    evaluations: int
    seconds: float
    bridged_s: float


@dataclass(frozen=True, kw_only=True)
class SpindleModelFile(Model):
    """The content of a spindle's ``model.json``; the forest's trees stand beside it."""

    network: SpindleThermalParameters
    records: SpindleRecords
    fit: SpindleFitFacts
    training_days: tuple[str, ...]
    forest: Forest


@dataclass(frozen=True, kw_only=True)
class SpindleModel:
    """Network, forest (None when it does not help) and the records they need."""

    network: SpindleThermalParameters
    records: SpindleRecords
    step_s: float
    forest: ResidualForest | None = None

    def free_run(self, stretch: StateSegment) -> tuple[Floats, Floats]:
        """Temperature of network alone and of the whole model, each (T,), from the first sample."""
        physics = free_run(stretch, self.records, self.network)[0]
        return physics, self._corrected(stretch, self._inputs(stretch), physics, 0)

    def windows(self, stretch: StateSegment, window_s: float) -> tuple[Floats, Floats, Floats]:
        """Network alone, whole model, and persistence, each (T,), window by window.

        Every window starts from a measured temperature; where there is none, the window begins at
        the next one and what lies between is nan.
        """
        measured = stretch.frame[TARGET].to_numpy(float)
        length = max(round(window_s / stretch.step), 1)
        nodes = free_run(stretch, self.records, self.network)
        body = nodes[1] if len(nodes) == 2 else None
        inputs = self._inputs(stretch)
        physics, model, persistence = (np.full(len(measured), np.nan) for _ in range(3))
        for start in window_starts(measured, length):
            window = slice(start, start + length)
            physics[window] = from_measured(
                stretch, start, length, self.records, self.network, body
            )
            model[window] = self._corrected(stretch, inputs, physics[window], start)
            persistence[window] = measured[start]
        return physics, model, persistence

    def _inputs(self, stretch: StateSegment) -> pd.DataFrame:
        """What the forest looks at over a stretch; no columns when there is no forest."""
        names = [*self.forest.sources, *self.forest.extra] if self.forest else []
        return smoothed_inputs(stretch.frame, stretch.step, names)

    def _corrected(
        self, stretch: StateSegment, inputs: pd.DataFrame, physics: Floats, start: int
    ) -> Floats:
        if self.forest is None:
            return physics
        rows = inputs.iloc[start : start + len(physics)]
        first = float(stretch.frame[TARGET].iloc[start])
        at = np.arange(len(physics), dtype=float) * stretch.step
        correction: Floats = self.forest.correction(rows, physics, first, at)
        return physics + correction

    def predict(self, state: pd.DataFrame, start_temperature: float) -> pd.DataFrame:
        """Temperatures from a state table and one measured temperature at its beginning.

        Parameters
        ----------
        state : DataFrame
            Index of UTC times, the columns that the model needs (``records.signals`` and what its
            forest looks at).  No temperature of the spindle is read from it.
        start_temperature : float
            Measured at the first row [degC].

        Returns
        -------
        DataFrame
            Index of step times; ``spindle_temperature`` and ``physics`` [degC].

        Raises
        ------
        ValueError
            When a column is missing, or an input is unknown in the first step.
        """
        stretch = stretch_of(state, start_temperature, self.records, step=self.step_s)
        physics, model = self.free_run(stretch)
        return pd.DataFrame(
            {"spindle_temperature": model, "physics": physics}, index=stretch.frame.index
        )


def window_starts(measured: Floats, length: int) -> list[int]:
    """Steps at which windows of ``length`` steps start: one after the other, each measured.

    Examples
    --------
    >>> window_starts(np.array([20.0, 21.0, np.nan, 22.0, 22.0]), 2)
    [0, 3]
    """
    starts, free = [], 0
    for step in np.flatnonzero(np.isfinite(measured)).tolist():
        if step >= free:
            starts.append(step)
            free = step + length
    return starts


def load_spindle_model(folder: Path) -> SpindleModel:
    """The model in ``model.json`` of a folder, with the forest beside it if it is used.

    Raises
    ------
    StoreError
        When a file is missing or broken; the message names it and the command that writes it.
    """
    stored = read_json(folder / "model.json", SpindleModelFile)
    return SpindleModel(
        network=stored.network,
        records=stored.records,
        step_s=stored.fit.step_s,
        forest=load_forest(folder / "residual", stored.forest),
    )
