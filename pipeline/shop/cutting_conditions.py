"""What is set for a straight pass of an end mill."""

from dataclasses import dataclass
from math import acos, pi
from typing import Literal

from pipeline.shop.ranges import Ranged, quantity

Immersion = Literal["slot", "up", "down"]


@dataclass(frozen=True, kw_only=True)
class Conditions(Ranged):
    """Depth and width of a pass, speed of the spindle, feed; a slot is as wide as the tool."""

    immersion: Immersion
    depth: float = quantity(2.0, "mm", 0.01, 200)
    width: float = quantity(12.0, "mm", 0.01, 200)
    speed: float = quantity(4000.0, "rev/min", 10, 1e5)
    feed: float = quantity(600.0, "mm/min", 1, 1e5)

    def feed_per_tooth(self, flutes: int) -> float:
        """[mm]."""
        return self.feed / (self.speed * flutes)

    @property
    def removal_rate(self) -> float:
        """[mm3/s]."""
        return self.depth * self.width * self.feed / 60


def engaged(conditions: Conditions, diameter: float) -> tuple[float, float]:
    """Angles at which a tooth enters and leaves [rad]."""
    arc = acos(1 - 2 * min(conditions.width / diameter, 1.0))
    return (0.0, arc) if conditions.immersion == "up" else (pi - arc, pi)
