"""Mechanics of a feed drive from recorded motion and command: mass, friction, offset, intervals.

Regression on filtered motion and force (Gautier, Vandanjon and Presse 1994), in SI at the carriage.
"""

__all__ = [
    "estimates",
    "feed_drive",
    "friction",
    "identifiability",
    "inverse_dynamics",
    "motion",
    "recursive",
    "uncertainty",
]
