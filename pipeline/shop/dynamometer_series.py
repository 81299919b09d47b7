"""The tests on the dynamometer: which, in which order, and what goes wrong with some of them."""

from dataclasses import dataclass
from typing import Literal

from pipeline.shop.cutting_conditions import Conditions, Immersion
from pipeline.shop.cutting_parameters import Cutting

Window = Literal["inside", "entry", "exit"]
Fault = Literal["", "clipped", "torn", "lost"]

LOST = 1
"""Channel of which the cable came off in one test: Fy."""


@dataclass(frozen=True, kw_only=True)
class CuttingTest:
    """One recording: conditions, which part of the pass it holds, its fault."""

    conditions: Conditions
    window: Window = "inside"
    fault: Fault = ""

    @property
    def name(self) -> str:
        """As its file is called: the conditions."""
        c = self.conditions
        side = "" if c.immersion == "slot" else f"ae{c.width:g}"
        return f"{c.immersion}-n{c.speed:g}f{c.feed:g}ap{c.depth:g}{side}"


def series(cutting: Cutting) -> list[CuttingTest]:
    """All tests of a machine, in the order in which they are cut."""
    return [
        _test(cutting, "slot", 0, 0, 0),
        _test(cutting, "slot", 0, 0, 1),
        _test(cutting, "slot", 0, 0, 2),
        _test(cutting, "slot", 0, 0, 3, "entry"),
        _test(cutting, "slot", 1, 0, 1),
        _test(cutting, "slot", 1, 0, 3, "exit"),
        _test(cutting, "slot", 0, 1, 0),
        _test(cutting, "slot", 0, 1, 2),
        _test(cutting, "down", 0, 0, 1),
        _test(cutting, "down", 0, 0, 3, "entry"),
        _test(cutting, "up", 0, 0, 1),
        _test(cutting, "up", 0, 0, 3, "exit"),
        _test(cutting, "slot", 1, 1, 3, fault="clipped"),
        _test(cutting, "down", 1, 1, 2, fault="lost"),
        _test(cutting, "up", 1, 1, 1, fault="torn"),
    ]


def _test(
    cutting: Cutting, immersion: Immersion, speed: int, depth: int, feed: int,
    window: Window = "inside", fault: Fault = "",
) -> CuttingTest:  # fmt: skip
    """A test by the places of its values in the series; a half immersion is D / 2 wide."""
    asked, tool = cutting.dynamometer.series, cutting.tool
    rate = asked.feeds[feed] * tool.flutes * asked.speeds[speed]
    return CuttingTest(
        conditions=Conditions(
            immersion=immersion, depth=asked.depths[depth], speed=asked.speeds[speed],
            width=tool.diameter / (1 if immersion == "slot" else 2), feed=round(rate / 10) * 10.0,
        ), window=window, fault=fault,
    )  # fmt: skip
