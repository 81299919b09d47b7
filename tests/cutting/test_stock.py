"""The stock as one writes it, and what is refused."""

from pathlib import Path

import pytest

from pipeline.cutting.stock import Box, Cylinder, Mesh, stock_of


def test_a_line_names_a_box() -> None:
    assert stock_of("box:0,100,-30,30,-20,0") == Box(x_mm=(0, 100), y_mm=(-30, 30), z_mm=(-20, 0))


def test_a_line_names_a_cylinder() -> None:
    stock = stock_of(" cylinder:10, 20, 50, -20, 0 ")
    assert stock == Cylinder(x_mm=10, y_mm=20, diameter_mm=50, z_mm=(-20, 0))


def test_a_path_names_a_mesh() -> None:
    assert stock_of("blanks/Casting.STL") == Mesh(path=Path("blanks/Casting.STL"))


def test_a_stock_without_height_is_one_without_material() -> None:
    assert stock_of("box:0,100,0,60,0,0") == Box(x_mm=(0, 100), y_mm=(0, 60), z_mm=(0, 0))


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
        ("cylinder:0,0,-5,-20,0", "diameter_mm = -5.0 of the cylinder must be above 0"),
        ("cylinder:nan,0,5,-20,0", "cylinder at nan, 0.0 is not finite"),
    ],
)
def test_what_is_refused_is_named(text: str, says: str) -> None:
    with pytest.raises(ValueError) as error:
        stock_of(text)
    assert says in str(error.value)


def test_a_mesh_has_a_scale_above_0() -> None:
    with pytest.raises(ValueError, match=r"scale = 0 of a\.stl"):
        Mesh(path=Path("a.stl"), scale=0)
