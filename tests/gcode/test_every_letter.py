"""All codes of each dialect with all letters: each is read, named to the user, or refused."""

import copy

import pytest

from pipeline.gcode.codes.execution import HANDLERS
from pipeline.gcode.dialects.siemens_words import G_CODES, SAME_AS
from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.modal import DIALECTS, GROUP_OF, GROUPS, M_STEPS, g_code, step_of
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup, Tool

HEAD = {
    "fanuc": "G21 G90 G0 X1 Y1 Z10 F100 S500 M3\n",
    "linuxcnc": "G21 G90 G0 X1 Y1 Z10 F100 S500 M3\n",
    "siemens": "G710 G90 G0 X1 Y1 Z10 F100 S500 M3\n",
}
TAIL = "\nG1 X7 Y8 Z9\n"
LETTERS = [*"ABCDEFHIJKLMPQRSTUVWXYZ", "@", "^", "$", ",R", ",C"]
CYCLE = "X5 Y5 Z-5 R2"
WORDS = {
    10: ["X3"], 0: ["X3"], 20: ["X3 Y1 I1", "X3 Y1 R2"], 30: ["X3 Y1 I1", "X3 Y1 R2"],
    40: ["P1", "X1", "F1"], 50: ["P10000"], 51: ["Q1"], 80: ["P1", ""],
    100: ["L2 P1 X1", "L10 P1 R1", "L1 P1 R1", "L20 P1 X1", "L11 P1 Z1"],
    330: ["Z1 F1", "Z1 K1"], 331: ["Z1 K1"], 310: ["X3"], 382: ["X3"], 383: ["X3"], 384: ["X3"],
    385: ["X3"], 430: ["H1"], 432: ["H1", "X1"], 431: ["Z1"], 440: ["H1"],
    410: ["X3 D1"], 420: ["X3 D1"],
    411: ["X3 D1"], 421: ["X3 D1"], 510: ["P2000", "I2000 J1000 K1000"],
    511: ["X1"], 680: ["X0 Y0 R30"], 520: ["X1"], 530: ["X3"], 541: ["P1"], 280: ["X3"],
    300: ["X3", "X3 P3"], 270: ["X3"],
    920: ["X3"], 921: [""], 960: ["S100"], 970: ["S100"], 930: ["G1 X3 F2\nG94 F3"],
    950: ["G1 X3 F2\nG94 F3"],
    160: ["G1 X3 Y4"],
    1030: ["P1"], 1870: ["P1 E1"], 640: ["", "P1"], 650: ["P9"], 660: ["P9"],
    **{code: [CYCLE] for code in GROUPS["cycle"].codes if code not in (800, 730, 830, 760, 870)},
    740: [CYCLE, CYCLE + " Q1", "M4 " + CYCLE], 840: [CYCLE, CYCLE + " Q1"],
    730: [CYCLE + " Q1"], 830: [CYCLE + " Q1"], 760: [CYCLE + " Q1", "Z-20 P1 I1 J1 K2"],
    870: ["X5 Y5 Z-2 R-5 Q1", "X5 Y5 Z-5 R2 I1 K-1"],
}  # fmt: skip
"""Ten times the G code -> words that it needs, or that go with it."""
OUTER = "\nM30\nO9\nG91 G1 Z1\nG90 X#24 Y#25 Z#26\nM99\n"
OF_OTHERS = {
    "fanuc": {"G41.1", "G42.1", "G43.1", "G43.2", "G59.1", "G59.2", "G59.3", "G66.1"},
    "linuxcnc": {"G44", "G54.1"},
    "siemens": set(),
}
"""Codes of a group that its dialect refuses, whatever stands beside them."""
SILENT = {
    "how the control computes": {("fanuc", code, letter) for code, letter in (
        (50, "P"), (50, "R"), (51, "Q"), (51, "R"), (80, "P"), (1030, "P"), (1030, "E"),
        (1870, "P"), (1870, "E"))} | {("linuxcnc", 640, "Q")},
    "how far and at which ends a thread tapers: each needs the other": {
        ("linuxcnc", 760, "E"), ("linuxcnc", 760, "L")},
    "lathe tool data": {("linuxcnc", 100, letter) for letter in "IJQ"},
    "argument of a macro, whose program reads it": {
        ("fanuc", code, letter) for code in (650, 660) for letter in "ABCDEFHIJKLMQRSTUVW"},
}  # fmt: skip
"""Why a letter that was taken shows in no move."""


