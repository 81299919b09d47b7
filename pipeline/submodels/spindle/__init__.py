"""Spindle temperature from speed and load: thermal network, random forest on its residual.

The network (:mod:`pipeline.thermal.network`) is fitted to the clean state table of training days in
[degC] and SI units; a forest corrects it where days left out say that it helps (Twin2026).
"""

__all__ = ["days", "fit", "reruns", "submodel", "transfer"]
