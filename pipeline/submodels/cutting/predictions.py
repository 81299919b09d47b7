"""Predicted forces beside measured ones over the mean revolution, as rows of the shared judge.

The force in the plane of the feed is judged: its waveform as both of its components one after the
other, whose RMSE is that of the vector; its peak and mean as the magnitude.  The channels of the
dynamometer and a fit on the other recordings are shown.  Beside the
model stand mechanics alone, without the waveform residual, and the baseline.
"""

from collections.abc import Iterable, Mapping

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import (
    BY_LOAD,
    BY_LOAD_SHARE,
    CHANNEL_FORCE,
    CHANNELS,
    MAGNITUDE,
    MEAN,
    MECHANICS,
    OTHERS,
    PEAK,
    PLAIN,
    PLANE,
    CuttingModel,
)
from pipeline.schema.verdict import Fact
from pipeline.submodels.contract import Prediction, Target
from pipeline.submodels.cutting.coefficients import NORMAL_90, mean_tangential, tangential_by_load
from pipeline.submodels.cutting.model import CutModel, restored
from pipeline.submodels.cutting.recordings import CuttingRecording, cut_harmonics
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.settings import (
    CuttingFitSettings,
    CuttingLimits,
    CuttingSetup,
)
from pipeline.submodels.cutting.spread import force_levels, half_widths, wave_half_widths

ANGLES = 720
"""Angles of a revolution at which waveforms are compared."""


def force_targets(limits: CuttingLimits) -> tuple[Target, ...]:
    """Quantities of the judgement: the force in the plane has limits, its channels are shown."""
    beside = (MECHANICS, PLAIN)
    kept = {
        PLANE: {"relative_percent": limits.rms_percent},
        MAGNITUDE: {"peak_percent": limits.peak_percent, "mean_percent": limits.mean_percent},
        PEAK: {}, MEAN: {},
    }  # fmt: skip
    judged = [
        Target(quantity=quantity, unit="N", regime=regime, limits=kept[quantity],
               baselines=beside, widens=True,
               coverage=limits.share if (quantity, regime) == (PLANE, "") else None)
        for pair in ((PLANE, MAGNITUDE), (PEAK, MEAN))
        for regime in ("", OTHERS) for quantity in pair
    ]  # fmt: skip
    loads = [Target(quantity=BY_LOAD, unit="N"), Target(quantity=BY_LOAD_SHARE, unit="%")]
    channels = [
        Target(quantity=CHANNEL_FORCE + name, unit="N", baselines=beside, widens=True)
        for name in CHANNELS
    ]
    return (*judged, *loads, *channels)


class ForcePredictor:
    """Predictor of the forces of recordings by a stored model, if there is one."""

    def __init__(
        self, stored: CuttingModel, setup: CuttingSetup, settings: CuttingFitSettings
    ) -> None:
        self.reason, self.setup, self.settings = stored.reason, setup, settings
        self.model = None if stored.prediction is None else restored(stored.prediction)
        self.load = stored.spindle_parameters
        self.plain = None if stored.plain is None else restored(stored.plain)
        self.faults = {one.recording: one.fault for one in stored.recordings if one.fault}
        self.without: Mapping[str, CutModel] = {
            name: restored(fold.prediction) for fold in stored.folds for name in fold.left_out
        }

    def prediction(self, recording: CuttingRecording) -> Prediction:
        """Rows of one recording; without rows where nothing predicts it or it was left out."""
        if self.model is None or self.plain is None or recording.revolution is None:
            return Prediction(frame=pd.DataFrame(), note=self.reason or recording.reason)
        parts = [*self._rows(recording, self.model, self.plain, "")]
        if recording.name in self.without and recording.role == "training":
            other = self.without[recording.name]
            parts += self._rows(recording, other, self.plain, OTHERS)
        parts += self._by_load(recording)
        residual = self.model.residual(cut_harmonics(recording, self.settings).conditions)
        how = "mechanics" if residual is None else "mechanics and what they leave over"
        return Prediction(
            frame=pd.concat(parts, ignore_index=True), facts={"predicted by": Fact(value=how)},
            cause=self.faults.get(recording.name, ""),
        )  # fmt: skip

    def _rows(
        self, recording: CuttingRecording, model: CutModel, plain: CutModel, regime: str
    ) -> Iterable[pd.DataFrame]:
        """Rows of the judged quantities and the channels under one model."""
        _, revolution = recording.cut
        cut = cut_harmonics(recording, self.settings)
        angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)
        forces = {
            "measured": wave(revolution.lines, angles),
            "predicted": wave(model.beside(cut), angles),
            f"baseline_{MECHANICS}": wave(model.beside(cut, mechanics_only=True), angles),
            f"baseline_{PLAIN}": wave(plain.beside(cut), angles),
        }
        degrees = np.degrees(angles)
        half = (
            np.tile(NORMAL_90 * np.sqrt(model.left_out * cut.harmonics), (ANGLES, 1))
            if model.spread is None else wave_half_widths(model, cut)
        )  # fmt: skip
        # rows of a force on the tool: feed, normal, axis; the first two span the plane
        plane = {name: force[:, :2].ravel(order="F") for name, force in forces.items()}
        yield _table(PLANE, regime, np.tile(degrees, 2), plane, half[:, :2].ravel(order="F"))
        magnitude = {name: np.linalg.norm(f[:, :2], axis=1) for name, f in forces.items()}
        yield _table(MAGNITUDE, regime, degrees, magnitude)
        if model.spread is not None:
            levels = force_levels(model, cut.conditions, cut.harmonics)
            widths = half_widths(model.spread, levels)
            peaks = {name: np.array([values.max()]) for name, values in magnitude.items()}
            means = {name: np.array([values.mean()]) for name, values in magnitude.items()}
            yield _table(PEAK, regime, np.zeros(1), peaks, np.array([widths[0]]))
            yield _table(MEAN, regime, np.zeros(1), means, np.array([widths[1]]))
        rotation = self.setup.dynamometer.rotation
        for k, name in enumerate(CHANNELS):
            channel = {key: force @ rotation[:, k] for key, force in forces.items()}
            width = half @ np.abs(rotation[:, k])
            yield _table(CHANNEL_FORCE + name, regime, degrees, channel, width)

    def _by_load(self, recording: CuttingRecording) -> Iterable[pd.DataFrame]:
        """Tangential force from the spindle load beside that of the dynamometer, if any."""
        cut = cut_harmonics(recording, self.settings)
        found = tangential_by_load(self.load, cut.conditions)
        if found is None or self.plain is None:
            return
        force, half = found
        measured = float(mean_tangential([cut], self.plain.values[:6])[0][0])
        if not measured > 0:
            return
        for quantity, scale in ((BY_LOAD, 1.0), (BY_LOAD_SHARE, 100 / measured)):
            values = {"measured": scale * measured, "predicted": scale * force}
            one = {name: np.array([value]) for name, value in values.items()}
            unit = "N" if quantity == BY_LOAD else "%"
            yield _table(quantity, "", np.zeros(1), one, np.array([scale * half]), unit)


def _table(
    quantity: str, regime: str, degrees: Floats, values: Mapping[str, Floats],
    half: Floats | None = None, unit: str = "N",
) -> pd.DataFrame:  # fmt: skip
    """Rows of one quantity over the angle; ``half`` is half of the 90 % prediction interval."""
    frame = pd.DataFrame({"t": degrees, **values})
    width = np.nan if half is None else half
    return frame.assign(
        quantity=quantity, unit=unit, regime=regime,
        low=frame["predicted"] - width, high=frame["predicted"] + width,
    )  # fmt: skip
