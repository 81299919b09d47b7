"""An identified control as it is stored."""

import json
from collections.abc import Mapping
from pathlib import Path

import cattrs

from pipeline.machine.control import ControlParameters


def read_controls(path: Path) -> dict[str, ControlParameters]:
    """Controls in a ``control.json``, by unit ("" where a machine is one).

    Raises
    ------
    ValueError
        When the file is none, or of another form.
    """
    converter = cattrs.Converter(forbid_extra_keys=True)
    converter.register_structure_hook(float, lambda value, _: float(value))
    try:
        controls = json.loads(path.read_text())["control"]
        return {u: converter.structure(c, ControlParameters) for u, c in controls.items()}
    except _OTHER_FORMS as error:
        raise ValueError(
            f"{path} is no identified control ({type(error).__name__}): run `dvc repro` to write it"
        ) from error


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


_OTHER_FORMS = (
    OSError, ValueError, LookupError, TypeError, AttributeError, cattrs.BaseValidationError,
)  # fmt: skip
"""What reading and taking apart JSON of another form raises."""
