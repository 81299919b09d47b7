"""Quantities with a unit and a range, and the check that a parameter keeps its range."""

from dataclasses import dataclass, field, fields
from typing import Any


def quantity(default: Any, unit: str, low: float, high: float) -> Any:
    """Field of a parameter class: default value, unit (``"1"`` for none) and allowed range."""
    return field(default=default, metadata={"unit": unit, "low": low, "high": high})


@dataclass(frozen=True, kw_only=True)
class Ranged:
    """Base of parameter classes: each :func:`quantity` must lie in its range.

    Raises
    ------
    ValueError
        When a value lies outside; the message has class, name, value, unit and range.
    """

    def __post_init__(self) -> None:
        for f in fields(self):
            if "low" not in f.metadata:
                continue
            value, low, high = getattr(self, f.name), f.metadata["low"], f.metadata["high"]
            if not low <= value <= high:
                raise ValueError(
                    f"{type(self).__name__}.{f.name} = {value} [{f.metadata['unit']}] must lie "
                    f"between {low} and {high}"
                )
