"""What the limits of an optimisation are called on its pages."""

from typing import Any

LIMITS = {"as programmed": "chip as it was programmed"}
"""Limits whose own name says too little beside the others."""


def limit_name(name: Any) -> str:
    """A limit in words, small; "nothing" where none binds."""
    return LIMITS.get(str(name), str(name)) if name else "nothing"
