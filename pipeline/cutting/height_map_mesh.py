"""Height map of a closed surface of triangles: the highest surface over each column."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.cutting.height_map import MM, HeightMap, empty_map
from pipeline.cutting.stock import Mesh

if TYPE_CHECKING:
    import trimesh

_LOST_SHARE = 0.01


def mesh_map(stock: Mesh, resolution_m: float) -> HeightMap:
    """Columns of a mesh; its lowest point is the floor.

    Returns
    -------
    HeightMap
        With a notice where cavities or undercuts count as full.

    Raises
    ------
    ValueError
        When trimesh is not installed, the file cannot be read, has no triangles or is not closed.
    """
    from pipeline.cutting.height_map_triangles import raise_to_triangles

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
    return replace(
        grid,
        notice=(
            f"stock {stock.path}: the height map holds {filled / exact:.1%} more material than the "
            "mesh, because what is under its highest surface counts as full: undercuts and "
            "cavities are not modelled, or the resolution is too coarse"
        ),
    )


def _closed_mesh(stock: Mesh) -> "trimesh.Trimesh":
    try:
        import trimesh
    except ImportError as error:
        raise ValueError(
            f"stock {stock.path}: reading STL needs trimesh: install kerf[stl]"
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
