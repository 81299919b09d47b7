"""Facts about the feed drives: parameters by axis, how well they rebuild records, traces."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from pipeline.charts.numbers import real
from pipeline.charts.sources import Shelf, dig, objects_of, rows_of, words_of
from pipeline.report.drive_traces import JUDGED, DriveTrace, drive_traces
from pipeline.report.folders import MachineFolders

RECORDS = "records of the servo drives"


@dataclass(frozen=True, kw_only=True)
class DriveRun:
    """One axis in one recording, held against the twin.

    Parameters
    ----------
    axis, recording, role, reason : str
        Which, ``judged`` or ``training``, why it was not judged or failed.
    seconds : float or None
        Length [s].
    force, following : dict
        Errors of the force by inverse dynamics and of the following error in closed loop; empty
        where the recording does not show them.
    status : {"passed", "failed", "unknown"}
        ``unknown`` where it does not count.
    """

    axis: str
    recording: str
    role: str
    seconds: float | None
    force: dict[str, Any]
    following: dict[str, Any]
    status: Literal["passed", "failed", "unknown"]
    reason: str

    @property
    def judged(self) -> bool:
        """Whether it counts: nothing was learnt from it, and it could be judged."""
        return self.role == "judged" and self.status != "unknown"

    @property
    def force_error(self) -> float | None:
        """Error of the force over the measured force [%]."""
        return real(self.force.get("relative_error_percent"))

    @property
    def following_error(self) -> float | None:
        """RMS error of the following error over its own RMS [%]."""
        return real(self.following.get("error_rms_percent"))


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What is known of the drives; None where the file that would say it is absent."""

    drive: dict[str, Any] | None = None
    validation: dict[str, Any] | None = None
    traces: list[DriveTrace] = field(default_factory=list)

    @property
    def axes(self) -> dict[str, dict[str, Any]]:
        """What was found of each axis, by its letter."""
        return dict(sorted(objects_of(self.drive, "axes").items()))

    @property
    def runs(self) -> list[DriveRun]:
        """Every axis in every recording: by axis, the judged first, then by name."""
        rows = dig(self.validation, "axes")
        names = sorted(str(axis) for axis in rows) if isinstance(rows, dict) else []
        runs = [_run(axis, row) for axis in names for row in rows_of(rows, axis)]
        return sorted(runs, key=lambda r: (r.axis, r.role == "training", r.recording))

    @property
    def judged(self) -> list[DriveRun]:
        """Those that count."""
        return [run for run in self.runs if run.judged]

    @property
    def force_limit(self) -> float | None:
        """Largest error of the force that passes [%]."""
        return real(dig(self.validation, "limits", "force_percent"))

    @property
    def following_limit(self) -> float | None:
        """Largest error of the following error that passes [%]."""
        return real(dig(self.validation, "limits", "following_percent"))

    @property
    def training(self) -> list[dict[str, Any]]:
        """Recordings that the parameters were found from: name, length, what was done to each."""
        named = rows_of(self.drive, "recordings", "training")
        return named or [{"recording": w} for w in words_of(self.drive, "recordings", "training")]

    @property
    def undetermined(self) -> list[str]:
        """Axis and name of every parameter that the records do not determine."""
        return [
            f"{axis} {name}" for axis, found in self.axes.items()
            for name, p in objects_of(found, "parameters").items() if not p.get("determined")
        ]  # fmt: skip

    def telling(self, axis: str) -> DriveTrace | None:
        """The trace of an axis that says most: judged before learnt from, then the longest."""
        ranked = {
            run.recording: (run.judged, run.role != "training", run.seconds or 0.0)
            for run in self.runs if run.axis == axis
        }  # fmt: skip
        traces = [t for t in self.traces if t.axis == axis and len(t.seconds) > 1]
        return max(
            traces,
            key=lambda t: ranked.get(t.recording, (False, False, float(np.ptp(t.seconds)))),
            default=None,
        )


def worst_force(runs: list[DriveRun]) -> DriveRun | None:
    """The run whose force is wrong most; None without any."""
    return max((r for r in runs if r.force_error is not None),
               key=lambda r: r.force_error or 0.0, default=None)  # fmt: skip


def worst_following(runs: list[DriveRun]) -> DriveRun | None:
    """The run whose following error is wrong most; None without any."""
    return max((r for r in runs if r.following_error is not None),
               key=lambda r: r.following_error or 0.0, default=None)  # fmt: skip


def _run(axis: str, row: dict[str, Any]) -> DriveRun:
    force, following = row.get("force"), row.get("following")
    status = row.get("status")
    return DriveRun(
        axis=axis,
        recording=str(row.get("recording") or ""),
        role=str(row.get("role") or ""),
        seconds=real(row.get("seconds")),
        force=force if isinstance(force, dict) else {},
        following=following if isinstance(following, dict) else {},
        status=status if status in ("passed", "failed") else "unknown",
        reason=str(row.get("reason") or ""),
    )


def driven(folders: MachineFolders, shelf: Shelf) -> Driven:
    """What the files of the drives and of their judgement say."""
    return Driven(
        drive=shelf.document(folders.models / "drive.json", RECORDS),
        validation=shelf.document(folders.models / "drive_validation.json", JUDGED),
        traces=drive_traces(folders, shelf),
    )
