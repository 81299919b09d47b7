"""Units of a frequency response, and the receptance of one direction from it."""

import re

import numpy as np

from pipeline.cutting.frf import Complex, Floats, FrequencyResponse

PLACES: dict[str, tuple[int, int]] = {"x": (0, 0), "y": (1, 1), "xy": (0, 1), "yx": (1, 0)}
"""Direction of the displacement and of the force -> row and column of the receptance."""
UNITS: dict[str, tuple[float, int]] = {
    "m/N": (1.0, 0), "mm/N": (1e-3, 0), "um/N": (1e-6, 0),
    "m/s/N": (1.0, 1), "mm/s/N": (1e-3, 1),
    "m/s2/N": (1.0, 2), "mm/s2/N": (1e-3, 2), "g/N": (9.80665, 2),
}  # fmt: skip
"""Unit of a response -> factor to SI, and how often it is a displacement's derivative in time."""


def unit_of(text: str) -> tuple[float, int]:
    """Factor to SI of a unit, and how often it is a displacement's derivative in time."""
    plain = text.replace("µ", "u").replace("μ", "u").replace("²", "2")
    plain = re.sub(r"[\s^()*]", "", plain)
    if plain not in UNITS:
        raise ValueError(f"the response's unit is {text!r}: give one of {', '.join(UNITS)}")
    return UNITS[plain]


def one_direction(
    frequency: Floats, values: Complex, derivative: int, direction: str, sign: int = 1
) -> FrequencyResponse:
    """One direction of the receptance; a mobility or an accelerance is integrated."""
    kept = frequency != 0.0  # the static deflection is no part of an accelerance
    frequency, values = frequency[kept], values[kept]
    receptance = np.zeros((len(frequency), 2, 2), dtype=np.complex128)
    place = (slice(None), *PLACES[direction])
    receptance[place] = sign * values / (2j * np.pi * frequency) ** derivative
    return FrequencyResponse(frequency_Hz=frequency, receptance=receptance)
