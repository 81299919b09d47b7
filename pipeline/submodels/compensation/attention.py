"""Attention of the compensation network over a motion to and fro."""

from collections.abc import Mapping

import numpy as np

from pipeline.nets.windows import Recording
from pipeline.schema.arrays import Floats
from pipeline.submodels.compensation.features import (
    MEASURED,
    REGIMES,
    RESIDUAL,
    before_motion,
    every,
    modelled_following,
    regimes,
)
from pipeline.submodels.compensation.model import (
    ATTENTIVE,
    PREDICTION,
    AttentionShown,
    Compensation,
)
from pipeline.twin.drive import IdentifiedDrive

DRAWN_WINDOWS = 100
"""Windows of a regime over which the attention is averaged, at most [1]."""
PERIOD = 0.001
"""Sampling period of the motion [s]."""
RAMP_S, EVEN_S, STAND_S = 0.1, 0.3, 0.2
"""Acceleration, constant speed and rest of the motion [s]."""


def attention_shown(
    model: Compensation, drives: Mapping[str, IdentifiedDrive]
) -> AttentionShown | None:
    """Attention of the first axis whose network before the motion has any; None without one.

    The motion goes to and fro at half of the highest speed that was learnt; the network sees the
    command and the drives' model alone.
    """
    for letter, uses in model.file.axes.items():
        one, drive = uses.get(PREDICTION), drives.get(letter)
        if one is None or ATTENTIVE not in one.scores:
            continue
        top = _highest(model, letter)
        modelled = drive is not None and drive.servo is not None
        if top > 0 and (modelled or all(entry.name != "modelled error" for entry in one.inputs)):
            return _attended(model, letter, 0.5e-3 * top, drive if modelled else None)
    return None


def _highest(model: Compensation, letter: str) -> float:
    """Highest training speed [mm/s]; 0 where it is not recorded."""
    found = model.file.conditions.get(f"highest speed {letter}")
    return 0.0 if found is None or found.high is None else float(found.high)


def to_and_fro(speed: float) -> Floats:
    """Commanded position [m] every ms, shape (T,): rest, to, back at once, rest."""
    ramp, even, stand = (round(s / PERIOD) for s in (RAMP_S, EVEN_S, STAND_S))
    up = speed * 0.5 * (1 - np.cos(np.pi * np.arange(1, ramp + 1) / ramp))
    there = np.concatenate([up, np.full(even, speed), up[::-1]])
    still = np.zeros(stand)
    return PERIOD * np.cumsum(np.concatenate([still, there, -there, still]))


def _attended(
    model: Compensation, letter: str, speed: float, drive: IdentifiedDrive | None
) -> AttentionShown:
    """Mean attention of the folds' networks by regime."""
    reference = to_and_fro(speed)
    of_model = None if drive is None else modelled_following(letter, reference, PERIOD, drive)
    signals = before_motion(reference, PERIOD, of_model, model.file.lead_mm.get(letter))
    rows = slice(None, None, every(PERIOD, model.file.step_s))
    regime = regimes(signals)[rows]
    on_grid = {name: values[rows] for name, values in signals.items()}
    on_grid[RESIDUAL] = np.zeros(len(regime))
    windows = model.windows(letter, PREDICTION, Recording(
        name="to and fro", step_s=model.file.step_s, signals=on_grid, measured=MEASURED
    ))  # fmt: skip
    weights = {}
    for name in REGIMES:
        of = np.flatnonzero(regime[windows.at] == name)
        of = of[:: max(-(-len(of) // DRAWN_WINDOWS), 1)]
        if len(of):
            found = [
                one.attention(windows.x[of]).mean(axis=0)
                for one in model.networks(letter, PREDICTION, ATTENTIVE)
            ]
            weights[name] = tuple(np.mean(found, axis=0).tolist())
    many = len(next(iter(weights.values()), ()))
    width = 1e3 * model.file.step_s * model.file.length / max(many, 1)
    ms = -width * (np.arange(many)[::-1] + 0.5)
    return AttentionShown(axis=letter, ms=tuple(ms.tolist()), weights=weights)
