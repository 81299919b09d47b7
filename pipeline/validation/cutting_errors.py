"""Figures of a predicted waveform against a measured one: peak, mean, RMS, by channel."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.cutting.known import CHANNELS, DIRECTIONS, Dynamometer
from pipeline.identification.cutting.revolution import wave

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Components = dict[str, dict[str, Any]]

ANGLES = 720
"""Of a revolution, at which waveforms are compared."""
SLIGHT = 0.1
"""A mean below this share of its RMS is no measure of its own error."""


def components(measured: Complexes, modelled: Complexes, dynamometer: Dynamometer) -> Components:
    """Figures of each channel and of the resultant in the plane.

    Parameters
    ----------
    measured, modelled : ndarray of complex, shape (H + 1, 3)
        Harmonics of the force on the tool along feed, normal, axis [N].
    dynamometer : Dynamometer
        Which channel shows which.
    """
    angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)
    true, said = wave(measured, angles), wave(modelled, angles)
    turning = dynamometer.turning
    found = {
        name: _figures(
            true @ turning[:, k], said @ turning[:, k],
            _rms((said - true) @ turning[:, k]), _rms(true @ turning[:, k]),
        )
        for k, name in enumerate(CHANNELS)
    }  # fmt: skip
    plane = [DIRECTIONS.index("feed"), DIRECTIONS.index("normal")]
    one, other = np.linalg.norm(true[:, plane], axis=1), np.linalg.norm(said[:, plane], axis=1)
    error = _rms(np.linalg.norm((said - true)[:, plane], axis=1))
    return found | {"resultant": _figures(one, other, error, _rms(one))}


def over_limits(figures: Mapping[str, Any], *, peak: float, mean: float, rms: float) -> list[str]:
    """Words on each figure of the force in the plane that is over its limit [%]."""
    limits = {"peak": peak, "mean": mean, "rms": rms}
    words = {"peak": "peak", "mean": "mean", "rms": "RMS error"}
    return [
        f"{words[name]}: {abs(figures[f'{name}_error_percent']):g} % > {limit:g} %"
        for name, limit in limits.items()
        if abs(figures[f"{name}_error_percent"]) > limit
    ]


def _figures(true: Floats, said: Floats, error: float, strength: float) -> dict[str, Any]:
    measured, modelled = _levels(true), _levels(said)
    shares: dict[str, float | None] = {
        "rms_error_percent": round(100 * error / strength, 2) if strength > 0 else None
    }
    for name in ("peak", "mean"):
        told = strength > 0 and (name == "peak" or abs(measured[name]) > SLIGHT * strength)
        change = 100 * (modelled[name] - measured[name]) / abs(measured[name]) if told else None
        shares[f"{name}_error_percent"] = None if change is None else round(change, 2)
    return {
        "measured": {name: _digits(value) for name, value in measured.items()},
        "modelled": {name: _digits(value) for name, value in modelled.items()},
        **shares,
    }


def _levels(force: Floats) -> dict[str, float]:
    return {"peak": float(np.abs(force).max()), "mean": float(force.mean()), "rms": _rms(force)}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _digits(value: float) -> float:
    return float(f"{value:.5g}")
