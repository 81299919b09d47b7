"""Stock: the blank that a program starts from, in the program's work coordinates.

A height map is made of it (:mod:`pipeline.cutting.engagement.height_map`): one height a column, so
that of a cavity or an undercut only the highest surface is kept.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from pipeline.schema.ranges import Finite, Positive, Ranged

Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Box:
    """Block with edges along the axes."""

    x_mm: Span
    y_mm: Span
    z_mm: Span
    """Lower and upper end [mm]; a block without height is a stock without material."""

    def __post_init__(self) -> None:
        _check_range("x_mm", self.x_mm)
        _check_range("y_mm", self.y_mm)
        _check_range("z_mm", self.z_mm, empty=True)


@dataclass(frozen=True, kw_only=True)
class Cylinder(Ranged, section="stock"):
    """Round bar with a vertical axis."""

    x_mm: Finite
    y_mm: Finite
    """Position of the cylinder's axis along x and y [mm]."""
    diameter_mm: Positive
    """Diameter [mm]."""
    z_mm: Span
    """Lower and upper end [mm]; a bar without height is a stock without material."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_range("z_mm", self.z_mm, empty=True)


@dataclass(frozen=True, kw_only=True)
class Mesh(Ranged, section="stock"):
    """Closed surface of triangles, read from an STL file."""

    path: Path
    """The file, in the program's work coordinates."""
    scale: Positive = 1.0
    """Millimetres to one unit of the file: 25.4 where it is in inches."""


Stock = Box | Cylinder | Mesh

_FORMS = {"box": (6, "box:X0,X1,Y0,Y1,Z0,Z1"), "cylinder": (5, "cylinder:X,Y,DIAMETER,Z0,Z1")}


def stock_of(text: str) -> Stock:
    """Stock from a line of text: a box, a cylinder or an STL file [mm].

    ``box:X0,X1,Y0,Y1,Z0,Z1``, ``cylinder:X,Y,DIAMETER,Z0,Z1``, or the path of an STL file.
    ValueError when it is none of them, or a value is out of its range.

    Examples
    --------
    >>> stock_of("box:0,100,0,60,-20,0").z_mm
    (-20.0, 0.0)
    """
    form, colon, rest = text.strip().partition(":")
    if colon and form in _FORMS:
        values = _numbers(text, rest, form)
        if form == "box":
            x0, x1, y0, y1, z0, z1 = values
            return Box(x_mm=(x0, x1), y_mm=(y0, y1), z_mm=(z0, z1))
        x, y, diameter, z0, z1 = values
        return Cylinder(x_mm=x, y_mm=y, diameter_mm=diameter, z_mm=(z0, z1))
    if text.strip().lower().endswith(".stl"):
        return Mesh(path=Path(text.strip()))
    forms = ", ".join(pattern for _, pattern in _FORMS.values())
    raise ValueError(f"stock {text!r} is none of {forms} [mm] and no path of an .stl file")


def _numbers(text: str, rest: str, form: str) -> Sequence[float]:
    many, pattern = _FORMS[form]
    try:
        values = [float(word) for word in rest.split(",")]
    except ValueError:
        values = []
    if len(values) != many:
        raise ValueError(f"stock {text!r} has not the {many} numbers of {pattern} [mm]")
    return values


def _check_range(name: str, bounds: Span, *, empty: bool = False) -> None:
    low, high = bounds
    if not (isfinite(low) and isfinite(high)):
        raise ValueError(f"stock: {name} from {low:g} to {high:g} is not finite")
    if high < low or (high == low and not empty):
        raise ValueError(
            f"stock: {name} from {low:g} to {high:g} holds nothing: write the smaller one first"
        )
