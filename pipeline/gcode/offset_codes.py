"""G10, G28, G30, G52 to G59, G92: the codes that set and choose offsets, and go to references."""

from pipeline.gcode.block import AXES, Block
from pipeline.gcode.modal import g_code
from pipeline.gcode.motion import target
from pipeline.gcode.moves import Kind
from pipeline.gcode.run import Run
from pipeline.gcode.setup import ZERO
from pipeline.gcode.state import FANUC, LINUXCNC
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


def axis_words(run: Run, block: Block) -> dict[int, float]:
    """Axis words taken, by axis [mm, deg]."""
    given = {}
    for letter, axis in AXES.items():
        value = block.take(letter)
        if value is not None:
            given[axis] = value * (run.state.unit if axis < 3 else 1.0)
    return given


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
    given = axis_words(run, block)
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
        given = axis_words(run, block)
        if not given:
            raise block.error(item, "G92 names no axis: add X, Y or Z")
        point = run.point
        for axis, value in given.items():
            offsets.g92[axis] += point[axis] - value
        offsets.g92_kept = None
    elif code == 921:
        axis_words(run, block)  # a Fanuc names the axes to preset, all with 0
        offsets.g92, offsets.g92_kept = [0.0] * 6, None
        if run.state.dialect == FANUC:
            offsets.g52 = [0.0] * 6
    elif code == 922:
        if offsets.g92_kept is None:
            offsets.g92_kept, offsets.g92 = offsets.g92, [0.0] * 6
    elif offsets.g92_kept is not None:
        offsets.g92, offsets.g92_kept = offsets.g92_kept, None
    run.remap()


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
        if run.state.dialect == FANUC:
            raise block.error(item, f"{item.text} names no axis: add X, Y or Z")
        axes = list(AXES.values())
    run.pending_length = 0.0
    run.go(Kind.RAPID, block.line, target(run, block))
    if code == 270:
        return
    reference = run.references.get(name, ZERO)
    if run.state.dialect == LINUXCNC and run.mapping.matrix is not None:
        # it goes along the axes of the program, turned as they are
        point, there = run.point, run.mapping.program(list(reference))
        end = run.mapping.machine([(there if i in axes else point)[i] for i in range(6)])
    else:
        here = run.state.position
        end = [(reference if i in axes else here)[i] for i in range(6)]
    run.go(Kind.RAPID, block.line, end)


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
    given = axis_words(run, block)
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
    run.go(Kind.RAPID if code == 0 else Kind.FEED, block.line, end)
