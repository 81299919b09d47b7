"""An identified control as it is stored."""

import json
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


_OTHER_FORMS = (
    OSError, ValueError, LookupError, TypeError, AttributeError, cattrs.BaseValidationError,
)  # fmt: skip
"""What reading and taking apart JSON of another form raises."""
