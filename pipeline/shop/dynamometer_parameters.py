"""The table dynamometer of the simulated shop: its tests, its dynamics, its amplifier, its files.

Sources of the orders of magnitude: Kistler data sheets 9257B (crosstalk up to 2 %, natural
frequencies above 2 kHz, above 3 kHz along z, bare) and 9255C; with vise and workpiece 1 to 2.5 kHz
(Girardin, Remond, Rigal: *High frequency correction of dynamometer for cutting force observation in
milling*, J. Manuf. Sci. Eng. 132 (2010)); charge amplifiers drift by 0.05 pC/s and more.
"""

from dataclasses import dataclass, field
from typing import Literal

from pipeline.shop.ranges import Ranged, quantity

RATE = 10000
"""Rows a second."""


@dataclass(frozen=True, kw_only=True)
class ChannelMode(Ranged):
    """The mode of one channel: what it shows of a force at each frequency."""

    frequency: float = quantity(2100.0, "Hz", 200, 2e4)
    damping: float = quantity(0.03, "1", 1e-3, 0.5)


def _z() -> ChannelMode:
    return ChannelMode(frequency=2860.0, damping=0.022)


@dataclass(frozen=True, kw_only=True)
class Series(Ranged):
    """Which tests: slots and half immersions at two speeds, two depths, several feeds.

    Parameters
    ----------
    speeds, depths : tuple of 2 floats
        [rev/min], [mm].
    feeds : tuple of 4 floats
        For each tooth [mm].
    seconds : float
        Length of a recording inside the material.
    block : float
        Length of a pass.
    passes_between : float
        What is cut between two tests, in passes of the test before: wear that nobody records.

    Raises
    ------
    ValueError
        When there are not 2 speeds, 2 depths and 4 feeds above 0.
    """

    speeds: tuple[float, ...] = (4000.0, 6000.0)
    depths: tuple[float, ...] = (2.0, 3.0)
    feeds: tuple[float, ...] = (0.03, 0.05, 0.08, 0.12)
    seconds: float = quantity(0.8, "s", 0.1, 60)
    block: float = quantity(80.0, "mm", 20, 1000)
    passes_between: float = quantity(1.0, "1", 0, 1000)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, count in (("speeds", 2), ("depths", 2), ("feeds", 4)):
            values = getattr(self, name)
            if len(values) != count or min(values) <= 0:
                raise ValueError(f"Series.{name} = {values} must be {count} positive numbers")


@dataclass(frozen=True, kw_only=True)
class Dynamometer(Ranged):
    """The dynamometer under the workpiece and all behind it.

    Parameters
    ----------
    along : {"x", "y"}
        Its axis that points along the feed; x of the other one to the right of it.
    axial : {"lift", "pressure"}
        What its z channel counts positive.
    x, y, z : ChannelMode
        Of its channels.
    crosstalk : float
        Greatest share of a force that another channel shows.
    speed_error, speed_wander : float
        Of the spindle in a cut: greatest offset from the speed that is commanded, standard
        deviation about it.
    depth_error : float
        Of the tool's length as it was measured for a test, standard deviation.
    offset, drift : float
        Of the amplifier, standard deviations from test to test.
    range, low_range, bits : float, float, int
        Force at the converter's end, the one that was left set too low in one test, resolution.
    decimal : {".", ","}
        Of its files.
    """

    along: Literal["x", "y"] = "x"
    axial: Literal["lift", "pressure"] = "lift"
    series: Series = field(default_factory=Series)
    x: ChannelMode = field(default_factory=ChannelMode)
    y: ChannelMode = field(default_factory=lambda: ChannelMode(frequency=1840.0, damping=0.035))
    z: ChannelMode = field(default_factory=_z)
    crosstalk: float = quantity(0.018, "1", 0, 0.2)
    speed_error: float = quantity(1e-3, "1", 0, 0.05)
    speed_wander: float = quantity(1e-3, "1", 0, 0.05)
    depth_error: float = quantity(8.0, "um", 0, 200)
    offset: float = quantity(3.0, "N", 0, 100)
    drift: float = quantity(0.8, "N/s", 0, 50)
    noise: float = quantity(1.2, "N", 0, 50)
    hum: float = quantity(0.7, "N", 0, 50)
    mains: float = quantity(50.0, "Hz", 15, 70)
    range: float = quantity(1000.0, "N", 10, 1e5)
    low_range: float = quantity(320.0, "N", 1, 1e5)
    bits: int = quantity(16, "1", 8, 24)
    decimal: Literal[".", ","] = "."
