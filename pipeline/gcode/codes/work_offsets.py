"""Codes that set and choose offsets: G10, G15, G16, G28, G30, G50 to G59, G68, G69, G92."""

from pipeline.gcode.codes.motion import target
from pipeline.gcode.modal import FANUC, LINUXCNC, g_code
from pipeline.gcode.moves import IN_PLANE, Kind
from pipeline.gcode.run import AXES, Block, Run
from pipeline.gcode.setup import ZERO
from pipeline.gcode.statements import WordItem

LOCAL_SYSTEMS = 300
"""Work coordinate systems that G54.1 can name."""
NAMES = {
    540: "G54", 550: "G55", 560: "G56", 570: "G57", 580: "G58", 590: "G59",
    591: "G59.1", 592: "G59.2", 593: "G59.3", 5000: "G500",
}  # fmt: skip


def guard_contour(run: Run, block: Block, item: WordItem) -> None:
    """Offsets stay as they are while the tool runs beside a contour."""
    if run.contour is not None:
        raise block.error(
            item, f"{item.text} cannot come while G41 or G42 is in force: write G40 before it"
        )


def select_system(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G54 to G59, G54.1 P, G59.1 to G59.3."""
    state = run.state
    fanuc = state.dialect == FANUC
    if (code == 541 and not fanuc) or (code in (591, 592, 593) and state.dialect != LINUXCNC):
        raise block.error(item, f"{g_code(code)} is not known in this dialect: use G54 to G59")
    if code == 541 or (code == 540 and fanuc and "P" in block.words):
        number = block.need("P", "G54.1", item)
        name = f"G54.1 P{block.whole('P', number, 1, LOCAL_SYSTEMS)}"
        code = 541
    else:
        name = NAMES[code]
    if name == run.offsets.active:
        return
    guard_contour(run, block, item)
    run.offsets.active, state.wcs = name, code
    run.remap()


def local_system(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G52: a system inside the one in force; LinuxCNC keeps it where G92 keeps its shift."""
    guard_contour(run, block, item)
    given = block.take_axes(run.state.unit)
    if not given:
        raise block.error(item, "G52 names no axis: add X, Y or Z")
    shifts = run.offsets.g92 if run.state.dialect == LINUXCNC else run.offsets.g52
    for axis, value in given.items():
        shifts[axis] = value
    run.offsets.g92_kept = None
    run.remap()


def position_set(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G92: the point where the tool stands gets these coordinates; G92.1 to G92.3 undo it."""
    guard_contour(run, block, item)
    offsets = run.offsets
    if code == 920:
        given = block.take_axes(run.state.unit)
        if not given:
            raise block.error(item, "G92 names no axis: add X, Y or Z")
        point = run.point
        for axis, value in given.items():
            offsets.g92[axis] += point[axis] - value
        offsets.g92_kept = None
    elif code == 921:
        _preset(run, block, item)
    elif code == 922:
        if offsets.g92_kept is None:
            offsets.g92_kept, offsets.g92 = offsets.g92, [0.0] * 6
    elif offsets.g92_kept is not None:
        offsets.g92, offsets.g92_kept = offsets.g92_kept, None
    run.remap()


def _preset(run: Run, block: Block, item: WordItem) -> None:
    """G92.1: no shift any more, on a Fanuc in the axes that it names with 0."""
    offsets, axes = run.offsets, list(range(6))
    if run.state.dialect == FANUC:
        given = block.take_axes(run.state.unit)
        if any(given.values()):
            raise block.error(item, "G92.1 names axes with 0: write 0 behind each of them")
        axes = list(given) or axes
        for axis in axes:
            offsets.g52[axis] = 0.0
    for axis in axes:
        offsets.g92[axis] = 0.0
    offsets.g92_kept = None


def reference_return(run: Run, block: Block, code: int, item: WordItem) -> None:
    """G28, G30 P: over the point that the axis words name to the reference; G27: to it."""
    guard_contour(run, block, item)
    if code in (281, 301):
        position = tuple(run.state.position)
        a, b, c, d, e, f = position
        run.references["G28" if code == 281 else "G30"] = (a, b, c, d, e, f)
        return
    axes = [axis for letter, axis in AXES.items() if letter in block.words]
    name = "G28"
    if code == 300:
        number = block.whole("P", block.words.pop("P"), 2, 4) if "P" in block.words else 2
        name = "G30" if number == 2 else f"G30 P{number}"
    if not axes:
        if run.state.dialect == FANUC and code != 280:
            raise block.error(item, f"{item.text} names no axis: add X, Y or Z")
        if run.state.dialect == FANUC:
            run.note(block.line, "G28 names no axis: all axes go to the reference, as on a Haas")
        axes = list(AXES.values())
    run.pending_length = 0.0
    run.line_to(Kind.RAPID, block.line, target(run, block))
    if code == 270:
        return
    reference = run.references.get(name, ZERO)
    if run.state.dialect == LINUXCNC and run.transform.matrix is not None:
        # it goes along the axes of the program, turned as they are
        point, there = run.point, run.transform.program(list(reference))
        end = run.transform.machine([(there if i in axes else point)[i] for i in range(6)])
    else:
        here = run.state.position
        end = [(reference if i in axes else here)[i] for i in range(6)]
    run.line_to(Kind.RAPID, block.line, end)


def machine_move(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """G53: axis words are the machine's coordinates."""
    state = run.state
    word = next(i for _, kind, c, i in block.actions if kind == "G" and c == 530)
    guard_contour(run, block, word)
    if not state.absolute:
        raise block.error(word, "G53 takes absolute coordinates and G91 is in force: write G90")
    if state.dialect == FANUC:
        code = 0
    if code not in (0, 10):
        raise block.error(word, "G53 goes with G0 or G1: write one of them")
    given = block.take_axes(run.state.unit)
    if not given and state.dialect == FANUC:
        raise block.error(word, "G53 names no axis: add X, Y or Z")
    if not given:
        return
    if code == 10 and state.feed <= 0:
        raise block.error(word, "G1 has no feed: give F above 0")
    run.pending_length = 0.0
    end = state.position.copy()
    for axis, value in given.items():
        end[axis] = value
    run.line_to(Kind.RAPID if code == 0 else Kind.FEED, block.line, end)


LARGEST = 99_999_999
SYSTEMS = ("EXT", "G54", "G55", "G56", "G57", "G58", "G59")
"""Work offsets by the P of a Fanuc G10 L2."""
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
    for axis, value in block.take_axes(run.state.unit).items():
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
    given = block.take_axes(run.state.unit)
    if kind == 2:
        if angle is not None:
            offsets.rotations[name] = angle
        for axis, value in given.items():
            offset[axis] = value
    else:
        _place(run, name, given)
    run.remap()


def _place(run: Run, name: str, given: dict[int, float]) -> None:
    """Set an offset so that the tool stands where ``given`` says."""
    offsets = run.offsets
    active, offsets.active = offsets.active, name
    mapping = offsets.transform()
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
    entry = run.listed_tool(number, block, item)
    radius = block.take("R")
    if radius is not None:
        entry.radius = radius * run.state.unit
    for letter in "IJQ":
        block.take(letter)  # angles and orientation of a lathe tool: no motion on a mill
    given = block.take_axes(run.state.unit)
    if kind != 1:
        offsets = run.offsets
        active, length = offsets.active, offsets.length
        offsets.length = [0.0] * 6
        if kind == 11:
            offsets.active = "G59.3"
        bare = offsets.transform().program(run.state.position)
        given = {axis: bare[axis] - value for axis, value in given.items()}
        offsets.active, offsets.length = active, length
    entry.length = given.pop(2, entry.length)
    entry.across.update(given)


LETTERS = "XYZ"
FACTOR = 1e-3
"""Unit of P, I, J and K of G51 without a decimal point [1]."""


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
    normal = LETTERS[IN_PLANE[plane][2]]
    if normal in block.words:
        raise block.error(
            block.items[normal], f"G68 turns in G{plane} and takes no {normal}: give it a block"
        )
    angle = block.need("R", "G68", item)
    turned = offsets.rotation != 0 and not run.state.absolute
    offsets.rotation = angle + (offsets.rotation if turned else 0.0)
    offsets.centre_of_rotation, offsets.plane_of_rotation = (centre[0], centre[1]), plane
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
    elif common is not None and each != [None] * 3:
        run.note(block.line, "G51 goes by I, J and K and does not read P")
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
