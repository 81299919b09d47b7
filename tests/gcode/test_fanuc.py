"""Rules of a Fanuc: offsets, lengths, canned cycles, Macro B, modal groups, and what is refused.

A rule's programs are tiny, and stand with the moves that they have by the manual.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.gcode.codes.execution import HANDLERS
from pipeline.gcode.modal import (
    GROUPS,
    M_STEPS,
    ONE_SHOT,
    WORD_STEPS,
    Offsets,
    excludes,
    g_code,
    step_of,
)
from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.setup import Tool
from tests.gcode.following import follow, kinds, points, refusal

OFFSETS = {"work_offsets": {
    "G54": (10.0, 20.0, 30.0, 0.0, 0.0, 0.0), "G55": (-1.0, -2.0, -3.0, 5.0, 0.0, 0.0),
    "G54.1 P7": (100.0, 0.0, 0.0, 0.0, 0.0, 0.0), "EXT": (0.5, 0.0, 0.0, 0.0, 0.0, 0.0),
}}  # fmt: skip
TOOLS = {"tools": {1: Tool(length=50.0, diameter=10.0), 2: Tool(length=80.0)}}
REFERENCES = {"references": {"G28": (1.0, 2.0, 300.0, 0, 0, 0), "G30 P3": (9.0, 9.0, 9.0, 0, 0, 0)}}
HEAD = "F100 M3 S500 G0 Z10\n"


def end(text: str, **choices) -> list[float]:
    """X Y Z of the machine in the end."""
    return follow(text, **choices).end[-1, :3].round(9).tolist()


def turned(text: str, **choices) -> list[float]:
    """The same with A."""
    return follow(text, **choices).end[-1, :4].round(9).tolist()


def path(text: str, **choices) -> list[list[float]]:
    return points(follow(text, **choices))


def xs(text: str, **choices) -> list[float]:
    return [point[0] for point in path(text, **choices)]


def holes(text: str, **choices) -> list[list[float]]:
    """Where the rows of cycles end, from 10 mm above."""
    return path(HEAD + text, **choices)[1:]


def heights(text: str, **choices) -> list[float]:
    return [point[2] for point in holes(text, **choices)]


def rows(text: str, **choices) -> str:
    """Kinds of the rows after the head."""
    return " ".join(kinds(follow(HEAD + text, **choices))[2:])


MACRO = "\nM30\nO9010\n"
RULES = {
    "a program without offsets counts in the machine": (end, {}, [("G0 X1 Y2 Z3", [1, 2, 3])]),
    "work offsets lie on the external one": (end, OFFSETS, [
        ("G0 X1 Y1 Z1", [11.5, 21, 31]), ("G54.1 P7 G0 X1", [101.5, 0, 0]),
        ("G54 P7 G0 X1", [101.5, 0, 0]), ("G154 P7 G0 X1", [101.5, 0, 0]),
    ]),
    "an axis that is not named stays where it is": (end, OFFSETS, [
        ("G0 X1 Y1\nG55 X1", [0.5, 21, 0]),
    ]),
    "rotary axes have offsets": (turned, OFFSETS, [("G55 G0 X1 A1", [0.5, 0, 0, 6])]),
    "G10 L2 sets offsets and adds under G91": (end, {}, [
        ("G90 G10 L2 P2 X7\nG55 G0 X1", [8, 0, 0]), ("G10 L2 P0 X7\nG0 X1", [8, 0, 0]),
        ("G91 G10 L2 P2 X7\nG10 L2 P2 X7\nG90 G55 G0 X1", [15, 0, 0]),
        ("G10 L20 P3 Y7\nG54.1 P3 G0 Y1", [0, 8, 0]), ("G20 G10 L2 P1 X1\nG0 X1", [50.8, 0, 0]),
    ]),
    "G10 L10 to L13 set registers": (path, {}, [
        ("G10 L10 P5 R25\nG43 H5 G0 Z1", [[0, 0, 26]]),
        ("G10 L10 P5 R25\nG10 L11 P5 R-1\nG43 H5 G0 Z1", [[0, 0, 25]]),
        ("F9 G10 L12 P5 R2\nG10 L13 P5 R1\nG41 D5 G1 X0 Y10\nY20\nG40 X9",
         [[-3, 10, 0], [-3, 20, 0], [9, 20, 0]]),
    ]),
    "G52 shifts every system until it is zero": (end, OFFSETS, [
        ("G52 X5\nG0 X1", [16.5, 0, 0]), ("G52 X5\nG55 G0 X1", [5.5, 0, 0]),
        ("G52 X5\nG52 X0\nG0 X1", [11.5, 0, 0]),
    ]),
    "G92 names the point where the tool stands": (end, {}, [
        ("G0 X10\nG92 X3\nG0 X4", [11, 0, 0]), ("G0 X10\nG92 X3\nG55 G0 X4", [11, 0, 0]),
        ("G0 X10\nG92 X3\nG92.1 X0\nG0 X4", [4, 0, 0]),
        ("G0 X5\nG92 X0 S3000\nG0 X1", [6, 0, 0]),
    ]),
    "G43 and G44 move by the length": (end, TOOLS, [
        ("G43 H1 G0 Z5", [0, 0, 55]), ("G44 H1 G0 Z5", [0, 0, -45]),
        ("G43 H1 G0 Z5\nH2 Z5", [0, 0, 85]), ("G43 H1 G0 Z5\nG49 Z5", [0, 0, 5]),
        ("G43 H7 G0 Z5", [0, 0, 5]), ("G0 Z5\nG43 H1", [0, 0, 55]),
        ("G0 Z5\nG43 H1\nG49\nX1", [1, 0, 5]), ("G0 Z5\nG91 G43 H1 Z1", [0, 0, 56]),
    ]),
    "a length without an axis shifts where the control is set so": (
        end, TOOLS | {"length_moves": False}, [("G0 Z5\nG43 H1\nX1", [1, 0, 5])],
    ),
    "G28 goes over a point to the reference by the axes named": (path, REFERENCES, [
        ("G0 X5 Z5\nG91 G28 Z10", [[5, 0, 5], [5, 0, 15], [5, 0, 300]]),
        ("G0 X5\nG90 G28 X6 Y7", [[5, 0, 0], [6, 7, 0], [1, 2, 0]]),
        ("G30 P3 X0 Y0 Z0", [[9, 9, 9]]), ("G0 X5 Z5\nG28", [[5, 0, 5], [1, 2, 300]]),
    ]),
    "G68 rotates about a point and G69 ends it": (end, {}, [
        ("G68 X1 Y0 R90\nG0 X3 Y0", [1, 2, 0]), ("G68 X0 Y0 R90\nG0 X3 Y0\nG69\nX3 Y0", [3, 0, 0]),
        ("G68 X0 Y0 R30\nG91 G68 R60\nG90 G0 X3 Y0", [0, 3, 0]),
        ("G0 X2\nG68 R90\nX3 Y0", [2, 1, 0]), ("G18 G68 X0 Z0 R90\nG0 Z3 X0", [3, 0, 0]),
    ]),
    "G51 scales about a point": (end, {}, [
        ("G51 X1 Y0 Z0 P2000\nG0 X3 Y4", [5, 8, 0]), ("G51 X0 Y0 Z0 P0.5\nG0 X3 Y4", [1.5, 2, 0]),
        ("G51 X0 Y0 Z0 I2000 J3000 K1000\nG0 X1 Y1 Z1", [2, 3, 1]),
        ("G51 X0 Y0 Z0 P2000\nG50\nG0 X3", [3, 0, 0]),
    ]),
    "G16 takes radius and angle": (end, {}, [
        ("G16 G0 X10 Y30", [8.660254038, 5, 0]), ("G16 G0 X10 Y30\nG91 Y60", [0, 10, 0]),
        ("G16 G0 X10 Y30\nG15 X1 Y1", [1, 1, 0]),
    ]),
    "inches are of lengths": (turned, {}, [("G20 G0 X1 A1", [25.4, 0, 0, 1])]),
    "G81 drills and returns to the initial level": (holes, {}, [
        ("G98 G81 X1 Y2 Z-5 R2\nX3\nG80",
         [[1, 2, 10], [1, 2, 2], [1, 2, -5], [1, 2, 10],
          [3, 2, 10], [3, 2, 2], [3, 2, -5], [3, 2, 10]]),
        ("G81 Z-5 R2 K0\nX1", [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 10]]),
        ("G81 X1 Z-5 R2\nM8\nF50", [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 10]]),
        ("G81 X1 Z-5 R2\nG80\nX2 Z9", [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 10], [2, 0, 9]]),
        ("G68 X0 Y0 R90\nG99 G81 X3 Z-5 R2", [[0, 3, 10], [0, 3, 2], [0, 3, -5], [0, 3, 2]]),
    ]),
    "G99 returns to R and the next hole starts there": (holes, {}, [
        ("G99 G81 X1 Z-5 R2\nX3",
         [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 2], [3, 0, 2], [3, 0, -5], [3, 0, 2]]),
        # R counts from the start and Z from R
        ("G91 G99 G81 X1 Z-7 R-8 K2",
         [[1, 0, 10], [1, 0, 2], [1, 0, -5], [1, 0, 2], [2, 0, 2], [2, 0, -5], [2, 0, 2]]),
    ]),
    "levels and words stay in force": (heights, {"peck_clearance": 0.5}, [
        ("G99 G81 X1 Z-5 R2\nG98 X3\nG80 X4", [10, 2, -5, 2, 2, -5, 10, 10]),
        ("G99 G83 X1 Z-5 R2 Q5\nG81 X2", [10, 2, -3, 2, -2.5, -5, 2, 2, -5, 2]),
    ]),
    "G83 comes out to R after each peck, G73 a little": (heights, {"peck_clearance": 0.5}, [
        ("G99 G83 X1 Z-5 R2 Q3", [10, 2, -1, 2, -0.5, -4, 2, -3.5, -5, 2]),
        ("G99 G73 X1 Z-5 R2 Q3", [10, 2, -1, -0.5, -4, -3.5, -5, 2]),
        ("G99 G83 X1 Z-1.7 R-1.4 Q0.1",
         [10, -1.4, -1.5, -1.4, -1.0, -1.6, -1.4, -1.1, -1.7, -1.4]),  # steps do not add up
    ]),
    "G76 leaves the wall before it comes out": (holes, {"boring_shift": "+X"}, [
        ("G99 G76 X5 Z-5 R2 Q0.5",
         [[5, 0, 10], [5, 0, 2], [5, 0, -5], [5.5, 0, -5], [5.5, 0, 2], [5, 0, 2]]),
    ]),
    "G87 bores from below": (holes, {"boring_shift": "-Y"}, [
        ("G98 G87 X5 Z-3 R-8 Q0.5",
         [[5, 0, 10], [5, -0.5, 10], [5, -0.5, -8], [5, 0, -8], [5, 0, -3], [5, -0.5, -3],
          [5, -0.5, 10], [5, 0, 10]]),
    ]),
    "cycles follow the plane": (path, {}, [
        ("F100 G18 G0 Y10\nG99 G81 X1 Z2 Y-5 R2",
         [[0, 10, 0], [1, 10, 2], [1, 2, 2], [1, -5, 2], [1, 2, 2]]),
    ]),
    "rows of cycles": (rows, {}, [
        ("G1 X1\nG81 X1 Z-5 R2\nG80\nX2", "FEED RAPID FEED RAPID FEED"),
        ("G81 X1 Z-5 R2\nG0 X2", "RAPID RAPID FEED RAPID RAPID"),
        ("G99 G85 X1 Z-5 R2", "RAPID RAPID FEED FEED"),
        ("G99 G86 X1 Z-5 R2", "RAPID RAPID FEED SPINDLE RAPID SPINDLE"),
        ("G88 X1 Z-5 R2 P100", "RAPID RAPID FEED DWELL SPINDLE STOP RAPID SPINDLE"),
        ("G99 G89 X1 Z-5 R2 P100", "RAPID RAPID FEED DWELL FEED"),
    ]),
    "the last code or word of a group counts": (rows, {}, [
        ("G0 G1 X1", "FEED"), ("G1 G0 X1", "RAPID"),
    ]),
    "the last of a word counts": (path, {}, [
        ("G90 G91 G0 X1\nX1", [[1, 0, 0], [2, 0, 0]]), ("G0 X1 X2", [[2, 0, 0]]),
    ]),
    "variables and arithmetic": (xs, {}, [
        ("#1=3\n#2=#1*2+[4-1]/3\nG0 X#2\nX[#1+#2]\nX-#1", [7, 10, -3]),
        ("#100=1\nG0 X#100 #100=5\nX#100", [1, 5]),  # after the words
    ]),
    "a vacant variable leaves the word out": (path, {}, [
        ("G0 X1 Y1\nG0 X#5 Y2", [[1, 1, 0], [1, 2, 0]]),
    ]),
    "GOTO searches forward, then from the top": (xs, {}, [
        ("#1=0\nN10 #1=#1+1\nG0 X#1\nIF [#1 LT 3] GOTO 10\nGOTO 20\nG0 X99\nN20 G0 X50",
         [1, 2, 3, 50]),
        ("#1=5\nIF [#1 EQ 5] THEN #2=7\nIF [#1 EQ 6] THEN #2=8\nG0 X#2", [7]),
    ]),
    "WHILE and DO": (xs, {}, [
        ("#1=0\nWHILE [#1 LT 2] DO1\n#2=0\nWHILE [#2 LT 2] DO2\n#2=#2+1\nG0 X[10*#1+#2]\nEND2\n"
         "#1=#1+1\nEND1\nG0 X99", [1, 2, 11, 12, 99]),
        ("WHILE [1 EQ 2] DO1\nG0 X1\nEND1\nG0 X5", [5]),
        ("#1=0\nDO1\n#1=#1+1\nG0 X#1\nIF [#1 EQ 3] GOTO 9\nEND1\nN9 G0 X9", [1, 2, 3, 9]),
    ]),
    "M98 counts in L or before the last four digits": (xs, {}, [
        *((call + "\nM30\nO1000\nG91 G0 X1\nM99", [1, 2, 3])
          for call in ("M98 P1000 L3", "M98 P31000", "M98 P00031000")),
        ("M98 P1000 L0\nM30\nO1000\nG91 G0 X1\nM99", []),
        ("G0 X5 M98 P1000\nM30\nO1000\nG0 X7\nM99", [5, 7]),  # it moves before it calls
    ]),
    "M99 P returns to a block": (xs, {}, [
        ("M98 P1000\nG0 X1\nN50 G0 X2\nM30\nO1000\nG0 X9\nM99 P50", [9, 2]),
        ("O1\nG21G90\nM98P2\nG1X1.F100\nN50 G1X2.F100\nM30\nO2\nG1X9.F100\nM99P50\n", [9, 2]),
    ]),
    "M97 calls lines of the same program": (xs, {}, [
        ("G0 X1\nM97 P100 L2\nG0 X9\nM30\nN100 G91 G0 X1\nG90\nM99\n", [1, 2, 3, 9]),
    ]),
    "subprograms share local variables and macros have their own": (xs, {}, [
        ("#1=3\nM98 P1000\nG0 X#1\nM30\nO1000\n#1=7\nM99", [7]),
        ("#1=3\nG65 P1000\nG0 X#1\nM30\nO1000\n#1=7\nM99", [3]),
    ]),
    "letters of G65 are local variables": (xs, {}, [
        *((f"G65 P9010 A1 B2 C3 D7 E8 F9 H11 M13 Q17 R18 S19 T20 U21 V22 W23 X24 Y25 Z26{MACRO}"
           f"G0 X#{number}\nM99", [number])
          for number in (1, 2, 3, 7, 8, 9, 11, 13, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26)),
        *((f"G65 P9010 A1 I4 J5 K6 I7 K9 J11{MACRO}G0 X#{number}\nM99", [number])
          for number in (1, 4, 5, 6, 7, 9, 11)),
        (f"G91\nG65 P9010 L3 A1{MACRO}G0 X#1\n#1=5\nM99", [1, 2, 3]),
    ]),
    "arguments are taken as written where lengths count increments": (
        path, {"decimal": "increment"},
        [("G65 P1000 A1 X2.\nM30\nO1000\nG0 X#24 Y#1\nM99", [[2, 1, 0]])],
    ),
    "G66 calls after each move until G67": (path, {}, [
        (f"G0\nG66 P9010 A2\nX1\nM8\nX5\nG67\nX9{MACRO}G91 G0 Z#1\nG90\nM99",
         [[1, 0, 0], [1, 0, 2], [5, 0, 2], [5, 0, 4], [9, 0, 4]]),
    ]),
    "system variables": (
        xs, {"work_offsets": {"G54": (10.0, 0, 0, 0, 0, 0), "G54.1 P2": (7.0, 0, 0, 0, 0, 0)},
             "tools": {3: Tool(length=12.0)}}, [
            ("G0 Y3\nX#5221\nX#5042", [0, 20, 13]), ("G0 X2\nX#5021", [12, 22]),
            ("G0 X#7021\nX#4003", [17, 100]), ("#5221=4\nG0 X1", [5]), ("G0 X#11003", [22]),
            ("F250 S99 T5\nG0 X#4109\nX#4119\nX#4120", [260, 109, 15]),
            ("G20\n#5221=1\nG0 X#5221", [50.8]),
        ],
    ),
    "a level of block skip is on": (xs, {"block_skip": (1,)}, [("G0 X1\n/X2\n/3 X3", [1, 3])]),
    "block skip is off": (xs, {}, [("G0 X1\n/X2\n/3 X3", [1, 2, 3])]),
    "two levels of block skip": (xs, {"block_skip": (1, 3)}, [("G0 X1\n/X2\n/3 X3", [1])]),
    "numbers without a point": (path, {"decimal": "increment"}, [
        ("G0 X10 Y10.", [[0.01, 10, 0]]), ("G20 G0 X10000", [[25.4, 0, 0]]),
        ("#1=10\nG0 X#1", [[10, 0, 0]]),
    ]),
    "words that move nothing are passed over": (xs, {}, [
        *((f"G0 X1\n{words}\nG0 X2", [1, 2]) for words in (
            "G103 P1", "G187 P2 E0.1", "POPEN", "DPRNT[X#1[53]]", "SETVN100[A]")),
    ]),
    "a Haas mirrors by G101": (path, {}, [
        ("G101 X0\nG0 X3. Y2.\nG100 X0\nG0 X1.", [[-3, 2, 0], [1, 2, 0]]),
    ]),
    "rows of codes": (rows, {}, [
        ("G8 P1\nG5.1 Q1\nG5 P10000\nG1 X1\nG8 P0", "FEED"), ("G31 Z-5\nG0 X1", "PROBE RAPID"),
        ("G2 X2 I1\nM19 R90", "ARC SPINDLE"),
    ]),
    "; ends a block where lines end in it": (xs, {}, [("O1;\nG0 X1;\nX#0 X2; X3;\n", [1, 2, 3])]),
    "% ends a file": (xs, {}, [("%\nO1\nG0 X1\n%\nG0 X9", [1])]),
}  # fmt: skip
"""Rule -> what is seen of its programs, choices of the setup, programs with what is seen."""


@pytest.mark.parametrize("rule", RULES)
def test_rule_is_the_manuals(rule):
    seen, choices, cases = RULES[rule]
    for text, expected in cases:
        assert seen(text, **choices) == expected, text


@pytest.mark.parametrize("dialect", ["fanuc", "linuxcnc"])
@pytest.mark.parametrize("head", [
    "%\n\nO16\n", "(by hand)\n%\n(part)\n\nO16 (BRACKET)\n", "\nO1 (main)\n",
])  # fmt: skip
def test_comments_and_blank_lines_may_stand_before_the_number(head, dialect):
    text = head + "G21 G90 G94 F100\nM98 P2\nG1 X2\nM30\nO2\nG1 X1\nM99\n"
    assert xs(text, dialect=dialect) == [1, 2]


@pytest.mark.parametrize(("text", "words"), [
    ("GOTO 7", "N7 is not in the program"), ("WHILE [1 EQ 1] DO1\nG0 X1", "do not match"),
    ("END1", "do not match"), ("M98 P77", "O0077 is neither in this file nor"),
    ("M98 P1\nM30\nO1\nG0 X1", "does not return"), ("O1\nG0 X1\nO2\nG0 X2", "runs into the next"),
    ("\nG0 X1\nO16\nG0 X2\nM30", "runs into the next"),
    ("M98 P1\nM30\nO1\nM98 P1\nM99", "100 levels"), ("G65 A1", "which macro"),
    ("N1 GOTO 1", "more than 5001 blocks"), ("G0 X[1/0]", "1 / 0"), ("M98", "needs P"),
    ("#1=SQRT[-1]", "SQRT of -1"), ("#9999=1", "#9999 cannot be written"),
    ("G0 X#3001", "only the machine knows"), ("#3000=7 (PART MISSING)", "alarm 7"),
    ("M97 P7\nM30", "N7 to call is not in the program"), ("G91 G53 X1", "G91"),
    ("F9 G18 G68 X0 Z0 R9\nG17 G3 X2 I1", "leave its plane"),
    ("F9 G51 X0 Y0 Z0 I2000 J1000 K1000\nG2 X1 Y1 I1", "ellipse"),
    *((f"F9 G41 D1 G1 X9\n{code}\nY9", "G40") for code in (
        "G55", "G52 X1", "G92 X1", "G28 X0", "G68 R1", "G51 P2000", "G10 L2 P1 X1")),
    (HEAD + "G81 X1 Z-5", "begins without R"), (HEAD + "G81 X1 R5", "begins without Z"),
    (HEAD + "G83 X1 Z-5 R2", "add Q"), (HEAD + "G81 X1 Z5 R2", "exchange"),
    (HEAD + "G81 X1 Z-5 R2 K1.5", "whole number"),
    (HEAD + "G83 X1 Z-10 R2 I4 J1 K2 F100", "I J K of a Haas"),
    *((f"G21\n{words}\nM30", words[:3]) for words in ("M96 P5", "M200 P5", "M97 P5")),
    ("F100\nG12 I5 D1", "circular pockets"), ("F100\nG13 I5 D1", "circular pockets"),
    ("F100\nG150 P5 X0", "pocket milling"),
    ("F100\nG1 X10,R20\nY5", "takes 20 mm of lines of 10 and 5 mm"),
    ("F100\nG1 X10,R2\nX20", "two lines that meet at an angle"),
    ("F100\nG1 X10,R2\nG2 X20 Y10 I10", "has to be a straight line"),
    ("F100\nG1 X10,R2\nG4 P100", "has to be a straight line"),
    ("F100\nG1 X10,R2", "has to be a straight line"),
    ("F100\nG1 X10,R2\nY10 Z1", "in the plane"), ("F100\nG1 X10,C0\nY10", "give more than 0"),
    ("F100\nG51 X0 Y0 Z0 P2\nG1 X10,C1\nY10", "under G51"),
    ("M1.5", "is no M code"), ("G4 P-1", "is not possible: give 0 or more"),
    ("G27", "names no axis"), ("G68 X0 Y0 Z1 R9", "takes no Z"), ("G51 X1", "by how much"),
    ("G51 X0 Y0 Z0 P0", "scales by 0"), ("G0 X#<a>", "is a name"),
    (HEAD + "M5\nG95 G81 X1 Z-5 R2 F1.5 S100", "the spindle stands"),
])  # fmt: skip
def test_what_leads_nowhere_is_said(text, words):
    said = refusal(text, block_limit=5000, **TOOLS)
    assert words in said
    assert said.startswith("P:")


@pytest.mark.parametrize(("written", "with_point"), [
    ("G68 X0 Y0 R30000\nG0 X10000 Y0", "G68 X0 Y0 R30.\nG0 X1. Y0"),
    ("G51 X0 Y0 Z0 I2000 J3000 K1000\nG0 X10000 Y10000", "G51 X0 Y0 Z0 I2. J3. K1.\nG0 X1. Y1."),
    ("G1 X20000 ,R1000 F9.\nY20000", "G1 X2. ,R.1 F9.\nY2."),
    ("G1 X20000 ,C1000 F9.\nY20000", "G1 X2. ,C.1 F9.\nY2."),
    ("G91 G81 X10000 Z-10000 R-5000 K3 F9.", "G91 G81 X1. Z-1. R-.5 K3 F9."),
    ("G4 X1500", "G4 X1.5"), ("G4 U1500", "G4 U1.5"), ("G1 X10000 F200", "G1 X1. F200."),
])  # fmt: skip
def test_words_beside_lengths_keep_their_own_unit_where_lengths_count_increments(
    written, with_point
):
    """Angles, factors, counts and seconds do not count 0.0001 inch; sizes of corners do."""
    tried = [follow(f"G20\n{text}\n", decimal="increment") for text in (written, with_point)]
    for name, column in tried[0].columns():
        np.testing.assert_array_equal(column, getattr(tried[1], name))


def test_frames_are_named_and_shared():
    moves = follow("G0 X1\nG55 X1\nG54 X1\nG52 X5\nX1", **OFFSETS)
    names = [moves.frames[index].name for index in moves.frame]
    assert names == ["G54", "G55", "G54", "G54+G52"]
    assert moves.frames[moves.frame[-1]].translation[0] == 15.5


def test_frame_maps_the_program_to_the_machine():
    moves = follow("G54 G43 H1 G0 X1 Z2\nG68 X3 Y4 R30\nX6 Y7 Z8", **OFFSETS, **TOOLS)
    frame = moves.frames[moves.frame[-1]]
    c, s = math.cos(math.radians(frame.rotation)), math.sin(math.radians(frame.rotation))
    turned = np.array([c * 6 - s * 7, s * 6 + c * 7, 8.0])
    np.testing.assert_allclose(turned + frame.translation[:3], moves.end[-1, :3], atol=1e-9)


def test_g53_counts_in_the_machine_and_is_rapid():
    moves = follow("F9 G1 X1\nG53 X7 Z8\nX1", **OFFSETS)
    assert points(moves)[1:] == [[7, 0, 8], [11.5, 0, 8]]
    assert moves.kind.tolist() == [Kind.FEED, Kind.RAPID, Kind.FEED]


@pytest.mark.parametrize(("text", "words"), [
    ("G28", "G28 names no axis"), (HEAD + "G84 X1 Z-5 R2 Q1", "is peck tapping"),
    ("G51 X0 Y0 Z0 P2000 I2000 J1000 K1000", "G51 goes by I, J and K and does not read P"),
    (HEAD + "G76 X1 Z-5 R2 Q0.5 I1 J0", "I, J and K give the shift of the cycle: Q is not read"),
])  # fmt: skip
def test_what_is_assumed_or_not_read_is_said(text, words):
    assert words in " ".join(follow(text).notices)


def test_arcs_turn_with_g68_and_are_mirrored_by_g51_1():
    plain = follow("F9 G0 X5\nG3 X0 Y5 I-5")
    turned = follow("F9 G68 X0 Y0 R90\nG0 X5\nG3 X0 Y5 I-5")
    assert turned.end[-1, :2].round(9).tolist() == [-5, 0]
    assert turned.angle[-1] == pytest.approx(plain.angle[-1])
    assert turned.length[-1] == pytest.approx(plain.length[-1])
    moves = follow("F9 G51.1 X0\nG0 X5\nG3 X0 Y5 I-5\nG50.1 X0\nG0 X5")
    assert points(moves) == [[-5, 0, 0], [0, 5, 0], [5, 5, 0]]
    assert moves.angle[1] == pytest.approx(-math.pi / 2)
    assert moves.centre[1].tolist() == [0, 0, 0]


number = st.floats(-500, 500)


@given(
    st.lists(number, min_size=6, max_size=6),
    number, number, st.sampled_from([17, 18, 19]),
    st.lists(st.floats(0.1, 5), min_size=3, max_size=3),
    st.lists(st.sampled_from([1.0, -1.0]), min_size=3, max_size=3),
    st.lists(number, min_size=6, max_size=6),
)  # fmt: skip
def test_program_coordinates_come_back_from_the_machine(
    point, angle, turn, plane, scale, mirror, shift
):
    offsets = Offsets(
        work={"G54": shift}, rotations={"G54": turn}, rotation=angle, plane_of_rotation=plane,
        centre_of_rotation=(shift[0], shift[1]), scale=scale, mirror=mirror, g92=shift,
        scale_centre=shift[:3], mirror_centre=shift[:3],
    )  # fmt: skip
    mapping = offsets.transform()
    back = mapping.program(mapping.machine(point))
    # 1e4 mm times the rounding of doubles, divided by the smallest scale
    np.testing.assert_allclose(back, point, atol=1e-9, rtol=0)


def test_rows_of_cycles_bear_their_line_seconds_and_direction():
    assert set(follow(HEAD + "G83 X1 Z-5 R2 Q1").line.tolist()) == {1, 2}
    moves = follow(HEAD + "G82 X1 Z-5 R2 P500")
    assert moves.value[moves.kind == Kind.DWELL].tolist() == [0.5]
    assert follow(HEAD + "G99 G86 X1 Z-5 R2").direction[-3:].tolist() == [0, 0, 1]


@pytest.mark.parametrize(("code", "turns"), [("G84", [-1, 1]), ("G74", [1, -1])])
def test_tapping_turns_back_at_the_bottom(code, turns):
    moves = follow(HEAD + f"M{3 if code == 'G84' else 4}\nG99 {code} X1 Z-5 R2 P100")
    spindle = moves.direction[moves.kind == Kind.SPINDLE]
    assert spindle[-2:].tolist() == turns
    assert kinds(moves)[-5:] == ["FEED", "DWELL", "SPINDLE", "FEED", "SPINDLE"]


def test_rigid_tapping_starts_the_spindle_and_is_bound_to_it():
    moves = follow(HEAD + "M29 S500\nG99 G84 X1 Z-5 R2 F625\nG80 G1 X5")
    thread = moves.kind == Kind.THREAD
    assert moves.feed[thread].tolist() == [1.25, 1.25] and moves.feed[-1] == 625
    assert (moves.feed_mode[thread] == FeedMode.PER_REVOLUTION).all()
    moves = follow(HEAD + "M5\nM29 S100\nG95 G84 X1 Z-5 R2 F1.5\nG80")
    assert moves.direction[moves.kind == Kind.THREAD].tolist() == [1, -1]


@pytest.mark.parametrize("code", ["G83", "G73"])
def test_q_without_a_point_that_is_deeper_than_the_hole_is_asked_about(code):
    text = HEAD + f"G99 {code} X1 Z-10 R2 Q5000 F100\nG80"
    assert "setup.peck_increments" in refusal(text)
    for setup, other in (({"peck_increments": True}, "Q5."), ({"peck_increments": False}, "Q12.")):
        assert path(text, **setup) == path(text.replace("Q5000", other), **setup)
    # as deep as the hole it is asked about no more, and in inches increments are of 0.0001 inch
    assert path(text.replace("Q5000", "Q12")) == path(text.replace("Q5000", "Q12."))
    inch = "G20\n" + text.replace("Q5000", "Q50000")
    assert path(inch, peck_increments=True) == path(inch.replace("Q50000", "Q5."))


@pytest.mark.parametrize("code", ["G76", "G87"])
def test_a_shift_without_a_point_that_is_wider_than_the_hole_is_deep_is_asked_about(code):
    z, r = (-10, 2) if code == "G76" else (2, -10)
    text = HEAD + f"M3 S100\nG99 {code} X1 Z{z} R{r} Q200 F100\nG80"
    assert "setup.peck_increments" in refusal(text)
    assert path(text, peck_increments=True) == path(text.replace("Q200", "Q0.2"))


def test_m99_ends_one_pass_of_an_endless_program_and_3006_stops():
    assert kinds(follow("G0 X1\nM99")) == ["RAPID", "END"]
    assert kinds(follow("#3006=1 (LOOK)")) == ["STOP"]


def test_subprograms_in_other_files(tmp_path):
    (tmp_path / "O1234.nc").write_text("%\nO1234\nG0 X4\nM99\n%\n")
    (tmp_path / "9010").write_text("G0 X#1\nM99\n")
    moves = follow("M98 P1234\nG65 P9010 A7\nG0 X1\nM30", folders=(tmp_path,))
    assert [point[0] for point in points(moves)] == [4, 7, 1]
    assert moves.files == ("P", "O1234.nc", "9010")
    assert [moves.files[file] for file in moves.file] == ["O1234.nc", "9010", "P", "P"]
    assert moves.line.tolist() == [3, 1, 3, 4]


# the table of modal groups, and what it says of codes in one block


def test_every_code_belongs_to_one_group_and_is_carried_out():
    codes = [code for group in GROUPS.values() for code in group.codes]
    assert len(codes) == len(set(codes))
    assert all(group.default in group.codes for group in GROUPS.values())
    assert {*codes, *ONE_SHOT} - HANDLERS.keys() == set()
    every = [*codes, *ONE_SHOT]
    assert all(excludes(a, b) == excludes(b, a) for a in every for b in every)
    assert [g_code(code) for code in (0, 10, 541, 901)] == ["G0", "G1", "G54.1", "G90.1"]


@pytest.mark.parametrize("dialect", M_STEPS)
def test_what_starts_comes_before_the_motion_and_what_ends_after(dialect):
    motion, steps = GROUPS["motion"].step, M_STEPS[dialect]
    assert WORD_STEPS["F"] < WORD_STEPS["S"] < steps[3] < motion < steps[30]


def test_codes_of_other_dialects_are_not_known():
    assert step_of(680, "fanuc") and step_of(680, "linuxcnc") is None
    assert step_of(911, "linuxcnc") and step_of(50, "linuxcnc") is None
    assert "G68 is not known in the dialect linuxcnc" in refusal("G68 R1", dialect="linuxcnc")


@pytest.mark.parametrize("text", [
    "G0 G1", "G17 G18", "G20 G21", "G40 G41", "G54 G55", "G28 X1 G0", "M3 M5", "M0 M30", "G0 X1 X2",
])  # fmt: skip
def test_codes_of_one_group_exclude_each_other_in_linuxcnc(text):
    said = refusal(text, dialect="linuxcnc")
    assert "exclude each other" in said or "stands twice" in said
