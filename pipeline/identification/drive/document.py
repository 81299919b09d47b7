"""What is stored of identified drives: numbers, intervals, curves, and where they are from."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.fit import FeedDriveFit
from pipeline.identification.drive.identify import DrivesFound, MassTrace
from pipeline.identification.drive.motor import MotorFit
from pipeline.identification.drive.servo import ServoFit
from pipeline.machine.axis.friction import friction_force
from pipeline.signals.ingest import MachineIdentity

Floats = NDArray[np.float64]

CURVE = 40
"""Speeds of the curve in each direction."""
MOTOR_HOW = "least squares on voltage equations integrated over windows"
MOTOR_REMEDY = (
    "record voltages, currents and speed of the motor under steps of speed and load, i_d among them"
)


def drive_document(identity: MachineIdentity, found: DrivesFound) -> dict[str, Any]:
    """The content of ``drive.json``."""
    return {
        "model": "drive",
        "machine": identity.name,
        "origin": identity.origin,
        "axes": {
            letter: _axis(fit, found.servos.get(letter), found.masses.get(letter))
            for letter, fit in found.feed_drives.items()
        },
        "motor": None if found.motor is None else _motor(found.motor, found.motor_axis),
        "recordings": {
            "training": [
                {"recording": one.name, "seconds": _rounded(one.seconds, 3),
                 "notes": list(one.notes)}
                for one in found.recordings
                if one.trained and one.axes
            ],
            "left_out": _left_out(found),
        },
        "found_from": {
            one.file: one.sha256
            for one in found.recordings
            if (one.trained and one.axes) or one.motor
        },
    }  # fmt: skip


def _axis(fit: FeedDriveFit, servo: ServoFit | None, mass: MassTrace | None) -> dict[str, Any]:
    parameters = _parameters(fit)
    methods = [_method(one) for one in fit.methods]
    if servo is not None:
        parameters |= _parameters(servo)
        methods += [_method(one) for one in servo.methods]
    loops = None if servo is None or servo.servo is None else servo.servo
    return {
        "command_unit": fit.command_unit,
        "force_unit": fit.force_unit,
        "parameters": parameters,
        "drive": {
            "servo": None if loops is None else asdict(loops, dict_factory=_without_infinite),
            "servo_reason": "" if servo is None else servo.reason,
            "feed_drive": asdict(fit.feed_drive),
        },
        "friction_points": [
            {
                "velocity_mm_s": _digits(1e3 * one.velocity), "force": _digits(one.force),
                "half_width": _digits(one.half_width), "seconds": _rounded(one.seconds, 3),
            }
            for one in fit.points
        ],
        "friction_curve": _curve(fit),
        "methods": methods,
        "fit": {**_facts(fit), "delay_s": _digits(fit.delay)},
        "servo_fit": None if servo is None else _facts(servo),
        "recursive": None if mass is None else _recursive(mass),
    }  # fmt: skip


def _parameters(fit: FeedDriveFit | ServoFit) -> dict[str, dict[str, Any]]:
    found = {}
    for i, name in enumerate(fit.names):
        known = bool(fit.determined[i])
        found[name] = {
            "value": _digits(fit.values[i]) if known else None,
            "unit": fit.units[i],
            "low": _digits(fit.low[i]) if known else None,
            "high": _digits(fit.high[i]) if known else None,
            "determined": known,
            "how": fit.how[i],
            "remedy": None if known else fit.remedy[i],
        }
    return found


def _facts(fit: FeedDriveFit | ServoFit) -> dict[str, Any]:
    return {
        "samples": fit.samples,
        "relative_error_percent": _rounded(fit.relative_error_percent, 3),
        "bandwidth_Hz": _digits(fit.bandwidth_Hz),
        "condition": _digits(fit.condition),
        "rank": fit.rank,
        "correlation": {
            "names": list(fit.correlated),
            "values": np.round(fit.correlation, 3).tolist(),
        },
    }


def _method(one: Mapping[str, Any]) -> dict[str, Any]:
    return {**one, "error": _digits(one["error"])}


def _curve(fit: FeedDriveFit) -> list[dict[str, Any]]:
    """Friction and offset over speed, from the slowest to the fastest point in each direction."""
    speeds = np.abs([one.velocity for one in fit.points])
    if not len(speeds):
        return []
    ways = np.geomspace(0.8 * speeds.min(), speeds.max(), CURVE)
    velocity = np.r_[-ways[::-1], ways]
    force = friction_force(velocity, fit.feed_drive.friction) + fit.feed_drive.offset
    return [
        {"velocity_mm_s": _digits(1e3 * v), "force": _digits(f)}
        for v, f in zip(velocity.tolist(), force.tolist(), strict=True)
    ]


def _recursive(mass: MassTrace) -> dict[str, Any]:
    return {
        "recording": mass.recording,
        "quantity": "mass",
        "unit": mass.unit,
        "time_s": [_rounded(t, 4) for t in mass.time.tolist()],
        "value": [_digits(v) for v in mass.value.tolist()],
        "half_width": [_digits(h) for h in mass.half_width.tolist()],
    }


def _motor(fit: MotorFit, axis: str) -> dict[str, Any]:
    names = {"resistance": "R", "inductance_d": "L_d", "inductance_q": "L_q"}
    parameters = {}
    for i, name in enumerate(fit.names):
        known = bool(fit.determined[i])
        parameters[names.get(name, name)] = {
            "value": _digits(fit.values[i]) if known else None,
            "unit": fit.units[i],
            "low": _digits(fit.low[i]) if known else None,
            "high": _digits(fit.high[i]) if known else None,
            "determined": known,
            "how": MOTOR_HOW if known else fit.reasons.get(name, "not determined"),
            "remedy": None if known else MOTOR_REMEDY,
        }
    return {
        "axis": axis,
        "parameters": parameters,
        "fit": {
            "windows": fit.windows,
            "left_out": fit.left_out,
            "condition": _digits(fit.condition),
            "correlation": {
                "names": [names.get(name, name) for name in fit.names],
                "values": _matrix(fit.correlation),
            },
        },
    }


def _left_out(found: DrivesFound) -> list[dict[str, str]]:
    """Recordings that show no axis or another servo, axes that no training recording shows."""
    rows = [
        {"recording": one.name, "reason": "; ".join(sorted(set(one.lacking.values())))}
        for one in found.recordings
        if not one.axes and not one.motor
    ]
    rows += [
        {"recording": "all of them", "reason": f"axis {axis}: {why}"}
        for axis, why in found.open_axes.items()
    ]
    rows += [
        {
            "recording": name,
            "reason": f"servo of axis {axis}: taken with other gains than the first recording",
        }
        for axis, servo in found.servos.items()
        for name in servo.left_out
    ]
    if found.motor_reason:
        rows.append({"recording": "the motor's", "reason": found.motor_reason})
    return rows


def _matrix(values: Floats) -> list[list[float | None]]:
    rows: Sequence[Sequence[float]] = values.tolist()
    return [[_rounded(one, 3) for one in row] for row in rows]


def _without_infinite(items: list[tuple[str, Any]]) -> dict[str, Any]:
    """What JSON has numbers for: a limit that is infinite is so by default."""
    return {k: v for k, v in items if not (isinstance(v, float) and np.isinf(v))}


def _digits(value: float) -> float | None:
    return float(f"{value:.5g}") if np.isfinite(value) else None


def _rounded(value: float, digits: int) -> float | None:
    return round(float(value), digits) if np.isfinite(value) else None
