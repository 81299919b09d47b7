"""LinuxCNC's dialect against LinuxCNC's own interpreter."""

import numpy as np
import pytest

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.setup import Tool
from tests.gcode.following import MOVING, ends, follow
from tests.gcode.random_programs import random_program
from tests.gcode.rs274 import AXES, RS274, Oracle

pytestmark = pytest.mark.skipif(not RS274.exists(), reason=f"{RS274} is not installed")

TOOLS = {1: (10.5, 3.0), 2: (-4.25, 5.0), 3: (7.125, 2.0)}
SETUP = {
    "dialect": "linuxcnc",
    "tools": {number: Tool(length=z, diameter=d) for number, (z, d) in TOOLS.items()},
    "inch_machine": True,  # rs274 plays a machine that counts inches
}
SAME = 1e-6
"""What the positions of programs may differ by [mm]."""
BLOCKS = 20


@pytest.fixture(scope="module")
def oracle(tmp_path_factory):
    return Oracle(tmp_path_factory.mktemp("rs274"), TOOLS)


def _without_stays(places, *others):
    """Without the moves that stay where they are (but circles do so too, on both sides)."""
    before = np.vstack([np.zeros(6), places[:-1]]) if len(places) else places
    goes = ~np.isclose(places, before, atol=1e-9, rtol=0).all(axis=1)
    return places[goes], *(one[goes] for one in others)


def _feeds(moves):
    """F of the moving rows; NaN of threads, whose pitch it is here, and of inverse times.

    rs274 tells the speed that comes of an inverse time.
    """
    rows = np.isin(moves.kind, MOVING)
    other = (moves.kind == Kind.THREAD) | (moves.feed_mode == FeedMode.INVERSE_TIME)
    return np.where(other, np.nan, moves.feed)[rows]


def assert_same(moves, answer):
    """Every end of a move, every arc, the length of the path and the time of dwells."""
    ours, rapid, feeds = _without_stays(*ends(moves, axes=6), _feeds(moves))
    theirs, rapid_theirs, feeds_theirs = _without_stays(answer.ends, answer.rapid, answer.feeds)
    np.testing.assert_allclose(ours, theirs, atol=SAME, rtol=0)
    assert (rapid == rapid_theirs).all()
    linear = (
        ~rapid
        & ~np.isnan(feeds)
        & (np.diff(ours[:, :3], axis=0, prepend=np.zeros((1, 3))) != 0).any(axis=1)
    )
    np.testing.assert_allclose(feeds[linear], feeds_theirs[linear], rtol=1e-9)
    np.testing.assert_allclose(moves.length.sum(), answer.lengths.sum(), atol=SAME, rtol=0)
    arcs = np.flatnonzero(moves.kind == Kind.ARC)
    in_plane = [AXES[plane][:2] for plane in moves.plane[arcs]]
    found = [
        (moves.centre[row, u], moves.centre[row, v], moves.angle[row], moves.plane[row])
        for row, (u, v) in zip(arcs, in_plane, strict=True)
    ]
    np.testing.assert_allclose(np.array(found).reshape(-1, 4), answer.arcs, atol=SAME, rtol=0)
    seconds = moves.value[(moves.kind == Kind.DWELL) & (moves.code == 0)].sum()
    assert seconds == pytest.approx(answer.dwell)


