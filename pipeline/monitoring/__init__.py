"""Drift of the models that serve, the state that they estimate, and incidents of the machine.

Errors come from the contract of a sub-model, times from the records, limits from its targets; the
sequential test is Page and Hinkley's (E. S. Page, Biometrika 41, 1954), from the library river.
"""

__all__ = [
    "budget", "delivery", "drift", "forest", "incident_settings", "incidents", "nightly",
    "reasons", "state", "usual",
]  # fmt: skip
