"""Tests of the spindle's load meter: passes of known engagement, speeds without a cut, the meter.

The meter shows the power over what the motor has at that speed, P_rated min(1, n / n_base), as the
machine's own log does.  Sources of the orders of magnitude: Altintas: *Manufacturing Automation*,
2nd ed., ch. 5 (lag of a drive's current signal, 5 to 20 Hz behind its filter, less for a display);
Fanuc: *AC spindle motor αi series, parameter manual* (B-65280EN): load meter in percent of the
maximum output, its filter of some tenths of a second.
"""

from dataclasses import dataclass

from pipeline.shop.cutting_conditions import Conditions
from pipeline.shop.ranges import Ranged, quantity

PASSES = (
    Conditions(immersion="down", depth=10.0, width=6.0, speed=6000.0, feed=2160.0),
    Conditions(immersion="down", depth=10.0, width=6.0, speed=8000.0, feed=2880.0),
    Conditions(immersion="up", depth=10.0, width=6.0, speed=8000.0, feed=1920.0),
    Conditions(immersion="down", depth=8.0, width=4.0, speed=11000.0, feed=3960.0),
    Conditions(immersion="slot", depth=6.0, width=12.0, speed=6000.0, feed=1440.0),
    Conditions(immersion="slot", depth=4.0, width=12.0, speed=8000.0, feed=1440.0),
    Conditions(immersion="slot", depth=6.0, width=12.0, speed=8000.0, feed=2400.0),
    Conditions(immersion="slot", depth=4.0, width=12.0, speed=11000.0, feed=3300.0),
)
SPEEDS = (1000.0, 2000.0, 3000.0, 4500.0, 6000.0, 8000.0, 10000.0, 12000.0)


@dataclass(frozen=True, kw_only=True)
class SpindleTests(Ranged):
    """What is cut, what is turned without a cut, and what the load meter makes of it.

    Parameters
    ----------
    passes : tuple of Conditions
        Of the program; shoulders that get deeper are cut in the reverse order.
    block : float
        Length of the blank.
    speeds, hold : tuple of float, float
        Of the warm-up [rev/min], and how long each lasts.
    efficiency : float
        Of the way from motor to tool, for what the cut takes.
    oil_temperature : float
        Of the bearings, after the warm-up.
    lag, noise, step : float
        Of the meter: time constant, standard deviation, resolution.

    Raises
    ------
    ValueError
        When a value is out of its range, or there is no pass or no speed.
    """

    passes: tuple[Conditions, ...] = PASSES
    block: float = quantity(150.0, "mm", 20, 1000)
    speeds: tuple[float, ...] = SPEEDS
    hold: float = quantity(8.0, "s", 1, 600)
    efficiency: float = quantity(0.94, "1", 0.3, 1)
    oil_temperature: float = quantity(34.0, "degC", 0, 100)
    lag: float = quantity(0.25, "s", 0.01, 10)
    noise: float = quantity(0.15, "percent", 0, 20)
    step: float = quantity(0.1, "percent", 0.01, 10)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.passes or not self.speeds or min(self.speeds) <= 0:
            raise ValueError(
                "SpindleTests: there must be at least one pass and one speed above 0, got "
                f"{len(self.passes)} passes and speeds = {self.speeds} [rev/min]"
            )