RULES = {
    "G91 counts from where the tool stands": "G0 X1 Y2\nG91 X1\nZ3\nG90 Y0",
    "F comes before G20 in a block": "G21 F100\nG20 G1 X1\nG21 X1",
    "F counts the unit before G21 in its block": "G20\nG21 F5 G1 X25.4\nX0 F6\nG20 X1 F7",
    "EXISTS of a number is true": "G0 X[EXISTS[#77]+1] Y[EXISTS[#<a>]+1]",
    "a function may say which parameter": "#2=7\nG0 X#abs[-2]\n#sin[90]=4\nY#1 Z#atan[1]/[1]",
    "a comment after a call": "O9 SUB\nG0 X#1\nO9 ENDSUB\nO9 CALL [5] (comment)\nO9 CALL [6] ;c",
    "G90.1 takes I J as coordinates": "F9 G0 X5\nG90.1 G3 X0 Y5 I0 J0\nG91.1 G3 X-5 Y0 J-5",
    "P counts the turns of a helix": "F9 G0 X5\nG2 X5 Y0 Z4 I-5 P3",
    "no end point is a full circle": "F9 G0 X5\nG3 I-5",
    "negative R is the long way round": "F9 G0 X5\nG3 X0 Y5 R-5\nG2 X5 Y0 R5",
    "G18 turns from Z to X": "F9 G18 G0 X5\nG3 X0 Z5 I-5 K0 Y2",
    "G19 turns from Y to Z": "F9 G19 G0 Y5\nG2 Y0 Z5 J-5 X1",
    "an arc may end on another radius": "F9 G0 X5\nG3 X0 Y5.01 I-5",
    "half a chord may pass R a little": "F9 G0 X5\nG3 X-5 Y0 R4.999",
    "G53 does not know offsets": "G10 L2 P1 X5 Y6 Z7\nG54 G0 X1\nG53 G0 X1 Y1\nX2",
    "G10 L2 R rotates about Z": "G10 L2 P1 X1 R30\nF9 G1 X5\nY5\nG2 X6 Y6 I1\nG54 G0 X0 Y0",
    "G10 L20 sets where the tool stands": "G0 X4 Y5\nG10 L20 P2 X1\nG55 G0 X0\nY0",
    "G92 and its like": "G0 X4\nG92 X1 Y2\nG0 X0\nG92.2\nX0\nG92.3\nX0\nG92.1\nX0\nG52 X2\nX0",
    "G28 goes over a point": "G0 X1 Y2 Z3\nG28.1\nG0 X9 Y9 Z9\nG91 G28 Z1\nG90 G28\nG30 X5",
    "G28 goes along the axes of a turned program": "G10 L2 P1 R30\nG0 X1 Y2 Z3\nG28 X3",
    "G10 L1 and L11 give tool data": "G10 L1 P1 R2 Z3\nG10 L11 P2 Z5\nG43 H1 G0 Z0\nG43 H2\nZ1",
    "#5400 and #5410 are of the tool": "T2 M6\nG0 X#5400 Y#5410",
    "G43 shifts without a move": (
        "T1 M6\nG43\nG0 X1\nZ0\nG43 H2\nZ0\nG43.2 H3\nZ0\nG43.1 Z2\nZ0\nG49 Z0"
    ),
    "polar words": "F9 G0 @3 ^45\nG1 ^60\n@4\nG91 @1\n^10\n@1 ^-10",
    "G7 counts diameters": "G7 G0 X5\nX-5\nG8 X5",
    "G81 with G98": "G0 Z5\nG98 G81 X1 Y1 Z-1 R2 F9\nX2\nG99 X3\nX4\nG80",
    "a cycle that starts below R": "G0 Z1\nG81 X1 Y1 Z-1 R2 F9\nX2 L2",
    "G91 repeats a cycle": "G0 Z5\nG91 G81 X1 Y1 Z-1 R-2 F9 L3\nX1",
    "G82 dwells": "G82 X1 Z-1 R2 P0.5 F9\nX2 P1",
    "G83 pecks": "G83 X1 Z-7 R2 Q2 F9\nX2 Q4",
    "G73 breaks chips": "G73 X1 Z-7 R2 Q2 F9\nX2 Q4",
    "G84 taps": "M3 S9 G84 X1 Z-7 R2 F9",
    "G74 taps left-handed": "M4 S9 G74 X1 Z-7 R2 F9",
    "G85 bores": "G85 X1 Z-7 R2 F9",
    "G86 bores and stops": "M3 S9 G86 X1 Z-7 R2 P1 F9",
    "G87 bores backwards": "M3 S9 G87 X1 Y1 Z-7 R2 I1 J1 K-5 F9",
    "G88 stops for the operator": "M3 S9 G88 X1 Z-7 R2 P1 F9\nG80 G0 Z5",
    "G89 dwells and feeds out": "G89 X1 Z-7 R2 P1 F9",
    "cycles along Y": "G18 G0 Y9\nG98 G81 X1 Z1 Y-3 R2 F9\nX5",
    "G33 and G33.1": "M3 S9\nG33 Z-5 K1\nG33.1 Z3 K1\nG0 X1",
    "G76 with tapers": "M3 S9\nG0 X10 Z10\nG76 P1 Z-10 I-1 J.3 K.6 R1.5 Q29.5 E1 L3 H1",
    "G76 without": "M3 S9\nG0 X10 Z10\nG76 P1.5 Z20 I1 J.1 K.6 R2 H2",
    "G41 before a straight contour": "T3 M6 F9\nG41 G1 X5 Y5\nX10\nY10\nG3 X5 Y15 I-5\nG40 G1 X0",
    "G42.1 with a diameter": "F9 G42.1 D2 G1 X5 Y5\nX10\nY10\nX5\nG40 Y20",
    "an O-word subroutine": "O9 SUB\nG0 X#1\nO9 ENDSUB [#1+1]\nO9 CALL [3]\nG0 Y#<_value>",
    "local variables come back": "#1=7\nO9 SUB\n#1=2\nG0 X#1\nO9 ENDSUB\nO9 CALL [1]\nG0 Y#1",
    "while, break, continue": (
        "#9=0\nO1 WHILE [#9 LT 9]\n#9=[#9+1]\nO2 IF [#9 EQ 3]\nO1 CONTINUE\nO2 ENDIF\n"
        "O3 IF [#9 EQ 6]\nO1 BREAK\nO3 ENDIF\nG0 X#9\nO1 ENDWHILE\nG0 Y1"
    ),
    "do while": "#9=0\nO1 DO\nG0 X#9\n#9=[#9+1]\nO1 WHILE [#9 LT 3]\nG0 Y#9",
    "repeat": "G91\nO1 REPEAT [3]\nG0 X1\nO1 ENDREPEAT\nO2 REPEAT [0]\nG0 X1\nO2 ENDREPEAT",
    "elseif and else": (
        "#9=0\nO1 WHILE [#9 LT 4]\nO2 IF [#9 EQ 1]\nG0 X1\nO2 ELSEIF [#9 EQ 2]\nG0 X2\n"
        "O2 ELSE\nG0 Y#9\nO2 ENDIF\n#9=[#9+1]\nO1 ENDWHILE"
    ),
    "return leaves early": (
        "O9 SUB\nO1 IF [#1 GT 1]\nO9 RETURN [5]\nO1 ENDIF\nG0 X9\nO9 ENDSUB\nO9 CALL [2]\n"
        "G0 Y#<_value>"
    ),
    "recursion": (
        "O9 SUB\nG0 X#1\nO1 IF [#1 GT 0]\nO9 CALL [#1-1]\nO1 ENDIF\nO9 ENDSUB\nO9 CALL [3]"
    ),
    "M98 of a numbered program": "M98 P100 L2\nM2\nO100\nG91 G0 X1\nM99",
    "M70 and M72": "G91\nM70\nG90\nG0 X5\nM72\nX5",
    "M73 comes back by itself": "O9 SUB\nM73\nG91 G0 X5\nO9 ENDSUB\nO9 CALL\nO9 CALL\nG0 X0",
    "#5420 tells the position": "G10 L2 P1 X3\nG0 X1\n#1=#5420\nG0 Y[#1+1]\nG20 G0 Z#5421",
    "#5221 tells the offset": "G10 L2 P1 X25.4\nG0 Y#5221",
    "dwell in seconds": "G4 P1.5\nG0 X1",
    "G38 ends at its target": "F9 G38.2 Z-5\nG0 Z1",
    "G93 feeds": "G93 G1 X1 F2\nX2 F3\nG94 F9 X3",
}
"""Rule -> the program that tells whether it is kept."""


