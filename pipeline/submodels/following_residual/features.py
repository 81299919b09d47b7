"""Network inputs: a recording beside the drives' model, on the grid of the windows.

Inputs before the motion: the commanded position, its speed and acceleration, how far the axis
has come since it last turned round (friction slides only after some um), the place in a turn of the
screw, and what the drives' model makes of the command: its following error and its torque command.
Measured are the error that the model leaves over and the drive's torque command.  Nothing measured
enters the model's run: it begins at rest before the first commanded position, and what it needs to
settle is not learnt from.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from pipeline.nets.windows import Recording, WindowInput
from pipeline.schema.arrays import Bools, Floats
from pipeline.submodels.following_residual.records import AxisRun, Run
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import driven, driven_by_fuzzy

RESIDUAL = "residual"
"""Measured less modelled following error [m]: what is learnt."""
TORQUE = "torque command"
"""Measured torque command, in its own unit."""
MEASURED = frozenset({RESIDUAL, TORQUE})
"""Signals that are measured during the motion."""
COMMANDED = ("speed", "acceleration", "since reversal")
"""Inputs that the commanded position alone gives: [m/s], [m/s^2], [1] with the direction's sign."""
SCREW = ("screw sine", "screw cosine")
"""Inputs of the place in a turn of the screw [1]."""
MODELLED = ("modelled error", "modelled command")
"""Inputs from the drives' model: [m], in the drive's unit."""
STILL = 1e-5
"""Speed below which an axis stands [m/s]: 0.6 mm/min, below any feed."""
PRESLIDING, SLIDING = 1e-6, 1e-3
"""Range of distances since a reversal that are resolved, by their logarithm [m]."""
TURNED = 1e-4
"""Distance [m] after a reversal within which the regime is that of the reversal."""
SMOOTH_S = 0.008
"""Length of the parabolas through the command that give speed and acceleration [s]."""
RUN_UP_S, RUN_ON_S = 0.5, 0.5
"""Acceleration to the first speed of a recording that begins in motion, and motion at it [s]."""
SERVO_S = 0.00025
"""Longest step of the drives' model [s], that of the simulated programs."""
REST, TURN, BEND, EVEN = "at rest", "after a reversal", "accelerating", "constant speed"
REGIMES = (REST, TURN, BEND, EVEN)
"""Regimes of a commanded motion; "" where the command was not recorded."""
SLIGHT = 0.05
"""Share of the greatest acceleration of a recording up to which speed counts as constant [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Axis in a recording, N samples of the grid of windows."""

    recording: Recording
    """Signals by name, those of ``MEASURED`` among them."""
    group: str
    """Group of the recording in splits."""
    time: Floats
    """Time since the recording began [s]; shape (N,)."""
    measured: Floats
    modelled: Floats
    """Following error [m]; zero where there is no model; shape (N,)."""
    regime: "np.ndarray[Any, np.dtype[np.str_]]"
    """Regime of each sample; shape (N,)."""
    known: Bools
    """Samples that were recorded, neither put in between nor beside such; shape (N,)."""
    fuzzy: Floats | None = None
    """Following error of the drives' model with fuzzy PI [m], where needed; shape (N,)."""
    step: float = 0.0
    """Resolution of the measured position [m]; 0 where its values show none."""


def every(period: float, step_s: float) -> int:
    """Samples of a recording from one row of a window to the next, one at least."""
    return max(round(step_s / period), 1)


def before_motion(
    reference: Floats, period: float, modelled: tuple[Floats, Floats] | None, lead_mm: float | None
) -> dict[str, Floats]:
    """Signals available before the motion, each (T,).

    Commanded position ``reference`` (T,) [m] every ``period`` [s]; ``modelled`` are following error
    [m] and torque command of the drives' model, (T,) each; ``lead_mm`` that of the screw [mm].
    """
    half = max(round(0.5 * SMOOTH_S / period), 2)
    width = min(2 * half + 1, len(reference) - (len(reference) + 1) % 2)
    if width < 3:
        speed = acceleration = np.zeros(len(reference))
    else:
        from scipy.signal import savgol_filter

        speed, acceleration = (
            savgol_filter(reference, width, 2, deriv=order, delta=period) for order in (1, 2)
        )
    found = {
        "speed": speed, "acceleration": acceleration,
        "since reversal": since_reversal(reference, speed),
    }  # fmt: skip
    if lead_mm is not None:
        turn = 2e3 * np.pi * reference / lead_mm
        found |= {"screw sine": np.sin(turn), "screw cosine": np.cos(turn)}
    if modelled is not None:
        found |= dict(zip(MODELLED, modelled, strict=True))
    return found


