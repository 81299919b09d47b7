"""PI against fuzzy PI as the speed loop of one drive: step, load and ramps (Feed2025).

Both stand around the same motor, shaft, friction and limits, and both can be tuned by the same
search with the same number of trials for the same cost: the integral of time times absolute speed
error over a step of the speed and over a step of the load, each counted from its own start, up and
down.  All of it is simulated.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np
import numpy.typing as npt
import pandas as pd

from pipeline.machine.fuzzy_pi import FuzzyParameters
from pipeline.twin.speed_trial import SpeedTrial, ramp_error, step_response
from pipeline.twin.three_loop_parameters import ThreeLoopParameters

Floats = npt.NDArray[np.float64]

TUNED = {
    "PI": {"proportional": (0.05, 10.0), "integral": (2.0, 4000.0)},
    "fuzzy PI": {
        "proportional": (0.05, 10.0),
        "integral": (2.0, 4000.0),
        "error_scale": (0.01, 10.0),
        "change_scale": (1e-5, 1e-1),
    },
}
"""Bounds of what is tuned: gains (for fuzzy the output scales, middle and span together), and the
input scales; all on a logarithmic scale."""


class Found(Protocol):
    """What a search hands back."""

    @property
    def x(self) -> Floats:
        """The best individual, shape (D,)."""


Search = Callable[[Callable[[Floats], Floats], Floats, Floats], Found]
"""Takes costs (P, D) -> (P,) and both bounds, shape (D,)."""


def with_speed_loop(drive: ThreeLoopParameters, kind: str, values: Floats) -> ThreeLoopParameters:
    """Return the drive with a speed loop of a kind of ``TUNED`` and these values, shape (D,)."""
    named = dict(zip(TUNED[kind], map(float, values), strict=True))
    fuzzy = None
    if "error_scale" in named:
        fuzzy = FuzzyParameters(
            error_scale=named["error_scale"], change_scale=named["change_scale"]
        )
    loop = replace(
        drive.speed_loop,
        proportional=named["proportional"],
        integral=named["integral"],
        fuzzy=fuzzy,
    )
    return replace(drive, speed_loop=loop)


def published(drive: ThreeLoopParameters, kind: str, trial: SpeedTrial) -> Floats:
    """Return Feed2025's gains, and input scales that the step and its acceleration just fill.

    The input scales are not published; full torque on the whole inertia is the greatest change.
    """
    inertia = drive.motor.inertia + drive.transmission.load_inertia
    fastest = drive.speed_loop.torque_limit / inertia
    values = [0.5, 40.0, 10 / trial.speed, 10 / fastest]
    return np.array(values[: len(TUNED[kind])])


def tuned(
    drive: ThreeLoopParameters, kind: str, trial: SpeedTrial, search: Search
) -> ThreeLoopParameters:
    """Return the drive with the speed loop that a search finds best.

    Parameters
    ----------
    drive : ThreeLoopParameters
        The axis.
    kind : str
        Of ``TUNED``.
    trial : SpeedTrial
        What gives the cost.
    search : callable
        Takes costs over a population and both bounds, and hands back what has the best as ``x``;
        it walks over logarithms to the base 10.
    """

    def costs(logarithms: Floats) -> Floats:
        drives = [with_speed_loop(drive, kind, 10.0**x) for x in logarithms]
        both = [[step_response(one, trial, sign).cost for sign in (1, -1)] for one in drives]
        return np.sum(both, axis=1)

    low, high = np.log10(np.array(list(TUNED[kind].values()))).T
    return with_speed_loop(drive, kind, 10.0 ** search(costs, low, high).x)


def compare_speed_loops(
    drive: ThreeLoopParameters, trial: SpeedTrial, search: Search | None = None
) -> pd.DataFrame:
    """Return PI and fuzzy PI side by side, with Feed2025's gains and tuned.

    Parameters
    ----------
    drive : ThreeLoopParameters
        The axis.
    trial : SpeedTrial
        What they are put through.
    search : callable, optional
        As in :func:`tuned`; without it only Feed2025's gains are compared.

    Returns
    -------
    DataFrame
        A row each for gains, speed loop and direction of the step.  Its columns carry their units;
        errors of the ramps are the carriage's, without and with feed-forward of the velocity.
    """
    rows = []
    for kind in TUNED:
        loops = {"Feed2025": with_speed_loop(drive, kind, published(drive, kind, trial))}
        if search is not None:
            loops["tuned"] = tuned(drive, kind, trial, search)
        for gains, one in loops.items():
            for direction in (1, -1):
                head = {"gains": gains, "speed loop": kind, "direction": direction}
                rows.append(head | _figures(one, trial, direction))
    return pd.DataFrame(rows).set_index(["gains", "speed loop", "direction"]).sort_index()


def _figures(drive: ThreeLoopParameters, trial: SpeedTrial, direction: int) -> dict[str, float]:
    step = step_response(drive, trial, direction)
    found = {
        "settling to 2 % [ms]": 1e3 * step.settling_2,
        "settling to 0.1 % [ms]": 1e3 * step.settling_01,
        "overshoot [%]": 100 * step.overshoot,
        "dip under load [%]": 100 * step.dip,
        "recovery [ms]": 1e3 * step.recovery,
        "cost [mrad s]": 1e3 * step.cost,
    }
    for feed in trial.feeds:
        for feedforward in (0, 1):
            error = ramp_error(drive, feed, trial, feedforward=feedforward, direction=direction)
            name = f"error at {60e3 * feed:g} mm/min, feed-forward {feedforward} [mm]"
            found[name] = 1e3 * error
    return found
