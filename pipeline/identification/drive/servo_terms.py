"""What is sought of a servo: names, units, bounds, and what to record where it stays open."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.known import AxisConstants
from pipeline.machine.axis.servo import ServoParameters

Floats = NDArray[np.float64]

TERMS = (
    "position_scale", "velocity_scale", "integral_scale", "velocity_feedforward",
    "acceleration_feedforward", "position_lag", "velocity_lag", "position_hold",
    "lag_spread",
)  # fmt: skip
"""Order of the parameters in every vector of them."""
SPP, SVP, SVI, FV, FA, TX, TV, TH, TS = range(len(TERMS))
SCALES = (SPP, SVP, SVI)
"""Of gains that the control's list of parameters may name."""

SLOWEST = 1e-3
"""Period at which position loops sample at the latest [s]."""
_WIDEST_SCALE = 1e3
"""No servo is that far from the gains of its control's list [1]."""
_REVERSALS = "with reversals and rapid starts, reference, position and current at 1 kHz or more"
REMEDY = {
    "position_scale": f"record feeds at several speeds {_REVERSALS}",
    "velocity_scale": f"record the axis {_REVERSALS}",
    "integral_scale": f"record load steps, or the axis {_REVERSALS}",
    "velocity_feedforward": f"name velocity_feedforward in conf/machine/, or record {_REVERSALS}",
    "acceleration_feedforward": f"record accelerations of several heights {_REVERSALS}",
    "position_lag": f"record the axis {_REVERSALS}",
    "velocity_lag": f"record the axis {_REVERSALS}",
}


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """Gains of the control's list; 1 in SI where it does not name one.

    Parameters
    ----------
    position_gain : float
        P_p [1/s].
    velocity_gain : float
        V_p [A s/m].
    integral_gain : float
        V_i [A/m].
    velocity_feedforward : float
        f_v [1].
    acceleration_feedforward : float
        f_a [A s^2/m].
    current_limit : float, optional
        Greatest command [A].
    unnamed : frozenset of str
        Gains among these that the list does not name.
    """

    position_gain: float
    velocity_gain: float
    integral_gain: float
    velocity_feedforward: float
    acceleration_feedforward: float
    current_limit: float | None
    unnamed: frozenset[str]

    @classmethod
    def of(cls, constants: AxisConstants) -> "Nominal":
        """From what is known of the axis."""
        values: dict[str, Any] = {item.name: None for item in fields(cls)}
        values |= {name: getattr(constants, name, None) for name in values}
        unnamed = frozenset(n for n in values if values[n] is None and n != "unnamed")
        ones = {n: 1.0 for n in unnamed if n.endswith("_gain")}
        none = {n: 0.0 for n in unnamed if n.endswith("_feedforward")}
        return cls(**values | ones | none | {"unnamed": unnamed})

    @property
    def integral(self) -> bool | None:
        """Whether the velocity loop has an integral part; None where the list does not say."""
        return None if "integral_gain" in self.unnamed else self.integral_gain > 0

    def named(self, term: str) -> bool:
        """Whether the list names the gain that ``term`` scales, or ``term`` itself."""
        return term.replace("_scale", "_gain") not in self.unnamed

    @property
    def fixed(self) -> Floats:
        """Values of what is not sought; shape (D,)."""
        found = np.zeros(len(TERMS))
        found[[SPP, SVP]] = 1.0
        found[SVI] = 1.0 if self.integral else 0.0
        found[[FV, FA]] = self.velocity_feedforward, self.acceleration_feedforward
        return found

    def bounds(self, longest: float) -> tuple[Floats, Floats]:
        """Least and greatest values, lags up to ``longest`` [s]; each of shape (D,)."""
        low = np.zeros(len(TERMS))
        high = np.full(len(TERMS), np.inf)
        for k, gain in ((SPP, "position_gain"), (SVP, "velocity_gain")):
            if gain not in self.unnamed:
                low[k], high[k] = 1 / _WIDEST_SCALE, _WIDEST_SCALE
        high[FV], high[[TX, TV]], high[TH] = 2.0, longest, SLOWEST / 2
        high[TS] = 1.0
        return low, high

    def servo(self, values: Floats) -> ServoParameters:
        """The servo of ``values``, shape (D,)."""
        found = dict(zip(TERMS[:TH], values.tolist(), strict=False))
        whole = found["integral_scale"] > 0
        if not whole:
            found["integral_scale"] = 1.0
        if self.current_limit is not None:
            found["current_limit"] = self.current_limit
        return ServoParameters(
            position_gain=self.position_gain,
            velocity_gain=self.velocity_gain,
            integral_gain=self.integral_gain if whole else 0.0,
            **found,
        )

    def unit(self, name: str, command_unit: str) -> str:
        """Of the parameter ``name``: scales are gains in SI where the list names none."""
        units = {
            "position_scale": ("position_gain", "1/s"),
            "velocity_scale": ("velocity_gain", f"{command_unit} s/m"),
            "integral_scale": ("integral_gain", f"{command_unit}/m"),
        }
        if name in units:
            gain, unit = units[name]
            return unit if gain in self.unnamed else "1"
        if name == "acceleration_feedforward":
            return f"{command_unit} s^2/m"
        return "1" if name == "velocity_feedforward" else "s"
