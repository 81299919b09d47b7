"""Space-vector modulation of a two-level inverter: which mean voltage, and when each leg switches.

A leg that is high for the share d of a carrier period, centred in it, gives d U_dc over the
negative rail.  The three shares are d_x = 1/2 + (u_x - (u_max + u_min) / 2) / U_dc, which splits
the zero vectors equally: the modulation of Holmes and Lipo, Pulse Width Modulation for Power
Converters, 2003, section 6.6.  Mean voltages end at the hexagon of the six active vectors; the
circle in it has the radius U_dc / sqrt(3) (Feed2025).
"""

from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

_SQRT3 = np.sqrt(3.0)


@dataclass(frozen=True, kw_only=True)
class InverterParameters:
    """The inverter between the current loops and the motor; dead time and drops are left out.

    Parameters
    ----------
    dc_link : float
        U_dc [V].
    switched : bool
        Whether the legs switch, or the mean voltage of a carrier period is held over it.
    overmodulation : bool
        Whether voltages between the circle and the hexagon are used.

    Raises
    ------
    ValueError
        When the voltage is out of its range.
    """

    dc_link: float
    switched: bool = False
    overmodulation: bool = False

    def __post_init__(self) -> None:
        if not (isfinite(self.dc_link) and self.dc_link > 0):
            raise ValueError(f"inverter.dc_link = {self.dc_link} V must be finite and positive")

    @property
    def linear_limit(self) -> float:
        """U_dc / sqrt(3) [V], greatest amplitude of a phase that is free of distortion."""
        return float(self.dc_link / _SQRT3)


def limited(alpha: Any, beta: Any, dc_link: Any, overmodulation: bool) -> tuple[Any, Any]:
    """Return the voltage that the inverter can give; its direction stays, its length is cut.

    Parameters
    ----------
    alpha, beta : array_like
        Voltage in the stator's frame [V].
    dc_link : float
        U_dc [V].
    overmodulation : bool
        Whether the hexagon is the limit; otherwise the circle in it.
    """
    if overmodulation:
        half, whole = alpha / 2, _SQRT3 * beta / 2
        a, b, c = alpha, whole - half, -whole - half
        reach = np.maximum(np.maximum(a, b), c) - np.minimum(np.minimum(a, b), c)
    else:
        reach = _SQRT3 * np.sqrt(alpha * alpha + beta * beta)
    share = dc_link / np.maximum(reach, dc_link)
    return alpha * share, beta * share


def duty(alpha: Any, beta: Any, dc_link: Any) -> tuple[Any, Any, Any]:
    """Return the shares of a carrier period for which the legs a, b, c are high [1].

    Parameters
    ----------
    alpha, beta : array_like
        Mean voltage in the stator's frame [V], within the hexagon (see :func:`limited`).
    dc_link : float
        U_dc [V].
    """
    half, whole = alpha / 2, _SQRT3 * beta / 2
    a, b, c = alpha, whole - half, -whole - half
    middle = (np.maximum(np.maximum(a, b), c) + np.minimum(np.minimum(a, b), c)) / 2
    return (
        0.5 + (a - middle) / dc_link,
        0.5 + (b - middle) / dc_link,
        0.5 + (c - middle) / dc_link,
    )


def leg_voltage(a: Any, b: Any, c: Any, dc_link: Any) -> tuple[Any, Any]:
    """Return the voltage in the stator's frame [V] of three legs.

    Parameters
    ----------
    a, b, c : array_like
        1 for a leg that is high, 0 for low; shares of a period give its mean [1].
    dc_link : float
        U_dc [V].
    """
    return dc_link * (2 * a - b - c) / 3, dc_link * (b - c) / _SQRT3
