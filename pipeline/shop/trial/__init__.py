"""Trials: the simulated mill cuts a part by any program, with a dynamometer under it.

Coordinates are those of the work offset [mm], forces act on the tool along X and Y [N]; commands
that the mill drives with and without a correction are in its own frame [mm].  The
kinematics of the teeth follow Kline and DeVor (1983); sources of the scatter from part to part
stand in :mod:`pipeline.shop.trial.cutting`.
"""

__all__ = ["corrected", "job", "trials"]
