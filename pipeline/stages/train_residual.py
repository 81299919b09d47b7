"""Stage: train the forest on what the spindle's network leaves over."""

import json
from pathlib import Path

from pipeline.identification.residual import ForestSettings, examples, train_residual_forest
from pipeline.identification.spindle import SpindleFitSettings
from pipeline.identification.spindle_document import training_stretches
from pipeline.twin.residual import save_forest
from pipeline.twin.spindle import SpindleRecords
from pipeline.twin.spindle_model import network_from


def train_residual(
    clean: Path,
    model: Path,
    residual: Path,
    *,
    spindle: SpindleRecords,
    spindle_fit: SpindleFitSettings,
    residual_forest: ForestSettings,
) -> None:
    """Read ``clean`` and the network in ``model``, write the folder ``residual``."""
    pieces, _ = training_stretches(clean, spindle, spindle_fit)
    network = network_from(json.loads(model.read_text()))
    data = examples(pieces, spindle, network, residual_forest)
    forest, about = train_residual_forest(data, spindle, residual_forest)
    save_forest(forest, residual, about)
