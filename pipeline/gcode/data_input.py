"""G10: offsets and tool data from the program."""

from pipeline.gcode.block import Block
from pipeline.gcode.offset_codes import LOCAL_SYSTEMS, axis_words, guard_contour
from pipeline.gcode.run import Run
from pipeline.gcode.state import LINUXCNC
from pipeline.gcode.statements import WordItem

LARGEST = 99_999_999
SYSTEMS = ("EXT", "G54", "G55", "G56", "G57", "G58", "G59")
"""By the P of a Fanuc G10 L2."""
LINUXCNC_SYSTEMS = ("", "G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def data_input(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G10 L1, L2, L10 to L13, L20, as the dialect means them."""
    number = block.take("L")
    if run.state.dialect == LINUXCNC:
        kind = block.whole("L", number or 0, 0, LARGEST)
        if kind in (2, 20):
            _linuxcnc_system(run, block, item, kind)
        elif kind in (1, 10, 11):
            _linuxcnc_tool(run, block, item, kind)
        else:
            raise block.error(item, f"G10 L{kind} is not supported: use L1, L2, L10, L11 or L20")
        return
    kind = 10 if number is None else block.whole("L", number, 0, LARGEST)
    if kind in (2, 20):
        _fanuc_system(run, block, item, kind)
    elif kind in (1, 10, 11, 12, 13):
        _fanuc_register(run, block, item, kind)
    else:
        raise block.error(
            item, f"G10 L{kind} is not supported: only L2, L20 and L10 to L13 change the path"
        )


def _fanuc_system(run: Run, block: Block, item: WordItem, kind: int) -> None:
    guard_contour(run, block, item)
    number = block.need("P", f"G10 L{kind}", item)
    if kind == 2:
        name = SYSTEMS[block.whole("P", number, 0, 6)]
    else:
        name = f"G54.1 P{block.whole('P', number, 1, LOCAL_SYSTEMS)}"
    offset = run.offsets.work.setdefault(name, [0.0] * 6)
    for axis, value in axis_words(run, block).items():
        offset[axis] = value if run.state.absolute else offset[axis] + value
    run.remap()


def _fanuc_register(run: Run, block: Block, item: WordItem, kind: int) -> None:
    number = block.whole("P", block.need("P", "G10", item), 1, LARGEST)
    value = block.need("R", "G10", item) * run.state.unit
    entry = run.register(number)
    name = {1: "length", 10: "length", 11: "length_wear", 12: "radius", 13: "radius_wear"}[kind]
    setattr(entry, name, value if run.state.absolute else getattr(entry, name) + value)


def _linuxcnc_system(run: Run, block: Block, item: WordItem, kind: int) -> None:
    """L2 gives the offset; L20 gives the coordinates of where the tool stands."""
    guard_contour(run, block, item)
    offsets = run.offsets
    number = block.whole("P", block.need("P", f"G10 L{kind}", item), 0, 9)
    name = LINUXCNC_SYSTEMS[number] or offsets.active
    offset = offsets.work.setdefault(name, [0.0] * 6)
    angle = block.take("R")
    if angle is not None and kind == 20:
        raise block.error(item, "G10 L20 takes no R: rotate with G10 L2 R")
    given = axis_words(run, block)
    if kind == 2:
        if angle is not None:
            offsets.turned[name] = angle
        for axis, value in given.items():
            offset[axis] = value
    else:
        _place(run, name, given)
    run.remap()


def _place(run: Run, name: str, given: dict[int, float]) -> None:
    """Set an offset so that the tool stands where ``given`` says."""
    offsets = run.offsets
    active, offsets.active = offsets.active, name
    mapping = offsets.mapping()
    point = mapping.program(run.state.position)
    there = mapping.machine([given.get(axis, point[axis]) for axis in range(6)])
    offset = offsets.work[name]
    offsets.work[name] = [
        o + h - t for o, h, t in zip(offset, run.state.position, there, strict=True)
    ]
    offsets.active = active


def _linuxcnc_tool(run: Run, block: Block, item: WordItem, kind: int) -> None:
    """L1 gives a tool's data; L10 (L11) from where it stands in the system in force (in G59.3)."""
    number = block.whole("P", block.need("P", f"G10 L{kind}", item), 1, LARGEST)
    if number not in run.registers:
        raise block.error(
            item,
            f"tool {number} is not in the tool table: add it to setup.tools of the machine's file",
        )
    entry = run.registers[number]
    radius = block.take("R")
    if radius is not None:
        entry.radius = radius * run.state.unit
    for letter in "IJQ":
        block.take(letter)  # angles and orientation of a lathe tool: no motion on a mill
    given = axis_words(run, block)
    if given.keys() - {2}:
        raise block.error(item, "only Z offsets of tools are supported: leave the other axes out")
    if 2 not in given:
        return
    if kind == 1:
        entry.length = given[2]
        return
    offsets = run.offsets
    active, length = offsets.active, offsets.length
    offsets.length = [0.0] * 6
    if kind == 11:
        offsets.active = "G59.3"
    bare = offsets.mapping().program(run.state.position)
    entry.length = bare[2] - given[2]
    offsets.active, offsets.length = active, length
