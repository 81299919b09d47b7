"""Drift, the twin's state, condition by week, incidents of the machine, as-built parts.

Errors come from the contract of a sub-model, times from the records, limits from its targets; the
sequential test is Page and Hinkley's (E. S. Page, Biometrika 41, 1954), from the library river.
"""

__all__ = [
    "budget", "condition", "delivery", "drift", "forest", "incident_settings", "incidents",
    "nightly", "part_record", "reasons", "state", "usual",
]  # fmt: skip
