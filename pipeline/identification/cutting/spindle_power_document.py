"""What is stored of a spindle's power: the part ``spindle`` of cutting.json."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.identification.cutting.spindle_power import SpecificForce
from pipeline.identification.cutting.spindle_power_no_load import NoLoad
from pipeline.identification.cutting.spindle_power_regression import Regression

RPM = 60.0
N_MM2 = 1e6
N_MM = 1e3
UNITS = ("WATT", "W s", "W s^2")
NAMES = ("p0", "p1", "p2")
HOW = "least squares on levels of constant speed; noise and rounding of the display counted"


def spindle_document(
    idle: NoLoad | None, force: SpecificForce | None, *, recordings: Sequence[str],
    widest: float, reason: str = "", assumed: str = "", scale_error: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """The part ``spindle`` of cutting.json.

    Parameters
    ----------
    idle, force : NoLoad, SpecificForce, optional
        What was found.
    recordings : sequence of str
        Found from.
    widest : float
        Half of a 95 % interval wider than this share of its value is no determination.
    reason : str
        Why something was not found.
    assumed : str
        What the load is a percentage of, the rated power and the efficiency.
    scale_error : float
        Half of the 95 % interval of the power that a load stands for, as a share [1]; all results
        scale with it, and their intervals hold it.
    """
    document: dict[str, Any] = {
        "recordings": list(recordings),
        "reason": reason,
        "assumed": assumed,
    }
    if idle is not None:
        document["no_load"] = {
            "coefficients": {
                name: parameter(idle.fit, i, 1.0, unit, widest, HOW, scale_error)
                for i, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
                if i < len(idle.fit.values)
            },
            "range_rpm": [round(idle.lowest * RPM, 1), round(idle.highest * RPM, 1)],
            "curve": [
                {
                    "speed_rpm": round(float(n) * RPM, 1),
                    "power_W": round(float(idle.power(n)), 2),
                    "half_width_95_W": round(
                        float(np.hypot(idle.half_width(n), scale_error * idle.power(n))), 2
                    ),
                    "measured_W": round(float(measured), 2),
                }
                for n, measured in zip(idle.levels.speed, idle.levels.power, strict=True)
                if np.isfinite(idle.half_width(n))
            ],
        }
    if force is not None:
        how = (
            f"power of {force.cuts} levels of cutting over what they remove, each for the same "
            "time, edge force included"
        )
        half = float(np.hypot(force.half_width, scale_error * force.value))
        document["specific_force"] = _stored(
            force.value / N_MM2, half / N_MM2, "N/mm^2", widest, how, ""
        )
        how = f"least squares on {force.cuts} levels of cutting, no-load power taken off"
        if force.edge is not None:
            how += f", edge force of {force.edge[0] / N_MM:.3g} N/mm known"
        document["K_tc"] = parameter(force.fit, 0, N_MM2, "N/mm^2", widest, how, scale_error)
        if len(force.fit.values) > 1:
            document["K_te"] = parameter(force.fit, 1, N_MM, "N/mm", widest, how, scale_error)
    return document


def parameter(
    fit: Regression, index: int, scale: float, unit: str, widest: float, how: str,
    scale_error: float = 0.0,
) -> dict[str, Any]:  # fmt: skip
    """One parameter as it is stored: value and interval, or why it is not determined."""
    value, half = float(fit.values[index]), float(fit.half_width[index])
    what = "too few levels" if fit.freedom < 1 else "levels that do not tell it from the others"
    return _stored(
        value / scale, float(np.hypot(half, scale_error * value)) / scale, unit, widest, how,
        f"{what}: record more different ones",
    )  # fmt: skip


def _stored(
    value: float, half: float, unit: str, widest: float, how: str, open_reason: str
) -> dict[str, Any]:
    entry: dict[str, Any] = {"unit": unit, "how": how, "value": None, "interval_95": None}
    if not (np.isfinite(half) and np.isfinite(value)):
        return {**entry, "determined": False, "reason": open_reason}
    interval = [float(f"{value - half:.5g}"), float(f"{value + half:.5g}")]
    if half > widest * abs(value):
        why = f"the 95 % interval, {interval[0]:g} to {interval[1]:g}, is wider than asked"
        return {**entry, "determined": False, "reason": why}
    found = float(f"{value:.5g}")
    return {**entry, "value": found, "interval_95": interval, "determined": True, "reason": ""}
