"""Loops of a feed drive from recorded reference, position and command: gains, feed-forward, lags.

The control law of a cascade (Sim2023) is fitted to the recorded command, in SI at the encoder.
"""

__all__ = ["equation", "fit", "loop_gain", "presliding", "search"]
