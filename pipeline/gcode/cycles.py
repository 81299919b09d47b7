"""Canned cycles G73, G74, G76 and G81 to G89, as the moves that they are.

Sources: Fanuc 0i-F operator's manual B-64694EN, 5 "Functions to simplify programming"; LinuxCNC 2.9
"Canned cycles".
"""

from pipeline.gcode.block import AXES, Block
from pipeline.gcode.cycle_moves import AT_BOTTOM, Hole
from pipeline.gcode.modal import g_code
from pipeline.gcode.motion import check_feed, programmed
from pipeline.gcode.offsets import IN_PLANE
from pipeline.gcode.run import Cycle, Run
from pipeline.gcode.state import CANCELLED, FANUC, LINUXCNC
from pipeline.gcode.statements import WordItem

LETTERS = "XYZ"
STICKY = "QPIJK"
MOST = 10_000
"""Pecks of one hole."""
LINUXCNC_WORDS = {
    730: "Q",
    740: "P",
    820: "P",
    830: "Q",
    840: "P",
    860: "P",
    870: "IJK",
    880: "P",
    890: "P",
}
"""Cycle -> words that LinuxCNC takes beside R and Z; a Fanuc keeps any."""
MOST_REPEATS = 100_000
PECKING = (730, 830)


def drill(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """One block of a cycle: at each position that it names, one hole."""
    state = run.state
    first, second, normal = IN_PLANE[state.plane]
    if run.contour is not None:
        raise block.error(item, f"{g_code(code)} cannot run under G41 or G42: write G40 before")
    _check_cycle(run, block, code, item)
    fresh = _begin(run, block, code, item)
    repeats = _repeats(run, block)
    positions = {LETTERS[first], LETTERS[second], LETTERS[normal], "R"} & block.words.keys()
    other = ({letter for letter in AXES if AXES[letter] > 2} | {"@", "^"}) & block.words.keys()
    if state.dialect == FANUC and not positions and not other:
        return
    _take_depths(run, block, fresh)
    check_feed(run, block, code, item or block.any_item())
    words = {letter: block.take(letter) for letter in (LETTERS[first], LETTERS[second], *other)}
    given = {letter: value for letter, value in words.items() if value is not None}
    if state.dialect == LINUXCNC:
        _rise_first(run, block.line, normal)
    for _ in range(repeats):
        block.words.update(given)
        point = programmed(run, block)
        point[normal] = run.point[normal]
        hole = Hole(run=run, line=block.line, point=point, normal=normal, words=run.cycle.words)
        _drill_one(run, hole, code)


def _check_cycle(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    if run.state.dialect == LINUXCNC and code == 740 and run.state.direction > 0:
        raise block.error(item, "G74 taps left-handed and the spindle turns clockwise: write M4")
    if run.state.dialect == LINUXCNC and code == 840 and run.state.direction < 0:
        raise block.error(item, "G84 taps right-handed and the spindle turns backwards: write M3")
    if code not in AT_BOTTOM:
        raise block.error(item, f"{g_code(code)} is no cycle that is supported: use G81 to G89")


def _begin(run: Run, block: Block, code: int, item: WordItem | None) -> bool:
    """Note the initial level where a cycle begins; whether this one just did."""
    normal = IN_PLANE[run.state.plane][2]
    if run.cycle.code == code:
        return False
    another = run.cycle.code != CANCELLED
    initial = run.cycle.initial if another else run.point[normal]
    keep = run.cycle.words if another and run.state.dialect == FANUC else {}
    run.cycle = Cycle(code=code, initial=initial, words=dict(keep))
    depth = LETTERS[normal]
    for letter in ("R", depth):
        if letter not in block.words and letter.replace(depth, "Z") not in run.cycle.words:
            raise block.error(
                item or block.any_item(), f"{g_code(code)} begins without {letter}: add it"
            )
    return True


def _repeats(run: Run, block: Block) -> int:
    letters = ("L",) if run.state.dialect == LINUXCNC or run.cycle.code == 870 else ("L", "K")
    for letter in letters:
        if letter in block.words:
            least = 1 if run.state.dialect == LINUXCNC else 0
            return block.whole(letter, block.words.pop(letter), least, MOST_REPEATS)
    return 1


def _take_depths(run: Run, block: Block, fresh: bool) -> None:
    """R and Z as program coordinates; under G91 R counts from the start, Z from R."""
    state, cycle = run.state, run.cycle
    normal = IN_PLANE[state.plane][2]
    radius, depth = block.take("R"), block.take(LETTERS[normal])
    if radius is not None:
        base = 0.0 if state.absolute else cycle.initial
        cycle.words["R"] = base + radius * state.unit
    if depth is not None:
        base = 0.0 if state.absolute else cycle.words["R"]
        cycle.words["Z"] = base + depth * state.unit
    for letter in STICKY if state.dialect == FANUC else LINUXCNC_WORDS.get(cycle.code, ""):
        value = block.take(letter)
        if value is None:
            continue
        if letter == "P":
            written = "." in block.items["P"].text or state.dialect != FANUC
            cycle.words["P"] = value if written else value / 1000
        else:
            cycle.words[letter] = value * state.unit
    if cycle.code in PECKING and not cycle.words.get("Q", 0.0) > 0:
        raise block.error(
            block.any_item(), f"{g_code(cycle.code)} has no depth of cut: add Q above 0"
        )
    if cycle.code in PECKING and cycle.words["R"] - cycle.words["Z"] > MOST * cycle.words["Q"]:
        raise block.error(
            block.items.get("Q") or block.any_item(),
            f"a depth of cut of {cycle.words['Q']:g} mm makes more than {MOST} pecks: raise Q",
        )
    sticky_depth = cycle.words["Z"] > cycle.words["R"] and cycle.code != 870
    if sticky_depth:
        raise block.error(
            block.items.get("R") or block.any_item(),
            f"R lies at {cycle.words['R']:g} mm, below the bottom of the hole at "
            f"{cycle.words['Z']:g} mm: exchange them",
        )


def _rise_first(run: Run, line: int, normal: int) -> None:
    """LinuxCNC goes up to R before it goes anywhere else."""
    point = run.point
    if point[normal] < run.cycle.words["R"]:
        point[normal] = run.cycle.words["R"]
        Hole(run=run, line=line, point=point, normal=normal, words={}).rapid(point[normal])


def _drill_one(run: Run, hole: Hole, code: int) -> None:
    """Over the hole, to R, what the cycle does, and back."""
    words = run.cycle.words
    level = words["R"] if run.retract_to_r else max(run.cycle.initial, words["R"])
    before = hole.point[hole.normal]
    if run.state.dialect == LINUXCNC and not run.retract_to_r:
        before = level
    hole.rapid(before)
    if code != 870:
        hole.rapid(words["R"])
    AT_BOTTOM[code](hole, level)
