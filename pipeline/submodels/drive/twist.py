"""Twist of a shaft as predicted from the motor alone: its force by current and motion, over K."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from pipeline.schema.drive import RIGID, TWIST, DriveModel
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.drive.shaft_signals import DAMPING, PLAY, flanks, signals_of
from pipeline.twin.drive import IdentifiedDrive


def is_known(model: DriveModel, letter: str) -> bool:
    """Whether the stiffness of the shaft of an axis is determined."""
    found = model.parameters.get(letter, {}).get("shaft_stiffness")
    return found is not None and found.determined


def twist_frames(
    recording: Recording, model: DriveModel, drives: Mapping[str, IdentifiedDrive]
) -> Iterator[pd.DataFrame]:
    """Twist of each axis whose both ends a recording shows [um], measured and predicted.

    Both encoders have their own zero, screw and scale their errors: a constant and a straight line
    over position are taken out of the measured twist as of the predicted.
    """
    for letter, raw in recording.shafts.items():
        if letter not in drives or letter not in model.shafts or not is_known(model, letter):
            continue
        shaft = model.shafts[letter]
        one = signals_of(recording, letter, drives[letter].feed_drive.force_constant, shaft.lead)
        factors = np.array(shaft.factors)
        side, sure = flanks(one, factors)
        table = one.columns.copy()
        # the predicted twist knows nothing of the carriage's scale
        table[:, DAMPING], table[:, PLAY] = 0.0, side / 2
        own, _ = np.linalg.qr(one.nuisance[sure][:, :2])
        measured, predicted = (
            values[sure] - own @ (own.T @ values[sure]) for values in (one.twist, table @ factors)
        )
        yield pd.DataFrame({
            "quantity": f"{TWIST} {letter}", "unit": "um",
            "t": np.arange(len(raw["motor"]))[sure] * recording.period,
            "measured": 1e6 * measured, "predicted": 1e6 * predicted, "scored": True,
            f"baseline_{RIGID}": 0.0,
        })  # fmt: skip
