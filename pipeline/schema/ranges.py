"""Ranges of parameters, declared on the field and checked in one place.

A field says its range in its type, with the unit where it has one::

    @dataclass(frozen=True, kw_only=True)
    class Friction(Ranged, section="friction"):
        coulomb: Annotated[float, Range(least=0.0, unit="N")]
        stribeck_velocity: Annotated[float, Range(above=0.0, unit="m/s")]

A value out of range is refused with section, name, value, unit and range.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import inf, isnan
from numbers import Real
from typing import Annotated, Any, ClassVar, get_args, get_origin, get_type_hints


@dataclass(frozen=True, kw_only=True)
class Range:
    """Values that a number may have.

    Examples
    --------
    >>> Range(above=0.0).holds(1.0), Range(least=0.0, most=1.0).words
    (True, 'must lie from 0 to 1')
    """

    least: float = -inf
    most: float = inf
    """Smallest and greatest value that is allowed."""
    above: float = -inf
    below: float = inf
    """Values that all allowed ones lie above and below."""
    finite: bool = True
    """Whether infinity is refused."""
    unit: str = ""
    """Unit of the number, ``""`` for none."""

    def holds(self, value: float) -> bool:
        """Whether ``value`` lies in the range; NaN lies in none."""
        if isnan(value) or (self.finite and abs(value) == inf):
            return False
        low = value >= self.least and (self.above == -inf or value > self.above)
        return low and value <= self.most and (self.below == inf or value < self.below)

    @property
    def words(self) -> str:
        """Requirement on a value, as the end of a sentence."""
        low = f"above {self.above:g}" if self.above > -inf else f"from {self.least:g}"
        high = f"below {self.below:g}" if self.below < inf else f"to {self.most:g}"
        finite = "finite and " if self.finite else ""
        if self.most == inf and self.below == inf:
            if self.above == 0:
                return f"must be {finite}positive"
            if self.above > -inf:
                return f"must be {finite}{low}"
            if self.least > -inf:
                return f"must be {finite}at least {self.least:g}"
            return "must be finite" if self.finite else "must be a number"
        if self.least == -inf and self.above == -inf:
            return f"must be {high if self.below < inf else f'at most {self.most:g}'}"
        if self.above > -inf or self.below < inf:
            end = high if self.below < inf else f"at most {self.most:g}"
            return f"must lie {low} and {end}"
        return f"must lie {low} {high}"


Positive = Annotated[float, Range(above=0.0)]
NotNegative = Annotated[float, Range(least=0.0)]
Share = Annotated[float, Range(least=0.0, most=1.0)]
Finite = Annotated[float, Range()]
Count = Annotated[int, Range(least=1)]


class Ranged:
    """Base of dataclasses whose fields declare ranges.

    ``section`` names the class in messages as a person knows it: the section of params.yaml.  A
    field without a value (``None``) is not checked; of a list, a tuple or a mapping each number is.
    A value outside its range is a ValueError with section, name, value, unit and range.
    """

    section: ClassVar[str] = ""

    def __init_subclass__(cls, section: str = "", **more: Any) -> None:
        super().__init_subclass__(**more)
        if section:
            cls.section = section

    def __post_init__(self) -> None:
        kind: Any = type(self)
        declared = _ranges(kind)
        for name, allowed in declared.items():
            given = getattr(self, name)
            if given is None or (type(given) is float and allowed.holds(given)):
                continue  # nearly all fields: no list of numbers needs to be made
            for value in _numbers(given):
                if not allowed.holds(value):
                    prefix = f"{self.section}." if self.section else ""
                    unit = f" {allowed.unit}" if allowed.unit else ""
                    raise ValueError(f"{prefix}{name} = {value}{unit} {allowed.words}")


@cache
def _ranges(cls: Any) -> dict[str, Range]:
    """Range of each field of a dataclass that declares one, wherever in its type it stands."""
    hints = get_type_hints(cls, include_extras=True)
    found = {item.name: _range_in(hints[item.name]) for item in fields(cls)}
    return {name: allowed for name, allowed in found.items() if allowed is not None}


def _range_in(hint: Any) -> Range | None:
    if get_origin(hint) is Annotated:
        for extra in hint.__metadata__:
            if isinstance(extra, Range):
                return extra
    return next((r for part in get_args(hint) if (r := _range_in(part)) is not None), None)


def _numbers(value: Any) -> list[Any]:
    """The numbers that a value holds; a value that is none is left to the type."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [number for one in value for number in _numbers(one)]
    return [value] if isinstance(value, Real) and not isinstance(value, bool) else []
