"""Identified control as it is stored."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.machine.control.parameters import ControlParameters
from pipeline.schema.model import Correlation, Model
from pipeline.schema.store import read_json


@dataclass(frozen=True, kw_only=True)
class ControlFitFacts:
    """How well a control explains the durations of segments.

    Parameters
    ----------
    rmse_s : float or None
        Of the residuals, without outliers beyond 10 times the noise [s].
    segments : int
        Number of segments.
    condition : float or None
        Condition number of the scaled Jacobian [1].
    correlation : Correlation
        Of the parameters that were fitted to durations.
    """

    rmse_s: float | None
    segments: int
    condition: float | None
    correlation: Correlation


@dataclass(frozen=True, kw_only=True)
class ControlModelFile(Model):
    """The content of a control's ``model.json``.

    Parameters
    ----------
    control : mapping of str to ControlParameters
        By unit, where several machines of a kind are taken as one; else by ``""``.
    fit : ControlFitFacts
        How well they fit.
    programs : mapping of str to str
        Program that each training run executed.
    """

    control: Mapping[str, ControlParameters]
    fit: ControlFitFacts
    programs: Mapping[str, str]


def read_controls(path: Path) -> dict[str, ControlParameters]:
    """Controls in a ``model.json``, by unit ("" where a machine is one).

    Raises
    ------
    StoreError
        When the file is missing or of another form.
    """
    return dict(read_json(path, ControlModelFile).control)


def control_of_unit(controls: Mapping[str, ControlParameters], unit: str) -> ControlParameters:
    """The control that was identified for ``unit``.

    Raises
    ------
    ValueError
        When none was; the message names those there are.
    """
    if unit not in controls:
        known = ", ".join(repr(name) for name in sorted(controls)) or "none"
        raise ValueError(
            f"no control was identified for unit {unit!r}, there are {known}: "
            "name one of them, or let it learn from a run of that unit"
        )
    return controls[unit]
