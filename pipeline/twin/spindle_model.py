"""One spindle's model as it is stored, and what it predicts: network and, if it helps, forest."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import cattrs
import numpy as np
import pandas as pd

from pipeline.signals.windows import Stretch
from pipeline.thermal.network import SOURCES, Floats, SpindleThermalParameters
from pipeline.twin.residual import ResidualForest, load_forest, smoothed_inputs
from pipeline.twin.spindle import TARGET, SpindleRecords, free_run, from_measured, stretch_of


@dataclass(frozen=True, kw_only=True)
class SpindleModel:
    """Network, forest (None when it does not help) and the records they need."""

    network: SpindleThermalParameters
    records: SpindleRecords
    step_s: float
    forest: ResidualForest | None = None

    def free_run(self, stretch: Stretch) -> tuple[Floats, Floats]:
        """Temperature of network alone and of the whole model, each (T,), from the first sample."""
        physics = free_run(stretch, self.records, self.network)[0]
        return physics, self._corrected(stretch, self._inputs(stretch), physics, 0)

    def windows(self, stretch: Stretch, window_s: float) -> tuple[Floats, Floats, Floats]:
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

    def _inputs(self, stretch: Stretch) -> pd.DataFrame:
        """What the forest looks at over a stretch; no columns when there is no forest."""
        names = [*self.forest.sources, *self.forest.extra] if self.forest else []
        return smoothed_inputs(stretch.frame, stretch.step, names)

    def _corrected(
        self, stretch: Stretch, inputs: pd.DataFrame, physics: Floats, start: int
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


def network_from(document: dict[str, object]) -> SpindleThermalParameters:
    """The network of a ``spindle_thermal.json``."""
    converter = cattrs.Converter(forbid_extra_keys=True)
    return converter.structure(document["network"], SpindleThermalParameters)


def load_spindle_model(network: Path, residual: Path) -> SpindleModel:
    """The model in ``spindle_thermal.json`` and the forest's folder.

    Raises
    ------
    ValueError
        When a file is missing; the message names it and the command that writes it.
    """
    for path in (network, residual / "features.json"):
        if not path.exists():
            raise ValueError(f"{path} does not exist: run `dvc repro` to identify the spindle")
    document = json.loads(network.read_text())
    converter = cattrs.Converter(forbid_extra_keys=True)
    return SpindleModel(
        network=network_from(document),
        records=converter.structure(document["records"], SpindleRecords),
        step_s=float(document["fit"]["step_s"]),
        forest=load_forest(residual),
    )


def network_document(network: SpindleThermalParameters) -> dict[str, object]:
    """``network`` as plain values, rounded to nothing: what is stored is what was judged."""
    heating = {name: network.heating[name] for name in SOURCES if name in network.heating}
    return {**asdict(network), "heating": heating}
