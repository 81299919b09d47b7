"""Records of the drives of a simulated machine, and the truth about them."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.shop.drive_axis import hidden, truth
from pipeline.shop.motor_records import write_motor
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.servo_records import write_servo


def write_drives(folder: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``servo/*.csv`` and ``motor/*.csv`` into ``folder``, when the drives are recorded.

    Returns
    -------
    dict
        ``axes``: what a model of one mass should find of each, in SI; ``motor``: the same of the
        motor of X; ``more``: what such a model leaves out, the tool, the files and their dirt.
        Nothing when the drives are not recorded.
    """
    drives = parameters.drives
    if not drives.recorded:
        return {}
    files = write_servo(folder, parameters)
    motor, file = write_motor(folder, parameters)
    return {
        "axes": {letter: truth(axis) for letter, axis in drives.axes.items()},
        "motor": motor,
        "more": {
            "axes": {letter: hidden(axis) for letter, axis in drives.axes.items()},
            "tool": asdict(drives.tool),
            "files": [*files, file],
        },
    }
