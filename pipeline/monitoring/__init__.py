"""Drift of the models that serve, the state that they estimate, condition by week, as-built parts.

Errors come from the contract of a sub-model, times from the records, limits from its targets; the
sequential test is Page and Hinkley's (E. S. Page, Biometrika 41, 1954), from the library river.
"""

__all__ = ["budget", "condition", "drift", "nightly", "part_record", "reasons", "state"]
