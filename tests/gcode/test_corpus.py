"""Recorded programs: read, equal to rs274's where both accept, refused with a reason where not."""

import os
import re
from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter, interpret
from pipeline.gcode.moves import INCH, Kind
from pipeline.gcode.program import parse_program, read_program
from pipeline.gcode.setup import Setup, Tool
from tests.gcode.rs274 import RS274, Oracle
from tests.gcode.test_rs274 import assert_same

RECORDINGS = os.environ.get("KERF_RECORDINGS")
FOLDER = Path(RECORDINGS or ".")
LINUXCNC = FOLDER / "gcode" / "linuxcnc" / "nc_files"
pytestmark = pytest.mark.skipif(
    not LINUXCNC.is_dir(), reason="KERF_RECORDINGS names no folder with gcode/linuxcnc"
)
with_oracle = pytest.mark.skipif(not RS274.exists(), reason=f"{RS274} is not installed")

SUBROUTINES = [
    LINUXCNC / name
    for name in ("ngcgui_lib", "ngcgui_lib/utilitysubs", "ngcgui_lib/lathe", "macros/mill", ".")
]
"""Where programs look for subroutines; rs274 takes five folders."""
TOOLS = {number: (5.0 * (number % 7) + 1.5, 1.0 + number % 5) for number in range(1, 100)}
"""Number -> length, diameter [mm]."""
BARE = {number: (0.0, diameter) for number, (_, diameter) in TOOLS.items()}
LENGTH_WITH_CHANGE = re.compile(rb"(?im)^[^(;\r\n]*M0*6[^\r\n]*G43|^[^(;\r\n]*G43[^\r\n]*M0*6")
"""rs274 asks its stub where it stands after M6, which forgets a G43 of the same block."""
SENTENCE = re.compile(r"^.+:\d+:\d+: .+: .+")


def _setup(tools, folders=SUBROUTINES) -> Setup:
    return Setup(
        dialect="linuxcnc",
        tools={n: Tool(length=length, diameter=d) for n, (length, d) in tools.items()},
        folders=tuple(folders),
        inch_machine=True,  # as rs274 plays
        block_limit=2_000_000,
    )


def _tools(path: Path):
    return BARE if LENGTH_WITH_CHANGE.search(path.read_bytes()) else TOOLS


@cache
def _refusal(path: Path) -> str:
    try:
        interpret(read_program(path), _setup(_tools(path)))
    except GcodeError as error:
        return str(error)
    return ""


def _programs() -> list[Path]:
    return sorted(LINUXCNC.rglob("*.ngc"))


READ = {
    ".": 45, "macros/lathe": 9, "macros/mill": 3, "ngcgui_lib": 19, "ngcgui_lib/lathe": 6,
    "ngcgui_lib/utilitysubs": 14, "nurbs/G5": 0, "nurbs/G6": 0,
}  # fmt: skip
"""Folder -> programs that are read, at least."""
QUICK = ("macros/mill", "ngcgui_lib", "nurbs/G5", "nurbs/G6")
"""Folders of the ordinary suite."""
REASONS = {
    "not supported": 58,  # splines, NURBS, lathe cycles
    "known only when the machine has run": 2,  # what a probe told
    "not known in the dialect": 1,  # a remapped code
    "no axis W": 1,
    "with compensation does not move in the plane": 2,
    "nothing may follow here": 1,
}
"""Part of a refusal -> how often it is said, at most."""


@pytest.mark.parametrize("folder", [
    folder if folder in QUICK else pytest.param(folder, marks=pytest.mark.proof) for folder in READ
])  # fmt: skip
def test_count_of_programs_read(folder):
    read = sum(not _refusal(path) for path in _programs() if path.parent == LINUXCNC / folder)
    assert read >= READ[folder]


@pytest.mark.proof
def test_every_refusal_names_place_word_and_remedy():
    refusals = [refusal for path in _programs() if (refusal := _refusal(path))]
    assert all(SENTENCE.match(refusal) for refusal in refusals)
    for part, most in REASONS.items():
        assert sum(part in refusal for refusal in refusals) <= most, part
    unexpected = [r for r in refusals if not any(part in r for part in REASONS)]
    assert unexpected == []


