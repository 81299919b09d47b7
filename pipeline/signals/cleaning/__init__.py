"""Cleaning of a machine's records: gaps, glitches, the state table on a regular grid, activity.

Values that cannot be true are removed and audited, never replaced.  The state table has one row a
period, in the units of the table of signals, UTC; cycles of programs and segments (off, warm_up,
idle, air, cut) are derived from it.  States are those of the MTConnect controller (ANSI/MTC1.4).
"""

__all__ = ["clean", "settings"]
