"""The stock as one writes it, and what is refused."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.engagement.stock import Box, Cylinder, Mesh, height_map, rows_of, stock_of


@pytest.mark.parametrize(
    ("text", "stock"),
    [
        ("box:0,100,-30,30,-20,0", Box(x_mm=(0, 100), y_mm=(-30, 30), z_mm=(-20, 0))),
        ("box:0,100,0,60,0,0", Box(x_mm=(0, 100), y_mm=(0, 60), z_mm=(0, 0))),
        (
            " cylinder:10, 20, 50, -20, 0 ",
            Cylinder(x_mm=10, y_mm=20, diameter_mm=50, z_mm=(-20, 0)),
        ),
        ("blanks/Casting.STL", Mesh(path=Path("blanks/Casting.STL"))),
    ],
)
def test_a_line_names_a_stock(text: str, stock) -> None:
    assert stock_of(text) == stock


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "none of box:X0"),
        ("sphere:1,2,3", "'sphere:1,2,3' is none of"),
        ("casting.step", "'casting.step' is none of"),
        ("box:0,100,0,60,0", "the 6 numbers of box:X0"),
        ("box:0,100,0,60,0,top", "the 6 numbers of box:X0"),
        ("cylinder:0,0,50,0", "the 5 numbers of cylinder:X,Y"),
        ("box:100,0,0,60,-20,0", "x_mm from 100 to 0 holds nothing"),
        ("box:0,0,0,60,-20,0", "x_mm from 0 to 0 holds nothing"),
        ("box:0,100,0,60,0,-20", "z_mm from 0 to -20 holds nothing"),
        ("box:0,inf,0,60,-20,0", "x_mm from 0 to inf is not finite"),
        ("box:0,100,0,60,nan,0", "z_mm from nan to 0 is not finite"),
        ("cylinder:0,0,-5,-20,0", "stock.diameter_mm = -5.0 must be finite and positive"),
        ("cylinder:nan,0,5,-20,0", "stock.x_mm = nan must be finite"),
    ],
)
def test_what_is_refused_is_named(text: str, says: str) -> None:
    with pytest.raises(ValueError) as error:
        stock_of(text)
    assert says in str(error.value)


def test_a_mesh_has_a_scale_above_0() -> None:
    with pytest.raises(ValueError, match=r"stock\.scale = 0 must be finite and positive"):
        Mesh(path=Path("a.stl"), scale=0)


MM = 1e-3
CUBIC_MM = MM**3


def test_a_box_of_whole_cells_is_exact() -> None:
    stock = height_map(stock_of("box:0,100,0,60,-20,0"), 0.2 * MM)
    # heights are kept to 7 digits
    assert stock.volume == pytest.approx(100 * 60 * 20 * CUBIC_MM, rel=1e-6)


@settings(deadline=None)
@given(x0=st.floats(-50, 50), y0=st.floats(-50, 50), width=st.floats(5, 30), depth=st.floats(5, 30))
def test_a_box_anywhere_errs_far_less_than_a_cell_at_its_edge(x0, y0, width, depth) -> None:
    cell = 0.2
    stock = Box(x_mm=(x0, x0 + width), y_mm=(y0, y0 + depth), z_mm=(-1, 0))
    error = height_map(stock, cell * MM).volume / CUBIC_MM - width * depth
    # columns in the middle of their cells err by up to half a cell along each of the four edges;
    # a Kronecker sequence of irrationals of small quotients by about 2 columns an edge (3 where
    # two edges meet a corner's column)
    assert abs(error) < 7 * cell**2
    assert 7 * cell**2 < 0.5 * cell * min(width, depth)


def test_a_cylinder_errs_ever_less() -> None:
    stock = Cylinder(x_mm=3.3, y_mm=-7.1, diameter_mm=40, z_mm=(0, 10))
    exact = np.pi * 400 * 10
    errors = [
        abs(height_map(stock, cell * MM).volume / CUBIC_MM / exact - 1) for cell in (0.8, 0.2, 0.05)
    ]
    # the rim takes pi D / cell columns or leaves them, as if at random: error ~ cell^1.5
    bounds = [0.6 * cell**1.5 * (np.pi * 40) ** 0.5 / (np.pi * 400) for cell in (0.8, 0.2, 0.05)]
    assert np.all(np.array(errors) < bounds)


def test_columns_lie_in_their_cells() -> None:
    stock = height_map(stock_of("box:-3,5,2,9,0,1"), 0.25 * MM)
    for row, (x, y) in enumerate(rows_of(stock)):
        column = np.arange(stock.heights.shape[1])
        np.testing.assert_array_equal(np.floor((x - stock.x0) / stock.cell + 1e-9), column)
        np.testing.assert_array_equal(np.floor((y - stock.y0) / stock.cell + 1e-9), row)


def test_margins_continue_the_shifts_of_the_map() -> None:
    stock = height_map(stock_of("box:0,7,0,5,0,1"), 0.25 * MM)
    for inner, outer in zip(stock.shifts(), stock.shifts(40), strict=True):
        np.testing.assert_array_equal(outer[40:-40], inner)


def test_an_empty_stock_has_no_volume() -> None:
    assert height_map(stock_of("box:0,100,0,60,-5,-5"), 0.5 * MM).volume == 0.0


@pytest.mark.parametrize("resolution", [0.0, -0.1 * MM, np.nan, np.inf])
def test_a_resolution_is_above_0(resolution: float) -> None:
    with pytest.raises(ValueError, match="resolution of the height map is"):
        height_map(stock_of("box:0,1,0,1,0,1"), resolution)


def test_too_fine_a_map_is_refused_with_the_resolution_that_fits() -> None:
    with pytest.raises(ValueError, match=r"give a resolution of 0\.16 mm or more"):
        height_map(stock_of("box:0,1000,0,1000,0,1"), 0.01 * MM)


@pytest.fixture()
def mesh_of(tmp_path):
    trimesh = pytest.importorskip("trimesh")

    def write(mesh) -> Mesh:
        mesh.export(tmp_path / "stock.stl")
        return Mesh(path=tmp_path / "stock.stl")

    return trimesh, write


def test_a_box_as_a_mesh_is_the_box(mesh_of) -> None:
    trimesh, write = mesh_of
    mesh = trimesh.creation.box(extents=(40, 30, 20))
    mesh.apply_translation((20, 15, -10))
    from_mesh = height_map(write(mesh), 0.3 * MM)
    box = height_map(stock_of("box:0,40,0,30,-20,0"), 0.3 * MM)
    np.testing.assert_allclose(from_mesh.heights, box.heights, atol=1e-9)
    assert from_mesh.notice == ""
    assert (from_mesh.x0, from_mesh.y0, from_mesh.floor) == pytest.approx((0, 0, box.floor))


def test_a_mesh_in_inches_is_scaled(mesh_of) -> None:
    trimesh, write = mesh_of
    stock = write(trimesh.creation.box(extents=(1, 2, 1)))
    inches = height_map(Mesh(path=stock.path, scale=25.4), 0.2 * MM)
    assert inches.volume / CUBIC_MM == pytest.approx(2 * 25.4**3, rel=0.005)


def test_a_cone_has_the_height_of_its_flank(mesh_of) -> None:
    trimesh, write = mesh_of
    # a pyramid of 256 sides, 20 high over a radius of 10
    stock = height_map(write(trimesh.creation.cone(radius=10, height=20, sections=256)), 0.1 * MM)
    for row, (x, y) in enumerate(rows_of(stock)):
        r = np.hypot(x, y) / MM
        flank = np.clip(20 * (1 - r / 10), 0, None)
        # a chord lies r (1 - cos(pi / 256)) within the circle
        np.testing.assert_allclose(stock.heights[row] / MM, flank, atol=20 * 7.6e-5 + 1e-4)


def test_an_undercut_counts_as_full_and_is_said(mesh_of) -> None:
    trimesh, write = mesh_of
    ball = trimesh.creation.icosphere(subdivisions=4, radius=10)
    stock = height_map(write(ball), 0.2 * MM)
    # below the equator a ball becomes a cylinder: 5/4 of its volume
    assert stock.volume / CUBIC_MM == pytest.approx(1.25 * ball.volume, rel=0.005)
    assert re.search(r"holds 2[45]\.\d% more .* undercuts", stock.notice)


def test_a_mesh_with_a_hole_is_refused(mesh_of) -> None:
    trimesh, write = mesh_of
    mesh = trimesh.creation.box(extents=(1, 1, 1))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    with pytest.raises(ValueError, match="is not closed"):
        height_map(write(mesh), 0.1 * MM)


@pytest.mark.parametrize(
    "content",
    [b"", b"solid nothing\nendsolid nothing\n", b"\x00" * 84, b"\xff\xfe not a mesh " * 9],
)
def test_a_file_without_triangles_is_refused_in_one_sentence(tmp_path, content: bytes) -> None:
    pytest.importorskip("trimesh")
    path = tmp_path / "stock.stl"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"stock .*stock\.stl (has no|cannot be read)") as error:
        height_map(Mesh(path=path), 0.1 * MM)
    assert "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path) -> None:
    pytest.importorskip("trimesh")
    with pytest.raises(ValueError, match=r"none\.stl is not a file"):
        height_map(Mesh(path=tmp_path / "none.stl"), 0.1 * MM)
