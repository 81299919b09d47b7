"""G68, G69 (rotation), G50, G51, G50.1, G51.1 (scaling, mirror), G15, G16 (polar) of a Fanuc."""

from pipeline.gcode.block import Block
from pipeline.gcode.offset_codes import guard_contour
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.run import Run
from pipeline.gcode.statements import WordItem

LETTERS = "XYZ"
FACTOR = 1e-3
"""Of P, I, J and K of G51 without a decimal point."""


def rotation(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G68 X Y R: about a point, or about where the tool stands; R adds up under G91."""
    guard_contour(run, block, item)
    offsets = run.offsets
    if code == 690:
        offsets.rotation = 0.0
        run.remap()
        return
    plane = run.state.plane
    here = run.point
    centre = []
    for axis in IN_PLANE[plane][:2]:
        value = block.take(LETTERS[axis])
        centre.append(here[axis] if value is None else value * run.state.unit)
    angle = block.need("R", "G68", item)
    turned = offsets.rotation != 0 and not run.state.absolute
    offsets.rotation = angle + (offsets.rotation if turned else 0.0)
    offsets.pivot, offsets.pivot_plane = (centre[0], centre[1]), plane
    run.remap()


def scaling(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G51 X Y Z P, or I J K for each axis; G50 ends it."""
    guard_contour(run, block, item)
    offsets = run.offsets
    if code == 500:
        offsets.scale = [1.0] * 3
        run.remap()
        return
    here = run.point
    for axis, letter in enumerate(LETTERS):
        value = block.take(letter)
        offsets.scale_centre[axis] = here[axis] if value is None else value * run.state.unit
    common = _factor(block, "P")
    each = [_factor(block, letter) for letter in "IJK"]
    if common is None and each == [None] * 3:
        raise block.error(item, "G51 does not say by how much: add P, or I J K")
    offsets.scale = [common or 1.0] * 3 if each == [None] * 3 else [f or 1.0 for f in each]
    if 0.0 in (common, *each):
        raise block.error(item, "G51 scales by 0: give a factor that is not 0")
    run.remap()


def _factor(block: Block, letter: str) -> float | None:
    value = block.take(letter)
    if value is None:
        return None
    return value if "." in block.items[letter].text else value * FACTOR


def mirror(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G51.1 X Y Z: mirrored about these coordinates; G50.1 ends it for the axes that it names."""
    guard_contour(run, block, item)
    offsets = run.offsets
    named = {axis: block.take(letter) for axis, letter in enumerate(LETTERS)}
    given = {axis: value for axis, value in named.items() if value is not None}
    if code == 501 and not given:
        offsets.mirror = [1.0] * 3
    elif not given:
        raise block.error(item, "G51.1 names no axis: add X, Y or Z")
    for axis, value in given.items():
        offsets.mirror[axis] = 1.0 if code == 501 else -1.0
        offsets.mirror_centre[axis] = value * run.state.unit
    run.remap()


def polar(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G16: the plane's first axis is a radius, its second an angle; G15 ends it."""
    guard_contour(run, block, item)
    run.offsets.polar = code == 160
    run.polar_angle = None
    run.remap()
