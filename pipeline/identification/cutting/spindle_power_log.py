"""From a log of a spindle's speed and load to levels of its power."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.spindle_power_levels import (
    Levels,
    levels,
    resolution,
    runs,
    settled,
    shown_power,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class LoadScale:
    """What a load in percent means; taken for known, and all results scale with it.

    Parameters
    ----------
    rated_power_kW : float
        At the motor's shaft [kW].
    base_speed_rpm : float
        From which it gives that power [rpm].
    efficiency : float
        Mechanical, from the motor's shaft to the tool [1].
    of : {"available", "rated"}
        What 100 % are, see :func:`shown_power`.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    rated_power_kW: float
    base_speed_rpm: float
    efficiency: float = 1.0
    of: Literal["available", "rated"] = "available"

    def __post_init__(self) -> None:
        for name, high in (("rated_power_kW", 1e4), ("base_speed_rpm", 1e6), ("efficiency", 1.0)):
            if not 0.0 < getattr(self, name) <= high:
                raise ValueError(
                    f"load_scale.{name} = {getattr(self, name)} is out of its range, above 0 to "
                    f"{high:g}"
                )

    def power(self, load_percent: Floats | float, speed: Floats) -> Floats:
        """Power at the tool [W], of loads [%] at speeds [rev/s]."""
        return self.efficiency * shown_power(
            load_percent, speed, rated_W=self.rated_power_kW * 1e3,
            base_speed=self.base_speed_rpm / 60, of=self.of,
        )  # fmt: skip

    @property
    def words(self) -> str:
        """For a document."""
        of = "the power available at its speed" if self.of == "available" else "the rated power"
        return (
            f"load is a percentage of {of}; {self.rated_power_kW:g} kW from "
            f"{self.base_speed_rpm:g} rpm, efficiency {self.efficiency:g}"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadLog:
    """T rows of a log.

    Parameters
    ----------
    times : ndarray, shape (T,)
        Rising [s].
    speed : ndarray, shape (T,)
        Of the spindle [rev/s].
    load : ndarray, shape (T,)
        [%]; NaN where it is not known.
    cut : ndarray of int, shape (T,), optional
        Which cut each row is in, negative for none; without it the spindle turned free throughout.
    removal, edge : ndarray, shape (T,), optional
        Rates of the cut [m^3/s], [m^2/s]; needed with ``cut``, 0 for a line in air.

    Raises
    ------
    ValueError
        When columns do not fit together.
    """

    times: Floats
    speed: Floats
    load: Floats
    cut: NDArray[np.int64] | None = None
    removal: Floats | None = None
    edge: Floats | None = None

    def __post_init__(self) -> None:
        columns = (self.speed, self.load, self.cut, self.removal, self.edge)
        if any(c is not None and len(c) != len(self.times) for c in columns):
            raise ValueError(f"a column of the log has not the {len(self.times)} rows of its times")
        if np.any(~(np.diff(self.times) >= 0.0)):
            raise ValueError("the times of the log do not rise: sort its rows")
        if self.cut is not None and (self.removal is None or self.edge is None):
            raise ValueError("a log of cuts needs the removal rate and the edge rate of its rows")


def load_levels(log: LoadLog, scale: LoadScale, *, settle_s: float = 1.0) -> Levels:
    """Levels of a log: rows at which speed and cut have been the same for ``settle_s``.

    Parameters
    ----------
    log : LoadLog
        Of one run.
    scale : LoadScale
        What its loads mean.
    settle_s : float
        Longer than the control averages its load [s].
    """
    kept = settled(log.times, log.speed, settle_s=settle_s)
    if log.cut is None:
        label, removal, edge = runs(kept), np.zeros(1), np.zeros(1)
    else:
        cut = np.asarray(log.cut, dtype=np.int64)
        begins = np.flatnonzero(np.diff(cut, prepend=cut[:1] - 1) != 0)
        since = (
            log.times - log.times[begins][np.searchsorted(begins, np.arange(len(cut)), "right") - 1]
        )
        label = np.where(kept & (since >= settle_s), cut, -1)
        removal, edge = np.asarray(log.removal), np.asarray(log.edge)
    shown = log.load[np.isfinite(log.load)]
    step = scale.power(resolution(shown), log.speed)
    return levels(label, log.speed, scale.power(log.load, log.speed), step, removal, edge)