def since_reversal(reference: Floats, speed: Floats) -> Floats:
    """Direction of the last motion, times the decades of the distance since its reversal; (T,).

    It is 0 before the first motion and from 1 (within a um) to 4 (a millimetre and more) after it.
    """
    direction = np.where(np.abs(speed) > STILL, np.sign(speed), 0.0)
    moving = np.flatnonzero(direction)
    if not len(moving):
        return np.zeros(len(reference))
    last = np.maximum.accumulate(np.where(direction != 0, np.arange(len(reference)), -1))
    held = np.where(last >= 0, direction[np.maximum(last, 0)], 0.0)
    turned = np.flatnonzero(np.diff(held)) + 1
    begin = np.zeros(len(reference), int)
    begin[turned] = turned
    begin = np.maximum.accumulate(begin)
    way = np.clip(np.abs(reference - reference[begin]), 0.0, SLIDING)
    return held * (1.0 + np.log10(1.0 + way / PRESLIDING))


def regimes(signals: Mapping[str, Floats]) -> Any:
    """Regime of each sample from the command alone, shape (T,)."""
    speed, acceleration = np.abs(signals["speed"]), np.abs(signals["acceleration"])
    decades = np.abs(signals["since reversal"]) - 1.0
    near = decades < np.log10(1.0 + TURNED / PRESLIDING)
    bend = acceleration > SLIGHT * acceleration.max(initial=0.0)
    return np.select(
        [speed <= STILL, near & (decades >= 0), bend], [REST, TURN, BEND], default=EVEN
    )


def modelled_following(
    letter: str, reference: Floats, period: float, drive: IdentifiedDrive
) -> tuple[Floats, Floats]:
    """Following error [m] and torque command of the drives' model; each (T,).

    A recording that begins in motion gets a run-up from rest to its first speed, so that the model
    is where an axis is that has moved so for a while.
    """
    whole, rows = _with_run_up(reference, period)
    position, command = driven(letter, drive, whole, period, substeps=_substeps(period))
    return (whole - position)[rows], command[rows]


def fuzzy_following(
    letter: str, reference: Floats, period: float, drive: IdentifiedDrive
) -> Floats:
    """Following error of :func:`modelled_following` with a fuzzy PI speed loop."""
    whole, rows = _with_run_up(reference, period)
    position = driven_by_fuzzy(letter, drive, whole, period, substeps=_substeps(period))
    return (whole - position)[rows]


def _with_run_up(reference: Floats, period: float) -> tuple[Floats, slice]:
    """A command with its run-up, and the rows of the command in it."""
    speed = float(np.diff(reference[:3]).mean()) / period if len(reference) > 1 else 0.0
    up, on = round(RUN_UP_S / period), round(RUN_ON_S / period)
    before = np.concatenate([np.linspace(0.0, speed, up), np.full(on, speed)])
    way = period * np.cumsum(before[::-1])[::-1]
    return np.concatenate([reference[0] - way, reference]), slice(up + on, None)


def _substeps(period: float) -> int:
    return max(ceil(period / SERVO_S * (1 - 1e-6)), 1)


def features_of(
    run: Run, letter: str, drive: IdentifiedDrive | None, *, step_s: float, lead_mm: float | None,
    with_fuzzy: bool = False,
) -> Features:  # fmt: skip
    """Network inputs of an axis of a recording."""
    axis: AxisRun = run.axes[letter]
    stride = every(run.period, step_s)
    signals: dict[str, Floats] = {}
    modelled = np.zeros(len(axis.error))
    regime = np.full(len(axis.error), "")
    fuzzy = None
    if axis.reference is not None:
        of_model = None
        if drive is not None and drive.servo is not None:
            of_model = modelled_following(letter, axis.reference, run.period, drive)
            modelled = of_model[0]
            if with_fuzzy:
                fuzzy = fuzzy_following(letter, axis.reference, run.period, drive)
        signals = before_motion(axis.reference, run.period, of_model, lead_mm)
        regime = regimes(signals)
    signals = {**signals, RESIDUAL: axis.error - modelled}
    if axis.command is not None:
        signals[TORQUE] = axis.command
    rows = slice(None, None, stride)
    beside = np.convolve(axis.filled, np.ones(3), "same") > 0
    time: Floats = np.asarray(run.start + run.period * np.arange(len(axis.error))[rows])
    return Features(
        recording=Recording(
            name=run.name, step_s=stride * run.period, measured=MEASURED,
            signals={name: values[rows] for name, values in signals.items()},
        ),
        group=run.group, time=time, measured=axis.error[rows], modelled=modelled[rows],
        regime=regime[rows], known=~beside[rows], fuzzy=None if fuzzy is None else fuzzy[rows],
        step=axis.step,
    )  # fmt: skip


def inputs_of(features: Sequence[Features], horizon_s: float | None) -> tuple[WindowInput, ...]:
    """Inputs that all recordings have; with a horizon also what was measured before it.

    ``horizon_s`` is the age of the youngest measurement [s]; None for a prediction before the
    motion.
    """
    shared = set.intersection(*(set(one.recording.signals) for one in features))
    known = [WindowInput(name=n) for n in (*COMMANDED, *SCREW, *MODELLED) if n in shared]
    if horizon_s is not None:
        known += [
            WindowInput(name=n, older_than_s=horizon_s) for n in (RESIDUAL, TORQUE) if n in shared
        ]
    return tuple(known)
