"""Draws of what is not certain, from a scrambled Sobol sequence.

A Sobol sequence fills its cube more evenly than chance, so that far quantiles settle with fewer
draws (Owen 1998).
"""

from dataclasses import dataclass
from math import ceil, log2

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.certainty.uncertainty import ToolUncertainty, Uncertainty

Floats = NDArray[np.float64]

COEFFICIENTS, SIZE, ANGLE, MOUNTING, DEPTH = slice(0, 6), 6, 7, slice(8, 10), 10
DIMENSIONS = 11
"""Of one tool."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ToolDraws:
    """D draws of one tool.

    Parameters
    ----------
    coefficients : ndarray, shape (D, 6)
        K_tc, K_rc, K_ac, K_te, K_re, K_ae, SI.
    offsets : ndarray, shape (D, 2)
        Of the tool's axis from the spindle's, along the first tooth and across [m].
    depth : ndarray, shape (D,)
        By which it stands deeper [m].
    """

    coefficients: Floats
    offsets: Floats
    depth: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class Draws:
    """D draws of a part: those of each tool, by number, and the model's factor, shape (D,)."""

    tools: dict[int, ToolDraws]
    model: Floats

    def __len__(self) -> int:
        return len(self.model)

    def first(self, many: int) -> "Draws":
        """The first of them."""
        tools = {
            number: ToolDraws(
                coefficients=one.coefficients[:many], offsets=one.offsets[:many],
                depth=one.depth[:many],
            ) for number, one in self.tools.items()
        }  # fmt: skip
        return Draws(tools=tools, model=self.model[:many])


def draws_of(uncertain: Uncertainty, many: int, seed: int) -> Draws:
    """D = ``many`` draws."""
    from scipy.special import ndtri

    numbers = sorted(uncertain.tools)
    common = 1 + len(uncertain.sources)
    places = _sobol(common + DIMENSIONS * len(numbers), many, seed)
    normal = ndtri(places)
    tools = {}
    for k, number in enumerate(numbers):
        own = slice(common + DIMENSIONS * k, common + DIMENSIONS * (k + 1))
        tool = uncertain.tools[number]
        shared = normal[:, 1 + tool.source] if tool.source >= 0 else np.zeros(many)
        tools[number] = _of_tool(tool, uncertain.depth, shared, normal[:, own], places[:, own])
    return Draws(tools=tools, model=np.maximum(1.0 + uncertain.model * normal[:, 0], 0.0))


def _of_tool(
    tool: ToolUncertainty, depth: float, shared: Floats, normal: Floats, places: Floats
) -> ToolDraws:
    scale = np.maximum(1.0 + tool.common * shared, 0.0)
    law = tool.mean * scale[:, None] + normal[:, COEFFICIENTS] @ tool.own.T
    law[:, [0, 3]] = np.maximum(law[:, [0, 3]], 0.0)  # a cut does not drive its tool
    size = np.abs(tool.runout + tool.runout_sd * normal[:, SIZE])
    angle = 2 * np.pi * places[:, ANGLE]
    offsets = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets += tool.mounting * normal[:, MOUNTING]
    return ToolDraws(coefficients=law, offsets=offsets, depth=depth * normal[:, DEPTH])


def _sobol(dimensions: int, many: int, seed: int) -> Floats:
    """Points inside the unit cube; shape (many, dimensions)."""
    from scipy.stats.qmc import Sobol

    sequence = Sobol(dimensions, scramble=True, rng=np.random.default_rng(seed))
    points = sequence.random_base2(ceil(log2(many)))[:many]
    least = 0.5**33
    return np.clip(points, least, 1.0 - least)
