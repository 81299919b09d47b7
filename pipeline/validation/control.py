"""An identified control judged on runs: measured against predicted time, in all and by type."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import Kind
from pipeline.identification.control.overrides import stopped_within
from pipeline.identification.control.programs import Match
from pipeline.identification.control.records import ControlRecords
from pipeline.identification.control.segments import Observed, naive_times, shares
from pipeline.machine.control import ControlParameters
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.program import planned_program

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ControlLimits:
    """What a control's times are judged by.

    Parameters
    ----------
    total_percent : float
        Greatest error of the time of a run that was not learnt from [%].
    """

    total_percent: float = 5.0


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
    compared by type, but have no total to be judged by.
    """
    rows = [
        _run(one, controls[one.unit], records) for match, one in observed if match.whole
    ]
    judged = [r for r in rows if r["role"] == "judged" and r["completed"]]
    errors = [abs(r["error_percent"]) for r in judged]
    return {
        "machine": identity.name,
        "origin": identity.origin,
        "limit_percent": limits.total_percent,
        "passed": max(errors) <= limits.total_percent if errors else None,
        "runs": rows,
        "left_out": [
            {"run": m.run.name, "reason": m.reason} for m in matches if not m.whole
        ],
    }


def _run(one: Observed, control: ControlParameters, records: ControlRecords) -> dict[str, Any]:
    operator = one.operator
    times = planned_program(one.moves, control, one.overrides).time
    as_said = replace(one.overrides, feed=operator.said[one.moves.line])
    said = planned_program(one.moves, control, as_said).time
    rapid = min(a.rapid_speed for a in control.axes.values())
    naive = naive_times(one.moves, operator.feed[one.moves.line], rapid)
    stops, waits = _stops(one, times)
    measured = one.run.end - one.run.start - stops - waits
    until = len(one.moves) if one.run.completed else int(one.after[-1]) if len(one.after) else 0
    predicted, plain, told = (float(t[:until].sum()) for t in (times, naive, said))
    return {
        "run": one.run.name,
        "program": one.program,
        "role": "training" if records.is_training(one.run.recording) else "judged",
        "completed": one.run.completed,
        "measured_s": round(measured, 2),
        "stops_s": round(stops + waits, 2),
        "predicted_s": round(predicted, 2),
        "error_percent": _percent(predicted, measured),
        "naive_s": round(plain, 2),
        "naive_error_percent": _percent(plain, measured),
        "recorded_override_only_error_percent": _percent(told, measured),
        "feed_read_share": round(operator.feed_read, 3),
        "by_type": {
            word: {
                "measured_s": round(float(m), 2),
                "predicted_s": round(float(p), 2),
                "error_percent": _percent(float(p), float(m)),
            }
            for word, (m, p) in shares(one, times).items()
        },
    }


def _stops(one: Observed, times: Floats) -> tuple[float, float]:
    """Time that the machine was held, and time at M0 and M1 beyond the machine's own [s]."""
    run = one.run
    held = float(
        stopped_within(one.operator.stops, np.array([run.start]), np.array([run.end]))[0]
    )
    kinds = one.moves.kind
    waits = 0.0
    for first, after, measured in zip(one.first, one.after, one.measured, strict=True):
        if (kinds[first:after] == Kind.STOP).any():
            waits += max(0.0, float(measured - times[first:after].sum()) - WAIT)
    return held, waits


WAIT = 1.0
"""At M0 and M1 an operator is taken to wait when they last longer than planned by this [s]."""


def _percent(predicted: float, measured: float) -> float | None:
    return round(100 * (predicted / measured - 1), 2) if measured > 0 else None


def control_metrics(document: Mapping[str, Any]) -> dict[str, float | int | str]:
    """Key figures, flat, for ``dvc metrics``."""
    judged = [r for r in document["runs"] if r["role"] == "judged" and r["completed"]]
    errors = [abs(r["error_percent"]) for r in judged if r["error_percent"] is not None]
    verdict = {True: "passed", False: "failed"}.get(document["passed"], "not judged")
    found: dict[str, float | int | str] = {"verdict": verdict, "runs_judged": len(judged)}
    if errors:
        found["worst_error_percent"] = max(errors)
        found["mean_error_percent"] = round(float(np.mean(errors)), 2)
        naive = [abs(r["naive_error_percent"]) for r in judged]
        found["naive_mean_error_percent"] = round(float(np.mean(naive)), 2)
    return found
