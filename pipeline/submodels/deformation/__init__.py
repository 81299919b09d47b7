"""Spindle growth, identified from recordings of temperatures and a displacement probe.

Growth [um] is the displacement since the start of a recording, temperatures are in degC, spindle
speeds in rev/min, times in seconds.  Several methods compete; the one with the smallest error on
whole recordings left out of its fit is stored and served.  Source of the fuzzy-filtered network and
of its baselines: FFNN2015.
"""

__all__ = ["control_text", "methods", "model", "records", "submodel", "thermal_growth"]