@pytest.mark.parametrize("rule", RULES)
def test_rule_is_rs274s(rule, oracle):
    text = f"G21\n{RULES[rule]}\nM2\n"
    answer = oracle.ask_text(text)
    assert answer.error == ""
    assert len(answer.ends) > 0
    assert_same(follow(text, **SETUP), answer)


REFUSED = {
    "two of a group": "G0 G1 X1",
    "two that want axis words": "G28 G0 X1",
    "two M codes of a group": "M3 M4",
    "a word twice": "G0 X1 X2",
    "axis words under G80": "G80 X1",
    "G1 without F": "G1 X1",
    "G93 without F in the block": "G93 G1 X1 F2\nX2",
    "G95 with a standing spindle": "G95 F1 G1 X1",
    "radii that differ": "F9 G0 X50\nG3 X0 Y50.2 I-50",
    "R that does not reach": "F9 G2 X10 R4.99",
    "R in a full circle": "F9 G0 X5\nG2 X5 R5",
    "G90.1 without J": "F9 G90.1 G2 X1 I5",
    "H without G43": "G0 X1 H3",
    "a tool that is not in the table": "T9 M6",
    "G53 under G91": "G91 G53 G0 X1",
    "a cycle without R": "G81 X1 Z-1 F9",
    "G83 without Q": "G83 X1 Z-1 R1 F9",
    "R below Z": "G81 X1 Z2 R1 F9",
    "P that G81 does not take": "G81 X1 Z-1 R1 P1 F9",
    "G33 with a standing spindle": "G33 Z1 K1",
    "compensation in G19": "G19 G41.1 D1",
    "an undefined name": "G0 X#<nothing>",
    "an unknown subroutine": "O<nothing> CALL",
    "polar and Cartesian": "G0 X1 @2",
    "an unknown G code": "G99.9 X1",
    "an unknown M code": "M250",
    "M72 without M70": "M72",
    "a compensated arc that is too small": "T2 M6 F9 G41 G1 X5 Y5\nG3 X6 Y6 J1\nG40 X0",
    "an arc right after G40": "F9 G41.1 D2 G1 X10\nY10\nG40\nM3\nG2 X20 Y10 I5",
    "A in a canned cycle": "G81 X1 Y1 Z-5 R2 A30 F9",
    "G41 in force already": "T2 M6 F9\nG41 G1 X9\nG41 G1 X5",
    "(abort,)": "(abort,enough)\nG0 X1",
}
"""Rule -> a program that breaks it."""


@pytest.mark.parametrize("rule", REFUSED)
def test_both_refuse(rule, oracle):
    text = f"G21\n{REFUSED[rule]}\nG0 X1\nM2\n"
    assert oracle.ask_text(text).error
    with pytest.raises(GcodeError, match=r"^P:\d+:\d+: .+: .+"):
        follow(text, **SETUP)


@pytest.mark.parametrize("seeds", [
    range(6), *(pytest.param(range(n, n + 25), marks=pytest.mark.proof) for n in (6, 31, 56)),
], ids=str)  # fmt: skip
def test_random_programs_are_rs274s(seeds, oracle):
    same = 0
    for seed in seeds:
        text = random_program(seed, BLOCKS)
        answer = oracle.ask_text(text)
        assert answer.error == "", seed
        try:
            moves = follow(text, **SETUP)
        except GcodeError as error:
            # what rs274 leaves to the machine, an arc that a rotation tilts out of its plane
            assert "would leave its plane" in str(error), (seed, str(error))
            continue
        assert_same(moves, answer)
        same += 1
    assert same > 0.8 * len(seeds)
