"""Cleaning of a machine's records: gaps, glitches, the state table on a regular grid, activity.

Values that cannot be true are removed and audited, never replaced.  States are those of the
MTConnect controller (ANSI/MTC1.4).
"""

__all__ = ["clean", "settings"]
