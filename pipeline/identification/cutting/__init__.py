"""Cutting: force coefficients, runout and spindle power from records of cuts."""
