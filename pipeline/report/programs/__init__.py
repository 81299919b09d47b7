"""Simulated part programs on a machine's page: paths, feed over time, time by cause.

Positions are in the machine's frame [mm], feeds in [mm/min], times in [s].  Summaries are read as
:class:`~pipeline.schema.program.SimulatedProgram`, moves from the Parquet file beside each.
"""

__all__ = ["map", "moves", "section", "times"]
