"""Identified drives as they are stored."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cattrs

from pipeline.machine.axis.feed_drive import FeedDriveParameters
from pipeline.machine.axis.servo import ServoParameters


@dataclass(frozen=True, kw_only=True)
class IdentifiedDrive:
    """One axis of a ``drive.json``.

    Parameters
    ----------
    feed_drive : FeedDriveParameters
        Its mechanics.
    servo : ServoParameters or None
        Its loops; None where the records do not tell them.
    command_unit, force_unit : str
        Of its command; of forces, the command's where nobody knows the force constant.
    servo_reason : str
        Why there is no servo.
    bandwidth_Hz : float or None
        Below which its motion and force were compared [Hz]; None for no filter.
    delay : float
        How long its motion is behind its command [s].
    """

    feed_drive: FeedDriveParameters
    servo: ServoParameters | None
    command_unit: str
    force_unit: str
    servo_reason: str = ""
    bandwidth_Hz: float | None = None
    delay: float = 0.0


def read_drives(path: Path) -> dict[str, IdentifiedDrive]:
    """Axes in a ``drive.json``, by letter.

    Raises
    ------
    ValueError
        When the file is none, or of another form.
    """
    try:
        return drives_of(json.loads(path.read_text()))
    except (OSError, ValueError) as error:
        raise ValueError(
            f"{path} holds no identified drives ({type(error).__name__}): run `dvc repro` to "
            "write it"
        ) from error


def drives_of(document: Mapping[str, Any]) -> dict[str, IdentifiedDrive]:
    """Axes of the content of a ``drive.json``, by letter.

    Raises
    ------
    ValueError
        When it is of another form.
    """
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook(float, lambda value, _: float(value))
    try:
        return {letter: _axis(entry, converter) for letter, entry in document["axes"].items()}
    except _OTHER_FORMS as error:
        raise ValueError(
            f"the document holds no identified drives ({type(error).__name__}): write it anew with "
            "`dvc repro`"
        ) from error


def _axis(entry: Mapping[str, Any], converter: cattrs.Converter) -> IdentifiedDrive:
    drive, fit = entry["drive"], entry["fit"]
    servo = drive["servo"]
    return IdentifiedDrive(
        feed_drive=converter.structure(drive["feed_drive"], FeedDriveParameters),
        servo=None if servo is None else converter.structure(servo, ServoParameters),
        command_unit=str(entry["command_unit"]),
        force_unit=str(entry["force_unit"]),
        servo_reason=str(drive.get("servo_reason") or ""),
        bandwidth_Hz=fit.get("bandwidth_Hz"),
        delay=float(fit.get("delay_s") or 0.0),
    )


_OTHER_FORMS = (
    ValueError, LookupError, TypeError, AttributeError, cattrs.BaseValidationError,
)  # fmt: skip
"""What taking apart JSON of another form raises."""
