"""Drift, the twin's state, condition by week, incidents of the machine, as-built parts, replay.

Errors come from the contract of a sub-model, times from the records, limits from its targets; the
sequential test is Page and Hinkley's (E. S. Page, Biometrika 41, 1954), from the library river.
"""

__all__ = [
    "budget", "condition", "day_estimates", "delivery", "drift", "forest", "incident_settings",
    "incidents", "nightly", "part_record", "reasons", "replay", "replay_parts", "replay_windows",
    "state", "usual",
]  # fmt: skip
