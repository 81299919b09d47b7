"""What gives way at the tips of a machine's tools: modes of its file, or a measured response."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pipeline.cutting.frf import Dynamics, FrequencyResponse
from pipeline.cutting.modes import DIRECTIONS, Mode


@dataclass(frozen=True, kw_only=True)
class TipModes:
    """The section ``dynamics`` of a machine.

    Parameters
    ----------
    source : str
        Where the modes come from.
    measured : bool
        Whether that is a modal test of this machine.
    modes : tuple of Mode
        At the tip of every tool that is not listed.
    tools : dict of int to tuple of Mode
        By tool number.
    """

    source: str
    measured: bool = False
    modes: tuple[Mode, ...] = ()
    tools: dict[int, tuple[Mode, ...]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class TipDynamics:
    """Dynamics of each tool's tip by its number; ``every`` for those that are not listed."""

    source: str
    measured: bool = True
    every: Dynamics | None = None
    tools: Mapping[int, Dynamics] = field(default_factory=dict)

    @classmethod
    def of_modes(cls, found: TipModes) -> "TipDynamics":
        """As a machine's file has them."""
        return cls(
            source=found.source, measured=found.measured, every=found.modes or None,
            tools=dict(found.tools),
        )  # fmt: skip

    def of(self, numbers: Sequence[int]) -> list[Dynamics | None]:
        """For each of the tools with these numbers; None where nothing is known."""
        return [self.tools.get(number, self.every) for number in numbers]


def rigid_directions(found: Dynamics) -> list[str]:
    """Directions of the machine in which nothing is said to give way."""
    if isinstance(found, FrequencyResponse):
        moving = [bool(np.any(found.receptance[:, i, i])) for i in range(len(DIRECTIONS))]
    else:
        moving = [any(mode.direction == name for mode in found) for name in DIRECTIONS]
    return [name for name, moves in zip(DIRECTIONS, moving, strict=True) if not moves]