def codes(dialect: str) -> list[int]:
    """Ten times each G code that a dialect has."""
    if dialect == "siemens":
        return sorted({round(10 * code) for code in (*G_CODES, *SAME_AS)})
    every = {*HANDLERS, *GROUP_OF}
    return sorted(code for code in every if step_of(code, dialect) is not None)


def outcome(block: str, dialect: str):
    """What a block does: rows and state after a further move, notices; its sentence if refused."""
    setup = Setup(
        dialect=dialect, tools={n: Tool(length=20.0 * n, diameter=2.0) for n in (1, 2)},
        references={"G28": (9, 8, 7, 0, 0, 0), "G30": (6,) * 6, "G30 P3": (5,) * 6},
    )  # fmt: skip
    text = HEAD[dialect] + block + TAIL + (OUTER if dialect == "fanuc" else "M30\n")
    one = Interpreter(parse_program(text.encode(), "P"), setup, compiled=False)
    try:
        moves = one.moves()
    except GcodeError as error:
        return str(error)
    run = copy.copy(one.run)
    return (
        [column.tobytes() for _, column in moves.columns()],
        run.state, run.offsets, run.registers, run.references, run.probed, moves.notices,
        run.length_number, run.radius_number,
    )  # fmt: skip


def beside(base: str, letter: str) -> str:
    """The block with one more word; what follows it stays."""
    first, end, rest = base.partition("\n")
    return f"{first} {letter}3{end}{rest}"


def unread(dialect: str, code: int) -> list[str]:
    """Blocks with a letter that changes nothing and of which nothing is said."""
    found = []
    for words in WORDS.get(code, [""]):
        base = f"{g_code(code)} {words}".strip()
        without = outcome(base, dialect)
        if isinstance(without, str):
            continue
        present = {word[0] for word in words.split()}
        for letter in LETTERS:
            if letter in present or any((dialect, code, letter) in why for why in SILENT.values()):
                continue
            if outcome(beside(base, letter), dialect) == without:
                found.append(beside(base, letter))
    return found


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("step", [3, pytest.param(1, marks=pytest.mark.proof)])
def test_every_letter_beside_every_g_code_is_read_named_or_refused(dialect, step):
    silent = [block for code in codes(dialect)[::step] for block in unread(dialect, code)]
    assert not silent


M_WORDS = {98: "P9", 198: "P9", 97: "P9", 61: "Q1", 66: "P1", 68: "E1 Q2", 67: "E1 Q2"}
M_SILENT = {
    "fanuc": {19: "PQR", 99: "P"},  # to which angle; where a main program goes on: its end
    "linuxcnc": {19: "RPQ", 100: "Q", 66: "ELQ", 67: "Q", 68: "Q"},
    "siemens": {},
}
"""Letters that say what no axis does."""
M_OF_LINUXCNC = {*range(10), 19, 30, *range(48, 54), 60, 61, *range(62, 69), 98, 99, 100}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_letter_beside_every_m_code_is_read_named_or_refused(dialect):
    silent = []
    for code in sorted(M_STEPS[dialect].keys() | (M_OF_LINUXCNC if dialect == "linuxcnc" else {8})):
        base = f"M{code} {M_WORDS.get(code, '')}".strip()
        without = outcome(base, dialect)
        letters = [
            one for one in LETTERS if one not in base and one not in M_SILENT[dialect].get(code, "")
        ]
        silent += [
            beside(base, letter) for letter in letters
            if not isinstance(without, str) and outcome(beside(base, letter), dialect) == without
        ]  # fmt: skip
    assert not silent


@pytest.mark.parametrize("dialect", DIALECTS)
def test_every_code_was_tried(dialect):
    refused = {
        g_code(code)
        for code in codes(dialect)
        if all(
            isinstance(outcome(f"{g_code(code)} {w}", dialect), str) for w in WORDS.get(code, [""])
        )
    }
    assert refused <= OF_OTHERS[dialect]
