"""An identified control judged on runs: measured against predicted time, in all and by type."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import FeedMode, Kind, Moves
from pipeline.identification.control.programs import Match
from pipeline.identification.control.records import ControlRecords
from pipeline.identification.control.segments import Observed, shares
from pipeline.identification.control.spans import stopped_within
from pipeline.machine.control import ControlParameters
from pipeline.machine.spindle import CUTTING
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.control import control_of_unit
from pipeline.twin.program import planned_program

Floats = NDArray[np.float64]

WAIT = 1.0
"""At M0 and M1 an operator is taken to wait when they last longer than planned by this [s]."""


@dataclass(frozen=True, kw_only=True)
class ControlLimits:
    """What a control's times are judged by.

    Parameters
    ----------
    total_percent : float
        Greatest error of the time of a run that was not learnt from [%].
    """

    total_percent: float = 5.0

    def __post_init__(self) -> None:
        if not self.total_percent >= 0:
            raise ValueError(
                f"control_limits.total_percent = {self.total_percent} must be at least 0"
            )


def control_verdict(
    matches: Sequence[Match],
    observed: Sequence[tuple[Match, Observed]],
    controls: Mapping[str, ControlParameters],
    records: ControlRecords,
    identity: MachineIdentity,
    limits: ControlLimits,
) -> dict[str, Any]:
    """The content of ``control_validation.json``.

    Runs of another revision of a program are listed as left out; runs that were aborted are
    compared up to the last line that was seen, and not judged.

    Parameters
    ----------
    matches : sequence of Match
        Every run.
    observed : sequence of (Match, Observed)
        Segments of those that were matched.
    controls : mapping of str to ControlParameters
        By unit.
    records : ControlRecords
        Which runs the control was identified from.
    identity : MachineIdentity
        Of the machine.
    limits : ControlLimits
        What the others are judged by.
    """
    rows = [
        _run(one, control_of_unit(controls, one.unit), records)
        for match, one in observed
        if match.whole
    ]
    errors = [abs(r["error_percent"]) for r in _judged(rows)]
    return {
        "machine": identity.name,
        "origin": identity.origin,
        "limit_percent": limits.total_percent,
        "passed": max(errors) <= limits.total_percent if errors else None,
        "runs": rows,
        "left_out": [{"run": m.run.name, "reason": m.reason} for m in matches if not m.whole],
    }


def control_metrics(document: Mapping[str, Any]) -> dict[str, float | int | str]:
    """Key figures, flat, for ``dvc metrics``."""
    judged = _judged(document["runs"])
    verdict = {True: "passed", False: "failed"}.get(document["passed"], "not judged")
    found: dict[str, float | int | str] = {"verdict": verdict, "runs_judged": len(judged)}
    if judged:
        errors = [abs(r["error_percent"]) for r in judged]
        naive = [abs(r["naive_error_percent"]) for r in judged]
        found["worst_error_percent"] = max(errors)
        found["mean_error_percent"] = round(float(np.mean(errors)), 2)
        found["naive_mean_error_percent"] = round(float(np.mean(naive)), 2)
    return found


def _judged(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    return [
        r for r in rows
        if r["role"] == "judged" and r["completed"] and r["error_percent"] is not None
    ]  # fmt: skip


def _run(one: Observed, control: ControlParameters, records: ControlRecords) -> dict[str, Any]:
    times = planned_program(one.moves, control, one.overrides).time
    as_said = replace(one.overrides, feed=one.operator.said[one.moves.line])
    said = planned_program(one.moves, control, as_said).time
    rapid = min(axis.rapid_speed for axis in control.axes.values())
    naive = naive_times(one.moves, one.operator.feed[one.moves.line], rapid)
    end, until = _seen_until(one)
    stops = _stops(one, times, end)
    measured = end - one.run.start - stops
    predicted, plain, told = (float(t[:until].sum()) for t in (times, naive, said))
    return {
        "run": one.run.name,
        "program": one.program,
        "role": "training" if records.is_training(one.run.recording) else "judged",
        "completed": one.run.completed,
        "measured_s": round(measured, 2),
        "stops_s": round(stops, 2),
        "predicted_s": round(predicted, 2),
        "error_percent": _percent(predicted, measured),
        "naive_s": round(plain, 2),
        "naive_error_percent": _percent(plain, measured),
        "recorded_override_only_error_percent": _percent(told, measured),
        "feed_read_share": round(one.operator.feed_read, 3),
        "by_type": {
            word: {
                "measured_s": round(m, 2),
                "predicted_s": round(p, 2),
                "error_percent": _percent(p, m),
            }
            for word, (m, p) in shares(one, times).items()
        },
    }


def naive_times(moves: Moves, feed_factor: Floats, rapid_speed: float) -> Floats:
    """Path over programmed feed, without acceleration or waiting: what simple estimators do [s].

    Parameters
    ----------
    moves : Moves
        Of the program.
    feed_factor : ndarray, shape (rows,)
        Feed override [1].
    rapid_speed : float
        Of rapids, and of cuts whose feed is not in mm/min [mm/min].
    """
    cutting = np.isin(moves.kind, CUTTING)
    timed = cutting & (moves.feed > 0) & (moves.feed_mode == FeedMode.PER_MINUTE)
    speed = np.where(timed, moves.feed * feed_factor, rapid_speed)
    times: Floats = np.where(cutting | (moves.kind == Kind.RAPID), moves.length / speed * 60, 0.0)
    return times


def _seen_until(one: Observed) -> tuple[float, int]:
    """When the last line was seen [s], and the rows executed until then."""
    if one.run.completed or not len(one.after):
        return one.run.end, len(one.moves) if one.run.completed else 0
    return float(one.end[-1]), int(one.after[-1])


def _stops(one: Observed, times: Floats, end: float) -> float:
    """Time that the machine was held, and time at M0 and M1 beyond the machine's own [s].

    Parameters
    ----------
    one : Observed
        The run.
    times : ndarray, shape (rows,)
        Predicted time of each row [s].
    end : float
        Until when [s].
    """
    start = np.array([one.run.start])
    stopped = float(stopped_within(one.operator.stops, start, np.array([end]))[0])
    for first, after, measured in zip(one.first, one.after, one.measured, strict=True):
        rows = slice(first, after)
        if (one.moves.kind[rows] == Kind.STOP).any():
            stopped += max(0.0, float(measured - times[rows].sum()) - WAIT)
    return stopped


def _percent(predicted: float, measured: float) -> float | None:
    return round(100 * (predicted / measured - 1), 2) if measured > 0 else None
