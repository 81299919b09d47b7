"""Identified drives judged on recordings: force of the motion, following error of the loop.

Only recordings count that the drives were not identified from, never a part of one that they were.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from pipeline.identification.drive.loads import Factor
from pipeline.identification.drive.records import Recording
from pipeline.identification.drive.settings import DriveFitSettings
from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.drive_file import IdentifiedDrive, drives_of
from pipeline.validation.drive_following import FollowingComparison, following_comparison
from pipeline.validation.drive_force import (
    LEAST,
    ForceComparison,
    constant_level,
    factor_of_load,
    force_comparison,
    in_unit_of_drive,
    relative_error_percent,
)
from pipeline.validation.drive_traces import traces_table

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class DriveLimits:
    """What drives are judged by, on every recording that they were not identified from.

    Parameters
    ----------
    force_percent : float
        Greatest error of the force, of its own size [%].
    following_percent : float
        Greatest error of the following error, RMS of its RMS and maximum of its maximum [%].
    """

    force_percent: float = 15.0
    following_percent: float = 10.0

    def __post_init__(self) -> None:
        for name in ("force_percent", "following_percent"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise ValueError(f"drive_limits.{name} = {value} must be finite and positive")


@dataclass(frozen=True, kw_only=True, eq=False)
class Compared:
    """One axis in one recording.

    Parameters
    ----------
    axis : str
        Its letter.
    recording : Recording
        Where.
    force : ForceComparison
        Recorded against modelled.
    following : FollowingComparison or str
        The same of the following error; or why there is none.
    factor : Factor or None
        Of the recorded load; None where there is none.
    """

    axis: str
    recording: Recording
    force: ForceComparison
    following: FollowingComparison | str
    factor: Factor | None


def drive_verdict(
    document: Mapping[str, Any],
    recordings: Sequence[Recording],
    identity: MachineIdentity,
    settings: DriveFitSettings,
    limits: DriveLimits,
) -> tuple[dict[str, Any], pa.Table]:
    """The content of ``drive_validation.json`` and of ``drive_traces.parquet``.

    Parameters
    ----------
    document : mapping
        The content of ``drive.json``.
    recordings : sequence of Recording
        All of the machine; those that it learnt from are compared and not judged.
    identity : MachineIdentity
        Of the machine.
    settings : DriveFitSettings
        How often the simulated servo runs in a sample.
    limits : DriveLimits
        What the others are judged by.
    """
    drives = drives_of(document)
    found = {
        axis: [_compared(r, axis, drive, settings) for r in recordings if axis in r.axes]
        for axis, drive in drives.items()
    }
    rows = {axis: _rows(found[axis], drives[axis], limits) for axis in drives}
    verdict = [row["status"] for axis in rows for row in rows[axis] if row["role"] == "judged"]
    told = [status for status in verdict if status != "not judged"]
    return {
        "model": "drive",
        "machine": identity.name,
        "origin": identity.origin,
        "passed": all(status == "passed" for status in told) if told else None,
        "reason": "" if told else _why_not(recordings, drives, verdict),
        "limits": {
            "force_percent": limits.force_percent,
            "following_percent": limits.following_percent,
        },
        "axes": rows,
    }, traces_table([one for axis in found for one in found[axis]])


def _why_not(
    recordings: Sequence[Recording], drives: Mapping[str, IdentifiedDrive], verdict: Sequence[str]
) -> str:
    if verdict:
        return "no recording that the drives were not identified from shows enough of an axis"
    shown = sorted({r.file for r in recordings if set(r.axes) & set(drives)})
    mute = [r for r in recordings if not (r.trained or r.axes or r.motor)]
    said = [f"{r.name} shows no axis ({'; '.join(sorted(set(r.lacking.values())))})" for r in mute]
    if len(shown) == 1:
        reason = (
            f"{shown[0]} is the only recording {'of use ' if mute else ''}and the drives were "
            "identified from it: record another to judge them by"
        )
    else:
        reason = (
            f"the drives were identified from all {len(shown)} recordings: leave some out of "
            "drive_records.training, or record others"
        )
    return "; ".join([reason, *said])


def _compared(
    recording: Recording, axis: str, drive: IdentifiedDrive, settings: DriveFitSettings
) -> Compared:
    recording = in_unit_of_drive(recording, axis, drive)
    factor = factor_of_load(recording, axis, drive)
    return Compared(
        axis=axis, recording=recording, force=force_comparison(recording, axis, drive, factor),
        following=following_comparison(recording, axis, drive, settings.substeps, factor),
        factor=factor,
    )  # fmt: skip


def _rows(
    found: Sequence[Compared], drive: IdentifiedDrive, limits: DriveLimits
) -> list[dict[str, Any]]:
    level = constant_level([one.force for one in found if one.recording.trained])
    return [_row(one, drive, level, limits) for one in found]


def _row(
    one: Compared, drive: IdentifiedDrive, level: float, limits: DriveLimits
) -> dict[str, Any]:
    force = _force(one.force, drive.force_unit, level)
    following = None if isinstance(one.following, str) else following_errors(one.following)
    status, reason = _status(one, force, following, limits)
    return {
        "recording": one.recording.name,
        "role": "training" if one.recording.trained else "judged",
        "seconds": round(one.recording.seconds, 3),
        "samples": one.recording.samples,
        "force": force,
        "following": following,
        "load_factor": None if one.factor is None else _factor(one.factor),
        "status": status,
        "reason": reason,
    }


def _status(
    one: Compared,
    force: Mapping[str, Any] | None,
    following: Mapping[str, Any] | None,
    limits: DriveLimits,
) -> tuple[str, str]:
    why = one.following if isinstance(one.following, str) else ""
    if one.recording.trained:
        return "not judged", "; ".join(filter(None, ["the drive was identified from it", why]))
    if force is None:
        return "not judged", f"the axis moves in air for less than {LEAST:g} s"
    over = []
    if force["relative_error_percent"] > limits.force_percent:
        over.append(f"force {force['relative_error_percent']} % > {limits.force_percent:g} %")
    for name, words in (("error_rms_percent", "RMS"), ("error_max_percent", "maximum")):
        share = following[name] if following else None
        if share is not None and share > limits.following_percent:
            over.append(f"following error, {words}: {share} % > {limits.following_percent:g} %")
    return ("failed" if over else "passed"), "; ".join(filter(None, [*over, why]))


def _force(found: ForceComparison, unit: str, level: float) -> dict[str, Any] | None:
    error = relative_error_percent(found.modelled, found.measured)
    if error is None or found.seconds < LEAST:
        return None
    plain = relative_error_percent(level * found.direction, found.measured)
    return {
        "unit": unit,
        "relative_error_percent": round(error, 2),
        "rmse": _digits(_rms(found.modelled - found.measured)),
        "baseline_relative_error_percent": None if plain is None else round(plain, 2),
        "mean_measured": _digits(float(np.mean(found.measured * found.direction))),
        "mean_modelled": _digits(float(np.mean(found.modelled * found.direction))),
    }


def following_errors(found: FollowingComparison) -> dict[str, float | None]:
    """Figures of a following error [um], and of its model's error [um, % of its own]."""
    error = found.modelled - found.measured
    rms, most = _rms(found.measured), float(np.abs(found.measured).max())
    error_most = float(np.abs(error).max())
    return {
        "rms_um": _digits(1e6 * rms),
        "max_um": _digits(1e6 * most),
        "error_rms_um": _digits(1e6 * _rms(error)),
        "error_max_um": _digits(1e6 * error_most),
        "error_rms_percent": round(100 * _rms(error) / rms, 2) if rms > 0 else None,
        "error_max_percent": round(100 * error_most / most, 2) if most > 0 else None,
        "baseline_error_rms_um": _digits(1e6 * _rms(found.guessed - found.measured)),
    }


def drive_metrics(document: Mapping[str, Any]) -> dict[str, float | int | str]:
    """Key figures, flat, for ``dvc metrics``."""
    verdict = {True: "passed", False: "failed"}.get(document["passed"], "not judged")
    rows = [
        row for axis in document["axes"].values() for row in axis if row["status"] != "not judged"
    ]
    found: dict[str, float | int | str] = {"verdict": verdict, "axes_judged": len(rows)}
    for part, name in (("force", "relative_error_percent"), ("following", "error_rms_percent")):
        errors = [row[part][name] for row in rows if row[part] and row[part][name] is not None]
        if errors:
            found[f"worst_{part}_error_percent"] = max(errors)
            found[f"mean_{part}_error_percent"] = round(float(np.mean(errors)), 2)
    return found


def _factor(factor: Factor) -> dict[str, float | None]:
    """Without an interval where it was taken and not found."""
    told = np.isfinite(factor.half_width)
    return {
        "value": _digits(factor.value),
        "half_width": _digits(factor.half_width) if told else None,
    }


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _digits(value: float) -> float:
    return float(f"{value:.4g}")
