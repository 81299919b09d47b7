"""Stock: the blank that a program starts from, in its work coordinates, and its height map.

The height map has columns of material, one to each square cell of a grid.  Each column stands for
the area of its cell and is cut where it stands, wholly or not at all, so that what is cut once is
not cut again.  Columns do not stand in the middle of their cells: from row to row and from column
to column their place moves by an irrational part of a cell (a Kronecker sequence, the
one-dimensional sequence of least discrepancy).  An edge along a row or across it then divides its
cells' columns in proportion to their areas, and areas come out far better than to a cell: a slot's
volume errs by less than 0.1 % where its width is 50 cells.

Below the floor there is no material; an undercut or a cavity counts as full.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, fsum, isfinite, sqrt
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Singles
from pipeline.schema.ranges import Finite, Positive, Ranged
from pipeline.schema.si import MM

if TYPE_CHECKING:
    import trimesh

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


MOST_CELLS = 40_000_000
"""160 MB; two maps, before and after, stay within memory."""
_SHIFT_OF_ROW = (sqrt(5) - 1) / 2
_SHIFT_OF_COLUMN = sqrt(2) - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class HeightMap:
    """Columns of material on a grid of square cells."""

    x0: float
    y0: float
    """Corner of the grid with the least x and y [m]."""
    cell: float
    """Edge of a cell: the resolution [m]."""
    heights: Singles
    """Top of the material in each cell [m], ``floor`` without any; rows along y, (rows,
    columns)."""
    floor: float
    """Underside of the stock [m]."""
    notice: str = ""
    """Part of the stock that the map cannot hold; empty when it holds all."""

    @property
    def volume(self) -> float:
        """Volume of the material [m^3]."""
        floor = float(np.float32(self.floor))
        # row by row: a copy in double precision would need twice the memory of the map
        above = [float((row.astype(np.float64) - floor).sum()) for row in self.heights]
        return fsum(above) * self.cell**2

    def shifts(self, margin: int = 0) -> tuple[Floats, Floats]:
        """Positions of the columns in their cells, in cells.

        Along x by row, shape (rows + 2 margin,), and along y by column, shape (columns + 2
        margin,); ``margin`` is the number of cells around the map.
        """
        rows, columns = self.heights.shape
        row, column = (np.arange(-margin, many + margin) for many in (rows, columns))
        return (0.5 + _SHIFT_OF_ROW * row) % 1.0, (0.5 + _SHIFT_OF_COLUMN * column) % 1.0


def height_map(stock: Stock, resolution_m: float) -> HeightMap:
    """Columns of a stock.

    ``resolution_m`` is the edge of a cell [m]. ValueError when the resolution is not above 0 or the
    grid has too many cells, or a mesh cannot be used.
    """
    if isinstance(stock, Mesh):
        return mesh_map(stock, resolution_m)
    if isinstance(stock, Box):
        (x_low, x_high), (y_low, y_high) = stock.x_mm, stock.y_mm
    else:
        r = stock.diameter_mm / 2
        x_low, x_high = stock.x_mm - r, stock.x_mm + r
        y_low, y_high = stock.y_mm - r, stock.y_mm + r
    low, high = (z * MM for z in stock.z_mm)
    grid = empty_map((x_low * MM, x_high * MM), (y_low * MM, y_high * MM), low, resolution_m)
    # row by row: the places of all columns would need many times the memory of the map
    for row, (x, y) in enumerate(rows_of(grid)):
        grid.heights[row, _inside(stock, x, y)] = high
    return grid


def empty_map(
    x: tuple[float, float], y: tuple[float, float], floor: float, resolution_m: float
) -> HeightMap:
    """Grid over a rectangle [m] without material; ValueError as in :func:`height_map`."""
    if not 0 < resolution_m < np.inf:
        raise ValueError(
            f"resolution of the height map is {resolution_m / MM:g} mm: give one above 0"
        )
    columns, rows = ((high - low) / resolution_m for low, high in (x, y))
    if columns * rows > MOST_CELLS:
        enough = resolution_m * sqrt(columns * rows / MOST_CELLS) / MM
        raise ValueError(
            f"height map: {columns * rows:.3g} cells of {resolution_m / MM:g} mm are more than the "
            f"{MOST_CELLS:.3g} that memory allows: give a resolution of {enough:.2g} mm or more"
        )
    # an edge that falls on a cell's boundary must not add a row for what rounding left over
    shape = max(1, ceil(rows - 1e-9)), max(1, ceil(columns - 1e-9))
    return HeightMap(
        x0=x[0], y0=y[0], cell=resolution_m, heights=np.full(shape, floor, np.float32), floor=floor
    )


def rows_of(grid: HeightMap) -> Iterator[tuple[Floats, Floats]]:
    """Positions of the columns along x and y [m], row by row; each of shape (columns,)."""
    columns = grid.heights.shape[1]
    shifts, across = grid.shifts()
    along = np.arange(columns)
    for row, shift in enumerate(shifts):
        yield grid.x0 + (along + shift) * grid.cell, grid.y0 + (row + across) * grid.cell


def _inside(stock: Box | Cylinder, x: Floats, y: Floats) -> Bools:
    if isinstance(stock, Box):
        return (x <= stock.x_mm[1] * MM) & (y <= stock.y_mm[1] * MM)
    r = stock.diameter_mm / 2 * MM
    return (x - stock.x_mm * MM) ** 2 + (y - stock.y_mm * MM) ** 2 <= r * r


_LOST_SHARE = 0.01


def mesh_map(stock: Mesh, resolution_m: float) -> HeightMap:
    """Columns of a mesh; its lowest point is the floor.

    A notice says where cavities or undercuts count as full. ValueError when trimesh is not
    installed, the file cannot be read, has no triangles or is not closed.
    """
    from pipeline.cutting.engagement.sweep_columns import raise_to_triangles

    mesh = _closed_mesh(stock)
    to_m = stock.scale * MM
    corners = np.ascontiguousarray(mesh.triangles, np.float64) * to_m
    (x_low, y_low, floor), (x_high, y_high, _) = corners.min((0, 1)), corners.max((0, 1))
    grid = empty_map((x_low, x_high), (y_low, y_high), float(floor), resolution_m)
    raise_to_triangles(corners, grid.heights, *grid.shifts(), grid.x0, grid.y0, grid.cell)
    exact = abs(float(mesh.volume)) * to_m**3
    filled = grid.volume - exact
    if filled <= _LOST_SHARE * exact:
        return grid
    notice = (
        f"stock {stock.path}: the height map holds {filled / exact:.1%} more material than the "
        "mesh, because what is under its highest surface counts as full: undercuts and "
        "cavities are not modelled, or the resolution is too coarse"
    )
    return replace(grid, notice=notice)


def _closed_mesh(stock: Mesh) -> "trimesh.Trimesh":
    try:
        import trimesh
    except ImportError as error:
        raise ValueError(
            f"stock {stock.path}: reading STL needs trimesh: pip install -e '.[stl]'"
        ) from error
    if not stock.path.is_file():
        raise ValueError(f"stock {stock.path} is not a file")
    try:
        mesh = trimesh.load_mesh(str(stock.path), file_type="stl")
    except (ValueError, TypeError, IndexError, KeyError, OSError, UnicodeError) as error:
        raise ValueError(f"stock {stock.path} cannot be read as STL: {error}") from error
    # what has no faces comes as an empty scene
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise ValueError(f"stock {stock.path} has no triangles")
    if not np.isfinite(mesh.vertices).all():
        raise ValueError(f"stock {stock.path} has a corner that is not finite")
    if not mesh.is_watertight:
        raise ValueError(
            f"stock {stock.path} is not closed: edges of its {len(mesh.faces)} triangles belong to "
            "one triangle only: repair the mesh, or give a box"
        )
    return mesh
