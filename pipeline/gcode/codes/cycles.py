"""Canned cycles G73, G74, G76 and G81 to G89, as the moves that they consist of.

Sources: Fanuc 0i-F operator's manual B-64694EN, 5 "Functions to simplify programming"; LinuxCNC 2.9
"Canned cycles".
"""

from collections.abc import Callable
from dataclasses import dataclass

from pipeline.gcode.codes.motion import TAPPING, check_feed, programmed, seconds
from pipeline.gcode.modal import CANCELLED, FANUC, LINUXCNC, g_code
from pipeline.gcode.moves import IN_PLANE, INCREMENT, FeedMode, Kind, PathMode
from pipeline.gcode.run import AXES, Block, Cycle, Run
from pipeline.gcode.statements import Number, WordItem

LETTERS = "XYZ"
NEGLIGIBLE_DEPTH = 1e-9
"""Remaining depth of a hole that is not drilled [mm]."""


@dataclass(slots=True, kw_only=True)
class Hole:
    """One hole, in program coordinates."""

    run: Run
    """Interpretation that records the moves; it holds the words of the cycle."""
    line: int
    """Line of the block."""
    point: list[float]
    """Position of the tool; its coordinate ``normal`` changes as it moves [mm, deg]."""

    @property
    def words(self) -> dict[str, float]:
        """R, Z, Q, P, I, J, K of the cycle [mm, s]."""
        return self.run.cycle.words

    @property
    def normal(self) -> int:
        """Index of the axis it drills along."""
        return IN_PLANE[self.run.state.plane][2]

    @property
    def bottom(self) -> float:
        """Bottom of the hole: Z of the cycle."""
        return self.words["Z"]

    @property
    def plane_r(self) -> float:
        """Retract plane: R of the cycle."""
        return self.words["R"]

    def rapid(self, level: float) -> None:
        """Rapid to a level; no row where nothing moves."""
        self.to(Kind.RAPID, level)

    def feed(self, level: float) -> None:
        """Feed to a level."""
        self.to(Kind.FEED, level)

    def to(self, kind: Kind, level: float) -> None:
        """A row to a level where something moves."""
        self.point[self.normal] = level
        end = self.run.transform.machine(self.point)
        if end != self.run.state.position:
            self.run.line_to(kind, self.line, end, code=self.run.cycle.code // 10)

    def dwell(self) -> None:
        """Dwell at the bottom by P."""
        seconds = self.words.get("P", 0.0)
        if seconds > 0:
            self.run.add_row(Kind.DWELL, self.line, value=seconds)

    def spindle(self, direction: int) -> None:
        """Turn the spindle, or stop it with 0."""
        self.run.state.direction = direction
        self.run.add_row(Kind.SPINDLE, self.line)

    def shift(self, sign: int) -> None:
        """Sideways by I J K, or by Q as the control is set: away from the wall, or back."""
        along = [self.words.get(letter, 0.0) for letter in "IJK"]
        along[self.normal] = 0.0
        if any(along) and "Q" in self.words:
            self.run.note(self.line, "I, J and K give the shift of the cycle: Q is not read")
        if not any(along):
            shift = self.run.setup.boring_shift
            q = self.words.get("Q", 0.0)
            along[LETTERS.index(shift[1])] = q if shift[0] == "+" else -q
        for axis, amount in enumerate(along):
            self.point[axis] += sign * amount
        self.rapid(self.point[self.normal])

    def off_the_wall(self, level: float, direction: int) -> None:
        """With the spindle at rest beside the wall to a level; then it turns in ``direction``."""
        self.spindle(0)
        self.shift(1)
        self.rapid(level)
        self.shift(-1)
        self.spindle(direction)


def _drilling(hole: Hole, level: float) -> None:
    """G81, and G82 with a dwell."""
    hole.feed(hole.bottom)
    if hole.run.cycle.code == 820:
        hole.dwell()
    hole.rapid(level)


def _pecking(hole: Hole, level: float) -> None:
    """Q deeper each time: G83 goes out to R and back to just above, G73 only a little back."""
    gap = hole.run.setup.peck_clearance
    for depth in _pecks(hole):
        hole.feed(depth)
        if depth > hole.bottom:
            if hole.run.cycle.code == 830:
                hole.rapid(hole.plane_r)
            hole.rapid(depth + gap)
    hole.dwell()
    hole.rapid(level)


def _pecks(hole: Hole) -> list[float]:
    """Depths reached, the bottom last."""
    step = hole.words["Q"]
    count = int((hole.plane_r - hole.bottom) / step + 2)
    depths = [hole.plane_r - step * (i + 1) for i in range(count)]
    return [depth for depth in depths if depth > hole.bottom + NEGLIGIBLE_DEPTH] + [hole.bottom]


def _tapping(direction: int) -> Callable[[Hole, float], None]:
    """G74 and G84; with Q of a Fanuc peck tapping, where the spindle reverses at each peck.

    The tool goes back to R at the feed of the thread (parameter PCP, 5200#5, is 1), or by
    ``setup.tapping_retract`` (PCP is 0, high-speed peck tapping).
    """

    def tap(hole: Hole, level: float) -> None:
        state, linuxcnc = hole.run.state, hole.run.state.dialect == LINUXCNC
        mode, feed = state.feed_mode, state.feed
        kind = Kind.FEED
        if hole.run.rigid and state.speed > 0:
            kind = Kind.THREAD
            if mode != FeedMode.PER_REVOLUTION:
                state.feed_mode, state.feed = FeedMode.PER_REVOLUTION, feed / state.speed
        if state.direction != direction:
            hole.spindle(direction)
        retract = hole.run.setup.tapping_retract
        for depth in _pecks(hole) if hole.words.get("Q", 0.0) > 0 else [hole.bottom]:
            hole.to(kind, depth)
            last = depth == hole.bottom
            if last and state.dialect == FANUC:
                hole.dwell()
            hole.spindle(-direction)
            if linuxcnc:
                hole.dwell()
            full = level if linuxcnc else hole.plane_r
            hole.to(kind, full if last or retract is None else min(depth + retract, full))
            hole.spindle(direction)
        state.feed_mode, state.feed = mode, feed
        hole.rapid(level)

    return tap


def _fine_boring(hole: Hole, level: float) -> None:
    """G76: orient at the bottom, leave the wall, come out without a mark."""
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    hole.dwell()
    hole.off_the_wall(level, direction)


def _boring(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.feed(hole.plane_r)
    hole.rapid(level)


def _boring_spindle_stopped(hole: Hole, level: float) -> None:
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    if hole.run.state.dialect == LINUXCNC:
        hole.dwell()
    hole.spindle(0)
    hole.rapid(level)
    hole.spindle(direction)


def _back_boring(hole: Hole, level: float) -> None:
    """G87: through the hole beside its wall, then cut upwards.

    A Fanuc goes down to R and cuts up to Z; LinuxCNC goes down to Z and cuts up to K.
    """
    direction = hole.run.state.direction
    linuxcnc = hole.run.state.dialect == LINUXCNC
    low, high = (hole.bottom, hole.words.get("K", 0.0)) if linuxcnc else (hole.plane_r, hole.bottom)
    if linuxcnc:
        hole.rapid(hole.plane_r)
        if not hole.run.state.absolute:
            high += low
    hole.off_the_wall(low, direction)
    hole.feed(high)
    hole.dwell()
    if linuxcnc:
        hole.feed(low)
    hole.off_the_wall(level, direction)


def _boring_manual_retract(hole: Hole, level: float) -> None:
    """G88: stop at the bottom and leave the retraction to the operator."""
    direction = hole.run.state.direction
    hole.feed(hole.bottom)
    hole.dwell()
    hole.spindle(0)
    hole.run.add_row(Kind.STOP, hole.line)
    if hole.run.state.dialect == FANUC:
        hole.rapid(level)
    hole.spindle(direction)


def _boring_with_dwell(hole: Hole, level: float) -> None:
    hole.feed(hole.bottom)
    hole.dwell()
    hole.feed(level if hole.run.state.dialect == LINUXCNC else hole.plane_r)
    hole.rapid(level)


HOLE_CYCLES: dict[int, Callable[[Hole, float], None]] = {
    730: _pecking,
    740: _tapping(-1),
    760: _fine_boring,
    810: _drilling,
    820: _drilling,
    830: _pecking,
    840: _tapping(1),
    850: _boring,
    860: _boring_spindle_stopped,
    870: _back_boring,
    880: _boring_manual_retract,
    890: _boring_with_dwell,
}
"""Ten times the G code -> what it does, given the hole and the level to end at [mm]."""

STICKY = "QPIJK"
"""Words of a Fanuc cycle that stay in force with it."""
MAX_PECKS = 10_000
"""Greatest number of pecks of one hole."""
LINUXCNC_WORDS = {
    **dict.fromkeys((730, 830), "Q"),
    **dict.fromkeys((740, 820, 840, 860, 880, 890), "P"),
    870: "IJK",
}
"""Cycle -> words that LinuxCNC takes beside R and Z; a Fanuc keeps any."""
FANUC_WORDS = {
    **dict.fromkeys((730, 740, 830, 840), "QP"),
    **dict.fromkeys((760, 870), "QPIJK"),
    **dict.fromkeys((820, 880, 890), "P"),
}
"""Cycle -> words that a Fanuc reads in it beside R, Z and the count."""
PECK_TAPPING = (
    "{} with Q is peck tapping: the spindle reverses at each Q and the tool goes back to R, as "
    "parameter 5200#5 (PCP) = 1 has it; give setup.tapping_retract where the control breaks chips"
)
MAX_REPEATS = 100_000


def drill(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    """One block of a cycle: at each position that it names, one hole."""
    state = run.state
    first, second, normal = IN_PLANE[state.plane]
    if run.contour is not None:
        raise block.error(item, f"{g_code(code)} cannot run under G41 or G42: write G40 before")
    run.straight_next = False
    _check_cycle(run, block, code, item)
    fresh = _begin_cycle(run, block, code, item)
    repeats = _repeats(run, block)
    positions = {LETTERS[first], LETTERS[second], LETTERS[normal], "R"} & block.words.keys()
    other = ({letter for letter in AXES if AXES[letter] > 2} | {"@", "^"}) & block.words.keys()
    if state.dialect == FANUC and not positions and not other:
        return
    _take_depths(run, block, fresh)
    check_feed(run, block, code, item or block.any_item())
    letters = (LETTERS[first], LETTERS[second], *other)
    given = {letter: block.words.pop(letter) for letter in letters if letter in block.words}
    mode = state.path_mode, state.tolerance
    if state.dialect == LINUXCNC:  # which drills in exact path mode, whatever is in force
        state.path_mode, state.tolerance = PathMode.EXACT_PATH, 0.0
        _rise_to_r(run, block.line, normal)
    for _ in range(repeats):
        block.words.update(given)
        point = programmed(run, block)
        point[normal] = run.point[normal]
        _drill_one(run, Hole(run=run, line=block.line, point=point), code)
    state.path_mode, state.tolerance = mode


def _check_cycle(run: Run, block: Block, code: int, item: WordItem | None) -> None:
    rotary = next((letter for letter in "ABC" if letter in block.words), None)
    if run.state.dialect == LINUXCNC and rotary is not None:
        raise block.error(
            block.items[rotary], f"LinuxCNC turns no {rotary} in a canned cycle: turn it before"
        )
    if run.state.dialect == LINUXCNC and code == 740 and run.state.direction > 0:
        raise block.error(item, "G74 taps left-handed and the spindle turns clockwise: write M4")
    if run.state.dialect == LINUXCNC and code == 840 and run.state.direction < 0:
        raise block.error(item, "G84 taps right-handed and the spindle turns backwards: write M3")
    if code not in HOLE_CYCLES:
        raise block.error(item, f"{g_code(code)} is no cycle that is supported: use G81 to G89")


def _begin_cycle(run: Run, block: Block, code: int, item: WordItem | None) -> bool:
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
            return block.whole(letter, block.words.pop(letter), least, MAX_REPEATS)
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
    _take_sticky(run, block, normal)
    _check_depths(run, block)


def _take_sticky(run: Run, block: Block, normal: int) -> None:
    """Words that stay in force with the cycle; one that it does not read is named."""
    state, cycle = run.state, run.cycle
    for letter in STICKY if state.dialect == FANUC else LINUXCNC_WORDS.get(cycle.code, ""):
        value = block.take(letter)
        if value is None:
            continue
        if letter == "Q":
            value = _peck(run, block, value)
        if state.dialect == FANUC and not _reads(cycle.code, letter, normal):
            kept = " and keeps it for a later cycle" * (letter in "QP")
            run.note(block.line, f"{g_code(cycle.code)} does not read {letter}{kept}")
        dwell = letter == "P"
        cycle.words[letter] = seconds(run, block, value) if dwell else value * state.unit


def _check_depths(run: Run, block: Block) -> None:
    """Depth of cut and levels that make sense."""
    state, cycle = run.state, run.cycle
    plane_r, bottom = cycle.words["R"], cycle.words["Z"]
    step = cycle.words.get("Q", 0.0)
    taps = cycle.code in TAPPING and state.dialect == FANUC and step != 0
    if taps and run.setup.tapping_retract is None:
        run.note(block.line, PECK_TAPPING.format(g_code(cycle.code)))
    if HOLE_CYCLES[cycle.code] is _pecking or taps:
        smaller = not taps and "I" in (block.items if step > 0 else cycle.words)
        if smaller and state.dialect == FANUC:
            raise block.error(
                block.items.get("I") or block.any_item(),
                "pecks that get smaller (I J K of a Haas) are not followed: post them with Q",
            )
        if not step > 0:
            raise block.error(
                block.any_item(), f"{g_code(cycle.code)} has no depth of cut: add Q above 0"
            )
        if plane_r - bottom > MAX_PECKS * step:
            raise block.error(
                block.items.get("Q") or block.any_item(),
                f"a depth of cut of {step:g} mm makes more than {MAX_PECKS} pecks: raise Q",
            )
    if bottom > plane_r and cycle.code != 870:
        raise block.error(
            block.items.get("R") or block.any_item(),
            f"R lies at {plane_r:g} mm, below the bottom of the hole at {bottom:g} mm: "
            "exchange them",
        )


def _reads(code: int, letter: str, normal: int) -> bool:
    """Whether a Fanuc's cycle reads a word; nothing is shifted along the hole."""
    along = letter in "IJK" and "IJK".index(letter) == normal
    return letter in FANUC_WORDS.get(code, "") and not along


def _peck(run: Run, block: Block, value: float) -> float:
    """Q of a peck or shift in the program's unit; without a point it may count increments."""
    setup, item = run.setup, block.items["Q"]
    bare = type(item.value) is Number and "." not in item.text
    if not bare or run.state.dialect != FANUC or setup.decimal == "increment":
        return value
    if run.cycle.code not in (730, 740, 760, 830, 840, 870) or setup.peck_increments is False:
        return value
    step = value * INCREMENT[run.state.unit != 1.0]
    if setup.peck_increments:
        return step
    depth = abs(run.cycle.words["R"] - run.cycle.words["Z"]) / run.state.unit
    if value > depth:
        raise block.error(
            item,
            f"{item.text} has no decimal point and as {value:g} is more than the hole is deep, "
            f"{depth:g}: many controls count it in increments, {step:g}; say which in "
            "setup.peck_increments of the machine's file, true or false",
        )
    return value


def _rise_to_r(run: Run, line: int, normal: int) -> None:
    """LinuxCNC goes up to R before it goes anywhere else."""
    point = run.point
    if point[normal] < run.cycle.words["R"]:
        point[normal] = run.cycle.words["R"]
        Hole(run=run, line=line, point=point).rapid(point[normal])


def _drill_one(run: Run, hole: Hole, code: int) -> None:
    words = run.cycle.words
    level = words["R"] if run.retract_to_r else max(run.cycle.initial, words["R"])
    before = hole.point[hole.normal]
    if run.state.dialect == LINUXCNC and not run.retract_to_r:
        before = level
    hole.rapid(before)
    if code != 870:
        hole.rapid(words["R"])
    HOLE_CYCLES[code](hole, level)
