"""Cutting-force sub-model: identification from a dynamometer and from the spindle's load.

Six coefficients of the linear-edge model (Altintas, *Manufacturing Automation*, 2nd ed. 2012), the
runout and helix of the tool, edge forces of single teeth, the modes of the dynamometer's channels
and a residual over the spindle's angle are identified from the harmonics of the mean revolution of
recorded cuts.  Forces act on the tool along feed, normal and axis [N]; angles are those of
:mod:`pipeline.cutting.engagement.engagement` [rad]; all quantities are SI but for the fields whose
names carry a unit.  ``spindle_load`` identifies no-load power and specific cutting force from a
spindle's load; ``submodel`` is the contract, ``page`` what a maintenance lead reads.
"""

__all__ = [
    "coefficients", "fit", "identify", "model", "page", "recordings", "revolution", "selection",
    "settings", "spindle_load", "submodel", "waveform",
]  # fmt: skip
