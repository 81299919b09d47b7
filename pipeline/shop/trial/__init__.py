"""Trial cuts: the simulated mill cuts a part by any program, with a dynamometer under it.

Coordinates are those of the work offset [mm], forces act on the tool along X and Y [N]; commands
are in the machine's frame [mm].  The kinematics of the teeth follow Kline and DeVor (1983).
"""

__all__ = ["job", "trials"]
