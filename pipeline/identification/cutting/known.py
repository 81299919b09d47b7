"""What is known of a recorded cut beforehand: the tool, and how the dynamometer stands."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool

Floats = NDArray[np.float64]

CHANNELS = ("x", "y", "z")
DIRECTIONS = ("feed", "normal", "axial")
"""Rows of a force on the tool: along the feed, to the left of it, as F_z of `cutting.waveform`."""


@dataclass(frozen=True, kw_only=True)
class Dynamometer:
    """Which channel shows which force on the tool; a minus before a channel's name turns it.

    Parameters
    ----------
    feed : str
        Channel of the force on the tool along the feed, F_x of :mod:`pipeline.cutting.force.waveform`.
        A dynamometer under the workpiece shows the opposite force: ``-x`` when its x points along
        the feed.
    normal : str
        Of the force on the tool to the left of the feed, F_y; with M4, to the right of it.
    axial : str
        Of the force with which the edge lifts the workpiece, F_z: ``z`` of a dynamometer under
        the workpiece that points upwards.

    Raises
    ------
    ValueError
        When they are not the channels x, y and z, each once.
    """

    feed: str = "-x"
    normal: str = "-y"
    axial: str = "z"

    def __post_init__(self) -> None:
        named = [getattr(self, one) for one in DIRECTIONS]
        if sorted(one.removeprefix("-") for one in named) != list(CHANNELS):
            raise ValueError(
                f"cutting.dynamometer: feed, normal and axial are {', '.join(map(repr, named))}: "
                "name x, y and z, each once, a minus before those that are turned"
            )

    @property
    def turning(self) -> Floats:
        """Forces on the tool (rows) from channels (columns); shape (3, 3), orthogonal."""
        matrix = np.zeros((3, 3))
        for row, name in enumerate(DIRECTIONS):
            channel = getattr(self, name)
            sign = -1.0 if channel.startswith("-") else 1.0
            matrix[row, CHANNELS.index(channel.removeprefix("-"))] = sign
        return matrix


@dataclass(frozen=True, kw_only=True)
class CuttingKnown:
    """What is known of the cuts of a machine's recordings.

    Parameters
    ----------
    tool : Tool
        That cut; runout is found, so is what ``sought`` names.
    material : str
        Of the workpiece.
    dynamometer : Dynamometer
        How it stands.
    sought : tuple of {"runout", "helix"}
        Of the tool, what is not known and must be found; a helix angle that is given is where the
        search begins.

    Raises
    ------
    ValueError
        When the tool is no end mill.
    """

    tool: Tool
    material: str = ""
    dynamometer: Dynamometer = field(default_factory=Dynamometer)
    sought: tuple[Literal["runout", "helix"], ...] = ("runout",)

    def __post_init__(self) -> None:
        if self.tool.kind == "drill":
            raise ValueError(
                "cutting.tool is a drill: coefficients are identified from the forces of end "
                "mills (flat, bull_nose or ball)"
            )


def named_channels(channels: Mapping[str, str]) -> list[str]:
    """Names of the channels x, y, z in the recordings.

    Raises
    ------
    ValueError
        When one is missing, or there is another.
    """
    if sorted(channels) != list(CHANNELS):
        raise ValueError(
            f"cutting_records.channels has {', '.join(sorted(channels)) or 'none'}: name x, y and z"
        )
    return [channels[one] for one in CHANNELS]