@with_oracle
@pytest.mark.parametrize(("step", "least"), [
    (15, 3), pytest.param(1, 52, marks=[pytest.mark.slow, pytest.mark.proof]),
])  # fmt: skip
def test_positions_are_rs274s(step, least, tmp_path):
    """Of each ``step``-th program; ``least`` of them are read by both."""
    oracles = {}
    for name, tools in (("tools", TOOLS), ("bare", BARE)):
        (tmp_path / name).mkdir()
        oracles[name] = Oracle(tmp_path / name, tools, SUBROUTINES)
    same = []
    for path in _programs()[::step]:
        tools = _tools(path)
        answer = oracles["tools" if tools is TOOLS else "bare"].ask(path)
        if answer.error or answer.probed or _refusal(path):
            continue
        assert_same(interpret(read_program(path), _setup(tools)), answer)
        same.append(path.name)
    assert len(same) >= least


@with_oracle
@pytest.mark.parametrize(("step", "least"), [
    (12, 4), pytest.param(1, 62, marks=[pytest.mark.slow, pytest.mark.proof]),
])  # fmt: skip
def test_subroutines_with_their_defaults_are_rs274s(step, least, tmp_path):
    """The subroutines alone move nothing: call them with the defaults of their comments."""
    oracle = Oracle(tmp_path, BARE, SUBROUTINES)
    same = Counter()
    for path in _programs()[::step]:
        text = path.read_text("latin-1")
        named = re.search(r"(?im)^\s*o<([^>]+)>\s*sub", text)
        if named is None:
            continue
        pattern = r"#<[^>]+>\s*=\s*#(\d+)\s*\(\s*=\s*([-+]?[\d.]+)"
        defaults = {int(number): value for number, value in re.findall(pattern, text)}
        last = max(defaults, default=3)
        arguments = " ".join(f"[{defaults.get(n, '1')}]" for n in range(1, last + 1))
        for head in ("G20 F10 M3 S100 T1 M6", "G21 G0 X1 Y1 Z1 F100 G64"):
            caller = f"{head}\nG0 Z1\no<{named[1]}> call {arguments}\nM2\n"
            answer = oracle.ask_text(caller)
            try:
                moves = interpret(parse_program(caller.encode(), "caller"), _setup(BARE))
            except GcodeError:
                continue
            if not (answer.error or answer.probed):
                assert_same(moves, answer)
                same[path.name] += 1
    assert sum(same.values()) >= least


NIST_BOX = {
    "NIST_MTC_CRADA_BOX_REV-A OP2 (Front).NC": 1884.570,
    "NIST_MTC_CRADA_BOX_REV-A OP3 (Back).NC": 5367.263,
    "NIST_MTC_CRADA_COVER_REV-A.NC": 1555.488,
    "NIST_MTC_CRADA_PLATE-1.NC": 18542.537,
    "NIST_MTC_CRADA_PLATE-2.NC": 18558.415,
    "NIST_MTC_CRADA_PLATE-3.NC": 18558.415,
    "NIST_MTC_CRADA_PLATE-4.NC": 8806.572,
    "NIST_MTC_CRADA_PLATE-5.NC": 18558.415,
}
"""Program -> path [mm] as first read: that nothing is lost later."""


@pytest.mark.parametrize("name", NIST_BOX)
def test_nist_box_is_read(name):
    program = read_program(FOLDER / "nist_box" / "programs" / name)
    moves = interpret(program, Setup())
    assert moves.kind[-1] == Kind.END
    assert moves.length.sum() == pytest.approx(NIST_BOX[name], abs=0.001)
    assert moves.feed[moves.kind == Kind.FEED].min() >= INCH  # F in inch/minute


@pytest.mark.parametrize("name", ["FIXT", "OP1", "OP2"])
def test_nist_d2mi_is_read(name):
    """Macros, G10, G41 with D, G53; tools of half a millimetre fit every contour."""
    program = read_program(FOLDER / "gcode" / "nist_d2mi" / f"827-9999-904, {name}.NC")
    tool = Tool(diameter=0.02 * INCH)
    moves = interpret(program, Setup(tools=dict.fromkeys(range(1, 40), tool)))
    contour = interpret(program, Setup())
    assert moves.kind[-1] == Kind.END
    np.testing.assert_allclose(moves.end[-1], contour.end[-1])
    beside = np.abs(moves.end[:, :2] - contour.end[:, :2]).max()
    assert 0.01 * INCH - 1e-9 <= beside < 0.05 * INCH  # the radius; more only in sharp corners


@pytest.mark.proof
def test_interpreted_as_compiled():
    """Line by line and with compiled stretches: the same bits of a recorded program."""
    program = read_program(FOLDER / "nist_box" / "programs" / "NIST_MTC_CRADA_PLATE-4.NC")
    slow = Interpreter(program, Setup(), compiled=False).moves()
    fast = Interpreter(program, Setup()).moves()
    for (name, a), (_, b) in zip(slow.columns(), fast.columns(), strict=True):
        assert np.array_equal(a, b, equal_nan=a.dtype.kind == "f"), name
